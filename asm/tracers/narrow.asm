; narrow.asm - from pixels of four channels to pixels of three, without the fourth.
;
; unsafe extern "sysv64" fn(four: *const, three: *mut, pixels: u64)
;
;   rayo_<isa>_narrow_rgb8      from rgba8
;   rayo_<isa>_narrow_f32x3     from f32x4
;
;   Most kernels make only pixels of four channels, which fill whole registers; files have three.
;
;   registers   rdi four, rsi three, rdx pixels left
;   requires    the CPUID features of the ISA
;   equals      Iterator::map, to the first three channels

; INSERT_FLOAT - copies one float of a to d.
%macro INSERT_FLOAT 3
%define %%d %1          ; [in/out]   128-bit register
%define %%a %2          ; [in]       128-bit register
%define %%which %3      ; [in]       as in insertps: the lane of a in the upper two bits, that of d in the next two
%if HAS_VEX
    vinsertps %%d, %%d, %%a, %%which
%else
    insertps %%d, %%a, %%which
%endif
%endmacro

; NARROWS - the functions of this file.
%macro NARROWS 0
FUNC ISA %+ _narrow_rgb8
    sub     rdx, LANES
    jb      .few
.packet:
    VLOAD   v1, [rdi]
    IOP     pshufb, w1, w1, [PACKET(three_of_four)]
    SIDE_BY_SIDE 1
    STORE_RGB8 rsi, 1, movups
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
    add     rsi, RGB8_BYTES
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
    INSERT_FLOAT xmm1, xmm2, 0x30       ; x0 y0 z0 x1
    SHUFFLE xmm2, xmm2, xmm3, 0x49      ; y1 z1 x2 y2
    SHUFFLE xmm4, xmm4, xmm4, 0x90      ; .  x3 y3 z3
    INSERT_FLOAT xmm4, xmm3, 0x80       ; z2 x3 y3 z3
    VEX(movups) [rsi], xmm1
    VEX(movups) [rsi + 16], xmm2
    VEX(movups) [rsi + 32], xmm4
    add     rdi, 4 * F32X4_BYTES
    add     rsi, 4 * F32X3_BYTES
    sub     rdx, 4
    jae     .packet
.few:
    add     rdx, 4
    jz      .done
.pixel:
    VEX(movups) xmm1, [rdi]
    STORE_PIXEL_F32X3 rsi, 1
    add     rdi, F32X4_BYTES
    add     rsi, F32X3_BYTES
    dec     rdx
    jnz     .pixel
.done:
    CLEAN_UPPER
ENDFUNC
%endmacro
