//! Every kernel under a checked call and between guard pages; and kernels that break the rules, to see that we notice.

// Two of the deliberately broken kernels touch memory that is not theirs, in a process of their own.
#![allow(unsafe_code)]

use std::fmt::Debug;
use std::ops::Range;

use crate::kernel_cases::{self, Input, Numbers, implementations, packet_kernels, seed, twins};
use glam::Vec3;
use rayo::kernels::harness::{self, BROKEN, Guarded, Side, broken_read, broken_write, without_denormals};
use rayo::kernels::{
    BoundsView, CHUNK, Candidate, ColourRun, Element, ElementKernels, Extremes, F32x3, FacePart, Fault, Fill, Frame,
    Hits, LIT_ROWS, Light, LitRow, LitRows, LitSetup, LitSphere, Narrow, Objects, Op, OpRef, PART_SIDE, PacketKernels,
    PaperSphere, PaperTriangle, Parts, Plain, Rgb8, Rgba8, RowSetup, ShadeRows, ShadeTile, ShadingRecords, SphereChunk,
    SphereRecords, SphereView, Surface, TILE_PARTS, TileBuffers, TileOut, TileShade, TileWindow, Triangle,
    TriangleChunk, TriangleList, Vec4, hits_of_c, hits_of_paper,
};
use rayo::plan::{Keep, Raster, TilePlace, Tiles};
use rayo::scene::{self, Rng};

const SIDES: [Side; 2] = [Side::Before, Side::After];

/// Whether a copy of this process comes back from a call of kernels.
pub(crate) fn survives(call: impl FnOnce()) -> std::io::Result<bool> {
    // SAFETY: kernels only compute.
    unsafe { harness::survives(call) }
}

/// Inputs that take each way through an operation: intersections hit and miss, from outside and inside.
fn inputs(op: OpRef, rng: &mut Rng) -> Vec<Input> {
    let mut inputs: Vec<_> = (0..32).map(|_| Input::aimed(op, rng)).collect();
    for numbers in Numbers::ALL {
        inputs.extend((0..8).map(|_| Input::random(op, numbers, true, rng)));
    }
    inputs
}

/// Lists of different lengths, none among them.
fn scenes() -> Vec<(Vec<Light>, Vec<PaperSphere>, Vec<PaperTriangle>)> {
    let lights = [Light { position: Vec4::new(-3.0, 4.0, 0.0), radiance: Vec4::new(0.5, 0.75, 1.0) }; 3];
    let spheres = [5.0, 3.0].map(|z| kernel_cases::sphere(Vec4::new(0.25, 0.0, z), 1.0));
    let corners = [Vec4::new(-4.0, -2.0, 4.0), Vec4::new(4.0, -2.0, 4.0), Vec4::new(0.0, 3.0, 4.0)];
    let triangles = [kernel_cases::triangle(corners)];
    let lengths = [(0, 0, 0), (0, 1, 1), (1, 1, 0), (1, 0, 1), (2, 2, 1), (3, 0, 0)];
    let scene =
        |(l, s, t): (usize, usize, usize)| (lights[..l].to_vec(), spheres[..s].to_vec(), triangles[..t].to_vec());
    lengths.map(scene).to_vec()
}

/// A view of 90 degrees and more.
fn frame(width: u64, height: u32) -> Frame {
    let step = 2.0 / width as f32;
    Frame { step, half_width: 1.0, half_height: step * height as f32 / 2.0, focal: 1.0, width }
}

#[test]
fn every_operation_keeps_the_calling_convention() {
    let mut rng = Rng::new(seed());
    for (implementation, kernels) in implementations() {
        for (name, op) in kernels.ops() {
            for input in inputs(op, &mut rng) {
                assert_eq!(kernel_cases::call(op, &input).1, Ok(()), "{implementation} {name} for {input:?}");
            }
        }
    }
}

#[test]
fn every_tracer_keeps_the_calling_convention() {
    for (implementation, kernels) in implementations() {
        for (lights, spheres, triangles) in scenes() {
            let objects = Objects { lights: &lights, spheres: &spheres, triangles: &triangles };
            for (width, height) in [(1, 1), (2, 3), (17, 5), (64, 2)] {
                let mut film = vec![Vec4::from([f32::NAN; 4]); width as usize * height as usize];
                let kept = kernels.trace.call_checked(&frame(width, height), objects, 0..height, &mut film);
                assert_eq!(kept, Ok(()), "{implementation} at {width}x{height}, {objects:?}");
                let mut unchecked = film.clone();
                kernels.trace.call(&frame(width, height), objects, 0..height, &mut unchecked);
                assert_eq!(film, unchecked, "{implementation}: a checked call computes what any call does");
            }
        }
    }
}

/// What the two tracers of the paper hit.
fn hits() -> Vec<Hits> {
    [hits_of_c(), hits_of_paper()].into_iter().flatten().collect()
}

#[test]
fn what_a_tracer_hits_is_asked_within_the_calling_convention_and_within_its_memory() {
    let canary = Surface { point: [f32::NAN; 4].into(), ..Surface::ZERO };
    for hits in hits() {
        for (side, (lights, spheres, triangles)) in
            SIDES.into_iter().flat_map(|side| scenes().into_iter().map(move |s| (side, s)))
        {
            let lights = Guarded::new(&lights, side).unwrap();
            let spheres = Guarded::new(&spheres, side).unwrap();
            let triangles = Guarded::new(&triangles, side).unwrap();
            let objects = Objects { lights: &lights, spheres: &spheres, triangles: &triangles };
            for (width, rows) in [(1, 0..1), (3, 1..3), (16, 0..2), (33, 2..5)] {
                let frame = Guarded::new(&[frame(width, rows.end)], side).unwrap();
                let mut film = Guarded::new(&vec![canary; width as usize * rows.len()], side).unwrap();
                let what = format!("{width} wide, rows {rows:?}, the guard page {side:?}, {objects:?}");
                let mut trace = || hits.call(&frame[0], objects, rows.clone(), &mut film);
                assert!(survives(&mut trace).unwrap(), "touches the guard page: {what}");
                let mut checked = vec![canary; width as usize * rows.len()];
                assert_eq!(hits.call_checked(&frame[0], objects, rows.clone(), &mut checked), Ok(()), "{what}");
                trace();
                assert_eq!(film[..], checked[..], "{what}");
            }
        }
    }
}

#[test]
fn every_broken_kernel_is_caught_with_the_one_rule_that_it_breaks() {
    let rules: Vec<_> = BROKEN.iter().map(|broken| broken.breaks).collect();
    assert_eq!(rules, Fault::ALL, "there is a broken kernel for every rule");
    let Some(paper) = rayo::kernels::paper() else { return };
    for broken in BROKEN.iter().filter(|broken| broken.usable()) {
        assert_eq!(broken.call_checked(), Err(vec![broken.breaks]));
        // What it broke is put right: the next one is judged by what it does itself.
        let mut sum = Vec4::default();
        let one = Vec4::new(1.0, 1.0, 1.0);
        assert_eq!(paper.add.call_checked(&mut sum, &one, &one), Ok(()), "after {:?}", broken.breaks);
        assert_eq!(sum, Vec4::new(2.0, 2.0, 2.0));
    }
}

#[test]
fn without_denormals_a_kernel_sees_none_and_rust_does() {
    let least = f32::from_bits(1);
    let (tiny, zero) = (Vec4::new(least, -least, 2.0 * least), Vec4::default());
    for (implementation, kernels) in implementations() {
        let sum = || kernels.add.call(&tiny, &zero);
        assert_eq!(sum(), tiny, "{implementation}");
        let (sum, own) = without_denormals(|| (sum(), std::hint::black_box(least) + 0.0));
        assert_eq!((sum, own), (zero, least), "{implementation}");
        assert_eq!(kernels.add.call(&tiny, &zero), tiny, "{implementation} afterwards");
    }
    // What a kernel gives back comes through.
    let far = Candidate { most: 1.0, ..Candidate::default() };
    let near = Candidate { most: 2.0, ..Candidate::default() };
    for (isa, kernels) in packet_kernels() {
        let (mut nearer, mut farther) = ([Candidate::default(); 3], [Candidate::default(); 3]);
        let count = without_denormals(|| kernels.nearer_half.call(&[near, far, near], &mut nearer, &mut farther));
        assert_eq!((count, nearer[0], farther[0]), (2, near, far), "{isa}");
    }
}

/// Calls `op` with all of its memory flush with guard pages on `side`, first in a process that may die of it.
fn fenced<A: Plain, B: Plain, O: Plain>(op: Op<A, B, O>, a: &A, b: &B, side: Side) -> Option<O> {
    let a = Guarded::new(std::slice::from_ref(a), side).unwrap();
    let b = Guarded::new(std::slice::from_ref(b), side).unwrap();
    let mut out = Guarded::new(&[O::ZERO], side).unwrap();
    survives(|| op.call_into(&mut out[0], &a[0], &b[0])).unwrap().then(|| {
        op.call_into(&mut out[0], &a[0], &b[0]);
        out[0]
    })
}

#[test]
fn no_operation_touches_memory_beside_its_arguments() {
    let mut rng = Rng::new(seed());
    let scalar = |x: f32| Vec4 { x, ..Vec4::default() };
    for (implementation, kernels) in implementations() {
        for (name, op) in kernels.ops() {
            for (side, case) in SIDES.into_iter().flat_map(|side| [(side, 0), (side, 1), (side, 2), (side, 3)]) {
                let input = Input::aimed(op, &mut rng);
                let found = match (op, &input) {
                    (OpRef::Vector(op), Input::Vectors(a, b)) => fenced(op, a, b, side),
                    (OpRef::Scale(op), Input::Scale(a, b)) => fenced(op, a, b, side),
                    (OpRef::Lambert(op), Input::Lambert(a, b)) => fenced(op, a, b, side),
                    (OpRef::Scalar(op), Input::Vectors(a, b)) => fenced(op, a, b, side).map(scalar),
                    (OpRef::Sphere(op), Input::Sphere(a, b)) => fenced(op, a, b, side).map(scalar),
                    (OpRef::Triangle(op), Input::Triangle(a, b)) => fenced(op, a, b, side).map(scalar),
                    _ => unreachable!("aimed() gives what the operation takes"),
                };
                let what = format!("{implementation} {name}, the guard page {side:?}, case {case}: {input:?}");
                let found = found.unwrap_or_else(|| panic!("touches the guard page: {what}"));
                assert_eq!(found, kernel_cases::call(op, &input).0, "{what}");
            }
        }
    }
}

#[test]
fn no_tracer_touches_memory_beside_its_frame_its_lists_and_its_rows() {
    for (implementation, kernels) in implementations() {
        for side in SIDES {
            for (lights, spheres, triangles) in scenes() {
                let lights = Guarded::new(&lights, side).unwrap();
                let spheres = Guarded::new(&spheres, side).unwrap();
                let triangles = Guarded::new(&triangles, side).unwrap();
                let objects = Objects { lights: &lights, spheres: &spheres, triangles: &triangles };
                for (width, rows) in [(1, 0..1), (3, 1..3), (16, 0..2), (33, 2..5)] {
                    let frame = Guarded::new(&[frame(width, rows.end)], side).unwrap();
                    let pixels = width as usize * rows.len();
                    let mut film = Guarded::new(&vec![Vec4::from([f32::NAN; 4]); pixels], side).unwrap();
                    let mut trace = || kernels.trace.call(&frame[0], objects, rows.clone(), &mut film);
                    let what =
                        format!("{implementation}, {width} wide, rows {rows:?}, the guard page {side:?}, {objects:?}");
                    assert!(survives(&mut trace).unwrap(), "touches the guard page: {what}");
                    trace();
                    assert!(
                        film.iter().all(|pixel| !pixel.x.is_nan() && pixel.w == 0.0),
                        "a pixel is left out: {what}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_kernel_that_reads_or_writes_past_its_arguments_faults_at_the_guard_page() {
    let one = Vec4::new(1.0, 2.0, 3.0);
    // SAFETY: they are called with room for what they touch, or in a process of their own that is to fault.
    let (read, write) = unsafe { (broken_read(), broken_write()) };
    for (what, op, read_room, write_room, fine) in [
        ("reads past a", read, 1, 1, false),
        ("reads past a, where there is room", read, 2, 1, true),
        ("writes past out", write, 1, 1, false),
        ("writes past out, where there is room", write, 1, 2, true),
    ] {
        let a = Guarded::new(&vec![one; read_room], Side::After).unwrap();
        let mut out = Guarded::new(&vec![one; write_room], Side::After).unwrap();
        assert_eq!(survives(|| op.call_into(&mut out[0], &a[0], &one)).unwrap(), fine, "{what}");
    }
}

#[test]
fn a_guard_page_faults_on_either_side_and_only_beyond_the_values() {
    let values = [Vec4::new(1.0, 2.0, 3.0); 3];
    for (side, beyond) in [(Side::Before, -1), (Side::After, 3)] {
        let guarded = Guarded::new(&values, side).unwrap();
        assert_eq!(*guarded, values);
        let read = |index: isize| {
            // SAFETY: within the values, or in a process of its own that is to fault.
            let touch = || _ = unsafe { guarded.as_ptr().wrapping_offset(index).read_volatile() };
            survives(touch).unwrap()
        };
        assert!([0, 1, 2].into_iter().all(read), "{side:?}");
        assert!(!read(beyond), "{side:?}");
    }
}

/// What the packet kernels write.
trait Pixel: Plain + Debug + PartialEq {
    /// What none of them writes.
    const CANARY: Self;
    /// What is shown of one in a comparison: every bit.
    fn bits(self) -> [u32; 4];
    /// Whether its last part is what every kernel writes there; where it is like the others, whether it was written at all.
    fn whole(self) -> bool {
        self != Self::CANARY
    }
}

impl Pixel for Vec4 {
    const CANARY: Self = Vec4 { x: 1.5, y: -2.5, z: 3.5, w: -4.5 };
    fn bits(self) -> [u32; 4] {
        self.lanes().map(f32::to_bits)
    }
    fn whole(self) -> bool {
        self.w.to_bits() == 0
    }
}

impl Pixel for Rgba8 {
    const CANARY: Self = [1, 2, 3, 4];
    fn bits(self) -> [u32; 4] {
        self.map(u32::from)
    }
    fn whole(self) -> bool {
        self[3] == 255
    }
}

impl Pixel for F32x3 {
    const CANARY: Self = [1.5, -2.5, 3.5];
    fn bits(self) -> [u32; 4] {
        let [r, g, b] = self.map(f32::to_bits);
        [r, g, b, 0]
    }
}

impl Pixel for Rgb8 {
    // Nothing is of that colour here.
    const CANARY: Self = [251, 3, 117];
    fn bits(self) -> [u32; 4] {
        let [r, g, b] = self.map(u32::from);
        [r, g, b, 0]
    }
}

/// A number that is filled in.
impl Pixel for u32 {
    const CANARY: Self = 7;
    fn bits(self) -> [u32; 4] {
        [self, 0, 0, 0]
    }
}

fn bits<P: Pixel>(pixels: &[P]) -> Vec<[u32; 4]> {
    pixels.iter().map(|pixel| pixel.bits()).collect()
}

/// More pixels than two packets of the widest have.
const COUNTS: Range<usize> = 1..34;
/// More pixels than a packet has, and so every place that a span can begin at.
const MISALIGNED: Range<usize> = 0..17;
/// A row that has room for them.
const WIDTH: usize = 60;

/// Calls a kernel that writes `out` alone, checked, for every number of pixels at every place; then with `out` between
/// guard pages.
fn check_writes<P: Pixel>(
    symbol: &str,
    mut checked: impl FnMut(usize, &mut [P]) -> Result<(), Vec<Fault>>,
    call: impl Fn(usize, &mut [P]),
) {
    for pixels in COUNTS {
        let mut expected = vec![P::CANARY; pixels];
        call(pixels, &mut expected);
        assert!(expected.iter().all(|pixel| pixel.whole()), "{symbol}: {pixels} pixels are not all written");
        for misaligned in MISALIGNED {
            let mut film = [P::CANARY; WIDTH + 20];
            let span = 16 + misaligned..16 + misaligned + pixels;
            let what = format!("{symbol}, {pixels} pixels, {misaligned} off");
            assert_eq!(checked(pixels, &mut film[span.clone()]), Ok(()), "{what}");
            assert_eq!(bits(&film[span.clone()]), bits(&expected), "{what}");
            let canaries = [&film[..span.start], &film[span.end..]].concat();
            assert!(canaries.iter().all(|pixel| pixel.bits() == P::CANARY.bits()), "{what}: writes beside its pixels");
        }
    }
    for side in SIDES {
        let mut films: Vec<_> = COUNTS.map(|pixels| Guarded::new(&vec![P::CANARY; pixels], side).unwrap()).collect();
        // One process for all, and where it dies one for each to see which.
        let whole = |films: &mut [Guarded<P>]| survives(|| films.iter_mut().for_each(|out| call(out.len(), out)));
        if !whole(&mut films).unwrap() {
            let fatal = |film: &mut Guarded<P>| !whole(std::slice::from_mut(film)).unwrap();
            let counts: Vec<_> = films.iter_mut().filter_map(|film| fatal(film).then_some(film.len())).collect();
            panic!("{symbol} touches the guard page {side:?} of this many pixels: {counts:?}");
        }
    }
}

/// Rows of every width and number, with a span anywhere.
fn check_shade_rows<E: Element, P: Pixel>(kernel: &ShadeRows<E, P>, sphere: &LitSphere<E>, rng: &mut Rng) {
    for count in [1, 2, 5] {
        let rows: Vec<_> = (0..COUNTS.end)
            .map(|pixels| {
                let mut rows = Guarded::new(&[LitRows::default()], Side::After).unwrap();
                let width = pixels / count;
                for row in 0..count {
                    // As wide a silhouette as in a plan, where p is above 0 inside of the span.
                    let a = E::from_f64(1e4);
                    rows[0].set_row(row, &LitRow { a, ..kernel_cases::lit_row(Numbers::Ordinary, width, rng) });
                }
                rows
            })
            .collect();
        // Whole rows only; what is left over is a row of its own, of a width of its own.
        let whole = |pixels: usize| pixels.is_multiple_of(count);
        let width = |pixels: usize| if whole(pixels) { pixels / count } else { pixels };
        let rows = |pixels: usize| &rows[if whole(pixels) { pixels } else { 0 }][0];
        for streaming in [false, true] {
            check_writes(
                kernel.symbol(),
                |pixels, out| kernel.call_checked(sphere, rows(pixels), out, width(pixels), streaming),
                |pixels, out| kernel.call(sphere, rows(pixels), out, width(pixels), streaming),
            );
        }
    }
}

/// Any number of rows, the setup and the rows between guard pages.
fn check_row_setup<E: Element>(kernel: &RowSetup<E>, rng: &mut Rng) {
    let mut setup = LitSetup::<f64>::default();
    let fields = [&mut setup.step, &mut setup.columns, &mut setup.cy, &mut setup.k, &mut setup.m, &mut setup.zz];
    fields.into_iter().for_each(|field| *field = f64::from(rng.between(1.0, 2.0)));
    setup.width = 50.0;
    for side in SIDES {
        let setup = Guarded::new(&[setup], side).unwrap();
        let mut rows = Guarded::new(&[LitRows::<E>::default()], side).unwrap();
        for count in 1..=LIT_ROWS {
            assert_eq!(kernel.call_checked(&setup[0], 3, count, &mut rows[0]), Ok(()), "{} {count}", kernel.symbol());
        }
        let alive =
            survives(|| (1..=LIT_ROWS).for_each(|count| kernel.call(&setup[0], 3, count, &mut rows[0]))).unwrap();
        assert!(alive, "{} touches the guard page {side:?}", kernel.symbol());
    }
}

fn check_lit_kernels<E: Element>(kernels: &ElementKernels<E>, rng: &mut Rng) {
    for bodies in [&kernels.lit, &kernels.grey] {
        let sphere = kernel_cases::lit_sphere(Numbers::Ordinary, rng);
        check_shade_rows(&bodies.f32x4, &sphere, rng);
        check_shade_rows(&bodies.f32x4_fast, &sphere, rng);
        check_shade_rows(&bodies.f32x3, &sphere, rng);
        check_shade_rows(&bodies.f32x3_fast, &sphere, rng);
        check_shade_rows(&bodies.rgba8, &sphere, rng);
        check_shade_rows(&bodies.rgb8, &sphere, rng);
    }
    check_row_setup(&kernels.lit_rows, rng);
}

#[test]
fn every_packet_kernel_keeps_the_calling_convention_and_writes_its_own_pixels_alone() {
    let seed = seed();
    for (_, kernels) in packet_kernels() {
        check_lit_kernels(&kernels.single, &mut Rng::new(seed));
        check_lit_kernels(&kernels.double, &mut Rng::new(seed));
        check_fill(&kernels.fill);
        check_narrow(&kernels.narrow_rgb8, |i| [i, i + 1, i + 2, 255], |[r, g, b, _]| [r, g, b]);
        let four = |i: u8| Vec4::new(i.into(), f32::from(i) + 0.5, f32::MAX);
        check_narrow(&kernels.narrow_f32x3, four, |four| [four.x, four.y, four.z]);
    }
}

/// Pixels of four channels, made from numbers, and of three, made from those.
fn check_narrow<Four: Plain, P: Pixel>(kernel: &Narrow<Four, P>, four: impl Fn(u8) -> Four, three: impl Fn(Four) -> P) {
    let four: Vec<_> = (0..COUNTS.end).map(|i| four(i as u8)).collect();
    check_writes(
        kernel.symbol(),
        |_, out| kernel.call_checked(&four[..out.len()], out),
        |_, out| kernel.call(&four[..out.len()], out),
    );
    let mut out = vec![P::CANARY; four.len()];
    kernel.call(&four, &mut out);
    for (four, out) in four.into_iter().zip(out) {
        assert_eq!(out.bits(), three(four).bits(), "{}", kernel.symbol());
    }
    for side in SIDES {
        let four = Guarded::new(&[Four::ZERO; 37], side).unwrap();
        let mut out = [P::CANARY; 37];
        assert!(
            survives(|| kernel.call(&four, &mut out)).unwrap(),
            "{}: the guard page {side:?} is touched",
            kernel.symbol()
        );
    }
}

fn check_fill(fill: &Fill) {
    /// A black of some pixels, and what every one of them is.
    fn check<P: Pixel>(fill: &Fill, black: P, call: impl Fn(&mut [P])) {
        let checked = |_, out: &mut [P]| {
            call(out);
            assert!(out.iter().all(|pixel| pixel.bits() == black.bits()), "{}", fill.symbol());
            Ok(())
        };
        check_writes(fill.symbol(), checked, |_, out: &mut [P]| call(out));
    }
    for streaming in [false, true] {
        for pattern in [0, 0x1234_5678] {
            check_writes(
                fill.symbol(),
                |_, out: &mut [u32]| {
                    let checked = fill.call_checked(out, pattern, streaming);
                    assert!(out.iter().all(|word| *word == pattern), "{}", fill.symbol());
                    checked
                },
                |_, out: &mut [u32]| fill.call(out, pattern, streaming),
            );
        }
        check(fill, Vec4::ZERO, |out| fill.f32x4(out, streaming));
        check(fill, F32x3::ZERO, |out| fill.f32x3(out, streaming));
        check(fill, [0, 0, 0, 255], |out| fill.rgba8(out, streaming));
        check(fill, Rgb8::ZERO, |out| fill.rgb8(out, streaming));
    }
}

/// An `Rgba8` is four bytes, which Rust aligns to one.
#[test]
fn pixels_of_bytes_may_begin_at_any_address() {
    for (_, kernels) in packet_kernels() {
        for (pixels, streaming) in COUNTS.flat_map(|pixels| [false, true].map(|streaming| (pixels, streaming))) {
            for offset in 0..8 {
                let mut bytes = [7; 4 * WIDTH];
                let end = offset + 4 * pixels;
                kernels.fill.rgba8(bytes[offset..end].as_chunks_mut().0, streaming);
                let what = format!("{}: {pixels} pixels at {offset}", kernels.fill.symbol());
                assert!(bytes[offset..end].as_chunks::<4>().0.iter().all(|pixel| *pixel == [0, 0, 0, 255]), "{what}");
                let beside = [&bytes[..offset], &bytes[end..]].concat();
                assert!(beside.iter().all(|byte| *byte == 7), "{what}");
            }
        }
    }
}

/// A film around a tile, in pixels.
const TILE_FILM: (usize, usize) = (70, 34);

/// Shades a window of a tile, checked, into a film of canaries; then with its last pixel flush with a guard page.
fn check_shade_tile<E: Element, P: Pixel>(
    kernel: &ShadeTile<E, P>,
    plan: &Tiles<'_, E>,
    buffers: &TileBuffers<E>,
    shading: ShadingRecords<'_, E>,
    window: &TileWindow,
) {
    let (width, height) = TILE_FILM;
    let (_, rays) = plan.view(TilePlace { across: 0, down: 0 });
    let what = format!("{} of {window:?}", kernel.symbol());
    let (first, rows, columns) = (width + 3, window.rows.len(), window.columns as usize);
    let film = |checked: bool| {
        let mut pixels = vec![P::CANARY; width * height];
        let out = TileOut { pixels: &mut pixels, first, width };
        if checked {
            assert_eq!(kernel.call_checked(&rays, buffers, shading, window, out), Ok(()), "{what}");
        } else {
            kernel.call(&rays, buffers, shading, window, out);
        }
        pixels
    };
    let pixels = film(true);
    assert_eq!(bits(&pixels), bits(&film(false)), "{what}");
    for (i, pixel) in pixels.iter().enumerate() {
        let inside = i >= first && (i - first) / width < rows && (i - first) % width < columns;
        let fine = if inside { pixel.whole() } else { pixel.bits() == P::CANARY.bits() };
        assert!(fine, "{what}: pixel {i}");
    }
    for side in SIDES {
        let mut pixels = Guarded::new(&vec![P::CANARY; (rows - 1) * width + columns], side).unwrap();
        let out = |pixels| TileOut { pixels, first: 0, width };
        let alive = survives(|| kernel.call(&rays, buffers, shading, window, out(&mut pixels))).unwrap();
        assert!(alive, "{what} touches the guard page {side:?}");
    }
}

fn check_tiles<E: Element>(packets: &'static PacketKernels, kernels: &ElementKernels<E>, seed: u64) {
    let (kernels, lanes) = (&kernels.tiles, kernels.lanes);
    for (count, lights) in [(1, 1), (2, 0), (3, 2), (63, 1), (64, 2)] {
        let camera = scene::Camera::new(64, 32, 1.0, 1.0).unwrap();
        let mut scene = scene::Scene { camera, ..scene::many(count, count, seed) };
        scene.lights.truncate(lights);
        let plan = Tiles::<E>::new(&scene, Raster::of(&scene.camera)[0], packets, Keep::NOTHING, 1);
        let (view, _) = plan.view(TilePlace { across: 0, down: 0 });
        let ids: Vec<_> = (0..count as u32).collect();
        let mut candidates = vec![Candidate::default(); count.next_multiple_of(CHUNK)];
        let view_of_all = bounds_view(64, 32);
        packets.bounds.call(&view_of_all, TriangleList::Apart(&scene.triangles), 0, true, &mut candidates).unwrap();
        let (vertices, corners, colours) = joined(&scene.triangles);
        let view_of_spheres = &plan.levels().spheres;
        // Everyone as seen anywhere but for what is found of the spheres by their own kernel.
        let mut seen_spheres = vec![Candidate::default(); count.next_multiple_of(CHUNK)];
        packets.sphere_bounds.call(view_of_spheres, plan.spheres(), 0, true, &mut seen_spheres).unwrap();
        let order: Vec<_> = (0..=2 * count as u32).collect();
        let grid = plan.grid();
        for (side, shared) in SIDES.into_iter().flat_map(|side| [(side, false), (side, true)]) {
            // What is read lies between guard pages; the plan's copies are the scene's own.
            let apart = Guarded::new(&scene.triangles, side).unwrap();
            let (vertices, corners) = (Guarded::new(&vertices, side).unwrap(), Guarded::new(&corners, side).unwrap());
            let joined = FacePart::new(&vertices, &corners, &colours);
            let triangles = if shared { TriangleList::Joined(joined) } else { TriangleList::Apart(&apart) };
            let spheres = Guarded::new(plan.spheres(), side).unwrap();
            let ids = Guarded::new(&ids, side).unwrap();
            let candidates = Guarded::new(&candidates[..count], side).unwrap();
            let seen_spheres = Guarded::new(&seen_spheres[..count], side).unwrap();
            let lights_of_spheres = Guarded::new(plan.sphere_lights(), side).unwrap();
            let lights = Guarded::new(&plan.levels().lights, side).unwrap();
            let order = Guarded::new(&order, side).unwrap();
            let triangles = TriangleChunk { triangles, lights: &lights, candidates: &candidates, first_id: 1 + count };
            let spheres = SphereChunk { spheres: &spheres, candidates: &seen_spheres };
            let records = |short: bool| {
                let (mut checked, mut unchecked) = (SphereRecords::<E>::default(), SphereRecords::<E>::default());
                let shading = &kernels.sphere_shading;
                let kept = shading.call_checked(view_of_spheres, spheres, &lights_of_spheres, short, 0, &mut checked);
                assert_eq!(kept, Ok(()), "{}, {count} spheres", shading.symbol());
                let alive = survives(|| {
                    let mut records = SphereRecords::<E>::default();
                    shading.call(view_of_spheres, spheres, &lights_of_spheres, short, 0, &mut records);
                });
                assert!(alive.unwrap(), "{}, {count} spheres: the guard page {side:?} is touched", shading.symbol());
                shading.call(view_of_spheres, spheres, &lights_of_spheres, short, 0, &mut unchecked);
                // What is past the last is nobody's.
                for records in [&mut checked, &mut unchecked] {
                    records.spheres.truncate(count);
                    records.lits.truncate(count * lights_of_spheres.len());
                    records.shorts.truncate(count * lights_of_spheres.len());
                }
                assert!(checked == unchecked, "{}, {count} spheres", shading.symbol());
                checked
            };
            let long = records(false);
            assert!(long.spheres.iter().all(|sphere| sphere.short == E::ZERO));
            let records = records(true);
            let ball = scene::Sphere { radius: 2.0, colour: Vec3::ONE, centre: Vec3::Z };
            let inside = Guarded::new(&[plan.around(&ball).unwrap()], side).unwrap();
            for window in [(64, 0..32), (1, 0..1), (37, 3..5), (64, 31..32), (63, 1..30)] {
                let window = TileWindow { column: 0, row: 0, columns: window.0, rows: window.1 };
                let (mut checked, mut unchecked) = (TileBuffers::default(), TileBuffers::default());
                let shades = || vec![TileShade::<E>::default(); (1 + count) * lights.len()];
                let (mut of_checked, mut of_unchecked) = (shades(), shades());
                let alive = survives(|| {
                    let (mut buffers, mut shades) = (TileBuffers::default(), shades());
                    kernels.sphere_set_up.call(view_of_spheres, spheres, 1, &mut buffers);
                    kernels.nearest_spheres.call(&mut buffers, &order, &window, &grid, 1);
                    kernels.set_up.call(&view, triangles, &mut buffers, &mut shades);
                    kernels.nearest_triangles.call(&mut buffers, &order, &window, &grid, 1);
                });
                let what = format!("{}, {count} of a kind, {window:?}", kernels.set_up.symbol());
                assert!(alive.unwrap(), "{what}: the guard page {side:?} is touched");
                let kept = kernels.sphere_set_up.call_checked(view_of_spheres, spheres, 1, &mut checked);
                assert_eq!(kept, Ok(()), "{what}");
                let kept = kernels.nearest_spheres.call_checked(&mut checked, &order, &window, &grid, 1);
                assert_eq!(kept, Ok(()), "{what}");
                let kept = kernels.set_up.call_checked(&view, triangles, &mut checked, &mut of_checked);
                assert_eq!(kept, Ok(()), "{what}");
                let kept = kernels.nearest_triangles.call_checked(&mut checked, &order, &window, &grid, 1);
                assert_eq!(kept, Ok(()), "{what}");
                kernels.sphere_set_up.call(view_of_spheres, spheres, 1, &mut unchecked);
                kernels.nearest_spheres.call(&mut unchecked, &order, &window, &grid, 1);
                kernels.set_up.call(&view, triangles, &mut unchecked, &mut of_unchecked);
                kernels.nearest_triangles.call(&mut unchecked, &order, &window, &grid, 1);
                assert!(of_checked == of_unchecked, "{what}");
                // Corners that are shared are the same corners.
                let (mut buffers, mut of_apart) = (TileBuffers::default(), shades());
                let apart = TriangleChunk { triangles: TriangleList::Apart(&apart), ..triangles };
                kernels.set_up.call(&view, apart, &mut buffers, &mut of_apart);
                let set_up = (1 + count) * lights.len();
                assert!(of_checked[..set_up] == of_apart[..set_up], "{what}");
                let all = || (0..32).flat_map(|row| (0..64).map(move |column| (column, row)));
                let of = |buffers: &TileBuffers<E>| all().map(|(x, y)| buffers.pixel(4, x, y)).collect::<Vec<_>>();
                assert!(of(&checked) == of(&unchecked), "{what}");
                assert_eq!(kernels.farthest.call_checked(&checked), Ok(()), "{what}");
                let mut around = TileBuffers::default();
                assert_eq!(kernels.around.call_checked(&inside[0], &window, &mut around, &order), Ok(()), "{what}");
                let alive = survives(|| kernels.around.call(&inside[0], &window, &mut TileBuffers::default(), &order));
                assert!(alive.unwrap() && around.has_somebody(), "{what}");
                for (part, farthest) in kernels.farthest.call(&checked).into_iter().enumerate() {
                    let (left, top) = (part % (64 / PART_SIDE) * PART_SIDE, part / (64 / PART_SIDE) * PART_SIDE);
                    let pixels = (0..PART_SIDE * PART_SIDE).map(|i| (left + i % PART_SIDE, top + i / PART_SIDE));
                    let near = pixels.map(|(column, row)| checked.pixel(lanes, column, row).0.to_f64());
                    assert_eq!(Some(farthest.to_f64()), near.min_by(f64::total_cmp), "{what}");
                }
                let shading = ShadingRecords {
                    shades: &of_checked,
                    lights: plan.points(),
                    sphere_ids: &ids,
                    spheres: &records.spheres,
                    lits: &records.lits,
                    shorts: &records.shorts,
                };
                check_shade_tile(&kernels.f32x4, &plan, &checked, shading, &window);
                check_shade_tile(&kernels.f32x4_fast, &plan, &checked, shading, &window);
                check_shade_tile(&kernels.rgba8, &plan, &checked, shading, &window);
            }
        }
    }
}

#[test]
fn every_tile_kernel_keeps_the_calling_convention_and_writes_its_own_pixels_alone() {
    let seed = seed();
    for (_, kernels, twins) in twins() {
        check_tiles(kernels, &kernels.single, seed);
        check_tiles(kernels, &kernels.double, seed);
        check_bounds(kernels, seed);
        check_sphere_bounds(kernels, seed);
        check_nearer_half(kernels, twins, seed);
        check_visible(kernels, twins, seed);
    }
}

/// Cuts in two what lies between guard pages, checked and not, and holds the halves against their twin.
fn check_nearer_half(kernels: &PacketKernels, twins: &PacketKernels, seed: u64) {
    let kernel = &kernels.nearer_half;
    let mut rng = Rng::new(seed);
    for count in [1, 2, 3, 17, 64, 200] {
        let mut near = || match rng.next_u64() % 8 {
            0 => f32::MAX,
            1 => 0.0,
            _ => rng.between(0.5, 2.0),
        };
        let candidates = |id| Candidate { id, columns: !id, rows: u32::MAX, most: near() };
        let candidates: Vec<_> = (0..count as u32).map(candidates).collect();
        let (mut nearer, mut farther) = (candidates.clone(), candidates.clone());
        let near = twins.nearer_half.call(&candidates, &mut nearer, &mut farther);
        nearer.truncate(near);
        farther.truncate(count - near);
        let what = format!("{} of {count}", kernel.symbol());
        for side in SIDES {
            let candidates = Guarded::new(&candidates, side).unwrap();
            let room = || Guarded::new(&vec![Candidate::default(); count], side).unwrap();
            let (mut first, mut second) = (room(), room());
            let alive = survives(|| _ = kernel.call(&candidates, &mut first, &mut second)).unwrap();
            assert!(alive, "{what}: the guard page {side:?} is touched");
            assert_eq!(kernel.call_checked(&candidates, &mut first, &mut second), Ok(()), "{what}");
            assert_eq!(kernel.call(&candidates, &mut first, &mut second), nearer.len(), "{what}");
            assert_eq!((&first[..nearer.len()], &second[..farther.len()]), (&*nearer, &*farther), "{what}");
        }
    }
}

/// Looks for the visible among what lies between guard pages, checked and not, and holds them against their twin.
fn check_visible(kernels: &PacketKernels, twins: &PacketKernels, seed: u64) {
    let kernel = &kernels.visible;
    let mut rng = Rng::new(seed);
    for (count, rows) in [1_usize, 2, 3, 16, 17, 200].into_iter().flat_map(|count| [(count, 0..32), (count, 9..11)]) {
        let window = TileWindow { column: 128, row: 64, columns: if count == 17 { 5 } else { 64 }, rows };
        let mut from = |numbers: Range<u32>| numbers.start + rng.next_u64() as u32 % numbers.len() as u32;
        let farthest: [f32; TILE_PARTS] = std::array::from_fn(|_| from(0..4) as f32);
        // Most are small; one may be beside the tile, and so nowhere in it.
        let mut bounds = |first: u32| {
            let start = from(first - 20..first + 80);
            start | (start + from(1..20) * [1, 1, 1, 4][from(0..4) as usize]) << 16
        };
        let mut candidates: Vec<_> =
            (0..count as u32).map(|id| Candidate { id, columns: bounds(128), rows: bounds(64), most: 0.0 }).collect();
        candidates
            .iter_mut()
            .for_each(|candidate| candidate.most = [0.0, 0.5, 1.0, 1.5, f32::MAX][from(0..5) as usize]);
        let mut visible = candidates.clone();
        visible.resize(count.next_multiple_of(16), Candidate::default());
        let left = twins.visible.call(&mut visible, count, &Parts::new(farthest), &window);
        visible.truncate(left);
        let what = format!("{} of {count}, {window:?}", kernel.symbol());
        for guarded in SIDES {
            let parts = Parts::new(farthest);
            let mut room = candidates.clone();
            room.resize(count.next_multiple_of(16), Candidate::default());
            let room = || Guarded::new(&room, guarded).unwrap();
            let (mut in_child, mut checked, mut unchecked) = (room(), room(), room());
            let alive = survives(|| _ = kernel.call(&mut in_child, count, &parts, &window)).unwrap();
            assert!(alive, "{what}: the guard page {guarded:?} is touched");
            assert_eq!(kernel.call_checked(&mut checked, count, &parts, &window), Ok(()), "{what}");
            let left = kernel.call(&mut unchecked, count, &parts, &window);
            assert_eq!(unchecked[..left], visible, "{what}");
        }
    }
}

fn check_sphere_bounds(kernels: &PacketKernels, seed: u64) {
    let (width, height) = (64.0, 32.0);
    let view = SphereView {
        step: 1.0 / 64.0,
        half_width: 0.5,
        half_height: 0.25,
        focal: 1.0,
        scale: 1.0,
        width,
        height,
        most: 1.0,
        far: 1e10,
        white: 1.0,
    };
    for count in [1, 2, 3, 5, 63, 64, 65, 200] {
        let mut scene = scene::many(count, 0, seed);
        scene.spheres.iter_mut().skip(3).step_by(5).for_each(|sphere| sphere.centre.z = -sphere.centre.z);
        scene.spheres.iter_mut().skip(4).step_by(7).for_each(|sphere| sphere.centre.z = 0.1);
        for (side, keep_all) in SIDES.into_iter().flat_map(|side| [(side, false), (side, true)]) {
            let spheres = Guarded::new(&scene.spheres, side).unwrap();
            let candidates = || vec![Candidate { id: 7, ..Candidate::default() }; count.next_multiple_of(CHUNK)];
            let (mut checked, mut unchecked) = (candidates(), candidates());
            let kernel = &kernels.sphere_bounds;
            let what = format!("{} of {count}", kernel.symbol());
            let mut room = Guarded::new(&candidates(), side).unwrap();
            let alive = survives(|| _ = kernel.call(&view, &spheres, 5, keep_all, &mut room)).unwrap();
            assert!(alive, "{what}: the guard page {side:?} is touched");
            assert_eq!(kernel.call_checked(&view, &spheres, 5, keep_all, &mut checked), Ok(()), "{what}");
            let (found, extremes) = kernel.call(&view, &spheres, 5, keep_all, &mut unchecked).unwrap();
            assert_eq!(checked[..found], unchecked[..found], "{what}");
            let radii = || spheres.iter().map(|sphere| sphere.radius);
            let most =
                spheres.iter().map(|sphere| sphere.centre.abs().max_element()).chain(radii()).fold(0.0, f32::max);
            let brightest = spheres.iter().map(|sphere| sphere.colour.max_element()).fold(0.0, f32::max);
            let least = radii().fold(f32::MAX, f32::min);
            let nearest = extremes.nearest;
            let longest = 0.0;
            assert_eq!(extremes, Extremes { most, least, brightest, nearest, longest }, "{what}");
            // What is kept although it is behind the camera is not counted.
            let nears = checked[..found].iter().map(|candidate| candidate.most);
            assert!(keep_all || nears.fold(0.0, f32::max) <= nearest, "{what}");
            assert!(keep_all == (found == count) || count < 4, "{what}: {found}");
        }
    }
}

/// How bounds are found in a picture of this size.
fn bounds_view(width: u32, height: u32) -> BoundsView<f32> {
    let (width, height) = (width as f32, height as f32);
    BoundsView {
        to_pixels: 1.25 * width,
        column: 0.5 * width - 0.5,
        row: 0.5 * height - 0.5,
        low: 0.99,
        high: 1.01,
        width,
        height,
        most: 1.0,
        all_columns: f32::from_bits((width as u32) << 16),
        all_rows: f32::from_bits((height as u32) << 16),
        reach: 1.96,
        outside: -0.13,
    }
}

/// The same triangles as faces, none of which happen to share a corner: their vertices and one more, which may be anything,
/// the corners and the colours.
fn joined(triangles: &[Triangle]) -> (Vec<Vec3>, Vec<[u32; 3]>, Vec<ColourRun>) {
    let vertices = triangles.iter().flat_map(|triangle| triangle.vertices).chain([Vec3::NAN]);
    let corners = (0..triangles.len() as u32).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]);
    let colours = (1..).zip(triangles).map(|(end, triangle)| (end, triangle.colour));
    (vertices.collect(), corners.collect(), colours.collect())
}

fn check_bounds(kernels: &PacketKernels, seed: u64) {
    let view = bounds_view(64, 32);
    for count in [1, 2, 3, 5, 63, 64, 65, 200] {
        let scene = scene::many(0, count, seed);
        let (vertices, corners, colours) = joined(&scene.triangles);
        let ways = SIDES.into_iter().flat_map(|side| [(side, false), (side, true)]);
        for ((side, keep_all), shared) in ways.flat_map(|way| [(way, false), (way, true)]) {
            let triangles = Guarded::new(&scene.triangles, side).unwrap();
            let (vertices, corners) = (Guarded::new(&vertices, side).unwrap(), Guarded::new(&corners, side).unwrap());
            let joined = FacePart::new(&vertices, &corners, &colours);
            let list = if shared { TriangleList::Joined(joined) } else { TriangleList::Apart(&triangles) };
            let candidates = || vec![Candidate { id: 7, ..Candidate::default() }; count.next_multiple_of(CHUNK)];
            let (mut checked, mut unchecked) = (candidates(), candidates());
            let what = format!("{} of {count}", kernels.bounds.symbol());
            let mut room = Guarded::new(&candidates(), side).unwrap();
            let alive = survives(|| _ = kernels.bounds.call(&view, list, 5, keep_all, &mut room)).unwrap();
            assert!(alive, "{what}: the guard page {side:?} is touched");
            assert_eq!(kernels.bounds.call_checked(&view, list, 5, keep_all, &mut checked), Ok(()), "{what}");
            let (found, extremes) = kernels.bounds.call(&view, list, 5, keep_all, &mut unchecked).unwrap();
            assert_eq!(checked[..found], unchecked[..found], "{what}");
            let sizes = triangles.iter().map(|triangle| triangle.vertices.map(|v| v.abs().max_element()));
            let sizes: Vec<_> = sizes.map(|[a, b, c]| a.max(b).max(c)).collect();
            let brightest = triangles.iter().map(|triangle| triangle.colour.max_element()).fold(0.0, f32::max);
            let (most, least) =
                (sizes.iter().copied().fold(0.0, f32::max), sizes.iter().copied().fold(f32::MAX, f32::min));
            let nearest = extremes.nearest;
            let longest = extremes.longest;
            assert_eq!(extremes, Extremes { most, least, brightest, nearest, longest }, "{what}");
            // What is kept although it is behind the camera is not counted.
            let nears = checked[..found].iter().map(|candidate| candidate.most);
            assert!(keep_all || nears.fold(0.0, f32::max) <= nearest, "{what}");
            let side = |bounds: u32| (bounds >> 16).saturating_sub(bounds & 0xffff);
            let sides = checked[..found].iter().map(|candidate| [side(candidate.columns), side(candidate.rows)]);
            let sides = sides.filter(|sides| !sides.contains(&0)).flatten();
            assert_eq!(longest, sides.max().unwrap_or(0) as f32, "{what}");
            // Every corner's own pixel is within the bounds, and what is not seen has no pixel.
            let mut of = checked[..found].iter().peekable();
            for (id, triangle) in (5..).zip(triangles.iter()) {
                let corners = triangle.vertices.map(|v| (31.5 + 80.0 * v.x / v.z, 15.5 - 80.0 * v.y / v.z));
                let Some(candidate) = of.next_if(|candidate| candidate.id == id) else {
                    assert!(!keep_all && !holds_a_pixel(corners), "{what}: {id} is left out");
                    continue;
                };
                for (x, y) in corners {
                    let within = |at: f32, bounds: u32, side: f32| {
                        at < 0.0
                            || at > side
                            || (bounds & 0xffff) as f32 <= at.ceil() && at.floor() < (bounds >> 16) as f32
                    };
                    let seen_nowhere = (candidate.columns & 0xffff) >= (candidate.columns >> 16);
                    let inside = within(x, candidate.columns, 63.0) && within(y, candidate.rows, 31.0);
                    assert!(inside || keep_all && seen_nowhere, "{what}: {x} {y}");
                }
            }
            assert_eq!(of.next(), None, "{what}");
        }
    }
}

/// Whether the centre of a pixel of 64 x 32 is within a triangle.
fn holds_a_pixel(corners: [(f32, f32); 3]) -> bool {
    let [a, b, c] = corners;
    let side =
        |(ax, ay): (f32, f32), (bx, by): (f32, f32), (x, y): (f32, f32)| (ax - x) * (by - y) - (ay - y) * (bx - x);
    let pixels = (0..32).flat_map(|row| (0..64).map(move |column| (column as f32, row as f32)));
    pixels.into_iter().any(|p| {
        let edges = [side(a, b, p), side(b, c, p), side(c, a, p)];
        edges.iter().all(|edge| *edge > 1e-3) || edges.iter().all(|edge| *edge < -1e-3)
    })
}
