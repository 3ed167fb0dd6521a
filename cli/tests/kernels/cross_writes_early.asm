; cross_writes_early.asm - a result that is written before all of the arguments are read.

default rel
section .text
global cross
cross:
    movss   xmm0, [rsi + 4]
    mulss   xmm0, [rdx + 8]
    movss   xmm1, [rsi + 8]
    mulss   xmm1, [rdx + 4]
    subss   xmm0, xmm1
    movss   [rdi], xmm0
    movss   xmm0, [rsi + 8]
    mulss   xmm0, [rdx]
    movss   xmm1, [rsi]
    mulss   xmm1, [rdx + 8]
    subss   xmm0, xmm1
    movss   [rdi + 4], xmm0
    movss   xmm0, [rsi]
    mulss   xmm0, [rdx + 4]
    movss   xmm1, [rsi + 4]
    mulss   xmm1, [rdx]
    subss   xmm0, xmm1
    movss   [rdi + 8], xmm0
    movss   xmm0, [rsi + 12]
    mulss   xmm0, [rdx + 12]
    subss   xmm0, xmm0
    movss   [rdi + 12], xmm0
    ret
