; dot_no_nan.asm - a dot product that gives 0 in place of NaN.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    xorps   xmm2, xmm2
    movaps  xmm1, xmm0
    cmpordss xmm1, xmm0
    andps   xmm0, xmm1
    movss   [rdi], xmm0
    ret
