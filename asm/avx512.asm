; avx512.asm - the unit of the packet tracers on AVX-512 (F, VL, DQ, BW, BMI2, POPCNT): 16 rays at once, or 8 in f64.

%define ISA avx512
%include "include/isa.inc"
%include "include/packets.inc"
