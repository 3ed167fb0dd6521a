/* ladder.h - what the upper rungs of the ladder share: eq. 5, 9 and 10 for rays from the origin, with constants. */
#ifndef RAYO_LADDER_H
#define RAYO_LADDER_H

#include <float.h>

#include "paper.h"

/* The most objects of a kind that a rung takes: its constants are on the stack. */
enum { MOST = LADDER_MOST };

/* c.c - r^2, the constant of eq. 5. */
static inline float sphere_constant(const sphere *s) {
    return vec_dot(s->centre, s->centre) - s->radius * s->radius;
}

/* v1 . n, the constant of eq. 9. */
static inline float plane_constant(const triangle *s, vec4 normal) {
    return vec_dot(s->v1, normal);
}

/* The terms that do not depend on the ray. */
typedef struct {
    float sphere[MOST];
    vec4 normal[MOST];
    float plane[MOST];
} constants;

static inline void hoist(constants *k, const lists *s) {
    for (uint64_t i = 0; i < s->sphere_count; i++)
        k->sphere[i] = sphere_constant(&s->spheres[i]);
    for (uint64_t i = 0; i < s->triangle_count; i++) {
        k->normal[i] = plane_normal(&s->triangles[i]);
        k->plane[i] = plane_constant(&s->triangles[i], k->normal[i]);
    }
}

#endif
