//! What being right costs: the robust packets against the paper's plain formulas, which have one ray in each lane too.

use std::cell::RefCell;

use serde::{Deserialize, Serialize};

use super::{Contender, contenders};
use crate::experiments::PictureError;
use crate::experiments::ladder::TURNED;
use crate::kernels::{Vec4, ladder};
use crate::measure::Name;
use crate::measure::statistics::{Estimate, median, median_with_interval, pairwise_ratios};
use crate::measure::{Clock, Work, interleave};
use crate::plan::Packed;
use crate::render::{FilmMut, Precision};
use crate::scene::{Rng, Scene};

/// The same picture by the packets of an instruction set and by the plain formulas for the same instructions.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct AgainstPlain {
    pub scene: String,
    /// The packet engine, in single precision; it writes floats.
    pub engine: Name,
    /// How the plain formulas were compiled.
    pub flags: Name,
    /// Nanoseconds of a ray by the engine, the median run.
    pub robust_ns_per_ray: f64,
    /// By the plain formulas.
    pub plain_ns_per_ray: f64,
    /// The engine's time by that of the plain formulas, pair by pair.
    pub ratio: Estimate,
}

const ROUNDS: usize = 41;
/// Where the bootstrap's draws begin.
const SEED: u64 = 0x0070_1a17;

/// Times the packets, and `turned.c` for their instructions (eq. 5 by half of b, eq. 9 and eq. 10, all in f32, over arrays
/// of rays), on a scene, in turns, for every instruction set of this machine; nothing where the plain formulas take fewer
/// objects than it has. `hz` is the rate of the clock. None where `proceed` says no.
///
/// # Errors
/// A scene that cannot be traced.
pub fn against_plain(
    name: &str,
    scene: &Scene,
    clock: &mut dyn Clock,
    hz: f64,
    proceed: &mut dyn FnMut() -> bool,
) -> Result<Option<Vec<AgainstPlain>>, PictureError> {
    if scene.spheres.len().max(scene.triangle_count()) > ladder::MOST {
        return Ok(Some(Vec::new()));
    }
    let (camera, packed) = (scene.camera, Packed::new(scene));
    let rows = 0..camera.height();
    let out = RefCell::new(vec![Vec4::default(); camera.pixels() as usize]);
    let mut pairs = Vec::new();
    for (engine, _, rung) in TURNED {
        let single =
            |contender: &Contender| contender.engine.name() == engine && contender.precision == Precision::Single;
        let rung = ladder::C.iter().find(|of| of.name == rung && of.usable());
        let contender = contenders().into_iter().find(single);
        let Some((contender, rung)) = contender.zip(rung) else { continue };
        pairs.push((engine, rung, contender.prepare(scene)?));
    }
    let mut work: Vec<Work<'_>> = Vec::new();
    for (_, rung, tracer) in &pairs {
        let (out, packed, rows) = (&out, &packed, &rows);
        work.push(Box::new(move || tracer.rows(rows.clone(), FilmMut::F32x4(&mut out.borrow_mut()))));
        work.push(Box::new(move || {
            rung.call(packed.frame(), packed.objects(), rows.clone(), &mut out.borrow_mut());
        }));
    }
    work.iter_mut().for_each(|work| work());
    let Some(runs) = interleave(clock, &mut work, 0..ROUNDS, proceed) else { return Ok(None) };
    let ns = |ticks: &[f64]| 1e9 * median(ticks) / (hz * camera.pixels() as f64);
    let found = pairs.iter().zip(runs.chunks(2)).map(|((engine, rung, _), runs)| {
        let ratios = pairwise_ratios(&runs[0].ticks, &runs[1].ticks);
        let mut rng = Rng::new(SEED);
        AgainstPlain {
            scene: name.to_owned(),
            engine: (*engine).into(),
            flags: rung.flags.into(),
            robust_ns_per_ray: ns(&runs[0].ticks),
            plain_ns_per_ray: ns(&runs[1].ticks),
            ratio: median_with_interval(ratios.chunks(1), &mut || rng.next_u64()),
        }
    });
    Ok(Some(found.collect()))
}
