//! The plan: what traces a scene and which work it omits, decided once for tracing and for reports.

use super::aos::AosTracer;
use super::lit::LitTracer;
use super::reference::ReferenceTracer;
use super::rust::RustTracer;
use super::tiles::{Interleaved, TileTracer};
use super::{Engine, EngineError, PacketPlan, PixelFormat, Precision, Purpose, Tracer};
use crate::kernels::{self, Element, ElementKernels, PacketKernels};
use crate::plan::{Raster, Report};
use crate::scene::Scene;

/// A scene planned for an engine.
pub struct Plan<'a> {
    engine: Engine,
    scene: &'a Scene,
    /// Whether it is for 8 bits.
    bytes: bool,
    way: Way<'a>,
}

/// How a scene is traced.
enum Way<'a> {
    /// Every ray against every object.
    Rays(Box<dyn Tracer + 'a>),
    /// Packets of rays: in the rows of one sphere under one light, or in tiles.
    Packets(Box<dyn PacketPlan + 'a>),
}

impl<'a> Plan<'a> {
    /// Plans `scene` for `engine` and `purpose`.
    ///
    /// # Errors
    /// [`EngineError::NoPrecision`], [`EngineError::NoShadows`], [`EngineError::Unusable`] and [`EngineError::Scene`].
    pub fn new(engine: Engine, scene: &'a Scene, purpose: Purpose) -> Result<Self, EngineError> {
        // An unsupported precision is an error for every engine.
        let precision = engine.precision_for(purpose)?;
        if scene.shadows && !engine.has_shadows() {
            return Err(EngineError::NoShadows(engine));
        }
        let way = match engine {
            _ if engine.is_packet() => {
                let kernels = engine.packets().ok_or(EngineError::Unusable(engine))?;
                scene.check_lights()?;
                match precision {
                    Precision::Double => packets(kernels, (&kernels.double, false), scene, purpose),
                    _ => packets(kernels, (&kernels.single, precision == Precision::Fast), scene, purpose),
                }?
            }
            _ => {
                scene.check()?;
                Way::Rays(ray_tracer(engine, scene)?)
            }
        };
        let bytes = purpose.format.is_none_or(PixelFormat::is_8bit);
        Ok(Plan { engine, scene, bytes, way })
    }

    /// The kept and the omitted work. If the purpose has no format, for bytes.
    pub fn report(&self) -> Report {
        match &self.way {
            Way::Packets(plan) => plan.report(self.bytes),
            Way::Rays(_) => Report::of_rays(self.scene, self.engine.omissions()),
        }
    }

    /// The tracer.
    pub fn tracer(&self) -> &(dyn Tracer + 'a) {
        match &self.way {
            Way::Rays(tracer) => tracer.as_ref(),
            Way::Packets(plan) => plan.as_ref(),
        }
    }

    /// Only the tracer.
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

fn packets<'a, E: Element>(
    packets: &'static PacketKernels,
    kernels: (&'static ElementKernels<E>, bool),
    scene: &'a Scene,
    purpose: Purpose,
) -> Result<Way<'a>, EngineError> {
    if scene.spheres.len() == 1 {
        scene.check()?;
        if let Some(tracer) = LitTracer::new(packets, kernels, scene, purpose) {
            return Ok(Way::Packets(Box::new(tracer)));
        }
    }
    let planning = (purpose.keep, purpose.threads);
    let part = |raster| TileTracer::new(packets, kernels, (scene, raster), planning);
    let mut parts: Vec<_> = Raster::of(&scene.camera).into_iter().map(part).collect();
    // Set-up reads every object, and so checks at no cost whether their numbers are valid.
    if !parts[0].is_valid() {
        scene.check()?;
    }
    Ok(Way::Packets(match parts.pop() {
        Some(only) if parts.is_empty() => Box::new(only),
        last => {
            parts.extend(last);
            Box::new(Interleaved::new(scene.camera.width(), parts))
        }
    }))
}
