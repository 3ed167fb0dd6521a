; lit.asm - whole rows of a picture in which one light shines on one sphere: black, the sphere's span, and black again.
;
; The rows come from lit_rows.asm. A span is shaded packet by packet from where the memory is aligned to one, so its
; first and its last packet hold black pixels too: these edge packets are masked, those between are not. Shading wants
; arithmetic and black pixels want nothing but stores, so that in floats the two go side by side: while a span is
; shaded, what is black between it and the next row's span is stored along the way. Bytes are too few for that: lines
; that are not in cache come faster one after another than from two places in turn.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_<object>_<output>      unsafe extern "sysv64" fn(sphere, rows, count, out, width, streaming)
;
;   rayo_<p>_lit_planes             unsafe extern "sysv64" fn(sphere, rows, unused, row, pixels, stride)
;
;   <object>    lit         any colours; no clamp: the light is known not to exceed white
;               grey        red, green and blue are equal
;   <output>    f32x4       linear red, green, blue, 0
;               rgba8       levels of red, green, blue, and 255
;   ..._fast    with estimates in place of roots and divisions. 8 bits in f32 have nothing else, and 8 bits in f64 have
;               them, refined to the end, where AVX-512 has them.
;
;   sphere      *const LitSphere
;   rows        *const LitRows, of which the first `count` are read
;   out         *mut of the first pixel, aligned to 4: `count` rows of `width` pixels are written and nothing else
;   streaming   u64: not 0 for stores that go past the cache; f32x4 only
;   row, pixels, stride     as in spans.asm
;
;   registers   rdi sphere, afterwards free; rsi the row's elements, rdx rows left, rcx the row's first pixel, r8 bytes
;               of a row, r9 streaming, r10 where pixels are not yet written, r11 the end of all pixels
;               r12 the packet, rbx the end of the span's last one, r13 the next span's first one (0 if not known)
;               rax lanes of the packet that are written already
;               v0 j, v1 v2 v3 the colour, v11 black, the LIT_ constants
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written
;   equals      reference::packet, to the last bit where there is no estimate

; LIT_BODY_LIT - the colour in v1, v2, v3 of the pixels j in v0. v0 and v11 to v14 stay.
%macro LIT_BODY_LIT 1
%define %%edge %1       ; [in]       1 for a packet with an end of the span in it
    SPHERE_LIT v1, v0, %%edge, v4, v5, v6, v7, v8, v9, v10
%if %%edge
    LIT_KEEP 1
%endif
    VMUL    v2, v1, LIT_green
    VMUL    v3, v1, LIT_blue
    VMUL    v1, v1, LIT_red
%endmacro

; LIT_BODY_GREY - the same where red, green and blue are equal: in v1 alone.
%macro LIT_BODY_GREY 1
%define %%edge %1       ; [in]       1 for a packet with an end of the span in it
    SPHERE_LIT v1, v0, %%edge, v4, v5, v6, v7, v8, v9, v10
%if %%edge
    LIT_KEEP 1
%endif
%endmacro

; LIT_KEEP - 0 in the lanes of v<n> that are not the span's.
%macro LIT_KEEP 1
%define %%n %1          ; [in/out]   number of a register
    MASK_NOT_LESS v0, LIT_j
    MASK_AND_LESS v0, LIT_stop, v4
    VKEEP   v%[%%n]
%endmacro

; LIT_PIXELS_LIT_F32X4 - the pixels of LIT_BODY_LIT in w4 and up.
%macro LIT_PIXELS_LIT_F32X4 0
    TURN_F32X4 1, 2, 3, 4, 8, 9
%endmacro

; LIT_PIXELS_LIT_RGBA8 - the pixels of LIT_BODY_LIT in w1.
%macro LIT_PIXELS_LIT_RGBA8 0
    PACK_RGBA8 1, 2, 3, 0
%endmacro

; LIT_PIXELS_GREY_F32X4 - the pixels of LIT_BODY_GREY in w4 and up.
%macro LIT_PIXELS_GREY_F32X4 0
    SPREAD_F32X4 1, 4, edi, k2
%endmacro

; LIT_PIXELS_GREY_RGBA8 - the pixels of LIT_BODY_GREY in w1.
%macro LIT_PIXELS_GREY_RGBA8 0
    PACK_GREY 1
%endmacro

; LIT_STORE - stores the packet at r12.
%macro LIT_STORE 1
%define %%format %1     ; [in]       F32X4 or RGBA8
%ifidn %%format, F32X4
    test    r9d, r9d
    jnz     %%stream
    STORE_F32X4 r12, 4, movaps
    jmp     %%done
%%stream:
    STORE_F32X4 r12, 4, movntps
%%done:
%else
    STORE_RGBA8 r12, 1
%endif
%endmacro

; LIT_BLACK - stores a packet of black at r10, and steps over it.
%macro LIT_BLACK 1
%define %%format %1     ; [in]       F32X4 or RGBA8
%ifidn %%format, F32X4
    test    r9d, r9d
    jnz     %%stream
    STORE_SAME_F32X4 r10, 11, movaps
    jmp     %%done
%%stream:
    STORE_SAME_F32X4 r10, 11, movntps
%%done:
%else
    STORE_RGBA8 r10, 11
%endif
    add     r10, LANES * %%format %+ _BYTES
%endmacro

; LIT_NEXT - steps to the next packet; in floats, stores up to two packets of what is black before the next row's span.
%macro LIT_NEXT 1
%define %%format %1     ; [in]       F32X4 or RGBA8
    VADD    v0, v0, [PACKET(step)]
    add     r12, LANES * %%format %+ _BYTES
%ifidn %%format, F32X4
%rep 2
    cmp     r10, r13
    jae     %%written
    LIT_BLACK %%format
%endrep
%%written:
%endif
%endmacro

; LIT - a function that makes rows.
%macro LIT 4
%define %%object %1     ; [in]       lit or grey: part of the function's name
%define %%output %2     ; [in]       part of the function's name
%define %%body %3       ; [in]       LIT_BODY_<body>
%define %%format %4     ; [in]       F32X4 or RGBA8
%assign %%packet LANES * %%format %+ _BYTES
FUNC NAME(%%object, %%output)
    LIT_SPHERE_CONSTANTS
%ifidn %%format, F32X4
    VZERO   v11
%elif HAS_VEX
    vmovaps w11, [PACKET(opaque)]
%else
    movaps  w11, [PACKET(opaque)]
%endif
    shl     r8, %%format %+ _SHIFT
    mov     r10, rcx
    mov     r11, rdx
    imul    r11, r8
    add     r11, rcx
    ; black up to where the memory is aligned to a packet; a span that begins there is written over it
.head:
    test    r10, %%packet - 1
    jz      .row
    cmp     r10, r11
    jae     .row
    STORE_PIXEL_ %+ %%format r10, 11
    add     r10, %%format %+ _BYTES
    jmp     .head
align 16
.row:
    VTRUNCATE rax, [rsi + ELEM * LitRows.start]
    VTRUNCATE rbx, [rsi + ELEM * LitRows.end]
    cmp     rax, rbx
    jae     .next_row
    LIT_ROW_CONSTANTS
    shl     rax, %%format %+ _SHIFT
    shl     rbx, %%format %+ _SHIFT
    add     rax, rcx
    lea     rbx, [rcx + rbx + %%packet - 1]
    and     rbx, -%%packet
    mov     r12, rax
    and     r12, -%%packet
    sub     rax, r12
    shr     rax, %%format %+ _SHIFT     ; lanes before the span
    VSPREAD_INTEGER 1, rax
    VMOV    v0, LIT_j
    VADD    v0, v0, [%%format %+ _ORDER]
    VSUB    v0, v0, v1
    jmp     .black_until_span
.black:
    LIT_BLACK %%format
.black_until_span:
    cmp     r10, r12
    jb      .black
    mov     edi, 0
    cmove   rax, rdi                    ; all of the first packet is still to be written
    mov     r10, rbx
    xor     r13d, r13d
    cmp     rdx, 2
    jb      .edge
    VTRUNCATE rdi, [rsi + ELEM * (LitRows.start + 1)]
    VTRUNCATE r13, [rsi + ELEM * (LitRows.end + 1)]
    cmp     rdi, r13
    mov     r13d, 0
    jae     .edge
    shl     rdi, %%format %+ _SHIFT
    add     rdi, rcx
    lea     r13, [rdi + r8]
    and     r13, -%%packet
.edge:
    LIT_BODY_ %+ %%body 1
    LIT_PIXELS_ %+ %%body %+ _ %+ %%format
    lea     rdi, [r12 + %%packet]
    cmp     rdi, r11
    ja      .part
    test    eax, eax
    jnz     .part
    LIT_STORE %%format
.edge_stored:
    LIT_NEXT %%format
    lea     rdi, [r12 + %%packet]
    cmp     rdi, rbx
    ja      .next_row
    je      .edge
align 16
.packet:
    LIT_BODY_ %+ %%body 0
    LIT_PIXELS_ %+ %%body %+ _ %+ %%format
    LIT_STORE %%format
    LIT_NEXT %%format
    lea     rdi, [r12 + %%packet]
    cmp     rdi, rbx
    jb      .packet
    jmp     .edge
.next_row:
    add     rsi, ELEM
    add     rcx, r8
    dec     rdx
    jnz     .row
    ; black up to the end: whole packets, then pixels
    jmp     .whole
.whole_black:
    LIT_BLACK %%format
.whole:
    lea     rdi, [r10 + %%packet]
    cmp     rdi, r11
    jbe     .whole_black
    jmp     .tail
.pixel:
    STORE_PIXEL_ %+ %%format r10, 11
    add     r10, %%format %+ _BYTES
.tail:
    cmp     r10, r11
    jb      .pixel
    LIT_UNCONSTANTS
    ret
.part:
    mov     rdi, r11
    sub     rdi, r12
    shr     rdi, %%format %+ _SHIFT
    mov     r13d, LANES
    cmp     rdi, r13
    cmova   rdi, r13
%ifidn %%format, F32X4
    PART_F32X4 r12, 4, rax, rdi, r13, k1, 1
%else
    PART_RGBA8 r12, 1, rax, rdi, r13, k1, 2
%endif
    xor     eax, eax
    xor     r13d, r13d                  ; leave what is black to the next row
    jmp     .edge_stored
    END
%endmacro

; LIT_PLANES - a function that shades, of a row's span in the row of buffers of spans.asm, the pixels that are the
; span's own. The row is the first of `rows`.
%macro LIT_PLANES 1
%define %%output %1     ; [in]       part of the function's name
FUNC NAME(lit, %%output)
    LIT_SPHERE_CONSTANTS
    LIT_ROW_CONSTANTS
    VSPREAD v13, [rsi + ELEM * LitRows.id]
    VMOV    v0, LIT_j
    VADD    v0, v0, [PACKET(natural)]
    lea     r10, [r9 + 2 * r9]
align 16
.packet:
    SPHERE_LIT v1, v0, 1, v4, v5, v6, v7, v8, v9, v10
    VMUL    v2, v1, LIT_green
    VMUL    v3, v1, LIT_blue
    VMUL    v1, v1, LIT_red
    VLOAD   v14, [rcx]
    MASK_EQUAL v14, v13
    VSTORE_MASKED rcx + r9, v1, v4
    VSTORE_MASKED rcx + 2 * r9, v2, v4
    VSTORE_MASKED rcx + r10, v3, v4
    VADD    v0, v0, [PACKET(step)]
    add     rcx, VBYTES
    sub     r8, LANES
    ja      .packet
    LIT_UNCONSTANTS
ENDFUNC
%endmacro

%assign ESTIMATE 0
    LIT_PLANES planes
    LIT     lit, f32x4, LIT, F32X4
    LIT     grey, f32x4, GREY, F32X4
%if ELEM == 4
%assign ESTIMATE 1
    LIT     lit, f32x4_fast, LIT, F32X4
    LIT     grey, f32x4_fast, GREY, F32X4
%elif HAS_MASKS
%assign ESTIMATE 1                      ; with Newton steps to the end
%endif
%if ESTIMATE
    LIT_PLANES planes_fast
%endif
    LIT     lit, rgba8, LIT, RGBA8
    LIT     grey, rgba8, GREY, RGBA8

; This file is assembled once per element type.
%unmacro LIT_BODY_LIT 1
%unmacro LIT_BODY_GREY 1
%unmacro LIT_KEEP 1
%unmacro LIT_PIXELS_LIT_F32X4 0
%unmacro LIT_PIXELS_LIT_RGBA8 0
%unmacro LIT_PIXELS_GREY_F32X4 0
%unmacro LIT_PIXELS_GREY_RGBA8 0
%unmacro LIT_STORE 1
%unmacro LIT_BLACK 1
%unmacro LIT_NEXT 1
%unmacro LIT 4
%unmacro LIT_PLANES 1
