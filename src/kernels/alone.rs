//! The functions of asm/ops/alone.asm: single macros of the tracers as functions, which proofs read
//! and call.

use super::isa::Isa;
use super::kernel::{Kernel, kernel, reads, writes};
use super::records::{
    CasterBounds, CasterEdges, LightPosition, LightSideView, LitSphere, ObjectLight, ShortLight, SphereArrays,
    SphereCaster, SpherePlanes, SphereView, TileLight, TileSphere, TileView, TriangleArrays, TriangleCaster,
    TrianglePlanes,
};

/// Macros as a function that takes a record and packets.
pub struct Alone {
    pub name: &'static str,
    /// The macros that it consists of, which a proof of it proves.
    pub macros: &'static [&'static str],
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

/// Makes a list of functions for one instruction set and one element type. A row has a function's
/// name, its macros, the parts of its record, and how many packets it takes and writes.
macro_rules! alone {
    ($prefix:literal, $isa:ident, $element:ty; $(
        $name:ident($($of:ident),*): [$($record:ty),*], $inputs:literal => $outputs:literal;
    )*) => {
        &[$(Alone {
            name: stringify!($name),
            macros: &[$(stringify!($of)),*],
            isa: Isa::$isa,
            element: size_of::<$element>(),
            record: 0 $(+ size_of::<$record>())*,
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
            cross3_unfused(CROSS3_UNFUSED): [], 6 => 3;
            dot3_unfused(DOT3_UNFUSED): [], 6 => 1;
            cosine(COSINE): [], 2 => 1;
            triangle_cosine(TRIANGLE_COSINE): [LightPosition<$e>], 5 => 1;
            normal_over_t(SPHERE_ROOT, NORMAL_OVER_T): [TileSphere<$e>], 2 => 3;
            sphere_cosine(SPHERE_COSINE): [ObjectLight<$e>], 4 => 1;
            around_normal(AROUND_NORMAL): [TileSphere<$e>], 4 => 3;
            around_cosine(AROUND_COSINE): [LightPosition<$e>], 7 => 1;
            short_cosine(SHORT_COSINE): [ShortLight<$e>], 3 => 1;
            triangle_at(PLANE_ROW, PLANE_AT, TRIANGLE_AT): [TrianglePlanes<$e>], 2 => 2;
            sphere_at(SPHERE_ROW, SPHERE_D_AT, SPHERE_INVERSE_AT): [SpherePlanes<$e>], 2 => 2;
            sphere_lit(SPHERE_LIT): [LitSphere<$e>], 5 => 1;
        }
    };
}

/// The functions of ALONE_IN_DOUBLE, which exist in f64 alone.
macro_rules! in_double {
    ($prefix:literal, $isa:ident) => {
        alone! { $prefix, $isa, f64;
            sphere_box(SPHERE_BOX, SILHOUETTE): [SphereView<f64>], 3 => 4;
            pixels_between(PIXELS_BETWEEN): [SphereView<f64>], 2 => 2;
            length_of(LENGTH_OF): [], 3 => 1;
            better_corner(BETTER_CORNER): [], 9 => 1;
            triangle_volume(TRIANGLE_VOLUME, NORMAL_PART): [], 9 => 5;
            triangle_edge(TRIANGLE_EDGE): [TileView<f64>], 7 => 3;
            outside_triangle(IF_OUTSIDE_TRIANGLE, IF_OUTSIDE_EDGE, ONE_TERM): [TriangleArrays], 4 => 1;
            outside_sphere(IF_OUTSIDE_SPHERE, ONE_SQUARE): [SphereArrays], 3 => 1;
            triangle_hides(TRIANGLE_HIDES): [TriangleCaster<f64>], 5 => 1;
            sphere_hides(SPHERE_HIDES): [SphereCaster<f64>], 8 => 1;
            sphere_d(SPHERE_D, NEAREST_PIXEL, REACH): [SphereView<f64>, SphereArrays], 0 => 21;
            term(TERM): [], 8 => 6;
            normal(NORMAL): [SphereView<f64>], 9 => 9;
            lights(TO_LIGHT, SPHERE_WEIGHT, WEIGHT): [TileLight<f64>, SphereArrays, TriangleArrays], 0 => 6;
            casters(BOUNDS_OF_CASTERS, PLACE_IN_CELLS, LEAST_AND_MOST, EDGES_OF_CASTERS, EDGE_OF_TRIANGLE):
                [LightSideView<f64>, TriangleArrays], 0 => 14;
        }
    };
}

/// The functions of ALONE_IN_SINGLE, which exist in f32 alone.
macro_rules! in_single {
    ($prefix:literal, $isa:ident) => {
        alone! { $prefix, $isa, f32;
            edges_here(EDGES_HERE): [], 5 => 2;
            cross2(CROSS2): [], 4 => 1;
            project(PROJECT): [], 6 => 5;
            caster_edge(EDGE_OF_CASTER): [CasterEdges], 2 => 1;
            within_edges(WITHIN_EDGES): [CasterEdges], 2 => 1;
            within_bounds(WITHIN_BOUNDS): [CasterBounds], 2 => 1;
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
