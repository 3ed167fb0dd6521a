; alone_sse41.asm - the unit of macros by themselves, to be proved, in the instructions of sse41.

%define ISA sse41
%include "include/isa.inc"
%include "include/alone.inc"
