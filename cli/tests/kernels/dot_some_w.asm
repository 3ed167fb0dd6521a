; dot_some_w.asm - a dot product that adds the product of the fourth lanes only if a's is above 0.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    mulps   xmm0, [rdx]
    movss   xmm1, [rsi + 12]
    xorps   xmm2, xmm2
    comiss  xmm1, xmm2
    ja      .sum
    insertps xmm0, xmm0, 8
.sum:
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
