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
%include "ops/aos.asm"

%assign CHAIN_LINKS 8                   ; operations in a round

section RODATA align=64
align 16
vector:     dd 0.5, -0.75, 1.25, 0.0
other:      dd 1.5, 0.625, -0.25, 0.0
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
surface:
istruc Surface
    at Surface.point, dd 0.25, -0.5, 2.5, 0.0
    at Surface.normal, dd 0.0, 0.6, -0.8, 0.0
    at Surface.colour, dd 1.0, 0.5, 0.25, 0.0
iend

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

; CHAINS - the latency chain and the throughput chain of an operation, which takes the arguments of AOS_OP. The
;          operands are such that every ray hits.
%macro CHAINS 9
%define %%name %1       ; [in]  as in AOS_OP
%define %%a %2          ; [in]  as in AOS_OP, the label of its value here
%define %%b %3          ; [in]  as in AOS_OP, the label of its value here
%define %%of_a %4       ; [in]  as in AOS_OP: the operand that FEEDBACK makes depend on the result
%define %%load_b %5     ; [in]  as in AOS_OP
%define %%zeros %6      ; [in]  as in AOS_OP
%define %%result %7     ; [in]  as in AOS_OP
%define %%store %8      ; [in]  as in AOS_OP; nothing is stored here
%define %%operation %9  ; [in]  as in AOS_OP
FUNC AOS_NAME(%%name) %+ _latency
    lea     rsi, [%%a]
    lea     rdx, [%%b]
    movaps  %%of_a, [rsi]
    %%load_b
    %%zeros
    movaps  xmm14, %%of_a
    xorps   xmm15, xmm15
align 32
.round:
%rep CHAIN_LINKS
    %%operation
    FEEDBACK %%of_a, %%result, xmm15, xmm14
%endrep
    dec     rdi
    jnz     .round
.miss:
    mov     eax, CHAIN_LINKS
ENDFUNC

FUNC AOS_NAME(%%name) %+ _throughput
    lea     rsi, [%%a]
    lea     rdx, [%%b]
    %%zeros
align 32
.round:
%rep CHAIN_LINKS
    movaps  %%of_a, [rsi]
    %%load_b
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
    movaps  xmm14, [vector]
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

%assign AOS_BEST 0
%define AOS_NAME(name) paper_ %+ name
    AOS_OPERATIONS CHAINS

%assign AOS_BEST 1
%define AOS_NAME(name) aos_ %+ name
    AOS_OPERATIONS CHAINS
