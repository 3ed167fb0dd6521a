; dot_jumps_below_the_red_zone.asm - an address of code further under rsp than signals leave alone.

default rel
section .text
global dot
dot:
    lea     rax, [.sum]
    mov     [rsp - 256], rax
    movaps  xmm0, [rsi]
    mulps   xmm0, [rdx]
    jmp     [rsp - 256]
.sum:
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ret
