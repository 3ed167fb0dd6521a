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

; ALONE - begins a function: loads the packets of a.
%macro ALONE 3
%define %%name %1       ; [in]  the function's name
%define %%count %2      ; [in]  how many packets there are in a
%define %%constants %3  ; [in]  how many fields of the record are constants
FUNC ISA_NAME %+ _alone_ %+ %%name
%assign ALONE_CONSTANTS %%constants
%assign ALONE_RESULTS 0
%if ALONE_CONSTANTS
    CONSTANTS ALONE_CONSTANTS
%endif
%assign %%i 0
%rep %%count
    VLOAD   v%[%%i], [rsi + VBYTES * %%i]
%assign %%i %%i + 1
%endrep
%endmacro

; RESULT - stores a register as the next result.
%macro RESULT 1
%define %%v %1          ; [in]  vreg
    VSTORE  [rdx + VBYTES * ALONE_RESULTS], %%v
%assign ALONE_RESULTS ALONE_RESULTS + 1
%endmacro

; ENDALONE - ends a function.
%macro ENDALONE 0
%if ALONE_CONSTANTS
    UNCONSTANTS
%else
    CLEAN_UPPER
%endif
ENDFUNC
%endmacro

; MASK_RESULT - ends a function whose result is the mask.
%macro MASK_RESULT 0
    VMOV    v14, [PACKET(ones)]
    MASK_KEEP v14
    RESULT  v14
    ENDALONE
%endmacro

; ROOM - reserves aligned memory for packets at rsp, until LEAVE_ROOM.
%macro ROOM 1
%define %%packets %1    ; [in]  how many
    push    rbp
    mov     rbp, rsp
    sub     rsp, VBYTES * %%packets
    and     rsp, -VBYTES
%endmacro

; LEAVE_ROOM - undoes ROOM.
%macro LEAVE_ROOM 0
    mov     rsp, rbp
    pop     rbp
%endmacro

; ALONE_IN_BOTH - the functions of macros that are used in f32 and in f64.
%macro ALONE_IN_BOTH 0
%assign ESTIMATE 0
    ALONE   cross3_unfused, 6, 0
    CROSS3_UNFUSED v6, v7, v8, v0, v1, v2, v3, v4, v5, v9
    RESULT  v6
    RESULT  v7
    RESULT  v8
    ENDALONE

    ALONE   dot3_unfused, 6, 0
    DOT3_UNFUSED v6, v0, v1, v2, v3, v4, v5, v7, v8
    RESULT  v6
    ENDALONE

    ALONE   cosine, 2, 0
    COSINE  v0, v1, v2
    RESULT  v0
    ENDALONE

    ALONE   triangle_cosine, 5, 0
    TRIANGLE_COSINE v0, v1, v2, v3, v4, rdi, v5, v6, v7, v8
    RESULT  v0
    ENDALONE

    ALONE   normal_over_t, 2, 0
    SPHERE_ROOT v2, v0, v1, rdi, v3, v4, v5
    NORMAL_OVER_T v6, x, v0, v1, v2, rdi, v3, v5
    NORMAL_OVER_T v7, y, v0, v1, v2, rdi, v3, v5
    NORMAL_OVER_T v8, z, v0, v1, v2, rdi, v3, v5
    RESULT  v6
    RESULT  v7
    RESULT  v8
    ENDALONE

    ALONE   sphere_cosine, 4, 0
    SPHERE_COSINE v9, v0, v1, v2, v3, rdi, v4, v5, v6, v7
    RESULT  v9
    ENDALONE

    ALONE   around_normal, 4, 0
    AROUND_NORMAL v4, v5, v6, v0, v1, v2, v3, rdi, v7
    RESULT  v4
    RESULT  v5
    RESULT  v6
    ENDALONE

    ALONE   around_cosine, 7, 0
    AROUND_COSINE v7, v0, v1, v2, v3, v4, v5, v6, rdi, v8, v9, v10, v11
    RESULT  v7
    ENDALONE

    ALONE   short_cosine, 3, 0
    SHORT_COSINE v9, v0, v1, v2, rdi, v3, v4, v5, v6
    RESULT  v9
    ENDALONE

    ALONE   triangle_at, 2, 0
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
    RESULT  v11
    RESULT  v12
    ENDALONE

    ALONE   sphere_at, 2, 0
    SPHERE_ROW VSPREAD, v2, v3, v4, rdi, v1, v5, v6, v7
    VSPREAD v8, [rdi + ELEM * SpherePlanes.dxx]
    SPHERE_D_AT v9, v0, v2, v3, v8, v10, v11
    VSPREAD v12, [rdi + ELEM * SpherePlanes.hx]
    VSPREAD v13, [rdi + ELEM * SpherePlanes.most]
    SPHERE_INVERSE_AT v10, v0, v9, v4, v12, v13, v5, v6
    RESULT  v9
    RESULT  v10
    ENDALONE

    ; Inputs: j; then m, a, h0 and q0, which each row has of its own.
    ; Record: h1, q1, kn and ke of the sphere.
    ALONE   sphere_lit, 5, 0
    ROOM    LIT_PLACES
    VMOV    v9, v0
    VMOV    v10, v1
    LIT_FROM m, v10
    LIT_FROM a, v2
    LIT_FROM h_0, v3
    LIT_FROM q_0, v4
    LIT_CONSTANT h_1, [rdi + ELEM * LitSphere.h1]
    LIT_CONSTANT q_1, [rdi + ELEM * LitSphere.q1]
    LIT_CONSTANT kn, [rdi + ELEM * LitSphere.kn]
    LIT_CONSTANT ke, [rdi + ELEM * LitSphere.ke]
    SPHERE_LIT v8, v9, 1, v1, v2, v3, v4, v5
    LEAVE_ROOM
    RESULT  v8
    ENDALONE
%endmacro

; LIT_FROM - copies a register to a constant of SPHERE_LIT.
%macro LIT_FROM 2
%define %%name %1       ; [out]      without LIT_
%define %%a %2          ; [in]       vreg
    VOP     movu, LIT_ %+ %%name, %%a
%endmacro

; ALONE_IN_DOUBLE - the functions of macros that are used in f64 only.
%macro ALONE_IN_DOUBLE 0
    ALONE   silhouette, 3, 0
    SILHOUETTE v3, v4, v0, v1, v2, v5, v6
    RESULT  v3
    RESULT  v4
    ENDALONE

    ALONE   sphere_box, 3, SphereView_size
    SPHERE_BOX v3, v4, v5, v6, v0, v1, v2, v7, v8, v9
    RESULT  v3
    RESULT  v4
    RESULT  v5
    RESULT  v6
    ENDALONE

    ALONE   reach, 3, SphereView_size
    REACH   v0, v1, v2, width, v3
    RESULT  v1
    ENDALONE

    ALONE   pixels_between, 2, SphereView_size
    PIXELS_BETWEEN v0, v1, width
    RESULT  v0
    RESULT  v1
    ENDALONE

    ALONE   length_of, 3, 0
    LENGTH_OF v3, v0, v1, v2, v4
    RESULT  v3
    ENDALONE

    ALONE   better_corner, 9, 0
    BETTER_CORNER eax
    MASK_RESULT

    ALONE   triangle_volume, 9, 0
    TRIANGLE_VOLUME v9, v10, v11, v12, v0, v1, v2, v3, v4, v5, v6, v7, v8, v13, v14
    VMOV    v14, [PACKET(ones)]
    MASK_KEEP v14
    RESULT  v9
    RESULT  v10
    RESULT  v11
    RESULT  v12
    RESULT  v14
    ENDALONE

    ALONE   triangle_edge, 7, TileView_size
    VAND    v6, v6, [PACKET(sign)]
    TRIANGLE_EDGE v7, v8, v9, v0, v1, v2, v3, v4, v5, v6, v10, v11, v12, v13
    RESULT  v7
    RESULT  v8
    RESULT  v9
    ENDALONE

    ALONE   least_and_most, 3, 0
    LEAST_AND_MOST v3, v4, v0, v1, v2
    RESULT  v3
    RESULT  v4
    ENDALONE

    ; Inputs: the ray; then the triangle's volume, whose sign is the side of its plane.
    ALONE   outside_triangle, 4, 0
    VAND    v3, v3, [PACKET(sign)]
    IF_OUTSIDE_TRIANGLE x0, x1, x2, rdi, x3, x4, x5, x6, x7, .outside
    VMOV    v8, [PACKET(ones)]
    jmp     .stored
.outside:
    VZERO   v8
.stored:
    RESULT  v8
    ENDALONE

    ALONE   outside_sphere, 3, 0
    IF_OUTSIDE_SPHERE x0, x1, x2, rdi, x3, x4, x5, .outside
    VMOV    v8, [PACKET(ones)]
    jmp     .stored
.outside:
    VZERO   v8
.stored:
    RESULT  v8
    ENDALONE

    ; Inputs: points, the sum of the magnitudes of their coordinates, and the object that they are on.
    ALONE   triangle_hides, 5, 0
    ROOM    3
    mov     r10, rdi
    VMOV_TO [OWN], v4
    TRIANGLE_HIDES
    LEAVE_ROOM
    MASK_RESULT

    ; Inputs: points, g, the sum of the magnitudes of their coordinates, and the object that they are on.
    ALONE   sphere_hides, 8, 0
    ROOM    3
    mov     r10, rdi
    VMOV_TO [SUM_OF_SIZES], v6
    VMOV_TO [OWN], v7
    VMUL    v8, v3, v3
    VFMA    v8, v4, v4, v14
    VFMA    v8, v5, v5, v14
    VMOV_TO [SUM_OF_SQUARES], v8
    SPHERE_HIDES
    LEAVE_ROOM
    MASK_RESULT
%endmacro

; ALONE_IN_SINGLE - the functions of macros that are used in f32 only.
%macro ALONE_IN_SINGLE 0
    ALONE   caster_edge, 2, 0
    mov     rcx, rdi
    EDGE_OF_CASTER v6, 1
    RESULT  v6
    ENDALONE
%endmacro
