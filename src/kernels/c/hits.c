/* hits.c - what the tracer of trace.c hits, by the same source, for measuring errors: rayo_c_hits. */
#define HITS
#define TRACE rayo_c_hits
#include "trace.c"
