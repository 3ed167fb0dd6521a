/* by_value.c - the functions of paper.h kept whole, as the paper's program has them: vectors by value. */

/* For counts alone: build.rs compiles this file once per optimisation level, RAYO_LEVEL, and no engine calls it. */
#define JOIN(level, name) rayo_c_##level##_##name
#define NAME(level, name) JOIN(level, name)
/* Hidden, so that a compiler that makes position-independent code may inline one into another. */
#define SMALL KERNEL __attribute__((visibility("hidden")))
#define square_root NAME(RAYO_LEVEL, square_root)
#define vec_add NAME(RAYO_LEVEL, add)
#define vec_sub NAME(RAYO_LEVEL, sub)
#define vec_scale NAME(RAYO_LEVEL, scale)
#define vec_dot NAME(RAYO_LEVEL, dot)
#define vec_norm NAME(RAYO_LEVEL, norm)
#define vec_cross NAME(RAYO_LEVEL, cross)
#define vec_normalise NAME(RAYO_LEVEL, normalise)
#define point_on NAME(RAYO_LEVEL, point_on)
#define sphere_hit NAME(RAYO_LEVEL, sphere)
#define same_side NAME(RAYO_LEVEL, same_side)
#define plane_normal NAME(RAYO_LEVEL, plane_normal)
#define triangle_hit NAME(RAYO_LEVEL, triangle)
#define reflection NAME(RAYO_LEVEL, lambert)
#include "paper.h"

/* What this level may use beyond x86-64, in the order of `FEATURES` in src/kernels/by_value.rs. */
const uint32_t NAME(RAYO_LEVEL, features) = 0
#ifdef __SSE4_1__
    | 1 << 0
#endif
#ifdef __AVX__
    | 1 << 1
#endif
#ifdef __AVX2__
    | 1 << 2
#endif
#ifdef __FMA__
    | 1 << 3
#endif
#ifdef __BMI2__
    | 1 << 4
#endif
#ifdef __AVX512F__
    | 1 << 5
#endif
#ifdef __AVX512VL__
    | 1 << 6
#endif
#ifdef __AVX512DQ__
    | 1 << 7
#endif
#ifdef __AVX512BW__
    | 1 << 8
#endif
    ;
