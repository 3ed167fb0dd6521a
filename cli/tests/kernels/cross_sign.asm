; cross_sign.asm - b x a in place of a x b.

default rel
section .text
global cross
cross:
    movaps  xmm2, [rsi]
    movaps  xmm1, [rdx]
    pshufd  xmm0, xmm1, 0xc9
    pshufd  xmm3, xmm2, 0xd2
    mulps   xmm0, xmm3
    pshufd  xmm3, xmm1, 0xd2
    pshufd  xmm4, xmm2, 0xc9
    mulps   xmm3, xmm4
    subps   xmm0, xmm3
    movaps  [rdi], xmm0
    ret
