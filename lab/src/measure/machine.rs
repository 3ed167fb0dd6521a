//! The machine and the build that a measurement was made with.

use std::sync::OnceLock;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::Name;
use super::core_cycles_per_tick;
use rayo::internals::kernels::sys::cores;
use rayo::internals::kernels::{Cache, built, caches, tsc_hz};

/// The commit that the program was built from, which the program sets.
static COMMIT: OnceLock<&'static str> = OnceLock::new();

/// A machine and a build, without which a measured figure means little. The fields have their JSON
/// names.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Machine {
    /// The name that the CPU reports, which makers give to several generations.
    pub cpu: Option<String>,
    /// The CPU's family, in its maker's numbering.
    pub family: Option<u32>,
    /// The CPU's model within the family.
    pub model: Option<u32>,
    /// The CPU's stepping.
    pub stepping: Option<u32>,
    /// The maker's name for this family and model, if it is a known one.
    #[serde(default)]
    pub microarchitecture: Option<Name>,
    /// The core's own cycles per second, measured once at the start. They may change with load and
    /// temperature.
    pub core_hz: Option<f64>,
    /// Cores that this process may use.
    pub cores: usize,
    /// Data caches, nearest first; empty if the operating system does not report them.
    pub caches: Vec<Cache>,
    /// The name of the operating system.
    pub os: Name,
    /// The release of the operating system's kernel, if it is known.
    pub kernel: Option<String>,
    /// The name of the hypervisor; None without one.
    pub hypervisor: Option<String>,
    /// The date of the measurement, in UTC: 2026-01-31T12:00:00Z.
    pub date: Option<String>,
    /// Ticks of the time-stamp counter per second.
    pub tsc_hz: Option<f64>,
    /// Whether the CPU promises that the counter ticks at a constant rate.
    pub tsc_invariant: bool,
    /// The version of this program.
    pub version: Name,
    /// The commit that was checked out when the program was built; uncommitted changes do not show.
    /// None for a build from a package.
    #[serde(default)]
    pub commit: Option<Name>,
    /// The assembler that built the kernels.
    pub nasm: Option<Name>,
    /// The C compiler that built the baseline.
    pub cc: Option<Name>,
    /// The flags of the C compiler.
    pub cflags: Option<Name>,
    /// The Rust compiler that built the program.
    pub rustc: Name,
}

impl Machine {
    /// Describes this machine and this build. Measuring the counter's rate takes a twentieth of a
    /// second.
    pub fn this() -> Self {
        let tsc_hz = tsc_hz();
        let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease");
        Machine {
            cores: cores(),
            caches: caches(),
            os: std::env::consts::OS.into(),
            kernel: kernel.ok().map(|release| release.trim().to_owned()),
            date: SystemTime::UNIX_EPOCH.elapsed().ok().map(|since| date(since.as_secs())),
            tsc_hz: tsc_hz.map(f64::round),
            core_hz: tsc_hz.map(|hz| (hz * core_cycles_per_tick()).round()),
            version: env!("CARGO_PKG_VERSION").into(),
            commit: COMMIT.get().copied().map(Into::into),
            nasm: built::NASM.map(Into::into),
            cc: built::CC.map(Into::into),
            cflags: built::CFLAGS.map(Into::into),
            rustc: built::RUSTC.into(),
            ..of_cpu()
        }
    }

    /// The CPU's name and its generation, as text.
    pub fn cpu(&self) -> String {
        let name = self.cpu.as_deref().unwrap_or("an unknown CPU");
        let (Some(family), Some(model)) = (self.family, self.model) else { return name.to_owned() };
        let of = self.microarchitecture.as_ref().map(|of| format!("{of}, ")).unwrap_or_default();
        format!("{name} ({of}family {family} model {model})")
    }

    /// All facts as pairs of a label and a value.
    pub fn facts(&self) -> impl Iterator<Item = (&'static str, String)> {
        let gigahertz = |hz: f64| format!("{:.3} GHz", hz / 1e9);
        let promise = if self.tsc_invariant { "invariant" } else { "not known to be invariant" };
        let caches: Vec<_> = self.caches.iter().map(|of| format!("L{} {} KiB", of.level, of.bytes >> 10)).collect();
        let kernel = self.kernel.as_ref().map(|release| format!(", kernel {release}"));
        let hypervisor = self.hypervisor.as_ref().map(|name| format!(", under {name}"));
        let of =
            |text: &Option<Name>, what| text.as_deref().map_or(format!("none (built without {what})"), str::to_owned);
        [
            ("version", Some(self.version.to_string())),
            ("commit", self.commit.as_ref().map(ToString::to_string)),
            ("date", self.date.clone()),
            ("CPU", Some(self.cpu())),
            ("stepping", self.stepping.map(|stepping| stepping.to_string())),
            ("cores", Some(self.cores.to_string())),
            ("core clock", self.core_hz.map(|hz| format!("{}, measured", gigahertz(hz)))),
            ("time stamps", Some(self.tsc_hz.map_or("none".into(), |hz| format!("{}, {promise}", gigahertz(hz))))),
            ("caches", Some(caches.join(", ")).filter(|caches| !caches.is_empty())),
            ("system", Some([Some(self.os.to_string()), kernel, hypervisor].into_iter().flatten().collect())),
            ("NASM", Some(of(&self.nasm, "assembly"))),
            ("C compiler", Some(of(&self.cc, "C"))),
            ("C flags", Some(of(&self.cflags, "C"))),
            ("Rust", Some(self.rustc.to_string())),
        ]
        .into_iter()
        .filter_map(|(name, value)| Some((name, value?)))
    }
}

/// Makes [`Machine::this`] name the commit that the program was built from.
pub fn set_commit(commit: &'static str) {
    COMMIT.get_or_init(|| commit);
}

/// The time in UTC of a number of seconds since 1970, by a calendar whose years begin in March, so
/// that the leap day is the last one.
fn date(second: u64) -> String {
    let day = second / 86_400 + 719_468; // since the first of March of the year 0
    let (era, of_era) = (day / 146_097, day % 146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let (day, month) = (of_year - (153 * month + 2) / 5 + 1, (month + 2) % 12 + 1);
    let year = 400 * era + year + u64::from(month < 3);
    let (hour, minute, second) = (second / 3600 % 24, second / 60 % 60, second % 60);
    format!("{year}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// What the CPU reports of itself.
#[cfg(target_arch = "x86_64")]
fn of_cpu() -> Machine {
    let cpuid = raw_cpuid::CpuId::new();
    let numbers = cpuid.get_feature_info().map(|info| [info.family_id(), info.model_id(), info.stepping_id()]);
    let [family, model, stepping] = [0, 1, 2].map(|place| Some(u32::from(numbers?[place])));
    Machine {
        cpu: cpuid.get_processor_brand_string().map(|brand| brand.as_str().trim().to_owned()),
        family,
        model,
        stepping,
        microarchitecture: microarchitecture(&cpuid).map(Into::into),
        hypervisor: cpuid.get_hypervisor_info().map(|info| format!("{:?}", info.identify())),
        tsc_invariant: cpuid.get_advanced_power_mgmt_info().is_some_and(|info| info.has_invariant_tsc()),
        ..Machine::default()
    }
}

/// What the CPU reports of itself, which is nothing on this architecture.
#[cfg(not(target_arch = "x86_64"))]
fn of_cpu() -> Machine {
    Machine::default()
}

/// The name of a microarchitecture of AMD or Intel, after the tables in Linux's `arch/x86`. None if
/// a hypervisor presents a CPU with AMX as an older model.
#[cfg(target_arch = "x86_64")]
fn microarchitecture(cpuid: &raw_cpuid::CpuId<raw_cpuid::CpuIdReaderNative>) -> Option<&'static str> {
    let info = cpuid.get_feature_info()?;
    let has_amx = cpuid.get_extended_feature_info().is_some_and(|info| info.has_amx_tile());
    Some(match (cpuid.get_vendor_info()?.as_str() == "AuthenticAMD", info.family_id(), info.model_id()) {
        (true, 0x17, 0x00..=0x2f | 0x50..=0x5f) => "Zen",
        (true, 0x17, _) => "Zen 2",
        (true, 0x19, 0x10..=0x1f | 0x60..=0xaf) => "Zen 4",
        (true, 0x19, 0x00..=0x5f) => "Zen 3",
        (true, 0x1a, 0x00..=0x4f | 0x60..=0x7f) => "Zen 5",
        (false, 6, model) if has_amx && !matches!(model, 0x8f | 0xcf | 0xad | 0xae) => return None,
        (false, 6, 0x3c | 0x3f | 0x45 | 0x46) => "Haswell",
        (false, 6, 0x3d | 0x47 | 0x4f | 0x56) => "Broadwell",
        (false, 6, 0x4e | 0x5e | 0x8e | 0x9e | 0xa5 | 0xa6) => "Skylake",
        (false, 6, 0x55) => "Skylake-X",
        (false, 6, 0x6a | 0x6c | 0x7d | 0x7e) => "Ice Lake",
        (false, 6, 0x8c | 0x8d) => "Tiger Lake",
        (false, 6, 0xa7) => "Rocket Lake",
        (false, 6, 0x8f) => "Sapphire Rapids",
        (false, 6, 0xcf) => "Emerald Rapids",
        (false, 6, 0xad | 0xae) => "Granite Rapids",
        (false, 6, 0x97 | 0x9a) => "Alder Lake",
        (false, 6, 0xb7 | 0xba | 0xbf) => "Raptor Lake",
        _ => return None,
    })
}

/// The name of this machine's CPU and its generation, as text.
pub fn cpu_name() -> String {
    of_cpu().cpu()
}

#[cfg(test)]
mod tests {
    use super::date;

    #[test]
    fn a_second_since_1970_is_a_date() {
        for (second, expected) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (951_868_800, "2000-03-01T00:00:00Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
            (1_798_761_599, "2026-12-31T23:59:59Z"),
        ] {
            assert_eq!(date(second), expected);
        }
    }
}
