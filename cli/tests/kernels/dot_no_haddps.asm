; dot_no_haddps.asm - a dot product that forgets both.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    movss   [rdi], xmm0
    ret
