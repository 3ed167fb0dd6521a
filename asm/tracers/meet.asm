; meet.asm - which objects may hide a light from which points of a tile: those that a group of points meets.
;
; A group of points meets an object if their bounds overlap, as the light sees both, and if not all of the points are
; on that object: blocks of 16 objects are tested for LANES groups at once, then 16 objects for each group. The object
; must
; also have an open point of the group within it, and not one of its own: a triangle within its edges, where c + a x +
; b y is at least 0, eq. 10 in the light's picture; a sphere within its bounds. What may be rounded is in c and in the
; bounds, so that none is culled that hides a point; few are left for f64.
;
; Assembled once per ISA, in f32. unsafe extern "sysv64" fn(task: *const MeetTask) -> u64
;
;   rayo_<isa>_meet
;
;   returns     how many pairs of a group and an object met: MOST_CASTERS times the group plus the object, sorted
;   registers   rdi task; r12 the group, from which LitGroups' fields are counted, r13d the same in a pair; ebx those of
;               its BLOCKS that are left; r9 bounds, r15 the next pair; v0 to v5 the bounds of groups. Then r14 a pair,
;               r10 the same, r11 where the next that is left goes; r9 edges, rcx those of a triangle, rdx points, v0 v1
;               where they are seen, r8d those that are open, rsi all groups
;   writes      met, up to 15 pairs past the last
;   requires    the CPUID features of the ISA; all addresses valid for what is read and written; x of bounds beyond the
;               last object and the last block is no number
;   equals      kernels::portable::shadows::meet

%define BLOCKS rsp                      ; for each group a bit for each block that it meets

; MEETS - the mask = the lanes where the ends in v0 to v4 meet bounds and, with six fields, v5 is not their own.
;         Clobbers v13 and v14.
;
;   equals        kernels::shadows::CasterList::set_met
%macro MEETS 3
%define %%at %1         ; [in]       address of bounds
%define %%fields %2     ; [in]       5 or 6
%define %%spread %3     ; [in]       1: of one with all lanes; 0: of LANES each with its lane
%assign %%n 0
%rep %%fields
%if %%spread
    ELEMENT_OPERAND [%%at + CasterBounds_size / 6 * %%n], v14
%else
%define ONE [%%at + CasterBounds_size / 6 * %%n]
%endif
%if %%n == 0
    MASK_NOT_GREATER v0, ONE
%elif %%n < 5
    MASK_AND_NOT_GREATER v%[%%n], ONE, v13
%else
    MASK_AND_UNEQUAL v5, ONE, v13
%endif
%assign %%n %%n + 1
%endrep
%endmacro

; EDGE_OF_CASTER - d = c + a x + b y of the triangle at rcx. Clobbers v13, v14.
;
;   instructions   sse41 12   avx2 5   avx512 3
;   critical path  load -> fma -> fma
%macro EDGE_OF_CASTER 2
%define %%d %1          ; [out]      vreg
%define %%n %2          ; [in]       1, 2 or 3
    VSPREAD %%d, [rcx + CasterEdges.c%[%%n]]
    ELEMENT_OPERAND [rcx + CasterEdges.a%[%%n]], v14
    VFMA    %%d, v0, ONE, v13
    ELEMENT_OPERAND [rcx + CasterEdges.b%[%%n]], v14
    VFMA    %%d, v1, ONE, v13
%endmacro

; WITHIN_EDGES - the mask = the points at v0 v1 that are within the edges of the triangle at rcx. Clobbers v6 to v8,
;                v13, v14.
;
;   equals         kernels::portable::shadows::within_edges
%macro WITHIN_EDGES 0
    EDGE_OF_CASTER v6, 1
    EDGE_OF_CASTER v7, 2
    EDGE_OF_CASTER v8, 3
    VMIN    v6, v6, v7
    VMIN    v6, v6, v8
    MASK_NOT_LESS v6, [PACKET(zeros)]
%endmacro

; WITHIN_BOUNDS - the mask = the points at v0 v1 that are within the bounds of the object at rcx. Clobbers v6 to v8.
;
;   The difference of two floats has the sign of their order, also where it is rounded.
;
;   instructions   sse41 17   avx2 12   avx512 12
;   critical path  load -> sub -> min -> min
;   equals         kernels::portable::shadows::within_bounds
%macro WITHIN_BOUNDS 0
    VSPREAD v6, [rcx + CasterBounds.x]
    VADD    v6, v6, v0                  ; the least x is negated
    VSPREAD v7, [rcx + CasterBounds.y]
    VADD    v7, v7, v1
    VMIN    v6, v6, v7
    VSPREAD v7, [rcx + CasterBounds.past_x]
    VSUB    v7, v7, v0
    VSPREAD v8, [rcx + CasterBounds.past_y]
    VSUB    v8, v8, v1
    VMIN    v7, v7, v8
    VMIN    v6, v6, v7
    MASK_NOT_LESS v6, [PACKET(zeros)]
%endmacro

; KEEP_WITHIN - of the pairs from r14 to r15 keeps those whose group has an open point within the
;               object, which is not its own, and leaves their end in r11. The numbers of objects are
;               indices of what is at r9. Clobbers rax, rcx, rdx, r8, r10, r14 and v0 to v8, v13, v14.
%macro KEEP_WITHIN 2
%define %%record %1     ; [in]       CasterEdges or CasterBounds
%define %%within %2     ; [in]       WITHIN_EDGES or WITHIN_BOUNDS
    mov     r11, r14
    jmp     %%next
align 16
%%pair:
    mov     r10d, [r14]
    movzx   ecx, r10b
    mov     edx, r10d
    mov     eax, ecx
    shr     edx, ilog2e(MOST_CASTERS)
    shr     ecx, 4
    and     eax, 15
    imul    ecx, ecx, %%record %+ _size
    mov     r8d, [rsi + 4 * rdx + LitGroups.open]
    lea     rcx, [rcx + 4 * rax]
    shl     edx, ilog2e(4 * GROUP)
    add     rcx, r9
    add     rdx, [rdi + MeetTask.points]
    add     r14, 4
%assign %%first 0
%rep GROUP / LANES
    VMOV    v0, [rdx + TilePoints.seen + 4 * %%first]
    VMOV    v1, [rdx + TilePoints.seen + 4 * TILE_WIDTH * TILE_HEIGHT + 4 * %%first]
    %%within
    VSPREAD v6, [rcx + %%record %+ .own]
    MASK_AND_UNEQUAL v6, [rdx + TilePoints.own + 4 * %%first], v13
    MASK_BITS eax
%if %%first > 0
    shl     eax, %%first
%endif
    test    r8d, eax
    jnz     %%keep
%assign %%first %%first + LANES
%endrep
%%next:
    cmp     r14, r15
    jb      %%pair
    jmp     %%done
%%keep:
    mov     [r11], r10d
    add     r11, 4
    jmp     %%next
%%done:
%endmacro

; MEET - the kernel rayo_<isa>_meet, which the head of this file describes.
%macro MEET 0
FUNC ISA %+ _meet
    ENTER_OWNED 4 * TILE_WIDTH * TILE_HEIGHT / GROUP, VBYTES
    mov     rax, [rdi + MeetTask.groups]
    mov     r12d, [rdi + MeetTask.first]
    mov     r14d, [rdi + MeetTask.end]
    shl     r12d, 2
    shl     r14d, 2
    and     r12d, -VBYTES               ; whole registers of groups
.groups:
%assign %%n 0
%rep 5
    VMOV    v%[%%n], [rax + r12 + LitGroups_size / 7 * %%n]
%assign %%n %%n + 1
%endrep
    VZERO   v9
    VMOV    v10, [PACKET(first_bit)]
    mov     r9, [rdi + MeetTask.blocks]
    mov     r10, [rdi + MeetTask.block_count]
.groups_block:
    MEETS   r9, 5, 1
    VMOV    v7, v10
    MASK_KEEP v7
    IOR     v9, v9, v7
    IOP     paddd, v10, v10, v10
    add     r9, 4
    dec     r10d
    jnz     .groups_block
    VMOV_TO [BLOCKS + r12], v9
    add     r12d, VBYTES
    cmp     r12d, r14d
    jb      .groups

    mov     r12d, [rdi + MeetTask.first]
    mov     r13d, r12d
    shl     r12d, 2
    shl     r13d, ilog2e(MOST_CASTERS)
    mov     r15, [rdi + MeetTask.met]
.group:
    mov     rax, [rdi + MeetTask.groups]
    add     rax, r12
    mov     ebx, [BLOCKS + r12]
    cmp     dword [rax + LitGroups.open], 0
    je      .next_group
    test    ebx, ebx
    jz      .next_group
%assign %%n 0
%rep 6
    VSPREAD v%[%%n], [rax + LitGroups_size / 7 * %%n]
%assign %%n %%n + 1
%endrep
.block:
    bsf     ecx, ebx
    lea     eax, [rbx - 1]
    imul    r9, rcx, CasterBounds_size
    shl     ecx, 4
    or      ecx, r13d
    add     r9, [rdi + MeetTask.bounds]
    and     ebx, eax
%if HAS_MASKS && LANES == 16            ; a block fills a register
    MEETS   r9, 6, 0
    MASK_BITS eax
    vpbroadcastd v6, ecx
    vpaddd  v6, v6, [PACKET(of_block)]
    vpcompressd v6 {MASK} {z}, v6
    VSTORE  [r15], v6
    popcnt  eax, eax
    lea     r15, [r15 + 4 * rax]
%else
%assign %%first 0
%rep 16 / LANES
    MEETS   r9 + 4 * %%first, 6, 0
    MASK_BITS eax
    test    eax, eax
    jz      .culled%[%%first]
.meets%[%%first]:
    bsf     edx, eax
    lea     edx, [rcx + rdx + %%first]
    mov     [r15], edx
    add     r15, 4
    lea     edx, [rax - 1]
    and     eax, edx
    jnz     .meets%[%%first]
.culled%[%%first]:
%assign %%first %%first + LANES
%endrep
%endif
    test    ebx, ebx
    jnz     .block
.next_group:
    add     r13d, MOST_CASTERS
    add     r12, 4
    cmp     r12d, r14d
    jb      .group

    cmp     qword [rdi + MeetTask.points], 0
    je      .done
    mov     rsi, [rdi + MeetTask.groups]
    mov     r14, [rdi + MeetTask.met]
    mov     r9, [rdi + MeetTask.edges]
    test    r9, r9
    jz      .of_spheres
    KEEP_WITHIN CasterEdges, WITHIN_EDGES
    jmp     .kept
.of_spheres:
    mov     r9, [rdi + MeetTask.bounds]
    KEEP_WITHIN CasterBounds, WITHIN_BOUNDS
.kept:
    mov     r15, r11
.done:
    mov     rax, r15
    sub     rax, [rdi + MeetTask.met]
    shr     rax, 2
    LEAVE_OWNED
ENDFUNC
%endmacro
