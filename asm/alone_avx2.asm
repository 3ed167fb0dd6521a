; alone_avx2.asm - the unit of macros by themselves, to be proved, in the instructions of avx2.

%define ISA avx2
%include "include/isa.inc"
%include "include/alone.inc"
