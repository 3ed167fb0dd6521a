; alone_sse41.asm - the unit for SSE4.1 in which each macro of the tracers is a function of its own, to be proved.

%define ISA sse41
%include "include/isa.inc"
%include "include/alone.inc"
