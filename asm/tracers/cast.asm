; cast.asm - triangles as a light sees them: their bounds on a side of its cube, and planes that say what they hide.
;
; unsafe extern "sysv64" fn(view: *const LightSideView, task: *const CastTask)
;
;   rayo_<isa>_cast
;
;   Everything is in the axes of the side: across, down and depth. A cyclic change of axes changes no cross product. The
;   plane through the light L and an edge is that through the edge's middle m with the normal (m - L) x (w - v): turned
;   round, the edge has exactly the other side. The triangle's own plane is taken through its corner nearest to the
;   camera, since the terms of a farther one would cancel.
;
;   registers   rdi view, whose fields are the constants K; rsi task; r9 casters, r10 bounds of a block, r11 what is
;               left of it; rbx, rcx, rdx coordinates of corners, across, down and depth, r12, r13, r14 of planes
;   writes      casters and bounds of all triangles whose places are in the bounds, but for own; the bounds of one that
;               crosses the plane of depth 0 meet everything, those of one beyond it nothing; casters' bound is no
;               number where the side of the light is in doubt, or where the triangle is a sliver
;   requires    the CPUID features of the ISA; bounds whose places are those of triangles or of faces with valid
;               vertices, 4 readable bytes after these
;   equals      kernels::portable::shadows::cast, to the last bit

%assign CORNER_BYTES TriangleArrays_size / 5    ; three coordinates of a chunk
%assign AXIS_BYTES TriangleArrays_size / 15
%define PLANE_BYTES (ELEM * 4 * 16)

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

; CORNER - loads a corner in the axes of the side.
;
;   instructions   3
%macro CORNER 4
%define %%x %1          ; [out]      vreg
%define %%y %2          ; [out]      vreg
%define %%z %3          ; [out]      vreg
%define %%n %4          ; [in]       0, 1 or 2
    WIDEN   %%x, [rbx + CORNER_BYTES * %%n]
    WIDEN   %%y, [rcx + CORNER_BYTES * %%n]
    WIDEN   %%z, [rdx + CORNER_BYTES * %%n]
%endmacro

; FROM_LIGHT - a = a - L.
;
;   instructions   3
%macro FROM_LIGHT 3
%define %%x %1          ; [in/out]   vreg
%define %%y %2          ; [in/out]   vreg
%define %%z %3          ; [in/out]   vreg
    VSUB    %%x, %%x, K(LightSideView.across)
    VSUB    %%y, %%y, K(LightSideView.down)
    VSUB    %%z, %%z, K(LightSideView.depth)
%endmacro

; STORE_PLANE - stores the coefficients of plane n in the axes of the casters.
;
;   instructions   3
%macro STORE_PLANE 4
%define %%x %1          ; [in]       vreg
%define %%y %2          ; [in]       vreg
%define %%z %3          ; [in]       vreg
%define %%n %4          ; [in]       0 to 2, edges, or 3, the triangle's own
    VMOV_TO [r12 + PLANE_BYTES * %%n], %%x
    VMOV_TO [r13 + PLANE_BYTES * %%n], %%y
    VMOV_TO [r14 + PLANE_BYTES * %%n], %%z
%endmacro

; STORE_BOUND - stores v<n> as f32 in a field of the bounds at r10, or `beyond` in the lanes that are not in the mask:
;               where a triangle crosses depth 0.
%macro STORE_BOUND 3
%define %%n %1          ; [clobbered] number of a register
%define %%field %2      ; [in]       of CasterBounds
%define %%beyond %3     ; [clobbered] number of a register
    VSELECT v%[%%beyond], v%[%%n]
    NARROW  %%beyond
    STORE_NUMBERS r10 + %%field, %%beyond
%endmacro

; PLACE_IN_CELLS - v<n> = v<n> counted in cells, wider by slack: low ones are negated.
;
;   equals        kernels::portable::shadows::bounds_of
%macro PLACE_IN_CELLS 3
%define %%n %1          ; [in/out]   number of a register
%define %%axis %2       ; [in]       x or y
%define %%is_low %3     ; [in]       1 or 0
%if %%is_low
    VSUB    v%[%%n], v%[%%n], [PACKET(slack)]
%else
    VADD    v%[%%n], v%[%%n], [PACKET(slack)]
%endif
    VSUB    v%[%%n], v%[%%n], K(LightSideView.low_%+ %%axis)
    VMUL    v%[%%n], v%[%%n], K(LightSideView.scale_%+ %%axis)
%if %%is_low
    VXOR    v%[%%n], v%[%%n], [PACKET(sign)]
%endif
%endmacro

; BOUNDS_OF_CASTERS - stores the bounds of a packet of triangles. Clobbers v0 to v13.
;
;   equals        kernels::portable::shadows::bounds_of
%macro BOUNDS_OF_CASTERS 0
%assign %%n 0
%rep 3
    CORNER  v0, v1, v2, %%n
    FROM_LIGHT v0, v1, v2
    VMUL    v2, v2, K(LightSideView.sign)
    VMOV    v3, [PACKET(ones)]
    VDIV    v3, v3, v2
    VMUL    v0, v0, v3
    VMUL    v1, v1, v3
%if %%n == 0
    VMOV    v8, v0
    VMOV    v9, v0
    VMOV    v10, v1
    VMOV    v11, v1
    VMOV    v12, v2
    VMOV    v13, v2
%else
    VMIN    v8, v8, v0
    VMAX    v9, v9, v0
    VMIN    v10, v10, v1
    VMAX    v11, v11, v1
    VMIN    v12, v12, v2
    VMAX    v13, v13, v2
%endif
%assign %%n %%n + 1
%endrep
    PLACE_IN_CELLS 8, x, 1
    PLACE_IN_CELLS 9, x, 0
    PLACE_IN_CELLS 10, y, 1
    PLACE_IN_CELLS 11, y, 0
    MASK_GREATER v12, [PACKET(zeros)]
    VMUL    v12, v12, [PACKET(depth_slack)]
    VXOR    v12, v12, [PACKET(sign)]
    VMOV    v0, [PACKET(zeros)]
    STORE_BOUND 12, CasterBounds.depth, 0
    VMOV    v0, [PACKET(infinite)]
    STORE_BOUND 9, CasterBounds.past_x, 0
    VMOV    v0, [PACKET(infinite)]
    STORE_BOUND 10, CasterBounds.y, 0
    VMOV    v0, [PACKET(infinite)]
    STORE_BOUND 11, CasterBounds.past_y, 0
    VMOV    v1, [PACKET(infinite)]
    VSELECT v1, v8
    MASK_GREATER v13, [PACKET(zeros)]
    VMOV    v0, [PACKET(no_number)]
    STORE_BOUND 1, CasterBounds.x, 0
%endmacro

; OF_MAGNITUDES - d = the greatest (VMAX) or the sum (VADD) of the magnitudes of the coordinates of a. Clobbers t.
;
;   instructions   sse41 8   avx2, avx512 5
%macro OF_MAGNITUDES 6
%define %%op %1         ; [in]       VMAX or VADD
%define %%d %2          ; [out]      vreg
%define %%x %3          ; [in]       vreg
%define %%y %4          ; [in]       vreg
%define %%z %5          ; [in]       vreg
%define %%t %6          ; [clobbered] vreg
    VABS    %%d, %%x
    VABS    %%t, %%y
    %%op    %%d, %%d, %%t
    VABS    %%t, %%z
    %%op    %%d, %%d, %%t
%endmacro

; NEARER - v0 v1 v2 and v8, its greatest magnitude, become those of a corner if that is nearer to the camera. Clobbers
;          v9 to v14.
%macro NEARER 1
%define %%n %1          ; [in]       1 or 2
    CORNER  v9, v10, v11, %%n
    OF_MAGNITUDES VMAX, v13, v9, v10, v11, v14
    MASK_GREATER v8, v13
    VSELECT v0, v9
    VSELECT v1, v10
    VSELECT v2, v11
    VSELECT v8, v13
%endmacro

; CASTER_EDGE - stores the plane through the light and an edge, with the sign of the side in v12. Clobbers all others.
;
;   equals        kernels::portable::shadows::planes
%macro CASTER_EDGE 3
%define %%n %1          ; [in]       0, 1 or 2
%define %%v %2          ; [in]       the corner where it begins
%define %%w %3          ; [in]       where it ends
    CORNER  v0, v1, v2, %%v
    CORNER  v3, v4, v5, %%w
    SUB3    v9, v10, v11, v3, v4, v5, v0, v1, v2
    VADD    v6, v0, v3
    VADD    v7, v1, v4
    VADD    v8, v2, v5
    VMUL    v6, v6, [PACKET(halves)]
    VMUL    v7, v7, [PACKET(halves)]
    VMUL    v8, v8, [PACKET(halves)]    ; m
    VMOV    v0, v6
    VMOV    v1, v7
    VMOV    v2, v8
    FROM_LIGHT v0, v1, v2
    CROSS3_UNFUSED v3, v4, v5, v0, v1, v2, v9, v10, v11, v13
    VXOR    v3, v3, v12
    VXOR    v4, v4, v12
    VXOR    v5, v5, v12
    STORE_PLANE v3, v4, v5, %%n
    DOT3_UNFUSED v0, v3, v4, v5, v6, v7, v8, v1, v2
    VXOR    v0, v0, [PACKET(sign)]
    VMOV_TO [r9 + PLANE_BYTES * (%%n + 1) - ELEM * 16], v0
%endmacro

; PLANES_OF_CASTERS - stores the planes of a packet of triangles. Clobbers all registers.
;
;   equals        kernels::portable::shadows::cast
%macro PLANES_OF_CASTERS 0
    CORNER  v0, v1, v2, 0
    CORNER  v3, v4, v5, 1
    CORNER  v6, v7, v8, 2
    SUB3    v9, v10, v11, v0, v1, v2, v3, v4, v5
    SUB3    v12, v13, v14, v0, v1, v2, v6, v7, v8
    OF_MAGNITUDES VMAX, v7, v9, v10, v11, v6
    OF_MAGNITUDES VMAX, v8, v12, v13, v14, v6
    VMUL    v7, v7, v8
    VMUL    v8, v7, [PACKET(sliver)]
    CROSS3_UNFUSED v3, v4, v5, v9, v10, v11, v12, v13, v14, v6
    OF_MAGNITUDES VMAX, v7, v3, v4, v5, v6
    MASK_GREATER v7, v8                 ; no sliver
    VMOV    v9, v0
    VMOV    v10, v1
    VMOV    v11, v2
    FROM_LIGHT v9, v10, v11
    DOT3_UNFUSED v12, v9, v10, v11, v3, v4, v5, v13, v14
    OF_MAGNITUDES VADD, v6, v9, v10, v11, v14
    VMUL    v6, v6, v7
    VMUL    v6, v6, [PACKET(plain)]
    VABS    v14, v12
    MASK_AND_GREATER v14, v6, v13       ; no doubt
    VMUL    v7, v7, [PACKET(slack)]
    VMOV    v6, v7
    VMOV    v14, [PACKET(no_number)]
    VSELECT v14, v6
    VMOV_TO [r9 + ELEM * TriangleCasters.bound], v14
    VAND    v12, v12, [PACKET(sign)]
    VMOV_TO [SCRATCH], v12
    VXOR    v12, v12, [PACKET(sign)]
    VXOR    v3, v3, v12
    VXOR    v4, v4, v12
    VXOR    v5, v5, v12
    STORE_PLANE v3, v4, v5, 3
    OF_MAGNITUDES VMAX, v8, v0, v1, v2, v14
    NEARER  1
    NEARER  2
    OF_MAGNITUDES VADD, v9, v0, v1, v2, v14
    VMUL    v9, v9, v7
    DOT3_UNFUSED v10, v3, v4, v5, v0, v1, v2, v11, v13
    VSUB    v9, v9, v10
    VMOV_TO [r9 + ELEM * TriangleCasters.p0], v9
    VMOV    v12, [SCRATCH]
    CASTER_EDGE 0, 0, 1
    CASTER_EDGE 1, 1, 2
    CASTER_EDGE 2, 2, 0
%endmacro

; AXES - three registers = the addresses of coordinates, from that of the first axis on, in the order of the side.
;
;   instructions   6
%macro AXES 5
%define %%across %1     ; [out]      general register
%define %%down %2       ; [out]      general register
%define %%depth %3      ; [out]      general register
%define %%from %4       ; [in]       general register
%define %%bytes %5      ; [in]       from axis to axis
    imul    %%across, [rsi + CastTask.across], %%bytes
    imul    %%down, [rsi + CastTask.down], %%bytes
    imul    %%depth, [rsi + CastTask.depth], %%bytes
    add     %%across, %%from
    add     %%down, %%from
    add     %%depth, %%from
%endmacro

; CAST - the function.
%macro CAST 0
FUNC ISA %+ _cast
    PUSH_OWNED
    CONSTANTS LightSideView_size
    mov     r9, [rsi + CastTask.casters]
    mov     r10, [rsi + CastTask.bounds]
.block:
    cmp     qword [rsi + CastTask.vertices], 0
    jne     .faces
    TRANSPOSE_PLACED Triangle_size
    jmp     .transposed
.faces:
    TRANSPOSE_PLACED FACE_BYTES
.transposed:
    mov     r8, [rsi + CastTask.arrays]
    AXES    rbx, rcx, rdx, r8, AXIS_BYTES
    AXES    r12, r13, r14, r9, ELEM * 16
    mov     r11d, 16 / LANES
.packet:
    BOUNDS_OF_CASTERS
    PLANES_OF_CASTERS
    add     rbx, 4 * LANES
    add     rcx, 4 * LANES
    add     rdx, 4 * LANES
    add     r12, VBYTES
    add     r13, VBYTES
    add     r14, VBYTES
    add     r9, VBYTES
    add     r10, 4 * LANES
    dec     r11d
    jnz     .packet
    add     r9, ELEM * TriangleCasters_size - ELEM * 16
    add     r10, CasterBounds_size - 4 * 16
    cmp     r10, [rsi + CastTask.bounds_end]
    jb      .block
    UNCONSTANTS
    POP_OWNED
ENDFUNC
%endmacro
