; dot_no_root_below_zero.asm - the square of the root of a dot product, which is NaN where that is negative.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    mulps   xmm0, [rdx]
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    sqrtss  xmm0, xmm0
    mulss   xmm0, xmm0
    movss   [rdi], xmm0
    ret
