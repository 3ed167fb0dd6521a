/* ops.c - the operations and intersections of paper.h as functions of their own, named as in asm/ops/aos.asm. */
#include "paper.h"

#define OP(name, out_type, a_type, b_type)                                                                             \
    KERNEL void rayo_c_##name(out_type *out, const a_type *a, const b_type *b)

static inline ray along(const vec4 *direction) {
    return (ray){.origin = {0, 0, 0, 0}, .direction = *direction};
}

OP(add, vec4, vec4, vec4) {
    *out = vec_add(*a, *b);
}

OP(sub, vec4, vec4, vec4) {
    *out = vec_sub(*a, *b);
}

OP(scale, vec4, vec4, float) {
    *out = vec_scale(*a, *b);
}

OP(dot, float, vec4, vec4) {
    *out = vec_dot(*a, *b);
}

OP(norm, float, vec4, vec4) {
    (void)b;
    *out = vec_norm(*a);
}

OP(cross, vec4, vec4, vec4) {
    *out = vec_cross(*a, *b);
}

OP(normalise, vec4, vec4, vec4) {
    (void)b;
    *out = vec_normalise(*a);
}

OP(sphere, float, vec4, sphere) {
    float t;
    *out = sphere_hit(along(a), b, &t) ? t : INFINITY;
}

OP(triangle, float, vec4, triangle) {
    float t;
    *out = triangle_hit(along(a), b, &t) ? t : INFINITY;
}

OP(lambert, vec4, surface, light) {
    *out = reflection(b, a->point, a->normal, a->colour, false);
}

OP(lambert2, vec4, surface, light) {
    *out = reflection(b, a->point, a->normal, a->colour, true);
}
