; dot_wrong_and_rbx.asm - two faults at once: a wrong result and a register that is not restored.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    mov     rbx, rdx
    mulps   xmm0, [rbx]
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
