//! The records of the packet kernels: spans of rows, and objects for single rays, in f32 or f64. layout.inc has their offsets and says what each is.

use super::types::Plain;

/// An element of the packet kernels: f32 (`single`) or f64 (`double`).
pub trait Element: Plain + Default + PartialOrd + Send + Sync {
    /// From 1 to the next number: twice the largest relative error of a rounding.
    const EPSILON: f64;
    /// Rounded to nearest.
    fn from_f64(x: f64) -> Self;
    /// Exact.
    fn to_f64(self) -> f64;
    /// Of an integer from 0 to 2^24.
    fn to_index(self) -> usize;
}

impl Element for f32 {
    const EPSILON: f64 = f32::EPSILON as f64;
    fn from_f64(x: f64) -> Self {
        x as f32
    }
    fn to_f64(self) -> f64 {
        self.into()
    }
    fn to_index(self) -> usize {
        self as i32 as usize
    }
}

impl Element for f64 {
    const EPSILON: f64 = f64::EPSILON;
    fn from_f64(x: f64) -> Self {
        x
    }
    fn to_f64(self) -> f64 {
        self
    }
    fn to_index(self) -> usize {
        self as i32 as usize
    }
}

/// Declares a record of elements, its rounding from f64, and what all spans share.
macro_rules! records {
    ($($(#[$doc:meta])* $name:ident { $($field:ident),* $(,)? })*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, Default, PartialEq)]
            #[repr(C)]
            #[expect(missing_docs, reason = "layout.inc or tile_layout.inc says what each field is")]
            pub struct $name<E> {
                $(pub $field: E,)*
            }

            impl $name<f64> {
                /// Every field rounded once.
                pub fn round<E: Element>(self) -> $name<E> {
                    $name { $($field: E::from_f64(self.$field)),* }
                }
            }

            impl<E: Copy> $name<E> {
                /// Its fields, in their order.
                pub fn numbers(&self) -> Vec<E> {
                    vec![$(self.$field),*]
                }
            }

            // SAFETY: nothing but elements, which fill it, as the offsets asserted in types.rs show.
            unsafe impl<E: Element> Plain for $name<E> {
                const ZERO: Self = $name { $($field: E::ZERO),* };
            }
        )*
    };
}

pub(super) use records;

records! {
    /// What all spans begin with.
    Span { j, end, id, near }
    /// A sphere seen from outside and lit by one light, in the short form: what all its rows share.
    LitSphere { h1, least, q1, kn, ke, red, green, blue }
    /// One of its rows.
    LitRow { start, end, j, stop, m, a, h0, q0, id }
    /// What its rows are made of, in f64.
    LitSetup {
        step, half_width, half_height, columns, width, cx, cy, cz, k, m, nx, zz, cyz, czz, h, q, vx, vy, vzz,
    }
    /// A sphere seen from outside.
    OutsideSpan { j, end, id, near, a1, a0, b1, b0, h1, h0, x1, x0, y1, y0, z1, z0, cx, cy, cz }
    /// A sphere seen from outside at less than sqrt 2 radii.
    NearSpan { j, end, id, near, a1, a0, b1, b0, h1, h0, x1, x0, y, z, cx, cy, cz }
    /// A sphere seen from inside.
    InsideSpan { j, end, id, near, x1, x0, y, z, g, h1, h0, k, cx, cy, cz }
    /// A triangle.
    TriangleSpan { j, end, id, near, w1, w0, x1, x0, y1, y0, z1, z0 }
    /// One light on one object.
    Lit { x, y, z, cosine, red, green, blue, padding }
    /// A sphere that rays of any direction may meet.
    SphereHit { cx, cy, cz, square, k }
    /// A triangle that rays of any direction may meet.
    TriangleHit { nx, ny, nz, k, ax, ay, az, a, bx, by, bz, b, cx, cy, cz, c }
}

/// Rows of a [`LitSphere`], a field after another: as the kernels read them.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
#[expect(missing_docs, reason = "layout.inc says what each field is")]
pub struct LitRows<E> {
    pub start: [E; LIT_ROWS],
    pub end: [E; LIT_ROWS],
    pub j: [E; LIT_ROWS],
    pub stop: [E; LIT_ROWS],
    pub m: [E; LIT_ROWS],
    pub a: [E; LIT_ROWS],
    pub h0: [E; LIT_ROWS],
    pub q0: [E; LIT_ROWS],
    pub id: [E; LIT_ROWS],
}

/// The rows that [`LitRows`] has room for.
pub const LIT_ROWS: usize = 64;

impl<E: Element> LitRows<E> {
    /// A row.
    pub fn row(&self, row: usize) -> LitRow<E> {
        let LitRows { start, end, j, stop, m, a, h0, q0, id } = self;
        LitRow {
            start: start[row],
            end: end[row],
            j: j[row],
            stop: stop[row],
            m: m[row],
            a: a[row],
            h0: h0[row],
            q0: q0[row],
            id: id[row],
        }
    }

    /// Sets a row.
    pub fn set_row(&mut self, row: usize, of: &LitRow<E>) {
        let LitRows { start, end, j, stop, m, a, h0, q0, id } = self;
        for (field, value) in [
            (start, of.start),
            (end, of.end),
            (j, of.j),
            (stop, of.stop),
            (m, of.m),
            (a, of.a),
            (h0, of.h0),
            (q0, of.q0),
            (id, of.id),
        ] {
            field[row] = value;
        }
    }
}

// SAFETY: nothing but elements, which fill it, as the offsets asserted in types.rs show.
unsafe impl<E: Element> Plain for LitRows<E> {
    const ZERO: Self = {
        let none = [E::ZERO; LIT_ROWS];
        LitRows { start: none, end: none, j: none, stop: none, m: none, a: none, h0: none, q0: none, id: none }
    };
}

impl<E: Element> Default for LitRows<E> {
    fn default() -> Self {
        Self::ZERO
    }
}
