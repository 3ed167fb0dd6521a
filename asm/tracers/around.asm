; around.asm - the nearest wall of a sphere around the camera or beside it, at all pixels of a tile, in f64.
;
; A quadratic over a tile is not accurate enough for such a sphere: its silhouette is no ellipse, and D cancels next to
; a wall. With a = d.d, h = d.c and k = c.c - r^2 the roots of eq. 5 are k/q and q/a, where q = h + sqrt(D) with the
; sign of h, by the operations of reference::geometry: D = h^2 - k a for a near sphere, D = r^2 a - |c x d|^2 for one
; that is far for its size. The result is their inverse: the greater of q/k and a/q, and 0 where neither is positive or
; both are infinite.
;
; Assembled once per ISA, in the pass for f64. The functions:
;
;   rayo_<isa>_single_around, rayo_<isa>_double_around      unsafe extern "sysv64" fn(sphere, near, column, row)
;
;   sphere      *const AroundSphere, in f64
;   near        *mut of a tile's 1/t in f32 or f64, in blocks of a register each
;   column, row u64: of the tile's first pixel in the picture
;
;   registers   rdi sphere, rsi near, edx blocks left in a row, ecx rows of blocks left; v0 the columns and v10 the rows
;               of pixels' centres in the picture, number + 1/2; v2 and v1 those of the first block of a row
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written
;   equals      kernels::portable::spheres::around

; EACH_PIXEL - begins a loop over the pixels of a tile in registers of f64; a block of elements is PARTS registers. v0
;              and v10 are the columns and the rows of pixels' centres in the picture. Clobbers v1, v2, rcx, rdx, which
;              hold where the loop is. Used by points.asm too.
%macro EACH_PIXEL 1
%define %%bytes %1      ; [in]       4 or 8
%assign PARTS 8 / %%bytes
%if LANES == 2
%assign COLUMNS_OF_BLOCK 2 * PARTS
%assign ROWS_OF_BLOCK 1
%else
%assign COLUMNS_OF_BLOCK 4
%assign ROWS_OF_BLOCK LANES / 4 * PARTS
%endif
    VSPREAD_INTEGER 1, rcx
    VADD    v1, v1, [PACKET(block_y)]
    VADD    v1, v1, [PACKET(halves)]
    VSPREAD_INTEGER 2, rdx
    VADD    v2, v2, [PACKET(block_x)]
    VADD    v2, v2, [PACKET(halves)]
    mov     ecx, TILE_HEIGHT / ROWS_OF_BLOCK
.row:
    VMOV    v0, v2
    mov     edx, TILE_WIDTH / COLUMNS_OF_BLOCK
align 16
.block:
    VMOV    v10, v1
%endmacro

; NEXT_PART - goes on to the next register of a block.
%macro NEXT_PART 0
%if LANES == 2
    VADD    v0, v0, [PACKET(block_step)]
%else
%rep LANES / 4
    VADD    v10, v10, [PACKET(ones)]
%endrep
%endif
%endmacro

; NEXT_PIXELS - ends the loop that EACH_PIXEL begins.
%macro NEXT_PIXELS 0
%if LANES > 2
    VADD    v0, v0, [PACKET(block_step)]
%endif
    dec     edx
    jnz     .block
%rep ROWS_OF_BLOCK
    VADD    v1, v1, [PACKET(ones)]
%endrep
    dec     ecx
    jnz     .row
%endmacro

; AROUND - a function that writes elements of `out` bytes; see EACH_PIXEL.
%macro AROUND 2
%define %%precision %1  ; [in]       part of the function's name
%define %%out %2        ; [in]       4 or 8
FUNC ISA %+ _ %+ %%precision %+ _around
    CONSTANTS AroundSphere_size
    EACH_PIXEL %%out
%assign %%part 0
%rep PARTS
    VMUL    v3, v0, K(AroundSphere.step)
    VSUB    v3, v3, K(AroundSphere.half_width)      ; the ray
    VMUL    v5, v10, K(AroundSphere.step)
    KLOAD   v4, AroundSphere.half_height
    VSUB    v4, v4, v5
    VMUL    v5, v3, v3
    VMUL    v6, v4, v4
    VADD    v5, v5, v6
    VADD    v5, v5, K(AroundSphere.square)          ; a
    VMUL    v6, v3, K(AroundSphere.cx)
    VMUL    v7, v4, K(AroundSphere.cy)
    VADD    v6, v6, v7
    VADD    v6, v6, K(AroundSphere.along)           ; h
    cmp     qword [rdi + 8 * AroundSphere.far], 0
    jne     .far%[%%part]
    VMUL    v7, v6, v6
    VMUL    v8, v5, K(AroundSphere.k)
    VSUB    v7, v7, v8
    jmp     .discriminant%[%%part]
.far%[%%part]:
    VMUL    v8, v4, K(AroundSphere.cz)
    KLOAD   v9, AroundSphere.cy_focal
    VSUB    v9, v9, v8
    VMUL    v9, v9, v9
    VMUL    v8, v3, K(AroundSphere.cz)
    VSUB    v8, v8, K(AroundSphere.cx_focal)
    VMUL    v8, v8, v8
    VADD    v9, v9, v8
    VMUL    v8, v4, K(AroundSphere.cx)
    VMUL    v7, v3, K(AroundSphere.cy)
    VSUB    v8, v8, v7
    VMUL    v8, v8, v8
    VADD    v9, v9, v8
    VMUL    v7, v5, K(AroundSphere.r2)
    VSUB    v7, v7, v9
.discriminant%[%%part]:
    VSQRT   v7, v7
    VSIGN   v7, v6, v8
    VADD    v6, v6, v7                  ; q
    VMUL    v7, v6, K(AroundSphere.over_k)
    VMAX    v7, v7, [PACKET(zeros)]
    VMUL    v5, v5, K(AroundSphere.scale)
    VDIV    v5, v5, v6
    VMAX    v5, v5, [PACKET(zeros)]
    VMOV    v6, [PACKET(infinite)]
    MASK_GREATER v6, v5
    MASK_KEEP v5
    VMAX    v7, v7, v5
%if %%out == 8
    VSTORE  [rsi], v7
%else
    NARROW  7
    STORE_NUMBERS rsi, 7
%endif
    add     rsi, %%out * LANES
%assign %%part %%part + 1
    NEXT_PART
%endrep
    NEXT_PIXELS
    UNCONSTANTS
ENDFUNC
%endmacro

; AROUNDS - the kernels for spheres around the camera, in f32 (`single`) and in f64 (`double`).
%macro AROUNDS 0
    AROUND  single, 4
    AROUND  double, 8
%endmacro
