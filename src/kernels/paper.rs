//! The arguments of the paper's kernels: operations, and Algorithm 1 over rows.

use std::ops::Range;

use super::kernel::{Callee, function, kinds, reads, writes};
use super::records::Lists;
use super::types::{Frame, Light, Objects, PaperSphere, PaperTriangle, Plain, Surface, Vec4};

kinds! {
    /// An operation `out = op(a, b)` on single values.
    Op<A: Plain, B: Plain, O: Plain>

    /// Writes the result for `a` and `b` to `out`.
    fn call_into(out: &mut O, a: &A, b: &B); |way| {
        let Callee::Code(enter) = way;
        // Each argument is one value of a type for which any bits are valid.
        enter([writes(out), reads(a), reads(b), 0, 0, 0]);
    }

    /// Algorithm 1 over whole rows of an image: a [`Trace`] or [`Hits`].
    RowsOf<P: Plain>

    /// Writes `rows` of the image to `out`, row by row.
    ///
    /// # Panics
    /// If `out` does not have `frame.width` times the number of rows pixels.
    fn call(frame: &Frame, objects: Objects<'_>, rows: Range<u32>, out: &mut [P]); |way| {
        let Callee::Code(enter) = way;
        let pixels = u128::from(frame.width) * rows.len() as u128;
        assert_eq!(out.len() as u128, pixels, "the buffer must have the size of the rows");
        if pixels > 0 {
            // The lists have the lengths that are passed. There is at least one row and one column,
            // and `out` has room for each pixel.
            let Objects { lights, spheres, triangles } = objects;
            let lists = Lists {
                lights: reads(lights),
                light_count: lights.len() as u64,
                spheres: reads(spheres),
                sphere_count: spheres.len() as u64,
                triangles: reads(triangles),
                triangle_count: triangles.len() as u64,
            };
            enter([reads(frame), reads(&lists), rows.start.into(), rows.end.into(), writes(out), 0]);
        }
    }
}

impl<A: Plain, B: Plain, O: Plain> Op<A, B, O> {
    /// The result for `a` and `b`.
    pub fn call(self, a: &A, b: &B) -> O {
        let mut out = O::ZERO;
        self.call_into(&mut out, a, b);
        out
    }
}

/// Algorithm 1 over whole rows of an image. A pixel is linear red, green, blue, not clamped, and 0.
pub type Trace = RowsOf<Vec4>;

/// As [`Trace`], with the nearest surface that is hit instead of a colour. Its point has t in the
/// fourth lane, or 0 if nothing is hit.
pub type Hits = RowsOf<Surface>;

/// An operation of a table, by the types of its arguments and result: for tests, counts and
/// benches.
#[derive(Clone, Copy)]
pub enum OpRef {
    /// (vector, vector) -> vector.
    Vector(Op<Vec4, Vec4, Vec4>),
    /// (vector, scalar) -> vector.
    Scale(Op<Vec4, f32, Vec4>),
    /// (vector, vector) -> scalar.
    Scalar(Op<Vec4, Vec4, f32>),
    /// (ray, sphere) -> t.
    Sphere(Op<Vec4, PaperSphere, f32>),
    /// (ray, triangle) -> t.
    Triangle(Op<Vec4, PaperTriangle, f32>),
    /// (surface, light) -> colour.
    Lambert(Op<Surface, Light, Vec4>),
}

impl OpRef {
    /// The symbol of the operation's code.
    pub fn symbol(self) -> &'static str {
        match self {
            OpRef::Vector(op) => op.symbol(),
            OpRef::Scale(op) => op.symbol(),
            OpRef::Scalar(op) => op.symbol(),
            OpRef::Sphere(op) => op.symbol(),
            OpRef::Triangle(op) => op.symbol(),
            OpRef::Lambert(op) => op.symbol(),
        }
    }

    pub fn address(self) -> usize {
        match self {
            OpRef::Vector(op) => op.address(),
            OpRef::Scale(op) => op.address(),
            OpRef::Scalar(op) => op.address(),
            OpRef::Sphere(op) => op.address(),
            OpRef::Triangle(op) => op.address(),
            OpRef::Lambert(op) => op.address(),
        }
    }
}
