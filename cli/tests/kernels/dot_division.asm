; dot_division.asm - a division by 0 in a general register.

default rel
section .text
global dot
dot:
    xor     edx, edx
    xor     ecx, ecx
    div     ecx
    movss   [rdi], xmm0
    ret
