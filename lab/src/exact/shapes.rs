//! The truth about one ray and one sphere or triangle, in numbers whose signs are known, or are
//! known to be unknown.
//!
//! The same formulas serve [`Exact`] numbers, whose signs are always known, and
//! [`Bounded`](super::bounded::Bounded) ones, which are a hundred times as fast and fail to decide
//! in about one of a thousand pixels. Each result has a margin: by how much the input would have to
//! change for another result.

use super::digits::Exact;
use super::number::{Number, Operations};

#[derive(Clone, Debug, PartialEq)]
pub struct Vector<N>(pub [N; 3]);

impl<N: Number> Vector<N>
where
    for<'a> &'a N: Operations<N>,
{
    /// The vector equal to `v`.
    ///
    /// # Panics
    /// If a component is not finite, and the numbers are [`Exact`].
    pub fn new(v: [f64; 3]) -> Self {
        Vector(v.map(N::new))
    }

    /// The components, rounded to nearest.
    pub fn to_f64(&self) -> [f64; 3] {
        self.0.each_ref().map(N::to_f64)
    }

    /// self - b.
    pub fn sub(&self, b: &Self) -> Self {
        Vector(std::array::from_fn(|i| &self.0[i] - &b.0[i]))
    }

    /// This vector times s.
    pub fn scale(&self, s: &N) -> Self {
        Vector(std::array::from_fn(|i| &self.0[i] * s))
    }

    /// self . b.
    pub fn dot(&self, b: &Self) -> N {
        let [x, y, z] = std::array::from_fn(|i| &self.0[i] * &b.0[i]);
        &(&x + &y) + &z
    }

    /// self x b.
    pub fn cross(&self, b: &Self) -> Self {
        Vector(std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            &(&self.0[j] * &b.0[k]) - &(&self.0[k] * &b.0[j])
        }))
    }

    /// |self|.
    pub fn length(&self) -> N {
        self.dot(self).sqrt()
    }

    /// self / |self|, for a vector other than 0.
    pub fn normalize(&self) -> Self {
        self.scale(&(&N::new(1.0) / &self.length()))
    }

    /// The vector divided by its largest component, so that f64 can hold it; 0 stays 0.
    fn in_its_unit(&self) -> Self {
        let [x, y, z] = self.0.each_ref().map(N::abs);
        let larger = |a: N, b: N| if (&a - &b).sign() < Some(0) { b } else { a };
        let largest = larger(larger(x, y), z);
        if largest.sign() == Some(1) { self.scale(&(&N::new(1.0) / &largest)) } else { self.clone() }
    }
}

/// The rays of a camera by Algorithm 1's own formula. The grids of rays in f32 and f64 are
/// roundings of them.
#[derive(Clone, Debug)]
pub struct Rays {
    step: Exact,
    half_width: Exact,
    half_height: Exact,
    focal: Exact,
    /// The greatest magnitude of each component of a ray.
    pub reach: [f64; 3],
}

impl Rays {
    /// The rays through `width` x `height` pixels of a film with the diagonal `film`, at the focal
    /// distance `focal`.
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

    /// The direction r_d of a pixel's ray, not normalised.
    pub fn ray(&self, row: u32, col: u32) -> Ray<Exact> {
        Ray::within(Vector([self.across(col), self.up(row), self.focal.clone()]), self.reach)
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
pub struct Ray<N> {
    /// The direction, of any length but 0.
    pub d: Vector<N>,
    /// d . d.
    squared: N,
    /// The scale of the edges' margins: the greatest magnitude of each component of d, in this ray
    /// or in all rays of the picture.
    reach: [f64; 3],
}

impl<N: Number> Ray<N>
where
    for<'a> &'a N: Operations<N>,
{
    /// The ray along `d`, whose components are taken as exact.
    ///
    /// # Panics
    /// As [`Vector::new`].
    pub fn new(d: [f64; 3]) -> Self {
        Ray::within(Vector::new(d), d.map(f64::abs))
    }

    /// The ray along `d`, one of many rays whose components are at most `reach` in magnitude.
    pub fn within(d: Vector<N>, reach: [f64; 3]) -> Self {
        let squared = d.dot(&d);
        Ray { d, squared, reach }
    }

    /// The length of the picture's longest ray divided by that of this ray. It scales rounding
    /// errors that are given in units of the film.
    pub fn longest_over_this(&self) -> f64 {
        let longest = self.reach.iter().map(|d| d * d).sum::<f64>().sqrt();
        longest / self.squared.sqrt().to_f64()
    }
}

/// How a ray meets an object.
#[derive(Clone, Debug)]
pub struct Meeting<N> {
    /// The smallest t > 0 at which the ray is on the object; None for a miss.
    pub hit: Option<N>,
    /// For a miss, the t > 0 of the hit that would occur if the input changed by the margin. None
    /// if no small change makes a hit.
    pub miss: Option<N>,
    /// The distance from the opposite result, relative to the terms. For a sphere it is |s| with
    /// s = D/(a r^2), for a triangle that of the edge functions divided by the sums of their terms'
    /// magnitudes. Infinite if no small change alters the result.
    pub margin: f64,
    /// The documented bound of |error of t| / t of the robust kernels, in units of the kernel's u.
    /// It holds for a hit whose margin exceeds the kernel's.
    pub bound: f64,
    /// The bound for SPHERE_HIT3 and TRIANGLE_HIT3; the former has a single form for all spheres.
    pub alone: f64,
    /// 1 / the cosine between the ray and the normal: the factor by which a turn of the ray changes
    /// t.
    pub slant: f64,
}

impl<N> Meeting<N> {
    /// The result for an object that no ray can meet.
    pub const NEVER: Self = Meeting {
        hit: None,
        miss: None,
        margin: f64::INFINITY,
        bound: f64::INFINITY,
        alone: f64::INFINITY,
        slant: f64::INFINITY,
    };
}

/// A margin counts as known if it is accurate to 1e-9 of itself, or if it is below this value,
/// since smaller margins make no difference.
const MARGIN: f64 = 1e-18;

/// The margin `share`, if `x` > 0, of which it is a multiple, is known accurately enough.
pub(super) fn margin<N: Number>(x: &N, share: f64) -> Option<f64> {
    (x.is_within(1e-9 * x.to_f64()) || share < MARGIN).then_some(share)
}

/// The bound of |error of t| / t for a sphere whose centre is `kappa` radii away, where `k` is
/// kappa^2 - 1.
fn bound_of_sphere(kappa: f64, k: f64, slant: f64) -> f64 {
    match k < 0.0 {
        // 1 - kappa = -k / (1 + kappa); the difference itself would cancel.
        true => 6.0 + 3.0 / (-k / (1.0 + kappa)).sqrt(),
        false if kappa * kappa < 2.0 => 6.0 + 12.0 * slant,
        false => 5.0 + 6.0 * slant / kappa,
    }
}

#[derive(Clone, Debug)]
pub struct Sphere<N> {
    centre: Vector<N>,
    inverse_radius: N,
    squared_radius: N,
    /// |c|^2 - r^2.
    k: N,
    /// The sign of k: negative if the camera is inside.
    side: i8,
    /// |c| / r.
    kappa: f64,
}

impl<N: Number> Sphere<N>
where
    for<'a> &'a N: Operations<N>,
{
    /// None for a sphere that is never hit, because a field is not finite or the radius is not
    /// greater than 0. Also None if it is unknown on which side of the surface the camera is.
    pub fn new(centre: [f64; 3], radius: f64) -> Option<Self> {
        if !(centre.iter().all(|c| c.is_finite()) && radius.is_finite() && radius > 0.0) {
            return None;
        }
        let (centre, radius) = (Vector::new(centre), N::new(radius));
        let (squared, squared_radius) = (centre.dot(&centre), &radius * &radius);
        let k = &squared - &squared_radius;
        let (side, kappa) = (k.sign()?, (&squared / &squared_radius).to_f64().sqrt());
        Some(Sphere { centre, inverse_radius: &N::new(1.0) / &radius, squared_radius, k, side, kappa })
    }

    /// Eq. 5. None if the numbers do not decide where the ray meets the sphere. The discriminant is
    /// computed as a r^2 - |C x d|^2, the form for distant spheres, which loses the fewest digits.
    pub fn meet(&self, ray: &Ray<N>) -> Option<Meeting<N>> {
        let (a, h, inside) = (&ray.squared, ray.d.dot(&self.centre), self.side < 0);
        // Outside, where h <= 0, both roots are negative or there is none. For a camera on the
        // sphere, h^2 may be a rounding error.
        let behind = !inside && h.sign()? <= 0;
        if behind && self.side > 0 {
            return Some(Meeting::NEVER);
        }
        let (whole, across) = (a * &self.squared_radius, self.centre.cross(&ray.d));
        let disc = &whole - &across.dot(&across);
        let s = margin(&disc.abs(), (&disc / &whole).to_f64().abs())?;
        if behind {
            return Some(Meeting { margin: s, ..Meeting::NEVER });
        }
        let missed = disc.sign()? < 0;
        // D = a r^2 - |c x d|^2 has an error of at most 12 u a r^2. Its root therefore has a
        // relative error of at most 6 u / s, of which |h| + sqrt D has a part.
        let along = (&(&h * &h) / &whole).to_f64().sqrt();
        let (slant, alone) = (1.0 / s.sqrt(), 5.0 + 6.0 / (s.sqrt() * (s.sqrt() + along)));
        let bound = bound_of_sphere(self.kappa, (&self.k / &self.squared_radius).to_f64(), slant);
        if missed {
            return Some(Meeting { hit: None, miss: Some(&h / a), margin: s, bound, alone, slant });
        }
        let root = disc.sqrt();
        let hit = match (self.side, h.sign()) {
            (-1, Some(-1)) => &self.k / &(&h - &root),
            // (h - sqrt D) / a would be little but its own rounding error if the camera is near the
            // sphere.
            (1, _) => &self.k / &(&h + &root),
            _ => &(&h + &root) / a,
        };
        let margin = if inside { f64::INFINITY } else { s };
        Some(Meeting { hit: Some(hit), miss: None, margin, bound, alone, slant })
    }

    /// The outward unit normal at the point t d.
    pub fn normal(&self, ray: &Ray<N>, t: &N) -> Vector<N> {
        ray.d.scale(t).sub(&self.centre).scale(&self.inverse_radius)
    }
}

/// A triangle that some ray can hit.
#[derive(Clone, Debug)]
pub struct Triangle<N> {
    /// For each edge from v to w the vector v x w, made to point inwards. Only its direction
    /// matters.
    edges: [Vector<N>; 3],
    /// n of eq. 6, with the sign that makes n . v1 positive; `length` is its length.
    plane: Vector<N>,
    length: N,
    /// v1 . n.
    volume: N,
    /// The unit normal n / |n| with the sign of eq. 6.
    normal: Vector<N>,
}

impl<N: Number> Triangle<N>
where
    for<'a> &'a N: Operations<N>,
{
    /// None for a triangle that is never hit: it has no area, lies in a plane through the camera,
    /// or has a vertex that is not finite. Also None if that cannot be decided.
    pub fn new(vertices: [[f64; 3]; 3]) -> Option<Self> {
        if !vertices.iter().flatten().all(|v| v.is_finite()) {
            return None;
        }
        let [v1, v2, v3] = &vertices.map(Vector::new);
        let plane = v1.sub(v2).cross(&v1.sub(v3));
        let volume = v1.dot(&plane);
        let sign = N::new(volume.sign().filter(|sign| *sign != 0)?.into());
        let edges = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| v.cross(w).scale(&sign).in_its_unit());
        let (length, normal) = (plane.length(), plane.normalize());
        Some(Triangle { edges, plane: plane.scale(&sign), length, volume: volume.abs(), normal })
    }

    /// Eq. 9 and eq. 10, edges and vertices included; None if the numbers do not decide.
    pub fn meet(&self, ray: &Ray<N>) -> Option<Meeting<N>> {
        let (mut inside, mut outside, mut unknown) = (f64::INFINITY, f64::NEG_INFINITY, false);
        for edge in &self.edges {
            let side = ray.d.dot(edge);
            let size: f64 = edge.to_f64().iter().zip(ray.reach).map(|(n, d)| n.abs() * d).sum();
            let share = if size > 0.0 { side.to_f64().abs() / size } else { 0.0 };
            match side.sign() {
                Some(-1) => outside = outside.max(margin(&side.abs(), share)?),
                Some(_) => inside = inside.min(margin(&side, share)?),
                None => unknown = true,
            }
        }
        let missed = outside >= 0.0;
        let across = ray.d.dot(&self.plane);
        let ahead = across.sign()? > 0;
        if unknown && !missed {
            return None;
        }
        let cosine = (&(&across / &self.length) / &ray.squared.sqrt()).to_f64();
        let slant = if ahead { 1.0 / cosine } else { f64::INFINITY };
        let bound = 3.0 + 4.0 * slant;
        let t = ahead.then(|| &self.volume / &across);
        let (hit, miss, margin) = match (missed, ahead) {
            (false, true) => (t, None, inside),
            (true, _) => (None, t, outside),
            // The ray is outside of no edge, and yet the triangle is not ahead of it: only rounding
            // could make it a hit.
            (false, false) => (None, None, 0.0),
        };
        Some(Meeting { hit, miss, margin, bound, alone: bound, slant })
    }

    /// n / |n| of eq. 6.
    pub fn normal(&self) -> &Vector<N> {
        &self.normal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sphere(centre: [f64; 3], radius: f64, d: [f64; 3]) -> Meeting<Exact> {
        Sphere::new(centre, radius).unwrap().meet(&Ray::new(d)).unwrap()
    }

    #[test]
    fn the_margin_of_a_sphere_is_that_of_its_outline() {
        // A unit sphere at distance 10 and rays that pass its centre at the distance q:
        // s = 1 - q^2.
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
    fn margin_of_a_triangle_is_that_of_the_deciding_edge() {
        let vertices = [[-1.0, -1.0, 4.0], [3.0, -1.0, 4.0], [-1.0, 3.0, 4.0]];
        for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0]] {
            let triangle = Triangle::<Exact>::new(order.map(|i| vertices[i])).unwrap();
            let meet = |x: f64, y: f64| triangle.meet(&Ray::new([x, y, 4.0])).unwrap();
            let middle = meet(0.0, 0.0);
            assert_eq!(middle.hit.unwrap().to_f64(), 1.0);
            assert!(middle.margin > 0.1 && middle.bound > 7.0 - 1e-12 && middle.bound < 7.1);
            let corner = meet(-1.0, -1.0);
            assert!(corner.hit.is_some() && corner.margin == 0.0);
            let outside = meet(-1.0, -1.0 - 1e-9);
            assert!(outside.hit.is_none() && outside.margin < 1e-9 && outside.miss.unwrap().to_f64() == 1.0);
            assert!(triangle.meet(&Ray::new([0.0, 0.0, -4.0])).unwrap().miss.is_none());
        }
    }
}
