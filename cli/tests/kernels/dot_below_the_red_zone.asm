; dot_below_the_red_zone.asm - data further under rsp than signals leave alone.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    movaps  [rsp - 264], xmm1
    mulps   xmm0, [rsp - 264]
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
