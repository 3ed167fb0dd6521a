//! Tests of pictures: by every engine, they are right on every scene, and do not depend on how they
//! are split or on what is omitted.

#[path = "../common/contenders.rs"]
mod contenders;
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
#[allow(unsafe_code)]
#[path = "../../../tests/common/counting.rs"]
mod counting;
#[path = "../../../tests/common/extent.rs"]
mod extent;

mod accuracy;
mod engines;
mod geometry;
#[cfg(target_arch = "x86_64")]
mod hosts;
mod interactive;
mod judge;
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
mod memory;
mod mixtures;
mod outputs;
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
mod plan;
mod semantics;
mod shadows;
mod stability;
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
mod tiles;
