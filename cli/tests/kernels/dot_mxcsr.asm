; dot_mxcsr.asm - a control register of floating point that is left changed.

default rel
section .text
global dot
dot:
    stmxcsr [rsp - 8]
    or      dword [rsp - 8], 0x6000
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ldmxcsr [rsp - 8]
    ret
