//! The plan of a scene: which tracer traces it, and what work that tracer omits.

use std::ops::Range;

use super::aos::AosTracer;
use super::lit::LitTracer;
use super::reference::ReferenceTracer;
use super::rust::RustTracer;
use super::tiles::TileTracer;
use super::{Counted, Engine, EngineError, FilmMut, Found, PixelFormat, Precision, Purpose, Tracer, Wanted};
use crate::kernels::{self, Element, ElementKernels, PacketKernels, StandardFloats, Vec4};
use crate::plan::{Cancel, PlanOptions, Report};
use crate::scene::Scene;

/// A scene that has been planned for an engine.
pub struct Plan<'a> {
    engine: Engine,
    scene: &'a Scene,
    /// Whether the plan is for pixels of 8 bits.
    bytes: bool,
    tracer: Box<dyn Tracer + 'a>,
}

impl<'a> Plan<'a> {
    /// Plans `scene` for `engine` and `purpose`.
    ///
    /// # Errors
    /// Those of [`Engine::takes`], [`EngineError::Scene`], and [`EngineError::Cancelled`].
    pub fn new(engine: Engine, scene: &'a Scene, purpose: Purpose<'_>) -> Result<Self, EngineError> {
        let _floats = StandardFloats::set();
        engine.takes(scene, purpose.precision)?;
        let precision = engine.precision_for(purpose.precision)?;
        let tracer = match engine {
            _ if engine.is_packet() => {
                let kernels = engine.packets().ok_or(EngineError::Unusable(engine))?;
                scene.check_lights()?;
                let estimates = precision == Precision::Fast;
                match precision {
                    Precision::Double => {
                        let element = &kernels.double;
                        packets(PacketKernelSet { packets: kernels, element, estimates }, scene, purpose)
                    }
                    _ => {
                        let element = &kernels.single;
                        packets(PacketKernelSet { packets: kernels, element, estimates }, scene, purpose)
                    }
                }?
            }
            _ => {
                scene.check()?;
                ray_tracer(engine, scene)?
            }
        };
        if purpose.cancel.is_some_and(Cancel::is_cancelled) {
            return Err(EngineError::Cancelled);
        }
        let tracer = Box::new(Guarded { tracer });
        let bytes = purpose.format.is_none_or(PixelFormat::is_8bit);
        Ok(Plan { engine, scene, bytes, tracer })
    }

    /// The report of kept and omitted work. If the purpose names no format, it is the report for
    /// bytes.
    pub fn report(&self) -> Report {
        self.tracer.report(self.bytes).unwrap_or_else(|| Report::of_rays(self.scene, self.engine.omissions()))
    }

    /// The tracer.
    pub fn tracer(&self) -> &(dyn Tracer + 'a) {
        self.tracer.as_ref()
    }

    /// Drops the plan, and returns its tracer.
    pub fn into_tracer(self) -> Box<dyn Tracer + 'a> {
        self.tracer
    }
}

/// Wraps a tracer so that each call computes in [`StandardFloats`], from whichever thread of the
/// host it comes.
struct Guarded<'a> {
    tracer: Box<dyn Tracer + 'a>,
}

impl Tracer for Guarded<'_> {
    fn writes(&self, format: PixelFormat) -> bool {
        self.tracer.writes(format)
    }

    fn rows_together(&self) -> u32 {
        self.tracer.rows_together()
    }

    fn is_quick(&self) -> bool {
        self.tracer.is_quick()
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        let _floats = StandardFloats::set();
        self.tracer.rows(rows, out);
    }

    fn light(&self, rows: Range<u32>, wanted: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        let _floats = StandardFloats::set();
        self.tracer.light(rows, wanted, background, out)
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let _floats = StandardFloats::set();
        self.tracer.hits(rows)
    }

    fn count(&self, rows: Range<u32>) -> Counted {
        let _floats = StandardFloats::set();
        self.tracer.count(rows)
    }

    fn report(&self, bytes: bool) -> Option<Report> {
        let _floats = StandardFloats::set();
        self.tracer.report(bytes)
    }

    fn counted_rows(&self, rows: Range<u32>, out: FilmMut<'_>) -> Option<Counted> {
        let _floats = StandardFloats::set();
        self.tracer.counted_rows(rows, out)
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

/// The kernels of an instruction set for packets of one element type.
#[derive(Clone, Copy)]
pub struct PacketKernelSet<E: Element> {
    /// Kernels of both element types, and kernels that do not depend on it.
    pub packets: &'static PacketKernels,
    /// Kernels of this element type.
    pub element: &'static ElementKernels<E>,
    /// Whether floats too may be computed with estimates of roots. Bytes always are.
    pub estimates: bool,
}

/// Makes the tracer of a packet engine: by the closed form for one sphere under one light,
/// otherwise in tiles.
fn packets<'a, E: Element>(
    kernels: PacketKernelSet<E>,
    scene: &'a Scene,
    purpose: Purpose<'_>,
) -> Result<Box<dyn Tracer + 'a>, EngineError> {
    if scene.spheres.len() == 1 {
        scene.check()?;
        if let Some(tracer) = LitTracer::new(kernels, scene, purpose) {
            return Ok(Box::new(tracer));
        }
    }
    let planning = PlanOptions { keep: purpose.keep, threads: purpose.threads, cancel: purpose.cancel };
    let tracer = TileTracer::new(kernels, scene, planning);
    // Set-up reads every object, so that checking their numbers there costs nothing.
    if !tracer.is_valid() {
        scene.check()?;
    }
    Ok(Box::new(tracer))
}
