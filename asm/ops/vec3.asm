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
;   equals         experiments::check::twins::of_packets, to the last bit
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

; PACKET_OPERATIONS - passes each operation to a macro, PACKET_OP or CHAINS, with the arguments that PACKET_OP
;                     explains.
%macro PACKET_OPERATIONS 1
%define %%each %1       ; [in]  the macro that takes the lines
    %%each add3, a, none, 0, 3, {}, v0, v1, v2, v0, {ADD3 v0, v1, v2, v0, v1, v2, v3, v4, v5}
    %%each sub3, a, none, 0, 3, {}, v0, v1, v2, v0, {SUB3 v0, v1, v2, v0, v1, v2, v3, v4, v5}
    %%each scale3, a, none, 0, 1, {}, v0, v1, v2, v0, {SCALE3 v0, v1, v2, v0, v1, v2, v3}
    %%each dot3, a, none, 0, 3, {}, v6, none, none, v6, {DOT3 v6, v0, v1, v2, v3, v4, v5, v7}
    %%each norm3, a, none, 0, 0, {}, v6, none, none, v6, {NORM3 v6, v0, v1, v2, v7}
    %%each cross3, a, none, 0, 3, {}, v6, v7, v8, v8, {CROSS3 v6, v7, v8, v0, v1, v2, v3, v4, v5, v9}
    %%each normalise3, a, none, 0, 0, {}, v0, v1, v2, v0, {NORMALISE3 v0, v1, v2, v6, v7}
    %%each sphere3, ray, sphere, SphereHit_size, 0, {}, v3, none, none, v3, \
        {SPHERE_HIT3 v3, v0, v1, v2, v4, v5, v6, v7, v8, v9}
    %%each triangle3, ray, triangle, TriangleHit_size, 0, {}, v3, none, none, v3, \
        {TRIANGLE_HIT3 v3, v0, v1, v2, v4, v5, v6}
    %%each lambert3, normal, light, 0, 0, {BLACK3}, v3, v4, v5, v3, \
        {LAMBERT3 v3, v4, v5, v0, v1, v2, rdx, v6, v7, v8, v9, v10, v11}
%endmacro

; BLACK3 - the colour that LAMBERT3 adds to.
%macro BLACK3 0
    VZERO   v3
    VZERO   v4
    VZERO   v5
%endmacro

; PACKET_OP - defines the function of an operation. One with constants intersects rays with an object and has a mask,
;             too.
%macro PACKET_OP 11
%define %%name %1       ; [in]  the operation's name
%define %%a %2          ; [in]  as in CHAINS
%define %%record %3     ; [in]  as in CHAINS
%define %%constants %4  ; [in]  number of fields of the object's record that are kept as constants
%define %%reads %5      ; [in]  registers in a packet of b: 0, 1 or 3
%define %%before %6     ; [in]  a macro for what the operation takes beside its operands, if any
%define %%x %7          ; [in]  register of the result, or of its x
%define %%y %8          ; [in]  register of its y, or none
%define %%z %9          ; [in]  register of its z, or none
%define %%led_back %10  ; [in]  as in CHAINS
%define %%operation %11 ; [in]  the macro with its arguments
FUNC ISA_NAME %+ _ %+ %%name
%if %%constants
    xchg    rdi, rdx
    CONSTANTS %%constants
%endif
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
    %%before
.body:
    %%operation
.body_end:
%if %%constants
    VMOV    v4, [PACKET(infinite)]
    VSELECT v4, %%x
    STORE_RESULT rdx, v4, none, none
%else
    STORE_RESULT rdi, %%x, %%y, %%z
%endif
%if %%reads > 0
    add     rdx, %%reads * VBYTES
%endif
    dec     rcx
    jnz     .packet
.done:
%if %%constants
    UNCONSTANTS
%else
    CLEAN_UPPER
%endif
ENDFUNC
%endmacro

; PACKET_OPS - defines the functions of this file, for one element type.
%macro PACKET_OPS 0
%assign ESTIMATE 0
    PACKET_OPERATIONS PACKET_OP
%endmacro
