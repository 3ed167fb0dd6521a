; dot_rbp.asm - a frame that is made and never left.

default rel
section .text
global dot
dot:
    mov     rbp, rsp
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
