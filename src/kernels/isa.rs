//! The instruction sets for which kernels are written, and whether this CPU and its operating
//! system support them.

use std::fmt;

/// Whether the CPU has all of these features, and the operating system saves their registers. A CPU
/// that is not x86 has none.
macro_rules! detected {
    ($($feature:tt)*) => {{
        #[cfg(target_arch = "x86_64")]
        let found = $(std::is_x86_feature_detected!($feature))&&*;
        #[cfg(not(target_arch = "x86_64"))]
        let found = false;
        found
    }};
}

pub(super) use detected;

/// The highest x86-64 level of the psABI that this CPU supports.
#[cfg(feature = "lab")]
pub(super) fn psabi_level() -> u32 {
    let levels = [
        detected!("cmpxchg16b" "popcnt" "sse3" "sse4.1" "sse4.2" "ssse3"),
        detected!("avx" "avx2" "bmi1" "bmi2" "f16c" "fma" "lzcnt" "movbe"),
        detected!("avx512f" "avx512bw" "avx512cd" "avx512dq" "avx512vl"),
    ];
    1 + levels.into_iter().take_while(|has| *has).count() as u32
}

/// An instruction set. They are ordered: where a CPU has two, the later one is faster.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Isa {
    /// SSE4.1: 128-bit registers.
    Sse41,
    /// AVX2 and FMA: 256-bit registers.
    Avx2,
    /// AVX-512 F, VL, DQ and BW, BMI2 and POPCNT: 512-bit registers and masks.
    Avx512,
}

impl Isa {
    /// All instruction sets, in the order of their indices in tables.
    pub const ALL: [Isa; 3] = [Isa::Sse41, Isa::Avx2, Isa::Avx512];

    /// The name, which users type and which is part of kernels' symbols.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Sse41 => "sse41",
            Isa::Avx2 => "avx2",
            Isa::Avx512 => "avx512",
        }
    }

    /// The number of f32 in a register, which is `LANES` in a unit for elements of four bytes.
    pub fn lanes(self) -> usize {
        match self {
            Isa::Sse41 => 4,
            Isa::Avx2 => 8,
            Isa::Avx512 => 16,
        }
    }

    /// Whether this build has the instruction set's kernels.
    pub fn built(self) -> bool {
        cfg!(rayo_asm)
    }

    /// Whether this build has the kernels, the CPU has their instructions, and the operating system
    /// saves their registers.
    pub fn usable(self) -> bool {
        self.built()
            && match self {
                Isa::Sse41 => detected!("sse3" "ssse3" "sse4.1"),
                Isa::Avx2 => detected!("avx" "avx2" "fma"),
                Isa::Avx512 => {
                    detected!("avx" "avx2" "fma" "bmi1" "bmi2" "popcnt" "avx512f" "avx512vl" "avx512dq" "avx512bw")
                }
            }
    }
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
