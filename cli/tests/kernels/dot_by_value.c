/* dot_by_value.c - the dot product in C, in the order of the twin. */
typedef struct { float x, y, z, w; } Vec4;

void dot(float *out, const Vec4 *a, const Vec4 *b)
{
    *out = (a->x * b->x + a->y * b->y) + (a->z * b->z + a->w * b->w);
}
