//! Kernels in assembly and C behind safe functions, and the system calls that measuring needs: the only `unsafe`.

#![allow(unsafe_code)]

#[cfg(all(rayo_asm, feature = "lab"))]
mod by_value;
#[cfg(rayo_asm)]
mod checked;
#[cfg(feature = "lab")]
mod code;
mod faces;
#[cfg(rayo_asm)]
mod ffi;
#[cfg(all(rayo_asm, unix))]
mod guarded;
#[cfg(rayo_asm)]
#[doc(hidden)]
pub mod harness;
mod isa;
#[cfg(rayo_asm)]
mod kernel;
#[cfg(all(rayo_asm, feature = "lab"))]
pub mod ladder;
#[cfg(rayo_asm)]
mod objects;
#[cfg(rayo_asm)]
mod packet;
#[cfg(rayo_asm)]
mod paper;
mod records;
#[cfg(feature = "lab")]
pub mod step;
pub mod sys;
#[cfg(rayo_asm)]
mod tiles;
mod types;
#[cfg(rayo_asm)]
mod vec3;

#[cfg(all(rayo_asm, feature = "lab"))]
pub use by_value::{ByValue, Ray, by_value};
#[cfg(rayo_asm)]
pub use checked::Fault;
#[cfg(feature = "lab")]
pub use code::code_at;
pub use faces::{ColourRun, Faces};
#[cfg(rayo_asm)]
pub use ffi::{
    AosKernels, Bodies, FEEDBACK, InRow, LitBodies, PacketElement, PacketKernels, SpanKernels, TileKernels, aos, c,
    chains_of_aos, chains_of_packets, chains_of_paper, hits_of_c, hits_of_paper, packet_op_symbols, packet_ops,
    packet_symbols, packets, paper,
};
pub use isa::Isa;
#[cfg(rayo_asm)]
pub use kernel::Kernel;
#[cfg(rayo_asm)]
pub use objects::{FacePart, Facets, ObjectList};
#[cfg(rayo_asm)]
pub use packet::{Depth, Emit, F32x3, Fill, LitPlanes, Narrow, Planes, Rgb8, Rgba8, Row, RowSetup, Shade, ShadeRows};
#[cfg(rayo_asm)]
pub use paper::{Hits, Op, OpRef, RowsOf, Trace};
pub use records::{
    Ball, BoundsView, CHUNK, Element, Facet, InsideSpan, LitRow, LitSetup, LitSphere, NearSpan, ObjectLight,
    OutsideSpan, PART_SIDE, Seen, ShortLight, Span, SphereHit, SphereView, TILE_HEIGHT, TILE_WIDTH, TileLight,
    TilePoint, TileRays, TileShade, TileSphere, TileView, TriangleHit, TriangleSpan,
};
#[cfg(rayo_asm)]
pub use records::{Balls, Corners, LIT_ROWS, LitRows, SpherePlanes, TrianglePlanes};
#[cfg(rayo_asm)]
pub use tiles::{
    Bounded, Bounds, Extremes, Farthest, InTile, Looks, NearerHalf, Nearest, Parts, PixelBounds, SetUp, ShadeTile,
    SphereLooks, SphereRecords, SphereSetUp, Spheres, TILE_PARTS, TileBuffers, TileGrid, TileOut, TileWindow,
    Triangles, Visible,
};
pub use types::{Frame, Light, Objects, Plain, Sphere, Surface, Triangle, Vec4};
#[cfg(rayo_asm)]
pub use vec3::{Chain, Chains, PacketChains, PacketOp, Shape};

/// The objects that build.rs assembled and compiled, by the names of their sources, for those who want to disassemble them.
#[cfg(all(rayo_asm, feature = "lab"))]
pub static OBJECTS: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/objects.rs"));

/// The tables of source lines that build.rs made of the units with the engines' kernels; `measure::source` reads them.
#[cfg(all(rayo_asm, feature = "lab"))]
pub(crate) static LINES: [&[u8]; 3] = [
    include_bytes!(concat!(env!("OUT_DIR"), "/sse41.lines")),
    include_bytes!(concat!(env!("OUT_DIR"), "/avx2.lines")),
    include_bytes!(concat!(env!("OUT_DIR"), "/avx512.lines")),
];
