//! The kernels: each against its twin, under the rules of calls, and as its listing has it.

#![cfg(rayo_asm)]

#[path = "../common/extent.rs"]
mod extent;
#[cfg(unix)]
#[allow(unsafe_code)]
#[path = "../common/fences.rs"]
mod fences;
#[path = "../common/kernel_cases.rs"]
mod kernel_cases;

#[cfg(all(target_os = "linux", feature = "lab"))]
mod assembly;
#[cfg(unix)]
mod calling_convention;
#[cfg(all(target_os = "linux", feature = "lab"))]
mod counted;
#[cfg(feature = "lab")]
mod formats;
#[cfg(feature = "lab")]
mod lanes;
#[cfg(feature = "lab")]
mod operations;
#[cfg(unix)]
mod packets;
#[cfg(unix)]
mod safe_calls;
#[cfg(feature = "lab")]
mod step_model;
