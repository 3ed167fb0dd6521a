/* lit.c - the closed form of one sphere under one light along the pixels of known spans, as grey bytes. */
/* It is SPHERE_LIT of asm/include/lit.inc in plain C, which the compiler vectorises, or with INTRINSICS by these. */
#include <immintrin.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#define KERNEL __attribute__((sysv_abi))

/* LitSphere and LitRows of asm/include/layout.inc. */
typedef struct {
    float h1, least, q1, kn, ke, red, green, blue;
} lit_sphere;

typedef struct {
    float start[64], end[64], j[64], stop[64], m[64], a[64], h0[64], q0[64];
} lit_rows;

enum { BLACK = (int)0xff000000, GREY = 0x010101 };

#ifndef INTRINSICS

/* `count` pixels of a row from the first of its span on. */
static inline void span(const lit_sphere *s, const lit_rows *r, uint64_t row, int count, int32_t *restrict out) {
    float first = r->j[row], m = r->m[row], a = r->a[row], h0 = r->h0[row], q0 = r->q0[row];
    float h1 = s->h1, q1 = s->q1, kn = s->kn, ke = s->ke;
    for (int i = 0; i < count; i++) {
        float j = first + (float)i, u = j - m, p = a - u * u;
        float root = sqrtf(p > 0 ? p : 0);
        float den = h0 + h1 * j + root, n = q0 + q1 * j + kn * root;
        float light = n / sqrtf((ke * den - n) * den);
        out[i] = (int)(light > 0 ? light : 0) * GREY | BLACK;
    }
}

#else

#if defined __AVX512F__
#define OP(name) _mm512_##name
#define BITS(name) _mm512_##name##512
#define ESTIMATE _mm512_rsqrt14_ps
typedef __m512 packet;
typedef __m512i integers;
#elif defined __AVX2__
#define OP(name) _mm256_##name
#define BITS(name) _mm256_##name##256
#define ESTIMATE _mm256_rsqrt_ps
typedef __m256 packet;
typedef __m256i integers;
#else
#define OP(name) _mm_##name
#define BITS(name) _mm_##name##128
#define ESTIMATE _mm_rsqrt_ps
typedef __m128 packet;
typedef __m128i integers;
#endif
enum { LANES = sizeof(packet) / sizeof(float) };

#ifdef __FMA__
#define FMA OP(fmadd_ps)
#else
#define FMA(a, b, c) OP(add_ps)(OP(mul_ps)(a, b), c)
#endif

/* The same by whole packets, with estimates of both roots; no packet is masked, since p is held above 0 in all. */
static inline void span(const lit_sphere *s, const lit_rows *r, uint64_t row, int count, int32_t *restrict out) {
    packet m = OP(set1_ps)(r->m[row]), a = OP(set1_ps)(r->a[row]), h0 = OP(set1_ps)(r->h0[row]);
    packet q0 = OP(set1_ps)(r->q0[row]), h1 = OP(set1_ps)(s->h1), q1 = OP(set1_ps)(s->q1), kn = OP(set1_ps)(s->kn);
    packet ke = OP(set1_ps)(s->ke), least = OP(set1_ps)(s->least), zero = OP(setzero_ps)(), one = OP(set1_ps)(1);
    integers grey = OP(set1_epi32)(GREY), black = OP(set1_epi32)(BLACK);
    float lanes[LANES];
    for (int i = 0; i < LANES; i++)
        lanes[i] = r->j[row] + (float)i;
    packet j = OP(loadu_ps)(lanes), step = OP(set1_ps)(LANES);
    for (int i = 0; i < count; i += LANES) {
        packet u = OP(sub_ps)(j, m), p = OP(max_ps)(OP(sub_ps)(a, OP(mul_ps)(u, u)), least);
        packet t = ESTIMATE(p);
        packet den = FMA(FMA(j, h1, h0), t, one), n = FMA(FMA(j, q1, q0), t, kn);
        packet e = OP(mul_ps)(OP(sub_ps)(OP(mul_ps)(den, ke), n), den);
        packet light = OP(max_ps)(OP(mul_ps)(n, ESTIMATE(e)), zero);
        integers level = OP(cvttps_epi32)(light);
        integers pixels = BITS(or_si)(OP(mullo_epi32)(level, grey), black);
        if (i + LANES <= count)
            BITS(storeu_si)((void *)(out + i), pixels);
        else
            memcpy(out + i, &pixels, sizeof *out * (size_t)(count - i));
        j = OP(add_ps)(j, step);
    }
}

#endif

static void fill(int32_t *out, uint64_t count) {
    for (uint64_t i = 0; i < count; i++)
        out[i] = BLACK;
}

/* `count` rows of `width` pixels, as a kernel of the kind ShadeRows; never past the cache. */
KERNEL void TRACE(const lit_sphere *s, const lit_rows *r, uint64_t count, int32_t *out, uint64_t width, uint64_t past) {
    (void)past;
    for (uint64_t row = 0; row < count; row++, out += width) {
        uint64_t start = (uint64_t)r->start[row], end = (uint64_t)r->end[row];
        start = start < width ? start : width;
        end = end > start ? end : start;
        fill(out, start);
        span(s, r, row, (int)(end - start), out + start);
        fill(out + end, width - end);
    }
}
