//! The paper's kernels in checked calls and between guard pages; and kernels that break the rules,
//! to show that the checks notice.
//!
//! The packet kernels are tested so in packets.rs.

// What accesses foreign memory runs in a process of its own.
#![allow(unsafe_code)]

use std::fmt::Debug;
use std::ops::Range;

use crate::kernel_cases::{self, Input, implementations, packet_kernels, seed};
use rayo::internals::kernels::fences::{self, Side};
use rayo::internals::kernels::harness::{self, BROKEN, faults, without_denormals};
use rayo::internals::kernels::{
    Candidate, Fault, Frame, Light, Objects, PaperSphere, PaperTriangle, Plain, Surface, Vec4, hits_of_c, hits_of_paper,
};
use rayo::internals::scene::Rng;
use rayo_lab::experiments::check;

/// Whether the call returns, in a forked process.
pub(crate) fn survives(call: impl FnOnce()) -> std::io::Result<bool> {
    // SAFETY: kernels only compute.
    unsafe { harness::survives(call) }
}

/// Scenes with lists of different lengths, including 0.
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

/// A frame whose view is at least 90 degrees wide.
fn frame(width: u64, height: u32) -> Frame {
    let step = 2.0 / width as f32;
    Frame { step, half_width: 1.0, half_height: step * height as f32 / 2.0, focal: 1.0, width, ..Frame::ZERO }
}

/// Calls a tracer of scenes with all of its memory adjacent to guard pages: in a forked process,
/// then checked, then again.
fn trace_fenced<P: Plain + Debug + PartialEq>(
    what: &str,
    canary: P,
    trace: impl Fn(&Frame, Objects<'_>, Range<u32>, &mut [P]),
) {
    for (side, (lights, spheres, triangles)) in
        Side::ALL.into_iter().flat_map(|side| scenes().into_iter().map(move |s| (side, s)))
    {
        let lights = fences::copy(&lights, side);
        let spheres = fences::copy(&spheres, side);
        let triangles = fences::copy(&triangles, side);
        let objects = Objects { lights: &lights, spheres: &spheres, triangles: &triangles };
        for (width, rows) in [(1, 0..1), (3, 1..3), (16, 0..2), (33, 2..5), (64, 0..2)] {
            let frame = fences::copy(&[frame(width, rows.end)], side);
            let mut film = fences::copy(&vec![canary; width as usize * rows.len()], side);
            let what = format!("{what}, {width} wide, rows {rows:?}, the guard page {side:?}, {objects:?}");
            let mut fenced = || trace(&frame[0], objects, rows.clone(), &mut film);
            assert!(survives(&mut fenced).unwrap(), "touches the guard page: {what}");
            let mut checked = vec![canary; width as usize * rows.len()];
            assert_eq!(faults(|| trace(&frame[0], objects, rows.clone(), &mut checked)), [], "{what}");
            fenced();
            // Unwritten elements are NaN, which equals nothing, so that the assertion fails.
            assert_eq!(film[..], checked[..], "{what}");
        }
    }
}

#[test]
fn tracers_keep_to_the_convention_and_their_memory() {
    let nan = Vec4::from([f32::NAN; 4]);
    for hits in [hits_of_c(), hits_of_paper()].into_iter().flatten() {
        trace_fenced("hits", Surface { point: nan, ..Surface::ZERO }, |frame, of, rows, out| {
            hits.call(frame, of, rows, out);
        });
    }
    for (name, kernels) in implementations() {
        trace_fenced(name, nan, |frame, of, rows, out| kernels.trace.call(frame, of, rows, out));
    }
}

#[test]
fn broken_kernels_are_caught_with_the_rule_they_break() {
    let rules: Vec<_> = BROKEN.iter().map(|broken| broken.breaks).collect();
    assert_eq!(rules, Fault::ALL, "there is a broken kernel for every rule");
    let Some(paper) = rayo::internals::kernels::paper() else { return };
    for broken in BROKEN.iter().filter(|broken| broken.usable()) {
        assert_eq!(broken.faults(), [broken.breaks]);
        // The checked call repairs what a kernel breaks, so that it does not affect the next one.
        let mut sum = Vec4::default();
        let one = Vec4::new(1.0, 1.0, 1.0);
        assert_eq!(faults(|| paper.add.call_into(&mut sum, &one, &one)), [], "after {:?}", broken.breaks);
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
    // The results of a kernel are returned.
    let far = Candidate { most: 1.0, ..Candidate::default() };
    let near = Candidate { most: 2.0, ..Candidate::default() };
    for (isa, kernels) in packet_kernels() {
        let (mut nearer, mut farther) = ([Candidate::default(); 3], [Candidate::default(); 3]);
        let count = without_denormals(|| kernels.nearer_half.call(&[near, far, near], &mut nearer, &mut farther));
        assert_eq!((count, nearer[0], farther[0]), (2, near, far), "{isa}");
    }
}

#[test]
fn no_operation_touches_memory_beside_its_arguments() {
    let mut rng = Rng::new(seed());
    for (implementation, kernels) in implementations() {
        for (name, op) in kernels.ops() {
            for (side, case) in Side::ALL.into_iter().flat_map(|side| [(side, 0), (side, 1), (side, 2), (side, 3)]) {
                let input = Input::aimed(op, &mut rng);
                let fenced = || fences::within(side, || check::call(op, &input));
                let what = format!("{implementation} {name}, the guard page {side:?}, case {case}: {input:?}");
                assert!(survives(|| _ = fenced()).unwrap(), "touches the guard page: {what}");
                assert_eq!(fenced(), check::call(op, &input), "{what}");
            }
        }
    }
}

#[test]
fn guard_pages_fault_exactly_beyond_the_values() {
    let values = [Vec4::new(1.0, 2.0, 3.0); 3];
    for (side, beyond) in [(Side::Before, -1), (Side::After, 3)] {
        let mut guarded = fences::copy(&values, side);
        assert_eq!(guarded, values);
        let first = guarded.as_mut_ptr();
        for index in [0, 1, 2, beyond] {
            let at = first.wrapping_offset(index);
            // SAFETY: within the values, or in a process of its own that is to fault.
            let read = survives(|| _ = unsafe { at.read_volatile() }).unwrap();
            // SAFETY: as above.
            let written = survives(|| unsafe { at.write_volatile(values[0]) }).unwrap();
            assert_eq!([read, written], [index != beyond; 2], "{side:?}, {index}");
        }
    }
}
