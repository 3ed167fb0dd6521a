; add_drops_w.asm - a sum that takes the fourth lane for 0.

default rel
section .text
global add
add:
    movaps  xmm0, [rsi]
    addps   xmm0, [rdx]
    movaps  [rdi], xmm0
    mov     dword [rdi + 12], 0
    ret
