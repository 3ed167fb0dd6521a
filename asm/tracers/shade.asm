; shade.asm - the packet tracers in object order, second half: the pixels of a tile of many objects, shaded once.
;
; After nearest.asm has done all objects of a tile, each pixel is shaded once, by lines 18 to 21 of Algorithm 1, block
; by block. Floats are written at once, bytes when a row of blocks is complete: row by row of the picture, into lines
; that have been prefetched.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_tile_<output>      unsafe extern "sysv64" fn(rays: *const TileRays, task: *const ShadeTask)
;
;   <output>    f32x4, rgba8; f32x4_fast with estimates in place of roots and divisions
;   requires    the CPUID features of the ISA; memory as tile_layout.inc says
;   equals      kernels::portable::shade::shade, to the last bit where there is no estimate

; The stack of the shading functions, from rsp on.
%assign PIXELS_AT 0                     ; a block of floats, or a row of blocks of bytes
%define OFFSETS_AT (4 * TILE_WIDTH * BLOCK_HEIGHT)      ; offsets of the shades of a block's objects
%define STRIDES_AT (OFFSETS_AT + 64)    ; bytes from one object's shades to the next one's, in every lane
%define ROWS_AT (STRIDES_AT + 64)       ; rows in the picture of the pixels of a block
%define MIDDLE_AT (ROWS_AT + 64)        ; the tile's middle column
%define COLUMNS_AT (MIDDLE_AT + 64)     ; COLUMNS and OWNER, if not registers
%define OWNER_AT (COLUMNS_AT + 64)
%define WHOLE_AT (OWNER_AT + 64)        ; column of the tile up to which the row's blocks are written whole
%define RECORD_AT (WHOLE_AT + 8)        ; address of the owner's record ...
%define LIGHTS_AT (RECORD_AT + 8)       ; ... and, for a sphere, r13 of SPHERE_RECORD
%define FRAME (WHOLE_AT + 64)

; COLUMNS - the columns in the picture of a block's pixels; OWNER - in every lane the object that owned all pixels of
;           the last such block: registers where there are 32, since each block depends on the previous one.
%if HAS_MASKS
%xdefine COLUMNS VREG %+ 16
%xdefine OWNER VREG %+ 17
%else
%define COLUMNS [rsp + COLUMNS_AT]
%define OWNER [rsp + OWNER_AT]
%endif

; IF_ALL - jumps if the mask has all lanes. Clobbers eax.
%macro IF_ALL 1
%define %%to %1         ; [in]       label
    MASK_BITS eax
    cmp     eax, (1 << LANES) - 1
    je      %%to
%endmacro

; RAY_X - v4 = the first component of the rays of a block, dx + step x. Clobbers v8, v9, v10, v11.
%macro RAY_X 0
    VMOV    v9, COLUMNS
    VSUB    v9, v9, [rsp + MIDDLE_AT]
    VSPREAD v8, [rdi + ELEM * TileRays.step]
    VSPREAD v10, [rdi + ELEM * TileRays.dx]
    PLANE_AT v4, v10, v8, v9, v11
%endmacro

; SPHERE_RECORD - r10 = the address of the record of the tile's sphere eax, r13 = the offset of its ObjectLights from
;                 those of the first record. Clobbers rax.
%macro SPHERE_RECORD 0
    mov     r10, [rsi + ShadeTask.sphere_ids]
    mov     eax, [r10 + 4 * rax - 4]
    imul    r10, rax, ELEM * TileSphere_size
    add     r10, [rsi + ShadeTask.spheres]
    imul    rax, [rsi + ShadeTask.light_count]
    shl     rax, ilog2e(ELEM * ObjectLight_size)        ; a ShortLight is as long
    mov     r13, rax
%endmacro

; ADD_TRIANGLE_LIGHT - adds the effect of the light at r13 to the colours v1, v2, v3 of triangles with 1/t in v0 and
;                      rays in v4, v5, v14. Cosines and weights are in v7 to v10. Clobbers v7, v11, v12, v13, v15.
%macro ADD_TRIANGLE_LIGHT 0
    TRIANGLE_COSINE v7, v0, v4, v5, v14, r13, v11, v12, v13, v15
    VFMA    v1, v7, v8, v15
    VFMA    v2, v7, v9, v15
    VFMA    v3, v7, v10, v15
%endmacro

; NEXT_SHADE - goes on to the next of rcx lights and its shades of triangles.
%macro NEXT_SHADE 1
%define %%loop %1       ; [in]       label
    add     r10, ELEM * TileShade_size
    add     r13, ELEM * 4
    dec     rcx
    jnz     %%loop
%endmacro

; PIXELS_OUT - stores a block's pixels as floats, from v1, v2, v3 to r9 and the rows after it, r10 bytes apart.
%macro PIXELS_OUT 0
    TRANSPOSE_F32X4 1, 2, 3, 7, 11, 12
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

; PIXELS_KEPT - stores a block's pixels as bytes, from v1, v2, v3 to their place in the row of blocks on the stack.
%macro PIXELS_KEPT 0
    PACK_RGBA8 1, 2, 3, 1
    imul    eax, ebx, 4 * BLOCK_HEIGHT
%if LANES == 2
    movq    [rsp + PIXELS_AT + rax], x1
%else
    VEX(movups) [rsp + PIXELS_AT + rax], w1
%endif
%endmacro

; FETCH_ROWS - prefetches the rows of pixels of a row of blocks, from r14 on, r10 bytes apart. Clobbers rax.
%macro FETCH_ROWS 0
    mov     rax, r14
%rep BLOCK_HEIGHT
%assign %%at 0
%rep 4 * TILE_WIDTH / 64
    prefetcht0 [rax + %%at]
%assign %%at %%at + 64
%endrep
    add     rax, r10
%endrep
%endmacro

; ROWS_OUT - copies ecx columns of a row of blocks from the stack to r14 and the rows after it, r10 bytes apart: of
;            every BLOCK_HEIGHT blocks together, a register for each row. Clobbers rax, r9, r14, ecx, v1.
%macro ROWS_OUT 0
    xor     r9d, r9d
%%blocks:
    mov     rax, r14
%assign %%row 0
%rep BLOCK_HEIGHT
%if LANES == 2
    movq    x1, [rsp + PIXELS_AT + r9]
    movq    [rax], x1
%else
%assign %%block 0
%rep BLOCK_HEIGHT
    INSERT128 1, [rsp + PIXELS_AT + r9 + 4 * LANES * %%block + 16 * %%row], %%block
%assign %%block %%block + 1
%endrep
    VEX(movups) [rax], w1
%endif
    add     rax, r10
%assign %%row %%row + 1
%endrep
    add     r14, 4 * LANES
    add     r9d, 4 * LANES * BLOCK_HEIGHT
    sub     ecx, LANES
    jnz     %%blocks
%endmacro

; SHADE_TILE - a function that shades a tile.
;
;   Most blocks belong to one object, and mostly to that of the previous block. So that owner and the address of its
;   record are kept: a block need not wait for the address unless it has another owner, or several.
;
;   registers   rdi rays, rsi task; r8 block; ebx, r12d column and row of its first pixel in the tile
;               v0 1/t, v1 v2 v3 the colour, v4 v5 v14 the ray, v6 the ids of objects
;               edx the kind of the owner: 0 no object, positive a triangle, negative a sphere
;               r14 the address of the block's first pixel, in bytes of that of the row of blocks
;               r10 a record, r13 a light, rcx lights left, r15d lanes left, r11 a lane's id
%macro SHADE_TILE 2
%define %%output %1     ; [in]       part of the function's name
%define %%format %2     ; [in]       F32X4 or RGBA8
FUNC NAME(tile, %%output)
    ENTER_OWNED FRAME, 64
    imul    rax, [rsi + ShadeTask.light_count], ELEM * TileShade_size
%assign i 0
%rep LANES
    mov     [rsp + STRIDES_AT + 4 * i], eax
%assign i i + 1
%endrep
    xor     edx, edx
    VZERO   v7
    VMOV_TO OWNER, v7
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
%if %[%%format]_FLOATS
    and     r9d, -BLOCK_WIDTH
%else
    and     r9d, -LANES
%endif
    lea     eax, [r12 + BLOCK_HEIGHT]
    cmp     eax, [rsi + ShadeTask.end_row]
    cmovg   r9d, ecx
    mov     eax, r12d
    sub     eax, [rsi + ShadeTask.start_row]
    cmovl   r9d, ecx
    mov     [rsp + WHOLE_AT], r9d
    movsxd  r14, eax
    mov     r10, [rsi + ShadeTask.pitch]
    imul    r14, r10
    add     r14, [rsi + ShadeTask.out]
%if %[%%format]_FLOATS == 0
    cmp     r9d, TILE_WIDTH
    jl      .fetched
    FETCH_ROWS
.fetched:
%endif
    lea     eax, [r12 - TILE_HEIGHT / 2]
    VSPREAD_INTEGER 7, eax
    VADD    v7, v7, [PACKET(block_y)]
    VSPREAD v8, [rdi + ELEM * TileRays.down]
    VSPREAD v5, [rdi + ELEM * TileRays.dy]
    VFMA    v5, v7, v8, v9
    mov     r8d, r12d
%if BLOCK_HEIGHT > 1
    shr     r8d, ilog2e(BLOCK_HEIGHT)
%endif
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
    MASK_EQUAL v6, OWNER
    IF_ALL  .owned
    VSPREAD v7, [r8 + WHO]
    MASK_EQUAL v6, v7
    IF_ALL  .new_owner
    mov     rcx, [rsi + ShadeTask.light_count]
    test    rcx, rcx
    jz      .shaded
    cmp     qword [rsi + ShadeTask.triangle_count], 0
    je      .spheres
    RAY_X
    VMOV    v7, v6
    LEVELS  7
    IOP     pmulld, w7, w7, [rsp + STRIDES_AT]
    STORE_NUMBERS rsp + OFFSETS_AT, 7
    mov     r13, [rsi + ShadeTask.lights]
    mov     r10, [rsi + ShadeTask.shades]
.each:
    GATHER4 7, 8, 9, 10, 11, 12, 13, r10, rsp + OFFSETS_AT, ax
    ADD_TRIANGLE_LIGHT
    NEXT_SHADE .each
.spheres:
    mov     eax, [rsi + ShadeTask.sphere_count]
    test    eax, eax
    jz      .shaded
    MASK_GREATER v6, [PACKET(zeros)]
    MASK_BITS r15d
    VSPREAD_INTEGER 7, eax
    MASK_NOT_LESS v7, v6                ; spheres have the ids up to v7
    MASK_BITS eax
    and     r15d, eax
    jz      .shaded
.sphere:
    bsf     eax, r15d
    lea     r11, [r8 + WHO + ELEM * rax]
    VTRUNCATE   eax, [r11]
    VSPREAD v7, [r11]
    MASK_EQUAL v6, v7
    MASK_BITS ecx
    not     ecx
    and     r15d, ecx                   ; the lanes of other objects
    SPHERE_RECORD
.sphere_lights:
    mov     rcx, [rsi + ShadeTask.light_count]
    cmp     dword [r10 + ELEM * TileSphere.around + ELEM - 4], 0
    jne     .around
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
    SHORT_COSINE v9, v0, v7, v8, r13, v10, v11, v12, v15
    ADD_LIGHT v9, ShortLight, v10, v12
    add     r13, ELEM * ShortLight_size
    dec     rcx
    jnz     .short
%else
    LONG_LIGHTS
%endif
.next_sphere:
    test    r15d, r15d
    jnz     .sphere

.shaded:
%if %[%%format]_FLOATS
    cmp     ebx, [rsp + WHOLE_AT]
    jge     .part
    mov     r9, r14
    mov     r10, [rsi + ShadeTask.pitch]
    PIXELS_OUT
.next_block:
    add     r14, BLOCK_WIDTH * %%format %+ _BYTES
%else
    PIXELS_KEPT
%endif
    VMOV    v7, COLUMNS
    VADD    v7, v7, [PACKET(block_step)]
    VMOV_TO COLUMNS, v7
    add     r8, VBYTES
    add     ebx, BLOCK_WIDTH
    cmp     ebx, [rsi + ShadeTask.end_column]
    jl      .block
%if %[%%format]_FLOATS == 0
    mov     ecx, [rsp + WHOLE_AT]
    mov     ebx, ecx
    test    ecx, ecx
    jz      .part
    mov     r10, [rsi + ShadeTask.pitch]
    ROWS_OUT
.next_block:
    cmp     ebx, [rsi + ShadeTask.end_column]
    jl      .part
%endif
    add     r12d, BLOCK_HEIGHT
    cmp     r12d, [rsi + ShadeTask.end_row]
    jl      .row
    LEAVE_OWNED
    ret

    ; All pixels of the block are the owner's.
.new_owner:
    VMOV_TO OWNER, v7
    VTRUNCATE   eax, [r8 + WHO]
    xor     edx, edx
    cmp     qword [rsi + ShadeTask.light_count], 0
    je      .shaded
    test    eax, eax
    jz      .shaded
    mov     edx, 1
    mov     r10d, [rsp + STRIDES_AT]
    imul    r10, rax
    add     r10, [rsi + ShadeTask.shades]
    cmp     rax, [rsi + ShadeTask.sphere_count]
    ja      .found
    mov     edx, -1
    SPHERE_RECORD
    mov     [rsp + LIGHTS_AT], r13
.found:
    mov     [rsp + RECORD_AT], r10
.owned:
    test    edx, edx
    jz      .shaded
    mov     r10, [rsp + RECORD_AT]
    js      .owned_by_sphere
    RAY_X
    mov     rcx, [rsi + ShadeTask.light_count]
    mov     r13, [rsi + ShadeTask.lights]
.same:
    VSPREAD v7, [r10 + ELEM * TileShade.cosine]
    VSPREAD v8, [r10 + ELEM * TileShade.red]
    VSPREAD v9, [r10 + ELEM * TileShade.green]
    VSPREAD v10, [r10 + ELEM * TileShade.blue]
    ADD_TRIANGLE_LIGHT
    NEXT_SHADE .same
    jmp     .shaded
.owned_by_sphere:
    mov     r13, [rsp + LIGHTS_AT]
    lea     r11, [r8 + WHO]
    xor     r15d, r15d
    jmp     .sphere_lights

.around:
    RAY_X
    AROUND_NORMAL v10, v11, v12, v0, v4, v5, v14, r10, v7
    add     r13, [rsi + ShadeTask.lits]
    mov     rax, [rsi + ShadeTask.lights]
.around_light:
    AROUND_COSINE v13, v0, v4, v5, v14, v10, v11, v12, rax, v7, v8, v9, v15
    ADD_LIGHT v13, ObjectLight, v7, v8
    add     r13, ELEM * ObjectLight_size
    add     rax, ELEM * 4
    dec     rcx
    jnz     .around_light
    jmp     .next_sphere

%if %[%%format]_FLOATS == 0
.long:
    LONG_LIGHTS
    jmp     .next_sphere
%endif

    ; A block that is only partly written, or one of too few for ROWS_OUT: its pixels go by way of the stack.
.part:
%if %[%%format]_FLOATS
    mov     r9, rsp
    mov     r10d, BLOCK_WIDTH * %%format %+ _BYTES
    PIXELS_OUT
%endif
    mov     ecx, [rsi + ShadeTask.end_column]
    sub     ecx, ebx
    mov     eax, BLOCK_WIDTH
    cmp     ecx, eax
    cmovg   ecx, eax
    imul    ecx, ecx, %%format %+ _BYTES / 4        ; 32-bit numbers in a row
    xor     r11d, r11d                  ; row of the block
.part_row:
    lea     eax, [r12 + r11]
    cmp     eax, [rsi + ShadeTask.end_row]
    jge     .part_done
    sub     eax, [rsi + ShadeTask.start_row]
    jl      .next_part_row
    imul    rax, [rsi + ShadeTask.pitch]
    imul    r9, rbx, %%format %+ _BYTES
    add     r9, rax
    add     r9, [rsi + ShadeTask.out]
    imul    r10d, r11d, BLOCK_WIDTH * %%format %+ _BYTES
%if %[%%format]_FLOATS == 0
    imul    eax, ebx, 4 * BLOCK_HEIGHT
    add     r10, rax
%endif
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
.part_done:
%if %[%%format]_FLOATS == 0
    add     ebx, BLOCK_WIDTH
%endif
    jmp     .next_block
    END
%endmacro

; LONG_LIGHTS - adds the effect of all rcx lights on the sphere at r10, in the long form, with x, y in v7, v8.
%macro LONG_LIGHTS 0
    add     r13, [rsi + ShadeTask.lits]
    SPHERE_ROOT v9, v7, v8, r10, v10, v11, v15
    NORMAL_OVER_T v10, x, v7, v8, v9, r10, v13, v15
    NORMAL_OVER_T v11, y, v7, v8, v9, r10, v13, v15
    NORMAL_OVER_T v12, z, v7, v8, v9, r10, v13, v15
.light:
    SPHERE_COSINE v13, v0, v10, v11, v12, r13, v7, v8, v9, v15
    ADD_LIGHT v13, ObjectLight, v7, v8
    add     r13, ELEM * ObjectLight_size
    dec     rcx
    jnz     .light
%endmacro

; ADD_LIGHT - adds a cosine times the weights of the light at r13 to the colours v1, v2, v3, in the lanes whose id is
;             the one at r11: the lanes of the mask, which without FMA has to be computed again.
%macro ADD_LIGHT 4
%define %%cosine %1     ; [in/out]   vreg
%define %%record %2     ; [in]       ObjectLight or ShortLight
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

; SHADE_TILES - defines the functions of this file, for one element type.
%macro SHADE_TILES 0
%assign ESTIMATE 0
    SHADE_TILE f32x4, F32X4
%if ELEM == 4
%assign ESTIMATE 1
    SHADE_TILE f32x4_fast, F32X4
%endif
    SHADE_TILE rgba8, RGBA8
%endmacro
