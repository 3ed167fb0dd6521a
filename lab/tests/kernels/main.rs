//! The kernels: each against its twin, under the rules of calls, and as its listing has it.

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

/// The allocator of these tests, which puts arguments next to guard pages where a test asks for
/// that.
#[cfg(unix)]
#[global_allocator]
static ALLOCATOR: rayo::internals::kernels::fences::Fences = rayo::internals::kernels::fences::Fences;
