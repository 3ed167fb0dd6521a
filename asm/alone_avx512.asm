; alone_avx512.asm - the unit for AVX-512 in which each macro of the tracers is a function of its own, to be proved.

%define ISA avx512
%include "include/isa.inc"
%include "include/alone.inc"
