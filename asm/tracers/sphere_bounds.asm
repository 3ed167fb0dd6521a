; sphere_bounds.asm - the bounds of the pixels that each of many spheres can cover, LANES spheres in lockstep, in f64.
;
; unsafe extern "sysv64" fn(view: *const SphereView<f64>, task: *const BoundsTask)
;
;   A sphere wholly in front of the camera's plane, with the camera outside, covers only pixels within the box of its
;   silhouette; one wholly behind that plane covers none, and its upper bound of 1/t is 0. Any other one, which is left
;   to around.asm, gets the whole picture and the largest f32 as that bound. The largest f32, but its own box, also
;   marks a sphere whose outline reaches so far to the side that its planes may lose digits, k > 2 (cz^2 - 1): the plan
;   decides how it is traced.
;
;   registers   rdi view, whose fields are the constants K; rsi task; rdx spheres, rcx spheres left, r8 spheres
;               transposed, r9 the next id, r10 candidates, r11 packets left, r15 the last sphere
;               v12, v13 the greatest and the least size so far, v14 the brightest colour, as bits of f32
;   writes      as bounds.asm does; the greatest size is of the radii and |coordinates|, the least of the radii alone
;   requires    the CPUID features of the ISA; count >= 1 spheres
;   equals      kernels::portable::spheres::bounds, to the last bit

; PIXELS_BETWEEN - v<f>, v<p> = the first pixel and one past the last between two coordinates.
;   equals      kernels::portable::spheres::bounds_of
%macro PIXELS_BETWEEN 3
%define %%f %1          ; [in/out]   vreg
%define %%p %2          ; [in/out]   vreg
%define %%side %3       ; [in]       field: pixels of the picture along the axis
    VSUB    %%f, %%f, [PACKET(outline)]
    VADD    %%p, %%p, [PACKET(outline)]
    VROUND  %%f, %%f, UP
    VROUND  %%p, %%p, DOWN
    VADD    %%p, %%p, [PACKET(ones)]
    VMAX    %%f, %%f, [PACKET(zeros)]
    VMAX    %%p, %%p, [PACKET(zeros)]
    VMIN    %%f, %%f, K(SphereView. %+ %%side)
    VMIN    %%p, %%p, K(SphereView. %+ %%side)
%endmacro

; SPHERE_BOUNDS - defines the kernel, which the head of this file describes.
%macro SPHERE_BOUNDS 0
FUNC ISA %+ _sphere_bounds
    BEGIN_BOUNDS 8, [single_magnitude]
.chunk:
    TRANSPOSE_CHUNK Sphere_size, TRANSPOSE_SPHERES

    ; A register of f32 at a time.
    mov     r8, [rsi + BoundsTask.arrays]
    mov     r11d, 4 * CHUNK / VBYTES
.sizes:
    VMOV    v0, [r8 + SphereArrays.radius]
    IOP     pminud, v13, v13, v0
    IOP     pmaxud, v12, v12, v0
    VMOV    v0, [r8 + SphereArrays.x]
    VAND    v0, v0, [single_magnitude]
    IOP     pmaxud, v12, v12, v0
    VMOV    v0, [r8 + SphereArrays.y]
    VAND    v0, v0, [single_magnitude]
    IOP     pmaxud, v12, v12, v0
    VMOV    v0, [r8 + SphereArrays.z]
    VAND    v0, v0, [single_magnitude]
    IOP     pmaxud, v12, v12, v0
    IOP     pmaxud, v14, v14, [r8 + SphereArrays.red]
    IOP     pmaxud, v14, v14, [r8 + SphereArrays.green]
    IOP     pmaxud, v14, v14, [r8 + SphereArrays.blue]
    add     r8, VBYTES
    dec     r11d
    jnz     .sizes

    mov     r8, [rsi + BoundsTask.arrays]
    mov     r11d, CHUNK / LANES
.packet:
    WIDEN   v3, [r8 + SphereArrays.radius]
    WIDEN   v0, [r8 + SphereArrays.x]
    WIDEN   v1, [r8 + SphereArrays.y]
    WIDEN   v2, [r8 + SphereArrays.z]
    VSUB    v4, v2, v3
    KLOAD   v10, SphereView.most
    VDIV    v10, v10, v4
    VDIV    v0, v0, v3
    VDIV    v1, v1, v3
    VDIV    v2, v2, v3
    DOT3_UNFUSED v4, v0, v1, v2, v0, v1, v2, v9, v9
    SPHERE_BOX v5, v6, v7, v8, v0, v1, v2, v9, v11, v3
    PIXELS_BETWEEN v5, v6, width
    PIXELS_BETWEEN v7, v8, height
    MASK_NOT_LESS v2, [PACKET(front)]
    MASK_AND_LESS v4, [PACKET(infinite)], v9
    MASK_KEEP v5
    MASK_KEEP v7
    KLOAD   v9, SphereView.width
    VSELECT v9, v6
    KLOAD   v11, SphereView.height
    VSELECT v11, v8
    VMUL    v0, v2, v2
    VADD    v0, v0, v0
    VSUB    v0, v0, [PACKET(ones)]      ; 2 m + 1, to compare with c.c = k + 1
    MASK_AND_NOT_LESS v0, v4, v1
    VMOV    v3, [PACKET(largest)]
    VSELECT v3, v10
    MASK_GREATER v2, [PACKET(minus_ones)]
    MASK_KEEP v3
    MASK_KEEP v9
    MASK_KEEP v11
    VSUB    v0, v9, v5
    VSUB    v1, v11, v7
    VMIN    v0, v0, v1
    MASK_GREATER v0, [PACKET(zeros)]
    MASK_BITS eax
    or      eax, [rsi + BoundsTask.keep_all]
    LEVELS  5
    LEVELS  9
    IOP     pslld, w9, w9, 16
    IOR     w5, w5, w9
    LEVELS  7
    LEVELS  11
    IOP     pslld, w11, w11, 16
    IOR     w7, w7, w11
    NARROW  3
    VMOV    v0, v3
    NEARNESS 0
    VSPREAD_INTEGER 2, r9
    VADD    v2, v2, [PACKET(natural)]
    LEVELS  2
    STORE_CANDIDATES r10, 2, 5, 7, 3, 6, 8, 10, eax, r12
    add     r8, 4 * LANES
    END_BOUNDS
%endmacro
