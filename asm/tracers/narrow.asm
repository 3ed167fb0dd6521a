; narrow.asm - from pixels of four channels to pixels of three: the fourth left out.
;
; unsafe extern "sysv64" fn(four: *const, three: *mut, pixels: u64)
;
;   rayo_<isa>_narrow_rgb8      from rgba8
;   rayo_<isa>_narrow_f32x3     from f32x4
;
;   Most kernels make four channels alone, which fill whole registers; files have three.
;
;   registers   rdi four, rsi three, rdx pixels to go
;   requires    the CPUID features of the ISA
;   equals      Iterator::map, to the first three channels

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
%if HAS_VEX
    vzeroupper
%endif
ENDFUNC

FUNC ISA %+ _narrow_f32x3
    dec     rdx
    jz      .last
.pixel:
%if HAS_VEX
    vmovups x1, [rdi]
    vmovups [rsi], x1                   ; the next pixel takes the fourth float's place
%else
    movups  x1, [rdi]
    movups  [rsi], x1
%endif
    add     rdi, F32X4_BYTES
    add     rsi, F32X3_BYTES
    dec     rdx
    jnz     .pixel
.last:
%if HAS_VEX
    vmovups x1, [rdi]
%else
    movups  x1, [rdi]
%endif
    STORE_PIXEL_F32X3 rsi, 1
%if HAS_VEX
    vzeroupper
%endif
ENDFUNC
%endmacro
