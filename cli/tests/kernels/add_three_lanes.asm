; add_three_lanes.asm - a sum whose fourth lane is never written.

default rel
section .text
global add
add:
    movaps  xmm0, [rsi]
    addps   xmm0, [rdx]
    movlps  [rdi], xmm0
    movhlps xmm0, xmm0
    movss   [rdi + 8], xmm0
    ret
