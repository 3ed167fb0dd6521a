; casters.asm - which points of a tile a light does not reach, since one of some objects lies between: exact shadows.
;
; An object hides a light L from a point P of another object if it meets the segment between them. A triangle does if P
; and L are on different sides of its plane, and P is within its edges as L sees them: on the inner side of the planes
; through L and each edge, eq. 10 applied from the light. A sphere does if the line through P and L meets it, by eq. 5
; applied from P with g = L - P and q = c - P: D = (g.q)^2 - g.g (q.q - r^2) near it, r^2 g.g - |q x g|^2 from afar,
; where l = c - L replaces q if it is much shorter; and if one of the two walls is between P and L. A hit that the
; rounding of P could account for does not count.
;
; Assembled once per ISA, in f64. The functions:
;
;   rayo_<isa>_triangle_casters, rayo_<isa>_sphere_casters
;       unsafe extern "sysv64" fn(task: *const CastersTask)
;
; Clears, in each group's `open`, the points that some object which the group has met hides from the light. No point is
; hidden by the object that it is on.
;
;   registers   rdi task, r12 the group; rsi light, rdx points, rcx whose they are, r11 their end, r8d those that are
;               open, r13d those still so; r9 casters, r10 one of them; rbx a pair, r14 the first of a group, r15 their
;               end; v0 v1 v2 P, v3 the sum of its magnitudes; for spheres v3 v4 v5 g, and in memory that sum and g.g
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written
;   equals      kernels::portable::shadows::open

%define SUM_OF_SIZES rsp                ; |P|: for each point of a register the sum of its coordinates' magnitudes
%define SUM_OF_SQUARES rsp + VBYTES     ; g.g
%define OWN rsp + 2 * VBYTES            ; the numbers of the points' objects

; POINT - v<n> = coordinate n of the points at rdx, and v3 = v3 + its magnitude. Clobbers v14.
%macro POINT 1
%define %%n %1          ; [in]       0, 1 or 2
    VMOV    v%[%%n], [rdx + ELEM * TILE_WIDTH * TILE_HEIGHT * %%n]
    VABS    v14, v%[%%n]
    VADD    v3, v3, v14
%endmacro

; TO_LIGHT - v<g> = coordinate n of g. Clobbers nothing else.
%macro TO_LIGHT 2
%define %%g %1          ; [out]      number of a register
%define %%n %2          ; [in]       0, 1 or 2
    VSPREAD v%[%%g], [rsi + ELEM * %%n]
    VSUB    v%[%%g], v%[%%g], v%[%%n]
%endmacro

; PLANE_OF_CASTER - d = d0 + dx x + dy y + dz z, of the caster at r10. Clobbers v13, v14.
;
;   instructions   sse41 13   avx2 7   avx512 4
;   critical path  load -> fma -> fma -> fma
%macro PLANE_OF_CASTER 2
%define %%d %1          ; [out]      vreg
%define %%field %2      ; [in]       dx
    VSPREAD %%d, [r10 + ELEM * (%%field + 3)]
    ELEMENT_OPERAND [r10 + ELEM * %%field], v14
    VFMA    %%d, v0, ONE, v13
    ELEMENT_OPERAND [r10 + ELEM * (%%field + 1)], v14
    VFMA    %%d, v1, ONE, v13
    ELEMENT_OPERAND [r10 + ELEM * (%%field + 2)], v14
    VFMA    %%d, v2, ONE, v13
%endmacro

; TRIANGLE_HIDES - the mask = the points that the triangle at r10 hides from the light. Clobbers v6 to v9, v13, v14.
;
;   equals        kernels::portable::shadows::triangle_hides
%macro TRIANGLE_HIDES 0
    PLANE_OF_CASTER v6, TriangleCaster.e1x
    PLANE_OF_CASTER v7, TriangleCaster.e2x
    PLANE_OF_CASTER v8, TriangleCaster.e3x
    PLANE_OF_CASTER v9, TriangleCaster.px
    ELEMENT_OPERAND [r10 + ELEM * TriangleCaster.bound], v14
    VFMA    v9, v3, ONE, v13
    VMIN    v6, v6, v7
    VMIN    v6, v6, v8
    MASK_NOT_LESS v6, [PACKET(zeros)]
    MASK_AND_LESS v9, [PACKET(zeros)], v13
    VSPREAD v14, [r10 + ELEM * TriangleCaster.own]
    MASK_AND_UNEQUAL v14, [OWN], v13
%endmacro

; LESS_CASTER - d = a - a number of the caster at r10. Clobbers v14.
%macro LESS_CASTER 3
%define %%d %1          ; [out]      vreg
%define %%a %2          ; [in]       vreg
%define %%field %3      ; [in]       of the number
    ELEMENT_OPERAND [r10 + ELEM * %%field], v14
    VSUB    %%d, %%a, ONE
%endmacro

; SPHERE_HIDES - the mask = the points that the sphere at r10 hides from the light. Clobbers v6 to v14.
;
;   equals        kernels::portable::shadows::sphere_hides
%macro SPHERE_HIDES 0
    LESS_CASTER v6, v0, SphereCaster.ux
    LESS_CASTER v7, v0, SphereCaster.wx
    VMUL    v9, v6, v7
    LESS_CASTER v6, v1, SphereCaster.uy
    LESS_CASTER v7, v1, SphereCaster.wy
    VFMA    v9, v6, v7, v14
    LESS_CASTER v6, v2, SphereCaster.uz
    LESS_CASTER v7, v2, SphereCaster.wz
    VFMA    v9, v6, v7, v14
    ELEMENT_OPERAND [r10 + ELEM * SphereCaster.k], v14
    VADD    v9, v9, ONE                 ; q.q - r^2
    VSPREAD v6, [r10 + ELEM * SphereCaster.x]
    VSUB    v6, v6, v0
    VSPREAD v7, [r10 + ELEM * SphereCaster.y]
    VSUB    v7, v7, v1
    VSPREAD v8, [r10 + ELEM * SphereCaster.z]
    VSUB    v8, v8, v2                  ; q
    VMUL    v10, v6, v3
    VFMA    v10, v7, v4, v14
    VFMA    v10, v8, v5, v14            ; h = g.q
    VMOV    v12, [SUM_OF_SQUARES]
    VSUB    v13, v10, v12               ; g.l = g.q - g.g
    VSPREAD v11, [r10 + ELEM * SphereCaster.far]
    MASK_GREATER v9, v11
    MASK_BITS eax
    test    eax, eax
    jz      %%near
    VSPREAD v11, [r10 + ELEM * SphereCaster.lx]
    VMUL    v14, v11, v3
    VSELECT v6, v11
    VSPREAD v11, [r10 + ELEM * SphereCaster.ly]
    VMUL    v12, v11, v4
    VADD    v14, v14, v12
    VSELECT v7, v11
    VSPREAD v11, [r10 + ELEM * SphereCaster.lz]
    VMUL    v12, v11, v5
    VADD    v14, v14, v12
    VSELECT v8, v11
    VSELECT v13, v14
%%near:
    VMUL    v11, v7, v5
    VFNMA   v11, v8, v4, v14
    VMUL    v11, v11, v11
    VMUL    v12, v8, v3
    VFNMA   v12, v6, v5, v14
    VFMA    v11, v12, v12, v14
    VMUL    v12, v6, v4
    VFNMA   v12, v7, v3, v14
    VFMA    v11, v12, v12, v14          ; |q x g|^2, or |l x g|^2
    VMOV    v12, [SUM_OF_SQUARES]
    VSPREAD v6, [r10 + ELEM * SphereCaster.r2]
    VMOV    v7, v6
    VMUL    v7, v7, v12
    VSUB    v7, v7, v11
    VMUL    v11, v10, v10
    VMUL    v8, v9, v12
    VSUB    v11, v11, v8
    MASK_GREATER v6, v9
    VSELECT v7, v11
    VSPREAD v6, [r10 + ELEM * SphereCaster.most]
    VADD    v7, v7, v6                  ; D; infinite around the light, whatever rounding makes of it
    MASK_NOT_LESS v7, [PACKET(zeros)]
    MASK_AND_LESS v13, v6, v14          ; a wall is before the light
    ELEMENT_OPERAND [r10 + ELEM * SphereCaster.past], v14
    VADD    v10, v10, ONE
    VSPREAD v6, [r10 + ELEM * SphereCaster.bound]
    VMUL    v6, v6, [SUM_OF_SIZES]
    VSPREAD v7, [r10 + ELEM * SphereCaster.side]
    VFMA    v6, v7, v9, v14
    VZERO   v7
    VSUB    v7, v7, v6
    VMAX    v10, v10, v7
    VMOV    v7, [PACKET(zeros)]
    MASK_AND_GREATER v10, v7, v14       ; a wall is before P
    VSPREAD v14, [r10 + ELEM * SphereCaster.own]
    MASK_AND_UNEQUAL v14, [OWN], v13
%endmacro

; CASTERS_OF - the function for one kind of objects.
%macro CASTERS_OF 1
%define %%kind %1       ; [in]       triangle or sphere
%ifidn %%kind, triangle
%assign %%bytes ELEM * TriangleCaster_size
%else
%assign %%bytes ELEM * SphereCaster_size
%endif
FUNC ISA %+ _ %+ %%kind %+ _casters
    ENTER_OWNED 3 * VBYTES, VBYTES
    mov     rsi, [rdi + CastersTask.light]
    mov     r9, [rdi + CastersTask.casters]
    mov     r15, [rdi + CastersTask.met]
.group:
    mov     r14, r15
    mov     r12d, [r14]
    shr     r12d, ilog2e(MOST_CASTERS)
.of_group:
    add     r15, 4
    cmp     r15, [rdi + CastersTask.met_end]
    je      .group_ends
    mov     eax, [r15]
    shr     eax, ilog2e(MOST_CASTERS)
    cmp     eax, r12d
    je      .of_group
.group_ends:
    mov     rax, [rdi + CastersTask.groups]
    mov     r8d, [rax + 4 * r12 + LitGroups.open]
    mov     rdx, r12
    shl     rdx, ilog2e(GROUP * ELEM)
    add     rdx, [rdi + CastersTask.points]
    mov     rcx, r12
    shl     rcx, ilog2e(4 * GROUP)
    add     rcx, [rdi + CastersTask.points]
    lea     r11, [rcx + 4 * GROUP]
.points:
    mov     r13d, r8d
    and     r13d, (1 << LANES) - 1
    jz      .next_points
    VZERO   v3
    POINT   0
    POINT   1
    POINT   2
    WIDEN   v14, [rcx + TilePoints.own]
    VMOV_TO [OWN], v14
%ifidn %%kind, sphere
    VMOV_TO [SUM_OF_SIZES], v3
    TO_LIGHT 3, 0
    TO_LIGHT 4, 1
    TO_LIGHT 5, 2
    VMUL    v6, v3, v3
    VFMA    v6, v4, v4, v14
    VFMA    v6, v5, v5, v14
    VMOV_TO [SUM_OF_SQUARES], v6
%endif
    mov     rbx, r14
.caster:
    movzx   r10d, byte [rbx]
    imul    r10, r10, %%bytes
    add     r10, r9
%ifidn %%kind, triangle
    TRIANGLE_HIDES
%else
    SPHERE_HIDES
%endif
    MASK_BITS eax
    not     eax
    and     r13d, eax
    jz      .next_points
    add     rbx, 4
    cmp     rbx, r15
    jb      .caster
.next_points:
    shr     r8d, LANES
    shl     r13d, GROUP - LANES
    or      r8d, r13d
    add     rdx, VBYTES
    add     rcx, 4 * LANES
    cmp     rcx, r11
    jb      .points
    mov     rax, [rdi + CastersTask.groups]
    mov     [rax + 4 * r12 + LitGroups.open], r8d
    cmp     r15, [rdi + CastersTask.met_end]
    jb      .group
    LEAVE_OWNED
ENDFUNC
%endmacro

; CASTERS - defines the functions of this file.
%macro CASTERS 0
    CASTERS_OF triangle
    CASTERS_OF sphere
%endmacro
