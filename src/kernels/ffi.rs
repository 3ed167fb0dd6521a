//! The list of all kernels: their foreign declarations, a table of them per implementation, and safe calls.

use std::ops::Range;

use super::checked::{self, Fault};
use super::isa::Isa;
use super::types::{Frame, Light, Lists, Objects, Plain, Sphere, Surface, Triangle, Vec4};

/// A loop of Algorithm 1, which writes pixels of the type `P`.
type Rows<P> = unsafe extern "sysv64" fn(frame: *const Frame, lists: *const Lists<'_>, row: u64, end: u64, out: *mut P);

/// An operation `out = op(a, b)` on single values.
#[derive(Clone, Copy)]
pub struct Op<A, B, O> {
    code: unsafe extern "sysv64" fn(out: *mut O, a: *const A, b: *const B),
}

impl<A: Plain, B: Plain, O: Plain> Op<A, B, O> {
    /// The contract of `code` is that of [`Op::call_into`]: one value of each type, and a CPU that has been checked.
    pub(super) const fn new(code: unsafe extern "sysv64" fn(*mut O, *const A, *const B)) -> Self {
        Op { code }
    }

    /// The result for `a` and `b`.
    pub fn call(self, a: &A, b: &B) -> O {
        let mut out = O::ZERO;
        self.call_into(&mut out, a, b);
        out
    }

    /// Writes the result for `a` and `b` to `out`.
    #[inline]
    pub fn call_into(self, out: &mut O, a: &A, b: &B) {
        // SAFETY: the references prove that the addresses are valid and aligned, and the kernel reads and writes one
        // value of each type, any bits of which are a value of O. The table it came from was handed out by a function
        // that had checked the CPU.
        unsafe { (self.code)(out, a, b) }
    }

    /// Where its code is.
    pub fn address(self) -> usize {
        self.code as usize
    }

    /// As [`Op::call_into`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(self, out: &mut O, a: &A, b: &B) -> Result<(), Vec<Fault>> {
        let args =
            [std::ptr::from_mut(out) as u64, std::ptr::from_ref(a) as u64, std::ptr::from_ref(b) as u64, 0, 0, 0];
        // SAFETY: as in call_into; these are the three arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }
}

/// Algorithm 1 over whole rows of an image: of a [`Trace`] or of [`Hits`].
pub struct RowsOf<P> {
    code: Rows<P>,
}

/// Algorithm 1 over whole rows of an image. A pixel is its linear red, green, blue and 0, not clamped.
pub type Trace = RowsOf<Vec4>;

/// The same, with what is hit in place of a colour. A pixel is the surface that is nearest, with t in the fourth lane of its
/// point, or 0 where there is none.
pub type Hits = RowsOf<Surface>;

impl<P> Clone for RowsOf<P> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<P> Copy for RowsOf<P> {}

impl<P: Plain> RowsOf<P> {
    /// The contract of `code` is that of [`RowsOf::call`], on a CPU that has been checked.
    pub(super) const fn new(code: Rows<P>) -> Self {
        RowsOf { code }
    }

    /// Writes `rows` of the image to `out`, row by row.
    ///
    /// # Panics
    /// Where `out` is not `frame.width` x the number of rows long.
    pub fn call(self, frame: &Frame, objects: Objects<'_>, rows: Range<u32>, out: &mut [P]) {
        if Self::some_pixels(frame, &rows, out) {
            let lists = Lists::from(objects);
            // SAFETY: the references prove that the addresses are valid and aligned and the lists as long as they say;
            // some_pixels() that there is a row, a column, and in `out` the place of each pixel. The CPU as in Op.
            unsafe { (self.code)(frame, &lists, rows.start.into(), rows.end.into(), out.as_mut_ptr()) }
        }
    }

    /// Where its code is.
    pub fn address(self) -> usize {
        self.code as usize
    }

    /// As [`RowsOf::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(
        self,
        frame: &Frame,
        objects: Objects<'_>,
        rows: Range<u32>,
        out: &mut [P],
    ) -> Result<(), Vec<Fault>> {
        if !Self::some_pixels(frame, &rows, out) {
            return Ok(());
        }
        let lists = Lists::from(objects);
        let args = [
            std::ptr::from_ref(frame) as u64,
            std::ptr::from_ref(&lists) as u64,
            rows.start.into(),
            rows.end.into(),
            out.as_mut_ptr() as u64,
            0,
        ];
        // SAFETY: as in call; these are the five arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }

    fn some_pixels(frame: &Frame, rows: &Range<u32>, out: &[P]) -> bool {
        let pixels = u128::from(frame.width) * rows.len() as u128;
        assert_eq!(out.len() as u128, pixels, "the buffer must have the size of the rows");
        pixels > 0
    }
}

/// One operation of a table, by the types it works on: what tests, counts and benches go through.
#[derive(Clone, Copy)]
pub enum OpRef {
    /// (vector, vector) -> vector.
    Vector(Op<Vec4, Vec4, Vec4>),
    /// (vector, scalar) -> vector.
    Scale(Op<Vec4, f32, Vec4>),
    /// (vector, vector) -> scalar.
    Scalar(Op<Vec4, Vec4, f32>),
    /// (ray, sphere) -> t.
    Sphere(Op<Vec4, Sphere, f32>),
    /// (ray, triangle) -> t.
    Triangle(Op<Vec4, Triangle, f32>),
    /// (surface, light) -> colour.
    Lambert(Op<Surface, Light, Vec4>),
}

/// Declares a table of kernels, a tracer among them, and one static of it per implementation, from one list.
macro_rules! kernels {
    ($(#[$doc:meta])* struct $table:ident $list:tt $($(#[$static_doc:meta])* static $static:ident = $prefix:literal;)*) => {
        kernels!(@table [$(#[$doc])*] $table $list);
        $(kernels!(@static [$(#[$static_doc])*] $table $static $prefix $list);)*
    };
    (@table [$($doc:tt)*] $table:ident {
        $($(#[$op_doc:meta])* $name:ident: $kind:ident($a:ty, $b:ty) -> $out:ty,)*
    }) => {
        $($doc)*
        pub struct $table {
            $($(#[$op_doc])* pub $name: Op<$a, $b, $out>,)*
            /// Algorithm 1: rows of four floats a pixel.
            pub trace: Trace,
        }

        impl $table {
            /// Every operation with its name, in the order of the list.
            pub fn ops(&self) -> impl Iterator<Item = (&'static str, OpRef)> {
                [$((stringify!($name), OpRef::$kind(self.$name))),*].into_iter()
            }
        }
    };
    (@static [$($doc:tt)*] $table:ident $static:ident $prefix:literal {
        $($(#[$op_doc:meta])* $name:ident: $kind:ident($a:ty, $b:ty) -> $out:ty,)*
    }) => {
        $($doc)*
        static $static: $table = {
            unsafe extern "sysv64" {
                $(#[link_name = concat!($prefix, stringify!($name))]
                fn $name(out: *mut $out, a: *const $a, b: *const $b);)*
                #[link_name = concat!($prefix, "trace")]
                fn trace(frame: *const Frame, lists: *const Lists<'_>, row: u64, end: u64, out: *mut Vec4);
            }
            $table { $($name: Op { code: $name },)* trace: Trace::new(trace) }
        };
    };
}

kernels! {
    /// Kernels that hold one vector in one register: the paper's operations, its intersections, its tracer.
    struct AosKernels {
        /// a + b.
        add: Vector(Vec4, Vec4) -> Vec4,
        /// a - b.
        sub: Vector(Vec4, Vec4) -> Vec4,
        /// a times the scalar b.
        scale: Scale(Vec4, f32) -> Vec4,
        /// a . b.
        dot: Scalar(Vec4, Vec4) -> f32,
        /// ||a||; b is not read.
        norm: Scalar(Vec4, Vec4) -> f32,
        /// a x b, with w = 0 where a and b have it.
        cross: Vector(Vec4, Vec4) -> Vec4,
        /// a / ||a||; b is not read.
        normalise: Vector(Vec4, Vec4) -> Vec4,
        /// The smallest t > 0 at which the ray a from the origin meets the sphere b, infinity for none: eq. 5.
        sphere: Sphere(Vec4, Sphere) -> f32,
        /// The t > 0 at which the ray a from the origin meets the triangle b, infinity for none: eq. 6, 9, 10.
        triangle: Triangle(Vec4, Triangle) -> f32,
        /// What the light b adds to the surface a on the side of its normal: eq. 11.
        lambert: Lambert(Surface, Light) -> Vec4,
        /// The same where the surface has two sides.
        lambert2: Lambert(Surface, Light) -> Vec4,
    }
    static C = "rayo_c_";
    static PAPER = "rayo_paper_";
    static AOS = "rayo_aos_";
}

/// The paper's C, as the compiler makes it at -O3.
pub fn c() -> &'static AosKernels {
    &C
}

/// The paper's macros, in the forms that the paper counts. None where the CPU lacks SSE4.1.
pub fn paper() -> Option<&'static AosKernels> {
    Isa::Sse41.usable().then_some(&PAPER)
}

/// What the tracer of [`c()`] hits.
pub fn hits_of_c() -> Hits {
    unsafe extern "sysv64" {
        fn rayo_c_hits(frame: *const Frame, lists: *const Lists<'_>, row: u64, end: u64, out: *mut Surface);
    }
    Hits::new(rayo_c_hits)
}

/// What the tracer of [`paper`] hits. None where the CPU lacks SSE4.1.
pub fn hits_of_paper() -> Option<Hits> {
    unsafe extern "sysv64" {
        fn rayo_paper_hits(frame: *const Frame, lists: *const Lists<'_>, row: u64, end: u64, out: *mut Surface);
    }
    Isa::Sse41.usable().then_some(Hits::new(rayo_paper_hits))
}

/// The same kernels with the best forms of dot, norm and cross that we know. None where the CPU lacks SSE4.1.
pub fn aos() -> Option<&'static AosKernels> {
    Isa::Sse41.usable().then_some(&AOS)
}
