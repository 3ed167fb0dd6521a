; visible.asm - culls the objects of a tile that nearer ones hide, LANES of them in lockstep.
;
; unsafe extern "sysv64" fn(view: *const VisibleView, task: *const VisibleTask) -> u64
;
;   Moves the visible objects to the front, in order, and returns their number. An object is hidden if every pixel of
;   every part of the window that its bounds meet holds something nearer. An object in at most two parts across and two
;   down, as most are, is looked up without a branch; others are checked part by part. There are four tables of the
;   hierarchical depth, row by row: of each part alone, with its right neighbour, with the one below, and with these two
;   and the one between them.
;
;   Four registers of records are transposed within 128 bits, so that each holds one number of all records: its element
;   4c + k comes from 128-bit part c of register k.
;
;   registers   rdi view, whose fields are the constants K; rsi task; r8 the next object, rcx how many are left, r9
;               where they go, r10 parts; eax visible lanes, ebx lanes in many parts, a bit each
;               v0 to v3 the records; v4, v6 the first and the last of their parts across, v5, v8 down; v7 most
;   writes      the visible objects; the list after them is overwritten
;   requires    the CPUID features of the ISA; count >= 1; room for a multiple of LANES, filled up with hidden objects
;   equals      kernels::portable::nearest::visible

; PARTS - v<first> and v<last> = the first and the last part that bounds meet, across or down; last < first if none.
;
;   instructions   sse41 11   avx2, avx512 10
;   critical path  shift -> shift -> sub -> max -> shift
%macro PARTS 3
%define %%first %1      ; [in/out]   number of a register: bounds in, parts out
%define %%last %2       ; [out]      number of a register
%define %%axis %3       ; [in]       column or row
    IOP     psrld, v%[%%last], v%[%%first], 16
    IOP     pslld, v%[%%first], v%[%%first], 16
    IOP     psrld, v%[%%first], v%[%%first], 16
    IOP     psubd, v%[%%first], v%[%%first], K(VisibleView. %+ %%axis / 4)
    IOP     pmaxsd, v%[%%first], v%[%%first], K(VisibleView.first_ %+ %%axis / 4)
    IOP     psrld, v%[%%first], v%[%%first], ilog2e(PART_SIDE)
    IOP     psubd, v%[%%last], v%[%%last], K(VisibleView.next_ %+ %%axis / 4)
    IOP     pminsd, v%[%%last], v%[%%last], K(VisibleView.last_ %+ %%axis / 4)
    IOP     pmaxsd, v%[%%last], v%[%%last], [PACKET(zeros)]
    IOP     psrld, v%[%%last], v%[%%last], ilog2e(PART_SIDE)
%endmacro

; LOOK_UP_FOUR - d = the numbers at r10 with the indices in a. Clobbers rdx.
;
;   instructions   sse41, avx2 8
;   critical path  extract -> load -> insert
%macro LOOK_UP_FOUR 2
%define %%a %1          ; [in]       128 bits of indices
%define %%d %2          ; [out]      128 bits
    VEX(movd) edx, %%a
    VEX(movss) %%d, [r10 + 4 * rdx]
%assign %%l 1
%rep 3
    VEX(pextrd) edx, %%a, %%l
%if HAS_VEX
    vinsertps %%d, %%d, [r10 + 4 * rdx], 16 * %%l
%else
    insertps %%d, [r10 + 4 * rdx], 16 * %%l
%endif
%assign %%l %%l + 1
%endrep
%endmacro

; LOOK_UP - v13 = the numbers at r10 with the indices in the lower 7 bits of v12. Clobbers v9 to v15 and, without masks,
;           rdx.
;
;   instructions   sse41 10   avx2 20   avx512 15
;   critical path  move -> permute -> select -> select, or shift -> shift -> extract -> load -> insert
%macro LOOK_UP 0
%if HAS_MASKS
    VMOV    v13, v12
    vpermi2ps v13, zmm16, zmm17
    VMOV    v14, v12
    vpermi2ps v14, zmm18, zmm19
    VMOV    v15, v12
    vpermi2ps v15, zmm20, zmm21
    VMOV    v9, v12
    vpermi2ps v9, zmm22, zmm23
    vpslld  v10, v12, 26
    vpcmpltd k2, v10, [PACKET(zeros)]
    vpslld  v10, v12, 25
    vpcmpltd k3, v10, [PACKET(zeros)]
    vmovaps v13 {k2}, v14
    vmovaps v15 {k2}, v9
    vmovaps v13 {k3}, v15
%else
    IOP     pslld, v12, v12, 25
    IOP     psrld, v12, v12, 25
    LOOK_UP_FOUR x12, x13
%if LANES > 4
    vextracti128 x14, v12, 1
    LOOK_UP_FOUR x14, x15
    vinsertf128 v13, v13, x15, 1
%endif
%endif
%endmacro

; KEEP_VISIBLE - stores the records in v0 to v3 whose bits are set, one after another. Clobbers rdx and v4.
;
;   instructions   sse41 20   avx2 39   avx512 35
%macro KEEP_VISIBLE 0
%if HAS_MASKS
%assign %%k 0
%rep 4
    mov     edx, eax
%if %%k > 0
    shr     edx, %%k
%endif
    and     edx, 0x1111
    imul    edx, edx, 0xf               ; a bit for each 32-bit number
    kmovw   k1, edx
    vpcompressd v4 {k1} {z}, v%[%%k]
    VSTORE  [r9], v4
    popcnt  edx, edx
    lea     r9, [r9 + 4 * rdx]
%assign %%k %%k + 1
%endrep
%else
%assign %%j 0
%rep LANES
%assign %%k %%j / (LANES / 4)
%assign %%c %%j % (LANES / 4)
%assign %%bit 4 * %%c + %%k
    STORE128 [r9], v, %%k, %%c
    mov     edx, eax
%if %%bit < ilog2e(Candidate_size)
    shl     edx, ilog2e(Candidate_size) - %%bit
%elif %%bit > ilog2e(Candidate_size)
    shr     edx, %%bit - ilog2e(Candidate_size)
%endif
    and     edx, Candidate_size
    add     r9, rdx
%assign %%j %%j + 1
%endrep
%endif
%endmacro

; VISIBLE - the function.
%macro VISIBLE 0
FUNC ISA %+ _visible
    PUSH_OWNED
    mov     r8, [rsi + VisibleTask.candidates]
    mov     rcx, [rsi + VisibleTask.count]
    mov     r10, [rsi + VisibleTask.parts]
    mov     r9, r8
    CONSTANTS VisibleView_size / 4
%if HAS_MASKS
%assign %%i 16
%rep 8
    vmovups zmm%[%%i], [r10 + VBYTES * (%%i - 16)]
%assign %%i %%i + 1
%endrep
%endif
.packet:
    VLOAD   v0, [r8]
    VLOAD   v1, [r8 + VBYTES]
    VLOAD   v2, [r8 + 2 * VBYTES]
    VLOAD   v3, [r8 + 3 * VBYTES]
    IOP     unpcklps, v4, v0, v1
    IOP     unpcklps, v5, v2, v3
    IOP     unpckhpd, v4, v4, v5        ; columns
    IOP     unpckhps, v5, v0, v1
    IOP     unpckhps, v6, v2, v3
    IOP     unpckhpd, v7, v5, v6
    IOP     unpcklpd, v5, v5, v6        ; rows
    PARTS   4, 6, column
    PARTS   5, 8, row
    IOP     psubd, v9, v6, v4
    IOP     psubd, v10, v8, v5
    IOP     pslld, v12, v10, 1          ; the table: with the right neighbour, or the one below
    IOP     paddd, v12, v12, v9
    IOP     pslld, v12, v12, ilog2e(TILE_HEIGHT / PART_SIDE)
    IOP     paddd, v12, v12, v5
    IOP     pslld, v12, v12, ilog2e(TILE_WIDTH / PART_SIDE)
    IOP     paddd, v12, v12, v4
    IOP     pmaxud, v9, v9, v10
    IOP     psrld, v9, v9, 1
%if HAS_MASKS
    vptestmd k1, v9, v9
    kmovw   ebx, k1
%else
    IOP     pcmpeqd, v9, v9, [PACKET(zeros)]
    VOP     movmsk, ebx, v9
    xor     ebx, (1 << LANES) - 1
%endif
    LOOK_UP
    MASK_GREATER v13, v7
    MASK_BITS eax
    not     eax
    test    ebx, ebx
    jnz     .many
.decided:
    KEEP_VISIBLE
    add     r8, 4 * VBYTES
    sub     rcx, LANES
    ja      .packet
    mov     rax, r9
    sub     rax, [rsi + VisibleTask.candidates]
    shr     rax, ilog2e(Candidate_size)
    jmp     .done

.many:
    VMOV_TO [SCRATCH], v4
    VMOV_TO [SCRATCH + VBYTES], v6
    VMOV_TO [SCRATCH + 2 * VBYTES], v5
    VMOV_TO [SCRATCH + 3 * VBYTES], v8
.next:
    bsf     edx, ebx
    lea     r11d, [rbx - 1]
    and     ebx, r11d
    mov     r11d, edx
    mov     r12d, edx
    and     r11d, 3
    shr     r12d, 2
    imul    r11d, r11d, VBYTES
    shl     r12d, ilog2e(Candidate_size)
    add     r12, r8
    VEX(movss) x4, [r11 + r12 + Candidate.most]
    mov     r11d, [SCRATCH + 2 * VBYTES + 4 * rdx]
.row:
    cmp     r11d, [SCRATCH + 3 * VBYTES + 4 * rdx]
    jg      .hidden
    mov     r12d, [SCRATCH + 4 * rdx]
    mov     r13d, r11d
    shl     r13d, ilog2e(TILE_WIDTH / PART_SIDE)
.part:
    cmp     r12d, [SCRATCH + VBYTES + 4 * rdx]
    jg      .next_row
    lea     r14d, [r13 + r12]
    VEX(movss) x5, [r10 + 4 * r14]
    VEX(ucomiss) x5, x4
    jbe     .visible
    inc     r12d
    jmp     .part
.next_row:
    inc     r11d
    jmp     .row
.hidden:
    btr     eax, edx
    jmp     .next_of_many
.visible:
    bts     eax, edx
.next_of_many:
    test    ebx, ebx
    jnz     .next
    jmp     .decided
.done:
    UNCONSTANTS
    POP_OWNED
ENDFUNC
%endmacro
