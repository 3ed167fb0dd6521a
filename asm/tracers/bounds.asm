; bounds.asm - the bounds of the pixels that each of many triangles can cover, LANES triangles in lockstep.
;
; unsafe extern "sysv64" fn(view: *const BoundsView, task: *const BoundsTask)
;
;   A ray can hit a triangle in front of the camera only if its pixel lies within the box of the projected vertices. The
;   box is computed in f32 and widened by a margin that exceeds the rounding. A triangle that reaches behind the
;   camera's plane gets the whole picture, and one entirely behind it nothing. Most triangles of a fine mesh contain no
;   pixel's centre; they are culled here: if a box is small, the edges are evaluated at the four pixels that it can
;   hold, and if each of these is outside some edge by more than the rounding, the box becomes empty.
;
;   registers   rdi view, whose fields are the constants K; rsi task; rdx triangles or faces, rcx how many are left,
;               r8 corners, r9 the next id, r10 candidates, r11 packets left, r15 the last triangle
;               v12, v13 the greatest and the least size so far, v14 the brightest colour, as bits; at SCRATCH the
;               greatest upper bound of 1/t
;   writes      a Candidate for each triangle that may cover a pixel, one after another, and their number; the memory
;               after them, up to a multiple of CHUNK in all, may be overwritten; and the extremes of all triangles in
;               BoundsFound, by which the plan judges their numbers; faces have no colours
;   requires    the CPUID features of the ISA; count >= 1 triangles, or faces with valid vertices; 4 readable bytes
;               after the vertices
;   equals      kernels::portable::set_up::bounds, to the last bit

; FIRST_AND_PAST - from coordinates v<f> to v<p>: w<f> = the first pixel and w<p> = one past the last, << 16.
;   equals      kernels::portable::set_up::bounds_of
%macro FIRST_AND_PAST 3
%define %%f %1          ; [in/out]   number of a register
%define %%p %2          ; [in/out]   number of a register
%define %%side %3       ; [in]       field: pixels of the picture along the axis
    VADD    v%[%%f], v%[%%f], K(BoundsView.low)
    VADD    v%[%%p], v%[%%p], K(BoundsView.high)
    VMAX    v%[%%f], v%[%%f], [PACKET(zeros)]
    VMAX    v%[%%p], v%[%%p], [PACKET(zeros)]
    VMIN    v%[%%f], v%[%%f], K(BoundsView. %+ %%side)
    VMIN    v%[%%p], v%[%%p], K(BoundsView. %+ %%side)
    LEVELS  %%f
    LEVELS  %%p
    IOP     pslld, w%[%%p], w%[%%p], 16
%endmacro

; PROJECT - replaces a coordinate x of three vertices by x / z to_pixels, and gives the least and the greatest of the
;           three.
;   equals      kernels::portable::set_up::project
%macro PROJECT 4
%define %%low %1        ; [out]      vreg
%define %%high %2       ; [out]      vreg
%define %%axis %3       ; [in]       x or y
%define %%t %4          ; [clobbered] vreg
    VMUL    %%low, v0, [r8 + TriangleArrays.a %+ %%axis]
    VMUL    %%high, v1, [r8 + TriangleArrays.b %+ %%axis]
    VMOV_TO [r8 + TriangleArrays.a %+ %%axis], %%low
    VMOV_TO [r8 + TriangleArrays.b %+ %%axis], %%high
    VMOV    %%t, %%low
    VMIN    %%low, %%low, %%high
    VMAX    %%high, %%high, %%t
    VMUL    %%t, v2, [r8 + TriangleArrays.c %+ %%axis]
    VMOV_TO [r8 + TriangleArrays.c %+ %%axis], %%t
    VMIN    %%low, %%low, %%t
    VMAX    %%high, %%high, %%t
%endmacro

; SIZE - w5 = the greater of w5 and the magnitude of a coordinate, as bits. Clobbers v6.
%macro SIZE 2
%define %%load %1       ; [in]       VMOV or VLOAD
%define %%from %2       ; [in]       vreg or memory
    %%load  v6, %%from
    VAND    v6, v6, [PACKET(magnitude)]
    IOP     pmaxud, w5, w5, w6
%endmacro

; EDGES_HERE - v3 = max(v3, the least of the edges v9, v10, v11 at a pixel), v5 = min(v5, the greatest of them).
;              Clobbers v7.
;   equals      kernels::portable::set_up::edges_here
%macro EDGES_HERE 0
    VMIN    v7, v9, v10
    VMIN    v7, v7, v11
    VMAX    v3, v3, v7
    VMAX    v7, v9, v10
    VMAX    v7, v7, v11
    VMIN    v5, v5, v7
%endmacro

; CROSS2 - d = ax*by - ay*bx. Clobbers v1.
;   equals      kernels::portable::set_up::cross2
%macro CROSS2 5
%define %%d %1          ; [out]      vreg, not one of the inputs
%define %%ax %2         ; [in]       vreg
%define %%ay %3         ; [in]       vreg
%define %%bx %4         ; [in]       vreg
%define %%by %5         ; [in]       vreg
    VMUL    %%d, %%ax, %%by
    VMUL    v1, %%ay, %%bx
    VSUB    %%d, %%d, v1
%endmacro

; LENGTH - v<n> = the number of pixels in the bounds in w<b>. Clobbers v8.
;   equals      kernels::portable::set_up::lengths
%macro LENGTH 2
%define %%n %1          ; [out]      number of a register
%define %%b %2          ; [in]       number of a register
    IOP     psrld, w%[%%n], w%[%%b], 16
    IOP     pslld, w8, w%[%%b], 16
    IOP     psrld, w8, w8, 16
    IOP     psubd, w%[%%n], w%[%%n], w8
    VOP     cvtdq2, v%[%%n], w%[%%n]
%endmacro

; NEARNESS - the memory at SCRATCH = the greater of itself and the upper bounds of 1/t, as bits.
%macro NEARNESS 1
%define %%near %1       ; [clobbered] number of a register: f32, or 0
    IOP     pmaxud, v%[%%near], v%[%%near], [SCRATCH]
    VMOV_TO [SCRATCH], v%[%%near]
%endmacro

%assign AHEAD 3072                      ; prefetch distance in bytes: about a chunk

; FOUR_AT - r14, rbx, r12, r13 = the addresses of four objects from rdx on, or of the last one. Prefetches later ones.
%macro FOUR_AT 1
%define %%bytes %1      ; [in]       of an object
%assign %%i 0
%rep (4 * %%bytes + 63) / 64
    prefetcht0 [rdx + AHEAD + 64 * %%i]
%assign %%i %%i + 1
%endrep
    OBJECT_AT 0, r14, %%bytes, rdx, r15
    OBJECT_AT 1, rbx, %%bytes, rdx, r15
    OBJECT_AT 2, r12, %%bytes, rdx, r15
    OBJECT_AT 3, r13, %%bytes, rdx, r15
    add     rdx, 4 * %%bytes
%endmacro

; BEGIN_BOUNDS - begins a function: saves registers, prepares the constants, and resets the extremes.
%macro BEGIN_BOUNDS 2
%define %%constants %1  ; [in]       number of constants at rdi
%define %%greatest %2   ; [in]       aligned memory: bits of f32 above those of any size
    PUSH_OWNED
    mov     rdx, [rsi + BoundsTask.objects]
    mov     r9, [rsi + BoundsTask.first_id]
    mov     r10, [rsi + BoundsTask.candidates]
    mov     rcx, [rsi + BoundsTask.count]
    CONSTANTS %%constants
    VZERO   v12
    VMOV    v13, %%greatest
    VZERO   v14
    VMOV_TO [SCRATCH], v14
%endmacro

; TRANSPOSE_CHUNK - transposes a chunk of objects, from rdx on.
%macro TRANSPOSE_CHUNK 2
%define %%bytes %1      ; [in]       of an object
%define %%transpose %2  ; [in]       macro that transposes four of them
    imul    r15, [rsi + BoundsTask.count], %%bytes
    add     r15, [rsi + BoundsTask.objects]
    sub     r15, %%bytes
    mov     r8, [rsi + BoundsTask.arrays]
%%four:
    FOUR_AT %%bytes
    %%transpose  r8, r14, rbx, r12, r13
    add     r8, 16
    mov     rax, r8
    sub     rax, [rsi + BoundsTask.arrays]
    cmp     eax, 4 * CHUNK
    jb      %%four
%endmacro

; END_BOUNDS - goes on to the next packet or the next chunk, and after the last one ends the function.
%macro END_BOUNDS 0
    add     r9, LANES
    dec     r11d
    jnz     .packet
    sub     rcx, CHUNK
    ja      .chunk
    mov     r8, [rsi + BoundsTask.found]
    VSTORE  [r8 + BoundsFound.most], v12
    VSTORE  [r8 + BoundsFound.least], v13
    VSTORE  [r8 + BoundsFound.brightest], v14
    VMOV    v0, [SCRATCH]
    VSTORE  [r8 + BoundsFound.nearest], v0
    sub     r10, [rsi + BoundsTask.candidates]
    shr     r10, ilog2e(Candidate_size)
    mov     [r8 + BoundsFound.count], r10
    UNCONSTANTS
    POP_OWNED
ENDFUNC
%endmacro

; TRANSPOSE_BLACK_FACES - transposes four faces, with black for their colours. Clobbers rax, r11, v0 to v4.
%macro TRANSPOSE_BLACK_FACES 5
%define %%to %1         ; [out]      general register: address of the first of the four in TriangleArrays
%define %%f0 %2         ; [in]       general register: address of a face
%define %%f1 %3         ; [in]       general register
%define %%f2 %4         ; [in]       general register
%define %%f3 %5         ; [in]       general register
    mov     r11, [rsi + BoundsTask.vertices]
    TRANSPOSE_FACES %%to, %%f0, %%f1, %%f2, %%f3, r11, rax
    VZERO   v0
    STORE128 [%%to + TriangleArrays.red], x, 0, 0
    STORE128 [%%to + TriangleArrays.green], x, 0, 0
    STORE128 [%%to + TriangleArrays.blue], x, 0, 0
%endmacro

; BOUNDS - defines the kernel, which the head of this file describes.
%macro BOUNDS 0
FUNC ISA %+ _bounds
    BEGIN_BOUNDS 12, [PACKET(magnitude)]
.chunk:
    cmp     qword [rsi + BoundsTask.vertices], 0
    jne     .faces
    TRANSPOSE_CHUNK Triangle_size, TRANSPOSE_TRIANGLES
    jmp     .transposed
.faces:
    TRANSPOSE_CHUNK FACE_BYTES, TRANSPOSE_BLACK_FACES
.transposed:
    mov     r8, [rsi + BoundsTask.arrays]
    mov     r11d, CHUNK / LANES
.packet:
    VLOAD   v0, [r8 + TriangleArrays.az]
    VLOAD   v1, [r8 + TriangleArrays.bz]
    VLOAD   v2, [r8 + TriangleArrays.cz]
    VAND    v5, v0, [PACKET(magnitude)]
    SIZE    VMOV, v1
    SIZE    VMOV, v2
    SIZE    VLOAD, [r8 + TriangleArrays.ax]
    SIZE    VLOAD, [r8 + TriangleArrays.ay]
    SIZE    VLOAD, [r8 + TriangleArrays.bx]
    SIZE    VLOAD, [r8 + TriangleArrays.by]
    SIZE    VLOAD, [r8 + TriangleArrays.cx]
    SIZE    VLOAD, [r8 + TriangleArrays.cy]
    IOP     pmaxud, w12, w12, w5
    IOP     pminud, w13, w13, w5
    IOP     pmaxud, w14, w14, [r8 + TriangleArrays.red]
    IOP     pmaxud, w14, w14, [r8 + TriangleArrays.green]
    IOP     pmaxud, w14, w14, [r8 + TriangleArrays.blue]
    VMIN    v3, v0, v1
    VMIN    v3, v3, v2
    VMAX    v4, v0, v1
    VMAX    v4, v4, v2
    KLOAD   v5, BoundsView.to_pixels
    VDIV    v6, v5, v0
    VDIV    v7, v5, v1
    VDIV    v8, v5, v2
    VMOV    v0, v6
    VMOV    v1, v7
    VMOV    v2, v8
    PROJECT v5, v6, x, v9
    PROJECT v10, v7, y, v9
    VSUB    v8, v6, v5
    VMOV_TO [r8 + TriangleArrays.red], v8
    VSUB    v8, v7, v10
    VMOV_TO [r8 + TriangleArrays.green], v8
    VADD    v5, v5, K(BoundsView.column)
    VADD    v6, v6, K(BoundsView.column)
    KLOAD   v8, BoundsView.row
    VSUB    v8, v8, v7                  ; the greatest y is the first row
    KLOAD   v9, BoundsView.row
    VSUB    v9, v9, v10
    FIRST_AND_PAST 5, 6, width
    FIRST_AND_PAST 8, 9, height
    VOP     cvtdq2, v0, w5
    VSUB    v0, v0, K(BoundsView.column)
    VOP     cvtdq2, v1, w8
    KLOAD   v2, BoundsView.row
    VSUB    v2, v2, v1
    IOR     w5, w5, w6
    IOR     w8, w8, w9
    MASK_GREATER v3, [PACKET(least)]    ; nearer ones could overflow
    KLOAD   v6, BoundsView.all_columns
    VSELECT v6, v5
    KLOAD   v9, BoundsView.all_rows
    VSELECT v9, v8
    KLOAD   v7, BoundsView.most
    VDIV    v7, v7, v3
    VMOV    v8, [PACKET(largest)]
    VSELECT v8, v7
    VMOV_TO [r8 + TriangleArrays.most], v8
    VMOV    v8, [PACKET(largest)]
    VMOV    v7, [r8 + TriangleArrays.red]
    VSELECT v8, v7
    VMOV_TO [r8 + TriangleArrays.red], v8
    MASK_GREATER v4, [PACKET(zeros)]
    MASK_KEEP v6
    MASK_KEEP v9
    VMOV    v8, [r8 + TriangleArrays.most]
    MASK_KEEP v8
    NEARNESS 8
    VMOV_TO [r8 + TriangleArrays.columns], v6
    VMOV_TO [r8 + TriangleArrays.rows], v9

    ; Corners relative to the first pixel of the bounds, and the edges there: inside a triangle all have one sign.
    VMOV    v3, [r8 + TriangleArrays.ax]
    VSUB    v3, v3, v0
    VMOV    v4, [r8 + TriangleArrays.ay]
    VSUB    v4, v4, v2
    VMOV    v5, [r8 + TriangleArrays.bx]
    VSUB    v5, v5, v0
    VMOV    v6, [r8 + TriangleArrays.by]
    VSUB    v6, v6, v2
    VMOV    v7, [r8 + TriangleArrays.cx]
    VSUB    v7, v7, v0
    VMOV    v8, [r8 + TriangleArrays.cy]
    VSUB    v8, v8, v2
    CROSS2  v9, v3, v4, v5, v6
    CROSS2  v10, v5, v6, v7, v8
    CROSS2  v11, v7, v8, v3, v4
    VSUB    v0, v4, v6                  ; increments for a column
    VSUB    v1, v6, v8
    VSUB    v2, v8, v4
    VSUB    v4, v3, v5                  ; increments for a row
    VSUB    v6, v5, v7
    VSUB    v8, v7, v3
    VMIN    v3, v9, v10
    VMIN    v3, v3, v11
    VMAX    v5, v9, v10
    VMAX    v5, v5, v11
    VADD    v9, v9, v0
    VADD    v10, v10, v1
    VADD    v11, v11, v2
    EDGES_HERE
    VADD    v9, v9, v4
    VADD    v10, v10, v6
    VADD    v11, v11, v8
    EDGES_HERE
    VSUB    v9, v9, v0
    VSUB    v10, v10, v1
    VSUB    v11, v11, v2
    EDGES_HERE
    VXOR    v5, v5, [PACKET(sign)]
    VMAX    v3, v3, v5
    KLOAD   v5, BoundsView.outside
    MASK_GREATER v5, v3
    VMOV    v3, [r8 + TriangleArrays.red]
    MASK_AND_LESS v3, K(BoundsView.reach), v5
    VMOV    v3, [r8 + TriangleArrays.green]
    MASK_AND_LESS v3, K(BoundsView.reach), v5
    VMOV    v3, [r8 + TriangleArrays.columns]
    VZERO   v5
    VSELECT v3, v5
    VMOV    v4, [r8 + TriangleArrays.rows]
    LENGTH  0, 3
    LENGTH  1, 4
    VMOV    v5, v0
    VMAX    v5, v5, v1
    VMIN    v0, v0, v1
    MASK_GREATER v0, [PACKET(zeros)]
    MASK_KEEP v5
    mov     r13, [rsi + BoundsTask.found]
    VLOAD   v1, [r13 + BoundsFound.longest]
    IOP     pmaxud, v1, v1, v5
    VSTORE  [r13 + BoundsFound.longest], v1
    MASK_BITS eax
    or      eax, [rsi + BoundsTask.keep_all]
    VSPREAD_INTEGER 2, r9
    VADD    v2, v2, [PACKET(natural)]
    LEVELS  2
    VMOV    v5, [r8 + TriangleArrays.most]
    STORE_CANDIDATES r10, 2, 3, 4, 5, 6, 7, 8, eax, r12
    add     r8, VBYTES
    END_BOUNDS
%endmacro
