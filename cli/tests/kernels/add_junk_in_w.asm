; add_junk_in_w.asm - a sum with junk in its fourth lane.

default rel
section .text
global add
add:
    movaps  xmm0, [rsi]
    addps   xmm0, [rdx]
    movaps  [rdi], xmm0
    mov     dword [rdi + 12], 0x3f800000
    ret
