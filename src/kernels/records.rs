//! The records of the packet and tile kernels, in f32 or f64, with the layout of the `struc` blocks
//! in asm/include.

use glam::Vec3;

use super::types::Plain;
use super::types::{Frame, Light, PaperSphere, PaperTriangle, Surface, Vec4};

/// An element of the packet kernels: f32 (`single`) or f64 (`double`).
pub trait Element: Plain + Default + PartialOrd + Send + Sync {
    /// The difference of 1 and the next larger number, which is twice the largest relative error of
    /// a rounding.
    const EPSILON: f64;
    /// `x`, rounded to nearest.
    fn from_f64(x: f64) -> Self;
    /// The number in f64, which is exact.
    fn to_f64(self) -> f64;
    /// Converts an integer from 0 to 2^24.
    #[inline]
    fn to_index(self) -> u32 {
        // An integer below 2^52 is in the last bits of its sum with 2^52, so that the compiler can
        // convert many at once.
        (self.to_f64() + 4_503_599_627_370_496.0).to_bits() as u32
    }
}

impl Element for f32 {
    const EPSILON: f64 = f32::EPSILON as f64;
    fn from_f64(x: f64) -> Self {
        x as f32
    }
    fn to_f64(self) -> f64 {
        self.into()
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
}

/// Defines a record of elements, and how it is rounded from f64.
macro_rules! elements {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        #[repr(C)]
        #[allow(missing_docs, reason = "the fields say what they are where the assembly does")]
        pub struct $name<E> {
            $($(#[$field_doc])* pub $field: E,)*
        }

        impl $name<f64> {
            /// The record with every field rounded once.
            pub fn round<E: Element>(self) -> $name<E> {
                $name { $($field: E::from_f64(self.$field)),* }
            }
        }

        impl<E: Element> $name<E> {
            /// The record with every field in f64, which is exact.
            pub fn widen(self) -> $name<f64> {
                $name { $($field: self.$field.to_f64()),* }
            }

            /// The fields, in their order.
            pub fn numbers(&self) -> Vec<E> {
                vec![$(self.$field),*]
            }
        }

        // SAFETY: the record consists of elements only, all of the same size, which leave no
        // padding.
        unsafe impl<E: Element> Plain for $name<E> {
            const ZERO: Self = $name { $($field: E::ZERO),* };
        }
    };
}

/// Defines an array of records, transposed: the elements of one field come before those of the
/// next. 32-bit words may be floats.
macro_rules! columns {
    ($(#[$doc:meta])* $name:ident $(<$element:ident>)?: $type:ty, $len:literal {
        $($(#[$field_doc:meta])* $field:ident,)*
    }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(C, align(64))]
        #[allow(missing_docs, reason = "the fields say what they are where the assembly does")]
        pub struct $name $(<$element>)? {
            $($(#[$field_doc])* pub $field: [$type; $len],)*
        }

        const _: () = assert!($len % 16 == 0, "a field of numbers of 32 bits or more fills its 64 bytes");

        // SAFETY: the record consists of numbers only, all of the same size, which leave no
        // padding, as just asserted.
        unsafe impl $(<$element: Element>)? Plain for $name $(<$element>)? {
            const ZERO: Self = $name { $($field: [<$type as Plain>::ZERO; $len]),* };
        }
    };
}

/// Defines a kernel's arguments that are passed in memory: addresses, counts, and the bits of f64.
macro_rules! words {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident,)* }) => {
        $(#[$doc])*
        #[derive(Default)]
        #[repr(C)]
        #[cfg_attr(not(feature = "lab"), allow(dead_code, reason = "some are those of the lab's kernels"))]
        pub(super) struct $name {
            $($(#[$field_doc])* pub $field: u64,)*
        }
    };
}

/// Asserts the size and the offsets of a record whose fields have different types.
macro_rules! layout_checks {
    ($type:ty, $size:literal, { $($field:ident: $offset:literal,)* }) => {
        const _: () = {
            $(assert!(std::mem::offset_of!($type, $field) == $offset);)*
            assert!(size_of::<$type>() == $size);
        };
    };
}

include!(concat!(env!("OUT_DIR"), "/layout.rs"));

pub const TILE_PIXELS: usize = TILE_WIDTH * TILE_HEIGHT;

/// The visible points of a tile, pixel by pixel in the order of its blocks.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct TilePoints {
    /// The coordinates of the points, relative to the camera.
    pub x: [f64; TILE_PIXELS],
    pub y: [f64; TILE_PIXELS],
    pub z: [f64; TILE_PIXELS],
    /// The [number](super::shadows::own_number) of the object that a point is on; negative where
    /// nothing is visible.
    pub own: [f32; TILE_PIXELS],
    /// Where a light sees the points: x and y on a side of the cube around the light, in cells. NaN
    /// for points that the light sees through another side.
    pub seen: [[f32; TILE_PIXELS]; 2],
}

// SAFETY: the record consists of numbers only, which leave no padding, as the asserted offsets
// show.
unsafe impl Plain for TilePoints {
    const ZERO: Self = TilePoints {
        x: [0.0; TILE_PIXELS],
        y: [0.0; TILE_PIXELS],
        z: [0.0; TILE_PIXELS],
        own: [0.0; TILE_PIXELS],
        seen: [[0.0; TILE_PIXELS]; 2],
    };
}

/// A flat triangle that is seen from both sides, as a scene stores it and set-up reads it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Triangle {
    /// Red, green, blue, each at least 0.
    pub colour: Vec3,
    /// The three corners, in the camera's frame and in the file's order.
    pub vertices: [Vec3; 3],
}

// SAFETY: twelve floats that leave no padding, as the offsets asserted below show.
unsafe impl Plain for Triangle {
    const ZERO: Self = Triangle { colour: Vec3::ZERO, vertices: [Vec3::ZERO; 3] };
}

/// A sphere, eq. 2 of the paper: all points at the distance `radius` from `centre`. The layout is
/// that in which a scene stores it and set-up reads it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Sphere {
    /// The radius, greater than 0.
    pub radius: f32,
    /// Red, green, blue, each at least 0.
    pub colour: Vec3,
    /// The centre, in the camera's frame.
    pub centre: Vec3,
}

// SAFETY: seven floats that leave no padding, as the offsets asserted below show.
unsafe impl Plain for Sphere {
    const ZERO: Self = Sphere { radius: 0.0, colour: Vec3::ZERO, centre: Vec3::ZERO };
}

/// An object that may be visible in a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Candidate {
    /// The object's index in the scene.
    pub id: u32,
    /// The columns of the picture where the object may be: the first, and in the upper 16 bits one
    /// past the last.
    pub columns: u32,
    pub rows: u32,
    /// An upper bound of the object's 1/t: [`Candidate::ANY`] if it has none, infinity if the bound
    /// is beyond f32.
    pub most: f32,
}

impl Candidate {
    /// The `most` of a triangle that extends behind the camera's plane, and of a sphere that does
    /// or that contains the camera; such spheres have a kernel of their own.
    pub const ANY: f32 = f32::MAX;
}

// SAFETY: four numbers that leave no padding, as the offsets asserted below show.
unsafe impl Plain for Candidate {
    const ZERO: Self = Candidate { id: 0, columns: 0, rows: 0, most: 0.0 };
}

/// The number of rows in [`LitRows`].
pub const LIT_ROWS: usize = 64;

/// Defines a row of [`LitRows`] as a record.
macro_rules! lit_row {
    ($($field:ident)*) => {
        elements! {
            /// A row of a picture of a [`LitSphere`].
            LitRow { $($field,)* }
        }

        impl<E: Element> LitRows<E> {
            pub fn row(&self, row: usize) -> LitRow<E> {
                LitRow { $($field: self.$field[row]),* }
            }

            pub fn set_row(&mut self, row: usize, of: &LitRow<E>) {
                $(self.$field[row] = of.$field;)*
            }
        }
    };
}
lit_row! { start end j stop m a h0 q0 }

/// The position of a light relative to the camera, and a 0.
pub type LightPosition<E> = [E; 4];

/// At least as many elements as any register has.
pub(super) const MOST_LANES: usize = 16;

/// The record that the kernel `bounds` writes.
#[repr(C)]
pub(super) struct BoundsFound {
    pub most: [u32; MOST_LANES],
    pub least: [u32; MOST_LANES],
    pub brightest: [u32; MOST_LANES],
    pub nearest: [u32; MOST_LANES],
    pub longest: [u32; MOST_LANES],
    pub count: u64,
}
