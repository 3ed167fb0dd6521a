//! Algorithm 1 of the paper with a ray in each lane, tested against every object:
//! asm/tracers/lanes.asm.

use std::iter::repeat_n;
use std::ops::Range;

use super::isa::Isa;
use super::kernel::{Way, function, kernel, kinds, reads, writes};
use super::records::{LaneLists, ObjectLight, SphereHit, TriangleHit};
use super::types::{Frame, Vec4};

/// A line of a record: no record begins within one.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Line([f32; 16]);

/// The records of objects of one kind.
#[derive(Clone, Debug, Default)]
struct Records {
    lines: Vec<Line>,
    /// Lines of one.
    each: usize,
}

impl Records {
    fn push(&mut self, numbers: impl Iterator<Item = f32>) {
        let (numbers, before) = (numbers.collect::<Vec<_>>(), self.lines.len());
        for line in numbers.chunks(16) {
            self.lines.push(Line([0.0; 16]));
            self.lines.last_mut().expect("the line just made").0[..line.len()].copy_from_slice(line);
        }
        self.each = self.lines.len() - before;
    }
}

/// Objects as a [`LaneTracer`] reads them.
#[derive(Clone, Debug)]
pub struct LaneObjects {
    /// How often each number of a hit's record is there.
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

    /// Adds a sphere with this centre, and 1 / radius; lights are in radii from the centre.
    ///
    /// # Panics
    /// If it has not as many lights as the others.
    pub fn sphere(&mut self, hit: &SphereHit<f32>, centre_and_scale: [f32; 4], lights: &[ObjectLight<f32>]) {
        self.spheres.push(self.numbers(hit.numbers(), &centre_and_scale, lights));
    }

    /// Adds a triangle; lights are from the camera.
    ///
    /// # Panics
    /// If it has not as many lights as the others.
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
    /// If `out` is not `frame.width` x the number of rows long.
    fn call(frame: &Frame, objects: &LaneObjects, rows: Range<u32>, out: &mut [Vec4]); |way| {
        let Way::Code(enter) = way;
        let pixels = u128::from(frame.width) * rows.len() as u128;
        assert_eq!(out.len() as u128, pixels, "the buffer must have the size of the rows");
        if pixels > 0 {
            let bytes = |lines: usize| (lines * size_of::<Line>()) as u64;
            let LaneObjects { lights, spheres, triangles, .. } = objects;
            // All records of a list are of one size and hold what the kernel reads of each; with
            // lines of 64 bytes they are aligned. There is a row, a column, and in `out` the place
            // of each pixel.
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

/// The tracer of an ISA.
pub struct LaneTracer {
    spread: usize,
    kernel: RowsInLanes,
}

/// By [`Isa`]: operands of AVX-512 broadcast.
static TRACERS: [LaneTracer; Isa::ALL.len()] = [
    LaneTracer { spread: 4, kernel: kernel!("rayo_sse41_single_lanes") },
    LaneTracer { spread: 8, kernel: kernel!("rayo_avx2_single_lanes") },
    LaneTracer { spread: 1, kernel: kernel!("rayo_avx512_single_lanes") },
];

/// The tracer of an ISA. None if the CPU or the operating system does not support it.
pub fn lane_tracer(isa: Isa) -> Option<&'static LaneTracer> {
    isa.usable().then(|| &TRACERS[isa as usize])
}

/// The symbols of all of them, whether this CPU supports them or not.
pub fn lane_symbols() -> [&'static str; Isa::ALL.len()] {
    Isa::ALL.map(|isa| TRACERS[isa as usize].kernel.symbol())
}

impl LaneTracer {
    /// No objects yet, each of which will have so many lights.
    pub fn objects(&self, lights: usize) -> LaneObjects {
        LaneObjects { spread: self.spread, lights, spheres: Records::default(), triangles: Records::default() }
    }

    /// As [`RowsInLanes::call`].
    ///
    /// # Panics
    /// As that; if `objects` are another tracer's.
    pub fn call(&self, frame: &Frame, objects: &LaneObjects, rows: Range<u32>, out: &mut [Vec4]) {
        assert_eq!(objects.spread, self.spread, "the objects are those of a tracer with other lanes");
        self.kernel.call(frame, objects, rows, out);
    }
}
