; avx2.asm - the unit of the packet tracers on AVX2 and FMA: 8 rays in lockstep, or 4 in f64.

%define ISA avx2
%include "include/isa.inc"
%include "include/packets.inc"
