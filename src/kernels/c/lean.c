/* lean.c - Algorithm 1 with the omissions of the paper's SIMD: r_o, the factor 2 of eq. 5, the distance of a hit. */
/* t stands for the distance. NEAREST_ONLY 1 shades only the nearest hit, HOISTED 1 computes terms that do not depend
   on the ray only once. */
#include "ladder.h"

static inline bool sphere_hit_from_origin(vec4 d, const sphere *s, float constant, float *t) {
    float a = vec_dot(d, d);
    float h = vec_dot(d, s->centre);
    float disc = h * h - constant * a;
    if (!(disc >= 0))
        return false;
    float root = square_root(disc);
    *t = (h - root) / a;
    if (*t > 0)
        return true;
    *t = (h + root) / a;
    return *t > 0;
}

static inline bool triangle_hit_from_origin(vec4 d, const triangle *s, vec4 n, float constant, float *t) {
    float across = vec_dot(d, n);
    if (across == 0)
        return false;
    *t = constant / across;
    if (!(*t > 0))
        return false;
    vec4 p = vec_scale(d, *t);
    return same_side(s->v1, s->v2, p, s->v3) && same_side(s->v2, s->v3, p, s->v1) && same_side(s->v3, s->v1, p, s->v2);
}

static vec4 shade(const lists *s, vec4 p, vec4 n, vec4 colour, bool two_sided) {
    vec4 sum = {0, 0, 0, 0};
    for (uint64_t i = 0; i < s->light_count; i++)
        sum = vec_add(sum, reflection(&s->lights[i], p, n, colour, two_sided));
    return sum;
}

static inline vec4 shade_sphere(const lists *s, vec4 d, float t, const sphere *o) {
    vec4 p = vec_scale(d, t);
    return shade(s, p, vec_normalise(vec_sub(p, o->centre)), o->colour, false);
}

static inline vec4 shade_triangle(const lists *s, vec4 d, float t, const triangle *o, vec4 n) {
    return shade(s, vec_scale(d, t), vec_normalise(n), o->colour, true);
}

/* Writes the rows [row, end) to `out`, four floats a pixel.
   There are at most MOST objects of a kind. */
KERNEL void TRACE(const frame *f, const lists *s, uint64_t row, uint64_t end, vec4 *out) {
    constants k;
    if (HOISTED)
        hoist(&k, s);
    for (; row < end; row++) {
        for (uint64_t col = 0; col < f->width; col++) {
            vec4 d = {f->step * ((float)col + 0.5f) - f->half_width, -f->step * ((float)row + 0.5f) + f->half_height,
                      f->focal, 0};
            float nearest = FLT_MAX, t;
            vec4 pixel = {0, 0, 0, 0}, normal = {0, 0, 0, 0};
            const sphere *nearest_sphere = NULL;
            const triangle *nearest_triangle = NULL;
            for (uint64_t i = 0; i < s->sphere_count; i++) {
                const sphere *o = &s->spheres[i];
                float constant = HOISTED ? k.sphere[i] : sphere_constant(o);
                if (sphere_hit_from_origin(d, o, constant, &t) && t < nearest) {
                    nearest = t;
                    if (NEAREST_ONLY)
                        nearest_sphere = o;
                    else
                        pixel = shade_sphere(s, d, t, o);
                }
            }
            for (uint64_t i = 0; i < s->triangle_count; i++) {
                const triangle *o = &s->triangles[i];
                vec4 n = HOISTED ? k.normal[i] : plane_normal(o);
                float constant = HOISTED ? k.plane[i] : plane_constant(o, n);
                if (triangle_hit_from_origin(d, o, n, constant, &t) && t < nearest) {
                    nearest = t;
                    if (NEAREST_ONLY) {
                        nearest_triangle = o;
                        normal = n;
                    } else
                        pixel = shade_triangle(s, d, t, o, n);
                }
            }
            if (nearest_triangle)
                pixel = shade_triangle(s, d, nearest, nearest_triangle, normal);
            else if (nearest_sphere)
                pixel = shade_sphere(s, d, nearest, nearest_sphere);
            *out++ = pixel;
        }
    }
}
