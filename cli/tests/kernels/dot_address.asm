; dot_address.asm - a load from where nothing is.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    xor     eax, eax
    mulps   xmm0, [rax + 64]
    movss   [rdi], xmm0
    ret
