; lanes.asm - Algorithm 1 of the paper with a ray in each lane: every ray is tested against every object.
;
; By SPHERE_HIT3 and TRIANGLE_HIT3 it is the step of the ladder between the paper's tracer and the packets' kernels,
; which know beforehand what their rays meet.
;
; unsafe extern "sysv64" fn(frame: *const Frame, lists: *const LaneLists, row: u64, end: u64, out: *mut Vec4)
;
;   Writes the rows [row, end) to `out`, four floats a pixel: red, green, blue and 0, linear and not clamped. The record
;   of an object is what K reads, more numbers, and an ObjectLight for each light:
;
;       sphere      SphereHit     the centre and 1 / radius       lights in radii from the centre
;       triangle    TriangleHit   nothing                         lights from the camera
;
;   registers      rdi object, r10 the end of its list, r13 bytes of an object; r12 light, r11 the end of its list
;                  rsi lists, rdx row, rcx end, r8 out, r14 frame, rbx column, r9 columns left
;                  v0 v1 v2 the ray, v3 t
;   requires       the CPUID features of the ISA; lists aligned to VBYTES; width >= 1; row < end
;   equals         experiments::check::twins::t_of_sphere

; K(i) is number i of the object's record, in every lane: where operands cannot broadcast, it is there LANES times.
%if HAS_MASKS
%define LANE_K ELEM
%else
%define LANE_K VBYTES
%endif

; What a packet keeps in memory.
%define LANE_RAY rsp                            ; three components
%define LANE_NEAREST [rsp + 3 * VBYTES]         ; the t of the nearest hit so far
%define LANE_COLOUR rsp + 4 * VBYTES            ; three channels
%define LANE_PIXELS rsp + 7 * VBYTES

; LANES_LOAD - v<i> and the next two registers = three packets of memory.
;
;   instructions   3
%macro LANES_LOAD 2
%define %%i %1          ; [out]      number of the first register
%define %%m %2          ; [in]       address, aligned to VBYTES
%assign %%n %%i
%rep 3
    VMOV    v%[%%n], [%%m + VBYTES * (%%n - %%i)]
%assign %%n %%n + 1
%endrep
%endmacro

; LANES_STORE - stores v<i> and the next two registers as three packets of memory.
;
;   instructions   3
%macro LANES_STORE 2
%define %%m %1          ; [in]       address, aligned to VBYTES
%define %%i %2          ; [in]       number of the first register
%assign %%n %%i
%rep 3
    VMOV_TO [%%m + VBYTES * (%%n - %%i)], v%[%%n]
%assign %%n %%n + 1
%endrep
%endmacro

; LANES_LIST - begins a list: its first object in rdi, its end in r10, the size of an object in r13.
;
;   instructions   4
%macro LANES_LIST 1
%define %%objects %1    ; [in]       sphere or triangle
    mov     rdi, [rsi + LaneLists.%[%%objects]s]
    mov     r13, [rsi + LaneLists.%[%%objects]_bytes]
    mov     r10, [rsi + LaneLists.%[%%objects]s_bytes]
    add     r10, rdi
%endmacro

; LANES_NEARER - lines 16 and 17: leaves in the mask the lanes where t in v3 is the nearest so far, and keeps it there;
;                jumps if there are none.
%macro LANES_NEARER 1
%define %%none %1       ; [in]       where to
    MASK_AND_LESS v3, LANE_NEAREST, v4
    MASK_BITS eax
    test    eax, eax
    jz      %%none
    VMOV    v4, LANE_NEAREST
    VMOV    v5, v3
    VSELECT v4, v5
    VMOV_TO LANE_NEAREST, v4
%endmacro

; LANES_LIGHTS - begins the loop over the lights of the object at rdi: the sum of light in v3, v4, v5 (red, green,
;                blue) is 0, r12 is the address of the object's first light, and r11 the end of its lights.
%macro LANES_LIGHTS 1
%define %%at %1         ; [in]       bytes of the record before them
    VZERO   v3
    VZERO   v4
    VZERO   v5
    lea     r12, [rdi + %%at]
    mov     r11, [rsi + LaneLists.lights_bytes]
    add     r11, r12
%endmacro

; LANES_KEEP - makes the sum of light in v3, v4, v5 the colour of the lanes in the mask. Clobbers v6.
%macro LANES_KEEP 0
%assign %%channel 0
%rep 3
%assign %%n %%channel + 3
    VMOV    v6, [LANE_COLOUR + VBYTES * %%channel]
    VSELECT v6, v%[%%n]
    VMOV_TO [LANE_COLOUR + VBYTES * %%channel], v6
%assign %%channel %%channel + 1
%endrep
%endmacro

; LANES_TRACER - defines the kernel for an ISA; the head of this file describes it.
%macro LANES_TRACER 0
%assign ESTIMATE 0
%if HAS_MASKS
%define K(i) dword [rdi + ELEM * (i)] TO_ALL_LANES
%else
%define K(i) [rdi + VBYTES * (i)]
%endif
FUNC ISA_NAME %+ _lanes
    ENTER_OWNED 7 * VBYTES + 16 * LANES, VBYTES
    mov     r14, rdi
.row:                                   ; line 5
    VSPREAD_INTEGER 0, rdx
    VADD    v0, v0, [PACKET(halves)]
    VSPREAD v1, [r14 + Frame.step]
    VMUL    v0, v0, v1
    VSPREAD v1, [r14 + Frame.half_height]
    VSUB    v1, v1, v0                  ; H/2 - step (row + 1/2)
    VSPREAD v2, [r14 + Frame.focal]
    LANES_STORE LANE_RAY, 0
    mov     r9, [r14 + Frame.width]
    xor     ebx, ebx
align 16
.packet:                                ; line 6
    VSPREAD_INTEGER 0, rbx
    VADD    v0, v0, [PACKET(transposed)]
    VADD    v0, v0, [PACKET(halves)]
    VSPREAD v1, [r14 + Frame.step]
    VMUL    v0, v0, v1
    VSPREAD v1, [r14 + Frame.half_width]
    VSUB    v0, v0, v1                  ; step (col + 1/2) - W/2
    VMOV_TO [LANE_RAY], v0
    VMOV    v3, [PACKET(infinite)]      ; line 12
    VMOV_TO LANE_NEAREST, v3
    VZERO   v3
    VZERO   v4
    VZERO   v5
    LANES_STORE LANE_COLOUR, 3
    LANES_LOAD 0, LANE_RAY

    LANES_LIST sphere                   ; line 13
    jmp     .spheres
.sphere:
    SPHERE_HIT3 v3, v0, v1, v2, v4, v5, v6, v7, v8, v9
    LANES_NEARER .next_sphere
    SCALE3  v0, v1, v2, v0, v1, v2, v3  ; P
    VSPREAD v6, [rdi + LANE_K * SphereHit_size]
    VSPREAD v7, [rdi + LANE_K * SphereHit_size + ELEM]
    VSPREAD v8, [rdi + LANE_K * SphereHit_size + 2 * ELEM]
    SUB3    v0, v1, v2, v0, v1, v2, v6, v7, v8
    VSPREAD v6, [rdi + LANE_K * SphereHit_size + 3 * ELEM]
    SCALE3  v0, v1, v2, v0, v1, v2, v6  ; N
    LANES_LIGHTS LANE_K * SphereHit_size + 4 * ELEM
    jmp     .sphere_lights
.sphere_light:
    LAMBERT3 v3, v4, v5, v0, v1, v2, r12, v6, v7, v8, v9, v10, v11
    add     r12, ELEM * ObjectLight_size
.sphere_lights:
    cmp     r12, r11
    jb      .sphere_light
    LANES_KEEP
    LANES_LOAD 0, LANE_RAY
.next_sphere:
    add     rdi, r13
.spheres:
    cmp     rdi, r10
    jb      .sphere

    LANES_LIST triangle
    jmp     .triangles
.triangle:
    TRIANGLE_HIT3 v3, v0, v1, v2, v4, v5, v6
    LANES_NEARER .next_triangle
    VMOV    v12, [PACKET(ones)]
    VDIV    v12, v12, v3                ; 1 / t
    LANES_LIGHTS LANE_K * TriangleHit_size
    jmp     .triangle_lights
.triangle_light:
    VSPREAD v6, [r12 + ELEM * ObjectLight.cosine]
    TRIANGLE_COSINE v6, v12, v0, v1, v2, r12, v7, v8, v9, v10
    VSPREAD v7, [r12 + ELEM * ObjectLight.red]
    VFMA    v3, v6, v7, v10
    VSPREAD v7, [r12 + ELEM * ObjectLight.green]
    VFMA    v4, v6, v7, v10
    VSPREAD v7, [r12 + ELEM * ObjectLight.blue]
    VFMA    v5, v6, v7, v10
    add     r12, ELEM * ObjectLight_size
.triangle_lights:
    cmp     r12, r11
    jb      .triangle_light
    LANES_KEEP
.next_triangle:
    add     rdi, r13
.triangles:
    cmp     rdi, r10
    jb      .triangle

    LANES_LOAD 1, LANE_COLOUR
    TRANSPOSE_F32X4 1, 2, 3, 4, 8, 9
    cmp     r9, LANES
    jb      .part
    STORE_F32X4 r8, 4, movups
    add     r8, 16 * LANES
    add     rbx, LANES                  ; the next columns
    sub     r9, LANES
    jnz     .packet
    jmp     .next_row
.part:                                  ; the last pixels of a row
    STORE_F32X4 LANE_PIXELS, 4, movups
    lea     rdi, [LANE_PIXELS]
.pixel:
    VEX(movups) x0, [rdi]
    VEX(movups) [r8], x0
    add     rdi, 16
    add     r8, 16
    dec     r9
    jnz     .pixel
.next_row:
    inc     rdx                         ; row + 1
    cmp     rdx, rcx
    jb      .row
    LEAVE_OWNED
ENDFUNC
%endmacro
