; dot_unaligned.asm - unaligned loads, which do no harm.

default rel
section .text
global dot
dot:
    movups  xmm0, [rsi]
    movups  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
