; dot_fma.asm - fused multiply-adds of the lanes, and vzeroupper where it is not needed.

default rel
section .text
global dot
dot:
    vmovss  xmm0, [rsi]
    vmulss  xmm0, xmm0, [rdx]
    vmovss  xmm1, [rsi + 4]
    vfmadd231ss xmm0, xmm1, [rdx + 4]
    vmovss  xmm1, [rsi + 8]
    vfmadd231ss xmm0, xmm1, [rdx + 8]
    vmovss  [rdi], xmm0
    ret
