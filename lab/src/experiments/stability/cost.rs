//! How much time ill-conditioned scenes cost, compared with ordinary ones.

use serde::{Deserialize, Serialize};

use crate::experiments::accuracy::{Contender, subjects};
use crate::experiments::in_size;
use crate::experiments::lab::{Bench, Case, LabError, Pairs, Timed};
use crate::families::Family;
use crate::measure::statistics::{Estimate, median};
use crate::measure::{MachineClock, Name};
use rayo::internals::render::PixelFormat;
use rayo::internals::scene::{Camera, Scene};

/// The distance of the far sphere, in radii.
const KAPPA: f32 = 1e4;
/// The small scenes are the ordinary ones scaled by two to this power, which does not change a byte
/// of the packets' pictures.
const SMALL: i32 = -70;
/// The size of the pictures and the number of rounds, in a quick run and in a full one.
const SIZES: [((u32, u32), usize); 2] = [((160, 120), 5), ((640, 480), 15)];

/// The cost for one engine, precision and output. The field names are those of the JSON document.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Cost {
    /// In which way the scene is ill-conditioned.
    pub stiff: Name,
    pub engine: Name,
    pub precision: Name,
    pub output: Name,
    /// Nanoseconds per ray of the ordinary picture in the median run.
    pub ordinary_ns_per_ray: f64,
    pub stiff_ns_per_ray: f64,
    /// The ill-conditioned picture's time divided by the ordinary one's, pair by pair.
    pub ratio: Estimate,
}

/// An ordinary and an ill-conditioned scene that show the same picture.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The family whose scenes are ill-conditioned in the same way.
    family: &'static str,
    /// In which way the second scene is ill-conditioned.
    stiff: &'static str,
    ordinary: Scene,
    extreme: Scene,
}

/// The pairs of scenes, with pictures of this size.
fn pairs((width, height): (u32, u32)) -> [Pair; 3] {
    let [sphere, tetrahedron] = ["sphere", "tetrahedron"].map(|name| in_size(&subjects::shipped(name), width, height));
    let pair = |family, stiff, ordinary: &Scene, extreme| Pair { family, stiff, ordinary: ordinary.clone(), extreme };
    let small = 2f32.powi(SMALL);
    [
        pair("S1", "sphere, κ = 10⁴", &sphere, far(&sphere)),
        pair("S3", "sphere, size 2⁻⁷⁰", &sphere, sphere.scaled(small)),
        pair("T5", "tetrahedron, size 2⁻⁷⁰", &tetrahedron, tetrahedron.scaled(small)),
    ]
}

/// The scene with its sphere and its lights moved away to a distance of [`KAPPA`] radii, and its
/// film reduced so that the sphere fills as much of it as before.
fn far(scene: &Scene) -> Scene {
    let sphere = scene.spheres[0];
    let kappa = sphere.centre.length() / sphere.radius;
    let tangent = |kappa: f32| 1.0 / (kappa * kappa - 1.0).sqrt();
    let mut far = scene.scaled(KAPPA / kappa);
    far.spheres[0].radius = sphere.radius;
    let film = scene.camera.film() * tangent(KAPPA) / tangent(kappa);
    let camera = Camera::new(scene.camera.width(), scene.camera.height(), scene.camera.focal(), film);
    Scene { camera: camera.expect("a film of any size above 0 is within the limits"), ..far }
}

/// Times every contender on the pairs of `families`, the two scenes in turns, on one thread.
///
/// # Errors
/// If an engine cannot be prepared, or if there is not enough memory.
pub fn measure(families: &[&Family], contenders: &[Contender], quick: bool) -> Result<Vec<Cost>, LabError> {
    let (size, rounds) = SIZES[usize::from(!quick)];
    let mut costs = Vec::new();
    for Pair { stiff, ordinary, extreme, .. } in
        pairs(size).iter().filter(|pair| families.iter().any(|family| family.id == pair.family))
    {
        let pixels = ordinary.camera.pixels() as f64;
        for contender in contenders {
            for output in [PixelFormat::F32x3, PixelFormat::Rgb8] {
                let format = contender.engine.format_for(output.is_8bit());
                if output.is_8bit() != format.is_8bit() {
                    continue;
                }
                let case = |scene| Case::of(Timed::Tracing, scene, contender.engine, contender.purpose(), format);
                let cases = [case(ordinary)?, case(extreme)?];
                let runs = Bench::default().time(&mut MachineClock::wall(), &cases, 0..rounds, &mut || true)?;
                let Some([usual, stiff_runs]) = runs.as_deref() else { continue };
                let ns = |ticks: &[f64]| median(ticks) / pixels;
                costs.push(Cost {
                    stiff: (*stiff).into(),
                    engine: contender.engine.name().into(),
                    precision: contender.precision.name().into(),
                    output: output.name().into(),
                    ordinary_ns_per_ray: ns(&usual.ticks),
                    stiff_ns_per_ray: ns(&stiff_runs.ticks),
                    ratio: Pairs::of(stiff_runs, usual).estimate(1),
                });
            }
        }
    }
    Ok(costs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayo::internals::render::Engine;

    #[test]
    fn both_scenes_of_a_pair_show_the_same_picture() {
        for Pair { stiff, ordinary, extreme, .. } in pairs((80, 60)) {
            let hits = |scene: &Scene| {
                let tracer = Engine::Reference.prepare(None, scene).unwrap();
                tracer.hits(0..60).iter().map(Option::is_some).collect::<Vec<_>>()
            };
            let [ordinary, extreme] = [ordinary, extreme].map(|scene| hits(&scene));
            let differ = ordinary.iter().zip(&extreme).filter(|(a, b)| a != b).count();
            let hit = ordinary.iter().filter(|hit| **hit).count();
            // In perspective the outlines of the near and the far sphere differ by a part of a
            // pixel.
            assert!(hit > 500 && differ <= hit / 100, "{stiff}: {differ} of {hit}");
        }
    }
}
