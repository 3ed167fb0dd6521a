; dot_smashes_stack.asm - a function that writes over all of the stack above it.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    lea     rdi, [rsp + 8]
    mov     ecx, 4096
    xor     eax, eax
    rep stosq
    ret
