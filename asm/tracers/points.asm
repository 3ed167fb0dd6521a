; points.asm - the points that are visible at the pixels of a tile, in f64: from these, shadows are tested.
;
; The tile holds 1/t of the nearest objects, but only as exactly as shading needs it. Shadows are tested at the point
; itself, which is computed from the object's equation: 1/t = h + sqrt D over k for a sphere seen from outside, eq. 5,
; and
; n . d / (v1 . n) for a triangle, eq. 9, of which PointObject makes one formula. Products and sums are rounded
; separately, so that all ISAs have the same points. Where no pixel of a register has an object that a light may reach,
; the points are no numbers.
;
; Assembled once per ISA, in the pass for f64. The functions:
;
;   rayo_<isa>_single_points, rayo_<isa>_double_points
;       unsafe extern "sysv64" fn(view, who, column, row, objects, points)
;
;   view        *const PointView
;   who         *const of a tile's ids in f32 or f64, in blocks of a register each
;   column, row u64: of the tile's first pixel in the picture
;   objects     *const PointObject, by id
;   points      *mut TilePoints
;
;   registers   rdi view, rsi who, r8 objects, r10 their second halves, r9 points, r11 whose they are, edx blocks left
;               in a row, ecx rows of blocks left; v0 the columns and v10 the rows of pixels' centres in the picture,
;               number + 1/2; v2 and v1 those of the first block of a row; v3 v4 v5 the vector c, v12 v13 the ray,
;               v15 h, v6 D
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written, ids below the objects'
;   equals      kernels::portable::shadows::points

; POINTS - a function that reads ids of `in` bytes; see EACH_PIXEL.
%macro POINTS 2
%define %%precision %1  ; [in]       part of the function's name
%define %%in %2         ; [in]       4 or 8
FUNC ISA %+ _ %+ %%precision %+ _points
    CONSTANTS PointView_size
    lea     r10, [r8 + 4 * ELEM]
    lea     r11, [r9 + TilePoints.own]
    EACH_PIXEL %%in
%assign %%part 0
%rep PARTS
%if %%in == 4
    WIDEN   v6, [rsi]
%else
    VLOAD   v6, [rsi]
%endif
    VSPREAD v7, x6
    MASK_EQUAL v7, v6
    MASK_BITS eax
    LEVELS  6
    IOP     pslld, w6, w6, ilog2e(ELEM * PointObject_size)
    cmp     eax, (1 << LANES) - 1
    jne     .different%[%%part]
    VEX(movd) eax, x6
    VSPREAD v3, [r8 + rax + ELEM * PointObject.x]
    VSPREAD v4, [r8 + rax + ELEM * PointObject.y]
    VSPREAD v5, [r8 + rax + ELEM * PointObject.z]
    VSPREAD v6, [r8 + rax + ELEM * PointObject.a]
    VSPREAD v7, [r8 + rax + ELEM * PointObject.b]
    VSPREAD v8, [r8 + rax + ELEM * PointObject.e]
    VSPREAD v9, [r8 + rax + ELEM * PointObject.w]
    VSPREAD v11, [r8 + rax + ELEM * PointObject.own]
    jmp     .loaded%[%%part]
.different%[%%part]:
    STORE_NUMBERS SCRATCH, 6
    GATHER4 3, 4, 5, 6, 7, 8, 9, r8, SCRATCH, ax
    GATHER4 7, 8, 9, 11, 12, 13, 14, r10, SCRATCH, ax
.loaded%[%%part]:
    MASK_NOT_LESS v11, [PACKET(zeros)]
    MASK_BITS eax
    NARROW  11
    STORE_NUMBERS r11, 11
    VMOV    v12, [PACKET(no_number)]
    VMOV    v13, v12
    VMOV    v15, v12
    test    eax, eax
    jz      .nowhere%[%%part]
    VMUL    v12, v0, K(PointView.step)
    VSUB    v12, v12, K(PointView.half_width)       ; the ray
    VMUL    v11, v10, K(PointView.step)
    KLOAD   v13, PointView.half_height
    VSUB    v13, v13, v11
    VADD    v14, v7, v8
    MASK_GREATER v14, [PACKET(zeros)]
    MASK_BITS eax
    KLOAD   v15, PointView.focal
    VMUL    v15, v15, v5
    VMUL    v14, v3, v12
    VMUL    v11, v4, v13
    VADD    v14, v14, v11
    VADD    v15, v15, v14                           ; h
    test    eax, eax
    jz      .add%[%%part]                           ; triangles alone: D is 0, as a
    VMUL    v14, v12, v12
    VMUL    v11, v13, v13
    VADD    v14, v14, v11
    KLOAD   v11, PointView.focal
    VMUL    v11, v11, v11
    VADD    v14, v14, v11
    VMUL    v6, v6, v14                             ; a d.d
    VMUL    v7, v7, v15
    VMUL    v7, v7, v15
    VADD    v6, v6, v7
    VMUL    v7, v4, K(PointView.focal)
    VMUL    v11, v5, v13
    VSUB    v7, v7, v11
    VMUL    v14, v7, v7
    VMUL    v7, v5, v12
    VMUL    v11, v3, K(PointView.focal)
    VSUB    v7, v7, v11
    VMUL    v7, v7, v7
    VADD    v14, v14, v7
    VMUL    v7, v3, v13
    VMUL    v11, v4, v12
    VSUB    v7, v7, v11
    VMUL    v7, v7, v7
    VADD    v14, v14, v7                            ; |c x d|^2
    VMUL    v8, v8, v14
    VSUB    v6, v6, v8
    VMAX    v6, v6, [PACKET(zeros)]                 ; D
    VSQRT   v6, v6
.add%[%%part]:
    VADD    v15, v15, v6
    VMUL    v15, v15, v9                            ; 1/t
    VMOV    v6, [PACKET(ones)]
    VDIV    v6, v6, v15
    VMUL    v12, v12, v6
    VMUL    v13, v13, v6
    VMUL    v6, v6, K(PointView.focal)
    VMOV    v15, v6
.nowhere%[%%part]:
    VSTORE  [r9 + TilePoints.x], v12
    VSTORE  [r9 + TilePoints.y], v13
    VSTORE  [r9 + TilePoints.z], v15
    add     rsi, %%in * LANES
    add     r9, VBYTES
    add     r11, 4 * LANES
%assign %%part %%part + 1
    NEXT_PART
%endrep
    NEXT_PIXELS
    UNCONSTANTS
ENDFUNC
%endmacro

; POINTS_OF_TILES - defines the functions of this file.
%macro POINTS_OF_TILES 0
    POINTS  single, 4
    POINTS  double, 8
%endmacro
