; dot_red_zone.asm - data in the 128 bytes under rsp, which signals leave alone.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    movaps  [rsp - 24], xmm1
    mulps   xmm0, [rsp - 24]
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
