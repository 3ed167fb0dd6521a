//! What tiles keep and cull, counted.

use glam::DVec3;

use super::light::is_dark;
use super::omission::{Omission, Switch};
use super::report::{ByTiles, Kept, LeftOut, Report};
use super::team::on_all_cores;
use super::tiles::{Tiles, covered};
use crate::kernels::{Element, PixelBounds, TILE_HEIGHT, TILE_WIDTH};
use crate::reference::geometry;
use crate::scene::{Grid, Sphere, Triangle};

/// The counts of a picture after the nearest objects of each tile have been found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileSurvey {
    /// Tiles that no object's bounds meet.
    pub empty: u64,
    /// Objects of tiles, each counted in every tile that its bounds meet.
    pub placed: u64,
    /// Objects of tiles that need no set-up, since nearer ones hide them.
    pub occluded: u64,
    /// Objects of tiles that are tested and nearest at no pixel.
    pub unseen: u64,
    /// Spheres in the picture that have the short form in bytes.
    pub short: u64,
}

impl TileSurvey {
    /// The sum for two parts of the picture.
    pub fn and(self, other: Self) -> Self {
        TileSurvey {
            empty: self.empty + other.empty,
            placed: self.placed + other.placed,
            occluded: self.occluded + other.occluded,
            unseen: self.unseen + other.unseen,
            short: self.short + other.short,
        }
    }
}

/// A pyramid of rays, which tells why an object has no pixel among them.
#[derive(Clone, Copy, Debug)]
pub struct Frustum {
    /// Unit normals, outwards, of the planes through the camera and the picture's four sides.
    sides: [DVec3; 4],
}

impl Frustum {
    /// The frustum of a picture.
    pub fn new(&Grid { half_width, half_height, focal, .. }: &Grid<f64>) -> Self {
        Frustum::between([-half_width, half_width], [-half_height, half_height], focal)
    }

    /// The frustum of the rays from one x to another and from one y to another, at the focal distance.
    pub fn between([left, right]: [f64; 2], [low, high]: [f64; 2], focal: f64) -> Self {
        let sides = [
            DVec3::new(focal, 0.0, -right),
            DVec3::new(-focal, 0.0, left),
            DVec3::new(0.0, focal, -high),
            DVec3::new(0.0, -focal, low),
        ];
        Frustum { sides: sides.map(DVec3::normalize) }
    }

    /// Why no ray passes within the bounds of a sphere.
    pub fn unseen_sphere(&self, sphere: &Sphere) -> Omission {
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        if centre.z <= -radius {
            Omission::Behind
        } else if self.sides.iter().any(|side| side.dot(centre) >= radius) {
            Omission::Outside
        } else {
            Omission::Between
        }
    }

    /// Why no ray passes within the bounds of a triangle.
    pub fn unseen_triangle(&self, triangle: &Triangle) -> Omission {
        let corners = triangle.vertices.map(|v| v.as_dvec3());
        if corners.iter().all(|v| v.z <= 0.0) {
            Omission::Behind
        } else if self.sides.iter().any(|side| corners.iter().all(|v| side.dot(*v) >= 0.0)) {
            Omission::Outside
        } else if geometry::has_no_area(corners) {
            Omission::NoArea
        } else {
            Omission::Between
        }
    }
}

/// Why a triangle that has pixels in its bounds is never hit, if that is so.
pub(super) fn never_hit(triangle: &Triangle) -> Option<Omission> {
    let corners = triangle.vertices.map(|v| v.as_dvec3());
    match geometry::triangle_volume(corners) {
        Some(_) => None,
        None if geometry::has_no_area(corners) => Some(Omission::NoArea),
        None => Some(Omission::EdgeOn),
    }
}

/// The numbers of objects of a kind that each omission drops; the number of those kept, and the pixels within their
/// bounds.
#[derive(Clone, Copy, Default)]
struct Counts {
    left_out: [u64; Omission::ALL.len()],
    kept: u64,
    covered: u64,
}

impl Counts {
    fn one(mut self, left_out: Option<Omission>, covered: u64) -> Self {
        match left_out {
            Some(omission) => self.left_out[omission as usize] += 1,
            None => {
                self.kept += 1;
                self.covered += covered;
            }
        }
        self
    }

    fn and(mut self, other: Self) -> Self {
        self.left_out.iter_mut().zip(other.left_out).for_each(|(sum, more)| *sum += more);
        Counts { kept: self.kept + other.kept, covered: self.covered + other.covered, ..self }
    }

    /// Counts all objects: `unseen` says why one without pixels is dropped, `why` whether one with some is.
    fn of<T>(
        count: usize,
        object: impl Fn(usize) -> T + Sync,
        bounds: &[PixelBounds],
        unseen: impl Fn(&T) -> Omission + Sync,
        why: impl Fn(&T) -> Option<Omission> + Sync,
    ) -> Self {
        /// The number that a thread takes at a time.
        const TOGETHER: usize = 1 << 12;
        let pixels = |i: usize| bounds.iter().map(|bounds| covered(bounds.columns[i], bounds.rows[i])).sum();
        let add = |sum: Counts, i: usize| match pixels(i) {
            0 => sum.one(Some(unseen(&object(i))), 0),
            covered => sum.one(why(&object(i)), covered),
        };
        let some = |part: usize| (part * TOGETHER..count.min((part + 1) * TOGETHER)).fold(Counts::default(), add);
        on_all_cores(count.div_ceil(TOGETHER), some).into_iter().fold(Counts::default(), Counts::and)
    }
}

impl Report {
    /// The report on a scene that is traced in the tiles of `rasters`; `survey` is that of the whole picture, and
    /// `bytes` says whether the engine writes 8 bits.
    pub fn of_tiles<E: Element>(rasters: &[&Tiles<'_, E>], survey: TileSurvey, bytes: bool) -> Self {
        let (scene, keep) = (rasters[0].scene(), rasters[0].keep());
        let frustum = Frustum::new(&scene.camera.grid());
        let spheres = Counts::of(
            scene.spheres.len(),
            |i| scene.spheres[i],
            &rasters.iter().map(|tiles| tiles.sphere_bounds()).collect::<Vec<_>>(),
            |sphere| frustum.unseen_sphere(sphere),
            |_| None,
        );
        let triangles = Counts::of(
            scene.triangle_count(),
            |i| scene.triangle(i),
            &rasters.iter().map(|tiles| tiles.triangle_bounds()).collect::<Vec<_>>(),
            |triangle| frustum.unseen_triangle(triangle),
            never_hit,
        );
        let both = spheres.and(triangles);
        let dark = scene.lights.iter().filter(|light| is_dark(light)).count();
        let along = |side: usize| {
            rasters.iter().filter(|tiles| tiles.raster().first[1 - side] == 0).map(|tiles| tiles.tiles()[side]).sum()
        };
        let [across, down] = [0, 1].map(along);
        let count: u64 = rasters.iter().map(|tiles| tiles.tiles().map(u64::from).iter().product::<u64>()).sum();
        let pixels = scene.camera.pixels();
        let objects = (scene.spheres.len() + scene.triangle_count()) as u64;
        let counted = |omission: Omission| match omission {
            Omission::Behind | Omission::Outside | Omission::NoArea | Omission::EdgeOn | Omission::Between => {
                both.left_out[omission as usize]
            }
            Omission::DarkLights => dark as u64,
            Omission::SphereCode => (spheres.kept == 0).into(),
            Omission::TriangleCode => (triangles.kept == 0).into(),
            Omission::EmptyTiles => survey.empty,
            Omission::OtherTiles => objects * count - survey.placed,
            Omission::Occluded => survey.occluded,
            Omission::Misses => both.kept * pixels - both.covered,
            Omission::Unseen => survey.unseen,
            Omission::Constants => both.kept,
            Omission::Loop if bytes => survey.short,
            Omission::FloatImage if bytes => pixels,
            _ => 0,
        };
        let line = |omission: Omission| {
            let line = LeftOut::none(omission).by_tiles();
            let kept = keep.has(omission) && line.switch != Switch::None;
            LeftOut { count: if kept { 0 } else { counted(omission) }, ..line }
        };
        let kept = Kept {
            spheres: spheres.kept as usize,
            triangles: triangles.kept as usize,
            lights: scene.lights.len() - dark,
        };
        let by_tiles = ByTiles {
            objects,
            width: TILE_WIDTH as u32,
            height: TILE_HEIGHT as u32,
            across,
            down,
            placed: survey.placed,
        };
        Report::with(kept, Some(by_tiles), Omission::ALL.into_iter().map(line))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;
    use glam::{Vec3, vec3};

    #[test]
    fn what_has_no_pixel_is_behind_outside_of_no_area_or_between() {
        let frustum = Frustum::new(&Camera::new(160, 120, 1.0, 1.0).unwrap().grid());
        let sphere = |centre: Vec3| frustum.unseen_sphere(&Sphere { radius: 1.0, colour: Vec3::ONE, centre });
        for (centre, why) in [
            (vec3(0.0, 0.0, -1.0), Omission::Behind),
            (vec3(-90.0, 0.0, 20.0), Omission::Outside),
            (vec3(90.0, 0.0, 20.0), Omission::Outside),
            (vec3(0.0, -90.0, 20.0), Omission::Outside),
            (vec3(0.0, 90.0, 20.0), Omission::Outside),
            (vec3(3.0, 3.0, 1e9), Omission::Between),
        ] {
            assert_eq!(sphere(centre), why, "{centre}");
        }
        let triangle = |vertices: [Vec3; 3]| frustum.unseen_triangle(&Triangle { colour: Vec3::ONE, vertices });
        let [a, b, c] = [vec3(1e-3, 0.0, 20.0), vec3(2e-3, 0.0, 20.0), vec3(1e-3, 1e-3, 20.0)];
        for (vertices, why) in [
            ([a, b, c].map(|v| -v), Omission::Behind),
            ([a, b, c].map(|v| v + 90.0 * Vec3::Y), Omission::Outside),
            ([a, b, b], Omission::NoArea),
            ([a, b, c], Omission::Between),
        ] {
            assert_eq!(triangle(vertices), why, "{vertices:?}");
        }
    }
}
