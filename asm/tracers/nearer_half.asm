; nearer_half.asm - partitions the objects of a tile into nearer ones, which may hide the others, and the rest.
;
; unsafe extern "sysv64" fn(task: *const HalfTask) -> u64
;
;   Returns the number of nearer ones: those whose upper bound of 1/t is not below the middle, which has as many f32
;   between it and the least bound as between it and the greatest. The largest f32, the bound of an object that may be
;   at any distance, does not count as the greatest. Non-negative numbers are ordered as their bits are. Both halves
;   keep their order. A branch per object would be mispredicted: each record is stored to both halves, and only the end
;   of the right one advances.
;
;   registers   rdi task; r8 the next object, rcx how many are left; r9 end of the nearer half, r10 of the other; edx
;               the middle, as bits; v2, v3 the minimum and the maximum of each field; with masks v2 later the middle
;   writes      both halves, each with room for all objects
;   requires    the CPUID features of the ISA; count >= 1
;   equals      kernels::portable::nearest::nearer_half

%assign CANDIDATE_LANES VBYTES / Candidate_size ; records in a register

; EXTREMES_HERE - extends the minimum x2 or v2 and the maximum x3 or v3 by the records at r8. Clobbers v0 and, without
;                 masks, v1.
;
;   instructions   sse41 6   avx2 5   avx512 4
;   critical path  load -> compare -> and -> max
%macro EXTREMES_HERE 1
%define %%r %1          ; [in]       x or v
%ifidn %%r, v
    VLOAD   v0, [r8]
%else
    INSERT128 0, [r8], 0
%endif
    IOP     pminud, %[%%r %+ 2], %[%%r %+ 2], %[%%r %+ 0]
%if HAS_MASKS
    vpcmpneqd MASK, %[%%r %+ 0], [PACKET(largest)]
    vpmaxud %[%%r %+ 3] {MASK}, %[%%r %+ 3], %[%%r %+ 0]
%else
    IOP     pcmpeqd, %[%%r %+ 1], %[%%r %+ 0], [PACKET(largest)]
    IOP     pandn, %[%%r %+ 1], %[%%r %+ 1], %[%%r %+ 0]
    IOP     pmaxud, %[%%r %+ 3], %[%%r %+ 3], %[%%r %+ 1]
%endif
%endmacro

; NEARER_HALF - defines the kernel, which the head of this file describes.
%macro NEARER_HALF 0
FUNC ISA %+ _nearer_half
    mov     r8, [rdi + HalfTask.candidates]
    mov     rcx, [rdi + HalfTask.count]
    VZERO   v3
%if CANDIDATE_LANES == 1
    INSERT128 2, [r8], 0
%else
%if HAS_MASKS
    vbroadcasti32x4 v2, [r8]
%else
    vbroadcasti128 v2, [r8]
%endif
    mov     rax, rcx
    shr     rax, ilog2e(CANDIDATE_LANES)
    jz      .few
align 16
.many:
    EXTREMES_HERE v
    add     r8, VBYTES
    dec     rax
    jnz     .many
.few:
%if VBYTES == 64
    vextracti64x4 h0, v2, 1
    vpminud h2, h2, h0
    vextracti64x4 h0, v3, 1
    vpmaxud h3, h3, h0
%endif
    vextracti128 x0, ymm2, 1
    vpminud x2, x2, x0
    vextracti128 x0, ymm3, 1
    vpmaxud x3, x3, x0
    and     ecx, CANDIDATE_LANES - 1
    jz      .middle
%endif
align 16
.extremes:
    EXTREMES_HERE x
    add     r8, Candidate_size
    dec     rcx
    jnz     .extremes

.middle:
    VEX(pextrd) edx, x2, Candidate.most / 4
    VEX(pextrd) eax, x3, Candidate.most / 4
    add     edx, eax
    shr     edx, 1
    mov     r8, [rdi + HalfTask.candidates]
    mov     rcx, [rdi + HalfTask.count]
    mov     r9, [rdi + HalfTask.nearer]
    mov     r10, [rdi + HalfTask.farther]
%if HAS_MASKS
    vpbroadcastd v2, edx
    sub     rcx, CANDIDATE_LANES
    jb      .last
align 16
.four:
    VLOAD   v0, [r8]
    vpshufd v1, v0, 0x55 * (Candidate.most / 4)
    vpcmpnltud k1, v1, v2
    knotw   k2, k1
    vpcompressd v1 {k1} {z}, v0
    vpcompressd v0 {k2} {z}, v0
    kmovw   eax, k1
    popcnt  eax, eax
    VSTORE  [r9], v1
    VSTORE  [r10], v0
    shl     eax, 2                      ; bytes of the nearer ones
    add     r9, rax
    sub     r10, rax
    add     r10, VBYTES
    add     r8, VBYTES
    sub     rcx, CANDIDATE_LANES
    jae     .four
.last:
    add     rcx, CANDIDATE_LANES
    jz      .done
%endif
align 16
.next:
    INSERT128 0, [r8], 0
    STORE128 [r9], x, 0, 0
    STORE128 [r10], x, 0, 0
    cmp     [r8 + Candidate.most], edx
    sbb     rax, rax
    and     eax, Candidate_size         ; Candidate_size for a farther one, else 0
    add     r10, rax
    xor     eax, Candidate_size
    add     r9, rax
    add     r8, Candidate_size
    dec     rcx
    jnz     .next
.done:
    mov     rax, r9
    sub     rax, [rdi + HalfTask.nearer]
    shr     rax, ilog2e(Candidate_size)
    CLEAN_UPPER
ENDFUNC
%endmacro
