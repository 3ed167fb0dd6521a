; lit_rows.asm - the span of columns in each row that meet a sphere, and its constants for lit.asm: a row in each lane.
;
; This runs once per row, not per pixel, and so in f64, by the equations of the silhouette. With d = (x, y, f) and the
; terms of eq. 5 in units of the radius, D(x) = (d.c)^2 - k d.d = -m x^2 + 2 b x + c0 is positive between its two roots.
; b^2 + m c0 = k (g - across^2) does not cancel for far spheres, nor does the root of the larger magnitude; the other
; one is c0 divided by it. No operation is fused.
;
; Assembled once per ISA. The functions:
;
;   rayo_<isa>_single_lit_rows, rayo_<isa>_double_lit_rows
;                           unsafe extern "sysv64" fn(setup, first, count, rows)
;
;   setup       *const LitSetup, in f64
;   first       u64: the row of the picture that is row 0 of `rows`
;   count       u64, at least 1
;   rows        *mut LitRows, in f32 or f64; up to the next multiple of LANES rows are written
;
;   registers   rdi setup, rsi first, rdx rows left, rcx the rows' elements, v0 the rows' numbers
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written
;   equals      kernels::portable::rows::lit_rows, to the last bit

; ROW - stores a field of the rows. Clobbers v10.
%macro ROW 2
%define %%field %1      ; [in]       LitRows.<field>
%define %%v %2          ; [in]       number of a register
%if ROW_BYTES == 8
    VSTORE  [rcx + 8 * %%field], v%[%%v]
%else
    VMOV    v10, v%[%%v]
    NARROW  10
%if LANES == 2
    movlps  [rcx + 4 * %%field], x10
%else
    VEX(movups) [rcx + 4 * %%field], w10
%endif
%endif
%endmacro

; ROWS - a function that makes rows of elements of `bytes` bytes.
%macro ROWS 2
%define %%name %1       ; [in]       single or double
%define %%bytes %2      ; [in]       4 or 8
%assign ROW_BYTES %%bytes
%define S(field) K(LitSetup. %+ field)
FUNC ISA %+ _ %+ %%name %+ _lit_rows
    CONSTANTS LitSetup_size
    VSPREAD_INTEGER 0, rsi
    VADD    v0, v0, [PACKET(natural)]
.rows:
    VADD    v1, v0, [PACKET(halves)]
    VMUL    v1, v1, S(step)
    KLOAD   v2, LitSetup.half_height
    VSUB    v2, v2, v1
    VMOV    v1, v2                      ; y
    VMUL    v2, v1, v1
    VADD    v2, v2, S(zz)               ; g = y^2 + f^2
    VMUL    v4, v1, S(cz)
    KLOAD   v3, LitSetup.cyz
    VSUB    v3, v3, v4                  ; across = cy f - cz y
    VMUL    v3, v3, v3
    VSUB    v4, v2, v3
    VMUL    v4, v4, S(k)
    VSQRT   v4, v4                      ; root = sqrt(k (g - across^2)), NaN where the row misses the sphere
    VMUL    v5, v1, S(cy)
    VADD    v5, v5, S(czz)              ; h = cy y + cz f
    VMUL    v6, v5, S(cx)               ; b = cx h
    VMUL    v2, v2, S(nx)
    VSUB    v2, v2, v3                  ; c0 = (1 - cx^2) g - across^2
    VMOV    v3, v6
    VAND    v3, v3, [PACKET(sign)]
    VARITH  or, 1, v3, v3, v4
    VADD    v3, v3, v6                  ; q = b + root with the sign of b
    VDIV    v2, v2, v3
    MASK_EQUAL v3, [PACKET(zeros)]
    VZERO   v4
    VSELECT v2, v4                      ; p = c0 / q, or 0 where q = 0
    VDIV    v3, v3, S(m)                ; one root, q / m
    VZERO   v4
    VSUB    v4, v4, v2                  ; the other, -p
    VMIN    v2, v3, v4                  ; left
    VMAX    v4, v4, v3                  ; right
    VADD    v6, v2, v4
    VMUL    v6, v6, [PACKET(halves)]    ; the middle
    VMUL    v3, v6, S(cx)
    VADD    v3, v3, v5
    MASK_GREATER v3, [PACKET(zeros)]   ; in front of the camera
    VADD    v7, v2, S(half_width)
    VMUL    v7, v7, S(columns)
    VSUB    v7, v7, [PACKET(halves)]
    VROUND  v7, v7, UP
    VMAX    v7, v7, [PACKET(zeros)]
    VMIN    v7, v7, S(width)            ; start
    VADD    v8, v4, S(half_width)
    VMUL    v8, v8, S(columns)
    VSUB    v8, v8, [PACKET(halves)]
    VROUND  v8, v8, DOWN
    VADD    v8, v8, [PACKET(ones)]
    VMAX    v8, v8, [PACKET(zeros)]
    VMIN    v8, v8, S(width)            ; end
    MASK_KEEP v8
    ROW     LitRows.start, 7
    ROW     LitRows.end, 8
    VADD    v9, v7, v8
    VMUL    v9, v9, [PACKET(halves)]
    VROUND  v9, v9, DOWN                ; j counts from there
    VSUB    v7, v7, v9
    VSUB    v8, v8, v9
    ROW     LitRows.j, 7
    ROW     LitRows.stop, 8
    VADD    v9, v9, [PACKET(halves)]
    VMUL    v9, v9, S(step)
    VSUB    v9, v9, S(half_width)       ; x there
    VSUB    v6, v6, v9
    VMUL    v6, v6, S(columns)
    ROW     LitRows.m, 6
    VSUB    v4, v4, v2
    VMUL    v4, v4, [PACKET(halves)]
    VMUL    v4, v4, S(columns)
    VMUL    v4, v4, v4
    ROW     LitRows.a, 4
    VMUL    v3, v9, S(cx)
    VADD    v3, v3, v5
    VMUL    v3, v3, S(h)
    ROW     LitRows.h0, 3
    VMUL    v9, v9, S(vx)
    VMUL    v1, v1, S(vy)
    VADD    v9, v9, v1
    VADD    v9, v9, S(vzz)
    VMUL    v9, v9, S(q)
    ROW     LitRows.q0, 9
    VADD    v0, v0, [PACKET(step)]
    add     rcx, LANES * %%bytes
    sub     rdx, LANES
    ja      .rows
    UNCONSTANTS
ENDFUNC
%endmacro

; LIT_ROWS - defines the functions of this file.
%macro LIT_ROWS 0
    ROWS    single, 4
    ROWS    double, 8
%endmacro
