/* paper.h - the paper's C: vectors of four floats passed by value to small functions, eq. 1 to 11. */
#ifndef RAYO_PAPER_H
#define RAYO_PAPER_H

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "layout.h" /* made by build.rs from asm/include/layout.inc */

typedef struct {
    _Alignas(16) float x;
    float y, z, w;
} vec4;

typedef struct {
    vec4 origin, direction;
} ray;

typedef struct {
    vec4 background;
    float step, half_width, half_height, focal;
    uint64_t first, width;
} frame;

typedef struct {
    vec4 position, radiance;
} light;

typedef struct {
    vec4 centre, colour;
    float radius, padding[3];
} sphere;

typedef struct {
    vec4 v1, v2, v3, colour;
} triangle;

typedef struct {
    const light *lights;
    uint64_t light_count;
    const sphere *spheres;
    uint64_t sphere_count;
    const triangle *triangles;
    uint64_t triangle_count;
} lists;

typedef struct {
    vec4 point, normal, colour;
} surface;

#define SAME_OFFSET(type, field, offset) static_assert(offsetof(type, field) == offset, #type "." #field)
#define SAME_SIZE(type, size) static_assert(sizeof(type) == size, #type)
LAYOUT_CHECKS(SAME_OFFSET, SAME_SIZE)

/* Functions called from Rust keep one convention on every system: `convention!` in src/kernels/checked.rs. */
#ifdef __x86_64__
#define KERNEL __attribute__((sysv_abi))
#else
#define KERNEL
#endif

/* The options of the ladder's rungs: CALLS keeps the functions below from being inlined, SQRTF takes roots by sqrtf.
 * by_value.c defines SMALL, the declaration of the functions, itself. */
#if defined SMALL
#elif defined CALLS && defined __clang__
#define SMALL static __attribute__((noinline))
#elif defined CALLS
#define SMALL static __attribute__((noipa))
#else
#define SMALL static inline
#endif

/* The square root as the paper's program takes it. */
SMALL float square_root(float x) {
#ifdef SQRTF
    return sqrtf(x);
#else
    return (float)pow(x, 0.5);
#endif
}

SMALL vec4 vec_add(vec4 a, vec4 b) {
    return (vec4){a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w};
}

SMALL vec4 vec_sub(vec4 a, vec4 b) {
    return (vec4){a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w};
}

SMALL vec4 vec_scale(vec4 a, float s) {
    return (vec4){a.x * s, a.y * s, a.z * s, a.w * s};
}

SMALL float vec_dot(vec4 a, vec4 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
}

SMALL float vec_norm(vec4 a) {
    return square_root(vec_dot(a, a));
}

SMALL vec4 vec_cross(vec4 a, vec4 b) {
    return (vec4){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x, 0};
}

SMALL vec4 vec_normalise(vec4 a) {
    float norm = vec_norm(a);
    return (vec4){a.x / norm, a.y / norm, a.z / norm, a.w / norm};
}

/* Eq. 1. */
SMALL vec4 point_on(ray r, float t) {
    return vec_add(r.origin, vec_scale(r.direction, t));
}

/* Eq. 5: the smallest root t > 0, if there is one. */
SMALL bool sphere_hit(ray r, const sphere *s, float *t) {
    vec4 from_centre = vec_sub(r.origin, s->centre);
    float a = vec_dot(r.direction, r.direction);
    float b = 2 * vec_dot(r.direction, from_centre);
    float c = vec_dot(from_centre, from_centre) - s->radius * s->radius;
    float disc = b * b - 4 * a * c;
    if (!(disc >= 0))
        return false;
    float root = square_root(disc);
    *t = (-b - root) / (2 * a);
    if (*t > 0)
        return true;
    *t = (-b + root) / (2 * a);
    return *t > 0;
}

/* Eq. 10: whether p1 and p2 are on the same side of the line through a and b; the line belongs to both. */
SMALL bool same_side(vec4 a, vec4 b, vec4 p1, vec4 p2) {
    vec4 edge = vec_sub(b, a);
    return vec_dot(vec_cross(edge, vec_sub(p1, a)), vec_cross(edge, vec_sub(p2, a))) >= 0;
}

/* Eq. 6. */
SMALL vec4 plane_normal(const triangle *s) {
    return vec_cross(vec_sub(s->v1, s->v2), vec_sub(s->v1, s->v3));
}

/* Eq. 9, then eq. 10 for each edge. */
SMALL bool triangle_hit(ray r, const triangle *s, float *t) {
    vec4 n = plane_normal(s);
    float across = vec_dot(r.direction, n);
    if (across == 0)
        return false;
    *t = vec_dot(vec_sub(s->v1, r.origin), n) / across;
    if (!(*t > 0))
        return false;
    vec4 p = point_on(r, *t);
    return same_side(s->v1, s->v2, p, s->v3) && same_side(s->v2, s->v3, p, s->v1) && same_side(s->v3, s->v1, p, s->v2);
}

/* Eq. 11 for one light. A surface without an outside is lit from both sides. */
SMALL vec4 reflection(const light *l, vec4 p, vec4 n, vec4 colour, bool two_sided) {
    float cosine = vec_dot(vec_normalise(vec_sub(l->position, p)), n);
    if (two_sided)
        cosine = fabsf(cosine);
    if (!(cosine > 0)) /* also where the light is on the surface: NaN */
        return (vec4){0, 0, 0, 0};
    vec4 i = vec_scale(l->radiance, cosine);
    return (vec4){i.x * colour.x, i.y * colour.y, i.z * colour.z, 0};
}

#endif
