; dot_wrong_lane.asm - a dot product that adds y twice and z never.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    movshdup xmm1, xmm0
    addss   xmm0, xmm1
    addss   xmm0, xmm1
    movss   [rdi], xmm0
    ret
