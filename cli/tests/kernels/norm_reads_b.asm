; norm_reads_b.asm - a load from b, which a length is not given.

default rel
section .text
global norm
norm:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm0
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    sqrtss  xmm0, xmm0
    movss   [rdi], xmm0
    ret
