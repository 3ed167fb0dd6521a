; dot_r12_r15.asm - two registers that are not restored.

default rel
section .text
global dot
dot:
    mov     r12, rsi
    mov     r15, rdx
    movaps  xmm0, [r12]
    mulps   xmm0, [r15]
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
