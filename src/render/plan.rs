//! The plan: by what a scene is traced and what that leaves out, decided once for whoever traces and whoever reports it.

use super::aos::AosTracer;
use super::packet::PacketTracer;
use super::reference::ReferenceTracer;
use super::rust::RustTracer;
use super::tiles::TileTracer;
use super::{Engine, EngineError, PixelFormat, Precision, Purpose, Tracer};
use crate::kernels::{self, Element, PacketKernels};
use crate::plan::tiles_pay;
use crate::plan::{Keep, Report, Spans};
use crate::scene::Scene;

/// A scene planned for an engine.
pub struct Plan<'a> {
    engine: Engine,
    precision: Precision,
    scene: &'a Scene,
    /// Whether it is for 8 bits.
    bytes: bool,
    way: Way<'a>,
}

/// How a scene is traced.
enum Way<'a> {
    /// Every ray against every object.
    Rays(Box<dyn Tracer + 'a>),
    /// Packets of rays: those of each object's spans, or those of each tile.
    Packets(Box<dyn PacketPlan + 'a>),
}

/// A tracer of packets, with the plan that it goes by.
pub(super) trait PacketPlan: Tracer {
    /// What is kept and left out of `scene`, which is the plan's; `bytes` says whether 8 bits are written.
    fn report(&self, scene: &Scene, bytes: bool) -> Report;
}

impl<'a> Plan<'a> {
    /// Plans `scene` for `engine` and `purpose`.
    ///
    /// # Errors
    /// [`EngineError::NoPrecision`], [`EngineError::Unusable`] and [`EngineError::Scene`].
    pub fn new(engine: Engine, scene: &'a Scene, purpose: Purpose) -> Result<Self, EngineError> {
        // Asked for in vain it is an error, whatever the engine.
        let precision = engine.precision_for(purpose)?;
        let way = match engine {
            Engine::Packet(isa) => {
                let kernels = kernels::packets(isa).ok_or(EngineError::Unusable(engine))?;
                if tiles_pay(scene) {
                    scene.check_lights()?;
                    // Set-up reads every object, and so sees for nothing whether they have numbers that a scene may have.
                    let (way, valid) = tiles(kernels, precision, scene, purpose);
                    if !valid {
                        scene.check()?;
                    }
                    way
                } else {
                    scene.check()?;
                    spans(kernels, precision, scene, purpose)
                }
            }
            _ => {
                scene.check()?;
                Way::Rays(ray_tracer(engine, scene)?)
            }
        };
        Ok(Self::of(engine, precision, scene, purpose, way))
    }

    /// Plans `scene`, whose numbers are valid, for tiles, however few objects there are. None for an engine that has none,
    /// here.
    pub fn by_tiles(engine: Engine, scene: &'a Scene, purpose: Purpose) -> Option<Self> {
        let Engine::Packet(isa) = engine else { return None };
        let precision = engine.precision_for(purpose).ok()?;
        let (way, _) = tiles(kernels::packets(isa)?, precision, scene, purpose);
        Some(Self::of(engine, precision, scene, purpose, way))
    }

    fn of(engine: Engine, precision: Precision, scene: &'a Scene, purpose: Purpose, way: Way<'a>) -> Self {
        Plan { engine, precision, scene, bytes: purpose.format.is_none_or(PixelFormat::is_8bit), way }
    }

    /// What is kept and what is left out. Where the purpose has no format, for bytes.
    pub fn report(&self) -> Report {
        match &self.way {
            Way::Packets(plan) => plan.report(self.scene, self.bytes),
            // What these leave out is as it is, and what they do for nothing is what spans know of.
            Way::Rays(_) => {
                let omissions = self.engine.omissions();
                if self.precision == Precision::Double {
                    let spans = Spans::<f64>::new(self.scene, None, Keep::NOTHING);
                    Report::new(self.scene, &spans, omissions, self.bytes)
                } else {
                    let spans = Spans::<f32>::new(self.scene, None, Keep::NOTHING);
                    Report::new(self.scene, &spans, omissions, self.bytes)
                }
            }
        }
    }

    /// What traces it.
    pub fn tracer(&self) -> &(dyn Tracer + 'a) {
        match &self.way {
            Way::Rays(tracer) => tracer.as_ref(),
            Way::Packets(plan) => plan.as_ref(),
        }
    }

    /// The same alone.
    pub fn into_tracer(self) -> Box<dyn Tracer + 'a> {
        match self.way {
            Way::Rays(tracer) => tracer,
            Way::Packets(plan) => plan,
        }
    }
}

fn ray_tracer<'a>(engine: Engine, scene: &'a Scene) -> Result<Box<dyn Tracer + 'a>, EngineError> {
    Ok(match engine {
        Engine::Reference => Box::new(ReferenceTracer::new(scene)),
        Engine::Rust => Box::new(RustTracer::new(scene)),
        _ => {
            let (kernels, hits) = match engine {
                Engine::C => (kernels::c(), kernels::hits_of_c()),
                _ => (kernels::paper(), kernels::hits_of_paper()),
            };
            let (kernels, hits) = kernels.zip(hits).ok_or(EngineError::Unusable(engine))?;
            Box::new(AosTracer::new(kernels, hits, scene))
        }
    })
}

fn spans<'a>(kernels: &'static PacketKernels, precision: Precision, scene: &Scene, purpose: Purpose) -> Way<'a> {
    Way::Packets(match precision {
        Precision::Double => Box::new(PacketTracer::double(kernels, scene, purpose)),
        _ => Box::new(PacketTracer::single(kernels, precision == Precision::Fast, scene, purpose)),
    })
}

/// And whether planning has seen that the scene's objects are [valid](crate::plan::Tiles::is_valid).
fn tiles<'a>(
    kernels: &'static PacketKernels,
    precision: Precision,
    scene: &'a Scene,
    purpose: Purpose,
) -> (Way<'a>, bool) {
    fn way<'a, E: Element>(tracer: TileTracer<'a, E>) -> (Way<'a>, bool) {
        let valid = tracer.is_valid();
        (Way::Packets(Box::new(tracer)), valid)
    }
    let planning = (purpose.keep, purpose.threads);
    match precision {
        Precision::Double => way(TileTracer::double(kernels, scene, planning)),
        _ => way(TileTracer::single(kernels, precision == Precision::Fast, scene, planning)),
    }
}
