; normalise_by_reciprocal.asm - a division by the length as a product with its reciprocal.

default rel
section .text
global normalise
normalise:
    movaps  xmm0, [rsi]
    movaps  xmm1, xmm0
    mulps   xmm1, xmm1
    haddps  xmm1, xmm1
    haddps  xmm1, xmm1
    sqrtps  xmm1, xmm1
    movaps  xmm2, [one]
    divps   xmm2, xmm1
    mulps   xmm0, xmm2
    movaps  [rdi], xmm0
    ret
    section .rodata align=16
    one: times 4 dd 1.0
