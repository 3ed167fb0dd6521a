; shade.asm - the packet tracers in object order, second half: the pixels of a tile of many objects, shaded once.
;
; When nearest.asm is through with all objects of a tile, each pixel is shaded once, by lines 18 to 21 of Algorithm 1,
; and written, block by block.
;
; Assembled once per ISA and element type. The functions, with <p> = <isa>_<single or double>:
;
;   rayo_<p>_tile_<output>      unsafe extern "sysv64" fn(rays: *const TileRays, task: *const ShadeTask)
;
;   <output>    f32x4, rgba8; f32x4_fast with estimates in place of roots and divisions
;   requires    the CPUID features of the ISA; memory as tile_layout.inc says
;   equals      reference::tile, to the last bit where there is no estimate

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

; ADD_TRIANGLE_LIGHT - adds what the light at r13 does to the colours v1, v2, v3 of triangles with 1/t in v0 and rays
;                      in v4, v5, v14. Cosines and weights are in v7 to v10. Clobbers v7, v11, v12, v13, v15.
%macro ADD_TRIANGLE_LIGHT 0
    TRIANGLE_COSINE v7, v0, v4, v5, v14, r13, v11, v12, v13, v15
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
    ENTER_OWNED FRAME, 64
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
    cmp     eax, (1 << LANES) - 1
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
    ADD_TRIANGLE_LIGHT
    NEXT_SHADE .same
    jmp     .shaded
.mixed:
    IOP     pmulld, w7, w7, [rsp + STRIDES_AT]
    STORE_NUMBERS rsp + OFFSETS_AT, 7
    test    rcx, rcx
    jz      .shaded
.each:
    GATHER4 7, 8, 9, 10, 11, 12, 13, r10, rsp + OFFSETS_AT, ax
    ADD_TRIANGLE_LIGHT
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
    VTRUNCATE   eax, [r11]
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
    shl     rax, ilog2e(ELEM * ObjectLight_size)        ; a ShortLight is as long
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
    LEAVE_OWNED
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

; ADD_LIGHT - adds a cosine times the weights of the light at r13 to the colours v1, v2, v3 of the lanes whose who is
;             that at r11: those of the mask, where no operation without FMA has clobbered it.
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

; SHADE_TILES - the functions of this file, for one element type.
%macro SHADE_TILES 0
%assign ESTIMATE 0
    SHADE_TILE f32x4, F32X4
%if ELEM == 4
%assign ESTIMATE 1
    SHADE_TILE f32x4_fast, F32X4
%endif
    SHADE_TILE rgba8, RGBA8
%endmacro
