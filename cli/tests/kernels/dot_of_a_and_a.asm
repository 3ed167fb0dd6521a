; dot_of_a_and_a.asm - a dot product of a with itself.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    mulps   xmm0, xmm0
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
