//! Kernels in assembly and C behind safe functions, and the system calls that measuring needs: the
//! only `unsafe`.

#![allow(unsafe_code)]

#[macro_use]
mod checked;
#[cfg(feature = "lab")]
mod alone;
pub mod built;
#[cfg(feature = "lab")]
mod by_value;
mod caches;
#[cfg(feature = "lab")]
mod code;
pub mod crash;
mod cycles;
mod faces;
#[cfg(all(unix, feature = "lab"))]
pub mod fences;
mod ffi;
mod floats;
#[cfg(all(unix, feature = "lab"))]
pub mod foreign;
pub mod harness;
mod isa;
mod kernel;
#[cfg(feature = "lab")]
pub mod ladder;
#[cfg(feature = "lab")]
mod lanes;
pub mod memory;
mod objects;
mod packet;
mod paper;
mod portable;
mod records;
mod shadows;
#[cfg(feature = "lab")]
pub mod step;
pub mod sys;
mod tiles;
mod types;
mod vec3;

#[cfg(feature = "lab")]
pub use alone::{Alone, alone};
#[cfg(feature = "lab")]
pub use by_value::{ByValue, Ray, by_value};
pub use caches::{Cache, caches};
pub use checked::Fault;
#[cfg(feature = "lab")]
pub use code::{code_at, constants_at};
pub use cycles::{Cycles, tsc_hz};
pub use faces::{ColourRun, Faces};
pub use ffi::{
    ALL_OPERATIONS, AosKernels, ElementKernels, LitBodies, OPERATIONS, PacketElement, PacketKernels, TileKernels, aos,
    c, chains_of_aos, chains_of_packets, chains_of_paper, feedback, hits_of_c, hits_of_paper, packet_op_codes,
    packet_op_symbols, packet_ops, packet_symbols, packets, paper,
};
pub use floats::StandardFloats;
pub use isa::Isa;
pub use kernel::{CheckedCall, Crashed, Examined, Kernel, examine};
#[cfg(feature = "lab")]
pub use lanes::{LaneObjects, LaneTracer, lane_symbols, lane_tracer};
pub use objects::{FacePart, ObjectList, TriangleList};
pub use packet::{F32x3, Narrow, Rgb8, Rgba8, RowSetup, ShadeRows};
pub use paper::{Hits, Op, OpRef, RowsOf, Trace};
pub use portable::{normal_over_t, portable};
pub use records::{
    AroundSphere, BoundsView, CHUNK, Candidate, CasterBounds, CasterEdges, Element, LightPosition, LitRow, LitSetup,
    LitSphere, ObjectLight, PART_SIDE, PointObject, PointView, ShortLight, Sphere, SphereHit, SphereView, TILE_HEIGHT,
    TILE_WIDTH, TileLight, TileRays, TileShade, TileSphere, TileView, Triangle, TriangleHit,
};
pub use records::{
    GROUP, LightSideView, LitGroups, MOST_CASTERS, SphereCaster, TILE_PIXELS, TilePoints, TriangleCaster,
};
pub use records::{LIT_ROWS, LitRows, SphereArrays, SpherePlanes, TriangleArrays, TrianglePlanes};
pub use shadows::{
    Cast, CasterList, Casters, Extent, GROUPS, LitPoints, Meet, MetCaster, Points, Seen, own_bits, own_number,
};
pub use tiles::{
    Around, Bounded, Bounds, CandidatesFound, Extremes, NearerHalf, Nearest, NearestAtPixel, PixelBounds, SetUp,
    ShadeTile, ShadingRecords, SphereChunk, SphereRecords, SphereSetUp, SphereShading, TILE_PARTS, TileBuffers,
    TileGrid, TileOut, TileWindow, TriangleChunk,
};
pub use types::{Frame, Light, Objects, PaperSphere, PaperTriangle, Plain, Surface, Vec4, bytes};
pub use vec3::{Chain, Chains, PacketChains, PacketOp, PacketOpCode, Shape};

/// The objects that build.rs assembled and compiled, with the names of their sources. They are
/// there to be disassembled.
#[cfg(feature = "lab")]
pub static OBJECTS: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/objects.rs"));

/// The tables of source lines that build.rs makes for the units with the engines' kernels.
/// lab/src/measure/source.rs reads them.
#[cfg(feature = "lab")]
pub static LINES: [&[u8]; Isa::ALL.len()] = [
    include_bytes!(concat!(env!("OUT_DIR"), "/sse41.lines")),
    include_bytes!(concat!(env!("OUT_DIR"), "/avx2.lines")),
    include_bytes!(concat!(env!("OUT_DIR"), "/avx512.lines")),
];
