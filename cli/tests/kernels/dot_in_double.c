/* dot_in_double.c - a dot product that is rounded once, which is within the bound of any order. */
void dot(float *out, const float *a, const float *b)
{
    *out = (float)((double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2] + (double)a[3] * b[3]);
}
