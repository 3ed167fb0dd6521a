; tiles.asm - the packet tracers in object order: the nearest of many objects over a tile of pixels, shaded once.
;
; This is Algorithm 1 for many objects. Set-up has turned each triangle and each sphere into functions of a tile's
; pixels, and into bounds. Of each object only the blocks within its bounds are asked (line 14): a block is a packet of
; pixels, rows of up to four, and `near` and `who` of a tile keep the nearest of each (lines 12 to 17) in cache.
; When all objects are through, each pixel is shaded once (lines 18 to 21) and written.
;
; A block leaves an object as soon as all its pixels miss it or have something that is nearer than any point of it, so
; that it pays to ask what is near first.
;
; A ray hits or not by one predicate: in the elements of the kernel with their rounding bound, and where that leaves a
; doubt in f64, by the reference's operations in the reference's order. So bounds may leave work out, and never a hit.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_nearest_triangles  unsafe extern "sysv64" fn(planes: *const TrianglePlanes, task: *const NearestTask)
;   rayo_<p>_nearest_spheres    unsafe extern "sysv64" fn(planes: *const SpherePlanes, task: *const NearestTask)
;   rayo_<p>_tile_<output>      unsafe extern "sysv64" fn(rays: *const TileRays, task: *const ShadeTask)
;
;   <output>    f32x4, rgba8; f32x4_fast with estimates in place of roots and divisions
;   requires    the CPUID features of the ISA; memory as tile_layout.inc says

%define WHO (ELEM * Tile.who)
%define BLOCKS_X (TILE_WIDTH / BLOCK_WIDTH)
%define WIDTH_SHIFT (LANES == 2 ? 1 : 2)
%define HEIGHT_SHIFT (BLOCK_HEIGHT == 4 ? 2 : BLOCK_HEIGHT == 2 ? 1 : 0)
%define ALL_LANES ((1 << LANES) - 1)
%assign SMALL_SIDE 4                    ; pixels: a triangle whose bounds have no longer side is small

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

; IF_BELOW - jumps if a < b, or where either is NaN.
%macro IF_BELOW 3
%define %%a %1          ; [in]       128-bit register: an f64
%define %%b %2          ; [in]       128-bit register
%define %%to %3         ; [in]       label
%if HAS_VEX
    vucomisd %%a, %%b
%else
    ucomisd %%a, %%b
%endif
    jb      %%to
%endmacro

; CORNER - d = one number of f32 in f64.
%macro CORNER 2
%define %%d %1          ; [out]      128-bit register
%define %%m %2          ; [in]       memory
    SD      xorps, %%d, %%d
    SD      cvtss2sd, %%d, %%m
%endmacro

; BLOCK_PIXEL - r12d, r14d = column and row in the picture of the lane r9 of the block at r13 of row ebx of the tile.
;               Clobbers r9.
%macro BLOCK_PIXEL 0
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
%endmacro

; ONE_RAY - xmm0, xmm1, xmm2 = the ray of the pixel in column r12d and row r14d of the picture, which it clobbers.
;
;   The grid's step (i + 1/2) is half_step (2 i + 1), which is rounded alike.
%macro ONE_RAY 0
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

; ONE_EDGE - jumps to `outside` if the ray in xmm0, xmm1, xmm2 is outside the edge from corner v to corner w.
;
;   (dx ex + dy ey) + dz ez >= 0 with e = v x w, times the sign of the volume: the reference's order of operations.
%macro ONE_EDGE 3
%define %%v %1          ; [in]       a, b or c
%define %%w %2          ; [in]       a, b or c
%define %%outside %3    ; [in]       label
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
    IF_BELOW xmm6, xmm3, %%outside
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

; BEFORE_DOUBT_TRIANGLE - xmm7 = the sign of the volume of the triangle at r, for all rays that are in doubt.
%macro BEFORE_DOUBT_TRIANGLE 1
%define %%r %1          ; [in]       address in its planes' first field
    ELEMENT_F64 xmm7, [%%r + ELEM * TrianglePlanes.side]
%endmacro

; DECIDE_TRIANGLE - jumps to `outside` if the ray in xmm0, xmm1, xmm2 misses the triangle at rdx.
%macro DECIDE_TRIANGLE 1
%define %%outside %1    ; [in]       label
    ONE_EDGE a, b, %%outside
    ONE_EDGE b, c, %%outside
    ONE_EDGE c, a, %%outside
%endmacro

; SPHERE_CROSS - xmm3 = the square of one component of d x c: xmm<i> c<a> - xmm<j> c<b>.
%macro SPHERE_CROSS 4
%define %%i %1          ; [in]       0, 1 or 2
%define %%a %2          ; [in]       x, y or z
%define %%j %3          ; [in]       0, 1 or 2
%define %%b %4          ; [in]       x, y or z
    CORNER  xmm3, [rdx + Balls.%[%%a]]
    CORNER  xmm4, [rdx + Balls.%[%%b]]
    SD      mulsd, xmm3, xmm%[%%i]
    SD      mulsd, xmm4, xmm%[%%j]
    SD      subsd, xmm3, xmm4
    SD      mulsd, xmm3, xmm3
%endmacro

; BEFORE_DOUBT_SPHERE - nothing is the same for all rays that are in doubt.
%macro BEFORE_DOUBT_SPHERE 1
%define %%r %1          ; [in]       address in its planes' first field
%endmacro

; DECIDE_SPHERE - jumps to `outside` if the ray in xmm0, xmm1, xmm2 misses the sphere at rdx: r^2 d.d < |c x d|^2.
%macro DECIDE_SPHERE 1
%define %%outside %1    ; [in]       label
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
    CORNER  xmm3, [rdx + Balls.radius]
    SD      mulsd, xmm0, xmm3
    SD      mulsd, xmm0, xmm3
    IF_BELOW xmm0, xmm6, %%outside
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
%macro ENTER_NEAREST 1
%define %%room %1       ; [in]       bytes beside what SPILL and MASK_OF_BITS need, a multiple of VBYTES
    push    rbp
    mov     rbp, rsp
    PUSH_OWNED
    sub     rsp, VBYTES * 16 + %%room + 64      ; and eight numbers, from rbp - 104 on
    and     rsp, -VBYTES
%endmacro

; LEAVE - gives back what five pushes after rbp's saved, and leaves the upper parts of the registers clean.
%macro LEAVE 0
    lea     rsp, [rbp - 40]
    POP_OWNED
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

; Triangles or spheres, a packet of them at a time. Those whose bounds hold few pixels are asked together, an object in
; each lane and a pixel of its own after another; what they hit is put in a list, and then made theirs where they are
; nearest. The others are asked one by one, a block of pixels at a time.
;
; The stack of it, from rsp on, after what SPILL and MASK_OF_BITS use.
%assign MOST_STEPS (SMALL_SIDE * SMALL_SIDE)
%define ORIGIN_X (VBYTES * 16)          ; the tile's middle in the picture
%define ORIGIN_Y (ORIGIN_X + VBYTES)
%define LOW_X (ORIGIN_Y + VBYTES)       ; the window, from there
%define HIGH_X (LOW_X + VBYTES)
%define LOW_Y (HIGH_X + VBYTES)
%define HIGH_Y (LOW_Y + VBYTES)
%define FIRST_X (HIGH_Y + VBYTES)       ; of each lane's object: its first column, the one past its last,
%define PAST_X (FIRST_X + VBYTES)
%define ROW_PAST_X (PAST_X + VBYTES)    ; the same in its row
%define NOW_Y (ROW_PAST_X + VBYTES)     ; its row
%define PAST_Y (NOW_Y + VBYTES)
%define ROW_PLACE (PAST_Y + VBYTES)     ; where that row is in the tile
%define OFFSET_X (ROW_PLACE + VBYTES)   ; spheres: from the tile's middle to their own origins
%define OFFSET_Y (OFFSET_X + VBYTES)
%define INVERSES (OFFSET_Y + VBYTES)    ; what was found of a pixel of each lane: 1/t, and where it is in the tile
%define PLACES (INVERSES + MOST_STEPS * VBYTES)
%define FOUND (PLACES + MOST_STEPS * VBYTES)    ; the numbers of those that are hit, a byte each
%define SMALL_FRAME (FOUND + 256 + 64 - ORIGIN_X)
; The tile's middle.
%define MIDDLE (TILE_WIDTH / 2 * BLOCK_HEIGHT + TILE_HEIGHT / 2 * TILE_WIDTH)

; IAND - d = a & b of 32-bit numbers.
%macro IAND 3
%define %%d %1          ; [out]      register
%define %%a %2          ; [in]       register
%define %%b %3          ; [in]       register or aligned memory
%if HAS_MASKS
    vpandd  %%d, %%a, %%b
%else
    IOP     pand, %%d, %%a, %%b
%endif
%endmacro

; HALVES - v<f> = the lower half of each lane's number of 32 bits at an address, v<p> = the upper one.
%macro HALVES 3
%define %%f %1          ; [out]      number of a register
%define %%p %2          ; [out]      number of a register
%define %%m %3          ; [in]       address
%if LANES == 2
    movq    x%[%%f], [%%m]
%elif HAS_VEX
    vmovups w%[%%f], [%%m]
%else
    movups  w%[%%f], [%%m]
%endif
    IOP     psrld, w%[%%p], w%[%%f], 16
    IOP     pslld, w%[%%f], w%[%%f], 16
    IOP     psrld, w%[%%f], w%[%%f], 16
    ELEMENTS %%f
    ELEMENTS %%p
%endmacro

; ELEMENTS - v<n> = the integers in w<n>.
%macro ELEMENTS 1
%define %%n %1          ; [in/out]   number of a register
%if ELEM == 8 && HAS_VEX
    vcvtdq2pd v%[%%n], w%[%%n]
%elif ELEM == 8
    cvtdq2pd v%[%%n], w%[%%n]
%elif HAS_VEX
    vcvtdq2ps v%[%%n], w%[%%n]
%else
    cvtdq2ps v%[%%n], w%[%%n]
%endif
%endmacro

; KEEP_INTEGER - a number for all packets: the integer in eax, in every lane, to a place on the stack.
%macro KEEP_INTEGER 1
%define %%place %1      ; [out]      from rsp
    VSPREAD_INTEGER 0, eax
    VMOV_TO [rsp + %%place], v0
%endmacro

; PLANE_AT - d = the plane at the pixels of a block or of the lanes: row + factor x for x in v8.
%macro PLANE_AT 3
%define %%d %1          ; [out]      vreg
%define %%row %2        ; [in]       vreg
%define %%factor %3     ; [in]       vreg
    VMOV    %%d, %%row
    VFMA    %%d, %%factor, v8, v13
%endmacro

; Of each kind: FACTORS, what rows share; ROW, what is along a row; AT, what is asked at a pixel; INSIDE and SURE, from
; where on v9 is a hit but for the rounding, and for sure. An object of its own in each lane is loaded (VLOAD), one in
; all lanes is spread (VSPREAD).

; FACTORS_TRIANGLE - v0, v1, v2, v3 = the x factors of the edges and of 1/t, v14 = what 1/t cannot exceed.
%macro FACTORS_TRIANGLE 1
%define %%load %1       ; [in]       VLOAD or VSPREAD
    %%load  v0, [rdi + ELEM * TrianglePlanes.e1x]
    %%load  v1, [rdi + ELEM * TrianglePlanes.e2x]
    %%load  v2, [rdi + ELEM * TrianglePlanes.e3x]
    %%load  v3, [rdi + ELEM * TrianglePlanes.tx]
    %%load  v14, [rdi + ELEM * TrianglePlanes.most]
%endmacro

; ROW_PLANE - v<i> = name0 + namey y for y in v8. Clobbers v9 where it is spread.
%macro ROW_PLANE 3
%define %%load %1       ; [in]       VLOAD or VSPREAD
%define %%d %2          ; [out]      vreg
%define %%name %3       ; [in]       of TrianglePlanes
    %%load  %%d, [rdi + ELEM * TrianglePlanes. %+ %%name %+ 0]
%ifidn %%load, VLOAD
    VFMA    %%d, v8, [rdi + ELEM * TrianglePlanes. %+ %%name %+ y], v13
%else
    %%load  v9, [rdi + ELEM * TrianglePlanes. %+ %%name %+ y]
    VFMA    %%d, v9, v8, v13
%endif
%endmacro

; ROW_TRIANGLE - v4, v5, v6, v7 = the edges and 1/t along the row y in v8. Clobbers v9.
%macro ROW_TRIANGLE 1
%define %%load %1       ; [in]       VLOAD or VSPREAD
    ROW_PLANE %%load, v4, e1
    ROW_PLANE %%load, v5, e2
    ROW_PLANE %%load, v6, e3
    ROW_PLANE %%load, v7, t
%endmacro

; AT_TRIANGLE - v9 = the least of the three edges, v10 = 1/t, no more than at the nearest corner, for x in v8.
%macro AT_TRIANGLE 0
    PLANE_AT v9, v4, v0
    PLANE_AT v10, v5, v1
    VMIN    v9, v9, v10
    PLANE_AT v10, v6, v2
    VMIN    v9, v9, v10
    PLANE_AT v10, v7, v3
    VMIN    v10, v10, v14
%endmacro
%define INSIDE_TRIANGLE [PACKET(minus_ones)]
%define SURE_TRIANGLE [PACKET(ones)]

; FACTORS_SPHERE - v0 = dxx, v1 = hx, v2 and v3 = minus and plus the rounding bound, v14 = what 1/t cannot exceed, and
;                  how far its own origin is from the tile's middle. Clobbers v4, v5.
%macro FACTORS_SPHERE 1
%define %%load %1       ; [in]       VLOAD or VSPREAD
    %%load  v0, [rdi + ELEM * SpherePlanes.dxx]
    %%load  v1, [rdi + ELEM * SpherePlanes.hx]
    %%load  v3, [rdi + ELEM * SpherePlanes.bound]
    VXOR    v2, v3, [PACKET(sign)]
    %%load  v14, [rdi + ELEM * SpherePlanes.most]
    %%load  v5, [rdi + ELEM * SpherePlanes.column]
    VMOV    v4, [rsp + ORIGIN_X]
    VSUB    v4, v4, v5
    VMOV_TO [rsp + OFFSET_X], v4
    %%load  v5, [rdi + ELEM * SpherePlanes.row]
    VMOV    v4, [rsp + ORIGIN_Y]
    VSUB    v4, v4, v5
    VMOV_TO [rsp + OFFSET_Y], v4
%endmacro

; ROW_SPHERE - along the row y in v8: v4 and v5 = D at x = 0 and its linear part, v6 = h. Clobbers v9, v10, v11.
%macro ROW_SPHERE 1
%define %%load %1       ; [in]       VLOAD or VSPREAD
    VADD    v11, v8, [rsp + OFFSET_Y]
    %%load  v4, [rdi + ELEM * SpherePlanes.d0]
    %%load  v9, [rdi + ELEM * SpherePlanes.dy]
    %%load  v10, [rdi + ELEM * SpherePlanes.dyy]
    VFMA    v9, v10, v11, v13
    VFMA    v4, v9, v11, v13
    %%load  v5, [rdi + ELEM * SpherePlanes.dx]
    %%load  v9, [rdi + ELEM * SpherePlanes.dxy]
    VFMA    v5, v9, v11, v13
    %%load  v6, [rdi + ELEM * SpherePlanes.h]
    %%load  v9, [rdi + ELEM * SpherePlanes.hy]
    VFMA    v6, v9, v11, v13
%endmacro

; D_AT - v9 = D at x.
%macro D_AT 1
%define %%x %1          ; [in]       vreg, from the sphere's origin
    VMOV    v7, v5
    VFMA    v7, v0, %%x, v13
    VMOV    v9, v4
    VFMA    v9, v7, %%x, v13
%endmacro

; INVERSE_AT - v10 = 1/t = h + sqrt D at x for D in v9, no more than at the nearest point. Clobbers v7.
%macro INVERSE_AT 1
%define %%x %1          ; [in]       vreg, from the sphere's origin
    VMAX    v7, v9, [PACKET(zeros)]
    VSQRT   v7, v7
    VMOV    v10, v6
    VFMA    v10, v1, %%x, v13
    VADD    v10, v10, v7
    VMIN    v10, v10, v14
%endmacro

; AT_SPHERE - v9 = D, v10 = 1/t for x from the tile's middle in v8. Clobbers v7, v11.
%macro AT_SPHERE 0
    VADD    v11, v8, [rsp + OFFSET_X]
    D_AT    v11
    INVERSE_AT v11
%endmacro
%define INSIDE_SPHERE v2
%define SURE_SPHERE v3

; NEAREST - a function that finds the nearest of triangles or spheres.
;
;   registers   rdi planes, rdx what is turned round, both of one object or one packet; rsi task; r8 tile
;               of a packet: r10 hits, r11 pixels asked, r14 the same in every byte, r13 LANES in every byte, r15
;               numbers of lanes by masks; v0 v1 v2 v3 and v14 as FACTORS, v4 v5 v6 v7 as ROW and v9 v10 as AT make
;               them, v8 x
;               of one: r11 the first column of blocks, r14 blocks in a row, r10 those to go; ebx row, r15 the end of
;               rows; r13 block; v0 to v8 and v14 the same, v12 first x
%macro NEAREST 4
%define %%name %1       ; [in]       triangles or spheres
%define %%kind %2       ; [in]       TRIANGLE or SPHERE
%define %%planes %3     ; [in]       TrianglePlanes or SpherePlanes
%define %%turned %4     ; [in]       Corners or Balls
%if ELEM == 4                           ; registers of an element's size
%define %%cx ecx
%define %%d12 r12d
%define %%d14 r14d
%else
%define %%cx rcx
%define %%d12 r12
%define %%d14 r14
%endif
FUNC NAME(nearest, %%name)
    ENTER_NEAREST SMALL_FRAME
    mov     rdx, [rsi + NearestTask.turned]
    mov     rcx, [rsi + NearestTask.count]
    mov     r8, [rsi + NearestTask.tile]
    mov     eax, [rsi + NearestTask.column]
    add     eax, TILE_WIDTH / 2
    KEEP_INTEGER ORIGIN_X
    mov     eax, [rsi + NearestTask.row]
    add     eax, TILE_HEIGHT / 2
    KEEP_INTEGER ORIGIN_Y
    mov     eax, -(TILE_WIDTH / 2)
    KEEP_INTEGER LOW_X
    add     eax, [rsi + NearestTask.end_column]
    KEEP_INTEGER HIGH_X
    mov     eax, [rsi + NearestTask.start_row]
    sub     eax, TILE_HEIGHT / 2
    KEEP_INTEGER LOW_Y
    mov     eax, [rsi + NearestTask.end_row]
    sub     eax, TILE_HEIGHT / 2
    KEEP_INTEGER HIGH_Y
.packet:
    mov     [rbp - 80], rcx
    mov     [rbp - 88], rdi
    mov     [rbp - 96], rdx
    HALVES  0, 1, rdx + %%turned %+ .columns
    VSUB    v0, v0, [rsp + ORIGIN_X]
    VSUB    v1, v1, [rsp + ORIGIN_X]
    VMAX    v0, v0, [rsp + LOW_X]
    VMIN    v1, v1, [rsp + HIGH_X]
    HALVES  2, 3, rdx + %%turned %+ .rows
    VSUB    v2, v2, [rsp + ORIGIN_Y]
    VSUB    v3, v3, [rsp + ORIGIN_Y]
    VMAX    v2, v2, [rsp + LOW_Y]
    VMIN    v3, v3, [rsp + HIGH_Y]
    VSUB    v4, v1, v0
    VSUB    v5, v3, v2
    VMIN    v6, v4, v5
    MASK_GREATER v6, [PACKET(zeros)]
    MASK_BITS eax                       ; those that are in the window
    test    eax, eax
    jz      .next_packet
    VMAX    v4, v4, v5
    VMOV    v5, [PACKET(small)]
    MASK_AND_NOT_LESS v5, v4, v6
    MASK_BITS ebx
    lea     r15, [lanes_of_mask]
    movzx   r9d, bl
    movzx   r9d, byte [r15 + 8 * 256 + r9]
%if LANES == 16
    mov     r10d, ebx
    shr     r10d, 8
    movzx   r10d, byte [r15 + 8 * 256 + r10]
    add     r9d, r10d
%endif
    cmp     r9d, LANES / 2 + 1
    jb      .no_small                   ; few do better by themselves
    xor     eax, ebx
    mov     [rbp - 104], eax
    VMOV    v4, [rsp + LOW_X]
    VSELECT v4, v1
    VMOV_TO [rsp + FIRST_X], v0
    VMOV_TO [rsp + PAST_X], v4
    VMOV_TO [rsp + NOW_Y], v2
    VMOV_TO [rsp + PAST_Y], v3
    FACTORS_%[%%kind] VLOAD
    mov     r13, 0x0101010101010101 * LANES
    xor     r10d, r10d
    xor     r11d, r11d
    xor     r14d, r14d
.lanes_row:
    VMOV    v8, [rsp + NOW_Y]
    VMOV    v9, [rsp + PAST_Y]
    MASK_GREATER v9, v8
    MASK_BITS eax
    test    eax, eax
    jz      .lanes_done
    VMOV    v9, [rsp + LOW_X]
    VMOV    v10, [rsp + PAST_X]
    VSELECT v9, v10
    VMOV_TO [rsp + ROW_PAST_X], v9
    ROW_%[%%kind] VLOAD
    VMOV    v9, v8
    LEVELS  9
%if BLOCK_HEIGHT > 1
    IAND    w10, w9, [PACKET(in_block_y)]
    IOP     psubd, w9, w9, w10
    IOP     pslld, w10, w10, WIDTH_SHIFT
%endif
    IOP     pslld, w9, w9, 6            ; TILE_WIDTH is 64
%if BLOCK_HEIGHT > 1
    IOP     paddd, w9, w9, w10
%endif
    VMOV_TO [rsp + ROW_PLACE], v9
    VADD    v8, v8, [PACKET(ones)]
    VMOV_TO [rsp + NOW_Y], v8
    VMOV    v8, [rsp + FIRST_X]
.lanes_pixel:
    VMOV    v12, [rsp + ROW_PAST_X]
    MASK_GREATER v12, v8
    MASK_BITS eax
    test    eax, eax
    jz      .lanes_row
    AT_%[%%kind]
    MASK_AND_NOT_LESS v9, INSIDE_%[%%kind], v13
    MASK_BITS eax
    WHERE   r9d, v9, SURE_%[%%kind], 1, v13
    test    r9d, r9d
    jnz     .lanes_doubt
.lanes_hit:
    VMOV_TO [rsp + INVERSES + ELEM * r11], v10
    VMOV    v11, v8
    LEVELS  11
%if BLOCK_HEIGHT > 1
    IAND    w12, w11, [PACKET(of_block_x)]
    IOP     paddd, w11, w11, w12
%if BLOCK_HEIGHT == 4
    IOP     pslld, w12, w12, 1
    IOP     paddd, w11, w11, w12
%endif
%endif
    IOP     paddd, w11, w11, [rsp + ROW_PLACE]
    STORE_NUMBERS rsp + PLACES + 4 * r11, 11
%if LANES == 16
    movzx   r9d, al
    mov     r12, [r15 + 8 * r9]
    add     r12, r14
    mov     [rsp + FOUND + r10], r12
    movzx   r9d, byte [r15 + 8 * 256 + r9]
    add     r10d, r9d
    shr     eax, 8
    mov     r12, [r15 + 8 * rax]
    mov     r9, 0x0808080808080808
    add     r12, r9
    add     r12, r14
%else
    mov     r12, [r15 + 8 * rax]
    add     r12, r14
%endif
    mov     [rsp + FOUND + r10], r12
    movzx   eax, byte [r15 + 8 * 256 + rax]
    add     r10d, eax
    add     r14, r13
    add     r11d, LANES
    VADD    v8, v8, [PACKET(ones)]
    jmp     .lanes_pixel

    ; The pixels of the list: nearer is what is greater, which is so of their bits too, since none is below 0.
.lanes_done:
    xor     r11d, r11d
    jmp     .more_found
align 16
.found:
    movzx   eax, byte [rsp + FOUND + r11]
    mov     r9d, eax
    and     r9d, LANES - 1
    mov     %%cx, [rsp + INVERSES + ELEM * rax]
    movsxd  rax, dword [rsp + PLACES + 4 * rax]
    mov     %%d12, [r8 + ELEM * (rax + MIDDLE)]
    mov     %%d14, [r8 + WHO + ELEM * (rax + MIDDLE)]
    cmp     %%cx, %%d12
    je      .found_tie
    cmovg   %%d12, %%cx
    cmovg   %%d14, [rdi + ELEM * (r9 + %%planes %+ .id)]
    mov     [r8 + ELEM * (rax + MIDDLE)], %%d12
    mov     [r8 + WHO + ELEM * (rax + MIDDLE)], %%d14
.next_found:
    inc     r11d
.more_found:
    cmp     r11d, r10d
    jb      .found
    jmp     .large

    ; As near as another: the first in the scene stays. Nobody comes first of all.
.found_tie:
    mov     r13, [rsi + NearestTask.order]
    WHOSE   r12d, [r8 + WHO + ELEM * (rax + MIDDLE)]
    mov     r12d, [r13 + 4 * r12]
    WHOSE   ecx, [rdi + ELEM * (r9 + %%planes %+ .id)]
    cmp     r12d, [r13 + 4 * rcx]
    jbe     .next_found
    mov     %%d14, [rdi + ELEM * (r9 + %%planes %+ .id)]
    mov     [r8 + WHO + ELEM * (rax + MIDDLE)], %%d14
    jmp     .next_found

    ; The lanes of r9d are within the rounding of an edge.
.lanes_doubt:
    SPILL
    mov     [rbp - 48], r14
    mov     [rbp - 56], r9
.doubtful_lane:
    bsf     r9d, [rbp - 56]
    WHOSE   r12d, [rsp + VBYTES * 8 + ELEM * r9]        ; v8
    add     r12d, [rsi + NearestTask.column]
    add     r12d, TILE_WIDTH / 2
    WHOSE   r14d, [rsp + NOW_Y + ELEM * r9]
    add     r14d, [rsi + NearestTask.row]
    add     r14d, TILE_HEIGHT / 2 - 1   ; it is the next row already
    BEFORE_DOUBT_%[%%kind] rdi + ELEM * r9
    lea     rdx, [rdx + 4 * r9]
    ONE_RAY
    DECIDE_%[%%kind] .lane_outside
    jmp     .lane_decided
.lane_outside:
    btr     eax, r9d
.lane_decided:
    mov     rdx, [rbp - 96]
    mov     r12d, [rbp - 56]
    lea     r9d, [r12 - 1]
    and     r9d, r12d
    mov     [rbp - 56], r9d
    jnz     .doubtful_lane
    mov     r14, [rbp - 48]
    UNSPILL
    jmp     .lanes_hit

.no_small:
    mov     [rbp - 104], eax
    ; Those that are asked one by one.
.large:
    mov     eax, [rbp - 104]
    test    eax, eax
    jz      .next_packet
    bsf     r9d, eax
    btr     eax, r9d
    mov     [rbp - 104], eax
    mov     rdi, [rbp - 88]
    mov     rdx, [rbp - 96]
    lea     rdi, [rdi + ELEM * r9]
    lea     rdx, [rdx + 4 * r9]
    mov     eax, [rdx + %%turned %+ .columns]
    mov     ebx, [rdx + %%turned %+ .rows]
    CLIP    .large
    mov     r11d, r9d
    sub     eax, r9d
    mov     r14d, eax                   ; blocks in a row
    FACTORS_%[%%kind] VSPREAD
    shl     r9d, WIDTH_SHIFT
    sub     r9d, TILE_WIDTH / 2
    VSPREAD_INTEGER 12, r9d
    VADD    v12, v12, [PACKET(block_x)]
%ifidn %%kind, SPHERE
    VADD    v12, v12, [rsp + OFFSET_X]
%endif
.row:
    lea     r9d, [rbx - TILE_HEIGHT / 2]
    VSPREAD_INTEGER 8, r9d
    VADD    v8, v8, [PACKET(block_y)]
    ROW_%[%%kind] VSPREAD
    VMOV    v8, v12
    BLOCK_ROW
    mov     r10d, r14d
align 16
.block:
%ifidn %%kind, SPHERE
    D_AT    v8
    VLOAD   v11, [r13]
    MASK_NOT_LESS v9, INSIDE_SPHERE
    MASK_AND_NOT_LESS v14, v11, v13     ; its nearest point is not behind what is there
    MASK_BITS eax
    test    eax, eax
    jz      .next_block
    INVERSE_AT v8
    MASK_AND_NOT_LESS v10, v11, v13     ; of no lane, often: a branch would not be foreseen
%else
    AT_TRIANGLE
    VLOAD   v11, [r13]
    MASK_NOT_LESS v9, INSIDE_TRIANGLE
    MASK_AND_NOT_LESS v10, v11, v13
    MASK_BITS eax
    test    eax, eax
    jz      .next_block
%endif
%if HAS_MASKS
    VOP     cmp, k2 {MASK}, v10, v11, 0
    VOP     cmp, k3 {MASK}, v9, SURE_%[%%kind], 17
    kortestw k2, k3
    jnz     .rare
%else
    WHERE   r9d, v10, v11, 0, v13
    test    r9d, r9d
    jnz     .tie
.first:
    WHERE   r9d, v9, SURE_%[%%kind], 1, v13
    test    r9d, r9d
    jnz     .doubt
%endif
.nearest:
    MASK_STORE [r13], v10, v11
    VSPREAD v10, [rdi + ELEM * %%planes %+ .id]
    MASK_STORE [r13 + WHO], v10, v11
.next_block:
    VADD    v8, v8, [PACKET(block_step)]
    add     r13, VBYTES
    dec     r10d
    jnz     .block
    add     ebx, BLOCK_HEIGHT
    cmp     ebx, r15d
    jl      .row
    jmp     .large
.next_packet:
    mov     rdi, [rbp - 88]
    mov     rdx, [rbp - 96]
    mov     rcx, [rbp - 80]
    add     rdi, VBYTES
    add     rdx, 4 * LANES
    sub     rcx, LANES
    ja      .packet
    LEAVE
    ret

%if HAS_MASKS
    ; Some lanes have another object that is as near, or are in doubt.
.rare:
    kmovw   r9d, k2
    test    r9d, r9d
    jnz     .tie
.first:
    WHERE   r9d, v9, SURE_%[%%kind], 1, v13
    test    r9d, r9d
    jnz     .doubt
    jmp     .nearest
%endif

    ; The lanes of r9d have another object that is as near: the first in the scene stays. Nobody comes first of all.
.tie:
    MASK_BITS eax
    mov     [rbp - 48], r14
    mov     [rbp - 56], r10
    mov     r14, [rsi + NearestTask.order]
    WHOSE   r10d, [rdi + ELEM * %%planes %+ .id]
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
    MASK_BITS eax
    SPILL
    mov     [rbp - 48], r14
    mov     [rbp - 56], r10
    mov     r10d, r9d
    BEFORE_DOUBT_%[%%kind] rdi
.lane:
    bsf     r9d, r10d
    BLOCK_PIXEL
    ONE_RAY
    DECIDE_%[%%kind] .outside
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
%endmacro

; NEAREST_TILES - the functions that find the nearest, for one element type.
%macro NEAREST_TILES 0
    NEAREST triangles, TRIANGLE, TrianglePlanes, Corners
    NEAREST spheres, SPHERE, SpherePlanes, Balls
%endmacro

; SPHERE_FIELD - d = a field of the sphere at a general register, in every lane.
%macro SPHERE_FIELD 3
%define %%d %1          ; [out]      vreg
%define %%sphere %2     ; [in]       general register
%define %%field %3      ; [in]       of TileSphere
    VSPREAD %%d, [%%sphere + ELEM * TileSphere. %+ %%field]
%endmacro

; The stack of the shading functions, from rsp on.
%assign PIXELS_AT 0                     ; a block of pixels
%define IDS_AT (16 * LANES)             ; who, as integers
%define OFFSETS_AT (IDS_AT + 64)        ; of their shades
%define STRIDES_AT (OFFSETS_AT + 64)    ; bytes from one object's shades to the next one's, in every lane
%define ROWS_AT (STRIDES_AT + 64)       ; of the pixels of a block in the picture
%define MIDDLE_AT (ROWS_AT + 64)        ; the tile's middle column
%define WHOLE_AT (MIDDLE_AT + 64)       ; up to which column of the tile the row's blocks are written whole
%define COLUMNS_AT (WHOLE_AT + 64)      ; COLUMNS, where that is not a register
%define FRAME (COLUMNS_AT + 64)

; COLUMNS - the columns in the picture of a block's pixels: a register where there are 32, since each block waits for
;           the one before.
%if HAS_MASKS
%xdefine COLUMNS VREG %+ 16
%else
%define COLUMNS [rsp + COLUMNS_AT]
%endif

; ELEMENT_OPERAND - ONE = an element of memory in every lane, as the last operand of an operation: the memory itself
;                   where an operation can spread it.
%macro ELEMENT_OPERAND 2
%define %%m %1          ; [in]       memory: one element
%define %%s %2          ; [clobbered without mask registers] vreg
%if HAS_MASKS && ELEM == 4
%xdefine ONE dword %%m {1to16}
%elif HAS_MASKS
%xdefine ONE qword %%m {1to8}
%else
    VSPREAD %%s, %%m
%xdefine ONE %%s
%endif
%endmacro

; COSINE - d = d / sqrt q, from 0 to 1; NaN gives 0.
%macro COSINE 3
%define %%d %1          ; [in/out]   vreg
%define %%q %2          ; [clobbered] vreg
%define %%t %3          ; [clobbered] vreg
%if ESTIMATE
    VRSQRT  %%t, %%q
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

; NEXT_SHADE - goes on to the next light and what it does to triangles, of which there are rcx.
%macro NEXT_SHADE 1
%define %%loop %1       ; [in]       label
    add     r10, ELEM * TileShade_size
    add     r13, ELEM * 4
    dec     rcx
    jnz     %%loop
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
;               r14 where the block's first pixel goes
;               r10 a record, r13 a light, rcx lights to go, r15d lanes to go, r11 a lane's who
%macro SHADE_TILE 2
%define %%output %1     ; [in]       part of the function's name
%define %%format %2     ; [in]       F32X4 or RGBA8
FUNC NAME(tile, %%output)
    push    rbp
    mov     rbp, rsp
    PUSH_OWNED
    sub     rsp, FRAME
    and     rsp, -64
    imul    rax, [rsi + ShadeTask.light_count], ELEM * TileShade_size
%assign i 0
%rep LANES
    mov     [rsp + STRIDES_AT + 4 * i], eax
%assign i i + 1
%endrep
    mov     eax, [rsi + ShadeTask.column]
    add     eax, TILE_WIDTH / 2
    VSPREAD_INTEGER 7, eax
    VMOV_TO [rsp + MIDDLE_AT], v7
    VSPREAD v14, [rdi + ELEM * TileRays.dz]
    mov     r12d, [rsi + ShadeTask.start_row]
    and     r12d, -BLOCK_HEIGHT
.row:
    mov     eax, [rsi + ShadeTask.column]
    VSPREAD_INTEGER 7, eax
    VADD    v7, v7, [PACKET(block_x)]
    VMOV_TO COLUMNS, v7
    mov     eax, [rsi + ShadeTask.row]
    add     eax, r12d
    VSPREAD_INTEGER 7, eax
    VADD    v7, v7, [PACKET(block_y)]
    VMOV_TO [rsp + ROWS_AT], v7
    xor     ecx, ecx
    mov     r9d, [rsi + ShadeTask.end_column]
    and     r9d, -BLOCK_WIDTH
    lea     eax, [r12 + BLOCK_HEIGHT]
    cmp     eax, [rsi + ShadeTask.end_row]
    cmovg   r9d, ecx
    mov     eax, r12d
    sub     eax, [rsi + ShadeTask.start_row]
    cmovl   r9d, ecx
    mov     [rsp + WHOLE_AT], r9d
    movsxd  r14, eax
    imul    r14, [rsi + ShadeTask.pitch]
    add     r14, [rsi + ShadeTask.out]
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
    cmp     qword [rsi + ShadeTask.triangle_count], 0
    je      .sphere
    VMOV    v7, v6
    LEVELS  7
    STORE_NUMBERS rsp + IDS_AT, 7
    VMOV    v9, COLUMNS
    VSUB    v9, v9, [rsp + MIDDLE_AT]
    VSPREAD v8, [rdi + ELEM * TileRays.step]
    VSPREAD v4, [rdi + ELEM * TileRays.dx]
    VFMA    v4, v9, v8, v10
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
    NEXT_SHADE .same
    jmp     .shaded
.mixed:
    IOP     pmulld, w7, w7, [rsp + STRIDES_AT]
    STORE_NUMBERS rsp + OFFSETS_AT, 7
    test    rcx, rcx
    jz      .shaded
.each:
    GATHER4 7, 8, 9, 10, 11, 12, 13, r10, rsp + OFFSETS_AT, ax
    TRIANGLE_LIGHT
    NEXT_SHADE .each
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
    WHOSE   eax, [r11]
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
    VMOV    v7, COLUMNS
    ELEMENT_OPERAND [r10 + ELEM * TileSphere.column], v9
    VSUB    v7, v7, ONE                 ; x
    VMOV    v8, [rsp + ROWS_AT]
    ELEMENT_OPERAND [r10 + ELEM * TileSphere.row], v9
    VSUB    v8, v8, ONE                 ; y
%if %[%%format]_FLOATS == 0
    cmp     dword [r10 + ELEM * TileSphere.short + ELEM - 4], 0
    je      .long
    add     r13, [rsi + ShadeTask.shorts]
.short:
    SHORT_LIGHT
    add     r13, ELEM * ShortLit_size
    dec     rcx
    jnz     .short
%else
    LONG_LIGHTS
%endif
.next_sphere:
    test    r15d, r15d
    jnz     .sphere

.shaded:
    cmp     ebx, [rsp + WHOLE_AT]
    jge     .part
    mov     r9, r14
    mov     r10, [rsi + ShadeTask.pitch]
    PIXELS_OUT_ %+ %%format
.next_block:
    VMOV    v7, COLUMNS
    VADD    v7, v7, [PACKET(block_step)]
    VMOV_TO COLUMNS, v7
    add     r8, VBYTES
    add     r14, BLOCK_WIDTH * %%format %+ _BYTES
    add     ebx, BLOCK_WIDTH
    cmp     ebx, [rsi + ShadeTask.end_column]
    jl      .block
    add     r12d, BLOCK_HEIGHT
    cmp     r12d, [rsi + ShadeTask.end_row]
    jl      .row
    LEAVE
    ret

%if %[%%format]_FLOATS == 0
.long:
    LONG_LIGHTS
    jmp     .next_sphere
%endif

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
    imul    ecx, ecx, %%format %+ _BYTES / 4        ; numbers of 32 bits in a row
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
    mov     eax, [r10 + 4 * r13]
    mov     [r9 + 4 * r13], eax
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

; LONG_LIGHTS - adds what all lights, of which there are rcx, do to the sphere at r10 with x, y in v7, v8, in the long
;               form.
%macro LONG_LIGHTS 0
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

; ADD_LIGHT - adds a cosine times the weights of the light at r13 to the colours v1, v2, v3 of the lanes whose who is
;             that at r11: those of the mask, where no operation without FMA has clobbered it.
%macro ADD_LIGHT 4
%define %%cosine %1     ; [in/out]   vreg
%define %%record %2     ; [in]       Lit or ShortLit
%define %%s %3          ; [clobbered] vreg
%define %%t %4          ; [clobbered] vreg
%if HAS_FMA == 0
    VSPREAD %%s, [r11]
    MASK_EQUAL v6, %%s
%endif
    MASK_KEEP %%cosine
    ELEMENT_OPERAND [r13 + ELEM * %%record %+ .red], %%s
    VFMA    v1, %%cosine, ONE, %%t
    ELEMENT_OPERAND [r13 + ELEM * %%record %+ .green], %%s
    VFMA    v2, %%cosine, ONE, %%t
    ELEMENT_OPERAND [r13 + ELEM * %%record %+ .blue], %%s
    VFMA    v3, %%cosine, ONE, %%t
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
    ADD_LIGHT v13, Lit, v7, v8
%endmacro

; SHORT_LIGHT - adds what the ShortLit at r13 does to the colours v1, v2, v3 of the lanes whose who is that at r11, with
;               w = 1/t in v0 and x, y from the sphere's origin in v7, v8. Clobbers v9 to v13, v15.
;
;   SPHERE_LIT over k and the radius: with q = d . (l - c), neither the point nor the normal nor the way to the light.
%macro SHORT_LIGHT 0
    VSPREAD v9, [r13 + ELEM * ShortLit.q0]
    ELEMENT_OPERAND [r13 + ELEM * ShortLit.qx], v10
    VFMA    v9, v7, ONE, v15
    ELEMENT_OPERAND [r13 + ELEM * ShortLit.qy], v10
    VFMA    v9, v8, ONE, v15            ; q
    ELEMENT_OPERAND [r13 + ELEM * ShortLit.ke], v11
    VMUL    v11, v0, ONE
    VSUB    v11, v11, v9
    VSUB    v11, v11, v9
    VMUL    v11, v11, v0                ; w (ke w - 2 q)
    ELEMENT_OPERAND [r13 + ELEM * ShortLit.kn], v10
    VFMA    v9, v0, ONE, v15            ; q + kn w
    COSINE  v9, v11, v12
    ADD_LIGHT v9, ShortLit, v10, v12
%endmacro

; SHADE_TILES - the functions that shade, for one element type.
%macro SHADE_TILES 0
%assign ESTIMATE 0
    SHADE_TILE f32x4, F32X4
%if ELEM == 4
%assign ESTIMATE 1
    SHADE_TILE f32x4_fast, F32X4
%endif
    SHADE_TILE rgba8, RGBA8
%endmacro
