; chains.asm - the unit with chains of the paper's operations, which measure the latency and the throughput of each.
;
; unsafe extern "sysv64" fn(rounds: u64) -> u64
;
;   rayo_<form>_<op>_latency      CHAIN_LINKS times <rounds> operations, each of which needs the previous result
;   rayo_<form>_<op>_throughput   as many operations, independent of each other
;   rayo_feedback_latency         as many times FEEDBACK alone
;
;   All return the number of operations in a round.
;
;   In a latency chain FEEDBACK makes each operand depend on the previous result without changing its value, so that
;   nothing overflows, and divisions and roots meet ordinary numbers. Its cost is measured alone and subtracted. In a
;   throughput chain every operation loads its operands again, because the macros overwrite them.
;
;   requires       SSE3; rounds >= 1

%define ISA sse41
%include "include/isa.inc"
%include "include/layout.inc"
%include "include/vec3_aos.inc"
%include "include/sphere_aos.inc"
%include "include/triangle_aos.inc"
%include "include/lambert_aos.inc"
%include "include/constants.inc"

%assign CHAIN_LINKS 8                   ; operations in a round

section RODATA align=64
align 16
vector_a:   dd 0.5, -0.75, 1.25, 0.0
vector_b:   dd 1.5, 0.625, -0.25, 0.0
scalar:     dd 0.875, 0.0, 0.0, 0.0
ray:        dd 0.0625, -0.125, 1.0, 0.0
sphere:
istruc PaperSphere
    at PaperSphere.centre, dd 0.25, -0.5, 4.0, 0.0
    at PaperSphere.colour, dd 1.0, 0.5, 0.25, 0.0
    at PaperSphere.radius, dd 1.5
iend
triangle:
istruc PaperTriangle
    at PaperTriangle.v1, dd -1.0, -1.0, 3.0, 0.0
    at PaperTriangle.v2, dd 1.0, -1.0, 3.5, 0.0
    at PaperTriangle.v3, dd 0.25, 1.0, 4.0, 0.0
    at PaperTriangle.colour, dd 1.0, 0.5, 0.25, 0.0
iend
light:
istruc Light
    at Light.position, dd 3.0, 5.0, -2.0, 0.0
    at Light.radiance, dd 0.75, 0.5, 0.25, 0.0
iend
point:      dd 0.25, -0.5, 2.5, 0.0
normal:     dd 0.0, 0.6, -0.8, 0.0
colour:     dd 1.0, 0.5, 0.25, 0.0

; FEEDBACK - d = a, but dependent on r: costs the latency of andps and orps, and of a copy, which most CPUs rename away.
%macro FEEDBACK 4
%define %%d %1          ; [out]       register: the operand of the next operation
%define %%r %2          ; [clobbered] register: the previous result
%define %%zero %3       ; [in]        register of zeros
%define %%a %4          ; [in]        register: the operand
    andps   %%r, %%zero
    orps    %%r, %%a
%ifnidni %%d, %%r
    movaps  %%d, %%r
%endif
%endmacro

; LOAD_OPERANDS - loads the operands that are in registers.
%macro LOAD_OPERANDS 4
%define %%operand %1    ; [out] register
%define %%value %2      ; [in]  label: its value
%define %%other %3      ; [out] register, or none
%define %%with %4       ; [in]  label: the value of the other, or none
    movaps  %%operand, [%%value]
%ifnidni %%other, none
    movaps  %%other, [%%with]
%endif
%endmacro

; SET_UP - loads all operands, and the zeros and addresses that the macros take.
%macro SET_UP 4
%define %%operand %1    ; [out] as in LOAD_OPERANDS
%define %%value %2      ; [in]  as in LOAD_OPERANDS
%define %%other %3      ; [out] as in LOAD_OPERANDS
%define %%with %4       ; [in]  as in LOAD_OPERANDS
    LOAD_OPERANDS %%operand, %%value, %%other, %%with
    xorps   xmm13, xmm13
    lea     rsi, [sphere]
    lea     rdx, [triangle]
    lea     rcx, [light]
%endmacro

; CHAINS - the two chains of an operation.
%macro CHAINS 7
%define %%name %1       ; [in]  the operation
%define %%operand %2    ; [in]  register of the operand that FEEDBACK makes depend on the result
%define %%value %3      ; [in]  label: the value of that operand
%define %%other %4      ; [in]  register of the other operand, or none
%define %%with %5       ; [in]  label: its value, or none
%define %%result %6     ; [in]  register of the result
%define %%operation %7  ; [in]  the macro with its arguments; it has a jump to .miss, which these operands never take
FUNC AOS_NAME(%%name) %+ _latency
    SET_UP  %%operand, %%value, %%other, %%with
    movaps  xmm14, %%operand
    xorps   xmm15, xmm15
align 32
.round:
%rep CHAIN_LINKS
    %%operation
    FEEDBACK %%operand, %%result, xmm15, xmm14
%endrep
    dec     rdi
    jnz     .round
.miss:
    mov     eax, CHAIN_LINKS
ENDFUNC

FUNC AOS_NAME(%%name) %+ _throughput
    SET_UP  %%operand, %%value, %%other, %%with
align 32
.round:
%rep CHAIN_LINKS
    LOAD_OPERANDS %%operand, %%value, %%other, %%with
    %%operation
%endrep
    dec     rdi
    jnz     .round
.miss:
    mov     eax, CHAIN_LINKS
ENDFUNC
%endmacro

FUNC feedback_latency
    xorps   xmm15, xmm15
    movaps  xmm14, [vector_a]
    movaps  xmm0, xmm14
align 32
.round:
%rep CHAIN_LINKS
    FEEDBACK xmm0, xmm0, xmm15, xmm14
%endrep
    dec     rdi
    jnz     .round
    mov     eax, CHAIN_LINKS
ENDFUNC

; ALL_CHAINS - the chains of one form.
%macro ALL_CHAINS 0
CHAINS add, xmm0, vector_a, xmm1, vector_b, xmm0, {VEC_ADD xmm0, xmm1}
CHAINS sub, xmm0, vector_a, xmm1, vector_b, xmm0, {VEC_SUB xmm0, xmm1}
CHAINS scale, xmm0, vector_a, xmm1, scalar, xmm0, {VEC_SCALE xmm0, xmm1}
CHAINS dot, xmm0, vector_a, xmm1, vector_b, xmm0, {VEC_DOT xmm0, xmm1, xmm2}
CHAINS norm, xmm0, vector_a, none, none, xmm0, {VEC_NORM xmm0, xmm1}
CHAINS cross, xmm1, vector_a, xmm2, vector_b, xmm0, {VEC_CROSS xmm0, xmm1, xmm2, xmm3, xmm4}
CHAINS normalise, xmm0, vector_a, none, none, xmm0, {VEC_NORMALISE xmm0, xmm1, xmm2}
CHAINS sphere, xmm0, ray, none, none, xmm1, {SPHERE_HIT xmm1, xmm0, rsi, .miss, xmm2, xmm3, xmm4, xmm5, xmm13}
CHAINS triangle, xmm0, ray, none, none, xmm1, \
    {TRIANGLE_HIT xmm1, xmm2, xmm3, xmm0, rdx, .miss, xmm13, xmm5, xmm6, xmm7, xmm8, xmm9, xmm10}
CHAINS lambert, xmm1, point, xmm2, normal, xmm0, \
    {LAMBERT xmm0, rcx, xmm1, xmm2, [colour], 1, xmm13, xmm4, xmm5, xmm6}
%endmacro

%assign AOS_BEST 0
%define AOS_NAME(name) paper_ %+ name
ALL_CHAINS

%assign AOS_BEST 1
%define AOS_NAME(name) aos_ %+ name
ALL_CHAINS
