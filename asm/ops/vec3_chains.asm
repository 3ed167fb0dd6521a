; vec3_chains.asm - chains of the operations on packets, which measure the latency and the throughput of each.
;
; unsafe extern "sysv64" fn(rounds: u64) -> u64
;
;   rayo_<isa>_single_<op>3_latency      CHAIN_LINKS times <rounds> operations, each of which needs the previous result
;   rayo_<isa>_single_<op>3_throughput   as many operations, independent of each other
;   rayo_<isa>_single_feedback_latency   as many times LEAD_BACK alone
;   rayo_<isa>_single_muladd_throughput  SUMS times <rounds> multiply-adds, independent of each other in as many
;                                        registers: the most arithmetic that a core does
;
;   All return the number of operations in a round. The chains are those of chains.asm, for a packet in place of one
;   vector: in a latency chain LEAD_BACK makes each operand depend on the previous result without changing its value;
;   operands that an operation overwrites are loaded again. Constants of a record are kept as in the tracers.
;
;   requires       the CPUID features of the ISA; rounds >= 1

%assign CHAIN_LINKS 8                   ; operations in a round
%assign SUMS 14                         ; multiply-adds in a round

; LEAD_BACK - d = a, but dependent on r: costs the latency of an and and an or.
%macro LEAD_BACK 3
%define %%d %1          ; [out]       vreg: the operand of the next operation
%define %%r %2          ; [clobbered] vreg: the previous result
%define %%a %3          ; [in]        aligned memory: the operand
    VAND    %%r, %%r, [PACKET(zeros)]
    VARITH  or, 1, %%d, %%r, %%a
%endmacro

; FIRST - loads the first operand into v0 to v2.
%macro FIRST 1
%define %%value %1      ; [in]  label of its three registers
    VLOAD   v0, [%%value]
    VLOAD   v1, [%%value + VBYTES]
    VLOAD   v2, [%%value + 2 * VBYTES]
%endmacro

; BEGIN_CHAIN - begins a chain: the rounds go to rcx, and all operands are loaded.
%macro BEGIN_CHAIN 3
%define %%value %1      ; [in]  label of the first operand
%define %%record %2     ; [in]  label of the record
%define %%constants %3  ; [in]  how many of its elements are constants
    mov     rcx, rdi
    lea     rdi, [%%record]
    CONSTANTS %%constants
    mov     rdx, rdi
    FIRST   %%value
    VLOAD   v3, [PACKET(chain_b)]
    VLOAD   v4, [PACKET(chain_b) + VBYTES]
    VLOAD   v5, [PACKET(chain_b) + 2 * VBYTES]
align 32
.round:
%endmacro

; END_CHAIN - ends a chain.
%macro END_CHAIN 1
%define %%operations %1 ; [in]  how many operations a round has
    dec     rcx
    jnz     .round
    UNCONSTANTS
    mov     eax, %%operations
ENDFUNC
%endmacro

; CHAINS - the two chains of an operation, which takes what PACKET_OP takes.
%macro CHAINS 11
%define %%name %1       ; [in]  as in PACKET_OP
%define %%a %2          ; [in]  first operand, by its label below, whose x LEAD_BACK makes depend on the result
%define %%record %3     ; [in]  record, by its label below
%define %%constants %4  ; [in]  as in PACKET_OP
%define %%reads %5      ; [in]  as in PACKET_OP; b is loaded once
%define %%before %6     ; [in]  as in PACKET_OP
%define %%x %7          ; [in]  as in PACKET_OP; nothing is stored here
%define %%y %8          ; [in]  as in PACKET_OP
%define %%z %9          ; [in]  as in PACKET_OP
%define %%led_back %10  ; [in]  register of the result, or of its part, that depends on the x of a
%define %%operation %11 ; [in]  as in PACKET_OP
%define %%value PACKET(chain_ %+ %%a)
FUNC ISA_NAME %+ _ %+ %%name %+ _latency
    BEGIN_CHAIN %%value, PACKET(chain_ %+ %%record), %%constants
%rep CHAIN_LINKS
    VLOAD   v1, [%%value + VBYTES]
    VLOAD   v2, [%%value + 2 * VBYTES]
    %%before
    %%operation
    LEAD_BACK v0, %%led_back, [%%value]
%endrep
END_CHAIN CHAIN_LINKS

FUNC ISA_NAME %+ _ %+ %%name %+ _throughput
    BEGIN_CHAIN %%value, PACKET(chain_ %+ %%record), %%constants
%rep CHAIN_LINKS
    FIRST   %%value
    %%before
    %%operation
%endrep
END_CHAIN CHAIN_LINKS
%endmacro

; PACKET_CHAINS - defines the functions of this file, and their operands.
%macro PACKET_CHAINS 0
%assign ESTIMATE 0

section RODATA align=64
align 64
PACKET(chain_a):
    times LANES DE 0.5
    times LANES DE -0.75
    times LANES DE 1.25
PACKET(chain_b):
    times LANES DE 1.5
    times LANES DE 0.625
    times LANES DE -0.25
PACKET(chain_ray):
    times LANES DE 0.0625
    times LANES DE -0.125
    times LANES DE 1.0
PACKET(chain_normal):
    times LANES DE 0.0
    times LANES DE 0.6
    times LANES DE -0.8
PACKET(chain_none):                     ; of operations without a record
PACKET(chain_sphere):                   ; centre (0.25, -0.5, 4), radius 1.5
    DE 0.25, -0.5, 4.0, 2.25, 14.0625
PACKET(chain_triangle):                 ; (-1, -1, 3), (1, -1, 3.5) and (0.25, 1, 4)
    DE -1.0, -1.375, 4.0, 14.375
    DE 0.5, -6.5, -2.0, 1.0e-6
    DE 7.5, 3.125, -1.25, 1.0e-6
    DE -7.0, 4.75, -0.75, 1.0e-6
PACKET(chain_light):
    DE 3.0, 5.0, -2.0, 0.0, 0.75, 0.5, 0.25, 0.0

FUNC ISA_NAME %+ _feedback_latency
    BEGIN_CHAIN PACKET(chain_a), PACKET(chain_none), 0
%rep CHAIN_LINKS
    LEAD_BACK v0, v0, [PACKET(chain_a)]
%endrep
END_CHAIN CHAIN_LINKS

; d = d / 2 - 0.75 converges to -1.5 from any start.
FUNC ISA_NAME %+ _muladd_throughput
    BEGIN_CHAIN PACKET(chain_a), PACKET(chain_none), 0
%assign SUM 2
%rep SUMS
    VFMADD  v %+ SUM, v0, v1
%assign SUM SUM + 1
%endrep
END_CHAIN SUMS

    PACKET_OPERATIONS CHAINS
%endmacro
