/* dot_signals.c - a dot product that changes what a signal does. */
#include <signal.h>

void dot(float *out, const float *a, const float *b)
{
    signal(SIGSEGV, SIG_IGN);
    *out = (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
}
