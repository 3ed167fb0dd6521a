; vec3.asm - the paper's vector operations on packets, each as a function of its own, for tests and counts.
;
; unsafe extern "sysv64" fn(out: *mut f32, a: *const f32, b: *const f32, n: usize)
;
;   name        out      a        b         computes, for each of n packets and each lane
;   add3        vector   vector   vector    a + b
;   sub3        vector   vector   vector    a - b
;   scale3      vector   vector   scalar    a * b
;   dot3        scalar   vector   vector    a . b
;   norm3       scalar   vector   -         ||a||; b is not read
;   cross3      vector   vector   vector    a x b
;   normalise3  vector   vector   -         a / ||a||; b is not read
;
;   A packet of vectors is LANES x, then LANES y, then LANES z; one of scalars is LANES of them. No alignment is asked.
;
;   registers      rdi out, rsi a, rdx b, rcx packets to go, v0 to v2 a, v3 to v5 b
;   requires       the CPUID features of the ISA
;
; The labels .body and .body_end enclose the operation itself, without its loads and stores.

; PACKET_OP - an operation over n packets.
%macro PACKET_OP 6
%define %%name %1       ; [in]  the operation's name
%define %%reads %2      ; [in]  registers of a packet of b: 0, 1 or 3
%define %%x %3          ; [in]  register of the result, or of its x
%define %%y %4          ; [in]  register of its y, or none
%define %%z %5          ; [in]  register of its z, or none
%define %%operation %6  ; [in]  the macro with its arguments
FUNC ISA %+ _ %+ %%name
    test    rcx, rcx
    jz      .done
.packet:
    VLOAD   v0, [rsi]
    VLOAD   v1, [rsi + VBYTES]
    VLOAD   v2, [rsi + 2 * VBYTES]
%if %%reads > 0
    VLOAD   v3, [rdx]
%endif
%if %%reads > 1
    VLOAD   v4, [rdx + VBYTES]
    VLOAD   v5, [rdx + 2 * VBYTES]
%endif
.body:
    %%operation
.body_end:
    VSTORE  [rdi], %%x
%ifidn %%y, none
    add     rdi, VBYTES
%else
    VSTORE  [rdi + VBYTES], %%y
    VSTORE  [rdi + 2 * VBYTES], %%z
    add     rdi, 3 * VBYTES
%endif
    add     rsi, 3 * VBYTES
%if %%reads > 0
    add     rdx, %%reads * VBYTES
%endif
    dec     rcx
    jnz     .packet
.done:
%if HAS_VEX
    vzeroupper
%endif
ENDFUNC
%endmacro

PACKET_OP add3, 3, v0, v1, v2, {ADD3 v0, v1, v2, v0, v1, v2, v3, v4, v5}
PACKET_OP sub3, 3, v0, v1, v2, {SUB3 v0, v1, v2, v0, v1, v2, v3, v4, v5}
PACKET_OP scale3, 1, v0, v1, v2, {SCALE3 v0, v1, v2, v0, v1, v2, v3}
PACKET_OP dot3, 3, v6, none, none, {DOT3 v6, v0, v1, v2, v3, v4, v5, v7}
PACKET_OP norm3, 0, v6, none, none, {NORM3 v6, v0, v1, v2, v7}
PACKET_OP cross3, 3, v6, v7, v8, {CROSS3 v6, v7, v8, v0, v1, v2, v3, v4, v5, v9}
PACKET_OP normalise3, 0, v0, v1, v2, {NORMALISE3 v0, v1, v2, v6, v7}
