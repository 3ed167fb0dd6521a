; alone.asm - macros of the tracers, each in a function of its own, to be proved equal to its twin.
;
; unsafe extern "sysv64" fn(record: *const u8, a: *const element, out: *mut element)
;
;   record      the record in memory that the macro reads; a view is copied to the constants K
;   a           packets that are loaded into v0 and the registers after it
;   out         packets with its results; of a mask, 1 in the lanes that are set and 0 in the others
;
;   requires    the CPUID features of the ISA; no alignment
;
; Assembled once per ISA and element type, in units that no engine uses. A function is called
; rayo_<isa>_<single or double>_alone_<name>.
; src/kernels/alone.rs says how large record, a and out are.

; ALONE - begins a function: reserves memory, whose aligned address is then in rax and, without constants, in rsp; makes
;         constants; and loads the packets of a.
%macro ALONE 4
%define %%name %1       ; [in]  the function's name
%define %%count %2      ; [in]  how many packets there are in a
%define %%constants %3  ; [in]  how many fields of the record are constants
%define %%bytes %4      ; [in]  of memory
FUNC ISA_NAME %+ _alone_ %+ %%name
%assign ALONE_CONSTANTS %%constants
%assign ALONE_MEMORY %%bytes
%assign ALONE_RESULTS 0
%if ALONE_MEMORY
    push    rbp
    mov     rbp, rsp
    sub     rsp, ALONE_MEMORY
    and     rsp, -VBYTES
    mov     rax, rsp
%endif
%if ALONE_CONSTANTS
    CONSTANTS ALONE_CONSTANTS
%endif
%assign %%i 0
%rep %%count
    VLOAD   v%[%%i], [rsi + VBYTES * %%i]
%assign %%i %%i + 1
%endrep
%endmacro

; RESULTS - stores packets that are in memory as the next results.
%macro RESULTS 4
%define %%load %1       ; [in]  VMOV, or WIDEN from f32
%define %%first %2      ; [in]  address of the first
%define %%bytes %3      ; [in]  from one to the next
%define %%count %4      ; [in]  how many
%assign %%i 0
%rep %%count
    %%load  v14, [%%first + (%%bytes) * %%i]
    VSTORE  [rdx + VBYTES * ALONE_RESULTS], v14
%assign ALONE_RESULTS ALONE_RESULTS + 1
%assign %%i %%i + 1
%endrep
%endmacro

; RETURN - stores registers as the next results, and ends the function.
%macro RETURN 2
%define %%first %1      ; [in]  number of the first
%define %%count %2      ; [in]  how many
%assign %%i %%first
%rep %%count
    VSTORE  [rdx + VBYTES * ALONE_RESULTS], v%[%%i]
%assign ALONE_RESULTS ALONE_RESULTS + 1
%assign %%i %%i + 1
%endrep
%if ALONE_CONSTANTS
    UNCONSTANTS
%else
    CLEAN_UPPER
%endif
%if ALONE_MEMORY
    mov     rsp, rbp
    pop     rbp
%endif
ENDFUNC
%endmacro

; MASK_RESULT - ends a function whose result is the mask.
%macro MASK_RESULT 0
    VMOV    v14, [PACKET(ones)]
    MASK_KEEP v14
    RETURN  14, 1
%endmacro

; JUMP_RESULT - ends a function whose result is 1 or, if it jumped to .outside, 0.
%macro JUMP_RESULT 0
    VMOV    v8, [PACKET(ones)]
    jmp     .stored
.outside:
    VZERO   v8
.stored:
    RETURN  8, 1
%endmacro

; ALONE_IN_BOTH - the functions of macros that are used in f32 and in f64.
%macro ALONE_IN_BOTH 0
%assign ESTIMATE 0
    ALONE   cross3_unfused, 6, 0, 0
    CROSS3_UNFUSED v6, v7, v8, v0, v1, v2, v3, v4, v5, v9
    RETURN  6, 3

    ALONE   dot3_unfused, 6, 0, 0
    DOT3_UNFUSED v6, v0, v1, v2, v3, v4, v5, v7, v8
    RETURN  6, 1

    ALONE   cosine, 2, 0, 0
    COSINE  v0, v1, v2
    RETURN  0, 1

    ALONE   triangle_cosine, 5, 0, 0
    TRIANGLE_COSINE v0, v1, v2, v3, v4, rdi, v5, v6, v7, v8
    RETURN  0, 1

    ALONE   normal_over_t, 2, 0, 0
    SPHERE_ROOT v2, v0, v1, rdi, v3, v4, v5
    NORMAL_OVER_T v6, x, v0, v1, v2, rdi, v3, v5
    NORMAL_OVER_T v7, y, v0, v1, v2, rdi, v3, v5
    NORMAL_OVER_T v8, z, v0, v1, v2, rdi, v3, v5
    RETURN  6, 3

    ALONE   sphere_cosine, 4, 0, 0
    SPHERE_COSINE v9, v0, v1, v2, v3, rdi, v4, v5, v6, v7
    RETURN  9, 1

    ALONE   around_normal, 4, 0, 0
    AROUND_NORMAL v4, v5, v6, v0, v1, v2, v3, rdi, v7
    RETURN  4, 3

    ALONE   around_cosine, 7, 0, 0
    AROUND_COSINE v7, v0, v1, v2, v3, v4, v5, v6, rdi, v8, v9, v10, v11
    RETURN  7, 1

    ALONE   short_cosine, 3, 0, 0
    SHORT_COSINE v9, v0, v1, v2, rdi, v3, v4, v5, v6
    RETURN  9, 1

    ALONE   triangle_at, 2, 0, 0
    PLANE_ROW VSPREAD, v2, rdi, e1, v1, v14, v15
    PLANE_ROW VSPREAD, v3, rdi, e2, v1, v14, v15
    PLANE_ROW VSPREAD, v4, rdi, e3, v1, v14, v15
    PLANE_ROW VSPREAD, v5, rdi, t, v1, v14, v15
    VSPREAD v6, [rdi + ELEM * TrianglePlanes.e1x]
    VSPREAD v7, [rdi + ELEM * TrianglePlanes.e2x]
    VSPREAD v8, [rdi + ELEM * TrianglePlanes.e3x]
    VSPREAD v9, [rdi + ELEM * TrianglePlanes.tx]
    VSPREAD v10, [rdi + ELEM * TrianglePlanes.most]
    TRIANGLE_AT v11, v12, v0, v2, v3, v4, v5, v6, v7, v8, v9, v10, v15
    RETURN  11, 2

    ALONE   sphere_at, 2, 0, 0
    SPHERE_ROW VSPREAD, v2, v3, v4, rdi, v1, v5, v6, v7
    VSPREAD v8, [rdi + ELEM * SpherePlanes.dxx]
    SPHERE_D_AT v9, v0, v2, v3, v8, v10, v11
    VSPREAD v12, [rdi + ELEM * SpherePlanes.hx]
    VSPREAD v13, [rdi + ELEM * SpherePlanes.most]
    SPHERE_INVERSE_AT v10, v0, v9, v4, v12, v13, v5, v6
    RETURN  9, 2

    ; Inputs: j; then m, a, h0 and q0, which each row has of its own.
    ; Record: h1, q1, kn and ke of the sphere.
    ALONE   sphere_lit, 5, 0, VBYTES * LIT_PLACES
    VMOV    v9, v0
    VMOV    v10, v1
    VOP     movu, LIT_m, v10
    VOP     movu, LIT_a, v2
    VOP     movu, LIT_h_0, v3
    VOP     movu, LIT_q_0, v4
    LIT_CONSTANT h_1, [rdi + ELEM * LitSphere.h1]
    LIT_CONSTANT q_1, [rdi + ELEM * LitSphere.q1]
    LIT_CONSTANT kn, [rdi + ELEM * LitSphere.kn]
    LIT_CONSTANT ke, [rdi + ELEM * LitSphere.ke]
    SPHERE_LIT v8, v9, 1, v1, v2, v3, v4, v5
    RETURN  8, 1
%endmacro

; ALONE_IN_DOUBLE - the functions of macros that are used in f64 only.
%macro ALONE_IN_DOUBLE 0
    ALONE   sphere_box, 3, SphereView_size, 0
    SPHERE_BOX v3, v4, v5, v6, v0, v1, v2, v7, v8, v9
    RETURN  3, 4

    ALONE   pixels_between, 2, SphereView_size, 0
    PIXELS_BETWEEN v0, v1, width
    RETURN  0, 2

    ALONE   length_of, 3, 0, 0
    LENGTH_OF v3, v0, v1, v2, v4
    RETURN  3, 1

    ALONE   better_corner, 9, 0, 0
    BETTER_CORNER eax
    MASK_RESULT

    ALONE   triangle_volume, 9, 0, 0
    TRIANGLE_VOLUME v9, v10, v11, v12, v0, v1, v2, v3, v4, v5, v6, v7, v8, v13, v14
    VMOV    v13, [PACKET(ones)]
    MASK_KEEP v13
    RETURN  9, 5

    ALONE   triangle_edge, 7, TileView_size, 0
    VAND    v6, v6, [PACKET(sign)]
    TRIANGLE_EDGE v7, v8, v9, v0, v1, v2, v3, v4, v5, v6, v10, v11, v12, v13
    RETURN  7, 3

    ; Inputs: the ray; then the triangle's volume, whose sign is the side of its plane.
    ALONE   outside_triangle, 4, 0, 0
    VAND    v3, v3, [PACKET(sign)]
    IF_OUTSIDE_TRIANGLE x0, x1, x2, rdi, x3, x4, x5, x6, x7, .outside
    JUMP_RESULT

    ALONE   outside_sphere, 3, 0, 0
    IF_OUTSIDE_SPHERE x0, x1, x2, rdi, x3, x4, x5, .outside
    JUMP_RESULT

    ; Inputs: points, the sum of the magnitudes of their coordinates, and the object that they are on.
    ALONE   triangle_hides, 5, 0, VBYTES * 3
    mov     r10, rdi
    VMOV_TO [OWN], v4
    TRIANGLE_HIDES
    MASK_RESULT

    ; Inputs: points, g, the sum of the magnitudes of their coordinates, and the object that they are on.
    ALONE   sphere_hides, 8, 0, VBYTES * 3
    mov     r10, rdi
    VMOV_TO [SUM_OF_SIZES], v6
    VMOV_TO [OWN], v7
    VMUL    v8, v3, v3
    VFMA    v8, v4, v4, v14
    VFMA    v8, v5, v5, v14
    VMOV_TO [SUM_OF_SQUARES], v8
    SPHERE_HIDES
    MASK_RESULT

    ALONE   sphere_d, 0, 10, VBYTES * W_places
    mov     r11, r15
    mov     r15, rax
    lea     r8, [rdi + ELEM * SphereView_size]
    SPHERE_D
    RESULTS VMOV, r15 + VBYTES * W_column, VBYTES, 2
    RESULTS VMOV, r15 + VBYTES * W_ux, VBYTES, 3
    RESULTS VMOV, r15 + VBYTES * W_cc, VBYTES, 3
    RESULTS VMOV, r15 + VBYTES * W_rayx, VBYTES, 7
    VMOV    v3, v6
    VMOV    v5, v8
    VMOV    v6, v12
    VMOV    v7, v9
    mov     r15, r11
    RETURN  2, 6

    ; Inputs: the greatest distances from the origin; then d0, dx, dxy, dy, dxx and dyy.
    ALONE   term, 8, 0, 4 * SpherePlanes_size
    mov     r9, rax
    VMOV    v8, v3
    VMOV    v9, v5
    VABS    v3, v2
    TERM    4, dx, 8, v0, none
    TERM    4, dy, 9, v1, none
    TERM    4, dxx, 6, v0, v0
    TERM    4, dxy, 4, v0, v1
    TERM    4, dyy, 7, v1, v1
    RESULTS WIDEN, r9 + 4 * SpherePlanes.dx, 4 * (SpherePlanes.dy - SpherePlanes.dx), 5
    RETURN  3, 1

    ; Inputs: t and its increments; scale / radius; the centre; the ray, without its depth.
    ALONE   normal, 9, 10, VBYTES * W_places
    mov     r11, r15
    mov     r15, rax
    VMOV_TO W(ux), v4
    VMOV_TO W(uy), v5
    VMOV_TO W(uz), v6
    VMOV_TO W(rayx), v7
    VMOV_TO W(rayy), v8
    NORMAL  x, W(rayx), SphereView.step, none
    NORMAL  y, W(rayy), none, SphereView.step
    KLOAD   v7, SphereView.focal
    NORMAL  z, v7, none, none
    RESULTS VMOV, r15 + VBYTES * W_mx, VBYTES, 9
    mov     r15, r11
    RETURN  0, 0

    ; Record: a light, spheres and triangles.
    ALONE   lights, 0, 0, 0
    mov     r11, rdi
    lea     r8, [rdi + ELEM * TileLight_size]
    TO_LIGHT
    SPHERE_WEIGHT v3, red, [PACKET(white)], 4
    SPHERE_WEIGHT v4, green, [PACKET(white)], 8
    add     r8, SphereArrays_size
    WEIGHT  5, blue
    RETURN  0, 6

    ALONE   casters, 0, LightSideView_size, CasterEdges_size + CasterBounds_size
    mov     r8, rbx
    mov     r11, rdx
    mov     r9, rax
    lea     r10, [rax + CasterEdges_size]
    lea     rbx, [rdi + ELEM * LightSideView_size + TriangleArrays.ax]
    lea     rcx, [rdi + ELEM * LightSideView_size + TriangleArrays.ay]
    lea     rdx, [rdi + ELEM * LightSideView_size + TriangleArrays.az]
    BOUNDS_OF_CASTERS
    EDGES_OF_CASTERS
    mov     rbx, r8
    mov     rdx, r11
    RESULTS WIDEN, r10, CasterBounds.y - CasterBounds.x, 5
    RESULTS WIDEN, r9, CasterEdges.b1 - CasterEdges.a1, 9
    RETURN  0, 0
%endmacro

; ALONE_IN_SINGLE - the functions of macros that are used in f32 only.
%macro ALONE_IN_SINGLE 0
    ; Inputs: the greatest of the least edges and the least of the greatest ones so far, and three edges.
    ALONE   edges_here, 5, 0, 0
    VMOV    v9, v2
    VMOV    v10, v3
    VMOV    v11, v4
    VMOV    v3, v0
    VMOV    v5, v1
    EDGES_HERE
    VMOV    v4, v5
    RETURN  3, 2

    ALONE   cross2, 4, 0, 0
    VMOV    v5, v1
    CROSS2  v4, v0, v5, v2, v3
    RETURN  4, 1

    ; Inputs: what the coordinates of three corners are multiplied by, and these.
    ALONE   project, 6, 0, TriangleArrays_size
    mov     r8, rax
    VMOV_TO [r8 + TriangleArrays.ax], v3
    VMOV_TO [r8 + TriangleArrays.bx], v4
    VMOV_TO [r8 + TriangleArrays.cx], v5
    PROJECT v6, v7, x, v8
    RESULTS VMOV, r8 + TriangleArrays.ax, TriangleArrays.bx - TriangleArrays.ax, 3
    RETURN  6, 2

    ALONE   caster_edge, 2, 0, 0
    mov     rcx, rdi
    EDGE_OF_CASTER v6, 1
    RETURN  6, 1

    ALONE   within_edges, 2, 0, 0
    mov     rcx, rdi
    WITHIN_EDGES
    MASK_RESULT

    ALONE   within_bounds, 2, 0, 0
    mov     rcx, rdi
    WITHIN_BOUNDS
    MASK_RESULT
%endmacro
