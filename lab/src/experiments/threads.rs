//! The speedup of a picture, set-up included, on several threads, with the fastest engine.

use serde::{Deserialize, Serialize};

use super::accuracy::subjects::shipped;
use super::complexity::mesh;
use super::in_size;
use super::lab::{Bench, Case, LabError, Progress};
use super::ladder::on_all;
use crate::measure::Clock;
use crate::measure::Name;
use crate::measure::statistics::median;
use rayo::internals::kernels::sys;
use rayo::internals::render::{Engine, Film, FilmMut, Frame, PixelFormat, Plan, Purpose, Settings};
use rayo::internals::scene::{Scene, many};

const SIZE: (u32, u32) = (1632, 1224);
const RUNS: usize = 9;
const QUICK_RUNS: usize = 5;
/// The number of objects in the scenes of many objects.
const MANY: usize = 1000;
const MESH: u64 = 70_000;
const SEED: u64 = 7;

/// The time of a scene on a number of threads. The field names are those of the JSON document.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct OnThreads {
    pub scene: Name,
    pub engine: Name,
    /// The number of threads that set up and traced the scene.
    pub threads: usize,
    /// Median TSC cycles from the parsed scene to the last pixel.
    pub cycles_median: f64,
    /// The speedup over one thread: the ratio of the medians.
    pub speedup: f64,
}

/// The work that [`run`] reports by calling `proceed`: 1 for each of its three scenes.
pub const WORK: u64 = 3;

/// The numbers of threads: the powers of two up to `most`, and `most` itself.
fn counts(most: usize) -> Vec<usize> {
    let mut counts: Vec<usize> =
        std::iter::successors(Some(1), |count| Some(count * 2)).take_while(|c| *c < most).collect();
    counts.push(most);
    counts
}

/// A scene with its name in the document.
struct NamedScene {
    name: Name,
    scene: Scene,
}

fn scenes() -> [NamedScene; 3] {
    let sphere = in_size(&shipped("sphere"), SIZE.0, SIZE.1);
    let camera = sphere.camera;
    [
        NamedScene { name: "sphere".into(), scene: sphere },
        NamedScene { name: "1,000 spheres".into(), scene: Scene { camera, ..many(MANY, 0, SEED) } },
        NamedScene { name: "mesh of 70,000 triangles".into(), scene: mesh(MESH, camera) },
    ]
}

/// Measures with 8-bit pixels on 1, 2, 4 and so on of `cores`, and on all of them. None if
/// `proceed` returns false.
///
/// # Errors
/// If there is not enough memory, or if the threads cannot be allowed to use the cores.
pub fn run(
    quick: bool,
    cores: &sys::Cores,
    clock: &mut dyn Clock,
    proceed: &mut Progress<'_>,
) -> Result<Option<Vec<OnThreads>>, LabError> {
    let engine = Engine::fastest();
    let mut rows = Vec::new();
    for NamedScene { name, scene } in scenes() {
        let (camera, output) = (scene.camera, PixelFormat::Rgba8);
        let counts = counts(cores.count());
        let picture = |threads: usize, film: FilmMut<'_>| -> Result<(), LabError> {
            let purpose = Purpose { format: Some(output), threads, ..Purpose::default() };
            on_all(cores, || {
                let tracer = Plan::new(engine, &scene, purpose)?.into_tracer();
                let frame = Frame::new(tracer.as_ref(), camera, Settings { threads })?;
                frame.trace(0..camera.height(), film, &|_| ()).expect("a film of the picture's size");
                Ok(())
            })?
        };
        // Failures are returned from this first call; the timed calls that follow may expect
        // success.
        let mut film = Film::new(output, camera.pixels() as usize)?;
        counts.iter().try_for_each(|threads| picture(*threads, film.as_mut()))?;
        let case = |threads: &usize| {
            let threads = *threads;
            Case::new(camera, output, move |_, film| picture(threads, film).expect("it could be done before"))
        };
        let cases: Vec<_> = counts.iter().map(case).collect();
        let runs = if quick { QUICK_RUNS } else { RUNS };
        let measured = Bench::default().time(clock, &cases, 0..runs, &mut || proceed(0))?;
        let Some(measured) = measured else { return Ok(None) };
        let medians: Vec<f64> = measured.iter().map(|runs| median(&runs.ticks)).collect();
        rows.extend(counts.iter().zip(&medians).map(|(threads, cycles)| OnThreads {
            scene: name.clone(),
            engine: engine.name().into(),
            threads: *threads,
            cycles_median: *cycles,
            speedup: medians[0] / cycles,
        }));
        if !proceed(1) {
            return Ok(None);
        }
    }
    Ok(Some(rows))
}
