//! The plan: what traces a scene and which work it omits, decided once for tracing and for reports.

use super::aos::AosTracer;
use super::lit::LitTracer;
use super::reference::ReferenceTracer;
use super::rust::RustTracer;
use super::tiles::{Interleaved, MOST_LIGHTS, TileTracer};
use super::{Engine, EngineError, PixelFormat, Precision, Purpose, Tracer};
use crate::kernels::{self, Element, ElementKernels, PacketKernels};
use crate::plan::{Raster, Report, lights};
use crate::scene::Scene;

/// A scene planned for an engine.
pub struct Plan<'a> {
    engine: Engine,
    scene: &'a Scene,
    /// Whether it is for 8 bits.
    bytes: bool,
    tracer: Box<dyn Tracer + 'a>,
}

impl<'a> Plan<'a> {
    /// Plans `scene` for `engine` and `purpose`.
    ///
    /// # Errors
    /// [`EngineError::NoPrecision`], [`EngineError::NoShadows`], [`EngineError::Unusable`],
    /// [`EngineError::Lights`] and [`EngineError::Scene`].
    pub fn new(engine: Engine, scene: &'a Scene, purpose: Purpose) -> Result<Self, EngineError> {
        // An unsupported precision is an error for every engine.
        let precision = engine.precision_for(purpose)?;
        if scene.shadows && !engine.has_shadows() {
            return Err(EngineError::NoShadows(engine));
        }
        let tracer = match engine {
            _ if engine.is_packet() => {
                let kernels = engine.packets().ok_or(EngineError::Unusable(engine))?;
                scene.check_lights()?;
                match precision {
                    Precision::Double => packets(engine, kernels, (&kernels.double, false), scene, purpose),
                    _ => packets(engine, kernels, (&kernels.single, precision == Precision::Fast), scene, purpose),
                }?
            }
            _ => {
                scene.check()?;
                ray_tracer(engine, scene)?
            }
        };
        let bytes = purpose.format.is_none_or(PixelFormat::is_8bit);
        Ok(Plan { engine, scene, bytes, tracer })
    }

    /// The kept and the omitted work. If the purpose has no format, for bytes.
    pub fn report(&self) -> Report {
        self.tracer.report(self.bytes).unwrap_or_else(|| Report::of_rays(self.scene, self.engine.omissions()))
    }

    /// The tracer.
    pub fn tracer(&self) -> &(dyn Tracer + 'a) {
        self.tracer.as_ref()
    }

    /// Only the tracer.
    pub fn into_tracer(self) -> Box<dyn Tracer + 'a> {
        self.tracer
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

/// Packets of rays: in the rows of one sphere under one light, or in tiles.
fn packets<'a, E: Element>(
    engine: Engine,
    packets: &'static PacketKernels,
    kernels: (&'static ElementKernels<E>, bool),
    scene: &'a Scene,
    purpose: Purpose,
) -> Result<Box<dyn Tracer + 'a>, EngineError> {
    if scene.spheres.len() == 1 {
        scene.check()?;
        if let Some(tracer) = LitTracer::new(packets, kernels, scene, purpose) {
            return Ok(Box::new(tracer));
        }
    }
    let lights = lights(scene).len();
    if lights > MOST_LIGHTS {
        return Err(EngineError::Lights { engine, lights });
    }
    let planning = (purpose.keep, purpose.threads);
    let part = |raster| TileTracer::new(packets, kernels, (scene, raster), planning);
    let mut parts: Vec<_> = Raster::of(&scene.camera).into_iter().map(part).collect();
    // Set-up reads every object, and so checks at no cost whether their numbers are valid.
    if !parts[0].is_valid() {
        scene.check()?;
    }
    Ok(match parts.pop() {
        Some(only) if parts.is_empty() => Box::new(only),
        last => {
            parts.extend(last);
            Box::new(Interleaved::new(&scene.camera, parts))
        }
    })
}
