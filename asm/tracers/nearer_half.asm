; nearer_half.asm - the objects of a tile in two halves: the nearer ones, which may hide the others, and the rest.
;
; unsafe extern "sysv64" fn(task: *const HalfTask) -> u64
;
;   Returns how many are nearer: those whose 1/t of the nearest point is not below the middle, which has as many f32
;   between it and the least of all as between it and the greatest; the largest number, that of an object that may be
;   anywhere, is not taken for the greatest. Numbers not below 0 are ordered as their bits are. Both halves keep their
;   order. A branch on who is nearer would not be foreseen: each record is stored to both halves, and one of them
;   goes on.
;
;   registers   rdi task; r8 the next, rcx those to go; r9 the nearer half, r10 the other; edx the middle, as bits
;               x2, x3 the least and the greatest of each number of the records
;   writes      each half, with room for all
;   requires    the CPUID features of the ISA; count >= 1
;   equals      Iterator::partition, at reference::tile::middle

; NEARER_HALF - the function.
%macro NEARER_HALF 0
FUNC ISA %+ _nearer_half
    mov     r8, [rdi + HalfTask.seen]
    mov     rcx, [rdi + HalfTask.count]
    INSERT128 2, [r8], 0
    IOP     pxor, x3, x3, x3
align 16
.extremes:
    INSERT128 0, [r8], 0
    IOP     pminud, x2, x2, x0
    IOP     pcmpeqd, x1, x0, [PACKET(largest)]
    IOP     pandn, x1, x1, x0
    IOP     pmaxud, x3, x3, x1
    add     r8, Seen_size
    dec     rcx
    jnz     .extremes

    VEX(pextrd) edx, x2, Seen.most / 4
    VEX(pextrd) eax, x3, Seen.most / 4
    add     edx, eax
    shr     edx, 1
    mov     r8, [rdi + HalfTask.seen]
    mov     rcx, [rdi + HalfTask.count]
    mov     r9, [rdi + HalfTask.nearer]
    mov     r10, [rdi + HalfTask.farther]
align 16
.next:
    INSERT128 0, [r8], 0
    STORE128 [r9], x, 0, 0
    STORE128 [r10], x, 0, 0
    cmp     [r8 + Seen.most], edx
    sbb     rax, rax
    and     eax, Seen_size              ; of the farther ones, 0 of the others
    add     r10, rax
    xor     eax, Seen_size
    add     r9, rax
    add     r8, Seen_size
    dec     rcx
    jnz     .next
    mov     rax, r9
    sub     rax, [rdi + HalfTask.nearer]
    shr     rax, ilog2e(Seen_size)
    CLEAN_UPPER
ENDFUNC
%endmacro
