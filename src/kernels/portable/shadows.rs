//! Shadows: the visible points of a tile, and which of them are hidden from a light by an object.
//!
//! The twins of the kernels in asm/tracers/points.asm, seen.asm, cast.asm, meet.asm and
//! casters.asm.

use std::ops::Range;

use super::super::objects::TriangleList;
use super::super::records::{
    CasterBounds, CasterEdges, Element as _, GROUP, LightSideView, LitGroups, PointObject, PointView, SphereCaster,
    TILE_PIXELS, TILE_WIDTH, TilePoints, TriangleCaster,
};
use super::super::shadows::{BLOCK, CasterBlock, CasterList, GROUPS, LitPoints, MetByGroup, number, own_bits};
use super::super::types::Plain;
use super::lanes::{Each, Lanes, Number, dot, dot_unfused, zip};

/// How many roundings, of half of EPSILON each, the terms of a caster's edge go through; c counts
/// twice. `rayo ops --proofs` counts them.
pub const CASTER_ROUNDINGS: f64 = 16.0;

/// Finds the visible points of a tile. L is a block of pixels.
pub fn points<L: Lanes, W: Lanes<Number = f64>>(
    view: &PointView<f64>,
    who: &[L::Number; TILE_PIXELS],
    [column, row]: [u32; 2],
    objects: &[PointObject<f64>],
    points: &mut TilePoints,
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
        (0..W::COUNT).for_each(|i| points.own[at + i] = of(i).own as f32);
    }
}

/// Points p, for each the sum of the magnitudes of its coordinates and the number of its object,
/// and the vector g from p to a light.
#[derive(Clone, Copy)]
pub struct Query<W> {
    pub p: [W; 3],
    pub size: W,
    pub own: W,
    pub g: [W; 3],
}

/// An object that may hide a light from points.
pub trait HidesLight: Plain {
    /// A mask of the points that the object hides.
    fn hides<W: Lanes<Number = f64>>(&self, points: &Query<W>) -> W;
}

impl HidesLight for TriangleCaster<f64> {
    #[inline(always)]
    fn hides<W: Lanes<Number = f64>>(&self, points: &Query<W>) -> W {
        triangle_hides(self, points)
    }
}

impl HidesLight for SphereCaster<f64> {
    #[inline(always)]
    fn hides<W: Lanes<Number = f64>>(&self, points: &Query<W>) -> W {
        sphere_hides(self, points)
    }
}

/// A mask of the points that a triangle hides: TRIANGLE_HIDES.
#[inline(always)]
pub fn triangle_hides<W: Lanes<Number = f64>>(of: &TriangleCaster<f64>, &Query { p, size, own, .. }: &Query<W>) -> W {
    let all = W::all;
    let plane = |x, y, z, at_0| all(at_0).fma(p[0], all(x)).fma(p[1], all(y)).fma(p[2], all(z));
    let first = plane(of.e1x, of.e1y, of.e1z, of.e10);
    let second = plane(of.e2x, of.e2y, of.e2z, of.e20);
    let third = plane(of.e3x, of.e3y, of.e3z, of.e30);
    let behind = plane(of.px, of.py, of.pz, of.p0).fma(size, all(of.bound));
    let inside = first.min(second).min(third).not_less(W::of(0.0));
    inside.and(W::of(0.0).greater(behind)).and(unequal(own, all(of.own)))
}

/// A mask of the points that a sphere hides: SPHERE_HIDES.
#[inline(always)]
pub fn sphere_hides<W: Lanes<Number = f64>>(of: &SphereCaster<f64>, &Query { p, size, own, g }: &Query<W>) -> W {
    let (all, zero) = (W::all, W::of(0.0));
    let from = |x, y, z| zip(p, [x, y, z].each(all), |p, x| p - x);
    let outside = dot(from(of.ux, of.uy, of.uz), from(of.wx, of.wy, of.wz)) + all(of.k);
    let q = zip([of.x, of.y, of.z].each(all), p, |c, p| c - p);
    let (a, h) = (dot(g, g), dot(q, g));
    let l = [of.lx, of.ly, of.lz].each(all);
    let is_far = outside.greater(all(of.far));
    let beside = zip(l, q, |l, q| is_far.select(l, q));
    let of_light = is_far.select(dot_unfused(g, l), h - a);
    let across = [(1, 2), (2, 0), (0, 1)].each(|(i, j)| (beside[i] * g[j]).fnma(beside[j], g[i]));
    let far = all(of.r2) * a - dot(across, across);
    let near = h * h - outside * a;
    let disc = all(of.r2).greater(outside).select(near, far) + all(of.most);
    let before_light = all(of.most).greater(of_light);
    let before_p = zero - (all(of.bound) * size).fma(all(of.side), outside);
    let before_p = (h + all(of.past)).max(before_p).greater(zero);
    disc.not_less(zero).and(before_light).and(before_p).and(unequal(own, all(of.own)))
}

#[inline(always)]
fn unequal<L: Lanes>(a: L, b: L) -> L {
    a.equal(b).select(L::of(0.0), L::all(Number::mask(true)))
}

/// Finds where a light sees the points of a tile through a side of its cube, and the bounds of each
/// group there.
pub fn seen<W: Lanes<Number = f64>>(
    view: &LightSideView<f64>,
    axes: [&[f64; TILE_PIXELS]; 3],
    groups: &mut LitGroups,
    seen: &mut [[f32; TILE_PIXELS]; 2],
) {
    let all = W::all;
    let light = [view.across, view.down, view.depth];
    for group in 0..GROUPS {
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
            for (seen, x) in seen.iter_mut().zip([x, y]) {
                (0..W::COUNT).for_each(|i| seen[at + i] = x.lane(i) as f32);
            }
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

/// The minimum and the maximum of three numbers.
#[inline(always)]
fn least_and_most<W: Lanes>([a, b, c]: [W; 3]) -> [W; 2] {
    [a.min(b).min(c), a.max(b).max(c)]
}

/// Triangles as a light sees them through a side of its cube.
pub struct SeenTriangles<W> {
    /// The corners: x and y in cells, and the depth.
    corners: [[W; 3]; 3],
    /// The ends of the bounds, widened by the slack. The lower ends are negated.
    pub x: W,
    pub y: W,
    pub past_x: W,
    pub past_y: W,
    /// The depth of the nearest corner, negated.
    pub depth: W,
    /// A mask of the triangles that are in front of the light with all corners.
    is_before: W,
    /// A bound on the rounding errors of the edges.
    rounded: W,
}

impl<W: Lanes<Number = f64>> SeenTriangles<W> {
    /// Makes them from corners that are relative to the light, in the axes of the side:
    /// BOUNDS_OF_CASTERS.
    #[inline(always)]
    pub fn new(view: &LightSideView<f64>, corners: [[W; 3]; 3]) -> Self {
        let (all, zero, one, infinity) = (W::all, W::of(0.0), W::of(1.0), W::of(f64::INFINITY));
        let corners = corners.each(|[x, y, z]| {
            let z = z * all(view.sign);
            let over = one / z;
            let place = |x: W, low, scale| (x * over - all(low)) * all(scale);
            [place(x, view.low_x, view.scale_x), place(y, view.low_y, view.scale_y), z]
        });
        let [x, y, z] = [0, 1, 2].each(|axis| least_and_most(corners.each(|v| v[axis])));
        let extent = (x[1] - x[0]).max(y[1] - y[0]);
        let most = x[0].abs().max(x[1].abs()).max(y[0].abs()).max(y[1].abs()).max(W::of(4096.0));
        let slack = all(view.slack);
        let four = (slack + slack) + (slack + slack);
        let rounded =
            (most * W::of(CASTER_ROUNDINGS / 2.0 * f64::from(f32::EPSILON)) + (four + four)) * extent + W::of(1e-30);
        let is_before = z[0].greater(zero);
        let or_infinite = |end: W| is_before.select(end, infinity);
        let [past_x, past_y] = [x[1] + slack, y[1] + slack].each(or_infinite);
        let [x, y] = [(x[0] - slack).negated(), (y[0] - slack).negated()].each(or_infinite);
        let x = z[1].greater(zero).select(x, all(f64::NAN));
        let depth = is_before.select((z[0] * W::of(1.0 - f64::from(f32::EPSILON))).negated(), zero);
        SeenTriangles { corners, x, y, past_x, past_y, depth, is_before, rounded }
    }

    /// The three edges. Where these would lose too many digits, three ends of the bounds take their
    /// place: EDGES_OF_CASTERS.
    #[inline(always)]
    pub fn edges(&self) -> [[W; 3]; 3] {
        let (zero, one) = (W::of(0.0), W::of(1.0));
        let rounded = self.rounded;
        let [a, b, c] = self.corners;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let sign = one.with_sign_of(area);
        let is_plain = area.abs().greater(rounded).and(self.is_before).and(W::of(1e30).greater(rounded));
        let edge = |v: [W; 3], w: [W; 3], instead: [W; 3]| {
            let (a, b) = ((v[1] - w[1]) * sign, (w[0] - v[0]) * sign);
            let edge = [a, b, rounded - (a * v[0] + b * v[1])];
            zip(edge, instead, |edge, instead| is_plain.select(edge, instead))
        };
        [
            edge(a, b, [one, zero, self.x]),
            edge(b, c, [one.negated(), zero, self.past_x]),
            edge(c, a, [zero, one, self.y]),
        ]
    }
}

/// Rounds numbers to f32, and stores their bits from the index `at` on.
#[inline(always)]
fn store_rounded<W: Lanes<Number = f64>>(of: W, field: &mut [u32; BLOCK], at: usize) {
    for i in 0..W::COUNT {
        field[at + i] = (of.lane(i) as f32).to_bits();
    }
}

/// Finds where a light sees triangles, in the axes of the side.
pub fn cast<W: Lanes<Number = f64>>(
    view: &LightSideView<f64>,
    axes: [usize; 3],
    triangles: TriangleList<'_>,
    first: u32,
    casters: &mut CasterList,
) {
    let light = [view.across, view.down, view.depth].each(W::all);
    for CasterBlock { bounds, edges } in casters.blocks() {
        edges.own = bounds.own;
        let of = bounds.own.each(|own| triangles.vertices((own - own_bits(first)) as usize));
        for at in (0..BLOCK).step_by(W::COUNT) {
            let corners = [0, 1, 2].each(|n| {
                let corner = axes.each(|axis| W::from_fn(|i| of[at + i][n][axis].into()));
                zip(corner, light, W::sub)
            });
            let seen = SeenTriangles::new(view, corners);
            store_rounded(seen.x, &mut bounds.x, at);
            store_rounded(seen.y, &mut bounds.y, at);
            store_rounded(seen.past_x, &mut bounds.past_x, at);
            store_rounded(seen.past_y, &mut bounds.past_y, at);
            store_rounded(seen.depth, &mut bounds.depth, at);
            let CasterEdges { a1, b1, c1, a2, b2, c2, a3, b3, c3, .. } = &mut *edges;
            for (fields, edge) in [[a1, b1, c1], [a2, b2, c2], [a3, b3, c3]].into_iter().zip(seen.edges()) {
                for (field, of) in fields.into_iter().zip(edge) {
                    store_rounded(of, field, at);
                }
            }
        }
    }
}

/// The edge function c + a x + b y of a caster, at a position that a light sees: EDGE_OF_CASTER.
#[inline(always)]
pub fn caster_edge<L: Lanes>([a, b, c]: [L; 3], x: L, y: L) -> L {
    c.fma(x, a).fma(y, b)
}

/// A mask of the positions x and y, in cells, that are within the edges of the triangle at the
/// index `i` of a block: WITHIN_EDGES.
#[inline(always)]
pub fn within_edges<L: Lanes<Number = f32>>([x, y]: [L; 2], edges: &CasterEdges, i: usize) -> L {
    let all = |field: &[u32; BLOCK]| L::all(f32::from_bits(field[i]));
    let edge = |a, b, c| caster_edge([all(a), all(b), all(c)], x, y);
    let first = edge(&edges.a1, &edges.b1, &edges.c1);
    let second = edge(&edges.a2, &edges.b2, &edges.c2);
    let third = edge(&edges.a3, &edges.b3, &edges.c3);
    first.min(second).min(third).not_less(L::of(0.0))
}

/// A mask of the positions x and y, in cells, that are within the bounds of the object at the index
/// `i` of a block: WITHIN_BOUNDS.
#[inline(always)]
pub fn within_bounds<L: Lanes<Number = f32>>([x, y]: [L; 2], bounds: &CasterBounds, i: usize) -> L {
    let all = |field: &[u32; BLOCK]| L::all(f32::from_bits(field[i]));
    let past_least = (all(&bounds.x) + x).min(all(&bounds.y) + y);
    let before_greatest = (all(&bounds.past_x) - x).min(all(&bounds.past_y) - y);
    past_least.min(before_greatest).not_less(L::of(0.0))
}

/// Lists the pairs of a group in `asking` and an object whose bounds meet the group's. With
/// `points`, only those remain in which an open point of the group lies within the object's edges
/// or bounds.
pub fn meet<L: Lanes<Number = f32>>(
    points: Option<&TilePoints>,
    groups: &LitGroups,
    asking: Range<usize>,
    casters: &mut CasterList,
) {
    casters.set_met(groups, asking, |group, bounds, edges, i| {
        points.is_none_or(|points| {
            (0..GROUP).step_by(L::COUNT).any(|at| {
                let load = |field: &[f32; TILE_PIXELS]| L::load(&field[group * GROUP + at..]);
                let seen = points.seen.each_ref().map(load);
                let is_within = match edges {
                    Some(edges) => within_edges(seen, edges, i),
                    None => within_bounds(seen, bounds, i),
                };
                let own = L::all(f32::from_bits(bounds.own[i]));
                let is_within = is_within.and(unequal(load(&points.own), own));
                (0..L::COUNT).any(|i| is_within.lane(i).to_bits() != 0 && groups.open[group] >> (at + i) & 1 != 0)
            })
        })
    });
}

/// Closes the open points of groups that an object hides from the light.
pub fn open<W: Lanes<Number = f64>, C: HidesLight>(
    &LitPoints { points, light }: &LitPoints<'_>,
    objects: &[C],
    casters: &CasterList,
    groups: &mut LitGroups,
) {
    for MetByGroup { group, met } in casters.met() {
        let open = groups.open[group];
        let mut left = open;
        for at in (0..GROUP).step_by(W::COUNT) {
            let here = (open >> at) & ((1 << W::COUNT) - 1);
            if here == 0 {
                continue;
            }
            let first = group * GROUP + at;
            let p = [&points.x, &points.y, &points.z].each(|axis| W::load(&axis[first..]));
            let own = W::from_fn(|i| points.own[first + i].into());
            let size = W::of(0.0) + p[0].abs() + p[1].abs() + p[2].abs();
            let points = Query { p, size, own, g: zip(light.each(W::all), p, |light, p| light - p) };
            let mut hidden = 0;
            for met in met {
                let mask = objects[number(*met)].hides(&points);
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
