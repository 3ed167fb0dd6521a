; paper.asm - Algorithm 1 of the paper: rays one at a time, every vector in one 128-bit register.
;
; unsafe extern "sysv64" fn(frame: *const Frame, lists: *const Lists, row: u64, end: u64, out: *mut Vec4)
;
;   Writes the rows [row, end) to `out`, four floats a pixel: red, green, blue and 0, linear and not clamped; without a
;   hit it is the frame's background. Where AOS_HITS is 1 the function is called hits in place of trace, and a pixel is
;   the Surface that the nearest hit would be shaded as, with its t in the point's fourth lane; all 0 without a hit.
;
;   Everything that Algorithm 1 names stays in a register for the whole of its life:
;
;       rdi  bytes in a row             xmm0   ray: r_d
;       rdx  row                        xmm1   colour: I[row, col]
;       rcx  end                        xmm2   nearest: the t of the nearest hit so far
;       r8   out                        xmm3   t
;       r9   end of this row of out     xmm4   P
;       rsi  r10   spheres, their end   xmm5   N
;       r11  rbx   triangles            xmm6   (-W/2, H/2, f, 0)
;       rbp  r12   lights               xmm7   (col + 1/2, row + 1/2, 0, 0)
;       rax  object                     xmm8   to xmm13: temporaries
;       r13  light                      xmm14  zero
;       r14  frame                      xmm15  (step, -step, 0, 0)
;
;   requires       SSE3; addresses aligned to 16; every list as long as its count says; width >= 1; row < end
;   equals         reference::aos::trace, to the last bit; hits: the surfaces in it

; SHADE_SURFACE - lines 18 to 21 of Algorithm 1: the colour of the hit at P with normal N, over all lights.
%macro SHADE_SURFACE 2
%define %%colour %1     ; [in]       aligned memory: C of the object
%define %%sides %2      ; [in]       as in LAMBERT
%if AOS_HITS
    movaps  [r8 + Surface.point], xmm4
    movss   [r8 + Surface.point + 12], xmm3
    movaps  [r8 + Surface.normal], xmm5
    movaps  xmm1, %%colour
    movaps  [r8 + Surface.colour], xmm1
%else
    xorps   xmm1, xmm1
    mov     r13, rbp
    cmp     r13, r12
    jae     %%dark
align 16
%%light:
    LAMBERT xmm1, r13, xmm4, xmm5, %%colour, %%sides, xmm14, xmm8, xmm9, xmm10
    add     r13, Light_size
    cmp     r13, r12
    jb      %%light
%%dark:
%endif
%endmacro

; LIST - loads the address of a list and that of its end.
%macro LIST 4
%define %%first %1      ; [out]      general register
%define %%end %2        ; [out]      general register
%define %%list %3       ; [in]       the field of Lists, without its plural s; its length is the field <list>_count
%define %%size %4       ; [in]       bytes of an element
    imul    %%end, [rsi + %%list %+ _count], %%size
    mov     %%first, [rsi + %%list %+ s]
    add     %%end, %%first
%endmacro

; PAPER_TRACER - defines the kernel for one form; the head of this file describes it.
%macro PAPER_TRACER 0
%if AOS_HITS
%define PIXEL_SIZE Surface_size
FUNC AOS_NAME(hits)
%else
%define PIXEL_SIZE Vec4_size
FUNC AOS_NAME(trace)
%endif
    push    rbx
    push    rbp
    push    r12
    push    r13
    push    r14

    xorps   xmm14, xmm14
    movss   xmm15, [rdi + Frame.step]
    xorps   xmm8, xmm8
    subss   xmm8, xmm15
    unpcklps xmm15, xmm8                ; (step, -step, 0, 0)
    xorps   xmm6, xmm6
    subss   xmm6, [rdi + Frame.half_width]
    movss   xmm8, [rdi + Frame.half_height]
    unpcklps xmm6, xmm8
    movss   xmm8, [rdi + Frame.focal]
    movlhps xmm6, xmm8                  ; (-W/2, H/2, f, 0)
    mov     r14, rdi
    mov     rdi, [rdi + Frame.width]
    imul    rdi, rdi, PIXEL_SIZE
    LIST    rbp, r12, Lists.light, Light_size
    LIST    r11, rbx, Lists.triangle, PaperTriangle_size
    LIST    rsi, r10, Lists.sphere, PaperSphere_size

.row:                                   ; line 5
    lea     r9, [r8 + rdi]
    xorps   xmm7, xmm7
    xorps   xmm8, xmm8
    cvtsi2ss xmm7, qword [r14 + Frame.first]
    cvtsi2ss xmm8, rdx
    addss   xmm7, [half]
    addss   xmm8, [half]
    unpcklps xmm7, xmm8                 ; (first + 1/2, row + 1/2, 0, 0)

align 16
.col:                                   ; line 6
    movaps  xmm0, xmm7                  ; lines 7 to 11, with r_o = 0 left out:
    mulps   xmm0, xmm15                 ; (step (col + 1/2), -step (row + 1/2), 0, 0)
    addps   xmm0, xmm6                  ; r_d
    movss   xmm2, [infinity]            ; line 12
%if AOS_HITS
    xorps   xmm1, xmm1
    movaps  [r8 + Surface.point], xmm1
    movaps  [r8 + Surface.normal], xmm1
    movaps  [r8 + Surface.colour], xmm1
%else
    movaps  xmm1, [r14 + Frame.background]
%endif

    mov     rax, rsi                    ; line 13, the spheres
    cmp     rax, r10
    jae     .spheres_done
.sphere:
    SPHERE_HIT xmm3, xmm0, rax, .next_sphere, xmm8, xmm9, xmm10, xmm11, xmm14
    comiss  xmm3, xmm2                  ; line 16: t orders hits as the distance t |r_d| does
    jae     .next_sphere
    movaps  xmm2, xmm3                  ; line 17
    movaps  xmm4, xmm0
    VEC_SCALE xmm4, xmm3                ; P = t r_d
    movaps  xmm5, xmm4
    VEC_SUB xmm5, [rax + PaperSphere.centre]
    VEC_NORMALISE xmm5, xmm8, xmm9      ; N = (P - c) / |P - c|
    SHADE_SURFACE [rax + PaperSphere.colour], 1
.next_sphere:
    add     rax, PaperSphere_size
    cmp     rax, r10
    jb      .sphere
.spheres_done:

    mov     rax, r11                    ; line 13, the triangles
    cmp     rax, rbx
    jae     .triangles_done
.triangle:
    TRIANGLE_HIT xmm3, xmm4, xmm5, xmm0, rax, .next_triangle, xmm14, xmm8, xmm9, xmm10, xmm11, xmm12, xmm13
    comiss  xmm3, xmm2                  ; line 16
    jae     .next_triangle
    movaps  xmm2, xmm3                  ; line 17
    VEC_NORMALISE xmm5, xmm8, xmm9      ; N = n / |n|
    SHADE_SURFACE [rax + PaperTriangle.colour], 2
.next_triangle:
    add     rax, PaperTriangle_size
    cmp     rax, rbx
    jb      .triangle
.triangles_done:

%if AOS_HITS == 0
    movaps  [r8], xmm1
%endif
    addss   xmm7, [one]                 ; col + 1
    add     r8, PIXEL_SIZE
    cmp     r8, r9
    jb      .col

    inc     rdx                         ; row + 1
    cmp     rdx, rcx
    jb      .row

    pop     r14
    pop     r13
    pop     r12
    pop     rbp
    pop     rbx
ENDFUNC
%endmacro
