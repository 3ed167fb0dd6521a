; dot_own_code.asm - a function that writes over its own code.

default rel
section .text
global dot
dot:
    lea     rax, [dot]
    mov     byte [rax], 0x90
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
