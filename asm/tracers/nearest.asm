; nearest.asm - the packet tracers in object order, first half: the nearest of many objects over a tile of pixels.
;
; This is Algorithm 1 for many objects, without the light. Set-up has made each triangle and each sphere a function of a
; tile's pixels, with bounds. An object is tested only against the blocks within its bounds (line 14): a block is a
; packet of pixels, in rows of up to four, and `near` and `who` of a tile keep the nearest hit of each pixel (lines 12
; to 17) in cache.
;
; A large triangle is tested only against the blocks from the first to the last of a row that are not wholly outside an
; edge: each edge is evaluated where it is greatest in a block, for all blocks of a row at once.
;
; A test ends as soon as all pixels of the block miss the object or hold something nearer than any point of it, so it
; pays to test near objects first.
;
; One predicate decides whether a ray hits: in the elements of the kernel with their rounding bound, and where that
; leaves a doubt in f64. For triangles that is by the reference's operations in the reference's order; for spheres by
; its formula for those further away than sqrt 2 radii, with one rounding more. So bounds save work and lose no hit:
; docs/no-hit-is-lost.md.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_nearest_triangles  unsafe extern "sysv64" fn(planes: *const TrianglePlanes, task: *const NearestTask)
;   rayo_<p>_nearest_spheres    unsafe extern "sysv64" fn(planes: *const SpherePlanes, task: *const NearestTask)
;
;   requires    the CPUID features of the ISA; memory as tile_layout.inc says
;   equals      kernels::portable::nearest::nearest, to the last bit

%assign SMALL_SIDE 4                    ; pixels: a triangle whose bounds have no longer side is small

; BLOCK_PIXEL - r12d, r14d = column and row in the picture of lane r9 of the block at r13, which is in row ebx of the
;               tile. Clobbers r9.
%macro BLOCK_PIXEL 0
    mov     r12, r13
    sub     r12, r8
    shr     r12, ilog2e(VBYTES)
    and     r12d, BLOCKS_X - 1
    shl     r12d, ilog2e(BLOCK_WIDTH)
    mov     r14d, r9d
    and     r9d, BLOCK_WIDTH - 1
    add     r12d, r9d
    add     r12d, [rsi + NearestTask.column]
    shr     r14d, ilog2e(BLOCK_WIDTH)
    add     r14d, ebx
    add     r14d, [rsi + NearestTask.row]
%endmacro

; BEFORE_DOUBT_TRIANGLE - xmm7 = the sign of the volume of the triangle at r, for all rays in doubt.
%macro BEFORE_DOUBT_TRIANGLE 1
%define %%r %1          ; [in]       address in its planes' first field
    ELEMENT_F64 xmm7, [%%r + ELEM * TrianglePlanes.side]
%endmacro

; BEFORE_DOUBT_SPHERE - empty: the rays in doubt about a sphere share no value.
%macro BEFORE_DOUBT_SPHERE 1
%define %%r %1          ; [in]       address in its planes' first field
%endmacro

; The decision in f64 for the ray in xmm0, xmm1, xmm2; the last argument is a label.
%define DECIDE_TRIANGLE IF_OUTSIDE_TRIANGLE xmm0, xmm1, xmm2, rdx, xmm7, xmm6, xmm3, xmm4, xmm5,
%define DECIDE_SPHERE IF_OUTSIDE_SPHERE xmm0, xmm1, xmm2, rdx, xmm6, xmm3, xmm4,

; SPILL - stores v0 to v14 on the stack.
%macro SPILL 0
%assign %%i 0
%rep 15
    VMOV_TO [rsp + NearestStack.spilled + VBYTES * %%i], v%[%%i]
%assign %%i %%i + 1
%endrep
%endmacro

; UNSPILL - restores what SPILL stored.
%macro UNSPILL 0
%assign %%i 0
%rep 15
    VMOV    v%[%%i], [rsp + NearestStack.spilled + VBYTES * %%i]
%assign %%i %%i + 1
%endrep
%endmacro

; MASK_OF_BITS - the mask = the bits of eax; clobbers r12 and the stack above SPILL.
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
    mov     [rsp + NearestStack.bits + 4 * %%i], r12d
%else
    mov     [rsp + NearestStack.bits + 8 * %%i], r12
%endif
%assign %%i %%i + 1
%endrep
    VMOV    MASK, [rsp + NearestStack.bits]
%endif
%endmacro

; WHERE - r = a bit for each lane of the mask where a < b, or where a = b.
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

; CLIP - clips bounds in eax (columns) and ebx (rows) to the tile: blocks r9 to eax across, and from pixel row ebx to
;        r15d; jumps to `none` if nothing is left. Clobbers r10.
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
    shr     r9d, ilog2e(BLOCK_WIDTH)
    add     eax, BLOCK_WIDTH - 1
    shr     eax, ilog2e(BLOCK_WIDTH)
    and     ebx, -BLOCK_HEIGHT
%endmacro

; BLOCK_ROW - r13 = the address of block r9 in row ebx of the tile at r8.
%macro BLOCK_ROW 0
    mov     r13d, ebx
%if BLOCK_HEIGHT > 1
    shr     r13d, ilog2e(BLOCK_HEIGHT)
%endif
    imul    r13d, r13d, BLOCKS_X
    add     r13d, r9d
    shl     r13, ilog2e(VBYTES)
    add     r13, r8
%endmacro

; Triangles or spheres, a packet of them at a time. Small ones are tested together: each lane has one object and goes
; through its pixels one by one; hits are listed, and then entered in the tile where they are nearest. The others are
; tested one by one, a block of pixels at a time.
;
; The stack, from rsp on.
%assign MOST_STEPS (SMALL_SIDE * SMALL_SIDE)
struc NearestStack
    .spilled:       resb VBYTES * 15
    .bits:          resb VBYTES         ; of MASK_OF_BITS
    .origin_x:      resb VBYTES         ; the tile's middle in the picture
    .origin_y:      resb VBYTES
    .low_x:         resb VBYTES         ; the window, relative to the tile's middle
    .high_x:        resb VBYTES
    .low_y:         resb VBYTES
    .high_y:        resb VBYTES
    .first_x:       resb VBYTES         ; of each lane's object: its first column, one past its last,
    .past_x:        resb VBYTES
    .row_past_x:    resb VBYTES         ; one past the last in its current row
    .now_y:         resb VBYTES         ; the current row
    .past_y:        resb VBYTES
    .row_place:     resb VBYTES         ; where the current row is in the tile
    .offset_x:      resb VBYTES         ; spheres: from the tile's middle to their own origins
    .offset_y:      resb VBYTES
    .reach1:        resb VBYTES         ; REACH(1) to REACH(3), where they are not registers
    .reach2:        resb VBYTES
    .reach3:        resb VBYTES
    .inverses:      resb VBYTES * MOST_STEPS    ; found for one pixel of each lane: 1/t, ...
    .places:        resb VBYTES * MOST_STEPS    ; ... and its place in the tile
    .found:         resb 256 + 64       ; the indices of hits in inverses and places, a byte each
    .numbers:       resq 9              ; the variables below, relative to rbp
endstruc
%define SAVED_R14 rbp - 48
%define SAVED_R10 rbp - 56
%define DOUBTFUL rbp - 56               ; lanes of a packet
%define FIRST_ORDER rbp - 72            ; the object's place in the scene
%define COUNT rbp - 80                  ; objects left
%define PLANES_AT rbp - 88              ; planes of the packet
%define ARRAYS_AT rbp - 96
%define ONE_BY_ONE rbp - 104            ; lanes whose objects are to be tested one by one
%define ACROSS rbp - 112                ; a bit for each block of a row within the bounds

; OWN_ID - the id of the object that is tested; REACH(i) - its edge i where that is greatest in a block: registers where
;          there are 32.
%if HAS_MASKS
%xdefine OWN_ID VREG %+ 17
%xdefine REACH1 VREG %+ 18
%xdefine REACH2 VREG %+ 19
%xdefine REACH3 VREG %+ 20
%else
%define REACH1 [rsp + NearestStack.reach1]
%define REACH2 [rsp + NearestStack.reach2]
%define REACH3 [rsp + NearestStack.reach3]
%endif
%define REACH(i) REACH %+ i

; The tile's middle.
%define MIDDLE (TILE_WIDTH / 2 * BLOCK_HEIGHT + TILE_HEIGHT / 2 * TILE_WIDTH)

; HALVES - v<f> = the lower half of each lane's 32-bit number at an address, v<p> = the upper half.
%macro HALVES 3
%define %%f %1          ; [out]      number of a register
%define %%p %2          ; [out]      number of a register
%define %%m %3          ; [in]       address
%if LANES == 2
    movq    x%[%%f], [%%m]
%else
    VEX(movups) w%[%%f], [%%m]
%endif
    IOP     psrld, w%[%%p], w%[%%f], 16
    IOP     pslld, w%[%%f], w%[%%f], 16
    IOP     psrld, w%[%%f], w%[%%f], 16
    VOP     cvtdq2, v%[%%f], w%[%%f]
    VOP     cvtdq2, v%[%%p], w%[%%p]
%endmacro

; KEEP_INTEGER - stores the integer in eax on the stack, in every lane, for all packets.
%macro KEEP_INTEGER 1
%define %%place %1      ; [out]      field of NearestStack
    VSPREAD_INTEGER 0, eax
    VMOV_TO [rsp + NearestStack. %+ %%place], v0
%endmacro

; For each kind of object: FACTORS loads what all rows share, ROW evaluates it along a row, AT at a pixel; INSIDE and
; SURE are the values of v9 from which it may be a hit, within rounding, and from which it surely is. VLOAD loads a
; different object in each lane, VSPREAD the same in all lanes.

; FACTORS_TRIANGLE - v0, v1, v2, v3 = the coefficients of x in the edges and in 1/t, v14 = the upper bound of 1/t.
%macro FACTORS_TRIANGLE 1
%define %%load %1       ; [in]       VLOAD or VSPREAD
    %%load  v0, [rdi + ELEM * TrianglePlanes.e1x]
    %%load  v1, [rdi + ELEM * TrianglePlanes.e2x]
    %%load  v2, [rdi + ELEM * TrianglePlanes.e3x]
    %%load  v3, [rdi + ELEM * TrianglePlanes.tx]
    %%load  v14, [rdi + ELEM * TrianglePlanes.most]
%endmacro

; REACHES - REACH(i) = (e0 + (BLOCK_WIDTH - 1) |ex|) + (BLOCK_HEIGHT - 1) |ey|: an upper bound of edge i in a block that
;           begins at (0, 0). ex are in v0, v1, v2. Clobbers v4, v5, v6.
%macro REACHES 0
%assign %%i 0
%rep 3
%assign %%e %%i + 1
    VSPREAD v4, [rdi + ELEM * TrianglePlanes.e%[%%e]0]
    VABS    v5, v%[%%i]
    VFMA    v4, v5, [PACKET(to_last_column)], v6
%if BLOCK_HEIGHT > 1
    VSPREAD v5, [rdi + ELEM * TrianglePlanes.e%[%%e]y]
    VABS    v5, v5
    VFMA    v4, v5, [PACKET(to_last_row)], v6
%endif
    VMOV_TO REACH(%[%%e]), v4
%assign %%i %%i + 1
%endrep
%endmacro

; REACHED - of the blocks of a row within the bounds, those from the first, r9d, to the last that is not wholly outside
;           an edge, r10d blocks: where REACH(i) + ey y + ex x is at least -4, rounding and doubt being within 3. y is
;           in v8. Jumps to `none` if there is none. Clobbers v4, v5, v6, v9, v10, v13, eax.
%macro REACHED 1
%define %%none %1       ; [in]       label
%assign %%e 1
%rep 3
%assign %%i 3 + %%e
    VSPREAD v9, [rdi + ELEM * TrianglePlanes.e%[%%e]y]
    VMOV    v%[%%i], REACH(%[%%e])
    VFMA    v%[%%i], v9, v8, v13
%assign %%e %%e + 1
%endrep
    xor     eax, eax
%assign %%g 0
%rep BLOCKS_X / LANES                   ; a block in each lane
    VMOV    v10, [PACKET(block_columns) + VBYTES * %%g]
    PLANE_AT v9, v4, v0, v10, v13
    MASK_NOT_LESS v9, [PACKET(never)]
    PLANE_AT v9, v5, v1, v10, v13
    MASK_AND_NOT_LESS v9, [PACKET(never)], v13
    PLANE_AT v9, v6, v2, v10, v13
    MASK_AND_NOT_LESS v9, [PACKET(never)], v13
    MASK_BITS r9d
%if %%g > 0
    shl     r9d, LANES * %%g
%endif
    or      eax, r9d
%assign %%g %%g + 1
%endrep
    and     eax, [ACROSS]
    jz      %%none
    bsf     r9d, eax
    bsr     r10d, eax
    sub     r10d, r9d
    inc     r10d
%endmacro

; ROW_TRIANGLE - v4, v5, v6, v7 = the edges and 1/t along the row y in v8. Clobbers v9.
%macro ROW_TRIANGLE 1
%define %%load %1       ; [in]       VLOAD or VSPREAD
    PLANE_ROW %%load, v4, rdi, e1, v8, v9, v13
    PLANE_ROW %%load, v5, rdi, e2, v8, v9, v13
    PLANE_ROW %%load, v6, rdi, e3, v8, v9, v13
    PLANE_ROW %%load, v7, rdi, t, v8, v9, v13
%endmacro

; v9 = the least of the three edges, v10 = 1/t for x in v8.
%define AT_TRIANGLE TRIANGLE_AT v9, v10, v8, v4, v5, v6, v7, v0, v1, v2, v3, v14, v13
%define INSIDE_TRIANGLE [PACKET(minus_ones)]
%define SURE_TRIANGLE [PACKET(ones)]

; FACTORS_SPHERE - v0 = dxx, v1 = hx, v2 and v3 = minus and plus the rounding bound, v14 = the upper bound of 1/t, and
;                  the offset of its origin from the tile's middle. Clobbers v4, v5.
%macro FACTORS_SPHERE 1
%define %%load %1       ; [in]       VLOAD or VSPREAD
    %%load  v0, [rdi + ELEM * SpherePlanes.dxx]
    %%load  v1, [rdi + ELEM * SpherePlanes.hx]
    %%load  v3, [rdi + ELEM * SpherePlanes.bound]
    VXOR    v2, v3, [PACKET(sign)]
    %%load  v14, [rdi + ELEM * SpherePlanes.most]
    %%load  v5, [rdi + ELEM * SpherePlanes.column]
    VMOV    v4, [rsp + NearestStack.origin_x]
    VSUB    v4, v4, v5
    VMOV_TO [rsp + NearestStack.offset_x], v4
    %%load  v5, [rdi + ELEM * SpherePlanes.row]
    VMOV    v4, [rsp + NearestStack.origin_y]
    VSUB    v4, v4, v5
    VMOV_TO [rsp + NearestStack.offset_y], v4
%endmacro

; ROW_SPHERE - for the row y in v8: v4 and v5 = D at x = 0 and its coefficient of x, v6 = h. Clobbers v9, v10, v11.
%macro ROW_SPHERE 1
%define %%load %1       ; [in]       VLOAD or VSPREAD
    VADD    v11, v8, [rsp + NearestStack.offset_y]
    SPHERE_ROW %%load, v4, v5, v6, rdi, v11, v9, v10, v13
%endmacro

; v9 = D at x, then v10 = 1/t there. Clobber v7.
%define D_AT(x) SPHERE_D_AT v9, x, v4, v5, v0, v7, v13
%define INVERSE_AT(x) SPHERE_INVERSE_AT v10, x, v9, v6, v1, v14, v7, v13

; AT_SPHERE - v9 = D and v10 = 1/t, for x from the tile's middle in v8. Clobbers v7, v11.
%macro AT_SPHERE 0
    VADD    v11, v8, [rsp + NearestStack.offset_x]
    D_AT(v11)
    INVERSE_AT(v11)
%endmacro
%define INSIDE_SPHERE v2
%define SURE_SPHERE v3

; NEAREST - a function that finds the nearest of triangles or spheres.
;
;   registers   rdi planes, rdx transposed arrays, both of one object or one packet; rsi task; r8 tile
;               a packet: r10 hits, r11 pixels tested, r14 the same in every byte, r13 LANES in every byte, r15
;               lanes_of_mask; v0 v1 v2 v3 and v14 from FACTORS, v4 v5 v6 v7 from ROW, v9 v10 from AT, v8 x
;               one object: r11 the first column of blocks, r14 blocks in a row, r10 how many are left; ebx row, r15 the
;               end of rows; r13 block; rcx the first x of all blocks of a row; v0 to v8 and v14 as above, v12 x within
;               a block, OWN_ID its id
%macro NEAREST 4
%define %%name %1       ; [in]       triangles or spheres
%define %%kind %2       ; [in]       TRIANGLE or SPHERE
%define %%planes %3     ; [in]       TrianglePlanes or SpherePlanes
%define %%arrays %4     ; [in]       TriangleArrays or SphereArrays
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
    ENTER_OWNED NearestStack_size, VBYTES
    mov     rdx, [rsi + NearestTask.arrays]
    mov     rcx, [rsi + NearestTask.count]
    mov     r8, [rsi + NearestTask.tile]
    mov     eax, [rsi + NearestTask.column]
    add     eax, TILE_WIDTH / 2
    KEEP_INTEGER origin_x
    mov     eax, [rsi + NearestTask.row]
    add     eax, TILE_HEIGHT / 2
    KEEP_INTEGER origin_y
    mov     eax, -(TILE_WIDTH / 2)
    KEEP_INTEGER low_x
    add     eax, [rsi + NearestTask.end_column]
    KEEP_INTEGER high_x
    mov     eax, [rsi + NearestTask.start_row]
    sub     eax, TILE_HEIGHT / 2
    KEEP_INTEGER low_y
    mov     eax, [rsi + NearestTask.end_row]
    sub     eax, TILE_HEIGHT / 2
    KEEP_INTEGER high_y
.packet:
    mov     [COUNT], rcx
    mov     [PLANES_AT], rdi
    mov     [ARRAYS_AT], rdx
    HALVES  0, 1, rdx + %%arrays %+ .columns
    VSUB    v0, v0, [rsp + NearestStack.origin_x]
    VSUB    v1, v1, [rsp + NearestStack.origin_x]
    VMAX    v0, v0, [rsp + NearestStack.low_x]
    VMIN    v1, v1, [rsp + NearestStack.high_x]
    HALVES  2, 3, rdx + %%arrays %+ .rows
    VSUB    v2, v2, [rsp + NearestStack.origin_y]
    VSUB    v3, v3, [rsp + NearestStack.origin_y]
    VMAX    v2, v2, [rsp + NearestStack.low_y]
    VMIN    v3, v3, [rsp + NearestStack.high_y]
    VSUB    v4, v1, v0
    VSUB    v5, v3, v2
    VMIN    v6, v4, v5
    MASK_GREATER v6, [PACKET(zeros)]
    MASK_BITS eax                       ; lanes whose objects are in the window
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
    jb      .no_small                   ; a few are faster one by one
    xor     eax, ebx
    mov     [ONE_BY_ONE], eax
    VMOV    v4, [rsp + NearestStack.low_x]
    VSELECT v4, v1
    VMOV_TO [rsp + NearestStack.first_x], v0
    VMOV_TO [rsp + NearestStack.past_x], v4
    VMOV_TO [rsp + NearestStack.now_y], v2
    VMOV_TO [rsp + NearestStack.past_y], v3
    FACTORS_%[%%kind] VLOAD
    mov     r13, 0x0101010101010101 * LANES
    xor     r10d, r10d
    xor     r11d, r11d
    xor     r14d, r14d
.lanes_row:
    VMOV    v8, [rsp + NearestStack.now_y]
    VMOV    v9, [rsp + NearestStack.past_y]
    MASK_GREATER v9, v8
    MASK_BITS eax
    test    eax, eax
    jz      .lanes_done
    VMOV    v9, [rsp + NearestStack.low_x]
    VMOV    v10, [rsp + NearestStack.past_x]
    VSELECT v9, v10
    VMOV_TO [rsp + NearestStack.row_past_x], v9
    ROW_%[%%kind] VLOAD
    VMOV    v9, v8
    LEVELS  9
%if BLOCK_HEIGHT > 1
    IAND    w10, w9, [PACKET(in_block_y)]
    IOP     psubd, w9, w9, w10
    IOP     pslld, w10, w10, ilog2e(BLOCK_WIDTH)
%endif
    IOP     pslld, w9, w9, ilog2e(TILE_WIDTH)
%if BLOCK_HEIGHT > 1
    IOP     paddd, w9, w9, w10
%endif
    VMOV_TO [rsp + NearestStack.row_place], v9
    VADD    v8, v8, [PACKET(ones)]
    VMOV_TO [rsp + NearestStack.now_y], v8
    VMOV    v8, [rsp + NearestStack.first_x]
.lanes_pixel:
    VMOV    v12, [rsp + NearestStack.row_past_x]
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
    STORE_SPLIT rsp + NearestStack.inverses + ELEM * r11, v, 10
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
    IOP     paddd, w11, w11, [rsp + NearestStack.row_place]
    STORE_NUMBERS rsp + NearestStack.places + 4 * r11, 11
%if LANES == 16
    movzx   r9d, al
    mov     r12, [r15 + 8 * r9]
    add     r12, r14
    mov     [rsp + NearestStack.found + r10], r12
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
    mov     [rsp + NearestStack.found + r10], r12
    movzx   eax, byte [r15 + 8 * 256 + rax]
    add     r10d, eax
    add     r14, r13
    add     r11d, LANES
    VADD    v8, v8, [PACKET(ones)]
    jmp     .lanes_pixel

    ; The pixels of the list: the greater 1/t is nearer, and its bits compare alike, since none is negative.
.lanes_done:
    xor     r11d, r11d
    jmp     .more_found
align 16
.found:
    movzx   eax, byte [rsp + NearestStack.found + r11]
    mov     r9d, eax
    and     r9d, LANES - 1
    mov     %%cx, [rsp + NearestStack.inverses + ELEM * rax]
    movsxd  rax, dword [rsp + NearestStack.places + 4 * rax]
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

    ; Equally near: the first in the scene wins. An empty pixel wins any tie.
.found_tie:
    mov     r13, [rsi + NearestTask.order]
    VTRUNCATE   r12d, [r8 + WHO + ELEM * (rax + MIDDLE)]
    mov     r12d, [r13 + 4 * r12]
    VTRUNCATE   ecx, [rdi + ELEM * (r9 + %%planes %+ .id)]
    cmp     r12d, [r13 + 4 * rcx]
    jbe     .next_found
    mov     %%d14, [rdi + ELEM * (r9 + %%planes %+ .id)]
    mov     [r8 + WHO + ELEM * (rax + MIDDLE)], %%d14
    jmp     .next_found

    ; The lanes of r9d are within the rounding of an edge or of D.
.lanes_doubt:
    SPILL
    mov     [SAVED_R14], r14
    mov     [DOUBTFUL], r9
.doubtful_lane:
    bsf     r9d, [DOUBTFUL]
    VTRUNCATE   r12d, [rsp + NearestStack.spilled + VBYTES * 8 + ELEM * r9]      ; v8
    add     r12d, [rsi + NearestTask.column]
    add     r12d, TILE_WIDTH / 2
    VTRUNCATE   r14d, [rsp + NearestStack.now_y + ELEM * r9]
    add     r14d, [rsi + NearestTask.row]
    add     r14d, TILE_HEIGHT / 2 - 1   ; now_y is already the next row
    BEFORE_DOUBT_%[%%kind] rdi + ELEM * r9
    lea     rdx, [rdx + 4 * r9]
    ONE_RAY xmm0, xmm1, xmm2, 12, 14, rsi
    DECIDE_%[%%kind] .lane_outside
    jmp     .lane_decided
.lane_outside:
    btr     eax, r9d
.lane_decided:
    mov     rdx, [ARRAYS_AT]
    mov     r12d, [DOUBTFUL]
    lea     r9d, [r12 - 1]
    and     r9d, r12d
    mov     [DOUBTFUL], r9d
    jnz     .doubtful_lane
    mov     r14, [SAVED_R14]
    UNSPILL
    jmp     .lanes_hit

.no_small:
    mov     [ONE_BY_ONE], eax
    ; The objects that are tested one by one.
.large:
    mov     eax, [ONE_BY_ONE]
    test    eax, eax
    jz      .next_packet
    bsf     r9d, eax
    btr     eax, r9d
    mov     [ONE_BY_ONE], eax
    mov     rdi, [PLANES_AT]
    mov     rdx, [ARRAYS_AT]
    lea     rdi, [rdi + ELEM * r9]
    lea     rdx, [rdx + 4 * r9]
    mov     eax, [rdx + %%arrays %+ .columns]
    mov     ebx, [rdx + %%arrays %+ .rows]
    CLIP    .large
    mov     r11d, r9d
    xor     r10d, r10d
    bts     r10, rax
    xor     ecx, ecx
    bts     rcx, r9
    sub     r10, rcx
    mov     [ACROSS], r10d
    sub     eax, r9d
    mov     r14d, eax                   ; blocks in a row
    FACTORS_%[%%kind] VSPREAD
%if HAS_MASKS
    VSPREAD OWN_ID, [rdi + ELEM * %%planes %+ .id]
%endif
    lea     rcx, [PACKET(block_columns)]
    VMOV    v12, [PACKET(block_x)]
%ifidn %%kind, SPHERE
    VADD    v12, v12, [rsp + NearestStack.offset_x]
%else
    cmp     r14d, [rsi + NearestTask.fewest_across]
    jb      .row
    REACHES
%endif
.row:
    lea     r9d, [rbx - TILE_HEIGHT / 2]
    VSPREAD_INTEGER 8, r9d
    mov     r9d, r11d
    mov     r10d, r14d
%ifidn %%kind, TRIANGLE
    cmp     r14d, [rsi + NearestTask.fewest_across]
    jb      .all_across
    REACHED .next_row
.all_across:
%endif
    VADD    v8, v8, [PACKET(block_y)]
    BLOCK_ROW
    ROW_%[%%kind] VSPREAD
    ELEMENT_OPERAND [rcx + ELEM * r9], v8
    VADD    v8, v12, ONE
align 16
.block:
%ifidn %%kind, SPHERE
    D_AT(v8)
    VLOAD   v11, [r13]
    MASK_NOT_LESS v9, INSIDE_SPHERE
    MASK_AND_NOT_LESS v14, v11, v13     ; its nearest point is not behind the pixel's hit
    MASK_BITS eax
    test    eax, eax
    jz      .next_block
    INVERSE_AT(v8)
    MASK_AND_NOT_LESS v10, v11, v13     ; often no lane is left: a branch would be mispredicted
%else
    AT_TRIANGLE
    VLOAD   v11, [r13]
    MASK_NOT_LESS v9, INSIDE_TRIANGLE
    MASK_AND_NOT_LESS v10, v11, v13
%if HAS_MASKS == 0                      ; with masks, no branch: whether a triangle has a pixel here is unpredictable
    MASK_BITS eax
    test    eax, eax
    jz      .next_block
%endif
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
    VLOAD   v13, [r13 + WHO]
    VSELECT v11, v10
    VSTORE  [r13], v11
%if HAS_MASKS
    VSELECT v13, OWN_ID
%else
    VSPREAD v10, [rdi + ELEM * %%planes %+ .id]
    VSELECT v13, v10
%endif
    VSTORE  [r13 + WHO], v13
.next_block:
    VADD    v8, v8, [PACKET(block_step)]
    add     r13, VBYTES
    dec     r10d
    jnz     .block
.next_row:
    add     ebx, BLOCK_HEIGHT
    cmp     ebx, r15d
    jl      .row
    jmp     .large
.next_packet:
    mov     rdi, [PLANES_AT]
    mov     rdx, [ARRAYS_AT]
    mov     rcx, [COUNT]
    add     rdi, VBYTES
    add     rdx, 4 * LANES
    sub     rcx, LANES
    ja      .packet
    LEAVE_OWNED
    ret

%if HAS_MASKS
    ; In some lanes another object is equally near, or the hit is in doubt.
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

    ; In the lanes of r9d another object is equally near: the first in the scene wins. An empty pixel wins any tie.
.tie:
    MASK_BITS eax
    mov     [SAVED_R14], r14
    mov     [SAVED_R10], r10
    mov     r14, [rsi + NearestTask.order]
    VTRUNCATE   r10d, [rdi + ELEM * %%planes %+ .id]
    mov     r10d, [r14 + 4 * r10]
    mov     [FIRST_ORDER], r10d
    mov     r10d, r9d
.tied_lane:
    bsf     r9d, r10d
    VTRUNCATE   r12d, [r13 + WHO + ELEM * r9]
    mov     r12d, [r14 + 4 * r12]
    cmp     r12d, [FIRST_ORDER]
    ja      .untied
    btr     eax, r9d
.untied:
    lea     r9d, [r10 - 1]
    and     r10d, r9d
    jnz     .tied_lane
    mov     r10, [SAVED_R10]
    mov     r14, [SAVED_R14]
    MASK_OF_BITS
    test    eax, eax
    jnz     .first
    jmp     .next_block

    ; The lanes of r9d are within the rounding of an edge or of D: each is decided in f64.
.doubt:
    MASK_BITS eax
    SPILL
    mov     [SAVED_R14], r14
    mov     [SAVED_R10], r10
    mov     r10d, r9d
    BEFORE_DOUBT_%[%%kind] rdi
.lane:
    bsf     r9d, r10d
    BLOCK_PIXEL
    ONE_RAY xmm0, xmm1, xmm2, 12, 14, rsi
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
    mov     r10, [SAVED_R10]
    mov     r14, [SAVED_R14]
    test    eax, eax
    jnz     .nearest
    jmp     .next_block
    END
%endmacro

; NEAREST_TILES - defines the functions of this file, for one element type.
%macro NEAREST_TILES 0
    NEAREST triangles, TRIANGLE, TrianglePlanes, TriangleArrays
    NEAREST spheres, SPHERE, SpherePlanes, SphereArrays
%endmacro
