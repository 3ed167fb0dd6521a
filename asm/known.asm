; known.asm - functions whose instructions anybody can count, to test the counters.
;
; unsafe extern "sysv64" fn()
;
;   The labels .body and .body_end enclose what the table in src/kernels/harness.rs counts. The functions need nothing,
;   change only rax, rcx, rsi and the flags, and compute nothing.

%define ISA sse41
%include "include/isa.inc"

; KNOWN_LINE - a function with a given number of instructions in a row.
%macro KNOWN_LINE 1
%define %%count %1      ; [in]  how many
FUNC known_ %+ %%count
.body:
%assign i 0
%rep %%count
%if i % 3 == 0
    inc     eax
%elif i % 3 == 1
    lea     rax, [rax + 2 * rax + 1000]
%else
    xor     eax, 0x55
%endif
%assign i i + 1
%endrep
.body_end:
ENDFUNC
%endmacro
KNOWN_LINE 0
KNOWN_LINE 1
KNOWN_LINE 7
KNOWN_LINE 1000

; 3 instructions, of which two are executed ten times.
FUNC known_loop
.body:
    mov     ecx, 10
.again:
    dec     ecx
    jnz     .again
.body_end:
ENDFUNC

; 3 instructions, the last with a repeat prefix: it counts as one, however often it repeats (five times here).
FUNC known_repeat
.body:
    lea     rsi, [rayo_known_1000]
    mov     ecx, 5
    rep lodsb
.body_end:
ENDFUNC

; 2 instructions; the function that they call executes 9 more, including its endbr64 and ret.
FUNC known_call
.body:
    call    rayo_known_7
    inc     eax
.body_end:
ENDFUNC
