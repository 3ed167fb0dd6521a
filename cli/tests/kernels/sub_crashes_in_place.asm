; sub_crashes_in_place.asm - a difference that crashes where its result lies in the place of a.

default rel
section .text
global sub
sub:
    cmp     rdi, rsi
    jne     .apart
    ud2
.apart:
    movaps  xmm0, [rsi]
    subps   xmm0, [rdx]
    movaps  [rdi], xmm0
    ret
