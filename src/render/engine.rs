//! The engines by name: which there are, which this machine runs, and how to get one ready for a scene.

use std::fmt;
use std::str::FromStr;

use super::Tracer;
#[cfg(rayo_asm)]
use super::aos::AosTracer;
use super::reference::ReferenceTracer;
use super::rust::RustTracer;
#[cfg(rayo_asm)]
use crate::kernels;
use crate::scene::{Camera, Scene};

/// Who computes the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Engine {
    /// Pure Rust in f64: the truth.
    Reference,
    /// Pure Rust in f32, with glam's `Vec3A`.
    Rust,
    /// The paper's C at -O3.
    #[cfg(rayo_asm)]
    C,
    /// The paper's NASM macros, one vector in one register.
    #[cfg(rayo_asm)]
    Paper,
}

/// In what numbers an engine computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// f32, with correctly rounded operations.
    Single,
    /// f64.
    Double,
}

/// Why there is no such engine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// No engine of that name in this build.
    #[error("there is no engine `{name}`{}; this build has: {}", if *known { " in this build" } else { "" }, available())]
    Unknown {
        /// As it was asked for.
        name: String,
        /// Whether another build has it.
        known: bool,
    },
    /// This CPU does not run it.
    #[error("this CPU does not run the engine `{0}`, which needs {1}; it runs: {list}", list = available())]
    Unusable(Engine, &'static str),
    /// No precision of that name.
    #[error("there is no precision `{0}`; there are: single, double")]
    UnknownPrecision(String),
    /// The engine has not got that precision.
    #[error("the engine `{0}` does not compute in {1}; it has: {has}", has = .0.precision())]
    NoPrecision(Engine, Precision),
}

/// The engines that can be used here, in words.
fn available() -> String {
    let names: Vec<_> = Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name()).collect();
    names.join(", ") + ", auto"
}

impl Engine {
    /// Every engine of this build.
    #[cfg(rayo_asm)]
    pub const ALL: &[Engine] = &[Engine::Reference, Engine::Rust, Engine::C, Engine::Paper];
    /// Every engine of this build.
    #[cfg(not(rayo_asm))]
    pub const ALL: &[Engine] = &[Engine::Reference, Engine::Rust];

    /// The name that users type.
    pub fn name(self) -> &'static str {
        match self {
            Engine::Reference => "reference",
            Engine::Rust => "rust",
            #[cfg(rayo_asm)]
            Engine::C => "c",
            #[cfg(rayo_asm)]
            Engine::Paper => "paper",
        }
    }

    /// Whether this CPU runs it.
    pub fn usable(self) -> bool {
        match self {
            Engine::Reference | Engine::Rust => true,
            #[cfg(rayo_asm)]
            Engine::C => true,
            #[cfg(rayo_asm)]
            Engine::Paper => kernels::paper().is_some(),
        }
    }

    /// The fastest engine that this CPU runs: what `auto` means.
    pub fn fastest() -> Engine {
        #[cfg(rayo_asm)]
        if Engine::Paper.usable() {
            return Engine::Paper;
        }
        Engine::Rust
    }

    /// The precision that it computes in.
    pub fn precision(self) -> Precision {
        match self {
            Engine::Reference => Precision::Double,
            _ => Precision::Single,
        }
    }

    /// Gets it ready for `scene` as `camera` sees it, in `precision` (None: its own).
    pub fn prepare(
        self,
        precision: Option<Precision>,
        scene: &Scene,
        camera: &Camera,
    ) -> Result<Box<dyn Tracer>, EngineError> {
        if let Some(precision) = precision.filter(|precision| *precision != self.precision()) {
            return Err(EngineError::NoPrecision(self, precision));
        }
        Ok(match self {
            Engine::Reference => Box::new(ReferenceTracer::new(scene, camera)),
            Engine::Rust => Box::new(RustTracer::new(scene, camera)),
            #[cfg(rayo_asm)]
            Engine::C => Box::new(AosTracer::new(kernels::c(), scene, camera)),
            #[cfg(rayo_asm)]
            Engine::Paper => {
                let kernels = kernels::paper().ok_or(EngineError::Unusable(self, "SSE4.1"))?;
                Box::new(AosTracer::new(kernels, scene, camera))
            }
        })
    }
}

impl FromStr for Engine {
    type Err = EngineError;

    /// An engine that can be used here, by its name or as `auto`.
    fn from_str(name: &str) -> Result<Self, EngineError> {
        if name == "auto" {
            return Ok(Engine::fastest());
        }
        let engine = Engine::ALL.iter().find(|engine| engine.name() == name);
        engine.copied().ok_or_else(|| EngineError::Unknown { name: name.into(), known: ["c", "paper"].contains(&name) })
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Precision {
    /// The name that users type.
    pub fn name(self) -> &'static str {
        match self {
            Precision::Single => "single",
            Precision::Double => "double",
        }
    }
}

impl FromStr for Precision {
    type Err = EngineError;

    fn from_str(name: &str) -> Result<Self, EngineError> {
        let all = [Precision::Single, Precision::Double];
        all.into_iter().find(|p| p.name() == name).ok_or_else(|| EngineError::UnknownPrecision(name.into()))
    }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
