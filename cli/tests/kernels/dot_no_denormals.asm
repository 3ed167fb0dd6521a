; dot_no_denormals.asm - a dot product that takes denormal numbers for 0, and puts MXCSR back.

default rel
section .text
global dot
dot:
    stmxcsr [rsp - 8]
    stmxcsr [rsp - 4]
    or      dword [rsp - 4], 0x8040
    ldmxcsr [rsp - 4]
    movaps  xmm0, [rsi]
    movaps  xmm1, [rdx]
    mulps   xmm0, xmm1
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    ldmxcsr [rsp - 8]
    ret
