; norm_not_rooted.asm - the square of the length.

default rel
section .text
global norm
norm:
    movaps  xmm0, [rsi]
    mulps   xmm0, xmm0
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
