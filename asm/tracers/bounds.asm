; bounds.asm - which pixels each of many triangles can cover at all, LANES triangles in lockstep.
;
; unsafe extern "sysv64" fn(view: *const BoundsView, task: *const BoundsTask)
;
;   A ray passes between the edges of a triangle in front of the camera only if its pixel lies between the projected
;   vertices. These are found in f32, and the bounds opened by a margin above its rounding: a triangle of a fine mesh
;   that holds no pixel's centre is mostly found out here, and costs nothing from then on. One that reaches behind the
;   camera's plane gets the whole picture, and one all behind it nothing.
;
;   registers   rdi view, whose fields are the constants K; rsi task; rdx facets, rcx facets to go, r8 corners,
;               r9 columns, r10 rows, rax near, r11 those of the chunk
;   writes      columns and rows of count triangles, up to a multiple of CHUNK: the first, and past the last << 16; and
;               what their 1/t cannot exceed
;   requires    the CPUID features of the ISA; facets, count >= 1 of them

; FIRST_AND_PAST - w<f> = the first pixel and the one past the last << 16, of coordinates from v<f> to v<p>.
%macro FIRST_AND_PAST 3
%define %%f %1          ; [in/out]   number of a register
%define %%p %2          ; [clobbered] number of a register
%define %%side %3       ; [in]       field: how many pixels there are
    VADD    v%[%%f], v%[%%f], K(BoundsView.low)
    VADD    v%[%%p], v%[%%p], K(BoundsView.high)
    VMAX    v%[%%f], v%[%%f], [PACKET(zeros)]
    VMAX    v%[%%p], v%[%%p], [PACKET(zeros)]
    VMIN    v%[%%f], v%[%%f], K(BoundsView. %+ %%side)
    VMIN    v%[%%p], v%[%%p], K(BoundsView. %+ %%side)
    LEVELS  %%f
    LEVELS  %%p
    IOP     pslld, w%[%%p], w%[%%p], 16
    IOR     w%[%%f], w%[%%f], w%[%%p]
%endmacro

; PROJECT - d = x / z to_pixels, widened to the least and the greatest of three vertices.
%macro PROJECT 4
%define %%low %1        ; [out]      vreg
%define %%high %2       ; [out]      vreg
%define %%axis %3       ; [in]       x or y
%define %%t %4          ; [clobbered] vreg
    VMUL    %%low, v0, [r8 + Corners.a %+ %%axis]
    VMUL    %%high, v1, [r8 + Corners.b %+ %%axis]
    VMOV    %%t, %%low
    VMIN    %%low, %%low, %%high
    VMAX    %%high, %%high, %%t
    VMUL    %%t, v2, [r8 + Corners.c %+ %%axis]
    VMIN    %%low, %%low, %%t
    VMAX    %%high, %%high, %%t
%endmacro

; FACET_AT - r = the address of the facet number i from rdx on, or of the first one where only r11 are left.
%macro FACET_AT 2
%define %%i %1          ; [in]       1 to 3
%define %%r %2          ; [out]      general register
    lea     %%r, [rdx + Facet_size * %%i]
    cmp     r11, %%i
    cmovbe  %%r, rdx
%endmacro

FUNC ISA %+ _bounds
    push    rbx
    push    r12
    push    r13
    mov     rdx, [rsi + BoundsTask.facets]
    mov     r9, [rsi + BoundsTask.columns]
    mov     r10, [rsi + BoundsTask.rows]
    mov     rax, [rsi + BoundsTask.near]
    mov     rcx, [rsi + BoundsTask.count]
    CONSTANTS 10
.chunk:
    mov     r8, [rsi + BoundsTask.corners]
    mov     r11d, CHUNK
    cmp     rcx, r11
    cmovb   r11, rcx
    sub     rcx, r11
.turn:
    FACET_AT 1, rbx
    FACET_AT 2, r12
    FACET_AT 3, r13
    TURN_FACETS r8, rdx, rbx, r12, r13
    add     rdx, 4 * Facet_size
    add     r8, 16
    sub     r11, 4
    ja      .turn
    mov     r8, [rsi + BoundsTask.corners]
    mov     r11d, CHUNK / LANES
.packet:
    VLOAD   v0, [r8 + Corners.az]
    VLOAD   v1, [r8 + Corners.bz]
    VLOAD   v2, [r8 + Corners.cz]
    VMIN    v3, v0, v1
    VMIN    v3, v3, v2
    VMAX    v4, v0, v1
    VMAX    v4, v4, v2
    KLOAD   v5, BoundsView.to_pixels
    VDIV    v6, v5, v0
    VDIV    v7, v5, v1
    VDIV    v8, v5, v2
    VMOV    v0, v6
    VMOV    v1, v7
    VMOV    v2, v8
    PROJECT v5, v6, x, v9
    PROJECT v10, v7, y, v9
    VADD    v5, v5, K(BoundsView.column)
    VADD    v6, v6, K(BoundsView.column)
    KLOAD   v8, BoundsView.row
    VSUB    v8, v8, v7                  ; what is above comes first
    KLOAD   v9, BoundsView.row
    VSUB    v9, v9, v10
    FIRST_AND_PAST 5, 6, width
    FIRST_AND_PAST 8, 9, height
    MASK_GREATER v3, [PACKET(least)]    ; nearer ones could overflow
    KLOAD   v6, BoundsView.all_columns
    VSELECT v6, v5
    KLOAD   v9, BoundsView.all_rows
    VSELECT v9, v8
    KLOAD   v7, BoundsView.near
    VDIV    v7, v7, v3
    VMOV    v8, [PACKET(largest)]
    VSELECT v8, v7
    VSTORE  [rax], v8
    MASK_GREATER v4, [PACKET(zeros)]
    MASK_KEEP v6
    MASK_KEEP v9
    VSTORE  [r9], v6
    VSTORE  [r10], v9
    add     r8, VBYTES
    add     r9, VBYTES
    add     r10, VBYTES
    add     rax, VBYTES
    dec     r11d
    jnz     .packet
    test    rcx, rcx
    jnz     .chunk
    UNCONSTANTS
    pop     r13
    pop     r12
    pop     rbx
ENDFUNC

%unmacro FACET_AT 2
%unmacro FIRST_AND_PAST 3
%unmacro PROJECT 4
