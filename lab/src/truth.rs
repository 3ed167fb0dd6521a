//! The true picture of a scene: what each ray hits, where, and in which colour, with certainty.
//!
//! Objects that a ray certainly misses are excluded in f64, with a bound on the rounding. The
//! others are tested in numbers that carry a bound on their own error, and in 1024 bits where these
//! do not decide.

use std::collections::HashMap;
use std::sync::OnceLock;

use glam::{DVec3, Vec3};

use crate::exact::bounded::Bounded;
use crate::exact::digits::Exact;
use crate::exact::number::{Number, Operations, Split};
use crate::exact::shadows::{Caster, Segment};
use crate::exact::shapes::{self, Meeting, Ray, Rays, Vector};
use rayo::internals::reference::geometry;
use rayo::internals::scene::{Grid, Object, Scene, Sphere, Triangle};

/// Objects whose margin to a ray exceeds this are not examined closely; all margins that anyone
/// asks for are smaller.
const FAR: f64 = 1e-4;
/// A bound on all rounding errors of a test in f64, including those of the ray, relative to the sum
/// of the magnitudes of the test's terms.
const ROUNDING: f64 = 64.0 * f64::EPSILON;
/// If a light is nearer to a surface than this share of the surface's distance from the camera, its
/// direction is rounding noise in f32.
const AT_THE_SURFACE: f64 = 1e-4;
/// If a triangle's plane is nearer to the camera than this share of the nearest corner's distance,
/// v . n cancels so much in f64 that about seven digits or fewer are left.
const AT_THE_CAMERA: f64 = 1e-8;
/// A cosine below this is at the terminator: f32 may round it to 0.
const AT_THE_TERMINATOR: f64 = 1e-4;
/// The largest relative error of a hit's values that is accepted: less than f64 can resolve.
const SURE: f64 = f64::EPSILON / 64.0;

#[derive(Clone, Debug)]
pub struct TruePixel {
    /// The first object that the ray hits.
    pub hit: Option<TrueHit>,
    /// The distance from another result: the smallest margin of any object that could change the
    /// hit, or the gap to the second hit relative to t. Objects at exactly the same t do not count,
    /// since the first in the scene's order wins.
    pub margin: f64,
}

#[derive(Clone, Debug)]
pub struct TrueHit {
    pub object: Object,
    /// The distance t; the hit is at the point t r_d.
    pub t: Split,
    /// The unit normal; for a triangle, either of the two.
    pub normal: [Split; 3],
    /// L . N for each light: below 0 for a light behind a sphere's surface, 0 for one on the
    /// surface and for one that is hidden.
    pub cosines: Vec<f64>,
    /// The distance from another result for shadows: the smallest relative change of a quantity
    /// that would change which lights are hidden.
    pub shadow: f64,
    /// Whether the hit is at the terminator of a light so bright that rounding in f32 decides
    /// between black and white.
    pub dazzled: bool,
    /// The linear colour, not clamped. None if a light is so near that its direction is rounding
    /// noise in f32, or if a triangle's plane is so near to the camera that its distance is noise
    /// in f64.
    pub colour: Option<DVec3>,
    /// The documented bound of |error of t| / t, in units of the engine's u.
    pub bound: f64,
    /// The factor by which a rounding of the camera's numbers, relative to its longest ray, changes
    /// t: 1 / the cosine between the ray and the normal, times the longest ray's length over this
    /// ray's.
    pub lever: f64,
}

struct Light {
    position: DVec3,
    radiance: DVec3,
}

/// An object in f64, with the values needed to exclude it.
enum F64Object {
    Sphere { centre: DVec3, radius: f64, k: f64 },
    Triangle { vertices: [DVec3; 3], edges: [DVec3; 3], sizes: [DVec3; 3] },
}

enum Shape<N> {
    Sphere(shapes::Sphere<N>),
    Triangle(Box<shapes::Triangle<N>>),
}

struct Body {
    object: Object,
    quick: F64Object,
    /// The shape in numbers with error bounds; None if these cannot represent it with certainty.
    bounded: Option<Shape<Bounded>>,
    /// The shape in 1024 bits, made when it is first needed.
    exact: OnceLock<Shape<Exact>>,
    colour: DVec3,
    /// The index of the first object that is equal in everything but colour; the two tie wherever
    /// they are hit.
    same_as: usize,
    /// Whether the plane of a triangle is so near to the camera, although its corners are far away,
    /// that f64 cannot determine its distance.
    grazes_camera: bool,
}

/// How a ray meets a body.
struct BodyMeeting<N> {
    /// The index of the body.
    body: usize,
    meeting: Meeting<N>,
}

/// The first body that a ray hits.
struct FirstHit<'a, N> {
    /// The index of the body.
    body: usize,
    meeting: &'a Meeting<N>,
    t: &'a N,
}

/// What a ray hits first, if anything, and the distance from another result; see
/// [`TruePixel::margin`].
struct HitAndMargin<'a, N> {
    first: Option<FirstHit<'a, N>>,
    margin: f64,
}

/// A light as seen from a point of a surface.
struct LightAtPoint {
    /// L . N: below 0 for a light behind the surface; 0 for one at the point or hidden from it.
    cosine: f64,
    /// Whether the light is so near that its direction is rounding noise in f32.
    is_near: bool,
}

/// A point at which a ray hits a body.
struct SurfacePoint<'a, N> {
    body: &'a Body,
    point: Vector<N>,
    normal: Vector<N>,
    /// A bound on the error of the point that an engine computes, in units of its u.
    units: f64,
}

/// What the true pixels of one scene and camera are computed from.
pub struct Truth {
    grid: Grid<f64>,
    rays: Rays,
    /// The x of the rays of each column, the y of those of each row, and the z of all.
    across: Vec<Bounded>,
    up: Vec<Bounded>,
    focal: Bounded,
    lights: Vec<Light>,
    bodies: Vec<Body>,
    /// The objects that cast shadows, and the index of the first triangle among them.
    casters: Vec<Caster>,
    first_triangle: usize,
}

impl Truth {
    /// Prepares the truth of `scene`, whose f32 numbers are taken as exact.
    pub fn new(scene: &Scene) -> Self {
        let camera = &scene.camera;
        let lights = scene.lights.iter().map(|light| Light {
            position: light.position.as_dvec3(),
            radiance: f64::from(light.intensity) * light.colour.as_dvec3(),
        });
        let spheres = scene.spheres.iter().enumerate().map(|(i, sphere)| Body::sphere(i, sphere));
        let triangles = scene.all_triangles().enumerate().map(|(i, triangle)| Body::triangle(i, &triangle));
        let mut bodies: Vec<Body> = spheres.chain(triangles).flatten().collect();
        // Adding 0.0 turns -0 into 0, which is the same number.
        let bits = |v: Vec3| v.to_array().map(|x| (x + 0.0).to_bits());
        let mut seen = HashMap::new();
        for (i, body) in bodies.iter_mut().enumerate() {
            let shape = match body.object {
                Object::Sphere(i) => [Vec3::splat(scene.spheres[i].radius), scene.spheres[i].centre, Vec3::NAN],
                Object::Triangle(i) => scene.triangle(i).vertices,
            };
            body.same_as = *seen.entry(shape.map(bits)).or_insert(i);
        }
        let rays = Rays::new(camera.width(), camera.height(), camera.focal(), camera.film());
        let across = (0..camera.width()).map(|col| Bounded::from(&rays.across(col))).collect();
        let up = (0..camera.height()).map(|row| Bounded::from(&rays.up(row))).collect();
        let focal = Bounded::new(camera.focal().into());
        let of_sphere = |s: &Sphere| Caster::Sphere { centre: s.centre.as_dvec3(), radius: s.radius.into() };
        let of_triangle = |t: Triangle| Caster::Triangle(t.vertices.map(|v| v.as_dvec3()));
        let all = scene.spheres.iter().map(of_sphere).chain(scene.all_triangles().map(of_triangle));
        let casters = all.filter(|_| scene.shadows).collect();
        let (lights, first_triangle) = (lights.collect(), scene.spheres.len());
        Truth { grid: camera.grid(), rays, across, up, focal, lights, bodies, casters, first_triangle }
    }

    pub fn pixel(&self, row: u32, col: u32) -> TruePixel {
        self.quick_pixel(row, col).unwrap_or_else(|| self.exact_pixel(row, col))
    }

    /// The objects that f64 cannot exclude.
    fn near(&self, row: u32, col: u32) -> Vec<usize> {
        let d = DVec3::from(self.grid.ray(row, col));
        let reach = DVec3::new(self.grid.half_width, self.grid.half_height, self.grid.focal);
        (0..self.bodies.len()).filter(|i| !self.bodies[*i].quick.certainly_missed(d, reach)).collect()
    }

    /// The truth of a pixel computed in 1024 bits alone, by which the quick computation is checked.
    pub fn exact_pixel(&self, row: u32, col: u32) -> TruePixel {
        let ray = self.rays.ray(row, col);
        self.known_pixel(&self.near(row, col), &ray, |body| Some(body.exact())).expect("1024 bits know everything")
    }

    /// The truth of a pixel computed in numbers with error bounds; None if these do not decide.
    pub fn quick_pixel(&self, row: u32, col: u32) -> Option<TruePixel> {
        let near = self.near(row, col);
        if near.is_empty() {
            return Some(TruePixel { hit: None, margin: f64::INFINITY });
        }
        let d = Vector([self.across[col as usize], self.up[row as usize], self.focal]);
        self.known_pixel(&near, &Ray::within(d, self.rays.reach), |body| body.bounded.as_ref())
    }

    /// The truth of a pixel whose ray can meet only the objects `near`. None if numbers of type `N`
    /// do not decide.
    fn known_pixel<N: Number + 'static>(
        &self,
        near: &[usize],
        ray: &Ray<N>,
        shape: impl Fn(&Body) -> Option<&Shape<N>>,
    ) -> Option<TruePixel>
    where
        for<'n> &'n N: Operations<N>,
    {
        let meet = |&body: &usize| Some(BodyMeeting { body, meeting: shape(&self.bodies[body])?.meet(ray)? });
        let meetings = near.iter().map(meet).collect::<Option<Vec<_>>>()?;
        let HitAndMargin { first, margin } = self.first(&meetings)?;
        let hit = match first {
            Some(first) => Some(self.hit(&first, shape(&self.bodies[first.body])?, ray)?),
            None => None,
        };
        Some(TruePixel { hit, margin })
    }

    /// The first object that the ray hits, and the distance from another result.
    fn first<'a, N: Number>(&self, meetings: &'a [BodyMeeting<N>]) -> Option<HitAndMargin<'a, N>>
    where
        for<'n> &'n N: Operations<N>,
    {
        // The gap between a hit and the `first` hit, relative to the latter's t.
        let gap = |t: &N, first: &N| (&(t - first) / first).to_f64().max(0.0);
        let same = |a: usize, b: usize| self.bodies[a].same_as == self.bodies[b].same_as;
        let mut first: Option<FirstHit<'a, N>> = None;
        for BodyMeeting { body, meeting } in meetings {
            let Some(t) = &meeting.hit else { continue };
            let nearer = match &first {
                // Of objects that tie, the first in the scene's order wins.
                Some(first) if same(*body, first.body) => false,
                Some(first) => (first.t - t).sign()? > 0,
                None => true,
            };
            if nearer {
                first = Some(FirstHit { body: *body, meeting, t });
            }
        }
        let mut margin = first.as_ref().map_or(f64::INFINITY, |first| first.meeting.margin);
        for BodyMeeting { body, meeting } in meetings {
            let change = match &first {
                Some(first) if same(*body, first.body) => continue,
                // An object behind the first hit could change the result only by its gap or, if it
                // is missed narrowly, by its margin as well.
                Some(first) => match (&meeting.hit, &meeting.miss) {
                    (Some(other), _) => gap(other, first.t),
                    (None, Some(other)) => gap(other, first.t).max(meeting.margin),
                    (None, None) => meeting.margin,
                },
                None => meeting.margin,
            };
            margin = margin.min(change);
        }
        Some(HitAndMargin { first, margin })
    }

    /// The true values of a hit on this shape; None if a number is not known accurately enough.
    fn hit<N: Number>(&self, first: &FirstHit<'_, N>, shape: &Shape<N>, ray: &Ray<N>) -> Option<TrueHit>
    where
        for<'n> &'n N: Operations<N>,
    {
        let FirstHit { body, meeting, t } = *first;
        let body = &self.bodies[body];
        let point = ray.d.scale(t);
        let normal = match shape {
            Shape::Sphere(sphere) => sphere.normal(ray, t),
            Shape::Triangle(triangle) => triangle.normal().clone(),
        };
        if !is_sure(t, t.to_f64()) || !normal.0.iter().all(|x| is_sure(x, 1.0)) {
            return None;
        }
        let lever = meeting.slant * ray.longest_over_this();
        let at = SurfacePoint { body, point, normal, units: meeting.bound + 4.0 * lever };
        let mut lights = self.lights_at(&at)?;
        let shadow = self.find_hidden(&at, &mut lights)?;
        let near_light = lights.iter().any(|light| light.is_near);
        let cosines: Vec<f64> = lights.into_iter().map(|light| body.facing(light.cosine)).collect();
        let lit = cosines.iter().zip(&self.lights);
        let colour: DVec3 = lit.map(|(cosine, light)| cosine.max(0.0) * light.radiance * body.colour).sum();
        let dazzling = |(cosine, light): (&f64, &Light)| {
            let brightest = (light.radiance * body.colour).max_element();
            cosine.abs() < AT_THE_TERMINATOR && AT_THE_TERMINATOR * brightest > 1.0
        };
        let dazzled = cosines.iter().zip(&self.lights).any(dazzling);
        Some(TrueHit {
            object: body.object,
            t: t.split(),
            normal: at.normal.0.each_ref().map(N::split),
            cosines,
            shadow,
            dazzled,
            colour: (!near_light && !body.grazes_camera).then_some(colour),
            bound: meeting.bound,
            lever,
        })
    }

    /// Each light as seen from a point if no object casts a shadow. None if a number is not known
    /// accurately enough.
    fn lights_at<N: Number>(&self, at: &SurfacePoint<'_, N>) -> Option<Vec<LightAtPoint>>
    where
        for<'n> &'n N: Operations<N>,
    {
        let reach = AT_THE_SURFACE * at.point.length().to_f64();
        let mut seen = Vec::with_capacity(self.lights.len());
        for light in &self.lights {
            let to_light = Vector::new(light.position.into()).sub(&at.point);
            let squared = to_light.dot(&to_light);
            if squared.sign()? == 0 {
                seen.push(LightAtPoint { cosine: 0.0, is_near: true });
                continue;
            }
            let length = squared.sqrt();
            let cosine = &to_light.dot(&at.normal) / &length;
            if !is_sure(&cosine, 1.0) {
                return None;
            }
            seen.push(LightAtPoint { cosine: cosine.to_f64(), is_near: length.to_f64() < reach });
        }
        Some(seen)
    }

    /// Sets the cosines of `lights` that are hidden from a point to 0, and returns
    /// [`TrueHit::shadow`]. None if a number is not known accurately enough.
    fn find_hidden<N: Number>(&self, at: &SurfacePoint<'_, N>, lights: &mut [LightAtPoint]) -> Option<f64>
    where
        for<'n> &'n N: Operations<N>,
    {
        let mut shadow = f64::INFINITY;
        if self.casters.is_empty() {
            return Some(shadow);
        }
        // The camera is on the side of the normal on which a light's cosine has this sign.
        let before = -at.point.dot(&at.normal).to_f64().signum();
        for (seen, light) in lights.iter_mut().zip(&self.lights) {
            if at.body.facing(seen.cosine) > 0.0 {
                let is_behind = match &at.body.quick {
                    F64Object::Sphere { centre, radius, .. } => geometry::power(*centre, *radius) <= 0.0,
                    F64Object::Triangle { .. } => seen.cosine * before < 0.0,
                };
                let hidden =
                    if is_behind { f64::INFINITY } else { self.hidden(at.body.object, &at.point, light, at.units)? };
                if hidden >= 0.0 {
                    seen.cosine = 0.0;
                }
                shadow = shadow.min(hidden.abs());
            }
        }
        Some(shadow)
    }

    /// Whether something hides a light from a point of an object, as
    /// [`shadows`](crate::exact::shadows) answers.
    fn hidden<N: Number>(&self, object: Object, point: &Vector<N>, light: &Light, units: f64) -> Option<f64>
    where
        for<'n> &'n N: Operations<N>,
    {
        let own = match object {
            Object::Sphere(i) => i,
            Object::Triangle(i) => self.first_triangle + i,
        };
        let quick = Segment::<f64>::new(Vector::<f64>(point.to_f64()), light.position, units);
        let segment = Segment::new(point.clone(), light.position, units);
        let mut hidden = f64::NEG_INFINITY;
        for (_, caster) in self.casters.iter().enumerate().filter(|(i, _)| *i != own) {
            let sure = quick.is_hidden_by(caster).filter(|sure| sure.is_finite() && sure.abs() > FAR);
            hidden = hidden.max(match sure {
                Some(sure) => sure,
                None => segment.is_hidden_by(caster)?,
            });
            if hidden > FAR {
                break;
            }
        }
        Some(hidden)
    }
}

impl<N: Number> Shape<N>
where
    for<'n> &'n N: Operations<N>,
{
    fn meet(&self, ray: &Ray<N>) -> Option<Meeting<N>> {
        match self {
            Shape::Sphere(sphere) => sphere.meet(ray),
            Shape::Triangle(triangle) => triangle.meet(ray),
        }
    }
}

/// Whether a number of about this size is known accurately enough.
fn is_sure<N: Number>(x: &N, size: f64) -> bool {
    x.is_within(SURE * size)
}

impl Body {
    /// The cosine of a light, of which a triangle has one on both of its sides.
    fn facing(&self, cosine: f64) -> f64 {
        match self.object {
            Object::Sphere(_) => cosine,
            Object::Triangle(_) => cosine.abs(),
        }
    }

    /// The quick test of a sphere; None if it is never hit.
    fn sphere(i: usize, sphere: &Sphere) -> Option<Self> {
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        if !(radius > 0.0 && radius.is_finite() && centre.is_finite()) {
            return None;
        }
        Some(Body {
            object: Object::Sphere(i),
            quick: F64Object::Sphere { centre, radius, k: centre.dot(centre) - radius * radius },
            bounded: shapes::Sphere::new(centre.into(), radius).map(Shape::Sphere),
            exact: OnceLock::new(),
            colour: sphere.colour.as_dvec3(),
            same_as: 0,
            grazes_camera: false,
        })
    }

    /// The quick test of a triangle; None if it is never hit.
    fn triangle(i: usize, triangle: &Triangle) -> Option<Self> {
        let vertices = triangle.vertices.map(|v| v.as_dvec3());
        let bounded = shapes::Triangle::new(vertices.map(Into::into)).map(Box::new).map(Shape::Triangle);
        if bounded.is_none() {
            shapes::Triangle::<Exact>::new(vertices.map(Into::into))?;
        }
        let [v1, v2, v3] = vertices;
        // If f64 cannot decide the sign of the volume, nothing is excluded.
        let volume = geometry::triangle_volume(vertices).unwrap_or(0.0);
        let sign = if volume == 0.0 { 0.0 } else { volume.signum() };
        let nearest = vertices.map(DVec3::length).into_iter().fold(f64::INFINITY, f64::min);
        let grazes_camera = volume.abs() < AT_THE_CAMERA * nearest * geometry::triangle_plane(vertices).length();
        let edges = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| v.cross(w) * sign);
        let sizes = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| {
            let (v, w) = (v.abs(), w.abs());
            DVec3::new(v.y * w.z + v.z * w.y, v.z * w.x + v.x * w.z, v.x * w.y + v.y * w.x)
        });
        Some(Body {
            object: Object::Triangle(i),
            quick: F64Object::Triangle { vertices, edges, sizes },
            bounded,
            exact: OnceLock::new(),
            colour: triangle.colour.as_dvec3(),
            same_as: 0,
            grazes_camera,
        })
    }

    fn exact(&self) -> &Shape<Exact> {
        self.exact.get_or_init(|| match &self.quick {
            F64Object::Sphere { centre, radius, .. } => {
                Shape::Sphere(shapes::Sphere::new((*centre).into(), *radius).expect("it has a radius"))
            }
            F64Object::Triangle { vertices, .. } => {
                let triangle = shapes::Triangle::new(vertices.map(Into::into));
                Shape::Triangle(Box::new(triangle.expect("it can be hit")))
            }
        })
    }
}

impl F64Object {
    /// Whether the ray certainly misses the object: neither rounding errors nor a margin below
    /// [`FAR`] could make it a hit. Numbers that are not finite exclude nothing.
    fn certainly_missed(&self, d: DVec3, reach: DVec3) -> bool {
        match self {
            F64Object::Sphere { centre, radius, k } => {
                // The ray's distance from the centre, |c x d| / |d|, compared with the radius.
                let squared = d.dot(d) * radius * radius;
                let across = centre.cross(d).length();
                let distance = across - ROUNDING * centre.length() * reach.length();
                let far = distance > 0.0 && distance * distance > (1.0 + 2.0 * FAR) * squared;
                let behind = d.dot(*centre) < -ROUNDING * centre.length() * reach.length();
                let outside = *k > ROUNDING * centre.dot(*centre);
                outside && (far || behind)
            }
            F64Object::Triangle { edges, sizes, .. } => edges.iter().zip(sizes).any(|(edge, size)| {
                let doubt = FAR * edge.abs().dot(reach) + ROUNDING * size.dot(reach);
                edge.dot(d) < -doubt
            }),
        }
    }
}
