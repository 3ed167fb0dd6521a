//! The packet kernels in Rust, for any CPU: what those of asm/tracers do, to the same bits where these have no estimates.
//!
//! A formula stands once in assembly and once here, where it is the assembly's twin. With as many lanes and the rounding of an
//! instruction set a table is that of its twins.

mod lanes;
mod nearest;
mod rows;
mod set_up;
mod shade;
mod spheres;

use lanes::{Lanes, Number, Packet};

use super::ffi::{ElementKernels, LitBodies, PacketKernels, TileKernels};
use super::packet::{F32x3, Fill, Narrow, Rgb8, Rgba8, RowSetup, ShadeRows};
use super::records::{Element as _, Sphere, SpherePlanes, TileSphere, Triangle, TrianglePlanes};
use super::tiles::{
    Around, Bounds, Farthest, NearerHalf, Nearest, SetUp, ShadeTile, SphereSetUp, SphereShading, Visible,
};
use super::types::Vec4;

/// Whether the compiler has an instruction that adds a product and rounds once.
pub const FUSED: bool = cfg!(any(target_feature = "fma", target_arch = "aarch64"));
/// The numbers of f32 that a register has for the compiler, or that are in order without one.
const LANES: usize = if cfg!(target_feature = "avx512f") {
    16
} else if cfg!(target_feature = "avx2") {
    8
} else {
    4
};

static PACKETS: PacketKernels = packets::<LANES, { LANES / 2 }, FUSED>();

/// The packet kernels in Rust, for what this build may ask of the CPU.
pub fn portable() -> &'static PacketKernels {
    &PACKETS
}

/// Packet kernels in Rust of so many lanes in f32, and half as many in f64, with one rounding of a product and a sum or with two.
pub const fn packets<const N: usize, const HALF: usize, const FUSED: bool>() -> PacketKernels {
    PacketKernels {
        single: elements::<Packet<f32, N, FUSED>, Packet<f64, HALF, FUSED>, f32>(),
        double: elements::<Packet<f64, HALF, FUSED>, Packet<f64, HALF, FUSED>, f64>(),
        fill: Fill::in_rust(|out, pattern| out.fill(pattern), "fill"),
        narrow_rgb8: Narrow::<Rgba8, Rgb8>::in_rust(rows::narrow_rgb8, "narrow_rgb8"),
        narrow_f32x3: Narrow::<Vec4, F32x3>::in_rust(rows::narrow_f32x3, "narrow_f32x3"),
        bounds: Bounds::<Triangle>::in_rust(set_up::bounds::<Packet<f32, N, FUSED>>, "bounds"),
        sphere_bounds: Bounds::<Sphere>::in_rust(spheres::bounds::<Packet<f64, HALF, FUSED>>, "sphere_bounds"),
        nearer_half: NearerHalf::in_rust(nearest::nearer_half, "nearer_half"),
        visible: Visible::in_rust(nearest::visible, "visible"),
    }
}

/// Those on one type of elements, of which blocks of pixels are L; what is set up is so in W.
const fn elements<L: Lanes<Number = E>, W: Lanes<Number = f64>, E: Number>() -> ElementKernels<E> {
    // With true roots where kernels in assembly have estimates, and with all three weights where they are equal.
    let lit = LitBodies {
        f32x4: ShadeRows::<E, Vec4>::in_rust(rows::shade_rows::<L, _>, "lit_f32x4"),
        f32x4_fast: ShadeRows::<E, Vec4>::in_rust(rows::shade_rows::<L, _>, "lit_f32x4"),
        f32x3: ShadeRows::<E, F32x3>::in_rust(rows::shade_rows::<L, _>, "lit_f32x3"),
        f32x3_fast: ShadeRows::<E, F32x3>::in_rust(rows::shade_rows::<L, _>, "lit_f32x3"),
        rgba8: ShadeRows::<E, Rgba8>::in_rust(rows::shade_rows::<L, _>, "lit_rgba8"),
        rgb8: ShadeRows::<E, Rgb8>::in_rust(rows::shade_rows::<L, _>, "lit_rgb8"),
    };
    ElementKernels {
        lanes: L::COUNT,
        fused: L::FUSED,
        lit_rows: RowSetup::<E>::in_rust(rows::lit_rows::<W, E>, "lit_rows"),
        lit,
        grey: lit,
        tiles: TileKernels {
            set_up: SetUp::<E>::in_rust(set_up::set_up::<W, E>, "set_up"),
            nearest_triangles: Nearest::<TrianglePlanes<E>>::in_rust(nearest::nearest::<L, _>, "nearest_triangles"),
            around: Around::<E>::in_rust(nearest::around::<L, W>, "around"),
            farthest: Farthest::<E>::in_rust(nearest::farthest::<L>, "farthest"),
            sphere_set_up: SphereSetUp::<E>::in_rust(spheres::set_up::<W, E>, "sphere_set_up"),
            nearest_spheres: Nearest::<SpherePlanes<E>>::in_rust(nearest::nearest::<L, _>, "nearest_spheres"),
            sphere_shading: SphereShading::<E>::in_rust(spheres::shading::<W, E>, "sphere_shading"),
            f32x4: ShadeTile::<E, Vec4>::in_rust(shade::shade::<L, _>, "tile_f32x4"),
            f32x4_fast: ShadeTile::<E, Vec4>::in_rust(shade::shade::<L, _>, "tile_f32x4"),
            rgba8: ShadeTile::<E, Rgba8>::in_rust(shade::shade::<L, _>, "tile_rgba8"),
        },
    }
}

/// n / t at a pixel so far from a sphere's own origin, by the operations of kernels in f32 (`single`) or f64, with one rounding of
/// a product and a sum or with two.
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
