; sse41.asm - the unit of what runs on SSE4.1: the paper's engine, and packets of 4 rays in lockstep, or 2 in f64.

%define ISA sse41
%include "include/isa.inc"
%include "include/packets.inc"
%include "include/vec3_aos.inc"
%include "include/sphere_aos.inc"
%include "include/triangle_aos.inc"
%include "include/lambert_aos.inc"
%include "include/constants.inc"
%include "ops/aos.asm"
%include "tracers/paper.asm"

%assign AOS_BEST 0                      ; the paper's forms: rayo_paper_*
%define AOS_NAME(name) paper_ %+ name
    AOS_OPS
%assign AOS_HITS 0
    PAPER_TRACER
%assign AOS_HITS 1                      ; the surfaces that the paper's tracer hits, to measure errors
    PAPER_TRACER
%assign AOS_HITS 0

%assign AOS_BEST 1                      ; the best forms: rayo_aos_*
%define AOS_NAME(name) aos_ %+ name
    AOS_OPS
    PAPER_TRACER

%assign AOS_BEST 0                      ; the paper's forms, called: rayo_calls_*
%assign AOS_CALLS 1
%define AOS_NAME(name) calls_ %+ name
    PAPER_TRACER
