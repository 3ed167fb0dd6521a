; avx512.asm - the unit of the packet tracers on AVX-512 (F, VL, DQ, BW, and BMI2): 16 rays in lockstep, or 8 in f64.

%define ISA avx512
%include "include/isa.inc"
%include "include/packets.inc"
