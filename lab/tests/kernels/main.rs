//! Tests of the kernels: against their twins in Rust, under the rules of checked calls, and of
//! their code.

#![cfg(all(feature = "asm", target_arch = "x86_64"))]

#[path = "../../../tests/common/extent.rs"]
mod extent;
#[path = "../common/kernel_cases.rs"]
mod kernel_cases;

#[cfg(target_os = "linux")]
mod assembly;
#[cfg(unix)]
mod calling_convention;
#[cfg(target_os = "linux")]
mod counted;
#[cfg(target_os = "linux")]
mod crashes;
mod formats;
mod lanes;
mod operations;
#[cfg(unix)]
mod packets;
#[cfg(target_os = "linux")]
mod proofs;
#[cfg(unix)]
mod safe_calls;
mod step_model;

/// The allocator of these tests, which can place arguments next to guard pages.
#[cfg(unix)]
#[global_allocator]
static ALLOCATOR: rayo::internals::kernels::fences::Fences = rayo::internals::kernels::fences::Fences;
