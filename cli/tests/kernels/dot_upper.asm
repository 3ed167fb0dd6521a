; dot_upper.asm - upper halves of registers that are left dirty.

default rel
section .text
global dot
dot:
    vbroadcastf128 ymm2, [rsi]
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
