; narrow.asm - from pixels of four channels to pixels of three, without the fourth.
;
; unsafe extern "sysv64" fn(four: *const, three: *mut, pixels: u64)
;
;   rayo_<isa>_narrow_rgb8      from rgba8
;   rayo_<isa>_narrow_f32x3     from f32x4
;
;   Kernels make pixels of four channels, which fill whole registers; files have three.
;
;   registers   rdi four, rsi three, rdx pixels left
;   requires    the CPUID features of the ISA
;   equals      Iterator::map, to the first three channels

; OF_TWO - d = numbers of d and of a: d op a.
;
;   instructions   1
%macro OF_TWO 4
%define %%op %1         ; [in]       insertps or shufps
%define %%d %2          ; [in/out]   128-bit register
%define %%a %3          ; [in]       128-bit register
%define %%which %4      ; [in]       which numbers, and where they go
%if HAS_VEX
    v%[%%op] %%d, %%d, %%a, %%which
%else
    %%op    %%d, %%a, %%which
%endif
%endmacro

; SIDE_BY_SIDE - stores the 12 bytes in each 128 bits of w1 one after another, and nothing past them, at an address of
;                any alignment. Clobbers w1 and w2.
;
;   instructions   sse41 2   avx2 4   avx512 4
%macro SIDE_BY_SIDE 1
%define %%m %1          ; [in]       general register: address
%if LANES == 16
    vmovdqa32 w2, [side_by_side]
    vpermd  w1, w2, w1
    vmovups [%%m], h1
    vextracti32x4 [%%m + 32], v1, 2
%elif LANES == 8
    vextracti128 x2, w1, 1
    vpblendd x1, x1, x2, 8
    vmovups [%%m], x1
    vmovq   [%%m + 16], x2
%else
    movq    [%%m], x1
    pextrd  [%%m + 8], x1, 2
%endif
%endmacro

; NARROWS - defines the functions of this file.
%macro NARROWS 0
FUNC ISA %+ _narrow_rgb8
    sub     rdx, LANES
    jb      .few
.packet:
    VLOAD   v1, [rdi]
    IOP     pshufb, w1, w1, [three_of_four]
    SIDE_BY_SIDE rsi
    add     rdi, VBYTES
    add     rsi, 3 * LANES
    sub     rdx, LANES
    jae     .packet
.few:
    add     rdx, LANES
    jz      .done
.pixel:
    mov     eax, [rdi]
    mov     [rsi], ax
    shr     eax, 16
    mov     [rsi + 2], al
    add     rdi, RGBA8_BYTES
    add     rsi, 3
    dec     rdx
    jnz     .pixel
.done:
    CLEAN_UPPER
ENDFUNC

FUNC ISA %+ _narrow_f32x3
    sub     rdx, 4
    jb      .few
.packet:
    VEX(movups) xmm1, [rdi]             ; x0 y0 z0 .
    VEX(movups) xmm2, [rdi + 16]
    VEX(movups) xmm3, [rdi + 32]
    VEX(movups) xmm4, [rdi + 48]
    OF_TWO  insertps, xmm1, xmm2, 0x30  ; x0 y0 z0 x1
    OF_TWO  shufps, xmm2, xmm3, 0x49    ; y1 z1 x2 y2
    OF_TWO  shufps, xmm4, xmm4, 0x90    ; .  x3 y3 z3
    OF_TWO  insertps, xmm4, xmm3, 0x80  ; z2 x3 y3 z3
    VEX(movups) [rsi], xmm1
    VEX(movups) [rsi + 16], xmm2
    VEX(movups) [rsi + 32], xmm4
    add     rdi, 4 * F32X4_BYTES
    add     rsi, 4 * 12
    sub     rdx, 4
    jae     .packet
.few:
    add     rdx, 4
    jz      .done
.pixel:
    VEX(movups) xmm1, [rdi]
    VEX(movlps) [rsi], xmm1
    VEX(extractps) [rsi + 8], xmm1, 2
    add     rdi, F32X4_BYTES
    add     rsi, 12
    dec     rdx
    jnz     .pixel
.done:
    CLEAN_UPPER
ENDFUNC
%endmacro
