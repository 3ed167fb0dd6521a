; tiles.asm - the packet tracers in object order: the nearest of many objects over a tile of pixels, shaded once.
;
; This is Algorithm 1 for many objects. Set-up has turned each triangle and each sphere into functions of a tile's
; pixels, and into bounds. Of each object only the blocks within its bounds are asked (line 14): a block is a packet of
; pixels, rows of up to four, and `near` and `who` of a tile keep the nearest of each (lines 12 to 17) in cache.
; When all objects are through, each pixel is shaded once (lines 18 to 21) and written.
;
; A ray hits or not by one predicate: in the elements of the kernel with their rounding bound, and where that leaves a
; doubt in f64, by the reference's operations in the reference's order. So bounds may leave work out, and never a hit.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_nearest_triangles  unsafe extern "sysv64" fn(planes: *const TrianglePlanes, task: *const NearestTask)
;   rayo_<p>_nearest_spheres    unsafe extern "sysv64" fn(spheres: *const TileSphere, task: *const NearestTask)
;   rayo_<p>_tile_<output>      unsafe extern "sysv64" fn(rays: *const TileRays, task: *const ShadeTask)
;
;   <output>    f32x4, rgba8; f32x4_fast with estimates in place of roots and divisions
;   requires    the CPUID features of the ISA; memory as tile_layout.inc says

%assign WHO (ELEM * Tile.who)
%assign BLOCKS_X (TILE_WIDTH / BLOCK_WIDTH)
%assign WIDTH_SHIFT (LANES == 2 ? 1 : 2)
%assign HEIGHT_SHIFT (BLOCK_HEIGHT == 4 ? 2 : BLOCK_HEIGHT == 2 ? 1 : 0)
%assign ALL_LANES ((1 << LANES) - 1)

; SD - d = d op b in f64, of one number.
%macro SD 3
%define %%op %1         ; [in]       mnemonic
%define %%d %2          ; [in/out]   128-bit register
%define %%b %3          ; [in]       128-bit register or memory
%if HAS_VEX
    v%[%%op] %%d, %%d, %%b
%else
    %%op    %%d, %%b
%endif
%endmacro

; CORNER - d = one number of f32 in f64.
%macro CORNER 2
%define %%d %1          ; [out]      128-bit register
%define %%m %2          ; [in]       memory
    SD      xorps, %%d, %%d
    SD      cvtss2sd, %%d, %%m
%endmacro

; ONE_RAY - xmm0, xmm1, xmm2 = the ray of the lane r9 of the block at r13 of row ebx of the tile; clobbers r9, r12.
;
;   The grid's step (i + 1/2) is half_step (2 i + 1), which is rounded alike.
%macro ONE_RAY 0
    mov     r12, r13
    sub     r12, r8
    shr     r12, VBYTES == 64 ? 6 : VBYTES == 32 ? 5 : 4
    and     r12d, BLOCKS_X - 1
    shl     r12d, WIDTH_SHIFT
    mov     r14d, r9d
    and     r9d, BLOCK_WIDTH - 1
    add     r12d, r9d
    add     r12d, [rsi + NearestTask.column]
    shr     r14d, WIDTH_SHIFT
    add     r14d, ebx
    add     r14d, [rsi + NearestTask.row]
    lea     r12d, [2 * r12 + 1]
    lea     r14d, [2 * r14 + 1]
    SD      xorps, xmm0, xmm0
    SD      cvtsi2sd, xmm0, r12d
    SD      mulsd, xmm0, [rsi + NearestTask.half_step]
    SD      subsd, xmm0, [rsi + NearestTask.half_width]
    SD      xorps, xmm2, xmm2
    SD      cvtsi2sd, xmm2, r14d
    SD      mulsd, xmm2, [rsi + NearestTask.half_step]
    SD      xorps, xmm1, xmm1
    SD      addsd, xmm1, [rsi + NearestTask.half_height]
    SD      subsd, xmm1, xmm2
    SD      xorps, xmm2, xmm2
    SD      addsd, xmm2, [rsi + NearestTask.focal]
%endmacro

; ONE_CROSS - xmm3 = one component of a cross product, a b - c d.
%macro ONE_CROSS 4
%define %%a %1          ; [in]       field of Corners
%define %%b %2          ; [in]       field of Corners
%define %%c %3          ; [in]       field of Corners
%define %%d %4          ; [in]       field of Corners
    CORNER  xmm3, [rdx + Corners. %+ %%a]
    CORNER  xmm4, [rdx + Corners. %+ %%b]
    SD      mulsd, xmm3, xmm4
    CORNER  xmm4, [rdx + Corners. %+ %%c]
    CORNER  xmm5, [rdx + Corners. %+ %%d]
    SD      mulsd, xmm4, xmm5
    SD      subsd, xmm3, xmm4
%endmacro

; ONE_EDGE - jumps to .outside if the ray in xmm0, xmm1, xmm2 is outside the edge from corner v to corner w.
;
;   (dx ex + dy ey) + dz ez >= 0 with e = v x w, times the sign of the volume: the reference's order of operations.
%macro ONE_EDGE 2
%define %%v %1          ; [in]       a, b or c
%define %%w %2          ; [in]       a, b or c
    ONE_CROSS %[%%v]y, %[%%w]z, %[%%v]z, %[%%w]y
    SD      mulsd, xmm3, xmm0
    SD      xorps, xmm6, xmm6
    SD      addsd, xmm6, xmm3
    ONE_CROSS %[%%v]z, %[%%w]x, %[%%v]x, %[%%w]z
    SD      mulsd, xmm3, xmm1
    SD      addsd, xmm6, xmm3
    ONE_CROSS %[%%v]x, %[%%w]y, %[%%v]y, %[%%w]x
    SD      mulsd, xmm3, xmm2
    SD      addsd, xmm6, xmm3
    SD      xorps, xmm6, xmm7
    SD      xorps, xmm3, xmm3
%if HAS_VEX
    vucomisd xmm6, xmm3
%else
    ucomisd xmm6, xmm3
%endif
    jb      .outside
%endmacro

; ELEMENT_F64 - d = an element in f64.
%macro ELEMENT_F64 2
%define %%d %1          ; [out]      128-bit register
%define %%m %2          ; [in]       memory
%if ELEM == 4
    CORNER  %%d, %%m
%elif HAS_VEX
    vmovsd  %%d, %%m
%else
    movsd   %%d, %%m
%endif
%endmacro

; SPHERE_CROSS - xmm3 = the square of one component of d x c: xmm<i> c<a> - xmm<j> c<b>.
%macro SPHERE_CROSS 4
%define %%i %1          ; [in]       0, 1 or 2
%define %%a %2          ; [in]       x, y or z
%define %%j %3          ; [in]       0, 1 or 2
%define %%b %4          ; [in]       x, y or z
    ELEMENT_F64 xmm3, [rdi + ELEM * TileSphere.c%[%%a]]
    ELEMENT_F64 xmm4, [rdi + ELEM * TileSphere.c%[%%b]]
    SD      mulsd, xmm3, xmm%[%%i]
    SD      mulsd, xmm4, xmm%[%%j]
    SD      subsd, xmm3, xmm4
    SD      mulsd, xmm3, xmm3
%endmacro

; SPILL - v0 to v14 to the stack; UNSPILL brings them back.
%macro SPILL 0
%assign %%i 0
%rep 15
    VMOV_TO [rsp + VBYTES * %%i], v%[%%i]
%assign %%i %%i + 1
%endrep
%endmacro

; UNSPILL - v0 to v14 as SPILL found them.
%macro UNSPILL 0
%assign %%i 0
%rep 15
    VMOV    v%[%%i], [rsp + VBYTES * %%i]
%assign %%i %%i + 1
%endrep
%endmacro

; MASK_OF_BITS - the mask from the bits of eax; clobbers r12 and the stack above SPILL.
%macro MASK_OF_BITS 0
%if HAS_MASKS
    kmovw   MASK, eax
%else
%assign %%i 0
%rep LANES
    xor     r12d, r12d
    bt      eax, %%i
    sbb     r12, r12
%if ELEM == 4
    mov     [rsp + VBYTES * 15 + 4 * %%i], r12d
%else
    mov     [rsp + VBYTES * 15 + 8 * %%i], r12
%endif
%assign %%i %%i + 1
%endrep
    VMOV    MASK, [rsp + VBYTES * 15]
%endif
%endmacro

; WHERE - r = the lanes of the mask where a < b, or where a = b, a bit for each.
%macro WHERE 5
%define %%r %1          ; [out]      32-bit register
%define %%a %2          ; [in]       vreg
%define %%b %3          ; [in]       vreg or aligned memory
%define %%relation %4   ; [in]       1 for a < b, 0 for a = b
%define %%t %5          ; [clobbered without mask registers] vreg
%if HAS_MASKS
    VOP     cmp, k2 {MASK}, %%a, %%b, 17 * %%relation
    kmovw   %%r, k2
%else
%if HAS_VEX
    VOP     cmp, %%t, %%a, %%b, 17 * %%relation
%else
    VMOV    %%t, %%a
    VOP     cmp, %%t, %%b, %%relation
%endif
    VAND    %%t, %%t, MASK
    VOP     movmsk, %%r, %%t
%endif
%endmacro

; WHOSE - r = an element as an integer.
%macro WHOSE 2
%define %%r %1          ; [out]      32-bit register
%define %%m %2          ; [in]       memory
%if HAS_VEX && ELEM == 4
    vcvttss2si %%r, %%m
%elif HAS_VEX
    vcvttsd2si %%r, %%m
%elif ELEM == 4
    cvttss2si %%r, %%m
%else
    cvttsd2si %%r, %%m
%endif
%endmacro

; ENTER_NEAREST - saves what the caller owns, and makes room on the stack.
%macro ENTER_NEAREST 0
    push    rbp
    mov     rbp, rsp
    push    rbx
    push    r12
    push    r13
    push    r14
    push    r15
    sub     rsp, VBYTES * 16 + 32       ; and four numbers, from rbp - 72 on
    and     rsp, -VBYTES
%endmacro

; LEAVE_NEAREST - gives it back.
%macro LEAVE_NEAREST 0
    lea     rsp, [rbp - 40]
    pop     r15
    pop     r14
    pop     r13
    pop     r12
    pop     rbx
    pop     rbp
%if HAS_VEX
    vzeroupper
%endif
%endmacro

; CLIP - from bounds in eax (columns) and ebx (rows) to blocks of the tile: columns from r9 to eax, rows from ebx on, a
;        pixel, to r15d; jumps to `none` where there are none. Clobbers r10.
%macro CLIP 1
%define %%none %1       ; [in]       label
    movzx   r9d, ax
    shr     eax, 16
    movzx   r15d, bx
    shr     ebx, 16
    xchg    ebx, r15d
    mov     r10d, [rsi + NearestTask.column]
    sub     r9d, r10d
    sub     eax, r10d
    xor     r10d, r10d
    test    r9d, r9d
    cmovs   r9d, r10d
    cmp     eax, [rsi + NearestTask.end_column]
    cmovg   eax, [rsi + NearestTask.end_column]
    cmp     r9d, eax
    jge     %%none
    mov     r10d, [rsi + NearestTask.row]
    sub     ebx, r10d
    sub     r15d, r10d
    cmp     ebx, [rsi + NearestTask.start_row]
    cmovl   ebx, [rsi + NearestTask.start_row]
    cmp     r15d, [rsi + NearestTask.end_row]
    cmovg   r15d, [rsi + NearestTask.end_row]
    cmp     ebx, r15d
    jge     %%none
    shr     r9d, WIDTH_SHIFT
    add     eax, BLOCK_WIDTH - 1
    shr     eax, WIDTH_SHIFT
    and     ebx, -BLOCK_HEIGHT
%endmacro

; BLOCK_ROW - r13 = the address of the block number r11 of the row ebx of the tile at r8.
%macro BLOCK_ROW 0
    mov     r13d, ebx
    shr     r13d, HEIGHT_SHIFT
    imul    r13d, r13d, BLOCKS_X
    add     r13d, r11d
    shl     r13, VBYTES == 64 ? 6 : VBYTES == 32 ? 5 : 4
    add     r13, r8
%endmacro

; ROW_PLANE - v<i> = name0 + namey y for y in v8: what a plane is along a row of blocks.
%macro ROW_PLANE 2
%define %%d %1          ; [out]      vreg
%define %%name %2       ; [in]       of TrianglePlanes
    VSPREAD %%d, [rdi + ELEM * TrianglePlanes. %+ %%name %+ 0]
    VSPREAD v9, [rdi + ELEM * TrianglePlanes. %+ %%name %+ y]
    VFMA    %%d, v9, v8, v13
%endmacro

; Triangles.
;
;   registers   rdi planes, rdx corners, both of one triangle; rsi task; rcx triangles to go; r8 tile; r11 the first
;               column of blocks, r14 blocks in a row, r10 those to go; ebx row, r15 the end of rows; r13 block
;               v0 v1 v2 v3 x factors of the edges and of 1/t, v4 v5 v6 v7 the same along the row, v8 x, v12 first x,
;               v14 what 1/t cannot exceed
FUNC NAME(nearest, triangles)
    ENTER_NEAREST
    mov     rdx, [rsi + NearestTask.corners]
    mov     rcx, [rsi + NearestTask.count]
    mov     r8, [rsi + NearestTask.tile]
align 16
.triangle:
    mov     eax, [rdx + Corners.columns]
    mov     ebx, [rdx + Corners.rows]
    CLIP    .next_triangle
    mov     r11d, r9d
    sub     eax, r9d
    mov     r14d, eax                   ; blocks in a row
    VSPREAD v0, [rdi + ELEM * TrianglePlanes.e1x]
    VSPREAD v1, [rdi + ELEM * TrianglePlanes.e2x]
    VSPREAD v2, [rdi + ELEM * TrianglePlanes.e3x]
    VSPREAD v3, [rdi + ELEM * TrianglePlanes.tx]
    VSPREAD v14, [rdi + ELEM * TrianglePlanes.most]
    shl     r9d, WIDTH_SHIFT
    sub     r9d, TILE_WIDTH / 2
    VSPREAD_INTEGER 12, r9d
    VADD    v12, v12, [PACKET(block_x)]
.row:
    lea     r9d, [rbx - TILE_HEIGHT / 2]
    VSPREAD_INTEGER 8, r9d
    VADD    v8, v8, [PACKET(block_y)]
    ROW_PLANE v4, e1
    ROW_PLANE v5, e2
    ROW_PLANE v6, e3
    ROW_PLANE v7, t
    VMOV    v8, v12
    BLOCK_ROW
    mov     r10d, r14d
align 16
.block:
    VMOV    v9, v4
    VFMA    v9, v0, v8, v13
    VMOV    v10, v5
    VFMA    v10, v1, v8, v13
    VMIN    v9, v9, v10
    VMOV    v10, v6
    VFMA    v10, v2, v8, v13
    VMIN    v9, v9, v10                 ; the least of the three edges
    VMOV    v10, v7
    VFMA    v10, v3, v8, v13
    VMIN    v10, v10, v14               ; 1/t, no more than at the nearest corner
    VLOAD   v11, [r13]
    MASK_NOT_LESS v9, [PACKET(minus_ones)]
    MASK_AND_NOT_LESS v10, v11, v13
    MASK_BITS eax
    test    eax, eax
    jz      .next_block
    WHERE   r9d, v10, v11, 0, v13
    test    r9d, r9d
    jnz     .tie
.first:
    WHERE   r9d, v9, [PACKET(ones)], 1, v13
    test    r9d, r9d
    jnz     .doubt
.nearest:
    MASK_STORE [r13], v10, v11
    VSPREAD v10, [rdi + ELEM * TrianglePlanes.id]
    MASK_STORE [r13 + WHO], v10, v11
.next_block:
    VADD    v8, v8, [PACKET(block_step)]
    add     r13, VBYTES
    dec     r10d
    jnz     .block
    add     ebx, BLOCK_HEIGHT
    cmp     ebx, r15d
    jl      .row
.next_triangle:
    add     rdi, ELEM
    add     rdx, 4
    dec     rcx
    jnz     .triangle
    LEAVE_NEAREST
    ret

    ; The lanes of r9d have another triangle that is as near: the first in the scene stays. Nobody comes first of all.
.tie:
    mov     [rbp - 48], r14
    mov     [rbp - 56], r10
    mov     r14, [rsi + NearestTask.order]
    WHOSE   r10d, [rdi + ELEM * TrianglePlanes.id]
    mov     r10d, [r14 + 4 * r10]
    mov     [rbp - 72], r10d
    mov     r10d, r9d
.tied_lane:
    bsf     r9d, r10d
    WHOSE   r12d, [r13 + WHO + ELEM * r9]
    mov     r12d, [r14 + 4 * r12]
    cmp     r12d, [rbp - 72]
    ja      .untied
    btr     eax, r9d
.untied:
    lea     r9d, [r10 - 1]
    and     r10d, r9d
    jnz     .tied_lane
    mov     r10, [rbp - 56]
    mov     r14, [rbp - 48]
    MASK_OF_BITS
    test    eax, eax
    jnz     .first
    jmp     .next_block

    ; The lanes of r9d are within the rounding of an edge: each is decided in f64, as the reference does.
.doubt:
    SPILL
    mov     [rbp - 48], r14
    mov     [rbp - 56], r10
    mov     r10d, r9d
    ELEMENT_F64 xmm7, [rdi + ELEM * TrianglePlanes.side]
.lane:
    bsf     r9d, r10d
    ONE_RAY
    ONE_EDGE a, b
    ONE_EDGE b, c
    ONE_EDGE c, a
    jmp     .decided
.outside:
    bsf     r9d, r10d
    btr     eax, r9d
.decided:
    lea     r9d, [r10 - 1]
    and     r10d, r9d
    jnz     .lane
    MASK_OF_BITS
    UNSPILL
    mov     r10, [rbp - 56]
    mov     r14, [rbp - 48]
    test    eax, eax
    jnz     .nearest
    jmp     .next_block
    END

; SPHERE_FIELD - d = a field of the sphere at a general register, in every lane.
%macro SPHERE_FIELD 3
%define %%d %1          ; [out]      vreg
%define %%sphere %2     ; [in]       general register
%define %%field %3      ; [in]       of TileSphere
    VSPREAD %%d, [%%sphere + ELEM * TileSphere. %+ %%field]
%endmacro

; Spheres in front of the camera, seen from outside.
;
;   registers   rdi a sphere; rsi task; rcx spheres to go; r8 tile; rdx the next of ids; r11, r14, r15, ebx, r13, r10 as
;               for triangles
;               v0 dxx, v1 hx, v2 v3 minus and plus the bound, v4 v5 v6 along the row: D at x = 0, its linear part, h;
;               v7 who, v8 x, v12 first x
FUNC NAME(nearest, spheres)
    ENTER_NEAREST
    mov     rdx, [rsi + NearestTask.ids]
    mov     rcx, [rsi + NearestTask.count]
    mov     r8, [rsi + NearestTask.tile]
    mov     [rbp - 48], rdi
    mov     rax, [rsi + NearestTask.first_id]
    mov     [rbp - 64], rax
align 16
.sphere:
    mov     r12d, [rdx]
    imul    rdi, r12, ELEM * TileSphere_size
    add     rdi, [rbp - 48]
    mov     r9, [rsi + NearestTask.columns]
    mov     eax, [r9 + 4 * r12]
    mov     r9, [rsi + NearestTask.rows]
    mov     ebx, [r9 + 4 * r12]
    CLIP    .next_sphere
    mov     r11d, r9d
    sub     eax, r9d
    mov     r14d, eax
    SPHERE_FIELD v0, rdi, dxx
    SPHERE_FIELD v1, rdi, hx
    SPHERE_FIELD v3, rdi, bound
    VXOR    v2, v3, [PACKET(sign)]
    shl     r9d, WIDTH_SHIFT
    add     r9d, [rsi + NearestTask.column]
    VSPREAD_INTEGER 12, r9d
    SPHERE_FIELD v8, rdi, column
    VSUB    v12, v12, v8
    VADD    v12, v12, [PACKET(block_x)]
.row:
    mov     r9d, ebx
    add     r9d, [rsi + NearestTask.row]
    VSPREAD_INTEGER 7, r9d
    SPHERE_FIELD v8, rdi, row
    VSUB    v7, v7, v8
    VADD    v7, v7, [PACKET(block_y)]
    SPHERE_FIELD v4, rdi, d0
    SPHERE_FIELD v9, rdi, dy
    SPHERE_FIELD v10, rdi, dyy
    VFMA    v9, v10, v7, v13
    VFMA    v4, v9, v7, v13
    SPHERE_FIELD v5, rdi, dx
    SPHERE_FIELD v9, rdi, dxy
    VFMA    v5, v9, v7, v13
    SPHERE_FIELD v6, rdi, h
    SPHERE_FIELD v9, rdi, hy
    VFMA    v6, v9, v7, v13
    mov     r9d, [rbp - 64]
    VSPREAD_INTEGER 7, r9d
    VMOV    v8, v12
    BLOCK_ROW
    mov     r10d, r14d
align 16
.block:
    VMOV    v9, v5
    VFMA    v9, v0, v8, v13
    VMOV    v10, v4
    VFMA    v10, v9, v8, v13            ; D
    MASK_NOT_LESS v10, v2
    MASK_BITS eax
    test    eax, eax
    jz      .next_block
    VMAX    v9, v10, [PACKET(zeros)]
    VSQRT   v9, v9
    VMOV    v14, v6
    VFMA    v14, v1, v8, v13            ; h
    VADD    v9, v9, v14                 ; 1/t
    VLOAD   v11, [r13]
    MASK_AND_GREATER v9, v11, v13       ; the first of equals stays
    WHERE   r9d, v10, v3, 1, v13
    test    r9d, r9d
    jnz     .doubt
.nearest:                               ; of no lane, often: a branch would not be foreseen
    MASK_STORE [r13], v9, v11
    VMOV    v9, v7
    MASK_STORE [r13 + WHO], v9, v11
.next_block:
    VADD    v8, v8, [PACKET(block_step)]
    add     r13, VBYTES
    dec     r10d
    jnz     .block
    add     ebx, BLOCK_HEIGHT
    cmp     ebx, r15d
    jl      .row
.next_sphere:
    add     rdx, 4
    inc     dword [rbp - 64]
    dec     rcx
    jnz     .sphere
    LEAVE_NEAREST
    ret

    ; The lanes of r9d are within the rounding of the silhouette: r^2 d.d >= |c x d|^2 in f64.
.doubt:
    MASK_BITS eax
    SPILL
    mov     [rbp - 56], r10
    mov     [rbp - 72], r14
    mov     r10d, r9d
.lane:
    bsf     r9d, r10d
    ONE_RAY
    SPHERE_CROSS 1, z, 2, y
    SD      xorps, xmm6, xmm6
    SD      addsd, xmm6, xmm3
    SPHERE_CROSS 2, x, 0, z
    SD      addsd, xmm6, xmm3
    SPHERE_CROSS 0, y, 1, x
    SD      addsd, xmm6, xmm3
    SD      mulsd, xmm0, xmm0
    SD      mulsd, xmm1, xmm1
    SD      mulsd, xmm2, xmm2
    SD      addsd, xmm0, xmm1
    SD      addsd, xmm0, xmm2
    ELEMENT_F64 xmm3, [rdi + ELEM * TileSphere.radius]
    SD      mulsd, xmm0, xmm3
    SD      mulsd, xmm0, xmm3
%if HAS_VEX
    vucomisd xmm0, xmm6
%else
    ucomisd xmm0, xmm6
%endif
    jae     .decided
    bsf     r9d, r10d
    btr     eax, r9d
.decided:
    lea     r9d, [r10 - 1]
    and     r10d, r9d
    jnz     .lane
    MASK_OF_BITS
    UNSPILL
    mov     r10, [rbp - 56]
    mov     r14, [rbp - 72]
    jmp     .nearest
    END

; The stack of the shading functions, from rsp on.
%assign PIXELS_AT 0                     ; a block of pixels
%assign IDS_AT (16 * LANES)             ; who, as integers
%assign OFFSETS_AT (IDS_AT + 64)        ; of their shades
%assign STRIDES_AT (OFFSETS_AT + 64)    ; bytes from one object's shades to the next one's, in every lane
%assign FRAME (STRIDES_AT + 64)

; STORE_INTEGERS - stores who is in v<i> as integers, LANES of 32 bits.
%macro STORE_INTEGERS 2
%define %%m %1          ; [out]      address
%define %%i %2          ; [in]       number of a register
%if LANES == 2
    movq    [%%m], x%[%%i]
%elif HAS_VEX
    vmovups [%%m], w%[%%i]
%else
    movups  [%%m], w%[%%i]
%endif
%endmacro

; COSINE - d = d / sqrt q, from 0 to 1; NaN gives 0.
%macro COSINE 3
%define %%d %1          ; [in/out]   vreg
%define %%q %2          ; [clobbered] vreg
%define %%t %3          ; [clobbered] vreg
%if ESTIMATE
    VRSQRT  %%t, %%q, %%t, %%t
    VMUL    %%d, %%d, %%t
%else
    VSQRT   %%q, %%q
    VDIV    %%d, %%d, %%q
%endif
    VMAX    %%d, %%d, [PACKET(zeros)]
    VMIN    %%d, %%d, [PACKET(ones)]
%endmacro

; TRIANGLE_LIGHT - adds what the light at r13 does to the colours v1, v2, v3 of triangles with 1/t in v0 and rays in
;                  v4, v5, v14. Cosines and weights are in v7 to v10. Clobbers v7, v11, v12, v13, v15.
;
;   P = d / w, so that L - P = (l w - d) / w and N . (L - P) = N . (l - v): cosine w / |l w - d|, without a division.
%macro TRIANGLE_LIGHT 0
    VSPREAD v11, [r13]
    VSPREAD v12, [r13 + ELEM]
    VSPREAD v13, [r13 + 2 * ELEM]
    VFMSUB  v11, v0, v4
    VFMSUB  v12, v0, v5
    VFMSUB  v13, v0, v14
    DOT3    v11, v11, v12, v13, v11, v12, v13, v15
    VMUL    v7, v7, v0
    COSINE  v7, v11, v12
    VFMA    v1, v7, v8, v15
    VFMA    v2, v7, v9, v15
    VFMA    v3, v7, v10, v15
%endmacro

; PIXELS_OUT_F32X4 - a block's pixels from v1, v2, v3 to r9 and the rows after it, r10 bytes apart.
%macro PIXELS_OUT_F32X4 0
    TURN_F32X4 1, 2, 3, 7, 11, 12
%assign %%c 0
%rep BLOCK_HEIGHT
%assign %%e 0
%rep BLOCK_WIDTH
%assign %%i 7 + %%e
    STORE128 [r9 + 16 * %%e], w, %%i, %%c
%assign %%e %%e + 1
%endrep
    add     r9, r10
%assign %%c %%c + 1
%endrep
%endmacro

; PIXELS_OUT_F32X3 - the same in three floats a pixel.
%macro PIXELS_OUT_F32X3 0
    ROWS_F32X3 1, 2, 3, 7, 8
%assign %%c 0
%rep BLOCK_HEIGHT
%if LANES == 2
    STORE_F32X3 r9, 7, movups
%else
    STORE128 [r9], w, 7, %%c
    STORE128 [r9 + 16], w, 8, %%c
    STORE128 [r9 + 32], w, 9, %%c
%endif
    add     r9, r10
%assign %%c %%c + 1
%endrep
%endmacro

; PIXELS_OUT_RGB8 - the same in three bytes a pixel.
%macro PIXELS_OUT_RGB8 0
    PACK_RGB8 1, 2, 3, 1, 0
    STORE_ROW_RGB8 r9, 1
    add     r9, r10
%assign %%c 1
%rep BLOCK_HEIGHT - 1
    STORE128 x2, w, 1, %%c
    STORE_ROW_RGB8 r9, 2
    add     r9, r10
%assign %%c %%c + 1
%endrep
%endmacro

; PIXELS_OUT_RGBA8 - the same in four bytes a pixel.
%macro PIXELS_OUT_RGBA8 0
    PACK_RGBA8 1, 2, 3, 1
%assign %%c 0
%rep BLOCK_HEIGHT
%if LANES == 2
    movq    [r9], x1
%else
    STORE128 [r9], w, 1, %%c
%endif
    add     r9, r10
%assign %%c %%c + 1
%endrep
%endmacro

; SHADE_TILE - a function that shades a tile.
;
;   registers   rdi rays, rsi task; r8 block; ebx, r12d column and row of its first pixel in the tile
;               v0 1/t, v1 v2 v3 the colour, v4 v5 v14 the ray, v6 who
;               r10 a record, r13 a light, rcx lights to go, r15d lanes to go, r11 a lane's who
%macro SHADE_TILE 2
%define %%output %1     ; [in]       part of the function's name
%define %%format %2     ; [in]       F32X4, F32X3, RGBA8 or RGB8
FUNC NAME(tile, %%output)
    push    rbp
    mov     rbp, rsp
    push    rbx
    push    r12
    push    r13
    push    r14
    push    r15
    sub     rsp, FRAME
    and     rsp, -64
    imul    rax, [rsi + ShadeTask.light_count], ELEM * TileShade_size
%assign i 0
%rep LANES
    mov     [rsp + STRIDES_AT + 4 * i], eax
%assign i i + 1
%endrep
    VSPREAD v14, [rdi + ELEM * TileRays.dz]
    mov     r12d, [rsi + ShadeTask.start_row]
    and     r12d, -BLOCK_HEIGHT
.row:
    lea     eax, [r12 - TILE_HEIGHT / 2]
    VSPREAD_INTEGER 7, eax
    VADD    v7, v7, [PACKET(block_y)]
    VSPREAD v8, [rdi + ELEM * TileRays.down]
    VSPREAD v5, [rdi + ELEM * TileRays.dy]
    VFMA    v5, v7, v8, v9
    mov     r8d, r12d
    shr     r8d, HEIGHT_SHIFT
    imul    r8d, r8d, BLOCKS_X * VBYTES
    add     r8, [rsi + ShadeTask.tile]
    xor     ebx, ebx
align 16
.block:
    VLOAD   v0, [r8]
    VLOAD   v6, [r8 + WHO]
    VZERO   v1
    VZERO   v2
    VZERO   v3
    MASK_GREATER v6, [PACKET(zeros)]
    MASK_BITS r15d
    test    r15d, r15d
    jz      .shaded
    lea     eax, [rbx - TILE_WIDTH / 2]
    VSPREAD_INTEGER 7, eax
    VADD    v7, v7, [PACKET(block_x)]
    VSPREAD v8, [rdi + ELEM * TileRays.step]
    VSPREAD v4, [rdi + ELEM * TileRays.dx]
    VFMA    v4, v7, v8, v9
    VMOV    v7, v6
    LEVELS  7
    STORE_INTEGERS rsp + IDS_AT, 7
    VSPREAD v8, [r8 + WHO]
    MASK_EQUAL v6, v8
    MASK_BITS eax
    mov     rcx, [rsi + ShadeTask.light_count]
    mov     r13, [rsi + ShadeTask.lights]
    mov     r10, [rsi + ShadeTask.shades]
    cmp     eax, ALL_LANES
    jne     .mixed
    mov     eax, [rsp + IDS_AT]
    cmp     rax, [rsi + ShadeTask.sphere_count]
    jbe     .spheres
    mov     r9d, [rsp + STRIDES_AT]
    imul    rax, r9
    add     r10, rax
    test    rcx, rcx
    jz      .shaded
.same:
    VSPREAD v7, [r10 + ELEM * TileShade.cosine]
    VSPREAD v8, [r10 + ELEM * TileShade.red]
    VSPREAD v9, [r10 + ELEM * TileShade.green]
    VSPREAD v10, [r10 + ELEM * TileShade.blue]
    TRIANGLE_LIGHT
    add     r10, ELEM * TileShade_size
    add     r13, ELEM * 4
    dec     rcx
    jnz     .same
    jmp     .shaded
.mixed:
    IOP     pmulld, w7, w7, [rsp + STRIDES_AT]
    STORE_INTEGERS rsp + OFFSETS_AT, 7
    test    rcx, rcx
    jz      .shaded
.each:
    GATHER4 7, 8, 9, 10, 11, 12, 13, r10, rsp + OFFSETS_AT, ax
    TRIANGLE_LIGHT
    add     r10, ELEM * TileShade_size
    add     r13, ELEM * 4
    dec     rcx
    jnz     .each
.spheres:
    mov     eax, [rsi + ShadeTask.sphere_count]
    test    eax, eax
    jz      .shaded
    VSPREAD_INTEGER 7, eax
    MASK_NOT_LESS v7, v6                ; up to here they are spheres
    MASK_BITS eax
    and     r15d, eax
    jz      .shaded
.sphere:
    bsf     eax, r15d
    lea     r11, [r8 + WHO + ELEM * rax]
    mov     eax, [rsp + IDS_AT + 4 * rax]
    VSPREAD v7, [r11]
    MASK_EQUAL v6, v7
    MASK_BITS ecx
    not     ecx
    and     r15d, ecx                   ; the others
    mov     r10, [rsi + ShadeTask.sphere_ids]
    mov     eax, [r10 + 4 * rax - 4]
    imul    r10, rax, ELEM * TileSphere_size
    add     r10, [rsi + ShadeTask.spheres]
    mov     rcx, [rsi + ShadeTask.light_count]
    imul    rax, rcx
    shl     rax, ELEM == 8 ? 6 : 5      ; a Lit is eight elements, and so is a ShortLit
    mov     r13, rax
    test    rcx, rcx
    jz      .next_sphere
    mov     eax, [rsi + ShadeTask.column]
    add     eax, ebx
    VSPREAD_INTEGER 7, eax
    VADD    v7, v7, [PACKET(block_x)]
    SPHERE_FIELD v8, r10, column
    VSUB    v7, v7, v8                  ; x
    mov     eax, [rsi + ShadeTask.row]
    add     eax, r12d
    VSPREAD_INTEGER 8, eax
    VADD    v8, v8, [PACKET(block_y)]
    SPHERE_FIELD v9, r10, row
    VSUB    v8, v8, v9                  ; y
%if %[%%format]_FLOATS == 0
    cmp     dword [r10 + ELEM * TileSphere.short + ELEM - 4], 0
    je      .long
    add     r13, [rsi + ShadeTask.shorts]
.short:
    SHORT_LIGHT
    add     r13, ELEM * ShortLit_size
    dec     rcx
    jnz     .short
    jmp     .next_sphere
.long:
%endif
    add     r13, [rsi + ShadeTask.lits]
    SPHERE_FIELD v9, r10, dx
    SPHERE_FIELD v10, r10, dxy
    VFMA    v9, v10, v8, v15
    SPHERE_FIELD v10, r10, dxx
    VFMA    v9, v10, v7, v15
    SPHERE_FIELD v10, r10, dy
    SPHERE_FIELD v11, r10, dyy
    VFMA    v10, v11, v8, v15
    SPHERE_FIELD v11, r10, d0
    VFMA    v11, v10, v8, v15
    VFMA    v11, v9, v7, v15            ; D
    VMAX    v11, v11, [PACKET(zeros)]
    VSQRT   v9, v11
    NORMAL_OVER_T v10, x
    NORMAL_OVER_T v11, y
    NORMAL_OVER_T v12, z
.light:
    SPHERE_LIGHT
    add     r13, ELEM * Lit_size
    dec     rcx
    jnz     .light
.next_sphere:
    test    r15d, r15d
    jnz     .sphere

.shaded:
    mov     r10, [rsi + ShadeTask.pitch]
    mov     eax, r12d
    sub     eax, [rsi + ShadeTask.start_row]
    jl      .part
    lea     ecx, [r12 + BLOCK_HEIGHT]
    cmp     ecx, [rsi + ShadeTask.end_row]
    jg      .part
    lea     ecx, [rbx + BLOCK_WIDTH]
    cmp     ecx, [rsi + ShadeTask.end_column]
    jg      .part
    mov     r9d, eax
    imul    r9, r10
    imul    rax, rbx, %%format %+ _BYTES
    add     r9, rax
    add     r9, [rsi + ShadeTask.out]
    PIXELS_OUT_ %+ %%format
.next_block:
    add     r8, VBYTES
    add     ebx, BLOCK_WIDTH
    cmp     ebx, [rsi + ShadeTask.end_column]
    jl      .block
    add     r12d, BLOCK_HEIGHT
    cmp     r12d, [rsi + ShadeTask.end_row]
    jl      .row
    lea     rsp, [rbp - 40]
    pop     r15
    pop     r14
    pop     r13
    pop     r12
    pop     rbx
    pop     rbp
%if HAS_VEX
    vzeroupper
%endif
    ret

    ; A block that is only partly to be written: its pixels by way of the stack.
.part:
    mov     r9, rsp
    mov     r10d, BLOCK_WIDTH * %%format %+ _BYTES
    PIXELS_OUT_ %+ %%format
    mov     ecx, [rsi + ShadeTask.end_column]
    sub     ecx, ebx
    mov     eax, BLOCK_WIDTH
    cmp     ecx, eax
    cmovg   ecx, eax
%if %[%%format]_UNIT == 0
    imul    ecx, ecx, %%format %+ _BYTES            ; bytes in a row
%else
    imul    ecx, ecx, %%format %+ _BYTES / 4        ; numbers of 32 bits in a row
%endif
    xor     r11d, r11d                  ; row of the block
.part_row:
    lea     eax, [r12 + r11]
    cmp     eax, [rsi + ShadeTask.end_row]
    jge     .next_block
    sub     eax, [rsi + ShadeTask.start_row]
    jl      .next_part_row
    imul    rax, [rsi + ShadeTask.pitch]
    imul    r9, rbx, %%format %+ _BYTES
    add     r9, rax
    add     r9, [rsi + ShadeTask.out]
    imul    r10d, r11d, BLOCK_WIDTH * %%format %+ _BYTES
    add     r10, rsp
    xor     r13d, r13d
.number:
%if %[%%format]_UNIT == 0
    mov     al, [r10 + r13]
    mov     [r9 + r13], al
%else
    mov     eax, [r10 + 4 * r13]
    mov     [r9 + 4 * r13], eax
%endif
    inc     r13d
    cmp     r13d, ecx
    jb      .number
.next_part_row:
    inc     r11d
    cmp     r11d, BLOCK_HEIGHT
    jb      .part_row
    jmp     .next_block
    END
%endmacro

; NORMAL_OVER_T - d = one component of n / t, for the sphere at r10 with x, y, sqrt D in v7, v8, v9. Clobbers v13, v15.
;
;   n = t d - c, so that n / t = (d - h c) - sqrt(D) c, all of it over k and the radius: SPHERE_OUTSIDE.
%macro NORMAL_OVER_T 2
%define %%d %1          ; [out]      vreg
%define %%axis %2       ; [in]       x, y or z
    SPHERE_FIELD %%d, r10, m %+ %%axis
    SPHERE_FIELD v13, r10, m%[%%axis]x
    VFMA    %%d, v13, v7, v15
    SPHERE_FIELD v13, r10, m%[%%axis]y
    VFMA    %%d, v13, v8, v15
    SPHERE_FIELD v13, r10, u %+ %%axis
    VFNMA   %%d, v13, v9, v15
%endmacro

; SPHERE_LIGHT - adds what the Lit at r13 does to the colours v1, v2, v3 of the lanes whose who is that at r11, with
;                w = 1/t in v0 and m = n w in v10, v11, v12. Clobbers v7, v8, v9, v13, v15.
;
;   Seen from the centre, in radii: N . (l - n) over |l - n| is (m . l - w) / |l w - m|, without a division.
%macro SPHERE_LIGHT 0
    VSPREAD v13, [r13 + ELEM * Lit.x]
    VMUL    v13, v13, v10
    VSPREAD v8, [r13 + ELEM * Lit.y]
    VFMA    v13, v8, v11, v7
    VSPREAD v8, [r13 + ELEM * Lit.z]
    VFMA    v13, v8, v12, v7
    VSUB    v13, v13, v0
    VSPREAD v7, [r13 + ELEM * Lit.x]
    VSPREAD v8, [r13 + ELEM * Lit.y]
    VSPREAD v9, [r13 + ELEM * Lit.z]
    VFMSUB  v7, v0, v10
    VFMSUB  v8, v0, v11
    VFMSUB  v9, v0, v12
    DOT3    v7, v7, v8, v9, v7, v8, v9, v15
    COSINE  v13, v7, v8
    VSPREAD v7, [r11]
    MASK_EQUAL v6, v7
    MASK_KEEP v13
    VSPREAD v7, [r13 + ELEM * Lit.red]
    VFMA    v1, v13, v7, v8
    VSPREAD v7, [r13 + ELEM * Lit.green]
    VFMA    v2, v13, v7, v8
    VSPREAD v7, [r13 + ELEM * Lit.blue]
    VFMA    v3, v13, v7, v8
%endmacro

; SHORT_LIGHT - adds what the ShortLit at r13 does to the colours v1, v2, v3 of the lanes whose who is that at r11, with
;               w = 1/t in v0 and x, y from the sphere's origin in v7, v8. Clobbers v9 to v13, v15.
;
;   SPHERE_LIT over k and the radius: with q = d . (l - c), neither the point nor the normal nor the way to the light.
%macro SHORT_LIGHT 0
    VSPREAD v9, [r13 + ELEM * ShortLit.q0]
    VSPREAD v10, [r13 + ELEM * ShortLit.qx]
    VFMA    v9, v10, v7, v15
    VSPREAD v10, [r13 + ELEM * ShortLit.qy]
    VFMA    v9, v10, v8, v15            ; q
    VSPREAD v11, [r13 + ELEM * ShortLit.ke]
    VMUL    v11, v11, v0
    VSUB    v11, v11, v9
    VSUB    v11, v11, v9
    VMUL    v11, v11, v0                ; w (ke w - 2 q)
    VSPREAD v10, [r13 + ELEM * ShortLit.kn]
    VFMA    v9, v10, v0, v15            ; q + kn w
    COSINE  v9, v11, v12
    VSPREAD v10, [r11]
    MASK_EQUAL v6, v10
    MASK_KEEP v9
    VSPREAD v10, [r13 + ELEM * ShortLit.red]
    VFMA    v1, v9, v10, v12
    VSPREAD v10, [r13 + ELEM * ShortLit.green]
    VFMA    v2, v9, v10, v12
    VSPREAD v10, [r13 + ELEM * ShortLit.blue]
    VFMA    v3, v9, v10, v12
%endmacro

%assign ESTIMATE 0
    SHADE_TILE f32x4, F32X4
    SHADE_TILE f32x3, F32X3
%if ELEM == 4
%assign ESTIMATE 1
    SHADE_TILE f32x4_fast, F32X4
    SHADE_TILE f32x3_fast, F32X3
%endif
    SHADE_TILE rgba8, RGBA8
    SHADE_TILE rgb8, RGB8

%unmacro SD 3
%unmacro CORNER 2
%unmacro ONE_RAY 0
%unmacro ONE_CROSS 4
%unmacro ONE_EDGE 2
%unmacro ELEMENT_F64 2
%unmacro SPHERE_CROSS 4
%unmacro SPILL 0
%unmacro UNSPILL 0
%unmacro MASK_OF_BITS 0
%unmacro WHERE 5
%unmacro WHOSE 2
%unmacro ENTER_NEAREST 0
%unmacro LEAVE_NEAREST 0
%unmacro CLIP 1
%unmacro BLOCK_ROW 0
%unmacro ROW_PLANE 2
%unmacro SPHERE_FIELD 3
%unmacro STORE_INTEGERS 2
%unmacro COSINE 3
%unmacro TRIANGLE_LIGHT 0
%unmacro PIXELS_OUT_F32X4 0
%unmacro PIXELS_OUT_F32X3 0
%unmacro PIXELS_OUT_RGBA8 0
%unmacro PIXELS_OUT_RGB8 0
%unmacro SHADE_TILE 2
%unmacro NORMAL_OVER_T 2
%unmacro SPHERE_LIGHT 0
%unmacro SHORT_LIGHT 0
