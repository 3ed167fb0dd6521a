; dot_loop.asm - a loop without an end.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
.again:
    jmp     .again
