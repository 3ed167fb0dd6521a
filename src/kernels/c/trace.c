/* trace.c - Algorithm 1 of the paper: every hit that is the nearest so far is shaded at once. */
#include "paper.h"

#ifndef TRACE
#define TRACE rayo_c_trace
#endif

#ifdef HITS
/* A pixel is the surface to be shaded, with the t of the hit in the point's fourth lane. */
typedef surface pixel_type;

static pixel_type begin(const frame *f) {
    (void)f;
    return (surface){0};
}

static pixel_type shade(const lists *s, vec4 p, vec4 n, vec4 colour, bool two_sided, float t) {
    (void)s, (void)two_sided;
    p.w = t;
    return (surface){.point = p, .normal = n, .colour = colour};
}
#else
typedef vec4 pixel_type;

static pixel_type begin(const frame *f) {
    return f->background;
}

static pixel_type shade(const lists *s, vec4 p, vec4 n, vec4 colour, bool two_sided, float t) {
    (void)t;
    vec4 sum = {0, 0, 0, 0};
    for (uint64_t i = 0; i < s->light_count; i++)
        sum = vec_add(sum, reflection(&s->lights[i], p, n, colour, two_sided));
    return sum;
}
#endif

/* Writes the rows [row, end) to `out`, pixel by pixel. */
KERNEL void TRACE(const frame *f, const lists *s, uint64_t row, uint64_t end, pixel_type *out) {
    for (; row < end; row++) {
        for (uint64_t col = f->first; col < f->first + f->width; col++) {
            ray r = {
                .origin = {0, 0, 0, 0},
                .direction = {f->step * ((float)col + 0.5f) - f->half_width,
                              -f->step * ((float)row + 0.5f) + f->half_height, f->focal, 0},
            };
            float nearest = INFINITY, t;
            pixel_type pixel = begin(f);
            for (uint64_t i = 0; i < s->sphere_count; i++) {
                const sphere *o = &s->spheres[i];
                if (sphere_hit(r, o, &t)) {
                    vec4 p = point_on(r, t);
                    float distance = vec_norm(vec_sub(p, r.origin));
                    if (distance < nearest) {
                        nearest = distance;
                        pixel = shade(s, p, vec_normalise(vec_sub(p, o->centre)), o->colour, false, t);
                    }
                }
            }
            for (uint64_t i = 0; i < s->triangle_count; i++) {
                const triangle *o = &s->triangles[i];
                if (triangle_hit(r, o, &t)) {
                    vec4 p = point_on(r, t);
                    float distance = vec_norm(vec_sub(p, r.origin));
                    if (distance < nearest) {
                        nearest = distance;
                        pixel = shade(s, p, vec_normalise(plane_normal(o)), o->colour, true, t);
                    }
                }
            }
            *out++ = pixel;
        }
    }
}
