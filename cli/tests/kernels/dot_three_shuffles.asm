; dot_three_shuffles.asm - a dot product of its own with three shuffles, in the order of the twin.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    movshdup xmm1, xmm0
    addps   xmm0, xmm1
    movhlps xmm1, xmm0
    addss   xmm0, xmm1
    movss   [rdi], xmm0
    ret
