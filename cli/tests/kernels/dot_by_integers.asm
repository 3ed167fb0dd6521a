; dot_by_integers.asm - a dot product that drops fractions.

default rel
section .text
global dot
dot:
    cvttps2dq xmm0, [rsi]
    cvttps2dq xmm1, [rdx]
    cvtdq2ps xmm0, xmm0
    cvtdq2ps xmm1, xmm1
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
