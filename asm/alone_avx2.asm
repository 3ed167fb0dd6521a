; alone_avx2.asm - the unit for AVX2 in which each macro of the tracers is a function of its own, to be proved.

%define ISA avx2
%include "include/isa.inc"
%include "include/alone.inc"
