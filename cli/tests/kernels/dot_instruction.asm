; dot_instruction.asm - an instruction that no CPU has.

default rel
section .text
global dot
dot:
    movaps  xmm0, [rsi]
    ud2
    movss   [rdi], xmm0
    ret
