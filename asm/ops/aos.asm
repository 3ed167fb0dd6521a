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

; AOS_OPERATIONS - passes each operation to a macro, AOS_OP or CHAINS of chains.asm, with the arguments that AOS_OP
;                  explains.
%macro AOS_OPERATIONS 1
%define %%each %1       ; [in]  the macro that takes the lines
    %%each add, vector, other, xmm0, {movaps xmm1, [rdx]}, {}, xmm0, movaps, {VEC_ADD xmm0, xmm1}
    %%each sub, vector, other, xmm0, {movaps xmm1, [rdx]}, {}, xmm0, movaps, {VEC_SUB xmm0, xmm1}
    %%each scale, vector, scalar, xmm0, {movss xmm1, [rdx]}, {}, xmm0, movaps, {VEC_SCALE xmm0, xmm1}
    %%each dot, vector, other, xmm0, {movaps xmm1, [rdx]}, {}, xmm0, movss, {VEC_DOT xmm0, xmm1, xmm2}
    %%each norm, vector, other, xmm0, {}, {}, xmm0, movss, {VEC_NORM xmm0, xmm1}
    %%each cross, vector, other, xmm1, {movaps xmm2, [rdx]}, {}, xmm0, movaps, {VEC_CROSS xmm0, xmm1, xmm2, xmm3, xmm4}
    %%each normalise, vector, other, xmm0, {}, {}, xmm0, movaps, {VEC_NORMALISE xmm0, xmm1, xmm2}
    %%each sphere, ray, sphere, xmm0, {}, {xorps xmm6, xmm6}, xmm1, movss, \
        {SPHERE_HIT xmm1, xmm0, rdx, .miss, xmm2, xmm3, xmm4, xmm5, xmm6}
    %%each triangle, ray, triangle, xmm0, {}, {xorps xmm4, xmm4}, xmm1, movss, \
        {TRIANGLE_HIT xmm1, xmm2, xmm3, xmm0, rdx, .miss, xmm4, xmm5, xmm6, xmm7, xmm8, xmm9, xmm10}
    %%each lambert, surface, light, xmm1, {movaps xmm2, [rsi + Surface.normal]}, {BLACK}, xmm0, movaps, \
        {LAMBERT xmm0, rdx, xmm1, xmm2, [rsi + Surface.colour], 1, xmm3, xmm4, xmm5, xmm6}
    %%each lambert2, surface, light, xmm1, {movaps xmm2, [rsi + Surface.normal]}, {BLACK}, xmm0, movaps, \
        {LAMBERT xmm0, rdx, xmm1, xmm2, [rsi + Surface.colour], 2, xmm3, xmm4, xmm5, xmm6}
%endmacro

; BLACK - the colour that the light is added to, and the zero that LAMBERT takes.
%macro BLACK 0
    xorps   xmm0, xmm0
    xorps   xmm3, xmm3
%endmacro

; AOS_OP - the function of an operation.
%macro AOS_OP 9
%define %%name %1       ; [in]  its name
%define %%a %2          ; [in]  what a is, as the label of one in chains.asm; a ray may miss
%define %%b %3          ; [in]  the same of b
%define %%of_a %4       ; [in]  the register that a, or its first vector, is loaded into
%define %%load_b %5     ; [in]  the instruction that loads b, or the second vector of a, if any
%define %%zeros %6      ; [in]  what sets to 0 the registers that have to be, if any
%define %%result %7     ; [in]  register of the result
%define %%store %8      ; [in]  the instruction that stores it: movaps, or movss for a scalar
%define %%operation %9  ; [in]  the macro with its arguments
FUNC AOS_NAME(%%name)
    movaps  %%of_a, [rsi]
    %%load_b
    %%zeros
.body:
    %%operation
.body_end:
    %%store [rdi], %%result
%ifidn %%a, ray
    ret
.miss:
    movss   %%result, [infinity]
    movss   [rdi], %%result
%endif
ENDFUNC
%endmacro

; AOS_OPS - defines the functions of this file, for one form.
%macro AOS_OPS 0
    AOS_OPERATIONS AOS_OP
%endmacro
