; casters.asm - which points of a tile a light does not reach, since one of some objects lies between: exact shadows.
;
; An object hides a light L from a point P of another object if it meets the segment between them. A triangle does if P
; is on the other side of its plane than L, and within its edges as L sees them: on the inner side of the planes
; through L and each edge, eq. 10 asked from the light. A sphere does if the line through P and L meets it, eq. 5 asked
; from P with g = L - P and q = c - P: D = (g.q)^2 - g.g (q.q - r^2) near it, r^2 g.g - |q x g|^2 from afar, where l =
; c - L stands for q if it is much shorter; and if one of the two walls is between. What P's rounding may explain does
; not hide.
;
; Assembled once per ISA, in f64. The functions:
;
;   rayo_<isa>_triangle_casters, rayo_<isa>_sphere_casters
;       unsafe extern "sysv64" fn(task: *const CastersTask)
;
;   Leaves open those of the open points of groups that none of the objects hides; none is hidden by the object that it
;   belongs to. First the objects are culled whose bounds, as the light sees them, do not meet those of a group: blocks
;   of 16, for FLOATS groups at once, then each of a block, and the object that all of its points belong to.
;
;   registers   rdi task, r12 the group, from which LitGroups' fields are counted; ebx those of its BLOCKS that are
;               left; rsi light, rdx points, r8d the points that are open, r13d those still so; r9 casters, r10 one
;               of them, whose fields are 16 elements apart; at LEFT those that are left, up to r15, and r14 those that
;               are still to come; v0 v1 v2 P, v3 the sum of its magnitudes; for spheres v3 v4 v5 g, and in memory that
;               sum and g.g
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written; x of bounds beyond the
;               last caster and the last block is no number
;   equals      kernels::portable::shadows::open

%define SUM_OF_SIZES rsp                ; |P|, the sum of magnitudes of a register's points
%define SUM_OF_SQUARES rsp + VBYTES     ; g.g
%define BLOCKS rsp + 2 * VBYTES         ; for each group a bit for each block that it meets
%define LEFT BLOCKS + 4 * TILE_WIDTH * TILE_HEIGHT / GROUP  ; offsets of casters

; POINT - v<n> = coordinate n of the points at rdx, and v3 = v3 + its magnitude. Clobbers v14.
%macro POINT 1
%define %%n %1          ; [in]       0, 1 or 2
    VMOV    v%[%%n], [rdx + ELEM * TilePoints_size / 4 * %%n]
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
    VSPREAD %%d, [r10 + ELEM * (%%field + 3 * 16)]
    ELEMENT_OPERAND [r10 + ELEM * %%field], v14
    VFMA    %%d, v0, ONE, v13
    ELEMENT_OPERAND [r10 + ELEM * (%%field + 16)], v14
    VFMA    %%d, v1, ONE, v13
    ELEMENT_OPERAND [r10 + ELEM * (%%field + 2 * 16)], v14
    VFMA    %%d, v2, ONE, v13
%endmacro

; TRIANGLE_HIDES - the mask = the points that the triangle at r10 hides from the light. Clobbers v6 to v9, v13, v14.
;
;   equals        kernels::portable::shadows::triangle_hides
%macro TRIANGLE_HIDES 1
%define %%own %1        ; [in]       memory: whose points they are
    PLANE_OF_CASTER v6, TriangleCasters.e1x
    PLANE_OF_CASTER v7, TriangleCasters.e2x
    PLANE_OF_CASTER v8, TriangleCasters.e3x
    PLANE_OF_CASTER v9, TriangleCasters.px
    ELEMENT_OPERAND [r10 + ELEM * TriangleCasters.bound], v14
    VFMA    v9, v3, ONE, v13
    VMIN    v6, v6, v7
    VMIN    v6, v6, v8
    MASK_NOT_LESS v6, [PACKET(zeros)]
    MASK_AND_LESS v9, [PACKET(zeros)], v13
    VSPREAD v14, [r10 + ELEM * TriangleCasters.own]
    MASK_AND_UNEQUAL v14, %%own, v13
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
%macro SPHERE_HIDES 1
%define %%own %1        ; [in]       memory: whose points they are
    LESS_CASTER v6, v0, SphereCasters.ux
    LESS_CASTER v7, v0, SphereCasters.wx
    VMUL    v9, v6, v7
    LESS_CASTER v6, v1, SphereCasters.uy
    LESS_CASTER v7, v1, SphereCasters.wy
    VFMA    v9, v6, v7, v14
    LESS_CASTER v6, v2, SphereCasters.uz
    LESS_CASTER v7, v2, SphereCasters.wz
    VFMA    v9, v6, v7, v14
    ELEMENT_OPERAND [r10 + ELEM * SphereCasters.k], v14
    VADD    v9, v9, ONE                 ; q.q - r^2
    VSPREAD v6, [r10 + ELEM * SphereCasters.x]
    VSUB    v6, v6, v0
    VSPREAD v7, [r10 + ELEM * SphereCasters.y]
    VSUB    v7, v7, v1
    VSPREAD v8, [r10 + ELEM * SphereCasters.z]
    VSUB    v8, v8, v2                  ; q
    VMUL    v10, v6, v3
    VFMA    v10, v7, v4, v14
    VFMA    v10, v8, v5, v14            ; h = g.q
    VMOV    v12, [SUM_OF_SQUARES]
    VSUB    v13, v10, v12               ; g.l = g.q - g.g
    VSPREAD v11, [r10 + ELEM * SphereCasters.far]
    MASK_GREATER v9, v11
    MASK_BITS eax
    test    eax, eax
    jz      %%near
    VSPREAD v11, [r10 + ELEM * SphereCasters.lx]
    VMUL    v14, v11, v3
    VSELECT v6, v11
    VSPREAD v11, [r10 + ELEM * SphereCasters.ly]
    VMUL    v12, v11, v4
    VADD    v14, v14, v12
    VSELECT v7, v11
    VSPREAD v11, [r10 + ELEM * SphereCasters.lz]
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
    VSPREAD v6, [r10 + ELEM * SphereCasters.r2]
    VMOV    v7, v6
    VMUL    v7, v7, v12
    VSUB    v7, v7, v11
    VMUL    v11, v10, v10
    VMUL    v8, v9, v12
    VSUB    v11, v11, v8
    MASK_GREATER v6, v9
    VSELECT v7, v11
    VSPREAD v6, [r10 + ELEM * SphereCasters.most]
    VADD    v7, v7, v6                  ; D; infinite around the light, whatever rounding makes of it
    MASK_NOT_LESS v7, [PACKET(zeros)]
    MASK_AND_LESS v13, v6, v14          ; a wall is before the light
    ELEMENT_OPERAND [r10 + ELEM * SphereCasters.past], v14
    VADD    v10, v10, ONE
    VSPREAD v6, [r10 + ELEM * SphereCasters.bound]
    VMUL    v6, v6, [SUM_OF_SIZES]
    VSPREAD v7, [r10 + ELEM * SphereCasters.side]
    VFMA    v6, v7, v9, v14
    VZERO   v7
    VSUB    v7, v7, v6
    VMAX    v10, v10, v7
    VMOV    v7, [PACKET(zeros)]
    MASK_AND_GREATER v10, v7, v14       ; a wall is before P
    VSPREAD v14, [r10 + ELEM * SphereCasters.own]
    MASK_AND_UNEQUAL v14, %%own, v13
%endmacro

%assign FLOATS VBYTES / 4               ; bounds in a register

; MEETS - the lanes of k1, or of v6, where the ends in v0 to v4 meet bounds and, with six fields, v5 is not their own.
;         Clobbers v7 and v8.
;
;   equals        kernels::shadows::CasterList::meeting
%macro MEETS 3
%define %%at %1         ; [in]       address of bounds
%define %%fields %2     ; [in]       5 or 6
%define %%spread %3     ; [in]       1: of one with all lanes; 0: of FLOATS each with its lane
%assign %%n 0
%rep %%fields
%define %%of [%%at + CasterBounds_size / 6 * %%n]
%if %%n < 5
%assign %%relation 2                    ; less or equal
%else
%assign %%relation 4                    ; not equal
%endif
%if %%spread && HAS_MASKS
%define %%of dword [%%at + CasterBounds_size / 6 * %%n] {1to16}
%elif %%spread
    SPREAD_FLOAT 7, %%of
%define %%of v7
%endif
%if HAS_MASKS && %%n == 0
    vcmpps  k1, v%[%%n], %%of, %%relation
%elif HAS_MASKS
    vcmpps  k1 {k1}, v%[%%n], %%of, %%relation
%elif HAS_VEX && %%n == 0
    vcmpps  v6, v%[%%n], %%of, %%relation
%elif HAS_VEX
    vcmpps  v7, v%[%%n], %%of, %%relation
    vandps  v6, v6, v7
%else
    movaps  v8, v%[%%n]
    cmpps   v8, %%of, %%relation
%if %%n == 0
    movaps  v6, v8
%else
    andps   v6, v8
%endif
%endif
%assign %%n %%n + 1
%endrep
%endmacro

; SPREAD_FLOAT - v<n> = an f32 in every lane.
;
;   instructions   sse41 2   avx2, avx512 1
%macro SPREAD_FLOAT 2
%define %%n %1          ; [out]      number of a register
%define %%of %2         ; [in]       memory
%if HAS_VEX
    vbroadcastss v%[%%n], %%of
%else
    movss   v%[%%n], %%of
    shufps  v%[%%n], v%[%%n], 0
%endif
%endmacro

; CASTERS_OF - the function for one kind of objects.
%macro CASTERS_OF 1
%define %%kind %1       ; [in]       triangle or sphere
%ifidn %%kind, triangle
%assign %%bytes ELEM * TriangleCasters_size
%else
%assign %%bytes ELEM * SphereCasters_size
%endif
FUNC ISA %+ _ %+ %%kind %+ _casters
    ENTER_OWNED 2 * VBYTES + 4 * (TILE_WIDTH * TILE_HEIGHT / GROUP + MOST_CASTERS + 16), VBYTES
    mov     rax, [rdi + CastersTask.groups]
    xor     r12d, r12d
.groups:
%assign %%n 0
%rep 5
    VMOV    v%[%%n], [rax + r12 + LitGroups_size / 7 * %%n]
%assign %%n %%n + 1
%endrep
    VZERO   v9
    VMOV    v10, [PACKET(first_bit)]
    mov     r9, [rdi + CastersTask.blocks]
    mov     r10, [rdi + CastersTask.block_count]
.groups_block:
    MEETS   r9, 5, 1
%if HAS_MASKS
    vmovaps v7 {k1} {z}, v10
    IOR     v9, v9, v7
%else
    IOP     pand, v6, v6, v10
    IOR     v9, v9, v6
%endif
    IOP     paddd, v10, v10, v10
    add     r9, 4
    dec     r10d
    jnz     .groups_block
    VMOV_TO [BLOCKS + r12], v9
    add     r12d, VBYTES
    cmp     r12d, 4 * TILE_WIDTH * TILE_HEIGHT / GROUP
    jb      .groups

    xor     r12d, r12d
.group:
    mov     rax, [rdi + CastersTask.groups]
    add     rax, r12
    mov     r8d, [rax + LitGroups.open]
    mov     ebx, [BLOCKS + r12]
    test    r8d, r8d
    jz      .next_group
    test    ebx, ebx
    jz      .next_group
%assign %%n 0
%rep 6
    SPREAD_FLOAT %%n, [rax + LitGroups_size / 7 * %%n]
%assign %%n %%n + 1
%endrep
    lea     r15, [LEFT]
.block:
    bsf     ecx, ebx
    jz      .blocks_done
    lea     eax, [rbx - 1]
    and     ebx, eax
    imul    r9, rcx, CasterBounds_size
    imul    r10, rcx, %%bytes
    add     r9, [rdi + CastersTask.bounds]
%if HAS_MASKS
    MEETS   r9, 6, 0
    kmovw   eax, k1
    vpbroadcastd v6, r10d
    vpaddd  v6, v6, [PACKET(of_block)]
    vpcompressd v6 {k1} {z}, v6
    VSTORE  [r15], v6
    popcnt  eax, eax
    lea     r15, [r15 + 4 * rax]
%else
%assign %%first 0
%rep 16 / FLOATS
    MEETS   r9 + 4 * %%first, 6, 0
%if HAS_VEX
    vmovmskps eax, v6
%else
    movmskps eax, v6
%endif
    test    eax, eax
    jz      .culled%[%%first]
.meets%[%%first]:
    bsf     ecx, eax
    lea     ecx, [r10 + ELEM * (rcx + %%first)]
    mov     [r15], ecx
    add     r15, 4
    lea     ecx, [rax - 1]
    and     eax, ecx
    jnz     .meets%[%%first]
.culled%[%%first]:
%assign %%first %%first + FLOATS
%endrep
%endif
    jmp     .block
.blocks_done:
    lea     r14, [LEFT]
    cmp     r14, r15
    je      .next_group
    mov     rsi, [rdi + CastersTask.light]
    mov     r9, [rdi + CastersTask.casters]
    mov     rdx, r12
    shl     rdx, ilog2e(GROUP * ELEM / 4)
    add     rdx, [rdi + CastersTask.points]
    mov     r11d, GROUP / LANES
.points:
    mov     r13d, r8d
    and     r13d, (1 << LANES) - 1
    jz      .next_points
    VZERO   v3
    POINT   0
    POINT   1
    POINT   2
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
    lea     r14, [LEFT]
.caster:
    mov     r10d, [r14]
    add     r10, r9
%ifidn %%kind, triangle
    TRIANGLE_HIDES [rdx + ELEM * TilePoints.own]
%else
    SPHERE_HIDES [rdx + ELEM * TilePoints.own]
%endif
    MASK_BITS eax
    not     eax
    and     r13d, eax
    jz      .next_points
    add     r14, 4
    cmp     r14, r15
    jb      .caster
.next_points:
    shr     r8d, LANES
    shl     r13d, GROUP - LANES
    or      r8d, r13d
    add     rdx, VBYTES
    dec     r11d
    jnz     .points
    mov     rax, [rdi + CastersTask.groups]
    mov     [rax + r12 + LitGroups.open], r8d
.next_group:
    add     r12, 4
    cmp     r12d, 4 * TILE_WIDTH * TILE_HEIGHT / GROUP
    jb      .group
    LEAVE_OWNED
ENDFUNC
%endmacro

; CASTERS - the functions of this file.
%macro CASTERS 0
    CASTERS_OF triangle
    CASTERS_OF sphere
%endmacro
