//! The engines by name: which there are, which this machine runs, and how to get one ready for a scene.

use std::fmt;
use std::str::FromStr;

use super::Tracer;
#[cfg(rayo_asm)]
use super::aos::AosTracer;
#[cfg(rayo_asm)]
use super::packet::PacketTracer;
use super::reference::ReferenceTracer;
use super::rust::RustTracer;
#[cfg(rayo_asm)]
use super::tiles::TileTracer;
#[cfg(rayo_asm)]
use crate::kernels::{self, Element, Isa, PacketKernels, SpanKernels};
#[cfg(rayo_asm)]
use crate::plan;
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
    /// NASM packets, one ray in each lane.
    #[cfg(rayo_asm)]
    Packet(Isa),
}

/// In what numbers an engine computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// f32, with correctly rounded operations.
    Single,
    /// f32, with estimates of roots and reciprocals where only the shade depends on them.
    Fast,
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
    #[error("this CPU does not run the engine `{0}`; it runs: {list}", list = available())]
    Unusable(Engine),
    /// No precision of that name.
    #[error("there is no precision `{0}`; there are: single, fast, double")]
    UnknownPrecision(String),
    /// The engine has not got that precision.
    #[error("the engine `{0}` does not compute in {1}; it has: {has}", has = names(.0.precisions()))]
    NoPrecision(Engine, Precision),
}

/// The engines that can be used here, in words.
fn available() -> String {
    let names: Vec<_> = Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name()).collect();
    names.join(", ") + ", auto"
}

/// The precisions in words.
fn names(precisions: &[Precision]) -> String {
    precisions.iter().map(|precision| precision.name()).collect::<Vec<_>>().join(", ")
}

impl Engine {
    /// Every engine of this build.
    #[cfg(rayo_asm)]
    pub const ALL: &[Engine] = &[
        Engine::Reference,
        Engine::Rust,
        Engine::C,
        Engine::Paper,
        Engine::Packet(Isa::Sse41),
        Engine::Packet(Isa::Avx2),
        Engine::Packet(Isa::Avx512),
    ];
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
            #[cfg(rayo_asm)]
            Engine::Packet(isa) => isa.name(),
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
            #[cfg(rayo_asm)]
            Engine::Packet(isa) => isa.usable(),
        }
    }

    /// The fastest engine that this CPU runs: what `auto` means.
    pub fn fastest() -> Engine {
        let mut engines = Engine::ALL.iter().copied().filter(|engine| engine.usable());
        // They are listed from the slowest to the fastest, but for `c`, which is behind `paper` and every packet.
        engines.rfind(|engine| engine.name() != "c").unwrap_or(Engine::Rust)
    }

    /// The precision that it computes in unless it is asked for another.
    pub fn precision(self) -> Precision {
        self.precisions()[0]
    }

    /// The precisions that it has, its own first.
    pub fn precisions(self) -> &'static [Precision] {
        match self {
            Engine::Reference => &[Precision::Double],
            #[cfg(rayo_asm)]
            Engine::Packet(_) => &[Precision::Single, Precision::Fast, Precision::Double],
            _ => &[Precision::Single],
        }
    }

    /// Gets it ready for `scene` as `camera` sees it, in `precision` (None: its own).
    pub fn prepare<'a>(
        self,
        precision: Option<Precision>,
        scene: &'a Scene,
        camera: &Camera,
    ) -> Result<Box<dyn Tracer + 'a>, EngineError> {
        let precision = precision.unwrap_or(self.precision());
        if !self.precisions().contains(&precision) {
            return Err(EngineError::NoPrecision(self, precision));
        }
        Ok(match self {
            Engine::Reference => Box::new(ReferenceTracer::new(scene, camera)),
            Engine::Rust => Box::new(RustTracer::new(scene, camera)),
            #[cfg(rayo_asm)]
            Engine::C => Box::new(AosTracer::new(kernels::c(), scene, camera)),
            #[cfg(rayo_asm)]
            Engine::Paper => {
                let kernels = kernels::paper().ok_or(EngineError::Unusable(self))?;
                Box::new(AosTracer::new(kernels, scene, camera))
            }
            #[cfg(rayo_asm)]
            Engine::Packet(isa) => packet_tracer(isa, precision, scene, camera, Order::Planned)?,
        })
    }

    /// Gets a packet engine ready to trace tile by tile, however few objects there are; with `keep_all` by brute force:
    /// every object is asked at every pixel, by the same arithmetic. None for the other engines, which have no tiles.
    #[cfg(rayo_asm)]
    pub fn prepare_tiles<'a>(
        self,
        precision: Precision,
        scene: &'a Scene,
        camera: &Camera,
        keep_all: bool,
    ) -> Option<Box<dyn Tracer + 'a>> {
        let Engine::Packet(isa) = self else { return None };
        packet_tracer(isa, precision, scene, camera, Order::Tiles { keep_all }).ok()
    }
}

/// How packets go through a picture.
#[cfg(rayo_asm)]
#[derive(Clone, Copy)]
enum Order {
    /// Few objects span by span, many tile by tile.
    Planned,
    /// Tile by tile; every object at every pixel if it is to keep all.
    Tiles { keep_all: bool },
}

#[cfg(rayo_asm)]
fn packet_tracer<'a>(
    isa: Isa,
    precision: Precision,
    scene: &'a Scene,
    camera: &Camera,
    order: Order,
) -> Result<Box<dyn Tracer + 'a>, EngineError> {
    fn of<'a, E: Element>(
        packets: &'static PacketKernels,
        kernels: &'static SpanKernels<E>,
        fast: bool,
        scene: &'a Scene,
        camera: &Camera,
        order: Order,
    ) -> Box<dyn Tracer + 'a> {
        let keep_all = match order {
            Order::Planned => plan::tiles_pay(scene, camera).then_some(false),
            Order::Tiles { keep_all } => Some(keep_all),
        };
        match keep_all {
            Some(keep_all) => Box::new(TileTracer::new(packets, kernels, fast, scene, camera, keep_all)),
            None => Box::new(PacketTracer::new(packets, kernels, fast, scene, camera)),
        }
    }
    let kernels = kernels::packets(isa).ok_or(EngineError::Unusable(Engine::Packet(isa)))?;
    Ok(match precision {
        Precision::Single => of(kernels, &kernels.single, false, scene, camera, order),
        Precision::Fast => of(kernels, &kernels.single, true, scene, camera, order),
        Precision::Double => of(kernels, &kernels.double, false, scene, camera, order),
    })
}

impl FromStr for Engine {
    type Err = EngineError;

    /// An engine that can be used here, by its name or as `auto`.
    fn from_str(name: &str) -> Result<Self, EngineError> {
        if name == "auto" {
            return Ok(Engine::fastest());
        }
        let engine = Engine::ALL.iter().find(|engine| engine.name() == name);
        let elsewhere = ["c", "paper", "sse41", "avx2", "avx512"];
        engine.copied().ok_or_else(|| EngineError::Unknown { name: name.into(), known: elsewhere.contains(&name) })
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
