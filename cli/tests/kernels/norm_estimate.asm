; norm_estimate.asm - a length by the reciprocal estimate, which has twelve bits.

default rel
section .text
global norm
norm:
    movaps  xmm0, [rsi]
    mulps   xmm0, xmm0
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    rsqrtss xmm1, xmm0
    mulss   xmm0, xmm1
    movss   [rdi], xmm0
    ret
