; dot_called.asm - a part of the product in a function that is called.

default rel
section .text
global dot
dot:
    call    product
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
product:
    movaps  xmm0, [rsi]
    mulps   xmm0, [rdx]
    ret
