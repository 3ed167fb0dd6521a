; dot_writes_16.asm - a store of 16 bytes where there are 4.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movups  [rdi], xmm0
    ret
