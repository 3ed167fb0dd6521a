//! The adversarial search: a scene is perturbed at random, and what is worse than before is kept.

use std::fmt::{self, Display, Formatter};

use glam::Vec3;

use crate::experiments::PictureError;
use crate::experiments::accuracy::{Contender, judge};
use crate::scene::{Camera, Rng, Scene, Sphere};

/// How bad a picture is, the worst first: wrong hits and levels off by two, the share of the bound, levels off by one.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Badness {
    /// Rays with a wrong hit or another object, and pixels off by two levels or more.
    pub wrong: usize,
    /// The largest error of t as a share of its documented bound.
    pub bound_share: f64,
    /// Pixels off by a level.
    pub off_by_1: usize,
}

impl Display for Badness {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Badness { wrong, bound_share, off_by_1 } = self;
        write!(
            f,
            "{wrong} rays or pixels wrong, t off by at most {bound_share:.2} of its bound, {off_by_1} pixels off by a level"
        )
    }
}

/// What one of `contenders` at its worst makes of a scene.
///
/// # Errors
/// A scene whose numbers no scene may have.
pub fn badness(scene: &Scene, contenders: &[Contender]) -> Result<Badness, PictureError> {
    let of = |errors: &crate::experiments::accuracy::errors::Errors| Badness {
        wrong: errors.wrong_hits + errors.wrong_objects + errors.off_by_2,
        bound_share: errors.bound_share.unwrap_or(0.0),
        off_by_1: errors.off_by_1,
    };
    let judged = judge(scene, contenders)?;
    let worst = judged.iter().map(|judged| of(&judged.errors)).max_by(|a, b| a.partial_cmp(b).expect("no NaN"));
    Ok(worst.unwrap_or_default())
}

/// The worst of `steps` perturbations of `scene` with a picture of `side` x `side` pixels, each of the worst so far. Its
/// film is of diagonal 1, so that a scene file says all of it.
///
/// # Errors
/// As [`badness`].
pub fn search(
    scene: &Scene,
    contenders: &[Contender],
    side: u32,
    steps: usize,
    rng: &mut Rng,
) -> Result<(Scene, Badness), PictureError> {
    let camera = |focal: f32| Camera::new(side, side, focal, 1.0);
    let focal = scene.camera.focal() / scene.camera.film();
    let mut worst = Scene { camera: camera(focal).unwrap_or(scene.camera), ..scene.clone() };
    let mut found = badness(&worst, contenders)?;
    for _ in 0..steps {
        let mut next = worst.clone();
        perturb(&mut next, rng);
        if let Ok(camera) = camera(jitter(worst.camera.focal(), rng)) {
            next.camera = camera;
        }
        if next.check().is_err() {
            continue;
        }
        let badness = badness(&next, contenders)?;
        if badness > found {
            (worst, found) = (next, badness);
        }
    }
    Ok((worst, found))
}

/// Changes some numbers of the scene a little, or by a lot.
fn perturb(scene: &mut Scene, rng: &mut Rng) {
    let vector = |v: &mut Vec3, rng: &mut Rng| *v = Vec3::from(v.to_array().map(|x| jitter(x, rng)));
    for light in &mut scene.lights {
        vector(&mut light.position, rng);
        vector(&mut light.colour, rng);
        light.intensity = jitter(light.intensity, rng);
    }
    for sphere in &mut scene.spheres {
        vector(&mut sphere.centre, rng);
        sphere.radius = jitter(sphere.radius, rng);
    }
    scene.triangles.iter_mut().flat_map(|triangle| &mut triangle.vertices).for_each(|vertex| vector(vertex, rng));
    // Now and then one takes another's place, in its own colour: which of the two is seen shows.
    if rng.next_u64().is_multiple_of(8) {
        let mut two = |length: usize| [(); 2].map(|()| (rng.next_u64() % length.max(1) as u64) as usize);
        let ([a, b], [c, d]) = (two(scene.spheres.len()), two(scene.triangles.len()));
        if a != b {
            scene.spheres[a] = Sphere { colour: scene.spheres[a].colour, ..scene.spheres[b] };
        }
        if c != d {
            scene.triangles[c].vertices = scene.triangles[d].vertices;
        }
    }
}

/// `x` with a relative change of any size down to one unit in the last place; unchanged in two of three cases.
fn jitter(x: f32, rng: &mut Rng) -> f32 {
    if !rng.next_u64().is_multiple_of(3) {
        return x;
    }
    let size = 2f32.powf(rng.between(-23.0, -3.0));
    x + x * size * rng.between(-1.0, 1.0)
}
