//! The cost of being right: the robust packets compared with the paper's plain formulas.

use serde::{Deserialize, Serialize};

use super::{Contender, contenders};
use crate::experiments::lab::{Bench, Case, LabError, Pairs, Timed};
use crate::experiments::ladder::{VECTORISED, VectorisedRung, floats};
use crate::measure::Clock;
use crate::measure::Name;
use crate::measure::statistics::{Estimate, median};
use rayo::internals::kernels::ladder;
use rayo::internals::plan::Packed;
use rayo::internals::render::{PixelFormat, Precision};
use rayo::internals::scene::Scene;

/// The time of one picture by a packet engine and by the plain formulas, compiled for the same
/// instruction set.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct AgainstPlain {
    pub scene: String,
    /// The packet engine, in single precision; it writes floats.
    pub engine: Name,
    /// How the plain formulas were compiled.
    pub flags: Name,
    /// The engine's nanoseconds per ray in the median run.
    pub robust_ns_per_ray: f64,
    /// The nanoseconds per ray of the plain formulas in the median run.
    pub plain_ns_per_ray: f64,
    /// The engine's time divided by that of the plain formulas: the median over pairs of runs.
    pub ratio: Estimate,
}

const ROUNDS: usize = 41;

/// For every instruction set of this machine, times on a scene, in turns, the packets and
/// `turned.c` compiled for the same instructions: the plain formulas (eq. 5 with half of b, eq. 9
/// and eq. 10) in f32 over arrays of rays. The result is empty if the scene has more objects than
/// `turned.c` takes. `hz` is the rate of the clock. None if `proceed` returns false.
///
/// # Errors
/// If the scene cannot be traced.
pub fn against_plain(
    name: &str,
    scene: &Scene,
    clock: &mut dyn Clock,
    hz: f64,
    proceed: &mut dyn FnMut() -> bool,
) -> Result<Option<Vec<AgainstPlain>>, LabError> {
    if scene.spheres.len().max(scene.triangle_count()) > ladder::MOST {
        return Ok(Some(Vec::new()));
    }
    let (camera, packed) = (scene.camera, Packed::new(scene));
    let (mut pairs, mut cases) = (Vec::new(), Vec::new());
    for VectorisedRung { engine, variant: rung, .. } in VECTORISED {
        let single =
            |contender: &Contender| contender.engine.name() == engine && contender.precision == Precision::Single;
        let rung = ladder::C.iter().find(|of| of.name == rung && of.usable());
        let contender = contenders().into_iter().find(single);
        let Some((contender, rung)) = contender.zip(rung) else { continue };
        pairs.push((engine, rung.flags));
        cases.push(Case::of(Timed::Tracing, scene, contender.engine, contender.purpose(), PixelFormat::F32x4)?);
        cases.push(Case::new(camera, PixelFormat::F32x4, |rows, film| {
            rung.call(packed.frame(), packed.objects(), rows, floats(film));
        }));
    }
    let Some(runs) = Bench::default().time(clock, &cases, 0..ROUNDS, proceed)? else { return Ok(None) };
    let ns = |ticks: &[f64]| 1e9 * median(ticks) / (hz * camera.pixels() as f64);
    let found = pairs.into_iter().zip(runs.chunks(2)).map(|((engine, flags), runs)| AgainstPlain {
        scene: name.to_owned(),
        engine: engine.into(),
        flags: flags.into(),
        robust_ns_per_ray: ns(&runs[0].ticks),
        plain_ns_per_ray: ns(&runs[1].ticks),
        ratio: Pairs::of(&runs[0], &runs[1]).estimate(1),
    });
    Ok(Some(found.collect()))
}
