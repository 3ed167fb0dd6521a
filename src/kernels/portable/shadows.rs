//! Shadows: the visible points of a tile, and which of them an object hides from a light.
//!
//! The twins of asm/tracers/points.asm, seen.asm and casters.asm.

use std::ops::Range;

use super::super::records::{
    Element as _, GROUP, LightSideView, LitGroups, PointObject, PointView, SphereCaster, TILE_WIDTH, TilePoints,
    TriangleCaster,
};
use super::super::shadows::{CasterList, LitPoints};
use super::super::tiles::TILE_PIXELS;
use super::lanes::{Each, Lanes, dot, dot_unfused, zip};

/// The points of a tile, of which L is a block of pixels.
pub fn points<L: Lanes, W: Lanes<Number = f64>>(
    view: &PointView<f64>,
    who: &[L::Number; TILE_PIXELS],
    [column, row]: [u32; 2],
    objects: &[PointObject<f64>],
    points: &mut TilePoints<f64>,
) {
    let (all, half) = (W::all, W::of(0.5));
    let width = L::COUNT.min(4);
    let height = L::COUNT / width;
    let blocks = TILE_WIDTH / width;
    for at in (0..TILE_PIXELS).step_by(W::COUNT) {
        let pixel = |i: usize| {
            let (block, in_block) = ((at + i) / L::COUNT, (at + i) % L::COUNT);
            [block % blocks * width + in_block % width, block / blocks * height + in_block / width]
        };
        let [column, row] = [(0, column), (1, row)]
            .each(|(axis, first)| W::of(first.into()) + W::from_fn(|i| pixel(i)[axis] as f64) + half);
        let of = |i: usize| &objects[who[at + i].to_index() as usize];
        let field = |field: fn(&PointObject<f64>) -> f64| W::from_fn(|i| field(of(i)));
        let c = [field(|of| of.x), field(|of| of.y), field(|of| of.z)];
        let x = column * all(view.step) - all(view.half_width);
        let y = all(view.half_height) - row * all(view.step);
        let focal = all(view.focal);
        let d = [x, y, focal];
        let h = focal * c[2] + (c[0] * x + c[1] * y);
        let across = [c[1] * focal - c[2] * y, c[2] * x - c[0] * focal, c[0] * y - c[1] * x];
        let disc = field(|of| of.a) * dot_unfused(d, d) + field(|of| of.b) * h * h;
        let disc = (disc - field(|of| of.e) * dot_unfused(across, across)).max(W::of(0.0));
        let t = W::of(1.0) / ((h + disc.sqrt()) * field(|of| of.w));
        (x * t).store(&mut points.x[at..]);
        (y * t).store(&mut points.y[at..]);
        (t * focal).store(&mut points.z[at..]);
        field(|of| of.own).store(&mut points.own[at..]);
    }
}

/// Points, the sum of the magnitudes of their coordinates, and whose they are; and g, from them to a light.
#[derive(Clone, Copy)]
pub struct Asked<W> {
    p: [W; 3],
    size: W,
    own: W,
    g: [W; 3],
}

/// An object that may hide a light.
pub trait Hides {
    /// Which of the points, a mask, it hides.
    fn hides<W: Lanes<Number = f64>>(&self, points: &Asked<W>) -> W;
}

impl Hides for TriangleCaster<f64> {
    #[inline(always)]
    fn hides<W: Lanes<Number = f64>>(&self, points: &Asked<W>) -> W {
        triangle_hides(self, points)
    }
}

impl Hides for SphereCaster<f64> {
    #[inline(always)]
    fn hides<W: Lanes<Number = f64>>(&self, points: &Asked<W>) -> W {
        sphere_hides(self, points)
    }
}

/// TRIANGLE_HIDES.
#[inline(always)]
fn triangle_hides<W: Lanes<Number = f64>>(of: &TriangleCaster<f64>, &Asked { p, size, own, .. }: &Asked<W>) -> W {
    let all = W::all;
    let plane = |x, y, z, at_0| all(at_0).fma(p[0], all(x)).fma(p[1], all(y)).fma(p[2], all(z));
    let first = plane(of.e1x, of.e1y, of.e1z, of.e10);
    let second = plane(of.e2x, of.e2y, of.e2z, of.e20);
    let third = plane(of.e3x, of.e3y, of.e3z, of.e30);
    let behind = plane(of.px, of.py, of.pz, of.p0).fma(size, all(of.bound));
    let inside = first.min(second).min(third).not_less(W::of(0.0));
    inside.and(W::of(0.0).greater(behind)).and(unequal(own, all(of.own)))
}

/// SPHERE_HIDES.
#[inline(always)]
fn sphere_hides<W: Lanes<Number = f64>>(of: &SphereCaster<f64>, &Asked { p, size, own, g }: &Asked<W>) -> W {
    let (all, zero) = (W::all, W::of(0.0));
    let from = |x, y, z| zip(p, [x, y, z].each(all), |p, x| p - x);
    let outside = dot(from(of.ux, of.uy, of.uz), from(of.wx, of.wy, of.wz)) + all(of.k);
    let q = zip([of.x, of.y, of.z].each(all), p, |c, p| c - p);
    let (a, h) = (dot(g, g), dot(q, g));
    let across = [(1, 2), (2, 0), (0, 1)].each(|(i, j)| (q[i] * g[j]).fnma(q[j], g[i]));
    let far = all(of.r2) * a - dot(across, across);
    let near = h * h - outside * a;
    let disc = all(of.r2).greater(outside).select(near, far);
    let before_light = all(of.most).greater(h - a);
    let before_p = zero - (all(of.bound) * size).fma(all(of.side), outside);
    let before_p = (h + all(of.past)).max(before_p).greater(zero);
    disc.not_less(zero).and(before_light).and(before_p).and(unequal(own, all(of.own)))
}

#[inline(always)]
fn unequal<W: Lanes<Number = f64>>(a: W, b: W) -> W {
    a.greater(b).select(a.greater(b), b.greater(a))
}

/// The bounds of each group of points on a side.
pub fn seen<W: Lanes<Number = f64>>(view: &LightSideView<f64>, axes: [&[f64; TILE_PIXELS]; 3], groups: &mut LitGroups) {
    let all = W::all;
    let light = [view.across, view.down, view.depth];
    for group in 0..TILE_PIXELS / GROUP {
        let mut least = [W::of(f64::INFINITY); 5];
        let end = if groups.open[group] == 0 { group } else { group + 1 };
        for at in (group * GROUP..end * GROUP).step_by(W::COUNT) {
            let [x, y, z] = [0, 1, 2].each(|i| W::load(&axes[i][at..]) - all(light[i]));
            let z = z * all(view.sign);
            let end = z * W::of(1.000_000_000_000_01);
            let is_there = end.greater(x.abs()).and(end.greater(y.abs()));
            let z = is_there.select(z, all(f64::NAN));
            let over = W::of(1.0) / z;
            let x = (x * over - all(view.low_x)) * all(view.scale_x);
            let y = (y * over - all(view.low_y)) * all(view.scale_y);
            let ends = [x.negated(), y.negated(), x, y, z.negated()];
            ends.into_iter().zip(&mut least).for_each(|(end, least)| *least = end.min(*least));
        }
        let LitGroups { x, y, past_x, past_y, depth, .. } = groups;
        for (field, least) in [x, y, past_x, past_y, depth].into_iter().zip(least) {
            let least = (0..W::COUNT).map(|lane| least.lane(lane)).fold(f64::INFINITY, f64::min);
            field[group] = (least as f32).to_bits();
        }
    }
}

/// Leaves open those of the open points of groups that no object hides from the light.
pub fn open<W: Lanes<Number = f64>, C: Hides>(
    &LitPoints { points, light }: &LitPoints<'_>,
    casters: &CasterList<C>,
    groups: &mut LitGroups,
    of: Range<usize>,
) {
    for group in of {
        let open = groups.open[group];
        let mut left = open;
        for at in (0..GROUP).step_by(W::COUNT) {
            let here = (open >> at) & ((1 << W::COUNT) - 1);
            if here == 0 {
                continue;
            }
            let first = group * GROUP + at;
            let p = [&points.x, &points.y, &points.z].each(|axis| W::load(&axis[first..]));
            let own = W::load(&points.own[first..]);
            let size = W::of(0.0) + p[0].abs() + p[1].abs() + p[2].abs();
            let points = Asked { p, size, own, g: zip(light.each(W::all), p, |light, p| light - p) };
            let mut hidden = 0;
            for caster in casters.meeting(groups, group) {
                let mask = caster.hides(&points);
                for lane in 0..W::COUNT {
                    hidden |= u32::from(mask.lane(lane).to_bits() != 0) << lane;
                }
                if hidden & here == here {
                    break;
                }
            }
            left &= !(hidden << at);
        }
        groups.open[group] = left;
    }
}
