//! The engines by name: which there are, which this machine runs, and how to get one ready for a scene.

use std::fmt;
use std::str::FromStr;

#[cfg(rayo_asm)]
use super::aos::AosTracer;
#[cfg(rayo_asm)]
use super::packet::PacketTracer;
use super::reference::ReferenceTracer;
use super::rust::RustTracer;
#[cfg(rayo_asm)]
use super::tiles::TileTracer;
use super::{PixelFormat, Tracer};
#[cfg(rayo_asm)]
use crate::kernels::{self, Element, Isa, PacketKernels};
#[cfg(rayo_asm)]
use crate::plan;
use crate::plan::{Keep, Omission, Report, Scale, Spans};
use crate::scene::{Camera, InvalidScene, Scene};

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

/// What an engine is got ready for.
#[derive(Clone, Copy, Debug, Default)]
pub struct Purpose {
    /// In what numbers; None: the engine's own.
    pub precision: Option<Precision>,
    /// The one format that it will write, or one that differs from it in the number of channels alone; None: any.
    pub format: Option<PixelFormat>,
    /// What is not to be left out.
    pub keep: Keep,
    /// Threads that get it ready; 0 is 1. The pictures do not depend on it.
    pub threads: usize,
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
    /// The scene has a number that no scene may have.
    #[error("the scene cannot be traced: {0}")]
    Scene(#[from] InvalidScene),
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

    /// Whether it traces rays in packets.
    pub fn is_packet(self) -> bool {
        match self {
            #[cfg(rayo_asm)]
            Engine::Packet(_) => true,
            _ => false,
        }
    }

    /// Whether it computes its rays in f64, whatever its precision.
    pub fn rays_in_f64(self) -> bool {
        self == Engine::Reference || self.is_packet()
    }

    /// Gets it ready for `scene` as `camera` sees it, in `precision` (None: its own), for any format that it writes.
    pub fn prepare<'a>(
        self,
        precision: Option<Precision>,
        scene: &'a Scene,
        camera: &Camera,
    ) -> Result<Box<dyn Tracer + 'a>, EngineError> {
        self.prepare_for(Purpose { precision, ..Purpose::default() }, scene, camera)
    }

    /// Gets it ready for `scene` as `camera` sees it, and for `purpose`.
    pub fn prepare_for<'a>(
        self,
        purpose: Purpose,
        scene: &'a Scene,
        camera: &Camera,
    ) -> Result<Box<dyn Tracer + 'a>, EngineError> {
        // Asked for in vain it is an error, whatever the engine.
        self.precision_for(purpose)?;
        #[cfg(rayo_asm)]
        if let (Engine::Packet(isa), true) = (self, plan::tiles_pay(scene, camera)) {
            let kernels = kernels::packets(isa).ok_or(EngineError::Unusable(self))?;
            let precision = self.precision_for(purpose)?;
            scene.check_lights()?;
            // Set-up reads every object, and so sees for nothing whether they have numbers that a scene may have.
            let planning = (purpose.keep, purpose.threads);
            let (tracer, valid) = with_tiles(kernels, precision, scene, camera, planning, AnyTracer);
            if !valid {
                scene.check()?;
            }
            return Ok(tracer);
        }
        scene.check()?;
        Ok(match self {
            Engine::Reference => Box::new(ReferenceTracer::new(scene, camera)),
            Engine::Rust => Box::new(RustTracer::new(scene, camera)),
            #[cfg(rayo_asm)]
            Engine::C => Box::new(AosTracer::new(kernels::c(), kernels::hits_of_c(), scene, camera)),
            #[cfg(rayo_asm)]
            Engine::Paper => {
                let kernels = kernels::paper().zip(kernels::hits_of_paper());
                let (kernels, hits) = kernels.ok_or(EngineError::Unusable(self))?;
                Box::new(AosTracer::new(kernels, hits, scene, camera))
            }
            #[cfg(rayo_asm)]
            Engine::Packet(isa) => {
                let kernels = kernels::packets(isa).ok_or(EngineError::Unusable(self))?;
                let (precision, Purpose { format, keep, .. }) = (self.precision_for(purpose)?, purpose);
                match precision {
                    Precision::Single => Box::new(PacketTracer::single(kernels, false, scene, camera, format, keep)),
                    Precision::Fast => Box::new(PacketTracer::single(kernels, true, scene, camera, format, keep)),
                    Precision::Double => Box::new(PacketTracer::double(kernels, scene, camera, format, keep)),
                }
            }
        })
    }

    /// Gets a packet engine ready to trace tile by tile, however few objects there are; with `keep_all` by brute force:
    /// every object is asked at every pixel, by the same arithmetic. `threads` as in [`Purpose`]. None for the other
    /// engines, which have no tiles.
    #[cfg(rayo_asm)]
    pub fn prepare_tiles<'a>(
        self,
        precision: Precision,
        scene: &'a Scene,
        camera: &Camera,
        keep_all: bool,
        threads: usize,
    ) -> Option<Box<dyn Tracer + 'a>> {
        let kernels = self.packets()?;
        let keep = if keep_all { Keep::all() } else { Keep::NOTHING };
        Some(with_tiles(kernels, precision, scene, camera, (keep, threads), AnyTracer).0)
    }
}

/// What is done with a tracer of tiles, whatever its elements.
#[cfg(rayo_asm)]
trait UseTiles<'a> {
    type Result;
    fn of<E: Element>(self, tracer: TileTracer<'a, E>) -> Self::Result;
}

/// Hands it out, and whether its plan is of a scene that is [valid](plan::Tiles::is_valid).
#[cfg(rayo_asm)]
struct AnyTracer;

#[cfg(rayo_asm)]
impl<'a> UseTiles<'a> for AnyTracer {
    type Result = (Box<dyn Tracer + 'a>, bool);
    fn of<E: Element>(self, tracer: TileTracer<'a, E>) -> Self::Result {
        let valid = tracer.is_valid();
        (Box::new(tracer), valid)
    }
}

/// Reports what it leaves out.
#[cfg(rayo_asm)]
struct TileReport {
    bytes: bool,
}

#[cfg(rayo_asm)]
impl UseTiles<'_> for TileReport {
    type Result = Report;
    fn of<E: Element>(self, tracer: TileTracer<'_, E>) -> Report {
        tracer.report(self.bytes)
    }
}

#[cfg(rayo_asm)]
fn with_tiles<'a, U: UseTiles<'a>>(
    kernels: &'static PacketKernels,
    precision: Precision,
    scene: &'a Scene,
    camera: &Camera,
    planning: (Keep, usize),
    user: U,
) -> U::Result {
    match precision {
        Precision::Double => user.of(TileTracer::double(kernels, scene, camera, planning)),
        _ => user.of(TileTracer::single(kernels, precision == Precision::Fast, scene, camera, planning)),
    }
}

impl Engine {
    /// What it leaves out of a scene.
    pub fn omissions(self) -> &'static [Omission] {
        match self {
            Engine::Reference => &[Omission::Hidden],
            // In f32, eq. 9 would see the rounding of what is never hit.
            Engine::Rust => &[Omission::NoArea, Omission::EdgeOn, Omission::Constants, Omission::Hidden],
            #[cfg(rayo_asm)]
            Engine::C | Engine::Paper => &[Omission::NoArea, Omission::EdgeOn],
            #[cfg(rayo_asm)]
            Engine::Packet(_) => &Omission::ALL,
        }
    }

    /// The format that it computes in for a file of 8 bits (`bytes`) or of floats, which has three channels.
    pub fn format_for(self, bytes: bool) -> PixelFormat {
        match (self == Engine::Reference || self.is_packet(), bytes) {
            (true, true) => PixelFormat::Rgb8,
            (true, false) => PixelFormat::F32x3,
            (false, _) => PixelFormat::F32x4,
        }
    }

    /// What it would keep and leave out of `scene` as `camera` sees it. Where no format is given, bytes.
    ///
    /// # Errors
    /// [`EngineError::NoPrecision`].
    pub fn report(self, purpose: Purpose, scene: &Scene, camera: &Camera) -> Result<Report, EngineError> {
        let precision = self.precision_for(purpose)?;
        let bytes = purpose.format.is_none_or(PixelFormat::is_8bit);
        #[cfg(rayo_asm)]
        if let Some(kernels) = self.packets().filter(|_| plan::tiles_pay(scene, camera)) {
            let planning = (purpose.keep, purpose.threads);
            return Ok(with_tiles(kernels, precision, scene, camera, planning, TileReport { bytes }));
        }
        let scale = if bytes { Scale::Levels } else { Scale::Linear };
        // What is not a packet engine's to keep or leave out is as it is.
        let keep = if self.is_packet() { purpose.keep } else { Keep::NOTHING };
        Ok(if precision == Precision::Double {
            Report::new(scene, &Spans::<f64>::new(scene, camera, Some(scale), keep), self.omissions(), bytes)
        } else {
            Report::new(scene, &Spans::<f32>::new(scene, camera, Some(scale), keep), self.omissions(), bytes)
        })
    }

    /// The kernels of a packet engine that this CPU runs.
    #[cfg(rayo_asm)]
    fn packets(self) -> Option<&'static PacketKernels> {
        let Engine::Packet(isa) = self else { return None };
        kernels::packets(isa)
    }

    /// The precision that is asked for, if it has that.
    fn precision_for(self, purpose: Purpose) -> Result<Precision, EngineError> {
        let precision = purpose.precision.unwrap_or(self.precision());
        if !self.precisions().contains(&precision) {
            return Err(EngineError::NoPrecision(self, precision));
        }
        Ok(precision)
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
