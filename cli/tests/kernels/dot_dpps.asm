; dot_dpps.asm - one instruction for the whole product.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    dpps    xmm0, [rdx], 0xf1
    movss   [rdi], xmm0
    ret
