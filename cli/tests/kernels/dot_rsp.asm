; dot_rsp.asm - a stack pointer that is not put back.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    pop     rax
    add     rsp, 8
    jmp     rax
