//! The truth about shadows: whether an object hides a light from a visible point, in numbers whose
//! signs are known.
//!
//! An answer is a number, which means yes if it is at least 0. Its magnitude is the share by which
//! its terms would have to change for the opposite answer, so that `and` is the minimum and `or`
//! the maximum of two answers. The rounding of the visible point is part of these shares.

use glam::DVec3;

use super::number::{Number, Operations};
use super::shapes::{Vector, margin};

/// The answer where no rounding of the point could turn a no into a yes.
const NEVER: f64 = f64::NEG_INFINITY;
/// A point nearer to a surface than this share counts as on it.
const ON: f64 = 1e-18;

/// An object that may hide a light.
pub enum Caster {
    Sphere { centre: DVec3, radius: f64 },
    Triangle([DVec3; 3]),
}

/// The segment from a visible point P to a light.
pub struct Segment<N> {
    p: Vector<N>,
    light: Vector<N>,
    g: Vector<N>,
    /// How far P may be off by rounding, in units of the margin: |P| (1 + units / 16).
    doubt: f64,
}

/// x relative to `size`, a bound on the magnitudes of its terms and of what the rounding of P
/// changes. None if that is not known accurately enough.
fn share<N: Number>(x: &N, size: f64) -> Option<f64> {
    let share = x.to_f64() / size;
    x.sign()?;
    margin(&x.abs(), share.abs())?;
    Some(share)
}

/// As `share`, but where P is on the surface the answer is no; that is decided by `own`, the size
/// of the terms alone. A surface does not hide its own points.
fn strictly<N: Number>(x: &N, size: f64, own: f64) -> Option<f64> {
    let is_on = x.to_f64().abs() <= ON * own && x.is_within(ON * own);
    if is_on { Some(NEVER) } else { share(x, size) }
}

impl<N: Number> Segment<N>
where
    for<'a> &'a N: Operations<N>,
{
    /// The segment from `p` to `light`. Along its ray, `p` may be off by `units` units of rounding.
    pub fn new(p: Vector<N>, light: DVec3, units: f64) -> Self {
        let light = Vector::new(light.into());
        let (g, size) = (light.sub(&p), DVec3::from(p.to_f64()).length());
        Segment { p, light, g, doubt: size * (1.0 + units / 16.0) }
    }

    /// Whether an object other than the point's own hides the light. None if the numbers do not
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
        // Relative to a far corner the terms would cancel, so that the nearest corner is taken.
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
        // `sure` is small for a needle, wherever the light is. If it is 0, so are all terms below,
        // and P is in the plane.
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
            // The same volume, computed from either end of the segment.
            let of_light = from_light[i].length() * from_light[j].length();
            let (ends, of_ends) =
                if of_light < sizes[i] * sizes[j] { (&by_light, of_light) } else { (&seen, sizes[i] * sizes[j]) };
            let size = of_ends * g_size + plane * self.doubt + from_middle;
            let inside = share(&g.dot(&ends[i].cross(&ends[j])), size)?;
            (hides, most) = (hides.min(inside), most.max(inside));
        }
        // With the light on the other side of the plane, all signs would be opposite.
        let other_side = if of_p == NEVER { f64::INFINITY } else { most.max(sure) };
        Some(hides.max(-other_side).min(sure))
    }
}
