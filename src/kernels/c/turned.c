/* turned.c - lean.c transposed: a structure of arrays over the pixels of a block in place of a structure per vector. */
/* No loop over them has a branch, so that the compiler can vectorise. */
#include "ladder.h"

enum { BLOCK = 64 };

/* A block of pixels: its rays and their nearest hits so far; `two_sided` is 1 for a two-sided surface. */
typedef struct {
    float x[BLOCK], nearest[BLOCK];
    float nx[BLOCK], ny[BLOCK], nz[BLOCK];
    float red[BLOCK], green[BLOCK], blue[BLOCK], two_sided[BLOCK];
} block;

/* Both values are computed: a load or store for only one of them would be a branch. */
static inline float choose(int first, float a, float b) {
    return first ? a : b;
}

static inline void meet_sphere(block *restrict b, float y, float z, const sphere *o, float constant) {
    float cx = o->centre.x, cy = o->centre.y, cz = o->centre.z;
    float red = o->colour.x, green = o->colour.y, blue = o->colour.z;
    for (int j = 0; j < BLOCK; j++) {
        float x = b->x[j];
        float a = x * x + y * y + z * z;
        float h = x * cx + y * cy + z * cz;
        float disc = h * h - constant * a;
        float root = sqrtf(disc > 0 ? disc : 0);
        float near = (h - root) / a, far = (h + root) / a;
        float t = near > 0 ? near : far;
        t = disc >= 0 ? t : FLT_MAX;
        t = t > 0 ? t : FLT_MAX;
        int hit = t < b->nearest[j];
        b->nearest[j] = choose(hit, t, b->nearest[j]);
        b->nx[j] = choose(hit, t * x - cx, b->nx[j]);
        b->ny[j] = choose(hit, t * y - cy, b->ny[j]);
        b->nz[j] = choose(hit, t * z - cz, b->nz[j]);
        b->red[j] = choose(hit, red, b->red[j]);
        b->green[j] = choose(hit, green, b->green[j]);
        b->blue[j] = choose(hit, blue, b->blue[j]);
        b->two_sided[j] = choose(hit, 0, b->two_sided[j]);
    }
}

/* Positive if the point is on the same side of the line through v and w as the third vertex, 0 on it: eq. 10. */
static inline float side(vec4 v, vec4 w, vec4 across, float px, float py, float pz) {
    vec4 edge = vec_sub(w, v);
    vec4 inside = vec_cross(edge, vec_sub(across, v));
    vec4 p = {px, py, pz, 0};
    return vec_dot(vec_cross(edge, vec_sub(p, v)), inside);
}

static inline void meet_triangle(block *restrict b, float y, float z, const triangle *o, vec4 n, float constant) {
    float red = o->colour.x, green = o->colour.y, blue = o->colour.z;
    vec4 v1 = o->v1, v2 = o->v2, v3 = o->v3;
    for (int j = 0; j < BLOCK; j++) {
        float x = b->x[j];
        float across = x * n.x + y * n.y + z * n.z;
        float t = constant / (across == 0 ? -constant : across);
        float px = t * x, py = t * y, pz = t * z;
        float side1 = side(v1, v2, v3, px, py, pz), side2 = side(v2, v3, v1, px, py, pz);
        float side3 = side(v3, v1, v2, px, py, pz);
        int hit = (side1 >= 0) & (side2 >= 0) & (side3 >= 0) & (t > 0) & (t < b->nearest[j]);
        b->nearest[j] = choose(hit, t, b->nearest[j]);
        b->nx[j] = choose(hit, n.x, b->nx[j]);
        b->ny[j] = choose(hit, n.y, b->ny[j]);
        b->nz[j] = choose(hit, n.z, b->nz[j]);
        b->red[j] = choose(hit, red, b->red[j]);
        b->green[j] = choose(hit, green, b->green[j]);
        b->blue[j] = choose(hit, blue, b->blue[j]);
        b->two_sided[j] = choose(hit, 1, b->two_sided[j]);
    }
}

/* Adds to `light` what the surfaces of the block reflect: eq. 11. */
static inline void shade(const block *restrict b, float y, float z, const lists *s, float (*restrict light)[BLOCK]) {
    for (uint64_t i = 0; i < s->light_count; i++) {
        vec4 lamp = s->lights[i].position, radiance = s->lights[i].radiance;
        for (int j = 0; j < BLOCK; j++) {
            float t = b->nearest[j];
            float lx = lamp.x - t * b->x[j], ly = lamp.y - t * y, lz = lamp.z - t * z;
            float length = sqrtf((lx * lx + ly * ly + lz * lz) *
                                 (b->nx[j] * b->nx[j] + b->ny[j] * b->ny[j] + b->nz[j] * b->nz[j]));
            float cosine = (lx * b->nx[j] + ly * b->ny[j] + lz * b->nz[j]) / (length > 0 ? length : FLT_MAX);
            float other_side = b->two_sided[j] > 0 ? -cosine : 0;
            cosine = cosine > other_side ? cosine : other_side;
            light[0][j] += radiance.x * cosine * b->red[j];
            light[1][j] += radiance.y * cosine * b->green[j];
            light[2][j] += radiance.z * cosine * b->blue[j];
        }
    }
}

/* Writes the rows [row, end) to `out`, four floats a pixel.
   There are at most MOST objects of a kind. */
KERNEL void TRACE(const frame *f, const lists *s, uint64_t row, uint64_t end, vec4 *out) {
    constants k;
    hoist(&k, s);
    for (; row < end; row++) {
        float y = -f->step * ((float)row + 0.5f) + f->half_height, z = f->focal;
        for (uint64_t start = 0; start < f->width; start += BLOCK) {
            block b;
            float light[3][BLOCK];
            for (int j = 0; j < BLOCK; j++) {
                b.x[j] = f->step * ((float)start + (float)j + 0.5f) - f->half_width;
                b.nearest[j] = FLT_MAX;
                b.nx[j] = b.ny[j] = b.nz[j] = b.red[j] = b.green[j] = b.blue[j] = b.two_sided[j] = 0;
                light[0][j] = light[1][j] = light[2][j] = 0;
            }
            for (uint64_t i = 0; i < s->sphere_count; i++)
                meet_sphere(&b, y, z, &s->spheres[i], k.sphere[i]);
            for (uint64_t i = 0; i < s->triangle_count; i++)
                meet_triangle(&b, y, z, &s->triangles[i], k.normal[i], k.plane[i]);
            /* A pixel without a hit is black at any t, but its squares must be finite. */
            for (int j = 0; j < BLOCK; j++)
                b.nearest[j] = b.nearest[j] < FLT_MAX ? b.nearest[j] : 0;
            shade(&b, y, z, s, light);
            uint64_t left = f->width - start;
            int count = left < BLOCK ? (int)left : BLOCK;
            for (int j = 0; j < count; j++)
                out[j] = (vec4){light[0][j], light[1][j], light[2][j], 0};
            out += count;
        }
    }
}
