//! How the cost of the paper's C and SIMD grows with pixels, objects and lights.

use serde::{Deserialize, Serialize};

use super::in_size;
use super::lab::{Bench, Case, LabError, PreemptedCount, Progress, SEED, Timed, judged, kept};
use super::speedup::{self, BASELINE, CONTROL, Timing};
use crate::measure::statistics::{Estimate, Line, fit_line, mean, median_with_interval, minimum};
use crate::measure::{Clock, Name, Runs};
use rayo::internals::render::{PixelFormat, Purpose};
use rayo::internals::scene::{Light, Rng, Scene, many};

/// What the cost of a picture depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// The width times the height.
    #[default]
    Pixels,
    /// Spheres and triangles together.
    Objects,
    /// Lights.
    Lights,
}

impl Axis {
    /// The axis's name, as in the JSON document.
    pub fn name(self) -> &'static str {
        match self {
            Axis::Pixels => "pixels",
            Axis::Objects => "objects",
            Axis::Lights => "lights",
        }
    }
}

/// The cost of an engine along an axis, and the straight line fitted to it. The field names are
/// those of the JSON document.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Sweep {
    pub axis: Axis,
    pub engine: Name,
    /// For each count the TSC cycles of the fastest picture.
    pub points: Vec<(f64, f64)>,
    /// The straight line fitted to the points. Its slope is in cycles per pixel, object or light.
    pub line: Line,
    /// How far the cost is from a straight line. At each count the distance from the line of the
    /// same round has a median; this is the root mean square of these medians, relative to the mean
    /// cost.
    #[serde(default)]
    pub residual: Estimate,
    /// The number of points that were disturbed: more than half of their pictures were preempted.
    /// pictures.
    pub taken: usize,
}

/// The numbers of objects; half of them are spheres and half triangles.
const OBJECTS: [usize; 6] = [2, 8, 16, 24, 32, 40];
/// The numbers of lights over the experiment's sphere.
const LIGHTS: [usize; 6] = [1, 8, 16, 24, 32, 40];
/// The size of the pictures: small, so that a run is short.
pub const SIZE: (u32, u32) = (128, 96);
const SCENE_SEED: u64 = 5;
/// The work of one round of both engines, per pixel and object and per pixel and light, in the unit
/// of [`Progress`].
const OBJECT_WORK: u64 = 300;
const LIGHT_WORK: u64 = 60;

fn rounds(quick: bool) -> usize {
    if quick { 30 } else { 100 }
}

/// The work that [`measure`] does.
pub fn work(quick: bool) -> u64 {
    rounds(quick) as u64 * (work_of_round(&OBJECTS, OBJECT_WORK) + work_of_round(&LIGHTS, LIGHT_WORK))
}

fn work_of_round(counts: &[usize], work: u64) -> u64 {
    u64::from(SIZE.0) * u64::from(SIZE.1) * counts.iter().sum::<usize>() as u64 * work
}

/// The experiment's scene with its light divided into `count` lights at the same position, which
/// together are as bright.
fn lit(count: usize) -> Scene {
    let mut scene = speedup::scene();
    let light = scene.lights[0];
    scene.lights = vec![Light { intensity: light.intensity / count as f32, ..light }; count];
    scene
}

fn with_objects(count: usize) -> Scene {
    many(count / 2, count - count / 2, SCENE_SEED)
}

/// A scene with a number of objects or lights.
struct CountedScene {
    count: usize,
    scene: Scene,
}

/// Measures the cost in objects and in lights. None if `proceed` returns false.
///
/// # Errors
/// If an engine cannot be prepared, or if there is not enough memory.
pub fn measure(quick: bool, clock: &mut dyn Clock, proceed: &mut Progress<'_>) -> Result<Option<Vec<Sweep>>, LabError> {
    let objects = OBJECTS.iter().map(|count| CountedScene { count: *count, scene: with_objects(*count) }).collect();
    let lights = LIGHTS.iter().map(|count| CountedScene { count: *count, scene: lit(*count) }).collect();
    let mut sweeps = Vec::new();
    for (axis, scenes, work) in [
        (Axis::Objects, objects, work_of_round(&OBJECTS, OBJECT_WORK)),
        (Axis::Lights, lights, work_of_round(&LIGHTS, LIGHT_WORK)),
    ] {
        let Some(of_axis) = along(axis, scenes, rounds(quick), clock, &mut || proceed(work))? else { return Ok(None) };
        sweeps.extend(of_axis);
    }
    Ok(Some(sweeps))
}

/// Measures both engines along one axis, in the scenes of every count. Each round traces all scenes
/// in turn, so that a slowdown of the core that lasts longer than a round makes the round's line
/// steeper without bending it.
fn along(
    axis: Axis,
    scenes: Vec<CountedScene>,
    rounds: usize,
    clock: &mut dyn Clock,
    proceed: &mut dyn FnMut() -> bool,
) -> Result<Option<Vec<Sweep>>, LabError> {
    let engines = speedup::baseline_and_control();
    let counts: Vec<f64> = scenes.iter().map(|scene| scene.count as f64).collect();
    let scenes: Vec<Scene> = scenes.iter().map(|counted| in_size(&counted.scene, SIZE.0, SIZE.1)).collect();
    let mut cases = Vec::new();
    for engine in engines {
        for scene in &scenes {
            cases.push(Case::of(Timed::Tracing, scene, engine, Purpose::default(), PixelFormat::F32x4)?);
        }
    }
    let measured = Bench::default().time(clock, &cases, 0..rounds, proceed)?;
    let sweep = |(engine, runs): (&rayo::internals::render::Engine, &[Runs])| {
        of_runs(axis, engine.name().into(), &counts, runs)
    };
    Ok(measured.map(|runs| engines.iter().zip(runs.chunks(counts.len())).map(sweep).collect()))
}

/// The sweep of an engine, from its runs at each count.
fn of_runs(axis: Axis, engine: Name, counts: &[f64], runs: &[Runs]) -> Sweep {
    let points: Vec<_> = counts.iter().zip(runs).map(|(count, runs)| (*count, minimum(&runs.ticks))).collect();
    let rounds = 0..runs[0].ticks.len();
    // If one picture of a round was preempted, the line of the whole round is disturbed.
    let disturbed: Vec<bool> = rounds.map(|round| runs.iter().any(|runs| runs.taken[round])).collect();
    let judged = judged(&disturbed);
    let ticks: Vec<_> = runs.iter().map(|runs| kept(&runs.ticks, &judged)).collect();
    Sweep {
        axis,
        engine,
        line: fit_line(&points),
        points,
        residual: residual(counts, &ticks),
        taken: runs.iter().filter(|runs| !PreemptedCount::among(&runs.taken).leaves_enough()).count(),
    }
}

/// The cost in pixels, from the sizes of the paper's table. Empty with fewer than three sizes,
/// since any two points are on a line.
pub fn in_pixels(rows: &[Timing]) -> Vec<Sweep> {
    let sweep = |engine: &'static str| {
        let rows: Vec<_> = rows.iter().filter(|row| row.is(engine)).collect();
        let points: Vec<_> = rows.iter().map(|row| (row.pixels as f64, row.cycles_min)).collect();
        let counts: Vec<_> = points.iter().map(|(pixels, _)| *pixels).collect();
        let ticks: Vec<_> = rows.iter().map(|row| row.samples.clone()).collect();
        (points.len() > 2).then(|| Sweep {
            axis: Axis::Pixels,
            engine: engine.into(),
            line: fit_line(&points),
            points,
            residual: residual(&counts, &ticks),
            taken: rows.iter().filter(|row| !row.taken().leaves_enough()).count(),
        })
    };
    [BASELINE, CONTROL].into_iter().filter_map(sweep).collect()
}

/// How far a cost is from a straight line; `ticks` has every round at each of `counts`. A line is
/// fitted to each round. At each count the distances from these lines, relative to the round's
/// mean, have a median with an interval. The residual is the root mean square of these medians; its
/// low end takes each median as near to 0 as its interval allows, and its high end as far from 0.
fn residual(counts: &[f64], ticks: &[Vec<f64>]) -> Estimate {
    let rounds = ticks.iter().map(Vec::len).min().unwrap_or(0);
    let of_rounds: Vec<_> = (0..rounds).map(|round| distances(counts, ticks, round)).collect();
    let (mut value, mut low, mut high) = (0.0, 0.0, 0.0);
    for place in 0..counts.len() {
        let distances: Vec<f64> = of_rounds.iter().map(|round| round[place]).collect();
        let mut rng = Rng::new(SEED);
        let distance = median_with_interval(distances.chunks(1), &mut || rng.next_u64());
        let nearest = distance.low.max(-distance.high).max(0.0);
        let farthest = distance.high.max(-distance.low);
        value += distance.value * distance.value;
        low += nearest * nearest;
        high += farthest * farthest;
    }
    let root = |squares: f64| (squares / counts.len() as f64).sqrt();
    Estimate { value: root(value), low: root(low), high: root(high) }
}

/// The distances of a round's ticks from the straight line fitted to them, relative to their mean.
fn distances(counts: &[f64], ticks: &[Vec<f64>], round: usize) -> Vec<f64> {
    let points: Vec<_> = counts.iter().zip(ticks).map(|(count, ticks)| (*count, ticks[round])).collect();
    let line = fit_line(&points);
    let mean = mean(&points.iter().map(|(_, ticks)| *ticks).collect::<Vec<_>>());
    points.iter().map(|(count, ticks)| (ticks - (line.slope * count + line.intercept)) / mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The residual of fifteen rounds of a cost, each with another speed of the core and with
    /// errors of up to `noise` in every picture.
    fn rounds_of(cost: impl Fn(f64) -> f64, noise: f64) -> Estimate {
        let counts = [1.0, 2.0, 3.0, 4.0, 5.0];
        let mut rng = Rng::new(3);
        let speeds: Vec<f64> = (0..15).map(|_| f64::from(rng.between(1.0, 1.5))).collect();
        let mut off = || 1.0 + noise * f64::from(rng.between(-1.0, 1.0));
        let ticks: Vec<Vec<f64>> =
            counts.iter().map(|count| speeds.iter().map(|speed| speed * cost(*count) * off()).collect()).collect();
        residual(&counts, &ticks)
    }

    #[test]
    fn the_speed_of_a_round_bends_no_line() {
        let straight = rounds_of(|count| 7.0 + 100.0 * count, 0.0);
        assert!(straight.high < 1e-12, "{straight:?}");
    }

    #[test]
    fn a_bend_is_found_and_noise_is_in_the_interval() {
        let bent = |count: f64| 10.0 * count * count;
        let quiet = rounds_of(bent, 0.01);
        assert!(quiet.low > 0.1 && quiet.low <= quiet.value && quiet.value <= quiet.high, "{quiet:?}");
        for cost in [bent, |count| 100.0 * count] {
            let noisy = rounds_of(cost, 0.9);
            assert!(noisy.low < 0.05 && noisy.high > 0.05, "{noisy:?}");
        }
    }
}
