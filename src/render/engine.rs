//! The engines by name: which of them exist, which this machine supports, and what each can do.

use std::fmt;
use std::str::FromStr;

use super::plan::Plan;
use super::tiles::MOST_LIGHTS;
use super::{PixelFormat, Tracer};
use crate::kernels::{self, Isa, PacketKernels};
use crate::plan::{Cancel, Keep, Omission, lights};
use crate::scene::{InvalidScene, Scene, brief};

/// An implementation that computes pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Engine {
    /// Pure Rust in f64, with which all others are compared.
    Reference,
    /// Pure Rust in f32, with glam's `Vec3A`.
    Rust,
    /// The paper's C at -O3.
    C,
    /// The paper's NASM macros, one vector in one register.
    Paper,
    /// Packets in Rust: as many rays at a time as a vector has lanes.
    Portable,
    /// Packets in NASM, for an instruction set: 4, 8 or 16 rays at a time.
    Packet(Isa),
}

/// What an engine is prepared for.
#[derive(Clone, Copy, Debug, Default)]
pub struct Purpose<'a> {
    /// The precision; None for the engine's own.
    pub precision: Option<Precision>,
    /// The only format that the engine will have to write, apart from the one that differs from it
    /// only in the number of channels; None for any format.
    pub format: Option<PixelFormat>,
    /// The omissions that are switched off.
    pub keep: Keep,
    /// The number of threads that plan; 0 means 1. Pictures do not depend on it.
    pub threads: usize,
    /// Stops planning if it is set; None if nothing stops it.
    pub cancel: Option<&'a Cancel>,
    /// Whether the film is a band of the picture that is used again for the next band, and
    /// therefore stays in the caches.
    pub in_bands: bool,
}

/// The number format in which an engine computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// f32, with correctly rounded operations.
    Single,
    /// f32, with estimates of roots and reciprocals where only the shade depends on them.
    Fast,
    /// f64.
    Double,
}

/// Why an engine cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// This build has no engine of that name.
    #[error(
        "there is no engine `{}`{}; this build has: {}",
        brief(name),
        near.map_or("".into(), |n| if n == name { " in this build".into() } else { format!(", did you mean `{n}`?") }),
        listed(|_| true) + ", auto"
    )]
    Unknown {
        /// The name given.
        name: String,
        /// The name of an engine that the user probably meant, or that other builds have.
        near: Option<&'static str>,
    },
    /// This CPU does not support the engine.
    #[error("this CPU does not run the engine `{0}`; it runs: {list}", list = listed(Engine::usable) + ", auto")]
    Unusable(Engine),
    /// There is no precision of that name.
    #[error("there is no precision `{}`; there are: single, fast, double", brief(.0))]
    UnknownPrecision(String),
    /// The engine does not have that precision.
    #[error("the engine `{0}` does not compute in {1}; it has: {has}", has = names(.0.precisions()))]
    NoPrecision(Engine, Precision),
    /// The scene has shadows, which the engine does not have.
    #[error("the engine `{0}` has no shadows, as in the paper: leave them out or ask one of {has}",
        has = listed(|engine| engine.usable() && engine.has_shadows()))]
    NoShadows(Engine),
    /// The scene has more lights than the engine takes.
    #[error(
        "the engine `{engine}` takes at most {} lights, and the scene has {lights}: ask rust or reference",
        MOST_LIGHTS
    )]
    Lights {
        /// The engine.
        engine: Engine,
        /// The number of lights that are not dark.
        lights: usize,
    },
    /// [`Purpose::cancel`] stopped planning.
    #[error("planning was stopped")]
    Cancelled,
    /// The scene has an invalid number.
    #[error("the scene cannot be traced: {0}")]
    Scene(#[from] InvalidScene),
}

/// The names of those engines of this build that are wanted, as text.
fn listed(is_wanted: fn(Engine) -> bool) -> String {
    let engines = Engine::ALL.iter().filter(|engine| is_wanted(**engine));
    engines.map(|engine| engine.name()).collect::<Vec<_>>().join(", ")
}

/// The names of precisions, as text.
fn names(precisions: &[Precision]) -> String {
    precisions.iter().map(|precision| precision.name()).collect::<Vec<_>>().join(", ")
}

impl Engine {
    /// Every engine of this build.
    pub const ALL: &[Engine] = &[
        Engine::Reference,
        Engine::Rust,
        #[cfg(rayo_c)]
        Engine::C,
        #[cfg(rayo_asm)]
        Engine::Paper,
        Engine::Portable,
        #[cfg(rayo_asm)]
        Engine::Packet(Isa::Sse41),
        #[cfg(rayo_asm)]
        Engine::Packet(Isa::Avx2),
        #[cfg(rayo_asm)]
        Engine::Packet(Isa::Avx512),
    ];

    /// The engine's name in commands and documents.
    pub fn name(self) -> &'static str {
        match self {
            Engine::Reference => "reference",
            Engine::Rust => "rust",
            Engine::C => "c",
            Engine::Paper => "paper",
            Engine::Portable => "portable",
            Engine::Packet(isa) => isa.name(),
        }
    }

    /// Whether this CPU supports the engine. Only then can it be prepared.
    pub fn usable(self) -> bool {
        match self {
            Engine::Reference | Engine::Rust | Engine::Portable => true,
            Engine::C => kernels::c().is_some(),
            Engine::Paper => kernels::paper().is_some(),
            Engine::Packet(isa) => isa.usable(),
        }
    }

    /// The fastest engine that this CPU supports: the meaning of `auto`.
    pub fn fastest() -> Engine {
        let mut engines = Engine::ALL.iter().copied().filter(|engine| engine.usable());
        // The list goes from the slowest to the fastest, except that `c` is slower than `paper` and
        // all packets.
        engines.rfind(|engine| *engine != Engine::C).unwrap_or(Engine::Rust)
    }

    /// The engine's default precision.
    pub fn precision(self) -> Precision {
        self.precisions()[0]
    }

    /// The engine's precisions, the default first.
    pub fn precisions(self) -> &'static [Precision] {
        match self {
            Engine::Reference => &[Precision::Double],
            Engine::Portable => &[Precision::Single, Precision::Double],
            Engine::Packet(_) => &[Precision::Single, Precision::Fast, Precision::Double],
            _ => &[Precision::Single],
        }
    }

    /// Checks, without planning, whether [`Plan::new`] accepts a scene in a precision (None for the
    /// engine's own). The validity of the scene's numbers is not checked.
    ///
    /// # Errors
    /// Those of [`Plan::new`], except [`EngineError::Scene`] and [`EngineError::Cancelled`].
    pub fn takes(self, scene: &Scene, precision: Option<Precision>) -> Result<(), EngineError> {
        // An unsupported precision is an error for every engine.
        self.precision_for(precision)?;
        if scene.shadows && !self.has_shadows() {
            return Err(EngineError::NoShadows(self));
        }
        if !self.usable() {
            return Err(EngineError::Unusable(self));
        }
        let most_lights = if self.is_packet() { MOST_LIGHTS } else { usize::MAX };
        if scene.lights.len() > most_lights {
            // Lights that are dark do not count.
            let lights = lights(scene).len();
            if lights > most_lights {
                return Err(EngineError::Lights { engine: self, lights });
            }
        }
        Ok(())
    }

    /// Whether the engine traces rays in packets.
    pub fn is_packet(self) -> bool {
        matches!(self, Engine::Packet(_) | Engine::Portable)
    }

    /// Whether the engine traces scenes with shadows.
    pub fn has_shadows(self) -> bool {
        !matches!(self, Engine::C | Engine::Paper)
    }

    /// The engine's packet kernels, if it has any and this CPU supports them.
    #[doc(hidden)]
    pub fn packets(self) -> Option<&'static PacketKernels> {
        match self {
            Engine::Portable => Some(kernels::portable()),
            Engine::Packet(isa) => kernels::packets(isa),
            _ => None,
        }
    }

    /// Whether the engine computes its rays in f64, whatever its precision.
    pub fn rays_in_f64(self) -> bool {
        self == Engine::Reference || self.is_packet()
    }

    /// Prepares the engine for `scene`, in `precision` (None for its own), for any format that it
    /// writes.
    ///
    /// # Errors
    /// As [`Plan::new`].
    pub fn prepare(self, precision: Option<Precision>, scene: &Scene) -> Result<Box<dyn Tracer + '_>, EngineError> {
        Ok(Plan::new(self, scene, Purpose { precision, ..Purpose::default() })?.into_tracer())
    }

    /// The omissions that the engine makes where a scene allows them.
    pub fn omissions(self) -> &'static [Omission] {
        match self {
            Engine::Reference => &[Omission::Hidden],
            // For a triangle that is never hit, eq. 9 in f32 would return rounding errors as hits.
            Engine::Rust => &[Omission::NoArea, Omission::EdgeOn, Omission::Constants, Omission::Hidden],
            Engine::C | Engine::Paper => &[Omission::NoArea, Omission::EdgeOn],
            Engine::Portable | Engine::Packet(_) => &Omission::ALL,
        }
    }

    /// The format in which the engine computes for a file of three channels, which are bytes
    /// (`bytes`) or floats.
    pub fn format_for(self, bytes: bool) -> PixelFormat {
        match (self == Engine::Reference || self.is_packet(), bytes) {
            (true, true) => PixelFormat::Rgb8,
            (true, false) => PixelFormat::F32x3,
            (false, _) => PixelFormat::F32x4,
        }
    }

    /// The requested precision, if the engine has it, or the engine's own.
    pub(super) fn precision_for(self, precision: Option<Precision>) -> Result<Precision, EngineError> {
        let precision = precision.unwrap_or(self.precision());
        if !self.precisions().contains(&precision) {
            return Err(EngineError::NoPrecision(self, precision));
        }
        Ok(precision)
    }
}

impl FromStr for Engine {
    type Err = EngineError;

    /// Parses the name of an engine that can be used here, or `auto`.
    fn from_str(name: &str) -> Result<Self, EngineError> {
        if name == "auto" {
            return Ok(Engine::fastest());
        }
        let engine = Engine::ALL.iter().find(|engine| engine.name() == name);
        let names = ["reference", "rust", "c", "paper", "portable", "sse41", "avx2", "avx512", "auto"];
        let plain = name.replace(|c: char| !c.is_ascii_alphanumeric(), "").to_ascii_lowercase();
        let near = names.map(|name| (strsim::damerau_levenshtein(&plain, name), name)).into_iter().min();
        let near = near.filter(|(apart, near)| *apart < near.len().min(3)).map(|(_, near)| near);
        engine.copied().ok_or_else(|| EngineError::Unknown { name: name.into(), near })
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Precision {
    /// The precision's name in commands and documents.
    pub fn name(self) -> &'static str {
        match self {
            Precision::Single => "single",
            Precision::Fast => "fast",
            Precision::Double => "double",
        }
    }
}

impl FromStr for Precision {
    type Err = EngineError;

    fn from_str(name: &str) -> Result<Self, EngineError> {
        let all = [Precision::Single, Precision::Fast, Precision::Double];
        all.into_iter().find(|p| p.name() == name).ok_or_else(|| EngineError::UnknownPrecision(name.into()))
    }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
