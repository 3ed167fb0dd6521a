//! Shadows: the visible points of a tile, and which of them an object hides from a light.
//!
//! The twins of asm/tracers/points.asm, seen.asm, cast.asm and casters.asm.

use super::super::objects::TriangleList;
use super::super::records::{
    CasterBounds, Element as _, GROUP, LightSideView, LitGroups, PointObject, PointView, SphereCasters, TILE_WIDTH,
    TilePoints, TriangleCasters,
};
use super::super::shadows::{BLOCK, Caster, CasterList, FAR_BESIDE_NEAR, LitPoints, axes, own_bits};
use super::super::tiles::TILE_PIXELS;
use super::lanes::{Each, Lanes, Packet, cross_unfused, dot, dot_unfused, zip};

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

/// Objects that may hide a light.
pub trait Hides: Caster {
    /// Which of the points, a mask, one of them hides.
    fn hides<W: Lanes<Number = f64>>(&self, at: usize, points: &Asked<W>) -> W;
}

impl Hides for TriangleCasters<f64> {
    #[inline(always)]
    fn hides<W: Lanes<Number = f64>>(&self, at: usize, points: &Asked<W>) -> W {
        triangle_hides(self, at, points)
    }
}

impl Hides for SphereCasters<f64> {
    #[inline(always)]
    fn hides<W: Lanes<Number = f64>>(&self, at: usize, points: &Asked<W>) -> W {
        sphere_hides(self, at, points)
    }
}

/// TRIANGLE_HIDES.
#[inline(always)]
fn triangle_hides<W: Lanes<Number = f64>>(
    of: &TriangleCasters<f64>,
    at: usize,
    &Asked { p, size, own, .. }: &Asked<W>,
) -> W {
    let all = |field: &[f64; BLOCK]| W::all(field[at]);
    let plane = |x, y, z, at_0| all(at_0).fma(p[0], all(x)).fma(p[1], all(y)).fma(p[2], all(z));
    let first = plane(&of.e1x, &of.e1y, &of.e1z, &of.e10);
    let second = plane(&of.e2x, &of.e2y, &of.e2z, &of.e20);
    let third = plane(&of.e3x, &of.e3y, &of.e3z, &of.e30);
    let behind = plane(&of.px, &of.py, &of.pz, &of.p0).fma(size, all(&of.bound));
    let inside = first.min(second).min(third).not_less(W::of(0.0));
    inside.and(W::of(0.0).greater(behind)).and(unequal(own, all(&of.own)))
}

/// SPHERE_HIDES.
#[inline(always)]
fn sphere_hides<W: Lanes<Number = f64>>(
    of: &SphereCasters<f64>,
    at: usize,
    &Asked { p, size, own, g }: &Asked<W>,
) -> W {
    let (all, zero) = (|field: &[f64; BLOCK]| W::all(field[at]), W::of(0.0));
    let from = |x, y, z| zip(p, [x, y, z].each(all), |p, x| p - x);
    let outside = dot(from(&of.ux, &of.uy, &of.uz), from(&of.wx, &of.wy, &of.wz)) + all(&of.k);
    let q = zip([&of.x, &of.y, &of.z].each(all), p, |c, p| c - p);
    let (a, h) = (dot(g, g), dot(q, g));
    let l = [&of.lx, &of.ly, &of.lz].each(all);
    let is_far = outside.greater(all(&of.far));
    let beside = zip(l, q, |l, q| is_far.select(l, q));
    let of_light = is_far.select(dot_unfused(g, l), h - a);
    let across = [(1, 2), (2, 0), (0, 1)].each(|(i, j)| (beside[i] * g[j]).fnma(beside[j], g[i]));
    let far = all(&of.r2) * a - dot(across, across);
    let near = h * h - outside * a;
    let disc = all(&of.r2).greater(outside).select(near, far) + all(&of.most);
    let before_light = all(&of.most).greater(of_light);
    let before_p = zero - (all(&of.bound) * size).fma(all(&of.side), outside);
    let before_p = (h + all(&of.past)).max(before_p).greater(zero);
    disc.not_less(zero).and(before_light).and(before_p).and(unequal(own, all(&of.own)))
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

/// The least and the greatest of three.
#[inline(always)]
fn least_and_most<W: Lanes>([a, b, c]: [W; 3]) -> [W; 2] {
    [a.min(b).min(c), a.max(b).max(c)]
}

/// How a light sees triangles, in the axes of the side.
pub fn cast<W: Lanes<Number = f64>>(
    view: &LightSideView<f64>,
    axes: [usize; 3],
    triangles: TriangleList<'_>,
    first: u32,
    casters: &mut CasterList<TriangleCasters<f64>>,
) {
    let light = [view.across, view.down, view.depth].each(W::all);
    for (casters, bounds) in casters.blocks() {
        let of = bounds.own.each(|own| triangles.vertices((own - own_bits(first)) as usize));
        for at in (0..BLOCK).step_by(W::COUNT) {
            let corners = [0, 1, 2].each(|n| axes.each(|axis| W::from_fn(|i| of[at + i][n][axis].into())));
            bounds_of(bounds, at, view, corners.each(|v| zip(v, light, W::sub)));
            let [a, b, c] = corners;
            let sides = [zip(a, b, W::sub), zip(a, c, W::sub)];
            let n = cross_unfused(sides[0], sides[1]);
            let (size, least) = (size_of(n), size_of(sides[0]) * size_of(sides[1]) * W::of(1e-2));
            let from_light = zip(a, light, W::sub);
            let volume = dot_unfused(from_light, n);
            let plain = volume.abs().greater(sum_of(from_light) * size * W::of(1e-10));
            planes(casters, (at, false), axes, corners, light, n, volume);
            let no_number = W::all(f64::NAN);
            let bound = size.greater(least).and(plain).select(W::load(&casters.bound[at..]), no_number);
            bound.store(&mut casters.bound[at..]);
        }
    }
}

/// OF_MAGNITUDES, the greatest.
#[inline(always)]
fn size_of<W: Lanes>(of: [W; 3]) -> W {
    of[0].abs().max(of[1].abs()).max(of[2].abs())
}

/// OF_MAGNITUDES, the sum.
#[inline(always)]
fn sum_of<W: Lanes>(of: [W; 3]) -> W {
    of[0].abs() + of[1].abs() + of[2].abs()
}

/// BOUNDS_OF_CASTERS, from corners that are counted from the light.
#[inline(always)]
fn bounds_of<W: Lanes<Number = f64>>(
    bounds: &mut CasterBounds,
    at: usize,
    view: &LightSideView<f64>,
    corners: [[W; 3]; 3],
) {
    let (all, zero, slack) = (W::all, W::of(0.0), W::of(8.0 * f64::EPSILON));
    let corners = corners.each(|[x, y, z]| {
        let z = z * all(view.sign);
        let over = W::of(1.0) / z;
        [x * over, y * over, z]
    });
    let [x, y, z] = [0, 1, 2].each(|axis| least_and_most(corners.each(|v| v[axis])));
    let in_cells = |[low, high]: [W; 2], first: f64, scale: f64| {
        [low - slack, high + slack].each(|x| (x - all(first)) * all(scale))
    };
    let ([x, past_x], [y, past_y]) = (in_cells(x, view.low_x, view.scale_x), in_cells(y, view.low_y, view.scale_y));
    let is_before = z[0].greater(zero);
    let [x, y, past_x, past_y] =
        [x.negated(), y.negated(), past_x, past_y].each(|end| is_before.select(end, all(f64::INFINITY)));
    let x = z[1].greater(zero).select(x, all(f64::NAN));
    let depth = is_before.select((z[0] * W::of(1.0 - f64::from(f32::EPSILON))).negated(), zero);
    let fields = [&mut bounds.x, &mut bounds.y, &mut bounds.past_x, &mut bounds.past_y, &mut bounds.depth];
    for (field, end) in fields.into_iter().zip([x, y, past_x, past_y, depth]) {
        (0..W::COUNT).for_each(|i| field[at + i] = (end.lane(i) as f32).to_bits());
    }
}

/// PLANES_OF_CASTERS, from a normal and something with the sign of its side; of those that reach so `near` to the light or the
/// camera that the rounding of an edge's middle matters, such edges are taken through their ends.
#[inline(always)]
fn planes<W: Lanes<Number = f64>>(
    of: &mut TriangleCasters<f64>,
    (at, near): (usize, bool),
    axes: [usize; 3],
    corners: [[W; 3]; 3],
    light: [W; 3],
    n: [W; 3],
    side: W,
) {
    let with_side = |x: W, side: W| x.zip(side, |x, side| if side.is_sign_negative() { -x } else { x });
    let mut store = |number: usize, plane: [W; 3], at_0: W| {
        let (xyz, field_0) = match number {
            0 => ([&mut of.e1x, &mut of.e1y, &mut of.e1z], &mut of.e10),
            1 => ([&mut of.e2x, &mut of.e2y, &mut of.e2z], &mut of.e20),
            2 => ([&mut of.e3x, &mut of.e3y, &mut of.e3z], &mut of.e30),
            _ => ([&mut of.px, &mut of.py, &mut of.pz], &mut of.p0),
        };
        for (axis, field) in xyz.into_iter().enumerate() {
            let i = (0..3).find(|i| axes[*i] == axis).unwrap_or(axis);
            plane[i].store(&mut field[at..]);
        }
        at_0.store(&mut field_0[at..]);
    };
    let origin = [W::of(0.0); 3];
    let nearest = |of: &[[W; 3]], to: [W; 3]| {
        let size = |v| size_of(zip(v, to, W::sub));
        of[1..].iter().fold(of[0], |nearest, v| {
            let is_nearer = size(nearest).greater(size(*v));
            zip(*v, nearest, |v, nearest| is_nearer.select(v, nearest))
        })
    };
    for (number, (v, w)) in [(0, 1), (1, 2), (2, 0)].into_iter().enumerate() {
        let (v, w) = (corners[v], corners[w]);
        let middle = zip(v, w, |v, w| (v + w) * W::of(0.5));
        let mut points = [middle; 2];
        if near {
            // A rule for edges alone: triangles that share one have the same plane.
            let exact = [nearest(&[v, w], light), nearest(&[v, w, light], origin)];
            let [of_light, of_camera] = [light, origin].each(|from| {
                let [v, w] = [v, w].each(|v| size_of(zip(v, from, W::sub)));
                v.max(w).greater(v.min(w) * W::of(FAR_BESIDE_NEAR))
            });
            let is_near = of_light.select(of_light, of_camera);
            points = std::array::from_fn(|i| zip(exact[i], middle, |exact, middle| is_near.select(exact, middle)));
        }
        let [seen, known] = points;
        let e = cross_unfused(zip(seen, light, W::sub), zip(w, v, W::sub)).each(|e| with_side(e, side));
        store(number, e, dot_unfused(e, known).negated());
    }
    let p = n.each(|n| with_side(n, side.negated()));
    let bound = size_of(n) * W::of(8.0 * f64::EPSILON);
    let nearest = nearest(&corners, origin);
    store(3, p, sum_of(nearest) * bound - dot_unfused(p, nearest));
    bound.store(&mut of.bound[at..]);
}

impl CasterList<TriangleCasters<f64>> {
    /// Sets the planes of one of them whose plane has this normal, which points from the light if `side` is positive; it may
    /// reach [near](planes) to the light or the camera.
    pub fn set_planes(
        &mut self,
        (at, near): (usize, bool),
        axis: usize,
        corners: [[f64; 3]; 3],
        normal: [f64; 3],
        light: [f64; 3],
        side: f64,
    ) {
        let axes = axes(axis);
        let all = |of: [f64; 3]| axes.each(|axis| Packet::<f64, 1, false>::all(of[axis]));
        let Some((of, _)) = self.blocks().nth(at / BLOCK) else { return };
        planes(of, (at % BLOCK, near), axes, corners.map(all), all(light), all(normal), Packet::all(side));
    }
}

/// Leaves open those of the open points of groups that no object hides from the light.
pub fn open<W: Lanes<Number = f64>, C: Hides>(
    &LitPoints { points, light }: &LitPoints<'_>,
    casters: &CasterList<C>,
    groups: &mut LitGroups,
) {
    for group in 0..TILE_PIXELS / GROUP {
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
            for (caster, i) in casters.meeting(groups, group) {
                let mask = caster.hides(i, &points);
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
