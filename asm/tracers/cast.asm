; cast.asm - triangles as a light sees them: their bounds on a side of its cube, and their edges there.
;
; unsafe extern "sysv64" fn(view: *const LightSideView, task: *const CastTask)
;
;   rayo_<isa>_cast
;
;   Everything is in the axes of the side: across, down and depth. A corner c is seen at (c - L) / depth, counted in
;   cells. The edge from v to w is (w - v) x (P - v) = a x + b y + c, times the sign of the area, as in eq. 10, and c is
;   greater by all that corners, P and the function in f32 may be rounded by: 8 slack and 16 roundings of the greatest
;   coordinate, at least 4096, times the greatest difference of corners.
;
;   registers   rdi view, whose fields are the constants K; rsi task; r9 edges, r10 bounds of a block, r11 what is left
;               of it; rbx, rcx, rdx coordinates of corners, across, down and depth
;   writes      edges and bounds of all triangles whose places are in the bounds; the bounds of one that crosses the
;               plane of depth 0 meet everything, those of one beyond it nothing
;   requires    the CPUID features of the ISA; bounds whose places are those of triangles or of faces with valid
;               vertices, 4 readable bytes after these
;   equals      kernels::portable::shadows::cast, to the last bit

%assign CORNER_BYTES TriangleArrays_size / 5    ; three coordinates of a chunk
%assign AXIS_BYTES TriangleArrays_size / 15

; PLACED_OBJECT - r = the address of the object whose place is the i-th from r8 on.
;
;   instructions   4
%macro PLACED_OBJECT 4
%define %%i %1          ; [in]       0 to 3
%define %%r %2          ; [out]      general register
%define %%e %3          ; [clobbered] its 32 bits
%define %%bytes %4      ; [in]       of an object
    mov     %%e, [r8 + 4 * %%i]
    sub     %%e, [rsi + CastTask.first_own]
    imul    %%r, %%r, %%bytes
    add     %%r, [rsi + CastTask.objects]
%endmacro

; TRANSPOSE_PLACED - transposes the objects of the block of bounds at r10. Clobbers rax, rbx, rcx, rdx, r8, r12 to r15
;                    and v0 to v4.
%macro TRANSPOSE_PLACED 1
%define %%bytes %1      ; [in]       of an object: a face, or a triangle
    lea     r8, [r10 + CasterBounds.own]
    mov     r15, [rsi + CastTask.arrays]
    mov     edx, 16 / 4
%%four:
    PLACED_OBJECT 0, rbx, ebx, %%bytes
    PLACED_OBJECT 1, rcx, ecx, %%bytes
    PLACED_OBJECT 2, r12, r12d, %%bytes
    PLACED_OBJECT 3, r13, r13d, %%bytes
%if %%bytes == FACE_BYTES
    mov     r14, [rsi + CastTask.vertices]
    TRANSPOSE_FACES r15, rbx, rcx, r12, r13, r14, rax
%else
    TRANSPOSE_TRIANGLES r15, rbx, rcx, r12, r13
%endif
    add     r8, 16
    add     r15, 16
    dec     edx
    jnz     %%four
%endmacro

; STORE_SELECTED - replaces v<other> by v<n> in the lanes of the mask, and stores it as f32.
;
;   instructions   sse41 6 (select, copy, narrow, store)   avx2, avx512 4
%macro STORE_SELECTED 4
%define %%m %1          ; [out]      address
%define %%n %2          ; [in]       number of a register; clobbered without VEX
%define %%other %3      ; [in/out]   number of a register
%define %%t %4          ; [clobbered] number of a register
    VSELECT v%[%%other], v%[%%n]
    VMOV    v%[%%t], v%[%%other]
    NARROW  %%t
    STORE_NUMBERS %%m, %%t
%endmacro

; PLACE_IN_CELLS - v<n> = v<n> over depth, counted in cells, where 1 over that is in v12.
;
;   instructions   3
;   equals        kernels::portable::shadows::SeenTriangles::new, a part of it
%macro PLACE_IN_CELLS 2
%define %%n %1          ; [in/out]   number of a register
%define %%axis %2       ; [in]       x or y
    VMUL    v%[%%n], v%[%%n], v12
    VSUB    v%[%%n], v%[%%n], K(LightSideView.low_%+ %%axis)
    VMUL    v%[%%n], v%[%%n], K(LightSideView.scale_%+ %%axis)
%endmacro

; LEAST_AND_MOST - least and most of three. Clobbers nothing else.
;
;   instructions   4   sse41 6
;   equals        kernels::portable::shadows::least_and_most
%macro LEAST_AND_MOST 5
%define %%least %1      ; [out]      vreg
%define %%most %2       ; [out]      vreg
%define %%a %3          ; [in]       vreg
%define %%b %4          ; [in]       vreg
%define %%c %5          ; [in]       vreg
    VMIN    %%least, %%a, %%b
    VMIN    %%least, %%least, %%c
    VMAX    %%most, %%a, %%b
    VMAX    %%most, %%most, %%c
%endmacro

; BOUNDS_OF_CASTERS - stores the bounds of a packet of triangles. v0 to v5 = its corners in cells, x and y in turn, v8
;                     v9 v10 = the ends x, past_x and y as stored, v11 = the rounding of edges, v6 = the least depth.
;                     Clobbers v7 and v12 to v14.
;
;   equals        kernels::portable::shadows::SeenTriangles::new
%macro BOUNDS_OF_CASTERS 0
%assign %%n 0
%rep 3
%assign %%x 2 * %%n
%assign %%y 2 * %%n + 1
    WIDEN   v%[%%x], [rbx + CORNER_BYTES * %%n]
    WIDEN   v%[%%y], [rcx + CORNER_BYTES * %%n]
    WIDEN   v14, [rdx + CORNER_BYTES * %%n]
    VSUB    v%[%%x], v%[%%x], K(LightSideView.across)
    VSUB    v%[%%y], v%[%%y], K(LightSideView.down)
    VSUB    v14, v14, K(LightSideView.depth)
    VMUL    v14, v14, K(LightSideView.sign)
    VMOV    v12, [PACKET(ones)]
    VDIV    v12, v12, v14
    PLACE_IN_CELLS %%x, x
    PLACE_IN_CELLS %%y, y
%if %%n == 0
    VMOV    v6, v14
    VMOV    v7, v14
%else
    VMIN    v6, v6, v14
    VMAX    v7, v7, v14
%endif
%assign %%n %%n + 1
%endrep
    LEAST_AND_MOST v8, v9, v0, v2, v4
    LEAST_AND_MOST v10, v11, v1, v3, v5
    VSUB    v12, v9, v8
    VSUB    v13, v11, v10
    VMAX    v12, v12, v13               ; the greater extent
    VABS    v13, v8
    VABS    v14, v9
    VMAX    v13, v13, v14
    VABS    v14, v10
    VMAX    v13, v13, v14
    VABS    v14, v11
    VMAX    v13, v13, v14
    VMAX    v13, v13, [PACKET(cells)]   ; the greatest coordinate
    VMUL    v13, v13, [PACKET(rounded)]
    KLOAD   v14, LightSideView.slack
    VSUB    v8, v8, v14
    VADD    v9, v9, v14
    VSUB    v10, v10, v14
    VADD    v11, v11, v14
    VADD    v14, v14, v14
    VADD    v14, v14, v14
    VADD    v14, v14, v14
    VADD    v13, v13, v14
    VMUL    v13, v13, v12
    VADD    v13, v13, [PACKET(least)]
    VXOR    v8, v8, [PACKET(sign)]
    VXOR    v10, v10, [PACKET(sign)]
    MASK_GREATER v6, [PACKET(zeros)]    ; in front of the light
    VMUL    v12, v6, [PACKET(depth_slack)]
    VXOR    v12, v12, [PACKET(sign)]
    VZERO   v14
    STORE_SELECTED r10 + CasterBounds.depth, 12, 14, 12
    VMOV    v14, [PACKET(infinite)]
    STORE_SELECTED r10 + CasterBounds.past_y, 11, 14, 12
    VMOV    v11, v13
    VMOV    v14, [PACKET(infinite)]
    STORE_SELECTED r10 + CasterBounds.past_x, 9, 14, 12
    VMOV    v9, v14
    VMOV    v14, [PACKET(infinite)]
    STORE_SELECTED r10 + CasterBounds.y, 10, 14, 12
    VMOV    v10, v14
    VMOV    v14, [PACKET(infinite)]
    VSELECT v14, v8
    VMOV    v8, [PACKET(no_number)]
    MASK_GREATER v7, [PACKET(zeros)]
    STORE_SELECTED r10 + CasterBounds.x, 14, 8, 12
%endmacro

; EDGE_OF_TRIANGLE - stores the edge from corner v to w, with the sign in v7 and the rounding in v11; where the mask is
;                    not, an end of the bounds. Clobbers v6, v12 to v14.
;
;   equals        kernels::portable::shadows::SeenTriangles::edges, a third of it
%macro EDGE_OF_TRIANGLE 6
%define %%n %1          ; [in]       1, 2 or 3
%define %%v %2          ; [in]       0, 1 or 2
%define %%w %3          ; [in]       0, 1 or 2
%define %%a %4          ; [in]       elsewhere: a constant of packets,
%define %%b %5          ; [in]       another,
%define %%c %6          ; [in]       and the number of a register, which is clobbered
%assign %%xv 2 * %%v
%assign %%yv 2 * %%v + 1
%assign %%xw 2 * %%w
%assign %%yw 2 * %%w + 1
    VSUB    v12, v%[%%yv], v%[%%yw]
    VXOR    v12, v12, v7
    VMUL    v13, v12, v%[%%xv]
    VMOV    v14, [PACKET(%%a)]
    STORE_SELECTED r9 + CasterEdges.a%[%%n], 12, 14, 6
    VSUB    v12, v%[%%xw], v%[%%xv]
    VXOR    v12, v12, v7
    VMUL    v6, v12, v%[%%yv]
    VADD    v13, v13, v6
    VMOV    v14, [PACKET(%%b)]
    STORE_SELECTED r9 + CasterEdges.b%[%%n], 12, 14, 6
    VMOV    v12, v11
    VSUB    v12, v12, v13
    STORE_SELECTED r9 + CasterEdges.c%[%%n], 12, %%c, 6
%endmacro

; EDGES_OF_CASTERS - stores the edges of a packet of triangles from what BOUNDS_OF_CASTERS leaves. Clobbers all
;                    registers.
;
;   Edge functions have the sign of the area. Where that is in doubt, or numbers are too large for f32, three ends of
;   the bounds are edges.
;
;   equals        kernels::portable::shadows::SeenTriangles::edges
%macro EDGES_OF_CASTERS 0
    VSUB    v7, v2, v0
    VSUB    v12, v5, v1
    VMUL    v7, v7, v12
    VSUB    v12, v3, v1
    VSUB    v13, v4, v0
    VMUL    v12, v12, v13
    VSUB    v7, v7, v12
    VABS    v12, v7
    VZERO   v13
    MASK_GREATER v12, v11
    MASK_AND_GREATER v6, v13, v14
    MASK_AND_LESS v11, [PACKET(plain)], v14
    VAND    v7, v7, [PACKET(sign)]
    EDGE_OF_TRIANGLE 1, 0, 1, ones, zeros, 8
    EDGE_OF_TRIANGLE 2, 1, 2, minus_ones, zeros, 9
    EDGE_OF_TRIANGLE 3, 2, 0, zeros, ones, 10
%endmacro

; CAST - defines the kernel, which the head of this file describes.
%macro CAST 0
FUNC ISA %+ _cast
    PUSH_OWNED
    CONSTANTS LightSideView_size
    mov     r9, [rsi + CastTask.edges]
    mov     r10, [rsi + CastTask.bounds]
.block:
    cmp     qword [rsi + CastTask.vertices], 0
    jne     .faces
    TRANSPOSE_PLACED Triangle_size
    jmp     .transposed
.faces:
    TRANSPOSE_PLACED FACE_BYTES
.transposed:
%assign %%at 0
%rep 64 / VBYTES
    VMOV    v0, [r10 + CasterBounds.own + %%at]
    VMOV_TO [r9 + CasterEdges.own + %%at], v0
%assign %%at %%at + VBYTES
%endrep
    mov     r8, [rsi + CastTask.arrays]
    imul    rbx, [rsi + CastTask.across], AXIS_BYTES
    imul    rcx, [rsi + CastTask.down], AXIS_BYTES
    imul    rdx, [rsi + CastTask.depth], AXIS_BYTES
    add     rbx, r8
    add     rcx, r8
    add     rdx, r8
    mov     r11d, 16 / LANES
.packet:
    BOUNDS_OF_CASTERS
    EDGES_OF_CASTERS
    add     rbx, 4 * LANES
    add     rcx, 4 * LANES
    add     rdx, 4 * LANES
    add     r9, 4 * LANES
    add     r10, 4 * LANES
    dec     r11d
    jnz     .packet
    add     r9, CasterEdges_size - 4 * 16
    add     r10, CasterBounds_size - 4 * 16
    cmp     r10, [rsi + CastTask.bounds_end]
    jb      .block
    UNCONSTANTS
    POP_OWNED
ENDFUNC
%endmacro
