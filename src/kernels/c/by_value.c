/* by_value.c - the functions of paper.h, not inlined, as in the paper's program: vectors by value. */

/* Only for counts: build.rs compiles this file once per optimisation level, RAYO_LEVEL, and no engine calls it. */
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

/* The level of x86-64, by the psABI, that covers all instructions used here; no level has AMD's former extensions. */
const uint32_t NAME(RAYO_LEVEL, needs) =
#if defined __FMA4__ || defined __XOP__
    5
#elif defined __AVX512F__
    4
#elif defined __AVX__
    3
#elif defined __SSE3__
    2
#else
    1
#endif
    ;
