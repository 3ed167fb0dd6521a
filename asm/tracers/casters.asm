; casters.asm - which points of a tile a light does not reach, since one of some objects lies between: exact shadows.
;
; A light is a camera: from it a ray e = P - L leads to each visible point P, and an object that this ray meets before
; it is at P, at 0 < t < 1, hides the light. That is asked by the tests of nearest.asm, but at points in place of
; pixels' middles: of a triangle by its edges, e . (v x w) >= 0, and its plane, 1/t = p . e > 1; of a sphere by its
; discriminant, and where P is: beyond the wall that the ray meets first. So much as P's rounding may explain does not
; hide.
;
; Assembled once per ISA, in f64. The functions:
;
;   rayo_<isa>_triangle_casters, rayo_<isa>_sphere_casters      unsafe extern "sysv64" fn(task: *const CastersTask) -> u64
;
;   Returns those of the open points that none of the objects hides; none is hidden by the object that it belongs to.
;   Objects whose bounds, as the light sees them, do not meet the points' are culled first.
;
;   registers   rdi task, later the open points of a register; rsi light, rdx points, r8d the points that are open;
;               r9 the list of addresses of casters on the stack, rcx its end, r10 a caster, r11d the points of a register
;               that are hidden; v0 v1 v2 e, v3 the bound of P's rounding, v4 whose points they are, v5 e . e
;   requires    the CPUID features of the ISA; all addresses valid for what is read; 1 to CHUNK casters
;   equals      kernels::portable::shadows::open

%assign GROUP 16                        ; points of a call

; MAGNITUDE - d = |a|.
;
;   instructions   1   sse41 2 where d is not a
%macro MAGNITUDE 2
%define %%d %1          ; [out]      vreg
%define %%a %2          ; [in]       vreg
    VAND    %%d, %%a, [PACKET(magnitude)]
%endmacro

; FROM_LIGHT - v<n> = coordinate n of e of the points at rdx, and v3 = v3 + the magnitude of theirs. Clobbers v14.
;
;   instructions   sse41 6   avx2 5   avx512 4
%macro FROM_LIGHT 2
%define %%n %1          ; [in]       0, 1 or 2
%define %%at %2         ; [in]       of the first point of a register, in points
    VLOAD   v%[%%n], [rdx + ELEM * (TilePoints_size / 4 * %%n + %%at)]
    MAGNITUDE v14, v%[%%n]
    VADD    v3, v3, v14
    ELEMENT_OPERAND [rsi + ELEM * %%n], v14
    VSUB    v%[%%n], v%[%%n], ONE
%endmacro

; DOT_OF_CASTER - d = e . a vector of the caster at r10. Clobbers v13, v14.
;
;   instructions   sse41 11   avx2 6   avx512 3
;   critical path  mul -> fma -> fma
%macro DOT_OF_CASTER 2
%define %%d %1          ; [out]      vreg
%define %%field %2      ; [in]       of its first coordinate
    ELEMENT_OPERAND [r10 + ELEM * %%field], v14
    VMUL    %%d, v0, ONE
    ELEMENT_OPERAND [r10 + ELEM * (%%field + 1)], v14
    VFMA    %%d, v1, ONE, v13
    ELEMENT_OPERAND [r10 + ELEM * (%%field + 2)], v14
    VFMA    %%d, v2, ONE, v13
%endmacro

; TRIANGLE_HIDES - the mask = the points that the triangle at r10 hides from the light. Clobbers v6 to v9, v13, v14.
;
;   instructions   sse41 60   avx2 35   avx512 19
%macro TRIANGLE_HIDES 0
    DOT_OF_CASTER v6, TriangleCaster.e1x
    DOT_OF_CASTER v7, TriangleCaster.e2x
    DOT_OF_CASTER v8, TriangleCaster.e3x
    DOT_OF_CASTER v9, TriangleCaster.px
    ELEMENT_OPERAND [r10 + ELEM * TriangleCaster.bound], v14
    VFNMA   v9, v3, ONE, v13
    VMIN    v6, v6, v7
    VMIN    v6, v6, v8
    MASK_NOT_LESS v6, [PACKET(zeros)]
    VMOV    v7, [PACKET(ones)]
    MASK_AND_GREATER v9, v7, v13
    ELEMENT_OPERAND [r10 + ELEM * TriangleCaster.own], v14
    MASK_AND_UNEQUAL v4, ONE, v13
%endmacro

; SPHERE_HIDES - the mask = the points that the sphere at r10 hides from the light. Clobbers v6 to v14.
;
;   instructions   sse41 67   avx2 39   avx512 30
%macro SPHERE_HIDES 0
    VSPREAD v8, [r10 + ELEM * SphereCaster.x]
    VSPREAD v9, [r10 + ELEM * SphereCaster.y]
    VSPREAD v10, [r10 + ELEM * SphereCaster.z]
    VMUL    v6, v0, v8
    VFMA    v6, v1, v9, v13
    VFMA    v6, v2, v10, v13            ; h
    VMUL    v7, v9, v2
    VFNMA   v7, v10, v1, v13
    VMUL    v11, v7, v7
    VMUL    v7, v10, v0
    VFNMA   v7, v8, v2, v13
    VFMA    v11, v7, v7, v13
    VMUL    v7, v8, v1
    VFNMA   v7, v9, v0, v13
    VFMA    v11, v7, v7, v13            ; |c x e|^2
    VMOV    v7, v5
    ELEMENT_OPERAND [r10 + ELEM * SphereCaster.r2], v14
    VFMSUB  v7, ONE, v11                ; D
    MASK_NOT_LESS v7, [PACKET(zeros)]
    VSPREAD v12, [r10 + ELEM * SphereCaster.least]
    MASK_AND_GREATER v6, v12, v13
    ELEMENT_OPERAND [r10 + ELEM * SphereCaster.k], v14
    VADD    v7, v5, ONE
    VSUB    v7, v7, v6
    VSUB    v7, v7, v6                  ; above 0 where P is outside
    ELEMENT_OPERAND [r10 + ELEM * SphereCaster.bound], v14
    VADD    v11, v3, ONE
    ELEMENT_OPERAND [r10 + ELEM * SphereCaster.side], v14
    VFMA    v11, v7, ONE, v13           ; below 0 where P is on the other side than the light
    VSUB    v6, v6, v5                  ; below 0 where P is beyond the middle
    ELEMENT_OPERAND [r10 + ELEM * SphereCaster.past], v14
    VADD    v6, v6, ONE
    VMIN    v6, v6, v11
    MASK_AND_LESS v6, [PACKET(zeros)], v13
    ELEMENT_OPERAND [r10 + ELEM * SphereCaster.own], v14
    MASK_AND_UNEQUAL v4, ONE, v13
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
    sub     rsp, 8 * CHUNK
    mov     rsi, [rdi + CastersTask.light]
    mov     rdx, [rdi + CastersTask.points]
    mov     r8d, [rdi + CastersTask.open]
    mov     rcx, [rdi + CastersTask.count]
    mov     r10, [rdi + CastersTask.casters]
    mov     r9, [rdi + CastersTask.bounds]
    mov     rax, [rdi + CastersTask.seen]
    VEX(movups) x0, [rax]
    xor     eax, eax
.cull:
    mov     [rsp + 8 * rax], r10
    VEX(movups) x1, [r9]
%if HAS_VEX
    vcmpps  x1, x1, x0, 2               ; 2: less or equal
%else
    cmpps   x1, x0, 2
%endif
    VEX(movmskps) edi, x1
    xor     edi, 15
    sub     edi, 1                      ; carries where all four are
    adc     eax, 0
    add     r10, %%bytes
    add     r9, 16
    dec     rcx
    jnz     .cull
    test    eax, eax
    jz      .done
    lea     rcx, [rsp + 8 * rax]
%assign %%at 0
%rep GROUP / LANES
    mov     edi, r8d
%if %%at > 0
    shr     edi, %%at
%endif
    and     edi, (1 << LANES) - 1
    jz      .next%[%%at]
    VSPREAD v3, [rsi + ELEM * 3]
    FROM_LIGHT 0, %%at
    FROM_LIGHT 1, %%at
    FROM_LIGHT 2, %%at
    VLOAD   v4, [rdx + ELEM * (TilePoints.own + %%at)]
%ifidn %%kind, sphere
    VMUL    v3, v3, [PACKET(rounding)]
    VMUL    v3, v3, v3
    VMUL    v5, v0, v0
    VFMA    v5, v1, v1, v13
    VFMA    v5, v2, v2, v13
%endif
    xor     r11d, r11d
    mov     r9, rsp
.caster%[%%at]:
    mov     r10, [r9]
%ifidn %%kind, triangle
    TRIANGLE_HIDES
%else
    SPHERE_HIDES
%endif
    MASK_BITS eax
    or      r11d, eax
    mov     eax, r11d
    and     eax, edi
    cmp     eax, edi
    je      .all%[%%at]
    add     r9, 8
    cmp     r9, rcx
    jb      .caster%[%%at]
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
    add     rsp, 8 * CHUNK
    CLEAN_UPPER
ENDFUNC
%endmacro

; CASTERS - the functions of this file.
%macro CASTERS 0
    CASTERS_OF triangle
    CASTERS_OF sphere
%endmacro
