; checked.asm - the checked call, which tests whether a kernel keeps the calling convention, and kernels that break it.

%define ISA avx512                      ; the widest registers are checked
%include "include/isa.inc"
%include "include/layout.inc"          ; for Vec4_size

; The bits of the result, in the order of `Fault` in src/kernels/checked.rs.
%assign FAULT_RBX        0
%assign FAULT_RBP        1
%assign FAULT_R12        2
%assign FAULT_R13        3
%assign FAULT_R14        4
%assign FAULT_R15        5
%assign FAULT_RSP        6
%assign FAULT_STACK      7              ; wrote into its caller's frame
%assign FAULT_DIRECTION  8              ; left the direction flag set
%assign FAULT_MXCSR      9              ; changed the rounding mode, the masks, FTZ or DAZ
%assign FAULT_UPPER     10              ; left something in the upper parts of ymm or zmm: vzeroupper is missing

%assign CANARIES        32              ; quadwords of the caller's stack frame that must not change
%assign MXCSR_CONTROL   0xffc0          ; all but the sticky exception flags
%assign DIRECTION_FLAG  1 << 10

section RODATA align=64
junk:       dq 0x1b0b1e5_0badf00d, 0x2b0b1e5_0badf00d, 0x3b0b1e5_0badf00d   ; rbx, rbp, r12
            dq 0x4b0b1e5_0badf00d, 0x5b0b1e5_0badf00d, 0x6b0b1e5_0badf00d   ; r13, r14, r15
canary:     dq 0xcafe_0dd_ca7_5eed

section .bss align=64
upper:      resb 16 * 64                ; zmm0 to zmm15 as the kernel left them
home:       resq 1                      ; rsp at the call: a kernel may spoil every register, so memory keeps it; else 0
registers:  resq 1                      ; address of the arguments, where the result goes too
vectors:    resq 1
mxcsr:      resd 1                      ; MXCSR of the caller
mxcsr_inside: resd 1                    ; MXCSR while the kernel runs
mxcsr_after: resd 1

; FAULT_IF - sets a bit of r10 if a condition holds for the flags.
%macro FAULT_IF 2
%define %%condition %1  ; [in]  a condition code
%define %%bit %2        ; [in]  FAULT_*
    j%+%%condition %%fault
    jmp     %%fine
%%fault:
    bts     r10, %%bit
%%fine:
%endmacro

; unsafe extern "sysv64" fn(kernel: Code, registers: *mut [u64; 6], vectors: u64, mxcsr: u64) -> u64
;
;   Calls `kernel` with `registers` in rdi, rsi, rdx, rcx, r8 and r9, and junk in every register that it must preserve;
;   its result replaces the first of them. `vectors` is the width of this CPU's vectors in bytes: 16, 32 or 64.
;   The bits of `mxcsr` are set in MXCSR while the kernel runs. Returns the broken rules, one bit each.
;   Not reentrant: one call at a time.
FUNC checked_call
    push    rbx
    push    rbp
    push    r12
    push    r13
    push    r14
    push    r15
    sub     rsp, 8 * CANARIES + 8       ; aligned to 16 at the call
    mov     [registers], rsi
    mov     [vectors], rdx
    stmxcsr [mxcsr]
    or      ecx, [mxcsr]
    mov     [mxcsr_inside], ecx

    mov     rax, [canary]
%assign i 0
%rep CANARIES
    mov     [rsp + 8 * i], rax
%assign i i + 1
%endrep
    cmp     rdx, 16
    je      .call
    vzeroupper
.call:
    ldmxcsr [mxcsr_inside]
    mov     rax, rdi
    mov     r10, rsi
    mov     rdi, [r10]
    mov     rsi, [r10 + 8]
    mov     rdx, [r10 + 16]
    mov     rcx, [r10 + 24]
    mov     r8, [r10 + 32]
    mov     r9, [r10 + 40]
    mov     rbx, [junk]
    mov     rbp, [junk + 8]
    mov     r12, [junk + 16]
    mov     r13, [junk + 24]
    mov     r14, [junk + 32]
    mov     r15, [junk + 40]
    mov     [home], rsp                 ; last: from here on a crash can return
    call    rax

    xor     r10d, r10d                  ; the faults
    cmp     rsp, [home]
    FAULT_IF ne, FAULT_RSP
    mov     rsp, [home]
    mov     qword [home], 0
    mov     rdx, [registers]
    mov     [rdx], rax
    cmp     rbx, [junk]
    FAULT_IF ne, FAULT_RBX
    cmp     rbp, [junk + 8]
    FAULT_IF ne, FAULT_RBP
    cmp     r12, [junk + 16]
    FAULT_IF ne, FAULT_R12
    cmp     r13, [junk + 24]
    FAULT_IF ne, FAULT_R13
    cmp     r14, [junk + 32]
    FAULT_IF ne, FAULT_R14
    cmp     r15, [junk + 40]
    FAULT_IF ne, FAULT_R15

    pushfq
    pop     rdx
    cld
    test    edx, DIRECTION_FLAG
    FAULT_IF nz, FAULT_DIRECTION

    stmxcsr [mxcsr_after]
    mov     edx, [mxcsr_after]
    xor     edx, [mxcsr_inside]
    test    edx, MXCSR_CONTROL
    FAULT_IF nz, FAULT_MXCSR
    ldmxcsr [mxcsr]

    mov     rdx, [canary]
    xor     ecx, ecx
%assign i 0
%rep CANARIES
    mov     rsi, [rsp + 8 * i]
    xor     rsi, rdx
    or      rcx, rsi
%assign i i + 1
%endrep
    test    rcx, rcx
    FAULT_IF nz, FAULT_STACK

    lea     rsi, [upper]
    cmp     qword [vectors], 32
    jb      .report
    je      .ymm
%assign i 0
%rep 16
    vmovdqu64 [rsi + 64 * i], zmm %+ i
%assign i i + 1
%endrep
    jmp     .search
.ymm:
%assign i 0
%rep 16
    vmovdqu [rsi + 64 * i], ymm %+ i
%assign i i + 1
%endrep
.search:
    xor     ecx, ecx
    mov     edi, 16
.register:
%assign i 2                             ; past the lower 128 bits; what a narrower CPU lacks stays 0
%rep 6
    or      rcx, [rsi + 8 * i]
%assign i i + 1
%endrep
    add     rsi, 64
    dec     edi
    jnz     .register
    vzeroupper
    test    rcx, rcx
    FAULT_IF nz, FAULT_UPPER

.report:
    mov     rax, r10
    add     rsp, 8 * CANARIES + 8
    pop     r15
    pop     r14
    pop     r13
    pop     r12
    pop     rbp
    pop     rbx
ENDFUNC

; Where a call goes on after its kernel has crashed: the handler of the signal (src/kernels/crash.rs) lets the thread
; continue here, whatever the kernel left in the registers. The call returns as if no rule had been broken.
FUNC checked_crashed
    mov     rsp, [home]
    mov     qword [home], 0
    ldmxcsr [mxcsr]
    xor     r10d, r10d
    cmp     qword [vectors], 16
    je      .report
    vzeroupper
.report:
    jmp     rayo_checked_call.report
    END

; unsafe extern "sysv64" fn() -> u64
;
;   Not 0 while a call has all that it needs to go on in checked_crashed.
FUNC checked_home
    mov     rax, [home]
ENDFUNC

; The broken kernels: each breaks exactly one rule, so that every check is seen to fail.

; BROKEN_REGISTER - a kernel that does not restore a register.
%macro BROKEN_REGISTER 1
%define %%register %1   ; [in]  the register
FUNC broken_ %+ %%register
    not     %%register
ENDFUNC
%endmacro
BROKEN_REGISTER rbx
BROKEN_REGISTER rbp
BROKEN_REGISTER r12
BROKEN_REGISTER r13
BROKEN_REGISTER r14
BROKEN_REGISTER r15

FUNC broken_rsp
    pop     rax                         ; returns with one quadword too many taken from the stack
    add     rsp, 8
    jmp     rax
ENDFUNC

FUNC broken_stack
    not     qword [rsp + 16]
ENDFUNC

FUNC broken_direction
    std
ENDFUNC

FUNC broken_mxcsr
    stmxcsr [rsp - 8]
    or      dword [rsp - 8], 1 << 15    ; flush to zero
    ldmxcsr [rsp - 8]
ENDFUNC

FUNC broken_upper
    vpcmpeqd ymm15, ymm15, ymm15
ENDFUNC

; The broken operations, `fn(out: *mut f32, a: *const Vec4, b: *const Vec4)` as rayo_paper_dot: one mistake each.

FUNC broken_dot_wrong                   ; omits the second horizontal addition
    movaps  xmm0, [rsi]
    mulps   xmm0, [rdx]
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
ENDFUNC

FUNC broken_dot_rbx                     ; computes the right result, but does not restore a register
    movaps  xmm0, [rsi]
    mulps   xmm0, [rdx]
    haddps  xmm0, xmm0
    haddps  xmm0, xmm0
    movss   [rdi], xmm0
    xor     ebx, ebx
ENDFUNC

FUNC broken_dot_address                 ; reads from an unmapped address
    movaps  xmm0, [rsi]
    xor     eax, eax
    mulps   xmm0, [rax + 64]
    movss   [rdi], xmm0
ENDFUNC

FUNC broken_dot_alignment               ; loads a vector from a misaligned address
    movaps  xmm0, [rsi + 4]
    movss   [rdi], xmm0
ENDFUNC

FUNC broken_dot_instruction             ; executes an invalid instruction
    movaps  xmm0, [rsi]
    ud2
    movss   [rdi], xmm0
ENDFUNC

FUNC broken_dot_division                ; divides by 0 in a general register
    xor     edx, edx
    xor     ecx, ecx
    div     ecx
    movss   [rdi], xmm0
ENDFUNC
