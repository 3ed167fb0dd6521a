; sphere_set_up.asm - spheres of a tile from centre and radius to functions of the pixels, LANES in lockstep, in f64.
;
; unsafe extern "sysv64" fn(view: *const SphereView<f64>, task: *const SetupTask)
;
;   rayo_<isa>_single_sphere_set_up    writes f32: SpherePlanes, to find the nearest
;   rayo_<isa>_double_sphere_set_up    writes f64
;   rayo_<isa>_single_sphere_shading   writes f32: TileSpheres, ObjectLights and ShortLights, for shading
;   rayo_<isa>_double_sphere_shading   writes f64
;
;   They use set_up.asm's macros. Nothing is fused, so that the numbers are the same on every ISA.
;
;   registers   rdi view, whose fields are the constants K; rsi task; r8 spheres transposed, r15 work W; rcx spheres
;               left, r11 a light
;               set_up: r9 planes, rdx the next id
;               shading: r9 records, r10 ObjectLights, r14 ShortLights or 0, rbx from one sphere's to the next one's
;   writes      planes or records of count spheres, rounded up to a multiple of LANES
;   requires    the CPUID features of the ISA; count from 1 to CHUNK; candidates that are spheres. The results for one
;               that is not wholly in front, or that the camera is inside of, are meaningless
;   equals      kernels::portable::spheres::set_up and kernels::portable::spheres::shading, to the last bit

; The work of a packet: a register each. Names are those of the records; cc is c.c, over is scale / (k radius), per is
; scale / radius, sx and sy are step cx and step cy, reach_x and reach_y the outline's greatest distance from the
; origin.
%assign W_places 0

; WORK - gives a register of the work its place, for W.
%macro WORK 1
%define %%name %1       ; [in]       of the register
%assign W_%[%%name] W_places
%assign W_places W_places + 1
%endmacro
    WORK    column
    WORK    row
    WORK    d0
    WORK    dx
    WORK    dy
    WORK    dxx
    WORK    dxy
    WORK    dyy
    WORK    mx
    WORK    mxx
    WORK    mxy
    WORK    my
    WORK    myx
    WORK    myy
    WORK    mz
    WORK    mzx
    WORK    mzy
    WORK    ux
    WORK    uy
    WORK    uz
    WORK    short
    WORK    cc
    WORK    k
    WORK    over
    WORK    per
    WORK    rayx
    WORK    rayy
    WORK    sx
    WORK    sy
    WORK    h
    WORK    reach_x
    WORK    reach_y
    WORK    length
%define W(name) [r15 + VBYTES * (W_ %+ name)]

; NEAREST_PIXEL - d = the middle of a and b, rounded to an integer, half away from 0, and clamped to the picture.
;   equals      kernels::portable::spheres::nearest_pixel
%macro NEAREST_PIXEL 5
%define %%d %1          ; [out]      vreg
%define %%a %2          ; [in]       vreg
%define %%b %3          ; [in]       vreg
%define %%side %4       ; [in]       field: pixels of the picture along the axis
%define %%t %5          ; [clobbered] vreg
    VADD    %%d, %%a, %%b
    VMUL    %%d, %%d, [PACKET(halves)]
    VABS    %%t, %%d
    VADD    %%t, %%t, [PACKET(below_half)]
    VROUND  %%t, %%t, DOWN
    VAND    %%d, %%d, [PACKET(sign)]
    VXOR    %%d, %%d, %%t
    VMIN    %%d, %%d, K(SphereView. %+ %%side)
    VMAX    %%d, %%d, [PACKET(zeros)]
%endmacro

; REACH - d = the greatest distance from the origin o of the part of the outline, from a to b, that is in the picture,
;         plus one pixel.
;   equals      kernels::portable::spheres::reach
%macro REACH 5
%define %%a %1          ; [clobbered] vreg
%define %%b %2          ; [in/out]   vreg: d
%define %%o %3          ; [in]       vreg
%define %%side %4       ; [in]       field: pixels of the picture along the axis
%define %%t %5          ; [clobbered] vreg
    VMAX    %%a, %%a, [PACKET(zeros)]
    VMIN    %%b, %%b, K(SphereView. %+ %%side)
    VSUB    %%b, %%b, %%o
    VSUB    %%t, %%o, %%a
    VMAX    %%b, %%b, %%t
    VADD    %%b, %%b, [PACKET(ones)]
%endmacro

; SPHERE_D - computes what both functions need of the spheres at r8: W but for m, u and the lights, and D in v2 (d0), v6
;            (dx), v8 (dy), v12 (dxx), v4 (dxy), v9 (dyy). Clobbers all registers.
;
;   D = d.d - |c x d|^2, divided by k and the radius: quadratic in the pixel, and without cancellation for a far sphere.
;   Pixels count from an origin in the picture, so that the terms are no larger than D is within the picture: where that
;   shows only a piece of the limb, D is small and keeps all its digits.
;
;   k = c.c - 1 is ((cz - 1) (cz + 1) + cx^2) + cy^2, with cz - 1 from z - r, which is exact where they are near each
;   other: all terms are positive, so that k keeps its digits where the camera is next to the sphere.
;   equals      kernels::portable::spheres::InFront::new
%macro SPHERE_D 0
    WIDEN   v3, [r8 + SphereArrays.radius]
    WIDEN   v0, [r8 + SphereArrays.x]
    WIDEN   v1, [r8 + SphereArrays.y]
    WIDEN   v2, [r8 + SphereArrays.z]
    VSUB    v5, v2, v3
    VDIV    v0, v0, v3
    VDIV    v1, v1, v3
    VDIV    v2, v2, v3
    VDIV    v5, v5, v3
    VMOV_TO W(ux), v0
    VMOV_TO W(uy), v1
    VMOV_TO W(uz), v2
    DOT3_UNFUSED v4, v0, v1, v2, v0, v1, v2, v9, v9
    VMOV_TO W(cc), v4
    VADD    v4, v2, [PACKET(ones)]
    VMUL    v4, v4, v5
    VMUL    v9, v0, v0
    VADD    v4, v4, v9
    VMUL    v9, v1, v1
    VADD    v4, v4, v9
    VMOV_TO W(k), v4
    VMUL    v9, v4, v3
    KLOAD   v12, SphereView.scale
    VDIV    v12, v12, v9
    VMOV_TO W(over), v12
    SPHERE_BOX v5, v6, v7, v8, v0, v1, v2, v9, v10, v11
    NEAREST_PIXEL v9, v5, v6, width, v10
    VMOV_TO W(column), v9
    REACH   v5, v6, v9, width, v10
    VMOV_TO W(reach_x), v6
    NEAREST_PIXEL v11, v7, v8, height, v10
    VMOV_TO W(row), v11
    REACH   v7, v8, v11, height, v10
    VMOV_TO W(reach_y), v8

    ; The ray at the origin, and the increments of c x d and c . d for a column and a row.
    VADD    v6, v9, [PACKET(halves)]
    VMUL    v6, v6, K(SphereView.step)
    VSUB    v6, v6, K(SphereView.half_width)
    VMOV_TO W(rayx), v6
    VADD    v11, v11, [PACKET(halves)]
    VMUL    v11, v11, K(SphereView.step)
    KLOAD   v8, SphereView.half_height
    VSUB    v8, v8, v11
    VMOV_TO W(rayy), v8
    KLOAD   v12, SphereView.focal
    CROSS3_UNFUSED v9, v10, v11, v0, v1, v2, v6, v8, v12, v13
    VMUL    v3, v2, K(SphereView.step)
    VMUL    v4, v1, K(SphereView.step)
    VMUL    v5, v0, K(SphereView.step)
    VMOV_TO W(sy), v4
    VMOV_TO W(sx), v5
    DOT3_UNFUSED v0, v0, v1, v2, v6, v8, v12, v1, v2
    VMOV_TO W(h), v0
    VMOV    v1, W(over)
    VMUL    v1, v1, v1

    DOT3_UNFUSED v2, v6, v8, v12, v6, v8, v12, v7, v7
    DOT3_UNFUSED v7, v9, v10, v11, v9, v10, v11, v13, v13
    VSUB    v2, v2, v7
    VMUL    v2, v2, v1

    VMUL    v10, v10, v3
    VMUL    v13, v11, v4
    VSUB    v10, v10, v13
    VMUL    v6, v6, K(SphereView.step)
    VSUB    v6, v6, v10
    VADD    v6, v6, v6
    VMUL    v6, v6, v1

    VMUL    v9, v9, v3
    VMUL    v11, v11, v5
    VSUB    v9, v9, v11
    VMUL    v8, v8, K(SphereView.step)
    VADD    v8, v8, v9
    VADD    v8, v8, v8
    VXOR    v8, v8, [PACKET(sign)]
    VMUL    v8, v8, v1

    KLOAD   v9, SphereView.step
    VMUL    v9, v9, v9
    VMUL    v10, v3, v3
    VMUL    v11, v4, v4
    VADD    v11, v11, v10
    VSUB    v12, v9, v11
    VMUL    v12, v12, v1
    VMUL    v11, v5, v5
    VADD    v11, v11, v10
    VSUB    v9, v9, v11
    VMUL    v9, v9, v1
    VMUL    v4, v4, v5
    VADD    v4, v4, v4
    VXOR    v4, v4, [PACKET(sign)]
    VMUL    v4, v4, v1
%endmacro

; BEGIN_SPHERES - begins a function: transposes the spheres of the task and reserves memory for W.
%macro BEGIN_SPHERES 0
    PUSH_OWNED
    TRANSPOSE_CANDIDATES Sphere_size, SphereArrays, TRANSPOSE_SPHERES
    sub     rsp, VBYTES * (W_places + 1)
    lea     r15, [rsp + VBYTES - 1]
    and     r15, -VBYTES
    mov     r8, [rsi + SetupTask.arrays]
    mov     r9, [rsi + SetupTask.planes]
    mov     rcx, [rsi + SetupTask.count]
%endmacro

; END_SPHERES - ends what BEGIN_SPHERES and CONSTANTS began.
%macro END_SPHERES 0
    UNCONSTANTS
    add     rsp, VBYTES * (W_places + 1)
    POP_OWNED
ENDFUNC
%endmacro

; TERM - adds |d times a times b| to v3 and stores d.
;   equals      kernels::portable::spheres::sum_of_terms, five times
%macro TERM 5
%define %%out %1        ; [in]       4 or 8
%define %%field %2      ; [in]       of SpherePlanes
%define %%d %3          ; [clobbered] number of a register
%define %%a %4          ; [in]       vreg
%define %%b %5          ; [in]       vreg, or none
    VMUL    v5, v%[%%d], %%a
%ifnidn %%b, none
    VMUL    v5, v5, %%b
%endif
    VABS    v5, v5
    VADD    v3, v3, v5
    ROUNDED_STORE %%out, SpherePlanes. %+ %%field, %%d
%endmacro

; SPHERE_SET_UP - a function that writes planes of elements of `out` bytes.
%macro SPHERE_SET_UP 2
%define %%precision %1  ; [in]       part of the function's name
%define %%out %2        ; [in]       4 or 8
FUNC ISA %+ _ %+ %%precision %+ _sphere_set_up
    BEGIN_SPHERES
    mov     rdx, [rsi + SetupTask.first_id]
    CONSTANTS 10
.packet:
    ASK_FOR ahead, 1, Sphere_size, FETCH_ALL
    SPHERE_D

    ; The rounding error of D is at most a few ulps of its terms at the outline.
    VMOV    v0, W(reach_x)
    VMOV    v1, W(reach_y)
    VABS    v3, v2
    ROUNDED_STORE %%out, SpherePlanes.d0, 2
    TERM    %%out, dx, 6, v0, none
    TERM    %%out, dy, 8, v1, none
    TERM    %%out, dxx, 12, v0, v0
    TERM    %%out, dxy, 4, v0, v1
    TERM    %%out, dyy, 9, v1, v1
    VMUL    v3, v3, [PACKET(four_roundings)]
    ROUNDED_STORE %%out, SpherePlanes.bound, 3
    VMOV    v2, W(column)
    ROUNDED_STORE %%out, SpherePlanes.column, 2
    VMOV    v2, W(row)
    ROUNDED_STORE %%out, SpherePlanes.row, 2
    VMOV    v3, W(over)
    VMUL    v2, v3, W(h)
    ROUNDED_STORE %%out, SpherePlanes.h, 2
    VMUL    v2, v3, W(sx)
    ROUNDED_STORE %%out, SpherePlanes.hx, 2
    VMUL    v2, v3, W(sy)
    VXOR    v2, v2, [PACKET(sign)]
    ROUNDED_STORE %%out, SpherePlanes.hy, 2
    WIDEN   v2, [r8 + SphereArrays.most]
    ROUNDED_STORE %%out, SpherePlanes.most, 2
    VSPREAD_INTEGER 2, rdx
    VADD    v2, v2, [PACKET(natural)]
    ROUNDED_STORE %%out, SpherePlanes.id, 2
    add     r8, 4 * LANES
    add     r9, %%out * LANES
    add     rdx, LANES
    sub     rcx, LANES
    ja      .packet
    END_SPHERES
%endmacro

; STORE_FOUR - stores four fields of W as fields of the TileSpheres at r9, from number n on.
%macro STORE_FOUR 6
%define %%out %1        ; [in]       4 or 8
%define %%n %2          ; [in]       number of the first
%define %%a %3          ; [in]       of W
%define %%b %4          ; [in]       of W
%define %%c %5          ; [in]       of W
%define %%d %6          ; [in]       of W
    VMOV    v11, W(%%a)
    VMOV    v12, W(%%b)
    VMOV    v13, W(%%c)
    VMOV    v14, W(%%d)
    lea     r12, [r9 + %%out * %%n]
    STORE_RECORDS %%out
%endmacro

; NORMAL - W(m<axis>), W(m<axis>x), W(m<axis>y) = (d - t c) / radius with d the ray at the origin, and its increments
;          for a column and a row; t = d . c / k, which is in v0, v1 and minus v2; scale / radius is in v3.
;   equals      kernels::portable::spheres::normal
%macro NORMAL 4
%define %%axis %1       ; [in]       x, y or z
%define %%ray %2        ; [in]       aligned memory or K: d at the origin, the others being ...
%define %%column %3     ; [in]       field, or none for 0: its increment for a column
%define %%row %4        ; [in]       field, or none for 0: its decrement for a row
    VMUL    v5, v0, W(u%[%%axis])
    VMOV    v6, %%ray
    VSUB    v6, v6, v5
    VMUL    v6, v6, v3
    VMOV_TO W(m%[%%axis]), v6
    VMUL    v5, v1, W(u%[%%axis])
%ifidn %%column, none
    VZERO   v6
%else
    KLOAD   v6, %%column
%endif
    VSUB    v6, v6, v5
    VMUL    v6, v6, v3
    VMOV_TO W(m%[%%axis]x), v6
    VMUL    v6, v2, W(u%[%%axis])
%ifnidn %%row, none
    VSUB    v6, v6, K(%%row)
%endif
    VMUL    v6, v6, v3
    VMOV_TO W(m%[%%axis]y), v6
%endmacro

; TO_LIGHT - v0, v1, v2 = from the centre to the light at r11, in units of the radii in v3.
;   equals      kernels::portable::spheres::to_light
%macro TO_LIGHT 0
    WIDEN   v3, [r8 + SphereArrays.x]
    VSPREAD v0, [r11 + 8 * TileLight.x]
    VSUB    v0, v0, v3
    WIDEN   v3, [r8 + SphereArrays.y]
    VSPREAD v1, [r11 + 8 * TileLight.y]
    VSUB    v1, v1, v3
    WIDEN   v3, [r8 + SphereArrays.z]
    VSPREAD v2, [r11 + 8 * TileLight.z]
    VSUB    v2, v2, v3
    WIDEN   v3, [r8 + SphereArrays.radius]
    VDIV    v0, v0, v3
    VDIV    v1, v1, v3
    VDIV    v2, v2, v3
%endmacro

; LENGTH_OF - d = |x, y, z|.
;   equals      kernels::portable::lanes::dot_unfused
%macro LENGTH_OF 5
%define %%d %1          ; [out]      vreg
%define %%x %2          ; [in]       vreg
%define %%y %3          ; [in]       vreg
%define %%z %4          ; [in]       vreg
%define %%t %5          ; [clobbered] vreg
    DOT3_UNFUSED %%d, %%x, %%y, %%z, %%x, %%y, %%z, %%t, %%t
    VSQRT   %%d, %%d
%endmacro

; SPHERE_WEIGHT - d = the radiance of the light at r11 times the colour in white. Clobbers v5.
;
;   A weight beyond f32 is clamped: no kernel in f32 shades that sphere, but in blocks that it shares with others 0
;   times its weight is added to them, which must not be NaN.
;   equals      kernels::portable::spheres::weight
%macro SPHERE_WEIGHT 4
%define %%d %1          ; [out]      vreg
%define %%channel %2    ; [in]       red, green or blue
%define %%white %3      ; [in]       aligned memory or K
%define %%out %4        ; [in]       4 or 8
    WIDEN   %%d, [r8 + SphereArrays. %+ %%channel]
    VMUL    %%d, %%d, %%white
    VSPREAD v5, [r11 + 8 * TileLight. %+ %%channel]
    VMUL    %%d, %%d, v5
%if %%out == 4
    VMIN    %%d, %%d, [PACKET(largest)]
%endif
%endmacro

; SPHERE_SHADING - a function that writes records of elements of `out` bytes.
%macro SPHERE_SHADING 2
%define %%precision %1  ; [in]       part of the function's name
%define %%out %2        ; [in]       4 or 8
FUNC ISA %+ _ %+ %%precision %+ _sphere_shading
    BEGIN_SPHERES
    mov     r10, [rsi + SetupTask.shades]
    mov     r14, [rsi + SetupTask.shorts]
    CONSTANTS 10
.packet:
    ASK_FOR ahead, 1, Sphere_size, FETCH_ALL
    SPHERE_D
    VMOV_TO W(d0), v2
    VMOV_TO W(dx), v6
    VMOV_TO W(dy), v8
    VMOV_TO W(dxx), v12
    VMOV_TO W(dxy), v4
    VMOV_TO W(dyy), v9
    VMOV    v4, W(k)
    VMOV    v0, W(h)
    VDIV    v0, v0, v4
    VMOV    v1, W(sx)
    VDIV    v1, v1, v4
    VMOV    v2, W(sy)
    VDIV    v2, v2, v4
    WIDEN   v4, [r8 + SphereArrays.radius]
    KLOAD   v3, SphereView.scale
    VDIV    v3, v3, v4
    VMOV_TO W(per), v3
    NORMAL  x, W(rayx), SphereView.step, none
    NORMAL  y, W(rayy), none, SphereView.step
    KLOAD   v7, SphereView.focal
    NORMAL  z, v7, none, none
    mov     ebx, %%out * TileSphere_size
    STORE_FOUR %%out, TileSphere.column, column, row, d0, dx
    STORE_FOUR %%out, TileSphere.dy, dy, dxx, dxy, dyy
    STORE_FOUR %%out, TileSphere.mx, mx, mxx, mxy, my
    STORE_FOUR %%out, TileSphere.myx, myx, myy, mz, mzx
    STORE_FOUR %%out, TileSphere.mzy, mzy, ux, uy, uz
    VZERO   v0
    VMOV_TO W(short), v0
    imul    rbx, [rsi + SetupTask.light_count], %%out * ObjectLight_size     ; a ShortLight is as long
    mov     rax, [rsi + SetupTask.light_count]
    test    r14, r14
    jz      .long                       ; none in the short form

    ; The short form: how far the terms of kn and ke cancel decides whether it is accurate enough.
    VMOV    v0, [PACKET(ones)]
    VMOV_TO W(short), v0
    VMOV    v1, W(cc)
    VSQRT   v1, v1
    VADD    v1, v1, v0
    VMOV_TO W(length), v1
    mov     r11, [rsi + SetupTask.lights]
    xor     edx, edx
    test    rax, rax
    jz      .looked
.short_light:
    TO_LIGHT
    LENGTH_OF v7, v0, v1, v2, v8
    VSUB    v8, v7, [PACKET(ones)]      ; the gap between the light and the sphere
    VMUL    v7, v7, W(length)
    VSPREAD v4, [r11 + 8 * TileLight.x]
    VSPREAD v5, [r11 + 8 * TileLight.y]
    VSPREAD v6, [r11 + 8 * TileLight.z]
    VDIV    v4, v4, v3
    VDIV    v5, v5, v3
    VDIV    v6, v6, v3
    DOT3_UNFUSED v9, v4, v5, v6, W(ux), W(uy), W(uz), v10, v10
    VMOV    v14, W(k)
    VSUB    v14, v14, v9                ; kn = k - c.l
    DOT3_UNFUSED v4, v4, v5, v6, v4, v5, v6, v5, v6
    VSUB    v4, v4, W(k)                ; ke = l.l - k
    VABS    v5, v14
    VADD    v5, v5, v7
    VDIV    v5, v5, v8
    VADD    v7, v7, v7
    VABS    v6, v4
    VADD    v6, v6, v7
    VMUL    v7, v8, v8
    VDIV    v6, v6, v7
    VMAX    v5, v5, v6
    MASK_GREATER v8, [PACKET(quarters)]
    MASK_AND_LESS v8, [PACKET(short_far)], v7
    VMOV    v6, [PACKET(loss)]
    MASK_AND_GREATER v6, v5, v7
    VMOV    v6, W(short)
    MASK_KEEP v6
    VMOV_TO W(short), v6
    VMOV    v5, W(per)
    VMUL    v0, v0, v5
    VMUL    v1, v1, v5
    VMUL    v2, v2, v5
    DOT3_UNFUSED v11, v0, v1, v2, W(rayx), W(rayy), K(SphereView.focal), v12, v12
    VMUL    v12, v0, K(SphereView.step)
    VMUL    v13, v1, K(SphereView.step)
    VXOR    v13, v13, [PACKET(sign)]
    lea     r12, [r14 + rdx]
    STORE_RECORDS %%out
    VMOV    v11, v4
    SPHERE_WEIGHT v12, red, [PACKET(white)], %%out
    SPHERE_WEIGHT v13, green, [PACKET(white)], %%out
    SPHERE_WEIGHT v14, blue, [PACKET(white)], %%out
    lea     r12, [r14 + rdx + 4 * %%out]
    STORE_RECORDS %%out
    add     r11, 8 * TileLight_size
    add     rdx, %%out * ObjectLight_size
    dec     rax
    jnz     .short_light
    imul    rax, rbx, LANES
    add     r14, rax
    mov     rax, [rsi + SetupTask.light_count]
    VMOV    v0, W(short)
    VMOV    v1, [PACKET(ones)]
    MASK_NOT_LESS v0, v1
    MASK_BITS edx
    cmp     edx, (1 << LANES) - 1
    je      .looked

    ; The long form, from the light relative to the centre.
.long:
    mov     r11, [rsi + SetupTask.lights]
    xor     edx, edx
    test    rax, rax
    jz      .looked
.light:
    TO_LIGHT
    LENGTH_OF v7, v0, v1, v2, v8
    KLOAD   v8, SphereView.far
    MASK_GREATER v7, v8
    VDIV    v8, v8, v7
    VMUL    v4, v0, v8
    VSELECT v0, v4
    VMUL    v4, v1, v8
    VSELECT v1, v4
    VMUL    v4, v2, v8
    VSELECT v2, v4
    VMOV    v11, v0
    VMOV    v12, v1
    VMOV    v13, v2
    VZERO   v14
    lea     r12, [r10 + rdx]
    STORE_RECORDS %%out
    SPHERE_WEIGHT v11, red, K(SphereView.white), %%out
    SPHERE_WEIGHT v12, green, K(SphereView.white), %%out
    SPHERE_WEIGHT v13, blue, K(SphereView.white), %%out
    VZERO   v14
    lea     r12, [r10 + rdx + 4 * %%out]
    STORE_RECORDS %%out
    add     r11, 8 * TileLight_size
    add     rdx, %%out * ObjectLight_size
    dec     rax
    jnz     .light
.looked:
    imul    rax, rbx, LANES
    add     r10, rax
    VMOV    v11, W(short)
    VZERO   v12
    VZERO   v13
    VZERO   v14
    mov     ebx, %%out * TileSphere_size
    lea     r12, [r9 + %%out * TileSphere.short]
    STORE_RECORDS %%out
    imul    rax, rbx, LANES
    add     r9, rax
    add     r8, 4 * LANES
    sub     rcx, LANES
    ja      .packet
    END_SPHERES
%endmacro

; SPHERE_SET_UPS - defines the functions of this file.
%macro SPHERE_SET_UPS 0
    SPHERE_SET_UP single, 4
    SPHERE_SET_UP double, 8
    SPHERE_SHADING single, 4
    SPHERE_SHADING double, 8
%endmacro
