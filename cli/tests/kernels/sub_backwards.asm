; sub_backwards.asm - b - a in place of a - b.

default rel
section .text
global sub
sub:
    movaps  xmm0, [rdx]
    subps   xmm0, [rsi]
    movaps  [rdi], xmm0
    ret
