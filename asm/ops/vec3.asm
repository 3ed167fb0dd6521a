; vec3.asm - the operations of the paper on packets, each as a function of its own, for tests and counts.
;
; unsafe extern "sysv64" fn(out: *mut element, a: *const element, b: *const element, n: usize)
;
;   name        out      a        b            computes, for each of n packets and each lane
;   add3        vector   vector   vector       a + b
;   sub3        vector   vector   vector       a - b
;   scale3      vector   vector   scalar       a * b
;   dot3        scalar   vector   vector       a . b
;   norm3       scalar   vector   -            ||a||; b is not read
;   cross3      vector   vector   vector       a x b
;   normalise3  vector   vector   -            a / ||a||; b is not read
;   sphere3     scalar   vector   SphereHit    t of the ray a; infinity where it misses
;   triangle3   scalar   vector   TriangleHit  t of the ray a; infinity where it misses
;   lambert3    vector   vector   ObjectLight  what the light adds to black at the point a of the unit sphere
;
;   A packet of vectors is LANES x, then LANES y, then LANES z; a packet of scalars is LANES of them. There is one
;   record for all packets. No alignment is required.
;
;   registers      rdi out, rsi a, rdx b, rcx packets left, v0 to v2 a, v3 to v5 b
;                  where the record's fields are constants, rdx and rdi are exchanged
;   requires       the CPUID features of the ISA
;   equals         reference::packet, to the last bit
;
; Assembled once per ISA and element type: rayo_<isa>_<single or double>_<name>. The labels .body and .body_end enclose
; the operation itself, without its loads and stores.

; LOAD_RAY - loads the next packet of a into v0 to v2.
%macro LOAD_RAY 0
    VLOAD   v0, [rsi]
    VLOAD   v1, [rsi + VBYTES]
    VLOAD   v2, [rsi + 2 * VBYTES]
    add     rsi, 3 * VBYTES
%endmacro

; STORE_RESULT - stores a packet of scalars, or of vectors where y is not none.
%macro STORE_RESULT 4
%define %%out %1        ; [in/out]   general register
%define %%x %2          ; [in]       vreg
%define %%y %3          ; [in]       vreg, or none
%define %%z %4          ; [in]       vreg, or none
    VSTORE  [%%out], %%x
%ifidn %%y, none
    add     %%out, VBYTES
%else
    VSTORE  [%%out + VBYTES], %%y
    VSTORE  [%%out + 2 * VBYTES], %%z
    add     %%out, 3 * VBYTES
%endif
%endmacro

; PACKET_OP - an operation over n packets.
%macro PACKET_OP 6
%define %%name %1       ; [in]  the operation's name
%define %%reads %2      ; [in]  registers in a packet of b: 0, 1 or 3
%define %%x %3          ; [in]  register of the result, or of its x
%define %%y %4          ; [in]  register of its y, or none
%define %%z %5          ; [in]  register of its z, or none
%define %%operation %6  ; [in]  the macro with its arguments
FUNC ISA_NAME %+ _ %+ %%name
    test    rcx, rcx
    jz      .done
.packet:
    LOAD_RAY
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
    STORE_RESULT rdi, %%x, %%y, %%z
%if %%reads > 0
    add     rdx, %%reads * VBYTES
%endif
    dec     rcx
    jnz     .packet
.done:
    CLEAN_UPPER
ENDFUNC
%endmacro

; HIT_OP - intersects n packets of rays with one object: t in v3, and the mask.
%macro HIT_OP 3
%define %%name %1       ; [in]  the operation's name
%define %%constants %2  ; [in]  number of fields of the object's record
%define %%operation %3  ; [in]  the macro with its arguments
FUNC ISA_NAME %+ _ %+ %%name
    xchg    rdi, rdx
    CONSTANTS %%constants
    test    rcx, rcx
    jz      .done
.packet:
    LOAD_RAY
.body:
    %%operation
.body_end:
    VMOV    v4, [PACKET(infinite)]
    VSELECT v4, v3
    STORE_RESULT rdx, v4, none, none
    dec     rcx
    jnz     .packet
.done:
    UNCONSTANTS
ENDFUNC
%endmacro

; PACKET_OPS - the functions of this file, for one element type.
%macro PACKET_OPS 0
%assign ESTIMATE 0
PACKET_OP add3, 3, v0, v1, v2, {ADD3 v0, v1, v2, v0, v1, v2, v3, v4, v5}
PACKET_OP sub3, 3, v0, v1, v2, {SUB3 v0, v1, v2, v0, v1, v2, v3, v4, v5}
PACKET_OP scale3, 1, v0, v1, v2, {SCALE3 v0, v1, v2, v0, v1, v2, v3}
PACKET_OP dot3, 3, v6, none, none, {DOT3 v6, v0, v1, v2, v3, v4, v5, v7}
PACKET_OP norm3, 0, v6, none, none, {NORM3 v6, v0, v1, v2, v7}
PACKET_OP cross3, 3, v6, v7, v8, {CROSS3 v6, v7, v8, v0, v1, v2, v3, v4, v5, v9}
PACKET_OP normalise3, 0, v0, v1, v2, {NORMALISE3 v0, v1, v2, v6, v7}
HIT_OP sphere3, SphereHit_size, {SPHERE_HIT3 v3, v0, v1, v2, v4, v5, v6, v7, v8, v9}
HIT_OP triangle3, TriangleHit_size, {TRIANGLE_HIT3 v3, v0, v1, v2, v4, v5, v6}

; LAMBERT3 adds to a colour, here black.
FUNC ISA_NAME %+ _lambert3
    test    rcx, rcx
    jz      .done
.packet:
    LOAD_RAY
    VZERO   v3
    VZERO   v4
    VZERO   v5
.body:
    LAMBERT3 v3, v4, v5, v0, v1, v2, rdx, v6, v7, v8, v9, v10, v11
.body_end:
    STORE_RESULT rdi, v3, v4, v5
    dec     rcx
    jnz     .packet
.done:
    CLEAN_UPPER
ENDFUNC
%endmacro
