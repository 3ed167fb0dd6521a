; dot_aligned_store.asm - an aligned store to the address of a float.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movaps  [rdi], xmm0
    ret
