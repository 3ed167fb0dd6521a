; fill.asm - fills many pixels with one pattern, that of a background.
;
; unsafe extern "sysv64" fn(out: *mut u32, count: u64, pattern: u32, streaming: u64)
;
;   Writes `count` times `pattern` to `out`, which is aligned to 4; past the cache where `streaming` is not 0. Each
;   cache line is then written in only one of the two ways: a line that is in the cache would have to be evicted first.
;
;   registers   rdi out, rsi end, rdx pattern, rcx streaming, rax end of the middle, v0 the pattern
;   requires    the CPUID features of the ISA
;   equals      slice::fill

; FILL - the function.
%macro FILL 0
FUNC ISA %+ _fill
    VEX(movd) xmm0, edx
    VEX(pshufd) xmm0, xmm0, 0
%if HAS_MASKS
    vshuff32x4 zmm0, zmm0, zmm0, 0
%elif HAS_VEX
    vinsertf128 ymm0, ymm0, xmm0, 1
%endif
    lea     rsi, [rdi + 4 * rsi]
    test    rcx, rcx
    jnz     .lines
    lea     rax, [rdi + VBYTES]
    cmp     rax, rsi
    ja      .few
    VEX(movups) [rdi], v0             ; the first and the last register overlap with the aligned middle
    VEX(movups) [rsi - VBYTES], v0
    mov     rdi, rax
    and     rdi, -VBYTES
    mov     rax, rsi
    and     rax, -VBYTES
    cmp     rdi, rax
    jae     .done
align 16
.store:
    VEX(movaps) [rdi], v0
    add     rdi, VBYTES
    cmp     rdi, rax
    jb      .store
    jmp     .done
.to_line:
    mov     [rdi], edx
    add     rdi, 4
.lines:
    cmp     rdi, rsi
    jae     .done
    test    dil, 63
    jnz     .to_line
    mov     rax, rsi
    and     rax, -64
    cmp     rdi, rax
    jae     .few
align 16
.stream:
    VEX(movntps) [rdi], v0
    add     rdi, VBYTES
    cmp     rdi, rax
    jb      .stream
    jmp     .few
.one:
    mov     [rdi], edx
    add     rdi, 4
.few:
    cmp     rdi, rsi
    jb      .one
.done:
    CLEAN_UPPER
ENDFUNC
%endmacro
