//! The truth of a picture: what each ray hits, where, and in which colour, beyond any doubt of f64.
//!
//! Which objects a ray certainly does not meet is decided in f64, with a bound on its rounding. All that remains is
//! computed in 256 bits.

use glam::DVec3;

use crate::reference::exact::{self, Exact, Meeting, Ray, Rays, Vector};
use crate::reference::geometry;
use crate::scene::{Camera, Grid, Object, Scene};

/// Further than this from being hit, in units of the margin, an object is not looked at in 256 bits. Any margin that is
/// asked about is smaller.
const FAR: f64 = 1e-4;
/// A share of what is added up that all roundings of a test in f64 stay below, those of the ray included.
const ROUNDING: f64 = 64.0 * f64::EPSILON;
/// A light nearer to the surface than this share of the surface's distance lies in a direction that f32 cannot tell.
const AT_THE_SURFACE: f64 = 1e-4;

/// What is true of a pixel.
#[derive(Clone, Debug)]
pub struct TruePixel {
    /// What the ray hits first.
    pub hit: Option<TrueHit>,
    /// How far from another answer that is: the smallest margin of an object that would change it, or the gap to the
    /// second hit as a share of t. Exact ties are no doubt: the first in order wins them.
    pub margin: f64,
}

/// What is true of a hit.
#[derive(Clone, Debug)]
pub struct TrueHit {
    /// The object.
    pub object: Object,
    /// Where: the point t r_d.
    pub t: Exact,
    /// The unit normal; of a triangle either of the two.
    pub normal: Vector,
    /// The linear colour, not clamped. None where a light is so near that its direction is rounding noise in f32.
    pub colour: Option<DVec3>,
    /// The documented bound of |error of t| / t, in units of the engine's u.
    pub bound: f64,
    /// By how many times what rounds the camera's numbers, as a share of its longest ray, changes t: 1 / the cosine
    /// between the ray and the normal, times the longest ray over this one.
    pub lever: f64,
}

struct Light {
    position: Vector,
    radiance: DVec3,
}

/// An object in f64, with what is needed to rule it out.
enum Quick {
    Sphere { centre: DVec3, radius: f64, k: f64 },
    Triangle { edges: [DVec3; 3], sizes: [DVec3; 3] },
}

enum Shape {
    Sphere(exact::Sphere),
    Triangle(Box<exact::Triangle>),
}

struct Body {
    object: Object,
    quick: Quick,
    shape: Shape,
    colour: DVec3,
    /// The first object that is the same in all but colour: the two tie wherever they are hit.
    same_as: usize,
}

/// The truth of one scene and camera.
pub struct Truth {
    grid: Grid<f64>,
    rays: Rays,
    lights: Vec<Light>,
    bodies: Vec<Body>,
}

impl Truth {
    /// Takes over `scene` as `camera` sees it; its f32 numbers are exact.
    pub fn new(scene: &Scene, camera: &Camera) -> Self {
        let lights = scene.lights.iter().map(|light| Light {
            position: Vector::new(light.position.as_dvec3().into()),
            radiance: f64::from(light.intensity) * light.colour.as_dvec3(),
        });
        let mut bodies: Vec<Body> = Vec::new();
        for (i, sphere) in scene.spheres.iter().enumerate() {
            let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
            let Some(shape) = exact::Sphere::new(centre.into(), radius) else { continue };
            let k = centre.dot(centre) - radius * radius;
            bodies.push(Body {
                object: Object::Sphere(i),
                quick: Quick::Sphere { centre, radius, k },
                shape: Shape::Sphere(shape),
                colour: sphere.colour.as_dvec3(),
                same_as: bodies.len(),
            });
        }
        for (i, triangle) in scene.triangles.iter().enumerate() {
            let vertices = triangle.vertices.map(|v| v.as_dvec3());
            let Some(shape) = exact::Triangle::new(vertices.map(Into::into)) else { continue };
            let [v1, v2, v3] = vertices;
            // Where f64 cannot tell the sign of the volume, nothing is ruled out.
            let sign = geometry::triangle_volume(vertices).map_or(0.0, f64::signum);
            let edges = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| v.cross(w) * sign);
            let sizes = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| {
                let (v, w) = (v.abs(), w.abs());
                DVec3::new(v.y * w.z + v.z * w.y, v.z * w.x + v.x * w.z, v.x * w.y + v.y * w.x)
            });
            bodies.push(Body {
                object: Object::Triangle(i),
                quick: Quick::Triangle { edges, sizes },
                shape: Shape::Triangle(Box::new(shape)),
                colour: triangle.colour.as_dvec3(),
                same_as: bodies.len(),
            });
        }
        let same = |a: &Body, b: &Body| match (a.object, b.object) {
            (Object::Sphere(a), Object::Sphere(b)) => {
                let (a, b) = (&scene.spheres[a], &scene.spheres[b]);
                a.centre == b.centre && a.radius == b.radius
            }
            (Object::Triangle(a), Object::Triangle(b)) => scene.triangles[a].vertices == scene.triangles[b].vertices,
            _ => false,
        };
        for i in 0..bodies.len() {
            bodies[i].same_as = bodies[..i].iter().position(|body| same(body, &bodies[i])).unwrap_or(i);
        }
        let rays = Rays::new(camera.width(), camera.height(), camera.focal(), camera.film());
        Truth { grid: camera.grid(), rays, lights: lights.collect(), bodies }
    }

    /// What is true of a pixel.
    pub fn pixel(&self, row: u32, col: u32) -> TruePixel {
        let d = DVec3::from(self.grid.ray(row, col));
        let reach = DVec3::new(self.grid.half_width, self.grid.half_height, self.grid.focal);
        let near = || self.bodies.iter().enumerate().filter(|(_, body)| !body.quick.certainly_missed(d, reach));
        if near().next().is_none() {
            return TruePixel { hit: None, margin: f64::INFINITY };
        }
        let ray = self.rays.ray(row, col);
        let meetings: Vec<(usize, Meeting)> = near().map(|(i, body)| (i, body.meet(&ray))).collect();
        let hits = meetings.iter().filter_map(|(i, meeting)| Some((*i, meeting, meeting.hit.as_ref()?)));
        let first = hits.reduce(|nearest, hit| if *hit.2 < *nearest.2 { hit } else { nearest });
        let mut margin = first.map_or(f64::INFINITY, |(_, meeting, _)| meeting.margin);
        for (i, meeting) in &meetings {
            let change = match first {
                Some((winner, ..)) if *i == winner || self.bodies[*i].same_as == self.bodies[winner].same_as => {
                    continue;
                }
                Some((_, _, t)) => {
                    // Behind the first hit, its distance protects the answer; a near miss is protected by its margin too.
                    let gap = |other: &Exact| (&(other - t) / t).to_f64().max(0.0);
                    match (&meeting.hit, &meeting.miss) {
                        (Some(other), _) => gap(other),
                        (None, Some(other)) => gap(other).max(meeting.margin),
                        (None, None) => meeting.margin,
                    }
                }
                None => meeting.margin,
            };
            margin = margin.min(change);
        }
        let hit = first.map(|(i, meeting, t)| self.hit(&self.bodies[i], &ray, t.clone(), meeting));
        TruePixel { hit, margin }
    }

    fn hit(&self, body: &Body, ray: &Ray, t: Exact, meeting: &Meeting) -> TrueHit {
        let point = ray.d.scale(&t);
        let (normal, two_sided) = match &body.shape {
            Shape::Sphere(sphere) => (sphere.normal(ray, &t).expect("a sphere has a radius"), false),
            Shape::Triangle(triangle) => (triangle.normal().clone(), true),
        };
        let mut colour = DVec3::ZERO;
        let mut near_light = false;
        for light in &self.lights {
            let to_light = light.position.sub(&point);
            near_light |= to_light.length().to_f64() < AT_THE_SURFACE * point.length().to_f64();
            // A light on the surface contributes nothing.
            let Some(direction) = to_light.normalize() else { continue };
            let cosine = direction.dot(&normal).to_f64();
            let cosine = if two_sided { cosine.abs() } else { cosine.max(0.0) };
            colour += cosine * light.radiance * body.colour;
        }
        TrueHit {
            object: body.object,
            t,
            normal,
            colour: (!near_light).then_some(colour),
            bound: meeting.bound,
            lever: meeting.slant * ray.longest_over_this(),
        }
    }
}

impl Body {
    fn meet(&self, ray: &Ray) -> Meeting {
        match &self.shape {
            Shape::Sphere(sphere) => sphere.meet(ray),
            Shape::Triangle(triangle) => triangle.meet(ray),
        }
    }
}

impl Quick {
    /// Whether no rounding, and no margin below [`FAR`], could make the ray hit it. Numbers that are not finite rule
    /// nothing out.
    fn certainly_missed(&self, d: DVec3, reach: DVec3) -> bool {
        match self {
            Quick::Sphere { centre, radius, k } => {
                // The ray's distance from the centre, |c x d| / |d|, against the radius.
                let squared = d.dot(d) * radius * radius;
                let across = centre.cross(d).length();
                let distance = across - ROUNDING * centre.length() * reach.length();
                let far = distance > 0.0 && distance * distance > (1.0 + 2.0 * FAR) * squared;
                let behind = d.dot(*centre) < -ROUNDING * centre.length() * reach.length();
                let outside = *k > ROUNDING * centre.dot(*centre);
                outside && (far || behind)
            }
            Quick::Triangle { edges, sizes } => edges.iter().zip(sizes).any(|(edge, size)| {
                let doubt = FAR * edge.abs().dot(reach) + ROUNDING * size.dot(reach);
                edge.dot(d) < -doubt
            }),
        }
    }
}
