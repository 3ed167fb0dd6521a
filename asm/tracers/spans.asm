; spans.asm - the packet tracers: LANES rays in lockstep along a span, the pixels of a row that one object covers.
;
; This is Algorithm 1 with its loops the other way round. For each row the driver knows, in f64 and closed form, which
; pixels each object covers (line 14), so no kernel asks again. Where an object is alone, its pixels are shaded at once
; (lines 18 to 21). Where spans overlap, `depth` finds the nearest object of each pixel (lines 12 to 17) in a row of
; buffers that stays in cache, then `planes` shades each object's own pixels there, and `emit` writes the row out.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_<object>_<output>      unsafe extern "sysv64" fn(span, lits, lit_count, out, pixels, streaming), of a
;                                   sphere from outside or a triangle
;   rayo_<p>_<object>_planes        unsafe extern "sysv64" fn(span, lits, lit_count, row, pixels, stride)
;   rayo_<p>_<object>_normals       unsafe extern "sysv64" fn(span, lits, lit_count, row, pixels, stride)
;   rayo_<p>_<object>_depth         unsafe extern "sysv64" fn(span, row, pixels, stride)
;   rayo_<p>_emit_<output>          unsafe extern "sysv64" fn(row, stride, out, pixels)
;
;   <object>    outside     a sphere from outside
;               near        a sphere from outside at less than sqrt 2 radii, such as a ground
;               inside      a sphere from inside
;               triangle    a triangle
;   <output>    f32x4       linear red, green, blue, 0
;               rgba8       levels of red, green, blue, and 255
;   ..._fast    with estimates in place of roots and divisions, where only the shade depends on them. 8 bits in f32
;               have nothing else, and 8 bits in f64 have them, refined to the end, where AVX-512 has them.
;
;   ..._normals as planes, with a sphere's unit normal in place of its colour: for measuring errors
;
;   span        *const of the object's span record; its fields are the constants K
;   lits        *const ObjectLight, lit_count of them
;   out         *mut of the first pixel; pixels >= 1 of them are written and nothing else
;   streaming   u64: not 0 for stores that go past the cache
;   row         *mut element: five planes of `stride` bytes each: who (0 for nobody, else the span's id), red, green,
;               blue, 1/t. It points to the span's first pixel, and up to LANES - 1 elements past its last are read and
;               written back unchanged (depth) or in pixels that are the span's own (planes)
;
;   registers   rdi span, rsi lits, rdx lit_count, rcx out or row, r8 pixels, r9 streaming or stride
;               v0 j, v1 v2 v3 the colour, the others as the bodies say
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written
;   equals      reference::packet, to the last bit where there is no estimate

; LIGHTS - the colour in v1, v2, v3 of points o in v4, v5, v6 under all lights.
%macro LIGHTS 2
%define %%seen %1       ; [in]       FROM_CENTRE, ON_PLANE or FROM_CAMERA
%define %%centre %2     ; [in]       FROM_CAMERA: number of the constant c.x
    VZERO   v1
    VZERO   v2
    VZERO   v3
    mov     r11, rsi
    mov     rax, rdx
    test    rax, rax
    jz      %%dark
%%light:
    LAMBERT3 v1, v2, v3, v4, v5, v6, r11, %%seen, v7, v8, v9, v10, v11, v12, %%centre
    add     r11, ELEM * ObjectLight_size
    dec     rax
    jnz     %%light
%%dark:
%endmacro

; BODY_OUTSIDE - the colour in v1, v2, v3 of the pixels j in v0. All bodies leave v0, v14 and v15 alone.
%macro BODY_OUTSIDE 0
    SPHERE_OUTSIDE v4, v5, v6, v0, v7, v8, v9, v10
    LIGHTS  FROM_CENTRE, 0
%endmacro

; BODY_OUTSIDE_NORMAL - the unit normal in v1, v2, v3 of the pixels j in v0, as BODY_OUTSIDE has it.
%macro BODY_OUTSIDE_NORMAL 0
    SPHERE_OUTSIDE v1, v2, v3, v0, v7, v8, v9, v10
%endmacro

; BODY_CAMERA - the colour in v1, v2, v3 of the pixels j in v0 of a sphere whose points are seen from the camera.
%macro BODY_CAMERA 2
%define %%object %1     ; [in]       SPHERE_<object>
%define %%record %2     ; [in]       its span record
    SPHERE_ %+ %%object v4, v5, v6, v0, v7, v8, v9
    LIGHTS  FROM_CAMERA, %[%%record].cx
%endmacro
%define BODY_NEAR BODY_CAMERA NEAR, NearSpan
%define BODY_INSIDE BODY_CAMERA INSIDE, InsideSpan

; BODY_CAMERA_NORMAL - the unit normal in v1, v2, v3 of the pixels j in v0, as LAMBERT3 has it.
%macro BODY_CAMERA_NORMAL 2
%define %%object %1     ; [in]       SPHERE_<object>
%define %%record %2     ; [in]       its span record
    SPHERE_ %+ %%object v1, v2, v3, v0, v7, v8, v9
    SUB3    v1, v2, v3, v1, v2, v3, K(%[%%record].cx), K(%[%%record].cy), K(%[%%record].cz)
%endmacro
%define BODY_NEAR_NORMAL BODY_CAMERA_NORMAL NEAR, NearSpan
%define BODY_INSIDE_NORMAL BODY_CAMERA_NORMAL INSIDE, InsideSpan

; BODY_TRIANGLE - the colour in v1, v2, v3 of the pixels j in v0.
%macro BODY_TRIANGLE 0
    TRIANGLE_PLANE v4, v5, v6, v0, v7, v8
    LIGHTS  ON_PLANE, 0
%endmacro

; DEN_OUTSIDE - v1 = 1/t of the pixels j in v0, which is what depth compares.
%macro DEN_OUTSIDE 0
    SPHERE_DEN v1, v0, v2, v3
%endmacro

; DEN_NEAR - v1 = 1/t of the pixels j in v0.
%macro DEN_NEAR 0
    DEN_OUTSIDE
%endmacro

; DEN_INSIDE - v1 = 1/t of the pixels j in v0.
%macro DEN_INSIDE 0
    SPHERE_FAR_WALL v2, v3, v0, v4, v5, v6
    RECIPROCAL v1, v2
%endmacro

; DEN_TRIANGLE - v1 = 1/t of the pixels j in v0.
%macro DEN_TRIANGLE 0
    VAFFINE v1, v0, TriangleSpan.w1, TriangleSpan.w0
%endmacro

; PIXELS_F32X4 - from colours in v1, v2, v3 to pixels in w4 and up.
%macro PIXELS_F32X4 0
    TURN_F32X4 1, 2, 3, 4, 8, 9
%endmacro

; PIXELS_RGBA8 - from colours in v1, v2, v3 to pixels in w1, none brighter than white.
%macro PIXELS_RGBA8 0
    PACK_RGBA8 1, 2, 3, 1
%endmacro

; SHADE - a function that shades the pixels of a span one packet after another.
;
;   Packets begin where the memory of `out` is aligned to a register of pixels, which one in every so many pixels is,
;   whatever their bytes. So the first packet may begin before the span, and the last may end past it: of those, only
;   the span's own pixels are stored.
;
;   r10 first lane of the packet that is stored, r8 the lane past the last (beyond LANES where more packets follow)
%macro SHADE 5
%define %%object %1     ; [in]       part of the function's name
%define %%output %2     ; [in]       part of the function's name
%define %%body %3       ; [in]       BODY_<body>
%define %%format %4     ; [in]       F32X4 or RGBA8
%define %%constants %5  ; [in]       fields of the span record
FUNC NAME(%%object, %%output)
    CONSTANTS %%constants
    PIXELS_SINCE %%format, r10, rcx, %[%%format]_PERIOD
    VSPREAD v0, [rdi + ELEM * Span.j]
    VADD    v0, v0, [%%format %+ _ORDER]
    VSPREAD_INTEGER 1, r10
    VSUB    v0, v0, v1
    add     r8, r10
    imul    rax, r10, %%format %+ _BYTES
    sub     rcx, rax
align 16
.packet:
    BODY_ %+ %%body
    PIXELS_ %+ %%format
    cmp     r8, LANES
    jb      .part
    test    r10d, r10d
    jnz     .part
    test    r9d, r9d
    jnz     .stream
    STORE_ %+ %%format rcx, %[%%format]_FIRST, movups
.next:
    add     rcx, LANES * %%format %+ _BYTES
    VADD    v0, v0, [PACKET(step)]
    sub     r8, LANES
    ja      .packet
    UNCONSTANTS
    ret
.stream:
    STORE_ %+ %%format rcx, %[%%format]_FIRST, movntps
    jmp     .next
.part:
    mov     r11d, LANES
    cmp     r8, r11
    cmovb   r11, r8
    PART_ %+ %%format rcx, %[%%format]_FIRST, r10, r11, rax, k1, 3
    xor     r10d, r10d
    jmp     .next
    END
%endmacro

; PLANES - a function that shades, of a span's pixels in the row of buffers, those that are the span's own.
%macro PLANES 4
%define %%object %1     ; [in]       part of the function's name
%define %%output %2     ; [in]       part of the function's name
%define %%body %3       ; [in]       BODY_<body>
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
    BODY_ %+ %%body
    STORE_OWN rcx, r9, r10, v1, v2, v3, v4
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
    DEN_ %+ %%den
    VMUL    v1, v1, K(Span.depth)
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
%macro EMIT 2
%define %%output %1     ; [in]       part of the function's name
%define %%format %2     ; [in]       F32X4 or RGBA8
FUNC NAME(emit, %%output)
    mov     r8, rcx                     ; pixels
    mov     rcx, rdx                    ; out
    CONSTANTS 0
    lea     r9, [rsi + 2 * rsi]
.packet:
    VLOAD   v1, [rdi + rsi]
    VLOAD   v2, [rdi + 2 * rsi]
    VLOAD   v3, [rdi + r9]
    PIXELS_ %+ %%format
    cmp     r8, LANES
    jb      .part
    STORE_NATURAL %%format, rcx
    add     rcx, LANES * %%format %+ _BYTES
    add     rdi, VBYTES
    sub     r8, LANES
    jnz     .packet
    UNCONSTANTS
    ret
.part:
    STORE_NATURAL %%format, SCRATCH
    xor     r10d, r10d
    COPY_PART %%format, rcx, r10, r8, rax, 1
    UNCONSTANTS
ENDFUNC
%endmacro

; STORE_NATURAL - all pixels of a packet whose lanes are in the natural order.
%macro STORE_NATURAL 2
%define %%format %1     ; [in]       F32X4 or RGBA8
%define %%m %2          ; [in]       address
%ifidn %%format, F32X4
    STORE_NATURAL_F32X4 %%m, F32X4_FIRST
%else
    STORE_ %+ %%format %%m, %[%%format]_FIRST, movups
%endif
%endmacro

; SHADES - the functions that shade spans of the usual objects to one output; the others go by way of a row of buffers.
%macro SHADES 2
%define %%output %1     ; [in]       part of the functions' names
%define %%format %2     ; [in]       F32X4 or RGBA8
    SHADE   outside, %%output, OUTSIDE, %%format, 19
    SHADE   triangle, %%output, TRIANGLE, %%format, 12
%endmacro

; ALL_PLANES - the functions that shade each object's pixels in a row of buffers.
%macro ALL_PLANES 1
%define %%output %1     ; [in]       part of the functions' names
    PLANES  outside, %%output, OUTSIDE, 19
    PLANES  near, %%output, NEAR, 17
    PLANES  inside, %%output, INSIDE, 15
    PLANES  triangle, %%output, TRIANGLE, 12
%endmacro

; SPANS - the functions of this file, for one element type.
%macro SPANS 0
%assign ESTIMATE 0
    SHADES  f32x4, F32X4
    ALL_PLANES planes
    DEPTH   outside, OUTSIDE, 19
    DEPTH   near, NEAR, 17
    DEPTH   inside, INSIDE, 15
    DEPTH   triangle, TRIANGLE, 12
    EMIT    f32x4, F32X4
    EMIT    rgba8, RGBA8
    PLANES  outside, normals, OUTSIDE_NORMAL, 19
    PLANES  near, normals, NEAR_NORMAL, 17
    PLANES  inside, normals, INSIDE_NORMAL, 15
%if ELEM == 4
%assign ESTIMATE 1
    SHADES  f32x4_fast, F32X4
    ALL_PLANES planes_fast
%endif
%assign ESTIMATE ELEM == 4
    SHADES  rgba8, RGBA8
%endmacro
