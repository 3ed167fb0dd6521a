//! The packet kernels in Rust, for any CPU: the twins of the kernels in asm/tracers, equal to the
//! last bit except where these use estimates.
//!
//! Each formula is written once in assembly and once here. A table of these kernels with the lanes
//! and the rounding of an instruction set has the twins of that set's kernels.

pub mod lanes;
pub mod nearest;
pub mod rows;
pub mod set_up;
pub mod shade;
pub mod shadows;
pub mod spheres;

use lanes::{Lanes, Number, Packet};

use super::ffi::{ElementKernels, LitBodies, PacketKernels, TileKernels};
use super::packet::{F32x3, Narrow, Rgb8, Rgba8, RowSetup, ShadeRows};
use super::records::{
    Element as _, Sphere, SphereCaster, SpherePlanes, TileSphere, Triangle, TriangleCaster, TrianglePlanes,
};
#[cfg(feature = "lab")]
use super::records::{LitRows, LitSphere};
use super::shadows::{Cast, Casters, Meet, Points, Seen};
use super::tiles::{Around, Bounds, NearerHalf, Nearest, SetUp, ShadeTile, SphereSetUp, SphereShading};
use super::types::Vec4;

/// Whether the compiler may use fused multiply-add instructions.
pub const FUSED: bool = cfg!(any(target_feature = "fma", target_arch = "aarch64"));
/// The number of f32 in a vector register that the compiler may use; 4 if it knows of none.
const LANES: usize = if cfg!(target_feature = "avx512f") {
    16
} else if cfg!(target_feature = "avx2") {
    8
} else {
    4
};

static PACKETS: PacketKernels = packets::<LANES, { LANES / 2 }, FUSED>();

/// The packet kernels in Rust, compiled for the CPU features that this build assumes.
pub fn portable() -> &'static PacketKernels {
    &PACKETS
}

/// Packet kernels in Rust with `N` lanes in f32 and half as many in f64. If `FUSED`, a product and
/// its sum are rounded together.
pub const fn packets<const N: usize, const HALF: usize, const FUSED: bool>() -> PacketKernels {
    // More lanes would not divide the sizes of what kernels share.
    const { assert!(N <= 16 && HALF <= 8) };
    PacketKernels {
        single: elements::<Packet<f32, N, FUSED>, Packet<f64, HALF, FUSED>, f32>(),
        double: elements::<Packet<f64, HALF, FUSED>, Packet<f64, HALF, FUSED>, f64>(),
        narrow_rgb8: Narrow::<Rgba8, Rgb8>::in_rust(rows::narrow_rgb8, "narrow_rgb8"),
        narrow_f32x3: Narrow::<Vec4, F32x3>::in_rust(rows::narrow_f32x3, "narrow_f32x3"),
        bounds: Bounds::<Triangle>::in_rust(set_up::bounds::<Packet<f32, N, FUSED>>, "bounds"),
        sphere_bounds: Bounds::<Sphere>::in_rust(spheres::bounds::<Packet<f64, HALF, FUSED>>, "sphere_bounds"),
        nearer_half: NearerHalf::in_rust(nearest::nearer_half, "nearer_half"),
        seen: Seen::in_rust(shadows::seen::<Packet<f64, HALF, FUSED>>, "seen"),
        cast: Cast::in_rust(shadows::cast::<Packet<f64, HALF, FUSED>>, "cast"),
        meet: Meet::in_rust(shadows::meet::<Packet<f32, N, FUSED>>, "meet"),
        triangle_casters: Casters::<TriangleCaster<f64>>::in_rust(
            shadows::open::<Packet<f64, HALF, FUSED>, _>,
            "triangle_casters",
        ),
        sphere_casters: Casters::<SphereCaster<f64>>::in_rust(
            shadows::open::<Packet<f64, HALF, FUSED>, _>,
            "sphere_casters",
        ),
    }
}

/// The kernels of rows, with correctly rounded roots where kernels in assembly use estimates.
const fn lit<L: Lanes<Number = E>, E: Number, const GREY: bool>() -> LitBodies<E> {
    LitBodies {
        f32x4: ShadeRows::<E, Vec4>::in_rust(rows::shade_rows::<L, _, GREY>, "lit_f32x4"),
        f32x4_fast: ShadeRows::<E, Vec4>::in_rust(rows::shade_rows::<L, _, GREY>, "lit_f32x4"),
        rgba8: ShadeRows::<E, Rgba8>::in_rust(rows::shade_rows::<L, _, GREY>, "lit_rgba8"),
    }
}

/// The kernels for one element type. L is a packet of pixels, W the packet in which objects are set
/// up.
const fn elements<L: Lanes<Number = E>, W: Lanes<Number = f64>, E: Number>() -> ElementKernels<E> {
    ElementKernels {
        lanes: L::COUNT,
        fused: L::FUSED,
        lit_rows: RowSetup::<E>::in_rust(rows::lit_rows::<W, E>, "lit_rows"),
        lit: lit::<L, E, false>(),
        grey: lit::<L, E, true>(),
        tiles: TileKernels {
            set_up: SetUp::<E>::in_rust(set_up::set_up::<W, E>, "set_up"),
            nearest_triangles: Nearest::<TrianglePlanes<E>>::in_rust(nearest::nearest::<L, _>, "nearest_triangles"),
            around: Around::<E>::in_rust(nearest::around::<L, W>, "around"),
            sphere_set_up: SphereSetUp::<E>::in_rust(spheres::set_up::<W, E>, "sphere_set_up"),
            nearest_spheres: Nearest::<SpherePlanes<E>>::in_rust(nearest::nearest::<L, _>, "nearest_spheres"),
            sphere_shading: SphereShading::<E>::in_rust(spheres::shading::<W, E>, "sphere_shading"),
            points: Points::<E>::in_rust(shadows::points::<L, W>, "points"),
            f32x4: ShadeTile::<E, Vec4>::in_rust(shade::shade::<L, _>, "tile_f32x4"),
            f32x4_fast: ShadeTile::<E, Vec4>::in_rust(shade::shade::<L, _>, "tile_f32x4"),
            rgba8: ShadeTile::<E, Rgba8>::in_rust(shade::shade::<L, _>, "tile_rgba8"),
        },
    }
}

/// [`rows::shade_rows`] to the bytes of a grey sphere, compiled for a level of x86-64.
#[cfg(feature = "lab")]
macro_rules! compiled {
    ($($name:ident, $features:literal, $lanes:literal, $fused:literal;)*) => {$(
        /// # Safety
        /// The CPU supports the level.
        #[cfg_attr(target_arch = "x86_64", target_feature(enable = $features))]
        pub unsafe fn $name(sphere: &LitSphere<f32>, rows: &LitRows<f32>, out: &mut [Rgba8], width: usize) {
            rows::shade_rows::<Packet<f32, $lanes, $fused>, Rgba8, true>(sphere, rows, out, width);
        }
    )*};
}
#[cfg(feature = "lab")]
compiled! {
    grey_sse41, "sse4.1", 4, false;
    grey_v3, "avx2,fma,bmi1,bmi2,lzcnt,movbe,popcnt,f16c", 8, true;
    grey_v4, "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,fma", 16, true;
}

/// n / t at a pixel with the coordinates `x` and `y` relative to a sphere's own origin, by the
/// operations of kernels in f32 (`single`) or f64. If `fused`, a product and its sum are rounded
/// together.
pub fn normal_over_t([single, fused]: [bool; 2], sphere: &TileSphere<f64>, x: f64, y: f64) -> [f64; 3] {
    fn of<L: Lanes>(sphere: &TileSphere<f64>, x: f64, y: f64) -> [f64; 3] {
        shade::normal_over_t(&sphere.round(), L::of(x), L::of(y)).map(|n| n.lane(0).to_f64())
    }
    let of = match [single, fused] {
        [true, true] => of::<Packet<f32, 1, true>>,
        [true, false] => of::<Packet<f32, 1, false>>,
        [false, true] => of::<Packet<f64, 1, true>>,
        [false, false] => of::<Packet<f64, 1, false>>,
    };
    of(sphere, x, y)
}
