; scale_one_lane.asm - a scaling of the first lane alone.

default rel
section .text
global scale
scale:
    movaps  xmm0, [rsi]
    mulss   xmm0, [rdx]
    movaps  [rdi], xmm0
    ret
