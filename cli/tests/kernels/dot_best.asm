; dot_best.asm - the order of our best form, without the fourth lane.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    movshdup xmm1, xmm0
    addss   xmm1, xmm0
    movhlps xmm0, xmm0
    addss   xmm0, xmm1
    movss   [rdi], xmm0
    ret
