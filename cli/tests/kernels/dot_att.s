# dot_att.s - the dot product in the syntax of AT&T.
    .globl  dot
    .type   dot, @function
dot:
    movaps  (%rsi), %xmm0
    mulps   (%rdx), %xmm0
    haddps  %xmm0, %xmm0
    haddps  %xmm0, %xmm0
    movss   %xmm0, (%rdi)
    ret
    .size   dot, .-dot
    .section .note.GNU-stack, "", @progbits
