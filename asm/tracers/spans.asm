; spans.asm - the packet tracers: LANES rays in lockstep along a span, the pixels of a row that one object covers.
;
; This is Algorithm 1 with its loops the other way round. For each row the driver knows, in f64 and closed form, which
; pixels each object covers (line 14), so no kernel asks again. Where an object is alone, its pixels are shaded at once
; (lines 18 to 21). Where spans overlap, `depth` finds the nearest object of each pixel (lines 12 to 17) in a row of
; buffers that stays in cache, then `planes` shades each object's own pixels there, and `emit` writes the row out.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_<object>_<output>      unsafe extern "sysv64" fn(span, lits, lit_count, out, pixels, streaming)
;   rayo_<p>_<object>_planes        unsafe extern "sysv64" fn(span, lits, lit_count, row, pixels, stride)
;   rayo_<p>_<object>_depth         unsafe extern "sysv64" fn(span, row, pixels, stride)
;   rayo_<p>_emit_<output>          unsafe extern "sysv64" fn(row, stride, out, pixels)
;
;   <object>    lit         a sphere from outside, one light, in the short form (no planes, no depth); no clamp: the
;                           light is known not to exceed white
;               grey        the same where red, green and blue are equal (rgba8 only)
;               outside     a sphere from outside
;               inside      a sphere from inside
;               triangle    a triangle
;   <output>    f32x4       linear red, green, blue, 0
;               rgba8       levels of red, green, blue, and 255
;   ..._fast    with estimates in place of roots and divisions, where only the shade depends on them. 8 bits in f32
;               have nothing else.
;
;   span        *const of the object's span record; its fields are the constants K
;   lits        *const Lit, lit_count of them
;   out         *mut of the first pixel; pixels >= 1 of them are written and nothing else
;   streaming   u64: not 0 for stores that go past the cache; f32x4 only
;   row         *mut element: five planes of `stride` bytes each: who (0 for nobody, else the span's id), red, green,
;               blue, 1/t. It points to the span's first pixel, and up to LANES - 1 elements past its last are read and
;               written back unchanged (depth) or in pixels that are the span's own (planes)
;
;   registers   rdi span, rsi lits, rdx lit_count, rcx out or row, r8 pixels, r9 streaming or stride
;               v0 j, v1 v2 v3 the colour, the others as the bodies say
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written
;   equals      reference::packet, to the last bit where there is no estimate

%define NAME(object, what) ISA_NAME %+ _ %+ object %+ _ %+ what

; LIGHTS - the colour in v1, v2, v3 of points o in v4, v5, v6 under all lights.
%macro LIGHTS 1
%define %%flat %1       ; [in]       1 for a triangle
    VZERO   v1
    VZERO   v2
    VZERO   v3
    mov     r11, rsi
    mov     rax, rdx
    test    rax, rax
    jz      %%dark
%%light:
    LAMBERT3 v1, v2, v3, v4, v5, v6, r11, %%flat, v7, v8, v9, v10, v11, v12
    add     r11, ELEM * Lit_size
    dec     rax
    jnz     %%light
%%dark:
%endmacro

; The bodies: the colour in v1, v2, v3 of the pixels j in v0. They leave v0 and v14, v15 alone.
%macro BODY_LIT 0
    SPHERE_LIT v1, v0, v4, v5, v6, v7, v8
    VMUL    v2, v1, K(LitSpan.green)
    VMUL    v3, v1, K(LitSpan.blue)
    VMUL    v1, v1, K(LitSpan.red)
%endmacro
%macro BODY_GREY 0
    SPHERE_LIT v1, v0, v4, v5, v6, v7, v8
    VMUL    v1, v1, K(LitSpan.red)
%endmacro
%macro BODY_OUTSIDE 0
    SPHERE_OUTSIDE v4, v5, v6, v0, v7, v8, v9, v10
    LIGHTS  0
%endmacro
%macro BODY_INSIDE 0
    SPHERE_INSIDE v4, v5, v6, v0, v7, v8
    LIGHTS  0
%endmacro
%macro BODY_TRIANGLE 0
    TRIANGLE_PLANE v4, v5, v6, v0, v7, v8
    LIGHTS  1
%endmacro

; What depth compares: v1 = 1/t of the pixels j in v0.
%macro DEN_OUTSIDE 0
    SPHERE_DEN v1, v0, v2, v3
%endmacro
%macro DEN_INSIDE 0
    SPHERE_FAR_WALL v2, v3, v0, v4, v5
    VMOV    v1, [PACKET(ones)]
    VDIV    v1, v1, v2
%endmacro
%macro DEN_TRIANGLE 0
    VAFFINE v1, v0, TriangleSpan.w1, TriangleSpan.w0
%endmacro

; The outputs: bytes of a pixel, their logarithm, and the order of lanes that their stores want.
%assign F32X4_BYTES 16
%assign F32X4_SHIFT 4
%define F32X4_ORDER PACKET(turned)
%assign RGBA8_BYTES 4
%assign RGBA8_SHIFT 2
%define RGBA8_ORDER PACKET(natural)

; SHADE - a function that shades the pixels of a span one packet after another.
;
;   Packets begin where the memory of `out` is aligned to one, so the first may begin before the span, and the last may
;   end past it: of those, only the span's own pixels are stored.
;
;   r10 first lane of the packet that is stored, r8 the lane past the last (beyond LANES where more packets follow)
%macro SHADE 6+
%define %%object %1     ; [in]       part of the function's name
%define %%output %2     ; [in]       part of the function's name
%define %%body %3       ; [in]       one of the bodies
%define %%format %4     ; [in]       F32X4 or RGBA8
%define %%constants %5  ; [in]       fields of the span record
                        ; %6  [in]   the macro that makes pixels of colours
FUNC NAME(%%object, %%output)
    CONSTANTS %%constants
    mov     r10d, ecx
    and     r10d, LANES * 4 - 1
    shr     r10d, %4_SHIFT              ; pixels since the memory was aligned
    VSPREAD v0, [rdi + ELEM * Span.j]
    VADD    v0, v0, [%4_ORDER]
    VSPREAD_INTEGER 1, r10
    VSUB    v0, v0, v1
    add     r8, r10
    imul    rax, r10, %4_BYTES
    sub     rcx, rax
align 16
.packet:
    BODY_ %+ %3
    %6
    cmp     r8, LANES
    jb      .part
    test    r10d, r10d
    jnz     .part
%ifidn %4, F32X4
    test    r9d, r9d
    jnz     .stream
%endif
    STORE_%4 rcx
.next:
    add     rcx, LANES * %4_BYTES
    VADD    v0, v0, [PACKET(step)]
    sub     r8, LANES
    ja      .packet
    UNCONSTANTS
    ret
%ifidn %4, F32X4
.stream:
    STREAM_F32X4 rcx
    jmp     .next
%endif
.part:
    mov     r11d, LANES
    cmp     r8, r11
    cmovb   r11, r8
    PART_%4
    xor     r10d, r10d
    jmp     .next
    END
%endmacro

; PART_F32X4, PART_RGBA8 - stores the pixels of the lanes from r10 up to, but without, r11 to rcx.
;
;   clobbers    rax, r10, r11, k1 or v1
%macro PART_F32X4 0
%if HAS_MASKS
    shl     r10d, 2                     ; four floats a pixel
    shl     r11d, 2
    LANE_MASK 64
%assign %%e 0
%rep 4
%assign %%w 4 + %%e
    kmovw   k1, eax
    vmovups [rcx + LANES * 4 * %%e] {k1}, w%[%%w]
    shr     rax, LANES
%assign %%e %%e + 1
%endrep
%else
    STORE_F32X4 SCRATCH
    COPY_PART F32X4
%endif
%endmacro
%macro PART_RGBA8 0
%if HAS_MASKS
    LANE_MASK 32
    kmovw   k1, eax
    vmovups [rcx] {k1}, w1
%else
    STORE_RGBA8 SCRATCH
    COPY_PART RGBA8
%endif
%endmacro

; LANE_MASK - rax = the bits from r10 up to, but without, r11, of at most as many bits as its parameter says.
;
;   clobbers    rax, r10
%macro LANE_MASK 1
%if %1 == 64
    mov     rax, -1
    bzhi    rax, rax, r11               ; a CPU with AVX-512 has BMI2
    shrx    rax, rax, r10
    shlx    rax, rax, r10
%else
    mov     eax, -1
    bzhi    eax, eax, r11d
    shrx    eax, eax, r10d
    shlx    eax, eax, r10d
%endif
%endmacro

; COPY_PART - the pixels of the lanes from r10 up to, but without, r11 from the scratch memory to rcx. r10 < r11.
;
;   clobbers    rax, r10, v1
%macro COPY_PART 1
%%pixel:
%ifidn %1, F32X4
    mov     rax, r10
    shl     rax, 4
%if HAS_VEX
    vmovaps xmm1, [SCRATCH + rax]
    vmovaps [rcx + rax], xmm1
%else
    movaps  xmm1, [SCRATCH + rax]
    movaps  [rcx + rax], xmm1
%endif
%else
    mov     eax, [SCRATCH + 4 * r10]
    mov     [rcx + 4 * r10], eax
%endif
    inc     r10
    cmp     r10, r11
    jb      %%pixel
%endmacro

; PLANES - a function that shades, of a span's pixels in the row of buffers, those that are the span's own.
%macro PLANES 4
%define %%object %1     ; [in]       part of the function's name
%define %%output %2     ; [in]       part of the function's name
%define %%body %3       ; [in]       one of the bodies
%define %%constants %4  ; [in]       fields of the span record
FUNC NAME(%%object, %%output)
    CONSTANTS %%constants
    VSPREAD v0, [rdi + ELEM * Span.j]
    VADD    v0, v0, [PACKET(natural)]
    lea     r10, [r9 + 2 * r9]
align 16
.packet:
    VLOAD   v14, [rcx]
    MASK_EQUAL v14, K(Span.id)
    BODY_ %+ %3
%assign %%i 1
%rep 3
%if %%i == 1
%define %%plane rcx + r9
%elif %%i == 2
%define %%plane rcx + 2 * r9
%else
%define %%plane rcx + r10
%endif
    VLOAD   v4, [%%plane]
    VSELECT v4, v%[%%i]
    VSTORE  [%%plane], v4
%assign %%i %%i + 1
%endrep
    VADD    v0, v0, [PACKET(step)]
    add     rcx, VBYTES
    sub     r8, LANES
    ja      .packet
    UNCONSTANTS
ENDFUNC
%endmacro

; DEPTH - a function that makes a span's pixels its own where nothing in the row of buffers is as near.
%macro DEPTH 3
%define %%object %1     ; [in]       part of the function's name
%define %%den %2        ; [in]       DEN_<den>
%define %%constants %3  ; [in]       fields of the span record
FUNC NAME(%%object, depth)
    CONSTANTS %%constants
    VSPREAD v0, [rdi + ELEM * Span.j]
    VADD    v0, v0, [PACKET(natural)]
    KLOAD   v7, Span.id
align 16
.packet:
    DEN_ %+ %2
    VMUL    v1, v1, K(Span.near)
    VLOAD   v2, [rsi + 4 * rcx]
    MASK_GREATER v1, v2                 ; the first of equals stays
    MASK_AND_LESS v0, K(Span.end), v3
    VSELECT v2, v1
    VSTORE  [rsi + 4 * rcx], v2
    VLOAD   v2, [rsi]
    VMOV    v3, v7
    VSELECT v2, v3
    VSTORE  [rsi], v2
    VADD    v0, v0, [PACKET(step)]
    add     rsi, VBYTES
    sub     rdx, LANES
    ja      .packet
    UNCONSTANTS
ENDFUNC
%endmacro

; EMIT - a function that writes a row of buffers out.
%macro EMIT 3+
%define %%output %1     ; [in]       part of the function's name
%define %%format %2     ; [in]       F32X4 or RGBA8
                        ; %3  [in]   the macro that makes pixels of colours
FUNC NAME(emit, %%output)
    mov     r8, rcx                     ; pixels
    mov     rcx, rdx                    ; out
    CONSTANTS 0
    lea     r9, [rsi + 2 * rsi]
.packet:
    VLOAD   v1, [rdi + rsi]
    VLOAD   v2, [rdi + 2 * rsi]
    VLOAD   v3, [rdi + r9]
    %3
    cmp     r8, LANES
    jb      .part
    STORE_NATURAL_%2 rcx
    add     rcx, LANES * %2_BYTES
    add     rdi, VBYTES
    sub     r8, LANES
    jnz     .packet
    UNCONSTANTS
    ret
.part:
    STORE_NATURAL_%2 SCRATCH
    xor     r10d, r10d
    mov     r11, r8
    COPY_PART %2
    UNCONSTANTS
ENDFUNC
%endmacro

%assign ESTIMATE 0
    SHADE   lit, f32x4, LIT, F32X4, 15, TURN_F32X4
    SHADE   outside, f32x4, OUTSIDE, F32X4, 19, TURN_F32X4
    SHADE   inside, f32x4, INSIDE, F32X4, 15, TURN_F32X4
    SHADE   triangle, f32x4, TRIANGLE, F32X4, 12, TURN_F32X4
    PLANES  outside, planes, OUTSIDE, 19
    PLANES  inside, planes, INSIDE, 15
    PLANES  triangle, planes, TRIANGLE, 12
    DEPTH   outside, OUTSIDE, 19
    DEPTH   inside, INSIDE, 15
    DEPTH   triangle, TRIANGLE, 12
    EMIT    f32x4, F32X4, TURN_F32X4
    EMIT    rgba8, RGBA8, PACK_RGBA8 1
%if ELEM == 4
%assign ESTIMATE 1
    SHADE   lit, f32x4_fast, LIT, F32X4, 15, TURN_F32X4
    SHADE   outside, f32x4_fast, OUTSIDE, F32X4, 19, TURN_F32X4
    SHADE   inside, f32x4_fast, INSIDE, F32X4, 15, TURN_F32X4
    SHADE   triangle, f32x4_fast, TRIANGLE, F32X4, 12, TURN_F32X4
    PLANES  outside, planes_fast, OUTSIDE, 19
    PLANES  inside, planes_fast, INSIDE, 15
    PLANES  triangle, planes_fast, TRIANGLE, 12
%endif
    SHADE   lit, rgba8, LIT, RGBA8, 15, PACK_RGBA8 0
    SHADE   grey, rgba8, GREY, RGBA8, 13, PACK_GREY
    SHADE   outside, rgba8, OUTSIDE, RGBA8, 19, PACK_RGBA8 1
    SHADE   inside, rgba8, INSIDE, RGBA8, 15, PACK_RGBA8 1
    SHADE   triangle, rgba8, TRIANGLE, RGBA8, 12, PACK_RGBA8 1

%unmacro LIGHTS 1
%unmacro BODY_LIT 0
%unmacro BODY_GREY 0
%unmacro BODY_OUTSIDE 0
%unmacro BODY_INSIDE 0
%unmacro BODY_TRIANGLE 0
%unmacro DEN_OUTSIDE 0
%unmacro DEN_INSIDE 0
%unmacro DEN_TRIANGLE 0
%unmacro SHADE 6+
%unmacro PART_F32X4 0
%unmacro PART_RGBA8 0
%unmacro LANE_MASK 1
%unmacro COPY_PART 1
%unmacro PLANES 4
%unmacro DEPTH 3
%unmacro EMIT 3+
