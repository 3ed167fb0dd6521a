; lit.asm - whole rows of a picture in which one light shines on one sphere: black, the sphere's span, and black again.
;
; The rows come from lit_rows.asm. A span is shaded in packets that are aligned in memory, so its first and its last
; packet hold black pixels too: these edge packets are masked, those between are not. Shading is bound by arithmetic and
; black pixels by stores, so in floats the two are interleaved: while a span is shaded, the black pixels between it and
; the next row's span are stored. In bytes this does not pay: cache misses cost less in one sequential stream than in
; two.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_<object>_<output>      unsafe extern "sysv64" fn(sphere, rows, count, out, width, streaming)
;
;   <object>    lit         any colours; not clamped: the light is known not to exceed white
;               grey        red, green and blue are equal; in f32 alone
;   <output>    f32x4       linear red, green, blue, 0
;               rgba8       levels of red, green, blue, and 255
;   ..._fast    with estimates in place of roots and divisions. Bytes from f32 are always made so, and bytes from f64
;               with refined estimates on AVX-512.
;
;   sphere      *const LitSphere
;   rows        *const LitRows, of which the first `count` are read
;   out         *mut of the first pixel, aligned to 4: `count` rows of `width` pixels are written and nothing else
;   streaming   u64: not 0 for stores that go past the cache
;
;   registers   rdi sphere, afterwards free; rsi the row's elements, rdx rows left, rcx the row's first pixel, r8 bytes
;               of a row, r9 streaming, r10 the first pixel not yet written, r11 the end of all pixels
;               r12 the packet, rbx the end of the span's last one, r13 the next span's first one (0 if not known)
;               rax lanes of the packet that are already written
;               v0 j, v1 v2 v3 the colour, v11 black, the LIT_ constants
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written
;   equals      kernels::portable::rows::shade_rows, to the last bit without estimates

; BEGIN_LIT - begins a function: loads the constants that the rows of the LitSphere at rdi share, reserves SCRATCH for
;             one packet of pixels, and saves rbx, r12 and r13; until END_LIT rbp is in use.
%macro BEGIN_LIT 0
    push    rbp
    mov     rbp, rsp
    push    rbx
    push    r12
    push    r13
    sub     rsp, 16 * LANES + VBYTES * LIT_PLACES
    and     rsp, -VBYTES
%define SCRATCH rsp + %[VBYTES * LIT_PLACES]
    LIT_SPHERE_CONSTANTS rdi
%endmacro

; END_LIT - undoes BEGIN_LIT, and clears the upper parts of the registers.
%macro END_LIT 0
    lea     rsp, [rbp - 24]
    pop     r13
    pop     r12
    pop     rbx
    pop     rbp
    CLEAN_UPPER
%endmacro

; LIT_BODY_GREY - v1 = the colour of the pixels j in v0, whose red, green and blue are equal. Keeps v0 and v11 to v14.
%macro LIT_BODY_GREY 1
%define %%edge %1       ; [in]       1 for a packet with an end of the span in it
    SPHERE_LIT v1, v0, %%edge, v4, v5, v6, v7, v8
%if %%edge
    LIT_KEEP 1
%endif
%endmacro

; LIT_BODY_LIT - v1, v2, v3 = red, green and blue of the pixels j in v0.
%macro LIT_BODY_LIT 1
%define %%edge %1       ; [in]       1 for a packet with an end of the span in it
    LIT_BODY_GREY %%edge
    VMUL    v2, v1, LIT_green
    VMUL    v3, v1, LIT_blue
    VMUL    v1, v1, LIT_red
%endmacro

; LIT_KEEP - zeroes the lanes of v<n> that are outside the span.
%macro LIT_KEEP 1
%define %%n %1          ; [in/out]   number of a register
    MASK_NOT_LESS v0, LIT_j
    MASK_AND_LESS v0, LIT_stop, v4
    MASK_KEEP v%[%%n]
%endmacro

; The pixels of a body: of floats in w4 and up, of bytes from w1 on.
%define LIT_PIXELS_LIT_F32X4 TRANSPOSE_F32X4 1, 2, 3, 4, 8, 9
%define LIT_PIXELS_LIT_RGBA8 PACK_RGBA8 1, 2, 3, 0
%define LIT_PIXELS_GREY_F32X4 SPREAD_F32X4 1, 4, edi, k2
%define LIT_PIXELS_GREY_RGBA8 GREY_RGBA8 1

; LIT_STORE - stores the packet at r12.
%macro LIT_STORE 1
%define %%format %1     ; [in]       F32X4 or RGBA8
    test    r9d, r9d
    jnz     %%stream
    STORE_ %+ %%format r12, %[%%format]_FIRST, movaps
    jmp     %%done
%%stream:
    STORE_ %+ %%format r12, %[%%format]_FIRST, movntps
%%done:
%endmacro

; LIT_BLACK - stores a packet of black floats at r10, and advances r10.
%macro LIT_BLACK 0
    test    r9d, r9d
    jnz     %%stream
    STORE_SAME_F32X4 r10, 11, movaps
    jmp     %%done
%%stream:
    STORE_SAME_F32X4 r10, 11, movntps
%%done:
    add     r10, LANES * F32X4_BYTES
%endmacro

; LIT_FILL - stores black from r10 up to an address and moves r10 there, if it is below: in floats up to the start of a
;            packet, in bytes up to any pixel. Black bytes are written by whole registers or, past the cache, where no
;            line may be written in both ways, by whole packets.
%macro LIT_FILL 2
%define %%format %1     ; [in]       F32X4 or RGBA8
%define %%to %2         ; [in]       general register
%if %[%%format]_FLOATS
    jmp     %%until
%%black:
    LIT_BLACK
%%until:
    cmp     r10, %%to
    jb      %%black
%else
    test    r9d, r9d
    jnz     %%until_packet
    lea     rdi, [r10 + VBYTES]
    cmp     rdi, %%to
    ja      %%few
    VSTORE  [r10], v11                  ; the first and the last register overlap with the aligned middle
    and     rdi, -VBYTES
    mov     r10, %%to
    and     r10, -VBYTES
    jmp     %%until
align 16
%%middle:
    VMOV_TO [rdi], v11
    add     rdi, VBYTES
%%until:
    cmp     rdi, r10
    jb      %%middle
    VSTORE  [%%to - VBYTES], v11
    mov     r10, %%to
    jmp     %%filled
%%packet:                               ; r10 is the start of one
    STORE_ %+ %%format r10, 11, movntps
    add     r10, LANES * %[%%format]_BYTES
%%until_packet:
    lea     rdi, [r10 + LANES * %[%%format]_BYTES]
    cmp     rdi, %%to
    jbe     %%packet
    jmp     %%few
%%pixel:
    STORE_PIXEL_ %+ %%format r10, 11
    add     r10, %[%%format]_BYTES
%%few:
    cmp     r10, %%to
    jb      %%pixel
%%filled:
%endif
%endmacro

; LIT_NEXT - goes to the next packet; in floats, stores up to two packets of the black before the next row's span.
%macro LIT_NEXT 1
%define %%format %1     ; [in]       F32X4 or RGBA8
    VADD    v0, v0, [PACKET(step)]
    add     r12, LANES * %[%%format]_BYTES
%if %[%%format]_FLOATS
%rep 2
    cmp     r10, r13
    jae     %%written
    LIT_BLACK
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
%assign %%bytes %[%%format]_BYTES
%assign %%packet LANES * %%bytes
FUNC NAME(%%object, %%output)
    BEGIN_LIT
    VMOV    v11, [%[%%format]_BLACK]
    imul    r8, r8, %%bytes
    mov     r10, rcx
    mov     r11, rdx
    imul    r11, r8
    add     r11, rcx
    ; black up to the start of a packet; a span that begins within it overwrites some
.head:
    test    r10, %%packet - 1
    jz      .row
    cmp     r10, r11
    jae     .row
    STORE_PIXEL_ %+ %%format r10, 11
    add     r10, %%bytes
    jmp     .head
align 16
.row:
    VTRUNCATE rax, [rsi + ELEM * LitRows.start]
    VTRUNCATE rbx, [rsi + ELEM * LitRows.end]
    cmp     rax, rbx
    jae     .next_row
    LIT_ROW_CONSTANTS rsi
    imul    rax, rax, %%bytes
    imul    rbx, rbx, %%bytes
    add     rax, rcx
    lea     rbx, [rcx + rbx + %%packet - %%bytes]
    and     rbx, -%%packet
    mov     r12, rax
    and     r12, -%%packet
    and     eax, %%packet - 1
    shr     eax, ilog2e(%%bytes)        ; lanes before the span
    VSPREAD_INTEGER 1, rax
    VMOV    v0, LIT_j
    VADD    v0, v0, [%[%%format]_ORDER]
    VSUB    v0, v0, v1
    LIT_FILL %%format, r12
    cmp     r10, r12
    mov     edi, 0
    cmove   rax, rdi                    ; all of the first packet is still to be written
    mov     r10, rbx
%if %[%%format]_FLOATS
    xor     r13d, r13d
    cmp     rdx, 2
    jb      .edge
    VTRUNCATE r13, [rsi + ELEM * (LitRows.start + 1)]
    VTRUNCATE rdi, [rsi + ELEM * (LitRows.end + 1)]
    cmp     r13, rdi
    mov     edi, 0
    cmovae  r13, rdi
    jae     .edge
    imul    r13, r13, %%bytes
    add     r13, rcx
    add     r13, r8
    and     r13, -%%packet
%endif
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
    ; black up to the end, floats first by whole packets and then by pixels
    mov     r12, r11
%if %[%%format]_FLOATS
    and     r12, -%%packet
%endif
    LIT_FILL %%format, r12
    jmp     .tail
.pixel:
    STORE_PIXEL_ %+ %%format r10, 11
    add     r10, %%bytes
.tail:
    cmp     r10, r11
    jb      .pixel
    END_LIT
    ret
.part:
    mov     rdi, r11
    sub     rdi, r12
    mov     r13d, %%packet
    cmp     rdi, r13
    cmova   rdi, r13
    shr     rdi, ilog2e(%%bytes)
    PART_ %+ %%format r12, %[%%format]_FIRST, rax, rdi, r13, k1, 3
    xor     eax, eax
    xor     r13d, r13d                  ; leaves the black to the next row
    jmp     .edge_stored
    END
%endmacro

; LITS - the functions that make rows of one output.
%macro LITS 2
%define %%output %1     ; [in]       part of the functions' names
%define %%format %2     ; [in]       F32X4 or RGBA8
    LIT     lit, %%output, LIT, %%format
%if ELEM == 4
    LIT     grey, %%output, GREY, %%format
%endif
%endmacro

; LIT_TRACERS - defines the functions of this file, for one element type.
%macro LIT_TRACERS 0
%assign ESTIMATE 0
    LITS    f32x4, F32X4
%if ELEM == 4
%assign ESTIMATE 1
    LITS    f32x4_fast, F32X4
%elif HAS_MASKS
%assign ESTIMATE 1                      ; with Newton steps to the end
%endif
    LITS    rgba8, RGBA8
%endmacro
