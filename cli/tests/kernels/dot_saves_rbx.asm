; dot_saves_rbx.asm - a general register that is saved and restored.

default rel
section .text
global dot
dot:
    push    rbx
    mov     rbx, rdx
    movaps  xmm0, [rsi]
    mulps   xmm0, [rbx]
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    pop     rbx
    ret
