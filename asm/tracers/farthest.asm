; farthest.asm - the hierarchical depth of a tile: how far the farthest pixel of each square is, to cull what is behind.
;
; unsafe extern "sysv64" fn(tile: *const Tile, parts: *mut E)
;
;   rayo_<isa>_single_farthest    on f32
;   rayo_<isa>_double_farthest    on f64
;
;   A square is at least two blocks wide, and its blocks in a row of blocks follow those of the previous square.
;
;   registers   rdi start of the square in its first row of blocks, rsi parts, rdx rows of squares left,
;               rcx squares left in a row
;   writes      the least 1/t of each square, row by row from the top
;   requires    the CPUID features of the ISA
;   equals      Iterator::min_by, over the pixels of each square

; LEAST_LANE - lane 0 of a register = the least of its lanes. Used by seen.asm too.
%macro LEAST_LANE 2
%define %%n %1          ; [in/out]   number of a register
%define %%t %2          ; [clobbered] number of a register
%if VBYTES == 64
    vextractf64x4 h%[%%t], v%[%%n], 1
    VOP     min, h%[%%n], h%[%%n], h%[%%t]
%endif
%if VBYTES >= 32
    vextractf128 x%[%%t], ymm%[%%n], 1
    VOP     min, x%[%%n], x%[%%n], x%[%%t]
%endif
    IOP     unpckhpd, x%[%%t], x%[%%n], x%[%%n]
    VARITH  min, 0, x%[%%n], x%[%%n], x%[%%t]
%if ELEM == 4
    IOP     psrlq, x%[%%t], x%[%%n], 32
    VARITH  min, 0, x%[%%n], x%[%%n], x%[%%t]
%endif
%endmacro

; FARTHEST - the function, for one element type.
%macro FARTHEST 0
%assign %%part PART_SIDE * BLOCK_HEIGHT * ELEM  ; bytes of a square in a row of blocks
%assign %%row TILE_WIDTH * BLOCK_HEIGHT * ELEM  ; bytes of a row of blocks
FUNC ISA_NAME %+ _farthest
    mov     edx, TILE_HEIGHT / PART_SIDE
.row:
    mov     ecx, TILE_WIDTH / PART_SIDE
.part:
%assign %%down 0
%rep PART_SIDE / BLOCK_HEIGHT
%assign %%across 0
%rep %%part / VBYTES
%if %%down + %%across == 0
    VMOV    v0, [rdi]
%else
    VMIN    v0, v0, [rdi + %%row * %%down + VBYTES * %%across]
%endif
%assign %%across %%across + 1
%endrep
%assign %%down %%down + 1
%endrep
    LEAST_LANE 0, 1
%if ELEM == 4 && HAS_VEX
    vmovss  [rsi], x0
%elif ELEM == 4
    movss   [rsi], x0
%elif HAS_VEX
    vmovsd  [rsi], x0
%else
    movsd   [rsi], x0
%endif
    add     rdi, %%part
    add     rsi, ELEM
    dec     ecx
    jnz     .part
    add     rdi, %%row * (PART_SIDE / BLOCK_HEIGHT - 1)
    dec     edx
    jnz     .row
%if HAS_VEX
    vzeroupper
%endif
ENDFUNC
%endmacro
