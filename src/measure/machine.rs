//! The machine and the build that a figure belongs to.

use serde::Serialize;

use super::tsc_hz;

/// A figure without this is not a result. The field names are those of the JSON documents.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// The CPU's own name.
    pub cpu: Option<String>,
    /// Cores that this process may use.
    pub cores: usize,
    /// Operating system.
    pub os: &'static str,
    /// Ticks of the time-stamp counter in a second.
    pub tsc_hz: Option<f64>,
    /// Whether the CPU promises that the counter ticks at a constant rate.
    pub tsc_invariant: bool,
    /// Version of this program.
    pub version: &'static str,
    /// The assembler that made the kernels.
    pub nasm: Option<&'static str>,
    /// The C compiler that made the baseline.
    pub cc: Option<&'static str>,
    /// Its flags.
    pub cflags: Option<&'static str>,
    /// The Rust compiler.
    pub rustc: &'static str,
}

impl Machine {
    /// This machine and this build. Takes a twentieth of a second for the counter's rate.
    pub fn this() -> Self {
        Machine {
            cpu: cpu_name(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            os: std::env::consts::OS,
            tsc_hz: tsc_hz().map(f64::round),
            tsc_invariant: tsc_invariant().unwrap_or(false),
            version: env!("CARGO_PKG_VERSION"),
            nasm: option_env!("RAYO_NASM"),
            cc: option_env!("RAYO_CC"),
            cflags: option_env!("RAYO_CFLAGS"),
            rustc: env!("RAYO_RUSTC"),
        }
    }
}

/// The CPU's own name, where it gives one.
#[cfg(target_arch = "x86_64")]
pub fn cpu_name() -> Option<String> {
    let brand = raw_cpuid::CpuId::new().get_processor_brand_string()?;
    Some(brand.as_str().trim().to_owned())
}

/// The CPU's own name: not known on this architecture.
#[cfg(not(target_arch = "x86_64"))]
pub fn cpu_name() -> Option<String> {
    None
}

/// Whether the CPU promises that its time-stamp counter ticks at a constant rate; None where it says nothing of it.
#[cfg(target_arch = "x86_64")]
pub fn tsc_invariant() -> Option<bool> {
    raw_cpuid::CpuId::new().get_advanced_power_mgmt_info().map(|info| info.has_invariant_tsc())
}

/// Without a time-stamp counter: nothing to promise.
#[cfg(not(target_arch = "x86_64"))]
pub fn tsc_invariant() -> Option<bool> {
    None
}
