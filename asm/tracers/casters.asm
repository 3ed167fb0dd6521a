; casters.asm - which points of a tile a light does not reach, since one of some objects lies between: exact shadows.
;
; An object hides a light L from a point P of another object if it meets the segment between them. A triangle does if P
; is on the other side of its plane than L, and within its edges as L sees them: on the inner side of the planes
; through L and each edge, eq. 10 asked from the light. A sphere does if the line through P and L meets it, eq. 5 asked
; from P with g = L - P and q = c - P: D = (g.q)^2 - g.g (q.q - r^2) near it, r^2 g.g - |q x g|^2 from afar; and if one
; of the two walls is between. What P's rounding may explain does not hide.
;
; Assembled once per ISA, in f64. The functions:
;
;   rayo_<isa>_triangle_casters, rayo_<isa>_sphere_casters
;       unsafe extern "sysv64" fn(task: *const CastersTask) -> u64
;
;   Returns those of the open points that none of the objects hides; none is hidden by the object that it belongs to.
;   Objects whose bounds, as the light sees them, do not meet the points' are culled first.
;
;   registers   rdi task, later the open points of a register; rsi light, rdx points, r8d the points that are open;
;               r9 a bit for each caster that is left, rcx those that are still to come, r10 a caster, r11d the points
;               of a register that are hidden; v0 v1 v2 P, v3 the sum of its magnitudes; for spheres v3 v4 v5 g, and
;               in memory that sum and g.g
;   requires    the CPUID features of the ISA; all addresses valid for what is read; 1 to 16 casters
;   equals      kernels::portable::shadows::open

%assign GROUP 16                        ; points of a call
%define SUM_OF_SIZES rsp                ; |P|, the sum of magnitudes of a register's points
%define SUM_OF_SQUARES rsp + VBYTES     ; g.g

; MAGNITUDE - d = |a|.
;
;   instructions   1   sse41 2 where d is not a
%macro MAGNITUDE 2
%define %%d %1          ; [out]      vreg
%define %%a %2          ; [in]       vreg
    VAND    %%d, %%a, [PACKET(magnitude)]
%endmacro

; POINT - v<n> = coordinate n of points, and v3 = v3 + its magnitude. Clobbers v14.
%macro POINT 2
%define %%n %1          ; [in]       0, 1 or 2
%define %%at %2         ; [in]       of the first point of a register, in points
    VMOV    v%[%%n], [rdx + ELEM * (TilePoints_size / 4 * %%n + %%at)]
    MAGNITUDE v14, v%[%%n]
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
%macro TRIANGLE_HIDES 1
%define %%own %1        ; [in]       memory: whose points they are
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
    VMUL    v11, v7, v5
    VFNMA   v11, v8, v4, v14
    VMUL    v11, v11, v11
    VMUL    v12, v8, v3
    VFNMA   v12, v6, v5, v14
    VFMA    v11, v12, v12, v14
    VMUL    v12, v6, v4
    VFNMA   v12, v7, v3, v14
    VFMA    v11, v12, v12, v14          ; |q x g|^2
    VMOV    v12, [SUM_OF_SQUARES]
    VSPREAD v6, [r10 + ELEM * SphereCaster.r2]
    VMOV    v7, v6
    VMUL    v7, v7, v12
    VSUB    v7, v7, v11
    VMUL    v11, v10, v10
    VMUL    v8, v9, v12
    VSUB    v11, v11, v8
    MASK_GREATER v6, v9
    VSELECT v7, v11                     ; D
    MASK_NOT_LESS v7, [PACKET(zeros)]
    VSUB    v11, v10, v12
    VSPREAD v6, [r10 + ELEM * SphereCaster.most]
    MASK_AND_LESS v11, v6, v14          ; a wall is before the light
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
    MASK_AND_UNEQUAL v14, %%own, v13
%endmacro

%assign FLOATS VBYTES / 4               ; bounds in a register

; MEETS - eax = a bit for each of FLOATS casters, from a number on, whose bounds, at r9, meet those in v0 to v3.
;         Clobbers v4 and v5 without mask registers.
;
;   instructions   sse41 12   avx2 8   avx512 5
%macro MEETS 1
%define %%first %1      ; [in]       number of the first
%if HAS_MASKS
    vcmpps  k1, v0, [r9 + 4 * %%first + CasterBounds.x], 13     ; 13: greater or equal
    vcmpps  k1 {k1}, v1, [r9 + 4 * %%first + CasterBounds.y], 13
    vcmpps  k1 {k1}, v2, [r9 + 4 * %%first + CasterBounds.past_x], 13
    vcmpps  k1 {k1}, v3, [r9 + 4 * %%first + CasterBounds.past_y], 13
    kmovw   eax, k1
%elif HAS_VEX
    vcmpps  v4, v0, [r9 + 4 * %%first + CasterBounds.x], 13
    vcmpps  v5, v1, [r9 + 4 * %%first + CasterBounds.y], 13
    vandps  v4, v4, v5
    vcmpps  v5, v2, [r9 + 4 * %%first + CasterBounds.past_x], 13
    vandps  v4, v4, v5
    vcmpps  v5, v3, [r9 + 4 * %%first + CasterBounds.past_y], 13
    vandps  v4, v4, v5
    vmovmskps eax, v4
%else
    movaps  v4, [r9 + 4 * %%first + CasterBounds.x]
    cmpps   v4, v0, 2                   ; 2: less or equal
    movaps  v5, [r9 + 4 * %%first + CasterBounds.y]
    cmpps   v5, v1, 2
    andps   v4, v5
    movaps  v5, [r9 + 4 * %%first + CasterBounds.past_x]
    cmpps   v5, v2, 2
    andps   v4, v5
    movaps  v5, [r9 + 4 * %%first + CasterBounds.past_y]
    cmpps   v5, v3, 2
    andps   v4, v5
    movmskps eax, v4
%endif
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
    push    rbp
    mov     rbp, rsp
    push    rbx
    sub     rsp, 2 * VBYTES
    and     rsp, -VBYTES
    mov     rax, [rdi + CastersTask.seen]
%assign %%i 0
%rep 4
%if HAS_VEX
    vbroadcastss v%[%%i], [rax + 4 * %%i]
%else
    movss   v%[%%i], [rax + 4 * %%i]
    shufps  v%[%%i], v%[%%i], 0
%endif
%assign %%i %%i + 1
%endrep
    mov     r9, [rdi + CastersTask.bounds]
    mov     r10, [rdi + CastersTask.count]
    xor     ebx, ebx
%assign %%i 0
%rep 16 / FLOATS
    MEETS   %%i
%if %%i > 0
    shl     eax, %%i
%endif
    or      ebx, eax
%assign %%i %%i + FLOATS
%endrep
    xor     r9d, r9d                    ; beyond the last is anything
    bts     r9d, r10d
    dec     r9d
    mov     r8d, [rdi + CastersTask.open]
    and     r9d, ebx
    jz      .done
    mov     rsi, [rdi + CastersTask.light]
    mov     rdx, [rdi + CastersTask.points]
    mov     rbx, [rdi + CastersTask.casters]
%assign %%at 0
%rep GROUP / LANES
    mov     edi, r8d
%if %%at > 0
    shr     edi, %%at
%endif
    and     edi, (1 << LANES) - 1
    jz      .next%[%%at]
    VZERO   v3
    POINT   0, %%at
    POINT   1, %%at
    POINT   2, %%at
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
    xor     r11d, r11d
    mov     ecx, r9d
.caster%[%%at]:
    bsf     r10d, ecx
    imul    r10, r10, %%bytes
    add     r10, rbx
%ifidn %%kind, triangle
    TRIANGLE_HIDES [rdx + ELEM * (TilePoints.own + %%at)]
%else
    SPHERE_HIDES [rdx + ELEM * (TilePoints.own + %%at)]
%endif
    MASK_BITS eax
    or      r11d, eax
    mov     eax, r11d
    and     eax, edi
    cmp     eax, edi
    je      .all%[%%at]
    lea     eax, [rcx - 1]
    and     ecx, eax
    jnz     .caster%[%%at]
.all%[%%at]:
%if %%at > 0
    shl     r11d, %%at
%endif
    not     r11d
    and     r8d, r11d
.next%[%%at]:
%assign %%at %%at + LANES
%endrep
.done:
    mov     eax, r8d
    mov     rbx, [rbp - 8]
    mov     rsp, rbp
    pop     rbp
    CLEAN_UPPER
ENDFUNC
%endmacro

; CASTERS - the functions of this file.
%macro CASTERS 0
    CASTERS_OF triangle
    CASTERS_OF sphere
%endmacro
