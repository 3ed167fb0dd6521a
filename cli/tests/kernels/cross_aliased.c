/* cross_aliased.c - a cross product that writes its result lane by lane, while it still reads the arguments. */
typedef struct { float x, y, z, w; } Vec4;

void cross(Vec4 *out, const Vec4 *a, const Vec4 *b)
{
    out->x = a->y * b->z - a->z * b->y;
    out->y = a->z * b->x - a->x * b->z;
    out->z = a->x * b->y - a->y * b->x;
    out->w = 0;
}
