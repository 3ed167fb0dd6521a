//! The records of the packet kernels: spans of rows, in f32 or f64. layout.inc has their offsets and says what each is.

use super::types::Plain;

/// An element of the packet kernels: f32 (`single`) or f64 (`double`).
pub trait Element: Plain + Default + PartialOrd + Send + Sync {
    /// Rounded to nearest.
    fn from_f64(x: f64) -> Self;
    /// Exact.
    fn to_f64(self) -> f64;
}

impl Element for f32 {
    fn from_f64(x: f64) -> Self {
        x as f32
    }
    fn to_f64(self) -> f64 {
        self.into()
    }
}

impl Element for f64 {
    fn from_f64(x: f64) -> Self {
        x
    }
    fn to_f64(self) -> f64 {
        self
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
    /// A sphere seen from outside and lit by one light, in the short form.
    LitSpan { j, end, id, near, left, right, h1, h0, q1, q0, kn, ke, red, green, blue }
    /// A sphere seen from outside.
    OutsideSpan { j, end, id, near, a1, a0, b1, b0, h1, h0, x1, x0, y1, y0, z1, z0, cx, cy, cz }
    /// A sphere seen from inside.
    InsideSpan { j, end, id, near, x1, x0, y, z, g, h1, h0, k, cx, cy, cz }
    /// A triangle.
    TriangleSpan { j, end, id, near, w1, w0, x1, x0, y1, y0, z1, z0 }
    /// One light on one object.
    Lit { x, y, z, cosine, red, green, blue, padding }
}
