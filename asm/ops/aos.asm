; aos.asm - every operation and intersection of the paper's tracer as a function of its own, for tests, counts, benches.
;
; unsafe extern "sysv64" fn(out: *mut O, a: *const A, b: *const B)
;
;   name        out        a          b           computes
;   add         Vec4       Vec4       Vec4        a + b
;   sub         Vec4       Vec4       Vec4        a - b
;   scale       Vec4       Vec4       f32         a * b
;   dot         f32        Vec4       Vec4        a . b
;   norm        f32        Vec4       -           ||a||; b is not read
;   cross       Vec4       Vec4       Vec4        a x b
;   normalise   Vec4       Vec4       -           a / ||a||; b is not read
;   sphere      f32        Vec4       Sphere      the t of SPHERE_HIT along the ray a; infinity for a miss
;   triangle    f32        Vec4       Triangle    the t of TRIANGLE_HIT along the ray a; infinity for a miss
;   lambert     Vec4       Surface    Light       what LAMBERT adds on the side of N; on the other side it adds nothing
;   lambert2    Vec4       Surface    Light       the same for a two-sided surface
;
;   registers      rdi out, rsi a, rdx b; the values from xmm0 up
;   requires       SSE3; addresses aligned as their types are
;   equals         reference::aos, to the last bit
;
; The labels .body and .body_end enclose the operation itself, without its loads and stores.

; LAMBERT_FUNC - the two functions of the Lambert term.
%macro LAMBERT_FUNC 2
%define %%name %1       ; [in]       the function's name
%define %%sides %2      ; [in]       as in LAMBERT
FUNC AOS_NAME(%%name)
    xorps   xmm0, xmm0
    movaps  xmm1, [rsi + Surface.point]
    movaps  xmm2, [rsi + Surface.normal]
    xorps   xmm3, xmm3
.body:
    LAMBERT xmm0, rdx, xmm1, xmm2, [rsi + Surface.colour], %%sides, xmm3, xmm4, xmm5, xmm6
.body_end:
    movaps  [rdi], xmm0
ENDFUNC
%endmacro

; AOS_OPS - the functions of this file, for one form.
%macro AOS_OPS 0
FUNC AOS_NAME(add)
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
.body:
    VEC_ADD xmm0, xmm1
.body_end:
    movaps  [rdi], xmm0
ENDFUNC

FUNC AOS_NAME(sub)
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
.body:
    VEC_SUB xmm0, xmm1
.body_end:
    movaps  [rdi], xmm0
ENDFUNC

FUNC AOS_NAME(scale)
    movaps  xmm0, [rsi]
    movss   xmm1, [rdx]
.body:
    VEC_SCALE xmm0, xmm1
.body_end:
    movaps  [rdi], xmm0
ENDFUNC

FUNC AOS_NAME(dot)
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
.body:
    VEC_DOT xmm0, xmm1, xmm2
.body_end:
    movss   [rdi], xmm0
ENDFUNC

FUNC AOS_NAME(norm)
    movaps  xmm0, [rsi]
.body:
    VEC_NORM xmm0, xmm1
.body_end:
    movss   [rdi], xmm0
ENDFUNC

FUNC AOS_NAME(cross)
    movaps  xmm1, [rsi]
    movaps  xmm2, [rdx]
.body:
    VEC_CROSS xmm0, xmm1, xmm2, xmm3, xmm4
.body_end:
    movaps  [rdi], xmm0
ENDFUNC

FUNC AOS_NAME(normalise)
    movaps  xmm0, [rsi]
.body:
    VEC_NORMALISE xmm0, xmm1, xmm2
.body_end:
    movaps  [rdi], xmm0
ENDFUNC

FUNC AOS_NAME(sphere)
    movaps  xmm0, [rsi]
    xorps   xmm6, xmm6
.body:
    SPHERE_HIT xmm1, xmm0, rdx, .miss, xmm2, xmm3, xmm4, xmm5, xmm6
.body_end:
    movss   [rdi], xmm1
    ret
.miss:
    movss   xmm1, [infinity]
    movss   [rdi], xmm1
ENDFUNC

FUNC AOS_NAME(triangle)
    movaps  xmm0, [rsi]
    xorps   xmm4, xmm4
.body:
    TRIANGLE_HIT xmm1, xmm2, xmm3, xmm0, rdx, .miss, xmm4, xmm5, xmm6, xmm7, xmm8, xmm9, xmm10
.body_end:
    movss   [rdi], xmm1
    ret
.miss:
    movss   xmm1, [infinity]
    movss   [rdi], xmm1
ENDFUNC

LAMBERT_FUNC lambert, 1
LAMBERT_FUNC lambert2, 2
%endmacro
