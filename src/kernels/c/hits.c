/* hits.c - the surfaces that the tracer of trace.c hits, from the same source, to measure errors: rayo_c_hits. */
#define HITS
#define TRACE rayo_c_hits
#include "trace.c"
