//! The truth beyond doubt: one ray against a sphere or a triangle in numbers of 256 bits.
//!
//! What goes in is f32 or f64 data, taken as exact. Nothing here is fast, and no formula is chosen for its rounding: 256
//! bits leave more than 200 after the worst that such data can cancel. What comes out knows its own margin: how much would
//! have to change for the answer to be another one.

use std::ops::{Add, Div, Mul, Neg, Sub};

use dashu_float::FBig;
use dashu_float::round::mode::HalfEven;

/// Bits of a number.
pub const BITS: usize = 256;

/// A number of [`BITS`] bits, finite, its exponent without limits. Operations round to nearest.
#[derive(Clone, Debug, PartialEq, PartialOrd)]
pub struct Exact(FBig<HalfEven, 2>);

impl Exact {
    /// `x` itself.
    ///
    /// # Panics
    /// Where it is not finite.
    pub fn new(x: f64) -> Self {
        let x: FBig<HalfEven, 2> = x.try_into().unwrap_or_else(|_| panic!("an exact number is finite, not {x}"));
        assert!(x.repr().is_finite(), "an exact number is finite");
        // A result is as precise as the more precise of its operands.
        Exact(x.with_precision(BITS).value())
    }

    /// Rounded to nearest.
    pub fn to_f64(&self) -> f64 {
        self.0.to_f64().value()
    }

    /// The square root; 0 below 0.
    pub fn sqrt(&self) -> Self {
        if self.is_positive() { Exact(self.0.sqrt()) } else { Exact::new(0.0) }
    }

    /// Without its sign.
    pub fn abs(&self) -> Self {
        if self.is_negative() { -self } else { self.clone() }
    }

    /// Whether it is greater than 0.
    pub fn is_positive(&self) -> bool {
        *self > Exact::new(0.0)
    }

    /// Whether it is less than 0.
    pub fn is_negative(&self) -> bool {
        *self < Exact::new(0.0)
    }
}

/// A number to about 106 bits, as the sum of two f64: what fast comparisons take in place of an [`Exact`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Split {
    /// The number rounded to nearest.
    pub high: f64,
    /// What is left, rounded to nearest.
    pub low: f64,
}

impl Split {
    /// x - self; to all of f64 where x is near.
    pub fn error_of(self, x: f64) -> f64 {
        (x - self.high) - self.low
    }
}

impl From<&Exact> for Split {
    fn from(x: &Exact) -> Self {
        let high = x.to_f64();
        let low = (x - &Exact::new(high)).to_f64();
        Split { high, low }
    }
}

macro_rules! operation {
    ($trait:ident, $name:ident) => {
        impl $trait for &Exact {
            type Output = Exact;
            fn $name(self, other: &Exact) -> Exact {
                Exact((&self.0).$name(&other.0))
            }
        }
    };
}
operation!(Add, add);
operation!(Sub, sub);
operation!(Mul, mul);
operation!(Div, div);

impl Neg for &Exact {
    type Output = Exact;
    fn neg(self) -> Exact {
        Exact(-&self.0)
    }
}

/// A vector.
#[derive(Clone, Debug, PartialEq)]
pub struct Vector(pub [Exact; 3]);

impl Vector {
    /// `v` itself.
    ///
    /// # Panics
    /// As [`Exact::new`].
    pub fn new(v: [f64; 3]) -> Self {
        Vector(v.map(Exact::new))
    }

    /// Rounded to nearest.
    pub fn to_f64(&self) -> [f64; 3] {
        self.0.each_ref().map(Exact::to_f64)
    }

    /// self - b.
    pub fn sub(&self, b: &Vector) -> Vector {
        Vector(std::array::from_fn(|i| &self.0[i] - &b.0[i]))
    }

    /// s self.
    pub fn scale(&self, s: &Exact) -> Vector {
        Vector(std::array::from_fn(|i| &self.0[i] * s))
    }

    /// self . b.
    pub fn dot(&self, b: &Vector) -> Exact {
        let [x, y, z] = std::array::from_fn(|i| &self.0[i] * &b.0[i]);
        &(&x + &y) + &z
    }

    /// self x b.
    pub fn cross(&self, b: &Vector) -> Vector {
        Vector(std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            &(&self.0[j] * &b.0[k]) - &(&self.0[k] * &b.0[j])
        }))
    }

    /// |self|.
    pub fn length(&self) -> Exact {
        self.dot(self).sqrt()
    }

    /// Divided by its largest component; 0 as it is.
    fn in_its_unit(&self) -> Vector {
        let larger = |a: Exact, b: &Exact| if b.abs() > a { b.abs() } else { a };
        let largest = self.0.iter().fold(Exact::new(0.0), larger);
        if largest.is_positive() { self.scale(&(&Exact::new(1.0) / &largest)) } else { self.clone() }
    }

    /// self / |self|; None for 0.
    pub fn normalize(&self) -> Option<Vector> {
        let length = self.length();
        length.is_positive().then(|| self.scale(&(&Exact::new(1.0) / &length)))
    }
}

/// The rays of a camera by Algorithm 1's own formula, of which the grids in f32 and f64 are roundings.
#[derive(Clone, Debug)]
pub struct Rays {
    step: Exact,
    half_width: Exact,
    half_height: Exact,
    focal: Exact,
    /// How large each component of a ray is, at most.
    pub reach: [f64; 3],
}

impl Rays {
    /// The rays of `width` x `height` pixels through a film of that diagonal at that focal distance.
    pub fn new(width: u32, height: u32, focal: f32, film: f32) -> Self {
        let [width, height, focal, film] = [width.into(), height.into(), focal.into(), film.into()].map(Exact::new);
        let half = Exact::new(0.5);
        let relation = &width / &height;
        let film_height = &film / &(&(&relation * &relation) + &Exact::new(1.0)).sqrt();
        let film_width = &relation * &film_height;
        let (half_width, half_height) = (&film_width * &half, &film_height * &half);
        let reach = [half_width.to_f64(), half_height.to_f64(), focal.to_f64()];
        Rays { step: &film_width / &width, half_width, half_height, focal, reach }
    }

    /// r_d of a pixel, not normalised.
    pub fn ray(&self, row: u32, col: u32) -> Ray {
        Ray { d: Vector([self.across(col), self.up(row), self.focal.clone()]), reach: self.reach }
    }

    /// The x of the rays of a column.
    pub fn across(&self, col: u32) -> Exact {
        &self.at(col) - &self.half_width
    }

    /// The y of the rays of a row.
    pub fn up(&self, row: u32) -> Exact {
        &self.half_height - &self.at(row)
    }

    fn at(&self, i: u32) -> Exact {
        &self.step * &Exact::new(f64::from(i) + 0.5)
    }
}

/// A ray from the origin.
#[derive(Clone, Debug)]
pub struct Ray {
    /// Its direction, of any length but 0.
    pub d: Vector,
    /// What the margin of an edge refers to: how large each component is, here or anywhere in the picture.
    reach: [f64; 3],
}

impl Ray {
    /// The longest ray of the picture over this one: of what is rounded in units of the film, so much is this ray's share.
    pub fn longest_over_this(&self) -> f64 {
        let longest = self.reach.iter().map(|d| d * d).sum::<f64>().sqrt();
        longest / self.d.length().to_f64()
    }

    /// The ray along `d`, taken as exact.
    ///
    /// # Panics
    /// As [`Exact::new`].
    pub fn new(d: [f64; 3]) -> Self {
        Ray::within(d, d.map(f64::abs))
    }

    /// The same, one of many rays whose components are at most `reach`.
    ///
    /// # Panics
    /// As [`Exact::new`].
    pub fn within(d: [f64; 3], reach: [f64; 3]) -> Self {
        Ray { d: Vector::new(d), reach }
    }
}

/// What a ray and an object have to do with each other.
#[derive(Clone, Debug)]
pub struct Meeting<T = Exact> {
    /// The smallest t > 0 at which the ray is on the object; None for a miss.
    pub hit: Option<T>,
    /// Of a miss: the t > 0 at which it would be hit if the margin were overcome. None where nothing could make it a hit.
    pub miss: Option<T>,
    /// How far from the other answer it is: of a sphere |s|, s = D/(a r^2); of a triangle the edge functions by what
    /// they would be if nothing cancelled. Infinite where there is no other answer.
    pub margin: f64,
    /// The documented bound of |error of t| / t of the robust kernels, in units of their u; meaningful for a hit that is
    /// further than the margin from a miss.
    pub bound: f64,
    /// The same of SPHERE_HIT3 and TRIANGLE_HIT3, of which the first has one form for all spheres.
    pub alone: f64,
    /// 1 / the cosine between the ray and the normal: how many times as much t changes as the ray is turned.
    pub slant: f64,
}

impl<T> Meeting<T> {
    /// Of an object that no ray meets.
    pub const NEVER: Self = Meeting {
        hit: None,
        miss: None,
        margin: f64::INFINITY,
        bound: f64::INFINITY,
        alone: f64::INFINITY,
        slant: f64::INFINITY,
    };
}

/// The bound of |error of t| / t for a sphere `kappa` radii away, of which `k` is kappa^2 - 1.
pub(super) fn bound_of_sphere(kappa: f64, k: f64, slant: f64) -> f64 {
    match k < 0.0 {
        // 1 - kappa, which would cancel.
        true => 6.0 + 3.0 / (-k / (1.0 + kappa)).sqrt(),
        false if kappa * kappa < 2.0 => 6.0 + 12.0 * slant,
        false => 5.0 + 6.0 * slant / kappa,
    }
}

/// A sphere.
#[derive(Clone, Debug)]
pub struct Sphere {
    centre: Vector,
    squared_radius: Exact,
    /// |c|^2 - r^2: negative for a camera inside.
    k: Exact,
    /// |c| / r.
    kappa: f64,
}

impl Sphere {
    /// None where a field is not finite or the radius not greater than 0: it is never hit.
    pub fn new(centre: [f64; 3], radius: f64) -> Option<Self> {
        if !(centre.iter().all(|c| c.is_finite()) && radius.is_finite() && radius > 0.0) {
            return None;
        }
        let (centre, radius) = (Vector::new(centre), Exact::new(radius));
        let squared_radius = &radius * &radius;
        let k = &centre.dot(&centre) - &squared_radius;
        let kappa = (&centre.length() / &radius).to_f64();
        Some(Sphere { centre, squared_radius, k, kappa })
    }

    /// Eq. 5.
    pub fn meet(&self, ray: &Ray) -> Meeting {
        let a = ray.d.dot(&ray.d);
        let h = ray.d.dot(&self.centre);
        let disc = &(&h * &h) - &(&a * &self.k);
        let s = (&disc / &(&a * &self.squared_radius)).to_f64();
        let slant = 1.0 / s.abs().sqrt();
        // D = a r^2 - |c x d|^2 is right to 12 u a r^2, so sqrt D to 6 u / s of itself, which is a part of |h| + sqrt D.
        let root = s.abs().sqrt();
        let along = (&(&h * &h) / &(&a * &self.squared_radius)).to_f64().sqrt();
        let alone = 5.0 + 6.0 / (root * (root + along));
        let bound = bound_of_sphere(self.kappa, (&self.k / &self.squared_radius).to_f64(), slant);
        if self.k.is_negative() {
            let hit = &(&h + &disc.sqrt()) / &a;
            return Meeting { hit: Some(hit), miss: None, margin: f64::INFINITY, bound, alone, slant };
        }
        if !h.is_positive() {
            // Both roots are behind the camera, or none is there. On the sphere itself, h^2 may be what rounding leaves.
            let on_the_sphere = !self.k.is_positive();
            return if on_the_sphere { Meeting { margin: s.abs(), ..Meeting::NEVER } } else { Meeting::NEVER };
        }
        if disc.is_negative() {
            return Meeting { hit: None, miss: Some(&h / &a), margin: -s, bound, alone, slant };
        }
        let root = disc.sqrt();
        // As k / (h + sqrt D), which is exactly 0 for a camera on the sphere; (h - sqrt D) / a would be its rounding.
        let sum = &h + &root;
        let near = if sum.is_positive() { &self.k / &sum } else { Exact::new(0.0) };
        let hit = if near.is_positive() { near } else { &(&h + &root) / &a };
        Meeting { hit: Some(hit), miss: None, margin: s, bound, alone, slant }
    }

    /// The unit normal at t d, outward.
    pub fn normal(&self, ray: &Ray, t: &Exact) -> Option<Vector> {
        ray.d.scale(t).sub(&self.centre).normalize()
    }
}

/// A triangle that some ray can hit.
#[derive(Clone, Debug)]
pub struct Triangle {
    /// v x w for the edge from v to w, on the side of the inside.
    edges: [Vector; 3],
    /// n of eq. 6, on the side on which n . v1 is positive.
    plane: Vector,
    /// v1 . n.
    volume: Exact,
    /// n / |n|, as eq. 6 has it.
    normal: Vector,
}

impl Triangle {
    /// None for a triangle that is never hit: of no area, in a plane through the camera, or with a vertex that is not
    /// finite.
    pub fn new(vertices: [[f64; 3]; 3]) -> Option<Self> {
        if !vertices.iter().flatten().all(|v| v.is_finite()) {
            return None;
        }
        let [v1, v2, v3] = &vertices.map(Vector::new);
        let plane = v1.sub(v2).cross(&v1.sub(v3));
        let volume = v1.dot(&plane);
        let sign = Exact::new(if volume.is_negative() { -1.0 } else { 1.0 });
        let normal = plane.normalize()?;
        // Of an edge only the direction counts, whose numbers f64 holds however large the vertices' are.
        let edges = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| v.cross(w).scale(&sign).in_its_unit());
        let volume = volume.abs();
        volume.is_positive().then(|| Triangle { edges, plane: plane.scale(&sign), volume, normal })
    }

    /// Eq. 9 and eq. 10, the edges and vertices included.
    pub fn meet(&self, ray: &Ray) -> Meeting {
        let across = ray.d.dot(&self.plane);
        let ahead = across.is_positive();
        let t = || &self.volume / &across;
        let cosine = (&(&across / &self.plane.length()) / &ray.d.length()).to_f64();
        let (mut inside, mut outside) = (f64::INFINITY, f64::NEG_INFINITY);
        for edge in &self.edges {
            let side = ray.d.dot(edge);
            let size: f64 = edge.to_f64().iter().zip(ray.reach).map(|(n, d)| n.abs() * d).sum();
            let margin = if size > 0.0 { side.to_f64() / size } else { 0.0 };
            if side.is_negative() {
                outside = outside.max(-margin);
            } else {
                inside = inside.min(margin);
            }
        }
        let missed = outside >= 0.0;
        let slant = if ahead { 1.0 / cosine } else { f64::INFINITY };
        let bound = 3.0 + 4.0 * slant;
        match (missed, ahead) {
            (false, true) => Meeting { hit: Some(t()), miss: None, margin: inside, bound, alone: bound, slant },
            (true, true) => Meeting { hit: None, miss: Some(t()), margin: outside, bound, alone: bound, slant },
            // In the plane, or away from it: only rounding could make it a hit.
            _ => Meeting {
                hit: None,
                miss: None,
                margin: if missed { outside } else { 0.0 },
                bound,
                alone: bound,
                slant,
            },
        }
    }

    /// n / |n| of eq. 6.
    pub fn normal(&self) -> &Vector {
        &self.normal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sphere(centre: [f64; 3], radius: f64, d: [f64; 3]) -> Meeting {
        Sphere::new(centre, radius).unwrap().meet(&Ray::new(d))
    }

    #[test]
    fn numbers_keep_256_bits() {
        let (one, tiny) = (Exact::new(1.0), Exact::new(2f64.powi(-250)));
        assert_eq!((&(&one + &tiny) - &one).to_f64(), 2f64.powi(-250));
        let root = Exact::new(2.0).sqrt();
        let error = (&(&root * &root) - &Exact::new(2.0)).abs().to_f64();
        assert!(error < 2f64.powi(-250), "{error:e}");
        assert_eq!(Exact::new(-1.0).sqrt(), Exact::new(0.0));
        // Neither end of f64's range is an end here.
        let square = &Exact::new(f64::MIN_POSITIVE) * &Exact::new(f64::MIN_POSITIVE);
        assert_eq!(square.sqrt().to_f64(), f64::MIN_POSITIVE);
    }

    #[test]
    fn a_split_number_shows_differences_below_the_rounding_of_f64() {
        let third = &Exact::new(1.0) / &Exact::new(3.0);
        let split = Split::from(&third);
        let error = (&(&Exact::new(split.high) + &Exact::new(split.low)) - &third).to_f64();
        assert!(error.abs() < 2f64.powi(-107), "{error:e}");
        // 1/3 in f64 is a third of a unit of its last place too small: 2^-54 / 3.
        assert_eq!(split.error_of(1.0 / 3.0), -(2f64.powi(-54) / 3.0));
    }

    #[test]
    fn rays_are_those_of_the_grid() {
        let rays = Rays::new(8, 6, 2.0, 5.0);
        assert_eq!(rays.ray(0, 0).d.to_f64(), [-1.75, 1.25, 2.0]);
        assert_eq!(rays.ray(5, 7).d.to_f64(), [1.75, -1.25, 2.0]);
    }

    #[test]
    fn the_margin_of_a_sphere_is_that_of_its_outline() {
        // A unit sphere at distance 10 and rays that pass its centre at the distance q: s = 1 - q^2.
        for q in [0.0, 0.5, 0.999, 1.0, 1.001, 2.0_f64] {
            // At q from the centre, the ray's foot point is at sqrt(100 - q^2).
            let d = [q * (100.0 - q * q).sqrt() / 10.0, 0.0, (100.0 - q * q) / 10.0];
            let meeting = sphere([0.0, 0.0, 10.0], 1.0, d);
            let s = 1.0 - q * q;
            assert!((meeting.margin - s.abs()).abs() < 1e-13, "{q}: {meeting:?}");
            if q != 1.0 {
                assert_eq!((meeting.hit.is_some(), meeting.miss.is_some()), (q < 1.0, q > 1.0), "{q}");
            }
        }
        let behind = sphere([0.0, 0.0, -10.0], 1.0, [0.0, 0.0, 1.0]);
        assert!(behind.hit.is_none() && behind.miss.is_none() && behind.margin == f64::INFINITY);
    }

    #[test]
    fn a_sphere_around_the_camera_has_no_outline() {
        let meeting = sphere([0.0, 0.0, 1.0], 3.0, [0.0, 0.0, -2.0]);
        assert_eq!((meeting.hit.unwrap().to_f64(), meeting.margin), (1.0, f64::INFINITY));
        // On the sphere: the far wall ahead, nothing behind.
        assert_eq!(sphere([0.0, 0.0, 3.0], 3.0, [0.0, 0.0, 1.0]).hit.unwrap().to_f64(), 6.0);
        assert!(sphere([0.0, 0.0, -3.0], 3.0, [0.0, 0.0, 1.0]).hit.is_none());
    }

    #[test]
    fn the_margin_of_a_triangle_is_that_of_its_nearest_edge_or_of_the_furthest_that_excludes_the_ray() {
        let vertices = [[-1.0, -1.0, 4.0], [3.0, -1.0, 4.0], [-1.0, 3.0, 4.0]];
        for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0]] {
            let triangle = Triangle::new(order.map(|i| vertices[i])).unwrap();
            let meet = |x: f64, y: f64| triangle.meet(&Ray::new([x, y, 4.0]));
            let middle = meet(0.0, 0.0);
            assert_eq!(middle.hit.unwrap().to_f64(), 1.0);
            assert!(middle.margin > 0.1 && middle.bound > 7.0 - 1e-12 && middle.bound < 7.1);
            let corner = meet(-1.0, -1.0);
            assert!(corner.hit.is_some() && corner.margin == 0.0);
            let outside = meet(-1.0, -1.0 - 1e-9);
            assert!(outside.hit.is_none() && outside.margin < 1e-9 && outside.miss.unwrap().to_f64() == 1.0);
            assert!(triangle.meet(&Ray::new([0.0, 0.0, -4.0])).miss.is_none());
        }
    }

    #[test]
    fn what_is_never_hit_is_nothing() {
        let z = [0.0, 0.0, 1.0];
        let flat = [[-1.0, 0.0, 4.0], [0.0, 0.0, 4.0], [1.0, 0.0, 4.0]];
        assert!(Triangle::new(flat).is_none());
        let through_the_camera = [[1.0, 0.0, 3.0], [2.0, 0.0, 3.0], [-1.0, 0.0, 7.0]];
        assert!(Triangle::new(through_the_camera).is_none());
        assert!(Triangle::new([[f64::NAN; 3], z, z]).is_none());
        assert!(Sphere::new([f64::INFINITY, 0.0, 0.0], 1.0).is_none());
        assert!(Sphere::new(z, 0.0).is_none());
    }
}
