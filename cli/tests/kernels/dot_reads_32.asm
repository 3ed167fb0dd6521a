; dot_reads_32.asm - a load of 32 bytes where there are 16.

default rel
section .text
global dot
dot:
    vmovups ymm0, [rsi]
    vextractf128 xmm2, ymm0, 0
    vzeroupper
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
