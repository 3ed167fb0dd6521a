; alone_avx512.asm - the unit of macros by themselves, to be proved, in the instructions of avx512.

%define ISA avx512
%include "include/isa.inc"
%include "include/alone.inc"
