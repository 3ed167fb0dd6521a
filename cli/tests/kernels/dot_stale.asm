; dot_stale.asm - a dot product that adds what the result was before.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    addss   xmm0, [rdi]
    movss   [rdi], xmm0
    ret
