//! Algorithm 1 of the paper with a ray in each lane, where each ray is tested against every object:
//! asm/tracers/lanes.asm.

use std::iter::repeat_n;
use std::ops::Range;

use super::isa::Isa;
use super::kernel::{Callee, function, kernel, kinds, reads, writes};
use super::records::{LaneLists, ObjectLight, SphereHit, TriangleHit};
use super::types::{Frame, Vec4};

/// A cache line of numbers; every record begins with one.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct CacheLine([f32; 16]);

/// The records of objects of one kind.
#[derive(Clone, Debug, Default)]
struct Records {
    lines: Vec<CacheLine>,
    /// The number of lines in a record.
    each: usize,
}

impl Records {
    fn push(&mut self, numbers: impl Iterator<Item = f32>) {
        let (numbers, before) = (numbers.collect::<Vec<_>>(), self.lines.len());
        for line in numbers.chunks(16) {
            self.lines.push(CacheLine([0.0; 16]));
            self.lines.last_mut().expect("the line just made").0[..line.len()].copy_from_slice(line);
        }
        self.each = self.lines.len() - before;
    }
}

/// Objects as a [`LaneTracer`] reads them.
#[derive(Clone, Debug)]
pub struct LaneObjects {
    /// How many copies of each number a hit's record has.
    spread: usize,
    lights: usize,
    spheres: Records,
    triangles: Records,
}

impl LaneObjects {
    fn numbers(&self, hit: Vec<f32>, more: &[f32], lights: &[ObjectLight<f32>]) -> impl Iterator<Item = f32> + use<> {
        assert_eq!(lights.len(), self.lights, "every object has the same number of lights");
        let spread = self.spread;
        let lights = lights.iter().flat_map(ObjectLight::numbers).collect::<Vec<_>>();
        hit.into_iter().flat_map(move |number| repeat_n(number, spread)).chain(more.to_vec()).chain(lights)
    }

    /// Adds a sphere with its centre and 1 / radius. The lights are relative to the centre, in
    /// radii.
    ///
    /// # Panics
    /// If it does not have the same number of lights as the other objects.
    pub fn sphere(&mut self, hit: &SphereHit<f32>, centre_and_scale: [f32; 4], lights: &[ObjectLight<f32>]) {
        self.spheres.push(self.numbers(hit.numbers(), &centre_and_scale, lights));
    }

    /// Adds a triangle. The lights are relative to the camera.
    ///
    /// # Panics
    /// If it does not have the same number of lights as the other objects.
    pub fn triangle(&mut self, hit: &TriangleHit<f32>, lights: &[ObjectLight<f32>]) {
        self.triangles.push(self.numbers(hit.numbers(), &[], lights));
    }
}

kinds! {
    /// Algorithm 1 over whole rows of an image.
    RowsInLanes

    /// Writes `rows` of the image to `out`, row by row.
    ///
    /// # Panics
    /// If `out` does not have `frame.width` times the number of rows pixels.
    fn call(frame: &Frame, objects: &LaneObjects, rows: Range<u32>, out: &mut [Vec4]); |way| {
        let Callee::Code(enter) = way;
        let pixels = u128::from(frame.width) * rows.len() as u128;
        assert_eq!(out.len() as u128, pixels, "the buffer must have the size of the rows");
        if pixels > 0 {
            let bytes = |lines: usize| (lines * size_of::<CacheLine>()) as u64;
            let LaneObjects { lights, spheres, triangles, .. } = objects;
            // All records of a list have the same size and hold what the kernel reads; lines of 64
            // bytes keep them aligned. There is at least one row and one column, and `out` has room
            // for each pixel.
            let lists = LaneLists {
                spheres: reads(&*spheres.lines),
                spheres_bytes: bytes(spheres.lines.len()),
                sphere_bytes: bytes(spheres.each),
                triangles: reads(&*triangles.lines),
                triangles_bytes: bytes(triangles.lines.len()),
                triangle_bytes: bytes(triangles.each),
                lights_bytes: (lights * size_of::<ObjectLight<f32>>()) as u64,
            };
            enter([reads(frame), reads(&lists), rows.start.into(), rows.end.into(), writes(out), 0]);
        }
    }
}

/// The tracer for an ISA.
pub struct LaneTracer {
    spread: usize,
    kernel: RowsInLanes,
}

/// The tracers for each [`Isa`]. In AVX-512 memory operands broadcast, so that one copy of a number
/// suffices.
static TRACERS: [LaneTracer; Isa::ALL.len()] = [
    LaneTracer { spread: 4, kernel: kernel!("rayo_sse41_single_lanes") },
    LaneTracer { spread: 8, kernel: kernel!("rayo_avx2_single_lanes") },
    LaneTracer { spread: 1, kernel: kernel!("rayo_avx512_single_lanes") },
];

/// The tracer of an ISA. None if the CPU or the operating system does not support it.
pub fn lane_tracer(isa: Isa) -> Option<&'static LaneTracer> {
    isa.usable().then(|| &TRACERS[isa as usize])
}

/// The symbols of all tracers, whether or not this CPU supports them.
pub fn lane_symbols() -> [&'static str; Isa::ALL.len()] {
    Isa::ALL.map(|isa| TRACERS[isa as usize].kernel.symbol())
}

impl LaneTracer {
    /// An empty list of objects, each of which will have `lights` lights.
    pub fn objects(&self, lights: usize) -> LaneObjects {
        LaneObjects { spread: self.spread, lights, spheres: Records::default(), triangles: Records::default() }
    }

    /// Traces as [`RowsInLanes::call`] does.
    ///
    /// # Panics
    /// As [`RowsInLanes::call`]; and if `objects` were made by another tracer.
    pub fn call(&self, frame: &Frame, objects: &LaneObjects, rows: Range<u32>, out: &mut [Vec4]) {
        assert_eq!(objects.spread, self.spread, "the objects are those of a tracer with other lanes");
        self.kernel.call(frame, objects, rows, out);
    }
}
