; set_up.asm - triangles of a tile from corners to planes over its pixels, LANES triangles in lockstep, in f64.
;
; unsafe extern "sysv64" fn(view: *const TileView<f64>, task: *const SetupTask)
;
;   rayo_<isa>_single_set_up    writes f32
;   rayo_<isa>_double_set_up    writes f64
;
;   The planes of the edges are those of reference::geometry, in its order of operations. A triangle that is never hit,
;   or whose volume is 0 but for rounding, gets a 1/t of 0, which is never nearest.
;
;   registers   rdi view, whose fields are the constants K; rsi task; r8 corners, r9 planes, r10 shades, r11 a light,
;               rcx triangles left, rdx the next id, rbx from one triangle's shades to the next one's
;   writes      planes and shades of count triangles, rounded up to a multiple of LANES; arrays, with corners turned
;   requires    the CPUID features of the ISA; count from 1 to CHUNK; candidates that are triangles, or faces with valid
;               vertices, 4 readable bytes after these, and colours in the arrays
;   equals      kernels::portable::set_up::set_up, to the last bit

; CANDIDATE_OBJECT - r = the address of the object, in the list at rdx, of candidate i from r8 on, or of candidate 0 if
;               fewer than i + 1 are left (rcx); its bounds go to the arrays at r9. Clobbers r14.
%macro CANDIDATE_OBJECT 5
%define %%i %1          ; [in]       0 to 3
%define %%r %2          ; [out]      general register
%define %%e %3          ; [clobbered] its 32 bits
%define %%bytes %4      ; [in]       of an object
%define %%arrays %5     ; [in]       TriangleArrays or SphereArrays
    xor     r14d, r14d
    cmp     rcx, %%i + 1
    adc     r14d, r14d                  ; 1 if there is none
    dec     r14d
    and     r14d, Candidate_size * %%i
    mov     %%e, [r8 + r14 + Candidate.columns]
    mov     [r9 + %%arrays %+ .columns + 4 * %%i], %%e
    mov     %%e, [r8 + r14 + Candidate.rows]
    mov     [r9 + %%arrays %+ .rows + 4 * %%i], %%e
    mov     %%e, [r8 + r14 + Candidate.most]
    mov     [r9 + %%arrays %+ .most + 4 * %%i], %%e
    mov     r14d, [r8 + r14 + Candidate.id]
    imul    r14, r14, %%bytes
    lea     %%r, [rdx + r14]
%endmacro

; ASK_FOR - prefetches objects of a later chunk: those with the same indices in it as this packet's objects in theirs,
;           or its last one in place of missing ones. Prefetching a whole chunk at once would exceed the misses a core
;           can have outstanding. Clobbers rax, r11, r12 and r13.
%macro ASK_FOR 4
%define %%count %1      ; [in]       field of SetupTask: number of objects in that chunk
%define %%chunks %2     ; [in]       its distance from this one, in chunks
%define %%bytes %3      ; [in]       of an object
%define %%fetch %4      ; [in]       macro that prefetches the object at r11 + rax
    mov     r12, [rsi + SetupTask. %+ %%count]
    dec     r12
    js      %%none
    add     r12, CHUNK * %%chunks
    mov     r13d, CHUNK * (%%chunks + 1)
    sub     r13, rcx                    ; every chunk but the last is full
    shl     r12, ilog2e(Candidate_size)
    shl     r13, ilog2e(Candidate_size)
    add     r12, [rsi + SetupTask.candidates]
    add     r13, [rsi + SetupTask.candidates]
    mov     r11, [rsi + SetupTask.objects]
%rep LANES
    cmp     r13, r12
    cmova   r13, r12
    mov     eax, [r13 + Candidate.id]
    imul    rax, rax, %%bytes
    %%fetch %%bytes
    add     r13, Candidate_size
%endrep
%%none:
%endmacro

; TRANSPOSE_CANDIDATES - transposes the objects of the task.
;             Clobbers rax, rbx, rcx, rdx, r8, r9, r12, r13, r14 and v0 to v4.
%macro TRANSPOSE_CANDIDATES 3
%define %%bytes %1      ; [in]       of an object
%define %%arrays %2     ; [in]       TriangleArrays or SphereArrays
%define %%transpose %3  ; [in]       macro that transposes four of them
    mov     rdx, [rsi + SetupTask.objects]
    mov     r8, [rsi + SetupTask.candidates]
    mov     r9, [rsi + SetupTask.arrays]
    mov     rcx, [rsi + SetupTask.count]
%%four:
    CANDIDATE_OBJECT 0, rax, eax, %%bytes, %%arrays
    CANDIDATE_OBJECT 1, rbx, ebx, %%bytes, %%arrays
    CANDIDATE_OBJECT 2, r12, r12d, %%bytes, %%arrays
    CANDIDATE_OBJECT 3, r13, r13d, %%bytes, %%arrays
    %%transpose  r9, rax, rbx, r12, r13
    add     r8, 4 * Candidate_size
    add     r9, 16
    sub     rcx, 4
    ja      %%four
%endmacro

; FETCH_ALL - prefetches all lines of the object at r11 + rax.
%macro FETCH_ALL 1
%define %%bytes %1      ; [in]       of an object
    prefetcht0 [r11 + rax]
    prefetcht0 [r11 + rax + %%bytes - 1]
%endmacro

; FETCH_FACE - prefetches the first line of the face at r11 + rax.
%macro FETCH_FACE 1
%define %%bytes %1      ; [in]       of a face
    prefetcht0 [r11 + rax]
%endmacro

; FETCH_VERTICES - prefetches the vertices of the face at r11 + rax. Clobbers r14 and r15.
%macro FETCH_VERTICES 1
%define %%bytes %1      ; [in]       of a face
    mov     r14, [rsi + SetupTask.vertices]
%assign %%at 0
%rep 3
    movsxd  r15, dword [r11 + rax + %%bytes / 3 * %%at]
    lea     r15, [r15 + 2 * r15]
    prefetcht0 [r14 + 4 * r15]
%assign %%at %%at + 1
%endrep
%endmacro

; TRANSPOSE_CANDIDATE_FACES - transposes four faces, whose colours are in the arrays. Clobbers r10, r14, v0 to v4.
%macro TRANSPOSE_CANDIDATE_FACES 5
%define %%to %1         ; [out]      general register: address of the first of the four in TriangleArrays
%define %%f0 %2         ; [in]       general register: address of a face
%define %%f1 %3         ; [in]       general register
%define %%f2 %4         ; [in]       general register
%define %%f3 %5         ; [in]       general register
    mov     r10, [rsi + SetupTask.vertices]
    TRANSPOSE_FACES %%to, %%f0, %%f1, %%f2, %%f3, r10, r14
%endmacro

; ROUNDED_STORE - stores a register in a field at r9, rounded to elements of `out` bytes.
%macro ROUNDED_STORE 3
%define %%out %1        ; [in]       4 or 8
%define %%field %2      ; [in]       of TrianglePlanes or SpherePlanes, with its name in front
%define %%i %3          ; [clobbered] number of a register
%if %%out == 8
    VSTORE  [r9 + 8 * %%field], v%[%%i]
%else
    NARROW  %%i
    STORE_NUMBERS r9 + 4 * %%field, %%i
%endif
%endmacro

; LOAD_CORNER - loads corner a, b or c into three registers.
%macro LOAD_CORNER 4
%define %%x %1          ; [out]      vreg
%define %%y %2          ; [out]      vreg
%define %%z %3          ; [out]      vreg
%define %%corner %4     ; [in]       a, b or c
    WIDEN   %%x, [r8 + TriangleArrays. %+ %%corner %+ x]
    WIDEN   %%y, [r8 + TriangleArrays. %+ %%corner %+ y]
    WIDEN   %%z, [r8 + TriangleArrays. %+ %%corner %+ z]
%endmacro

; TURN - moves a coordinate of a triangle's second corner to the first, of the third to the second, of the first to the
;        third. Clobbers r12, r13 and r14.
%macro TURN 1
%define %%axis %1       ; [in]       x, y or z, of lane r11 of the arrays at r8
    mov     r12d, [r8 + 4 * r11 + TriangleArrays.a %+ %%axis]
    mov     r13d, [r8 + 4 * r11 + TriangleArrays.b %+ %%axis]
    mov     r14d, [r8 + 4 * r11 + TriangleArrays.c %+ %%axis]
    mov     [r8 + 4 * r11 + TriangleArrays.a %+ %%axis], r13d
    mov     [r8 + 4 * r11 + TriangleArrays.b %+ %%axis], r14d
    mov     [r8 + 4 * r11 + TriangleArrays.c %+ %%axis], r12d
%endmacro

; STORE_EDGE - stores the edge in v11, v12, v13 in the fields e<n>x, e<n>y, e<n>0.
%macro STORE_EDGE 2
%define %%out %1        ; [in]       4 or 8
%define %%n %2          ; [in]       1, 2 or 3
    ROUNDED_STORE %%out, TrianglePlanes.e%[%%n]0, 11
    ROUNDED_STORE %%out, TrianglePlanes.e%[%%n]x, 12
    ROUNDED_STORE %%out, TrianglePlanes.e%[%%n]y, 13
%endmacro

; WEIGHT - v<i> = the colour times the radiance of the light at r11. Clobbers v15.
;   equals      kernels::portable::set_up::weight
%macro WEIGHT 2
%define %%i %1          ; [out]      number of a register
%define %%channel %2    ; [in]       red, green or blue
    WIDEN   v%[%%i], [r8 + TriangleArrays. %+ %%channel]
    VSPREAD v15, [r11 + 8 * TileLight. %+ %%channel]
    VMUL    v%[%%i], v%[%%i], v15
%endmacro

; STORE_RECORDS - stores v11 to v14 as a record for each lane, from r12 on, rbx bytes apart. Clobbers v8 to v14, r13.
%macro STORE_RECORDS 1
%define %%out %1        ; [in]       4 or 8
    mov     r13, r12
%if %%out == 4
    NARROW  11
    NARROW  12
    NARROW  13
    NARROW  14
    TRANSPOSE4   11, 12, 13, 14, 8, 9, 10, 1
%assign %%c 0
%rep LANES > 4 ? LANES / 4 : 1
    STORE128 [r13], w, 8, %%c
    STORE128 [r13 + rbx], w, 9, %%c
%if LANES > 2
    lea     r13, [r13 + 2 * rbx]
    STORE128 [r13], w, 11, %%c
    STORE128 [r13 + rbx], w, 10, %%c
%endif
    lea     r13, [r13 + 2 * rbx]
%assign %%c %%c + 1
%endrep
%else
    TRANSPOSE4   11, 12, 13, 14, 8, 9, 10, 0
%assign %%c 0
%rep LANES / 2
    STORE128 [r13], v, 8, %%c
    STORE128 [r13 + 16], v, 11, %%c
    STORE128 [r13 + rbx], v, 9, %%c
    STORE128 [r13 + rbx + 16], v, 10, %%c
    lea     r13, [r13 + 2 * rbx]
%assign %%c %%c + 1
%endrep
%endif
%endmacro

; SET_UP - a function that writes elements of `out` bytes.
%macro SET_UP 2
%define %%precision %1  ; [in]       part of the function's name
%define %%out %2        ; [in]       4 or 8
FUNC ISA %+ _ %+ %%precision %+ _set_up
    PUSH_OWNED
    cmp     qword [rsi + SetupTask.vertices], 0
    jne     .faces
    TRANSPOSE_CANDIDATES Triangle_size, TriangleArrays, TRANSPOSE_TRIANGLES
    jmp     .transposed
.faces:
    TRANSPOSE_CANDIDATES FACE_BYTES, TriangleArrays, TRANSPOSE_CANDIDATE_FACES
.transposed:
    mov     r8, [rsi + SetupTask.arrays]
    mov     r9, [rsi + SetupTask.planes]
    mov     r10, [rsi + SetupTask.shades]
    mov     rcx, [rsi + SetupTask.count]
    mov     rdx, [rsi + SetupTask.first_id]
    imul    rbx, [rsi + SetupTask.light_count], %%out * TileShade_size   ; from one triangle's shades to the next one's
    CONSTANTS 10
.packet:
    cmp     qword [rsi + SetupTask.vertices], 0
    jne     .ask_for_faces
    ASK_FOR ahead, 1, Triangle_size, FETCH_ALL
    jmp     .asked
.ask_for_faces:
    ASK_FOR ahead, 1, FACE_BYTES, FETCH_VERTICES
    ASK_FOR later, 2, FACE_BYTES, FETCH_FACE
.asked:
    ; The terms of v . n, with n of the sides at v, may cancel: a corner comes first where they are small.
    LOAD_CORNER v0, v1, v2, a
    LOAD_CORNER v3, v4, v5, b
    LOAD_CORNER v6, v7, v8, c
    BETTER_CORNER eax
    test    eax, eax
    jnz     .turn
    TRIANGLE_VOLUME v3, v4, v5, v6, v0, v1, v2, v9, v10, v11, v12, v13, v14, v7, v8
    VAND    v7, v6, [PACKET(sign)]

    ; 1/t is (n . d) / (n . v), affine over the pixels; 0, which is never nearest, for a triangle that is never hit.
    KLOAD   v8, TileView.scale
    VDIV    v8, v8, v6
    VMUL    v9, v3, v8
    VMUL    v10, v4, v8
    VMUL    v11, v5, v8
    MASK_KEEP v9
    MASK_KEEP v10
    MASK_KEEP v11
    VMUL    v12, v9, K(TileView.dx)
    VFMA    v12, v10, K(TileView.dy), v14
    VFMA    v12, v11, K(TileView.dz), v14
    VMUL    v9, v9, K(TileView.step)
    VMUL    v10, v10, K(TileView.down)
    ROUNDED_STORE %%out, TrianglePlanes.t0, 12
    ROUNDED_STORE %%out, TrianglePlanes.tx, 9
    ROUNDED_STORE %%out, TrianglePlanes.ty, 10
    VSPREAD_INTEGER 8, rdx
    VADD    v8, v8, [PACKET(natural)]
    ROUNDED_STORE %%out, TrianglePlanes.id, 8
    VMOV    v8, v7
    ROUNDED_STORE %%out, TrianglePlanes.side, 8
    WIDEN   v8, [r8 + TriangleArrays.most]
    ROUNDED_STORE %%out, TrianglePlanes.most, 8

    ; The effect of each light: |n . (l - v)| / |n|, and the weights.
    DOT3    v8, v3, v4, v5, v3, v4, v5, v14
    VSQRT   v8, v8
    VMUL    v8, v8, K(TileView.scale)
    VMOV    v6, [PACKET(ones)]
    VDIV    v6, v6, v8
    mov     r11, [rsi + SetupTask.lights]
    mov     rax, [rsi + SetupTask.light_count]
    mov     r12, r10
    test    rax, rax
    jz      .dark
.light:
    VSPREAD v8, [r11 + 8 * TileLight.x]
    VSPREAD v9, [r11 + 8 * TileLight.y]
    VSPREAD v10, [r11 + 8 * TileLight.z]
    SUB3    v8, v9, v10, v8, v9, v10, v0, v1, v2
    DOT3    v11, v8, v9, v10, v3, v4, v5, v14
    VABS    v11, v11
    VMUL    v11, v11, v6
    VMIN    v11, v11, [PACKET(infinite)]    ; a NaN, of no area, becomes infinity
    WEIGHT  12, red
    WEIGHT  13, green
    WEIGHT  14, blue
    STORE_RECORDS %%out
    add     r12, %%out * TileShade_size
    add     r11, 8 * TileLight_size
    dec     rax
    jnz     .light
.dark:
    imul    rax, rbx, LANES
    add     r10, rax

    LOAD_CORNER v8, v9, v10, b
    TRIANGLE_EDGE v11, v12, v13, v0, v1, v2, v8, v9, v10, v7, v3, v4, v5, v6
    STORE_EDGE %%out, 1
    LOAD_CORNER v0, v1, v2, b
    LOAD_CORNER v8, v9, v10, c
    TRIANGLE_EDGE v11, v12, v13, v0, v1, v2, v8, v9, v10, v7, v3, v4, v5, v6
    STORE_EDGE %%out, 2
    LOAD_CORNER v0, v1, v2, c
    LOAD_CORNER v8, v9, v10, a
    TRIANGLE_EDGE v11, v12, v13, v0, v1, v2, v8, v9, v10, v7, v3, v4, v5, v6
    STORE_EDGE %%out, 3
    add     r8, 4 * LANES
    add     r9, %%out * LANES
    add     rdx, LANES
    sub     rcx, LANES
    ja      .packet
    UNCONSTANTS
    POP_OWNED
    ret
.turn:
    bsf     r11d, eax
    TURN    x
    TURN    y
    TURN    z
    lea     r12d, [rax - 1]
    and     eax, r12d
    jnz     .turn
    jmp     .asked
    END
%endmacro

; SET_UPS - defines the functions of this file.
%macro SET_UPS 0
    SET_UP  single, 4
    SET_UP  double, 8
%endmacro
