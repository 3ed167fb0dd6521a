//! Pictures: of every engine, right on every scene, the same however they are split and whatever is left out.

#[path = "../common/contenders.rs"]
mod contenders;
#[cfg(rayo_asm)]
#[allow(unsafe_code)]
#[path = "../common/counting.rs"]
mod counting;
#[path = "../common/extent.rs"]
mod extent;
#[cfg(feature = "cli")]
#[path = "../common/program.rs"]
mod program;
#[cfg(feature = "cli")]
#[path = "../common/schema.rs"]
mod schema;

#[cfg(feature = "cli")]
mod accuracy;
#[cfg(feature = "files")]
mod engines;
mod geometry;
#[cfg(feature = "cli")]
mod judge;
#[cfg(rayo_asm)]
mod memory;
#[cfg(feature = "cli")]
mod mixtures;
#[cfg(feature = "files")]
mod outputs;
#[cfg(all(rayo_asm, feature = "cli"))]
mod plan;
mod semantics;
mod shadows;
#[cfg(feature = "cli")]
mod stability;
#[cfg(rayo_asm)]
mod tiles;
