; dot_other_order.asm - a dot product that adds x and z first.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    movhlps xmm1, xmm0
    addps   xmm0, xmm1
    movshdup xmm1, xmm0
    addss   xmm0, xmm1
    movss   [rdi], xmm0
    ret
