//! Shadows: the visible points of a tile, and which of them an object hides from a light.
//!
//! The twins of asm/tracers/points.asm and casters.asm.

use super::super::records::{
    Element as _, PointObject, PointView, SphereCaster, TILE_WIDTH, TilePoints, TriangleCaster,
};
use super::super::shadows::{GROUP, LitPoints};
use super::super::tiles::TILE_PIXELS;
use super::lanes::{Each, Lanes, dot, dot_unfused};

/// Its square is 16 epsilon of f64.
const ROUNDING: f64 = 1.0 / (1 << 24) as f64;

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

/// An object that a ray from the light may meet first.
pub trait Hides {
    /// Which points, a mask, it hides, and are not its own: e leads to them from the light, `size` bounds the sum of the
    /// magnitudes of coordinates.
    fn hides<W: Lanes<Number = f64>>(&self, e: [W; 3], size: W, own: W) -> W;
}

impl Hides for TriangleCaster<f64> {
    #[inline(always)]
    fn hides<W: Lanes<Number = f64>>(&self, e: [W; 3], size: W, own: W) -> W {
        let with = |x, y, z| dot(e, [x, y, z].each(W::all));
        let first = with(self.e1x, self.e1y, self.e1z);
        let second = with(self.e2x, self.e2y, self.e2z);
        let third = with(self.e3x, self.e3y, self.e3z);
        let plane = with(self.px, self.py, self.pz).fnma(size, W::all(self.bound));
        let inside = first.min(second).min(third).not_less(W::of(0.0));
        inside.and(plane.greater(W::of(1.0))).and(unequal(own, W::all(self.own)))
    }
}

impl Hides for SphereCaster<f64> {
    #[inline(always)]
    fn hides<W: Lanes<Number = f64>>(&self, e: [W; 3], size: W, own: W) -> W {
        let all = W::all;
        let c = [self.x, self.y, self.z].each(all);
        let (a, h) = (dot(e, e), dot(e, c));
        let across = [(1, 2), (2, 0), (0, 1)].each(|(i, j)| (c[i] * e[j]).fnma(c[j], e[i]));
        let disc = a.fms(all(self.r2), dot(across, across));
        let outside = a + all(self.k) - h - h;
        let size = size * W::of(ROUNDING);
        let bound = size * size + all(self.bound);
        let there = (h - a + all(self.past)).min(bound.fma(outside, all(self.side)));
        let met = disc.not_less(W::of(0.0)).and(h.greater(all(self.least)));
        met.and(W::of(0.0).greater(there)).and(unequal(own, all(self.own)))
    }
}

#[inline(always)]
fn unequal<W: Lanes<Number = f64>>(a: W, b: W) -> W {
    a.greater(b).select(a.greater(b), b.greater(a))
}

/// Those of the open points that no object hides from the light.
pub fn open<W: Lanes<Number = f64>, C: Hides>(
    &LitPoints { points, first, light: &[x, y, z, size], seen }: &LitPoints<'_>,
    casters: &[C],
    bounds: &[[f32; 4]],
    open: u32,
) -> u32 {
    let mut left = open;
    let meets = |bounds: &[f32; 4]| bounds.iter().zip(seen).all(|(of, seen)| *of <= seen);
    for at in (0..GROUP).step_by(W::COUNT) {
        let here = (open >> at) & ((1 << W::COUNT) - 1);
        if here == 0 {
            continue;
        }
        let p = [&points.x, &points.y, &points.z].each(|axis| W::load(&axis[first + at..]));
        let own = W::load(&points.own[first + at..]);
        let size = p[2].abs() + (p[1].abs() + (p[0].abs() + W::all(size)));
        let e = [p[0] - W::all(x), p[1] - W::all(y), p[2] - W::all(z)];
        let mut hidden = 0;
        for (caster, _) in casters.iter().zip(bounds).filter(|(_, bounds)| meets(bounds)) {
            let mask = caster.hides(e, size, own);
            for lane in 0..W::COUNT {
                hidden |= u32::from(mask.lane(lane).to_bits() != 0) << lane;
            }
            if hidden & here == here {
                break;
            }
        }
        left &= !(hidden << at);
    }
    left
}
