//! Kernels in assembly and C behind safe functions, and the system calls that measuring needs: the only `unsafe`.

#![allow(unsafe_code)]

#[cfg(rayo_asm)]
mod by_value;
#[cfg(rayo_asm)]
mod chains;
#[cfg(rayo_asm)]
mod checked;
mod code;
#[cfg(rayo_asm)]
mod ffi;
mod isa;
#[cfg(rayo_asm)]
mod known;
#[cfg(rayo_asm)]
pub mod ladder;
#[cfg(rayo_asm)]
mod packet;
mod spans;
pub mod step;
pub mod sys;
mod tiles;
mod types;
#[cfg(rayo_asm)]
mod vec3;

#[cfg(rayo_asm)]
pub use by_value::{ByValue, Ray, by_value};
#[cfg(rayo_asm)]
pub use chains::{Chain, Chains, FEEDBACK, PacketChains, chains_of_aos, chains_of_packets, chains_of_paper};
#[cfg(rayo_asm)]
pub use checked::{BROKEN, Broken, Fault, broken_read, broken_write};
pub use code::code_at;
#[cfg(rayo_asm)]
pub use ffi::{AosKernels, Hits, Op, OpRef, RowsOf, Trace, aos, c, hits_of_c, hits_of_paper, paper};
pub use isa::Isa;
#[cfg(rayo_asm)]
pub use known::{KNOWN, Known};
#[cfg(rayo_asm)]
pub use packet::{
    Bodies, Depth, Emit, F32x3, Fill, LitBodies, LitPlanes, PacketKernels, Planes, Rgb8, Rgba8, Row, RowSetup, Shade,
    ShadeRows, SpanKernels, TileKernels, packet_symbols, packets,
};
pub use spans::{
    Element, InsideSpan, LIT_ROWS, Lit, LitRow, LitRows, LitSetup, LitSphere, NearSpan, OutsideSpan, Span, SphereHit,
    TriangleHit, TriangleSpan,
};
pub use tiles::{
    Ball, Balls, BoundsView, CHUNK, Corners, Facet, Seen, ShortLit, SpherePlanes, SphereView, TILE_HEIGHT, TILE_WIDTH,
    TileLight, TilePoint, TileRays, TileShade, TileSphere, TileView, TrianglePlanes,
};
#[cfg(rayo_asm)]
pub use tiles::{
    Bounded, Bounds, Extremes, Looks, NearerHalf, Nearest, PixelBounds, SetUp, ShadeTile, SphereLooks, SphereRecords,
    SphereSetUp, Spheres, TileBuffers, TileGrid, TileOut, TileWindow, Triangles,
};
pub use types::{Frame, Light, Lists, Objects, Plain, Sphere, Surface, Triangle, Vec4};
#[cfg(rayo_asm)]
pub use vec3::{PacketElement, PacketOp, Shape, packet_op_symbols, packet_ops};

/// The objects that build.rs assembled and compiled, by the names of their sources, for who wants to disassemble them.
#[cfg(rayo_asm)]
pub static OBJECTS: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/objects.rs"));
