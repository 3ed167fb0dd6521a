//! The program: each command as users call it.

#[path = "../../../tests/common/extent.rs"]
mod extent;
#[path = "../common/program.rs"]
mod program;
#[cfg(target_os = "linux")]
#[allow(unsafe_code)]
#[path = "../common/refused.rs"]
mod refused;
#[path = "../common/schema.rs"]
mod schema;

mod accuracy;
mod development;
mod diff;
mod docs;
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
mod experiment;
mod guidance;
mod hosts;
mod limits;
mod lone_meshes;
mod models;
#[cfg(all(feature = "asm", target_arch = "x86_64", target_os = "linux"))]
mod ops;
mod output;
mod pictures;
mod place;
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
mod plan;
mod preview;
mod render_options;
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
mod report;
mod scene_files;
mod stability;
#[cfg(all(feature = "asm", target_arch = "x86_64", target_os = "linux"))]
mod step;
#[cfg(all(feature = "asm", target_arch = "x86_64", target_os = "linux"))]
mod try_kernel;
mod usage;

/// Whether this build has kernels in assembly, which `rayo step` follows.
const CAN_STEP: bool = cfg!(all(feature = "asm", target_arch = "x86_64", target_os = "linux"));
