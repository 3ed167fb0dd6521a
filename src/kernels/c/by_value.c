/* by_value.c - the functions of paper.h kept whole, as the paper's program has them: vectors by value. */

/* For counts alone: build.rs compiles this file once per optimisation level, RAYO_LEVEL, and no engine calls it. */
#define JOIN(level, name) rayo_c_##level##_##name
#define NAME(level, name) JOIN(level, name)
/* Hidden, so that a compiler that makes position-independent code may inline one into another; on Windows it may. */
#ifdef _WIN32
#define SMALL KERNEL
#else
#define SMALL KERNEL __attribute__((visibility("hidden")))
#endif
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

/* What this level may use beyond x86-64, in the order of `feature_usable` in src/kernels/by_value.rs. */
const uint32_t NAME(RAYO_LEVEL, features) = 0
#ifdef __SSE3__
    | 1u << 0
#endif
#ifdef __SSSE3__
    | 1u << 1
#endif
#ifdef __SSE4_1__
    | 1u << 2
#endif
#ifdef __SSE4_2__
    | 1u << 3
#endif
#ifdef __POPCNT__
    | 1u << 4
#endif
#ifdef __AVX__
    | 1u << 5
#endif
#ifdef __AVX2__
    | 1u << 6
#endif
#ifdef __FMA__
    | 1u << 7
#endif
#ifdef __F16C__
    | 1u << 8
#endif
#ifdef __LZCNT__
    | 1u << 9
#endif
#ifdef __MOVBE__
    | 1u << 10
#endif
#ifdef __BMI__
    | 1u << 11
#endif
#ifdef __BMI2__
    | 1u << 12
#endif
#ifdef __AVX512F__
    | 1u << 13
#endif
#ifdef __AVX512CD__
    | 1u << 14
#endif
#ifdef __AVX512VL__
    | 1u << 15
#endif
#ifdef __AVX512DQ__
    | 1u << 16
#endif
#ifdef __AVX512BW__
    | 1u << 17
#endif
/* What AMD once had alone, and Rust cannot ask for. */
#if defined __FMA4__ || defined __XOP__
    | 1u << 31
#endif
    ;
