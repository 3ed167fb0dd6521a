; dot_adds_one.asm - a dot product that is one too large where it is 0.

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
    comiss  xmm0, xmm2
    jne     .store
    jp      .store
    movss   xmm0, [one]
.store:
    movss   [rdi], xmm0
    ret
    section .rodata
    one: dd 1.0
