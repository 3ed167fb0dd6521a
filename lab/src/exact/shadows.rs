//! The truth of shadows: whether an object hides a light from a visible point, in numbers whose
//! signs are known.
//!
//! An answer is a number: it is yes from 0 on, and as far from 0 as the share by which its terms
//! would have to change for the other one, so that "and" is the lesser of two and "or" the greater.
//! Shares count the rounding of the point too.

use glam::DVec3;

use super::number::{Number, Operations};
use super::shapes::{Vector, margin};

/// Of what is exactly so, or not, however the point is rounded.
const NEVER: f64 = f64::NEG_INFINITY;
/// A point is on a surface that is nearer than this share.
const ON: f64 = 1e-18;

/// An object that may hide a light.
pub enum Caster {
    Sphere { centre: DVec3, radius: f64 },
    Triangle([DVec3; 3]),
}

/// From a visible point to a light.
pub struct Segment<N> {
    p: Vector<N>,
    light: Vector<N>,
    g: Vector<N>,
    /// |P|, and what its rounding is as a share of the margin.
    doubt: f64,
}

/// A number by what its terms and the rounding of P may be.
fn share<N: Number>(x: &N, size: f64) -> Option<f64> {
    let share = x.to_f64() / size;
    x.sign()?;
    margin(&x.abs(), share.abs())?;
    Some(share)
}

/// The same where 0 is no: what P is on, by its terms' own size, does not hide.
fn strictly<N: Number>(x: &N, size: f64, own: f64) -> Option<f64> {
    let is_on = x.to_f64().abs() <= ON * own && x.is_within(ON * own);
    if is_on { Some(NEVER) } else { share(x, size) }
}

impl<N: Number> Segment<N>
where
    for<'a> &'a N: Operations<N>,
{
    /// From `p`, of which so many units of rounding along its ray are no error.
    pub fn new(p: Vector<N>, light: DVec3, units: f64) -> Self {
        let light = Vector::new(light.into());
        let (g, size) = (light.sub(&p), DVec3::from(p.to_f64()).length());
        Segment { p, light, g, doubt: size * (1.0 + units / 16.0) }
    }

    /// Whether an object other than that of the point hides the light; None if the numbers do not
    /// decide.
    pub fn is_hidden_by(&self, caster: &Caster) -> Option<f64> {
        match caster {
            Caster::Sphere { centre, radius } => self.is_hidden_by_sphere(Vector::new((*centre).into()), *radius),
            Caster::Triangle(vertices) => self.is_hidden_by_triangle(vertices.map(|v| Vector::new(v.into()))),
        }
    }

    fn is_hidden_by_sphere(&self, centre: Vector<N>, radius: f64) -> Option<f64> {
        let (q, of_light, r2) = (centre.sub(&self.p), self.light.sub(&centre), &N::new(radius) * &N::new(radius));
        let [q_size, l_size, g_size] = [&q, &of_light, &self.g].map(|v| DVec3::from(v.to_f64()).length());
        let across = q.cross(&self.g);
        let whole = &self.g.dot(&self.g) * &r2;
        let touches = &whole - &across.dot(&across);
        let touches = share(&touches, whole.to_f64() * (1.0 + (q_size + self.doubt) / radius))?;
        let before_light = share(&self.g.dot(&of_light), g_size * l_size + self.doubt * (g_size + l_size))?;
        let before_p = share(&self.g.dot(&q), g_size * q_size + self.doubt * (g_size + q_size))?;
        let power_of_light = &of_light.dot(&of_light) - &r2;
        let power_of_p = &q.dot(&q) - &r2;
        let outside = strictly(&power_of_p, 4.0 * radius * self.doubt, r2.to_f64())?;
        let inside = if outside == NEVER { NEVER } else { -outside };
        let sure = share(&power_of_light, l_size * l_size + radius * radius)?;
        Some(match power_of_light.sign()? {
            1 => touches.min(before_light).min(before_p.max(inside)).clamp(-sure, sure),
            0 => outside.min(before_light),
            _ => outside.clamp(sure, -sure),
        })
    }

    fn is_hidden_by_triangle(&self, vertices: [Vector<N>; 3]) -> Option<f64> {
        // The terms of a far corner would cancel.
        let nearest = |sizes: [f64; 3]| (1..3).fold(0, |at, i| if sizes[i] < sizes[at] { i } else { at });
        let seen = vertices.each_ref().map(|v| v.sub(&self.p));
        let sizes = seen.each_ref().map(|v| DVec3::from(v.to_f64()).length());
        let by_light = vertices.each_ref().map(|v| v.sub(&self.light));
        let from_light = by_light.each_ref().map(|v| DVec3::from(v.to_f64()));
        let (a, b) = (vertices[0].sub(&vertices[1]), vertices[0].sub(&vertices[2]));
        let (n, area) = (a.cross(&b), DVec3::from(a.to_f64()).length() * DVec3::from(b.to_f64()).length());
        let at = nearest(from_light.map(DVec3::length));
        let of_light = &n.dot(&by_light[at]);
        let sure = share(of_light, area * from_light[at].length())?.abs();
        // Of a needle it is a small share wherever the light is. Where it is 0, so are all terms
        // below, and P is on the plane.
        let side = N::new((-of_light.sign()?).into());
        let at = nearest(sizes);
        let own = DVec3::from(n.to_f64()).length() * sizes[at];
        let of_p = strictly(&(&n.dot(&seen[at]) * &side), area * (sizes[at] + 2.0 * self.doubt), own)?;
        let (mut hides, mut most) = (of_p, of_p);
        let (g, g_size) = (self.g.scale(&side), DVec3::from(self.g.to_f64()).length());
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            let edge = from_light[j] - from_light[i];
            let (middle, plane) = (0.5 * (sizes[i] + sizes[j]), from_light[i].cross(edge).length());
            let from_middle = (from_light[i] + 0.5 * edge).length() * edge.length() * middle;
            // The same volume from either end.
            let of_light = from_light[i].length() * from_light[j].length();
            let (ends, of_ends) =
                if of_light < sizes[i] * sizes[j] { (&by_light, of_light) } else { (&seen, sizes[i] * sizes[j]) };
            let size = of_ends * g_size + plane * self.doubt + from_middle;
            let inside = share(&g.dot(&ends[i].cross(&ends[j])), size)?;
            (hides, most) = (hides.min(inside), most.max(inside));
        }
        // Were the light on the other side, all signs would be.
        let other_side = if of_p == NEVER { f64::INFINITY } else { most.max(sure) };
        Some(hides.max(-other_side).min(sure))
    }
}
