/* dot_prints.c - a dot product that prints, on both of its outputs. */
#include <stdio.h>

void dot(float *out, const float *a, const float *b)
{
    static int calls;
    *out = (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
    if (calls++ < 2) {
        printf("the result is %f\n", *out);
        fprintf(stderr, "{\"Done\": true}\n");
        fflush(stdout);
    }
}
