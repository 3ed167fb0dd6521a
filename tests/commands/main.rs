//! The program: each command as its user meets it.

#![cfg(feature = "cli")]

#[path = "../common/extent.rs"]
mod extent;
#[path = "../common/program.rs"]
mod program;
#[cfg(rayo_asm)]
#[path = "../common/schema.rs"]
mod schema;

mod command_line;
mod development;
#[cfg(rayo_asm)]
mod experiment;
#[cfg(all(rayo_asm, target_os = "linux"))]
mod ops;
mod preview;
#[cfg(rayo_asm)]
mod report;
#[cfg(all(rayo_asm, target_os = "linux"))]
mod step;
