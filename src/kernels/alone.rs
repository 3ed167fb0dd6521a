//! The functions of asm/ops/alone.asm: single macros of the tracers as functions, which proofs read
//! and call.

use std::marker::PhantomData;

use super::isa::Isa;
use super::kernel::{Kernel, kernel, reads, writes};
use super::records::{
    CasterEdges, LightPosition, LitSphere, ObjectLight, ShortLight, SphereArrays, SphereCaster, SpherePlanes,
    SphereView, TileSphere, TileView, TriangleArrays, TriangleCaster, TrianglePlanes,
};

/// A macro as a function that takes a record and packets.
pub struct Alone {
    pub name: &'static str,
    pub isa: Isa,
    /// The bytes of an element: 4 or 8.
    pub element: usize,
    /// The bytes of the record.
    pub record: usize,
    /// How many packets the function takes.
    pub inputs: usize,
    /// How many packets the function writes.
    pub outputs: usize,
    kernel: Kernel<()>,
}

impl Alone {
    pub fn symbol(&self) -> &'static str {
        self.kernel.symbol()
    }

    pub fn address(&self) -> usize {
        self.kernel.address()
    }

    /// The bytes of a packet.
    pub fn packet_bytes(&self) -> usize {
        4 * self.isa.lanes()
    }

    /// Calls the function on the bytes of a record and of packets. Returns the bytes of its
    /// results.
    ///
    /// # Panics
    /// If the CPU lacks the function's instructions, or if the record or the packets have another
    /// length.
    pub fn call(&self, record: &[u8], a: &[u8]) -> Vec<u8> {
        assert!(self.isa.usable(), "the CPU lacks {}", self.isa.name());
        assert_eq!([record.len(), a.len()], [self.record, self.inputs * self.packet_bytes()], "{}", self.name);
        let mut out = vec![0; self.outputs * self.packet_bytes()];
        // SAFETY: the function requires no alignment, reads only the record and these packets, and
        // writes only the packets of its results; the CPU has its instructions, as asserted.
        unsafe { self.kernel.enter([reads(record), reads(a), writes(&mut *out), 0, 0, 0]) };
        out
    }
}

/// Makes a list of functions for one instruction set and one element type.
macro_rules! alone {
    ($prefix:literal, $isa:ident, $element:ty; $($name:ident: $record:ty, $inputs:literal => $outputs:literal;)*) => {
        &[$(Alone {
            name: stringify!($name),
            isa: Isa::$isa,
            element: size_of::<$element>(),
            record: size_of::<$record>(),
            inputs: $inputs,
            outputs: $outputs,
            kernel: kernel!(concat!($prefix, "_alone_", stringify!($name))),
        }),*]
    };
}

/// The functions of ALONE_IN_BOTH (asm/ops/alone.asm), which exist in f32 and in f64.
macro_rules! in_both {
    ($prefix:literal, $isa:ident, $e:ty) => {
        alone! { $prefix, $isa, $e;
            cross3_unfused: PhantomData<$e>, 6 => 3;
            dot3_unfused: PhantomData<$e>, 6 => 1;
            cosine: PhantomData<$e>, 2 => 1;
            triangle_cosine: LightPosition<$e>, 5 => 1;
            normal_over_t: TileSphere<$e>, 2 => 3;
            sphere_cosine: ObjectLight<$e>, 4 => 1;
            around_normal: TileSphere<$e>, 4 => 3;
            around_cosine: LightPosition<$e>, 7 => 1;
            short_cosine: ShortLight<$e>, 3 => 1;
            triangle_at: TrianglePlanes<$e>, 2 => 2;
            sphere_at: SpherePlanes<$e>, 2 => 2;
            sphere_lit: LitSphere<$e>, 5 => 1;
        }
    };
}

/// The functions of ALONE_IN_DOUBLE, which exist in f64 alone.
macro_rules! in_double {
    ($prefix:literal, $isa:ident) => {
        alone! { $prefix, $isa, f64;
            silhouette: PhantomData<f64>, 3 => 2;
            sphere_box: SphereView<f64>, 3 => 4;
            reach: SphereView<f64>, 3 => 1;
            pixels_between: SphereView<f64>, 2 => 2;
            length_of: PhantomData<f64>, 3 => 1;
            better_corner: PhantomData<f64>, 9 => 1;
            triangle_volume: PhantomData<f64>, 9 => 5;
            triangle_edge: TileView<f64>, 7 => 3;
            least_and_most: PhantomData<f64>, 3 => 2;
            outside_triangle: TriangleArrays, 4 => 1;
            outside_sphere: SphereArrays, 3 => 1;
            triangle_hides: TriangleCaster<f64>, 5 => 1;
            sphere_hides: SphereCaster<f64>, 8 => 1;
        }
    };
}

/// The functions of ALONE_IN_SINGLE, which exist in f32 alone.
macro_rules! in_single {
    ($prefix:literal, $isa:ident) => {
        alone! { $prefix, $isa, f32;
            caster_edge: CasterEdges, 2 => 1;
        }
    };
}

static ALONE: [&[Alone]; 12] = [
    in_single!("rayo_sse41_single", Sse41),
    in_single!("rayo_avx2_single", Avx2),
    in_single!("rayo_avx512_single", Avx512),
    in_both!("rayo_sse41_single", Sse41, f32),
    in_both!("rayo_sse41_double", Sse41, f64),
    in_double!("rayo_sse41_double", Sse41),
    in_both!("rayo_avx2_single", Avx2, f32),
    in_both!("rayo_avx2_double", Avx2, f64),
    in_double!("rayo_avx2_double", Avx2),
    in_both!("rayo_avx512_single", Avx512, f32),
    in_both!("rayo_avx512_double", Avx512, f64),
    in_double!("rayo_avx512_double", Avx512),
];

/// All functions, whether or not this CPU has their instructions.
pub fn alone() -> impl Iterator<Item = &'static Alone> {
    ALONE.into_iter().flatten()
}
