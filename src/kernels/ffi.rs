//! The list of all kernels. A line for each gives its foreign declaration, its position in a table,
//! and its symbol.

use std::collections::BTreeSet;

use super::isa::Isa;
use super::kernel::kernel;
use super::packet::{F32x3, Narrow, Rgb8, Rgba8, RowSetup, ShadeRows};
use super::paper::{Hits, Op, OpRef, Trace};
use super::records::{
    Element, ObjectLight, Sphere, SphereCaster, SphereHit, SpherePlanes, Triangle, TriangleCaster, TriangleHit,
    TrianglePlanes,
};
use super::shadows::{Cast, Casters, Meet, Points, Seen};
use super::tiles::{Around, Bounds, NearerHalf, Nearest, SetUp, ShadeTile, SphereSetUp, SphereShading};
use super::types::{Light, PaperSphere, PaperTriangle, Surface, Vec4};
use super::vec3::{Chain, Chains, PacketChains, PacketOp, PacketOpCode, Shape};

/// Declares tables of kernels, and for each table a macro of the same name that makes one. Such a
/// macro takes the prefix of all symbols, the suffix of symbols of kernels with estimates, the name
/// of kernels for equal channels, the lanes of a packet, and whether products and sums are fused.
/// After a name in a table, `fast` adds the suffix for estimates, `grey` inserts the name for equal
/// channels, and the name of a table nests that table.
macro_rules! tables {
    ($d:tt $(
        $(#[$doc:meta])*
        struct $table:ident $(<$parameter:ident: $bound:ident>)? $([$lanes:ident])? {
            $($(#[$field_doc:meta])* $field:ident: $type:ty = $name:literal $($how:ident)?;)*
        }
    )*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy)]
        pub struct $table $(<$parameter: $bound>)? {
            $(
                /// The number of rays in lockstep.
                pub $lanes: usize,
                /// Whether a product and its sum are rounded together, only once.
                pub fused: bool,
            )?
            $($(#[$field_doc])* pub $field: $type,)*
        }

        impl $(<$parameter: $bound>)? $table $(<$parameter>)? {
            fn symbols(&self) -> Vec<&'static str> {
                [$(self.$field.symbols()),*].concat()
            }
        }

        macro_rules! $table {
            ($d prefix:expr, $d fast:literal, $d grey:literal, $d lanes_of:expr) => {
                $table {
                    $($lanes: $d lanes_of.0, fused: $d lanes_of.1,)?
                    $($field: tables!(@make $d prefix, $d fast, $d grey, $d lanes_of; $name $($how)?),)*
                }
            };
        }
    )*};
    (@make $prefix:expr, $fast:literal, $grey:literal, $lanes:expr; $name:literal) => {
        kernel!(concat!($prefix, $name))
    };
    (@make $prefix:expr, $fast:literal, $grey:literal, $lanes:expr; $name:literal fast) => {
        kernel!(concat!($prefix, $name, $fast))
    };
    (@make $prefix:expr, $fast:literal, $grey:literal, $lanes:expr; $name:literal grey) => {
        LitBodies!(concat!($prefix, $grey), $fast, $grey, $lanes)
    };
    (@make $prefix:expr, $fast:literal, $grey:literal, $lanes:expr; $name:literal single) => {
        ElementKernels!(concat!($prefix, $name), "_fast", "grey", $lanes)
    };
    (@make $prefix:expr, $fast:literal, $grey:literal, $lanes:expr; $name:literal double) => {
        ElementKernels!(concat!($prefix, $name), "", "lit", ($lanes.0 / 2, $lanes.1))
    };
    (@make $prefix:expr, $fast:literal, $grey:literal, $lanes:expr; $name:literal $table:ident) => {
        $table!(concat!($prefix, $name), $fast, $grey, $lanes)
    };
}

tables! { $
    /// The kernels that render a sphere under one light, seen from outside, for all outputs. The
    /// light is not brighter than white.
    struct LitBodies<E: Element> {
        /// Writes linear floats.
        f32x4: ShadeRows<E, Vec4> = "_f32x4";
        /// Writes linear floats with estimates of roots (in f64 without: as `f32x4`).
        f32x4_fast: ShadeRows<E, Vec4> = "_f32x4" fast;
        /// Writes 8-bit levels (with estimates of roots if these are accurate enough).
        rgba8: ShadeRows<E, Rgba8> = "_rgba8";
    }

    /// The kernels that trace tile by tile.
    struct TileKernels<E: Element> {
        /// Sets up triangles as planes.
        set_up: SetUp<E> = "set_up";
        /// Finds the nearest triangles.
        nearest_triangles: Nearest<TrianglePlanes<E>> = "nearest_triangles";
        /// Finds the nearest wall of a sphere that contains the camera or is beside it.
        around: Around<E> = "around";
        /// Sets up spheres as planes.
        sphere_set_up: SphereSetUp<E> = "sphere_set_up";
        /// Finds the nearest spheres.
        nearest_spheres: Nearest<SpherePlanes<E>> = "nearest_spheres";
        /// Makes the shading records of spheres.
        sphere_shading: SphereShading<E> = "sphere_shading";
        /// Finds the visible points, from which shadows are cast.
        points: Points<E> = "points";
        /// Shades to linear floats.
        f32x4: ShadeTile<E, Vec4> = "tile_f32x4";
        /// Shades to linear floats with estimates of roots (in f64 without: as `f32x4`).
        f32x4_fast: ShadeTile<E, Vec4> = "tile_f32x4" fast;
        /// Shades to 8-bit levels (in f32 with estimates of roots).
        rgba8: ShadeTile<E, Rgba8> = "tile_rgba8";
    }

    /// All packet kernels of an ISA for one element type.
    struct ElementKernels<E: Element> [lanes] {
        /// Finds the rows of a sphere under one light, seen from outside, for `lit` and `grey`.
        lit_rows: RowSetup<E> = "lit_rows";
        /// Renders these rows.
        lit: LitBodies<E> = "lit" LitBodies;
        /// Renders these rows if the light's three weights are equal (in f64: as `lit`).
        grey: LitBodies<E> = "" grey;
        /// Kernels for all other scenes, tile by tile.
        tiles: TileKernels<E> = "" TileKernels;
    }

    /// All packet kernels of an ISA.
    struct PacketKernels {
        /// Kernels on f32.
        single: ElementKernels<f32> = "single_" single;
        /// Kernels on f64.
        double: ElementKernels<f64> = "double_" double;
        /// Converts pixels of four bytes to three.
        narrow_rgb8: Narrow<Rgba8, Rgb8> = "narrow_rgb8";
        /// Converts pixels of four floats to three.
        narrow_f32x3: Narrow<Vec4, F32x3> = "narrow_f32x3";
        bounds: Bounds<Triangle> = "bounds";
        sphere_bounds: Bounds<Sphere> = "sphere_bounds";
        /// Partitions the objects of a tile into nearer and farther ones.
        nearer_half: NearerHalf = "nearer_half";
        /// Finds where a light sees the points of a tile.
        seen: Seen = "seen";
        /// Finds where a light sees triangles.
        cast: Cast = "cast";
        /// Finds the objects that may hide a light from points.
        meet: Meet = "meet";
        /// Finds the points that triangles hide from a light.
        triangle_casters: Casters<TriangleCaster<f64>> = "triangle_casters";
        /// Finds the points that spheres hide from a light.
        sphere_casters: Casters<SphereCaster<f64>> = "sphere_casters";
    }
}

/// The packet kernels of each [`Isa`], with the number of lanes in f32.
pub(super) static PACKETS: [PacketKernels; Isa::ALL.len()] = [
    PacketKernels!("rayo_sse41_", "", "", (4, false)),
    PacketKernels!("rayo_avx2_", "", "", (8, true)),
    PacketKernels!("rayo_avx512_", "", "", (16, true)),
];

/// The packet kernels of an ISA. None if the CPU or the operating system does not support it.
pub fn packets(isa: Isa) -> Option<&'static PacketKernels> {
    isa.usable().then(|| &PACKETS[isa as usize])
}

/// The symbols of all packet kernels in this build, whether or not this CPU supports them.
pub fn packet_symbols() -> BTreeSet<&'static str> {
    PACKETS.iter().flat_map(PacketKernels::symbols).collect()
}

/// The number of elements in a record.
const fn numbers<R>() -> usize {
    size_of::<R>() / size_of::<f32>()
}

/// Declares the table of kernels that hold one vector in one register, tables of the operations on
/// packets, tables of chains, and macros that make such tables from the prefix of their symbols.
macro_rules! operations {
    ($d:tt $(
        $(#[$doc:meta])*
        $name:ident: $kind:ident($a:ty, $b:ty) -> $out:ty $(, packets of $numbers:literal, $record:expr => $results:literal)?;
    )*) => {
        /// Kernels that hold one vector in one register: the paper's operations, intersections and
        /// tracer.
        pub struct AosKernels {
            $($(#[$doc])* pub $name: Op<$a, $b, $out>,)*
            /// Algorithm 1 over whole rows of pixels of four floats.
            pub trace: Trace,
        }

        impl AosKernels {
            /// Every operation with its name, in the order of the list.
            pub fn ops(&self) -> impl Iterator<Item = (&'static str, OpRef)> {
                [$((stringify!($name), OpRef::$kind(self.$name))),*].into_iter()
            }

            /// The symbol and the address of each function in the table.
            pub fn functions(&self) -> impl Iterator<Item = (&'static str, usize)> {
                let trace = (self.trace.symbol(), self.trace.address());
                [$((self.$name.symbol(), self.$name.address()),)* trace].into_iter()
            }
        }

        /// The names of all operations.
        pub const ALL_OPERATIONS: [&str; [$(stringify!($name)),*].len()] = [$(stringify!($name)),*];

        /// The names of the operations that exist on packets too.
        pub const OPERATIONS: [&str; [$($($numbers,)?)*].len()] = [$($(operations!(@name $name $numbers),)?)*];

        macro_rules! aos_kernels {
            ($d built:ident, $d prefix:literal) => {
                AosKernels {
                    $($name: kernel!($d built, concat!($d prefix, stringify!($name))),)*
                    trace: kernel!($d built, concat!($d prefix, "trace")),
                }
            };
        }

        /// Makes a table of operations on packets, from the prefix and the lanes of a packet.
        macro_rules! packet_ops {
            ($d prefix:literal, $d lanes:literal) => {
                [$($(PacketOp {
                    name: stringify!($name),
                    lanes: $d lanes,
                    shape: Shape { b_numbers: $numbers, record: $record, out_numbers: $results },
                    kernel: kernel!(concat!($d prefix, stringify!($name), "3")),
                },)?)*]
            };
        }

        /// Makes a table of chains of operations on packets.
        macro_rules! chains_of_packet_ops {
            ($d prefix:literal) => {
                [$($(Chains {
                    op: operations!(@name $name $numbers),
                    latency: kernel!(concat!($d prefix, stringify!($name), "3_latency")),
                    throughput: kernel!(concat!($d prefix, stringify!($name), "3_throughput")),
                },)?)*]
            };
        }

        /// Makes a table of chains of operations on single vectors.
        macro_rules! chains_of_aos_ops {
            ($d prefix:literal) => {
                [$(Chains {
                    op: stringify!($name),
                    latency: kernel!(concat!($d prefix, stringify!($name), "_latency")),
                    throughput: kernel!(concat!($d prefix, stringify!($name), "_throughput")),
                },)*]
            };
        }
    };
    (@name $name:ident $numbers:literal) => { stringify!($name) };
}

// The numbers after `packets of` and the arrow: per vector of a packet the elements of b, then the
// elements of b's record, and per vector the elements of the result.
operations! { $
    /// a + b.
    add: Vector(Vec4, Vec4) -> Vec4, packets of 3, 0 => 3;
    /// a - b.
    sub: Vector(Vec4, Vec4) -> Vec4, packets of 3, 0 => 3;
    /// a times the scalar b.
    scale: Scale(Vec4, f32) -> Vec4, packets of 1, 0 => 3;
    /// a . b.
    dot: Scalar(Vec4, Vec4) -> f32, packets of 3, 0 => 1;
    /// ||a||; b is not read.
    norm: Scalar(Vec4, Vec4) -> f32, packets of 0, 0 => 1;
    /// a x b, with w = 0 where a and b have it.
    cross: Vector(Vec4, Vec4) -> Vec4, packets of 3, 0 => 3;
    /// a / ||a||; b is not read.
    normalise: Vector(Vec4, Vec4) -> Vec4, packets of 0, 0 => 3;
    /// The smallest t > 0 at which the ray a from the origin meets the sphere b; infinity for a
    /// miss: eq. 5.
    sphere: Sphere(Vec4, PaperSphere) -> f32, packets of 0, numbers::<SphereHit<f32>>() => 1;
    /// The t > 0 at which the ray a from the origin meets the triangle b; infinity for a miss: eq.
    /// 6, 9, 10.
    triangle: Triangle(Vec4, PaperTriangle) -> f32, packets of 0, numbers::<TriangleHit<f32>>() => 1;
    /// The light that b adds to the surface a on the side of its normal: eq. 11.
    lambert: Lambert(Surface, Light) -> Vec4, packets of 0, numbers::<ObjectLight<f32>>() => 3;
    /// The light that b adds to the two-sided surface a.
    lambert2: Lambert(Surface, Light) -> Vec4;
}

static C: AosKernels = aos_kernels!(rayo_c, "rayo_c_");
static PAPER: AosKernels = aos_kernels!(rayo_asm, "rayo_paper_");
static AOS: AosKernels = aos_kernels!(rayo_asm, "rayo_aos_");
static C_HITS: Hits = kernel!(rayo_c, "rayo_c_hits");
static PAPER_HITS: Hits = kernel!("rayo_paper_hits");

/// The paper's C, compiled at -O3. None if this build has no C.
pub fn c() -> Option<&'static AosKernels> {
    cfg!(rayo_c).then_some(&C)
}

/// The paper's macros, in the forms whose instructions the paper counts. None if the CPU lacks
/// SSE4.1.
pub fn paper() -> Option<&'static AosKernels> {
    Isa::Sse41.usable().then_some(&PAPER)
}

/// The paper's macros, with the best forms of dot, norm and cross that we know. None if the CPU
/// lacks SSE4.1.
pub fn aos() -> Option<&'static AosKernels> {
    Isa::Sse41.usable().then_some(&AOS)
}

/// The tracer of [`c()`] that returns the surfaces hit. None if this build has no C.
pub fn hits_of_c() -> Option<Hits> {
    cfg!(rayo_c).then_some(C_HITS)
}

/// The tracer of [`paper`] that returns the surfaces hit. None if the CPU lacks SSE4.1.
pub fn hits_of_paper() -> Option<Hits> {
    Isa::Sse41.usable().then_some(PAPER_HITS)
}

/// The operations on packets of f32, for each [`Isa`].
static SINGLE: [[PacketOp<f32>; OPERATIONS.len()]; Isa::ALL.len()] =
    [packet_ops!("rayo_sse41_single_", 4), packet_ops!("rayo_avx2_single_", 8), packet_ops!("rayo_avx512_single_", 16)];
static DOUBLE: [[PacketOp<f64>; OPERATIONS.len()]; Isa::ALL.len()] =
    [packet_ops!("rayo_sse41_double_", 2), packet_ops!("rayo_avx2_double_", 4), packet_ops!("rayo_avx512_double_", 8)];

macro_rules! packet_chains {
    ($prefix:literal) => {
        PacketChains {
            chains: &chains_of_packet_ops!($prefix),
            feedback: kernel!(concat!($prefix, "feedback_latency")),
            muladd: kernel!(concat!($prefix, "muladd_throughput")),
        }
    };
}

static PACKET_CHAINS: [PacketChains; Isa::ALL.len()] =
    [packet_chains!("rayo_sse41_single_"), packet_chains!("rayo_avx2_single_"), packet_chains!("rayo_avx512_single_")];
static PAPER_CHAINS: [Chains; ALL_OPERATIONS.len()] = chains_of_aos_ops!("rayo_paper_");
static AOS_CHAINS: [Chains; ALL_OPERATIONS.len()] = chains_of_aos_ops!("rayo_aos_");

/// The feedback by itself that the latency chains of single vectors contain. It needs only
/// instructions that every x86-64 CPU has.
pub fn feedback() -> Option<Chain> {
    cfg!(rayo_asm).then_some(kernel!("rayo_feedback_latency"))
}

/// An element type that has operations on packets.
pub trait PacketElement: Element {
    /// The operations of an ISA; see [`packet_ops`].
    #[doc(hidden)]
    fn table(isa: Isa) -> Option<&'static [PacketOp<Self>]>;

    /// The code of the operations of an ISA; see [`packet_op_codes`].
    #[doc(hidden)]
    fn codes(isa: Isa) -> Vec<PacketOpCode>;
}

impl PacketElement for f32 {
    fn table(isa: Isa) -> Option<&'static [PacketOp<f32>]> {
        isa.usable().then_some(&SINGLE[isa as usize])
    }

    fn codes(isa: Isa) -> Vec<PacketOpCode> {
        SINGLE[isa as usize].iter().map(PacketOp::code).collect()
    }
}

impl PacketElement for f64 {
    fn table(isa: Isa) -> Option<&'static [PacketOp<f64>]> {
        isa.usable().then_some(&DOUBLE[isa as usize])
    }

    fn codes(isa: Isa) -> Vec<PacketOpCode> {
        DOUBLE[isa as usize].iter().map(PacketOp::code).collect()
    }
}

/// The packet operations of an ISA. None if the CPU or the operating system does not support it.
pub fn packet_ops<E: PacketElement>(isa: Isa) -> Option<&'static [PacketOp<E>]> {
    E::table(isa)
}

/// The code of the packet operations of an ISA, whether or not this CPU supports it.
pub fn packet_op_codes<E: PacketElement>(isa: Isa) -> Vec<PacketOpCode> {
    E::codes(isa)
}

/// The symbols of all packet operations in this build, whether or not this CPU supports them.
pub fn packet_op_symbols() -> impl Iterator<Item = &'static str> {
    SINGLE.iter().flatten().map(PacketOp::symbol).chain(DOUBLE.iter().flatten().map(PacketOp::symbol))
}

/// Chains of the operations on packets. None if the CPU or the operating system does not support
/// the ISA.
pub fn chains_of_packets(isa: Isa) -> Option<&'static PacketChains> {
    isa.usable().then(|| &PACKET_CHAINS[isa as usize])
}

/// Chains of the forms whose instructions the paper counts. None if the CPU lacks SSE4.1.
pub fn chains_of_paper() -> Option<&'static [Chains]> {
    Isa::Sse41.usable().then_some(&PAPER_CHAINS)
}

/// Chains of the best forms. None if the CPU lacks SSE4.1.
pub fn chains_of_aos() -> Option<&'static [Chains]> {
    Isa::Sse41.usable().then_some(&AOS_CHAINS)
}
