//! The machine and the build that a figure belongs to.

use serde::{Deserialize, Serialize};

use super::names::{self, Name};
use super::tsc_hz;

/// A figure without this is not a result. The field names are those of the JSON documents.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Machine {
    /// The CPU's own name.
    pub cpu: Option<String>,
    /// Cores that this process may use.
    pub cores: usize,
    /// Caches that hold data, nearest first; empty where the operating system does not tell.
    pub caches: Vec<Cache>,
    /// Operating system.
    #[serde(deserialize_with = "names::read")]
    pub os: Name,
    /// Ticks of the time-stamp counter in a second.
    pub tsc_hz: Option<f64>,
    /// Whether the CPU promises that the counter ticks at a constant rate.
    pub tsc_invariant: bool,
    /// Version of this program.
    #[serde(deserialize_with = "names::read")]
    pub version: Name,
    /// The assembler that made the kernels.
    #[serde(deserialize_with = "names::read_optional")]
    pub nasm: Option<Name>,
    /// The C compiler that made the baseline.
    #[serde(deserialize_with = "names::read_optional")]
    pub cc: Option<Name>,
    /// Its flags.
    #[serde(deserialize_with = "names::read_optional")]
    pub cflags: Option<Name>,
    /// The Rust compiler.
    #[serde(deserialize_with = "names::read")]
    pub rustc: Name,
}

/// A level of cache.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Cache {
    /// 1 is the nearest.
    pub level: u32,
    /// Its size.
    pub bytes: usize,
}

impl Machine {
    /// This machine and this build. Takes a twentieth of a second for the counter's rate.
    pub fn this() -> Self {
        Machine {
            cpu: cpu_name(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            caches: caches(),
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

/// The caches of the first core that hold data, as Linux tells.
pub fn caches() -> Vec<Cache> {
    let read = |index: u32, name: &str| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/{name}");
        Some(std::fs::read_to_string(path).ok()?.trim().to_owned())
    };
    let mut caches = Vec::new();
    for index in 0.. {
        let Some(kind) = read(index, "type") else { break };
        let size = read(index, "size").as_deref().and_then(cache_bytes);
        let level = read(index, "level").and_then(|level| level.parse().ok());
        if let (true, Some(level), Some(bytes)) = (kind != "Instruction", level, size) {
            caches.push(Cache { level, bytes });
        }
    }
    caches.sort_unstable_by_key(|cache| cache.level);
    caches
}

/// A size as Linux writes it: 32K, 1M.
fn cache_bytes(text: &str) -> Option<usize> {
    let digits = text.trim_end_matches(['K', 'M']);
    let unit = match &text[digits.len()..] {
        "" => 1,
        "K" => 1 << 10,
        "M" => 1 << 20,
        _ => return None,
    };
    digits.parse::<usize>().ok()?.checked_mul(unit)
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

#[cfg(test)]
mod tests {
    use super::cache_bytes;

    #[test]
    fn the_size_of_a_cache_is_read_as_linux_writes_it() {
        for (text, bytes) in
            [("32K", Some(32 << 10)), ("1M", Some(1 << 20)), ("512", Some(512)), ("", None), ("KK", None)]
        {
            assert_eq!(cache_bytes(text), bytes, "{text}");
        }
    }
}
