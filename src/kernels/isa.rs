//! The instruction sets that kernels are written for, and whether this CPU and its operating system run them.

use std::fmt;

/// An instruction set, in ascending order of width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Isa {
    /// SSE4.1: 128-bit registers.
    Sse41,
}

impl Isa {
    /// Every one, narrowest first.
    pub const ALL: [Isa; 1] = [Isa::Sse41];

    /// The name that users type and kernels carry.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Sse41 => "sse41",
        }
    }

    /// Whether this build has its kernels.
    pub fn built(self) -> bool {
        cfg!(rayo_asm)
    }

    /// Whether this build has its kernels, the CPU runs them, and the operating system saves their registers.
    pub fn usable(self) -> bool {
        #[cfg(rayo_asm)]
        return match self {
            Isa::Sse41 => is_x86_feature_detected!("sse4.1"),
        };
        #[cfg(not(rayo_asm))]
        return false;
    }
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
