; seen.asm - the bounds of each group of a tile's points, as a light sees them on a side of its cube, in f64.
;
; With the light as the origin and z the depth on the side, a point is on it where |x| and |y| are below z, and is seen
; at x / z and y / z, counted in cells. Each bound of a group is kept as a minimum: x, y and
; depth hold its greatest values, negated, past_x and past_y its least ones. Rounding to f32 keeps the order of numbers,
; so that the bounds may be compared with those of objects, which are rounded too.
;
; unsafe extern "sysv64" fn(view: *const LightSideView, across, down, depth, groups: *mut LitGroups, seen)
;
;   rayo_<isa>_seen
;
;   across, down, depth   *const f64: coordinates of the points of a tile, aligned to 64 bytes
;   seen                  *mut f32: TilePoints.seen
;
;   registers   rdi view, whose fields are the constants K; rsi across, rdx down, rcx depth, r8 groups, r9 seen, eax
;               groups left, r10d whether a point is on the side, r11d those of a register; v0 v1 v2 points, v8 to v12
;               the least of a group so far
;   writes      x, y, past_x, past_y and depth: infinity where no point of a group is on the side, or none is open; and
;               seen of groups with open points
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written
;   equals      kernels::portable::shadows::seen

; LEAST_SO_FAR - least = the lesser of least and a, where a is a number. Clobbers a.
%macro LEAST_SO_FAR 2
%define %%least %1      ; [in/out]   vreg
%define %%a %2          ; [in]       vreg
    VMIN    %%a, %%a, %%least
    VMOV    %%least, %%a
%endmacro

; LEAST_LANE - lane 0 of a register = the least of its lanes.
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
%endmacro

; STORE_LEAST - stores the least lane of v<n>, as f32, in a field of the group at r8. Clobbers v0 and v<n>.
%macro STORE_LEAST 2
%define %%n %1          ; [in]       number of a register
%define %%field %2      ; [in]       of LitGroups
    LEAST_LANE %%n, 0
    NARROW  %%n
%if HAS_VEX
    vmovss  [r8 + %%field], x%[%%n]
%else
    movss   [r8 + %%field], x%[%%n]
%endif
%endmacro

; SEEN - defines the kernel, which the head of this file describes.
%macro SEEN 0
FUNC ISA %+ _seen
    CONSTANTS LightSideView_size
    mov     eax, TILE_WIDTH * TILE_HEIGHT / GROUP
align 16
.group:
    cmp     dword [r8 + LitGroups.open], 0
    je      .nowhere
%assign %%n 8
%rep 5
    VMOV    v%[%%n], [PACKET(infinite)]
%assign %%n %%n + 1
%endrep
    xor     r10d, r10d
%assign %%at 0
%rep GROUP / LANES
    VMOV    v0, [rsi + ELEM * %%at]
    VSUB    v0, v0, K(LightSideView.across)
    VMOV    v1, [rdx + ELEM * %%at]
    VSUB    v1, v1, K(LightSideView.down)
    VMOV    v2, [rcx + ELEM * %%at]
    VSUB    v2, v2, K(LightSideView.depth)
    VMUL    v2, v2, K(LightSideView.sign)
    VMUL    v3, v2, [PACKET(side)]
    VABS    v4, v0
    MASK_GREATER v3, v4
    VABS    v4, v1
    MASK_AND_GREATER v3, v4, v5
    MASK_BITS r11d
    or      r10d, r11d
    test    r11d, r11d
    VMOV    v4, [PACKET(no_number)]
    jz      .beside%[%%at]
    VMOV    v5, v2
    VSELECT v4, v5                      ; no numbers are beside the side
    VMOV    v3, [PACKET(ones)]
    VDIV    v3, v3, v4
    VMUL    v0, v0, v3
    VSUB    v0, v0, K(LightSideView.low_x)
    VMUL    v0, v0, K(LightSideView.scale_x)
    VMUL    v1, v1, v3
    VSUB    v1, v1, K(LightSideView.low_y)
    VMUL    v1, v1, K(LightSideView.scale_y)
    VMOV    v3, v0
    NARROW  3
    STORE_NUMBERS r9 + 4 * %%at, 3
    VMOV    v3, v1
    NARROW  3
    STORE_NUMBERS r9 + 4 * %%at + 4 * TILE_WIDTH * TILE_HEIGHT, 3
    VXOR    v3, v0, [PACKET(sign)]
    LEAST_SO_FAR v8, v3
    VXOR    v3, v1, [PACKET(sign)]
    LEAST_SO_FAR v9, v3
    LEAST_SO_FAR v10, v0
    LEAST_SO_FAR v11, v1
    VXOR    v4, v4, [PACKET(sign)]
    LEAST_SO_FAR v12, v4
    jmp     .done%[%%at]
.beside%[%%at]:
    NARROW  4
    STORE_NUMBERS r9 + 4 * %%at, 4
    STORE_NUMBERS r9 + 4 * %%at + 4 * TILE_WIDTH * TILE_HEIGHT, 4
.done%[%%at]:
%assign %%at %%at + LANES
%endrep
    test    r10d, r10d
    jz      .nowhere
    STORE_LEAST 8, LitGroups.x
    STORE_LEAST 9, LitGroups.y
    STORE_LEAST 10, LitGroups.past_x
    STORE_LEAST 11, LitGroups.past_y
    STORE_LEAST 12, LitGroups.depth
    jmp     .next
.nowhere:
%assign %%n 0
%rep 5
    mov     dword [r8 + LitGroups_size / 7 * %%n], __?float32?__(__?Infinity?__)
%assign %%n %%n + 1
%endrep
.next:
    add     rsi, ELEM * GROUP
    add     rdx, ELEM * GROUP
    add     rcx, ELEM * GROUP
    add     r8, 4
    add     r9, 4 * GROUP
    dec     eax
    jnz     .group
    UNCONSTANTS
ENDFUNC
%endmacro
