//! Triangles: their bounds in the picture, and planes over a tile's pixels. The twins of
//! asm/tracers/bounds.asm and set_up.asm.

use super::super::objects::{ObjectList, TriangleList};
use super::super::records::{
    BoundsView, CHUNK, Candidate, Element, TileLight, TileShade, TileView, TriangleArrays, TrianglePlanes,
};
use super::super::tiles::{CandidatesFound, Extremes, TriangleChunk, above};
use super::super::types::Plain;
use super::lanes::{Each, Lanes, Number, cross_unfused, dot, zip};

/// A volume below this share of the sum of its terms may be 0 and differ from it by rounding alone.
const PLANE: f64 = 4.0 * f64::EPSILON;
/// The relative error of a product of two rounded sides: three roundings of half of EPSILON each,
/// and a little for the products of these errors. `proofs/product-of-sides.g` proves it.
pub const PRODUCT_ROUNDING: f64 = 1.5 * f64::EPSILON * (1.0 + 1.0 / (1u64 << 49) as f64);
/// A corner nearer than this could overflow when it is projected.
const LEAST: f64 = 1e-30;

/// The bounds of one object in each lane: the first column and one past the last, the same for
/// rows, and an upper bound of 1/t.
pub struct Bounds<L> {
    pub columns: [L; 2],
    pub rows: [L; 2],
    pub most: L,
}

impl<L: Lanes> Bounds<L> {
    /// The number of pixels of the bounds, across and down: LENGTH.
    #[inline(always)]
    pub fn lengths(&self) -> [L; 2] {
        [self.columns, self.rows].each(|[first, past]| past - first)
    }

    /// Stores those lanes that are candidates after the first `count` candidates. `ids` has the ids
    /// of as many lanes as have objects.
    #[inline(always)]
    pub fn push(&self, ids: std::ops::Range<u32>, keep_all: bool, to: &mut [Candidate], count: &mut usize) {
        let [across, down] = self.lengths();
        let any = across.min(down).greater(L::of(0.0));
        for (lane, id) in (0..L::COUNT).zip(ids) {
            let both = |[first, past]: [L; 2]| first.lane(lane).to_index() | past.lane(lane).to_index() << 16;
            let most = self.most.lane(lane).to_f64() as f32;
            to[*count] = Candidate { id, columns: both(self.columns), rows: both(self.rows), most };
            *count += usize::from(keep_all || any.lane(lane).is_set());
        }
    }
}

fn transpose(triangles: TriangleList<'_>, ids: impl Iterator<Item = usize>, to: &mut TriangleArrays) {
    for (i, id) in ids.enumerate() {
        let [a, b, c] = triangles.vertices(id);
        (to.ax[i], to.ay[i], to.az[i]) = (a.x.to_bits(), a.y.to_bits(), a.z.to_bits());
        (to.bx[i], to.by[i], to.bz[i]) = (b.x.to_bits(), b.y.to_bits(), b.z.to_bits());
        (to.cx[i], to.cy[i], to.cz[i]) = (c.x.to_bits(), c.y.to_bits(), c.z.to_bits());
        if let TriangleList::Apart(list) = triangles {
            let colour = list[id].colour;
            (to.red[i], to.green[i], to.blue[i]) = (colour.x.to_bits(), colour.y.to_bits(), colour.z.to_bits());
        }
    }
}

/// The corners of the triangles from the index `at` on.
#[inline(always)]
fn corners<L: Lanes>(of: &TriangleArrays, at: usize) -> [[L; 3]; 3] {
    [[&of.ax, &of.ay, &of.az], [&of.bx, &of.by, &of.bz], [&of.cx, &of.cy, &of.cz]]
        .each(|corner| corner.each(|numbers| L::load_bits(&numbers[at..])))
}

/// A mask of the lanes in which v . n loses eight times as many digits at the first corner as at
/// another: BETTER_CORNER.
#[inline(always)]
pub fn better_corner<L: Lanes>([a, b, c]: [[L; 3]; 3]) -> L {
    let square = |v: [L; 3]| dot(v, v);
    let [ab, ac, bc] = [(a, b), (a, c), (b, c)].each(|(v, w)| square(zip(v, w, L::sub)));
    let [a, b, c] = [square(a) * ab * ac, square(b) * bc * ab, square(c) * bc * ac];
    (a * L::of(1.0 / 64.0)).greater(b.min(c))
}

pub fn bounds<L: Lanes<Number = f32>>(
    view: &BoundsView<f32>,
    triangles: TriangleList<'_>,
    first_id: u32,
    keep_all: bool,
    candidates: &mut [Candidate],
) -> CandidatesFound {
    let mut count = 0;
    let mut extremes = Extremes::NONE;
    let mut of = TriangleArrays::ZERO;
    let mut nearest = L::of(0.0);
    let mut longest = L::of(0.0);
    let mut sizes = [L::of(0.0), L::all(f32::MAX)];
    for start in (0..triangles.len()).step_by(CHUNK) {
        let end = triangles.len().min(start + CHUNK);
        // The last packet is filled up with copies of the last triangle.
        let past = end.next_multiple_of(L::COUNT);
        transpose(triangles, (start..past).map(|id| id.min(end - 1)), &mut of);
        for at in (0..past - start).step_by(L::COUNT) {
            let corners = corners::<L>(&of, at);
            let size = corners.as_flattened().iter().fold(L::of(0.0), |size, x| size.zip(x.abs(), above));
            sizes =
                [sizes[0].zip(size, above), sizes[1].zip(size, |a, b| if b.to_bits() < a.to_bits() { b } else { a })];
            for channel in [&of.red, &of.green, &of.blue] {
                let brightest = channel[at..at + L::COUNT].iter().copied().fold(0, u32::max);
                extremes.brightest = above(extremes.brightest, f32::from_bits(brightest));
            }
            let FoundBounds { bounds, most_in_front } = bounds_of(view, corners);
            let [across, down] = bounds.lengths();
            let any = across.min(down).greater(L::of(0.0));
            longest = longest.max(any.and(across.max(down)));
            nearest = nearest.zip(most_in_front, above);
            let id = first_id + (start + at) as u32;
            bounds.push(id..first_id + end as u32, keep_all, candidates, &mut count);
        }
    }
    for lane in 0..L::COUNT {
        extremes.most = above(extremes.most, sizes[0].lane(lane));
        extremes.least = f32::from_bits(extremes.least.to_bits().min(sizes[1].lane(lane).to_bits()));
        extremes.nearest = above(extremes.nearest, nearest.lane(lane));
        extremes.longest = above(extremes.longest, longest.lane(lane));
    }
    CandidatesFound { count, extremes }
}

/// The bounds of triangles as `bounds_of` finds them.
pub struct FoundBounds<L> {
    /// The bounds. For triangles that extend behind the camera, the upper bound of 1/t is the
    /// largest f32.
    pub bounds: Bounds<L>,
    /// The upper bound of 1/t of triangles of which some part is in front of the camera; 0 for the
    /// others.
    pub most_in_front: L,
}

/// The projections of three corners along an axis of the picture, and the least and the greatest of
/// them.
#[derive(Clone, Copy)]
pub struct Projected<L> {
    pub along: [L; 3],
    pub ends: [L; 2],
}

/// Projects the coordinates of corners: PROJECT.
#[inline(always)]
pub fn project<L: Lanes>(over: [L; 3], coordinates: [L; 3]) -> Projected<L> {
    let along = zip(over, coordinates, L::mul);
    let [a, b, c] = along;
    Projected { along, ends: [a.min(b).min(c), b.max(a).max(c)] }
}

/// Twice the area between two vectors of the picture: CROSS2.
#[inline(always)]
pub fn cross2<L: Lanes>([ax, ay]: [L; 2], [bx, by]: [L; 2]) -> L {
    ax * by - ay * bx
}

/// The greatest of `low` and the least edge, and the least of `high` and the greatest edge:
/// EDGES_HERE.
#[inline(always)]
pub fn edges_here<L: Lanes>([low, high]: [L; 2], [a, b, c]: [L; 3]) -> [L; 2] {
    [low.max(a.min(b).min(c)), high.min(a.max(b).max(c))]
}

/// Finds the bounds of triangles. Bounds that contain at most four pixels, each outside of some
/// edge, become empty.
#[inline(always)]
pub fn bounds_of<L: Lanes<Number = f32>>(view: &BoundsView<f32>, corners: [[L; 3]; 3]) -> FoundBounds<L> {
    let (all, zero) = (L::all, L::of(0.0));
    let least = |[a, b, c]: [L; 3]| a.min(b).min(c);
    let most = |[a, b, c]: [L; 3]| a.max(b).max(c);
    let z = corners.each(|corner| corner[2]);
    let (nearest, farthest) = (least(z), most(z));
    let over = z.each(|z| all(view.to_pixels) / z);
    let [across, up] = [0, 1].each(|axis| project(over, corners.each(|corner| corner[axis])));
    let ([left, right], [bottom, top]) = (across.ends, up.ends);
    let pixels = |[from, to]: [L; 2], side: f32| {
        let [first, past] = [from + all(view.low), to + all(view.high)];
        [first, past].each(|x| x.max(zero).min(all(side)).floor())
    };
    let columns = pixels([left + all(view.column), right + all(view.column)], view.width);
    let rows = pixels([all(view.row) - top, all(view.row) - bottom], view.height);
    let (ahead, in_part) = (nearest.greater(L::of(LEAST)), farthest.greater(zero));
    let cannot_exceed = ahead.select(all(view.most) / nearest, L::all(f32::MAX));

    // The edges at the first pixel within the bounds, and their increments per column and per row.
    let x = across.along.each(|x| x - (columns[0] - all(view.column)));
    let y = up.along.each(|y| y - (all(view.row) - rows[0]));
    let next = [(0, 1), (1, 2), (2, 0)];
    let mut edges = next.each(|(v, w)| cross2([x[v], y[v]], [x[w], y[w]]));
    let (column, row) = (next.each(|(v, w)| y[v] - y[w]), next.each(|(v, w)| x[v] - x[w]));
    // Over these pixels the greatest value of the least edge, and the least value of the greatest
    // edge.
    let mut ends = [least(edges), most(edges)];
    edges = zip(edges, column, L::add);
    ends = edges_here(ends, edges);
    edges = zip(edges, row, L::add);
    ends = edges_here(ends, edges);
    edges = zip(edges, column, L::sub);
    let [low, high] = edges_here(ends, edges);
    let has_no_pixel = all(view.outside).greater(low.max(high.negated()));
    let [width, height] = [right - left, top - bottom].each(|length| ahead.select(length, L::all(f32::MAX)));
    let is_small = all(view.reach).greater(width).and(all(view.reach).greater(height));
    let nowhere = has_no_pixel.and(is_small);

    let whole = |[first, past]: [L; 2], side: f32| {
        [ahead.select(first, zero), ahead.select(past, all(side))].each(|x| in_part.and(x))
    };
    let columns = whole(columns, view.width).each(|x| nowhere.select(zero, x));
    let bounds = Bounds { columns, rows: whole(rows, view.height), most: cannot_exceed };
    FoundBounds { bounds, most_in_front: in_part.and(cannot_exceed) }
}

/// A triangle's normal, the volume of its tetrahedron with the camera, and a mask of the lanes
/// where that differs from 0 by more than rounding: TRIANGLE_VOLUME.
pub struct Volume<W> {
    pub normal: [W; 3],
    pub volume: W,
    pub seen_from_a_side: W,
}

impl<W: Lanes<Number = f64>> Volume<W> {
    /// The volume from a corner v and the differences of v and the two other corners.
    #[inline(always)]
    pub fn new(v: [W; 3], to_b: [W; 3], to_c: [W; 3]) -> Self {
        let products = [(1, 2), (2, 0), (0, 1)].each(|(i, j)| [to_b[i] * to_c[j], to_b[j] * to_c[i]]);
        let normal = products.each(|[p, q]| p - q);
        let [x, y, z] = zip(v, normal, W::mul);
        let volume = x + y + z;
        let rounded = (x.abs() + y.abs() + z.abs()) * W::of(PLANE);
        let [x, y, z] = zip(products.each(|[p, q]| p.abs() + q.abs()), v.each(W::abs), W::mul);
        let seen_from_a_side = volume.abs().greater(rounded + (x + y + z) * W::of(PRODUCT_ROUNDING));
        Volume { normal, volume, seen_from_a_side }
    }
}

/// The edge from v to w with the sign of `side`, divided by its rounding bound: TRIANGLE_EDGE.
#[inline(always)]
pub fn edge<W: Lanes<Number = f64>>(view: &TileView<f64>, v: [W; 3], w: [W; 3], side: W) -> [W; 3] {
    let all = W::all;
    let e = cross_unfused(v, w);
    let at_origin = dot(e, [view.dx, view.dy, view.dz].each(all));
    let bound = dot(e.each(W::abs), [view.bound_x, view.bound_y, view.bound_z].each(all));
    let bound = bound.fma(at_origin.abs(), all(view.bound_0));
    let over = W::of(1.0) / bound * W::of(1.0).with_sign_of(side);
    [at_origin * over, e[0] * all(view.step) * over, e[1] * all(view.down) * over]
}

/// Rotates the corners of the triangles from the index `at` on, so that at the first one the terms
/// of v . n, with n from the two sides there, are small. Large terms may cancel.
#[inline(always)]
fn put_best_corner_first<W: Lanes<Number = f64>>(of: &mut TriangleArrays, at: usize) {
    let mut turned = better_corner(corners::<W>(of, at));
    while turned.any() {
        for i in (0..W::COUNT).filter(|i| turned.lane(*i).is_set()).map(|i| at + i) {
            (of.ax[i], of.bx[i], of.cx[i]) = (of.bx[i], of.cx[i], of.ax[i]);
            (of.ay[i], of.by[i], of.cy[i]) = (of.by[i], of.cy[i], of.ay[i]);
            (of.az[i], of.bz[i], of.cz[i]) = (of.bz[i], of.cz[i], of.az[i]);
        }
        turned = better_corner(corners::<W>(of, at));
    }
}

/// Stores 1/t as a plane over the pixels: it is (n . d) / (n . v), which is affine. For a triangle
/// that is never hit it is 0, which is never nearest.
#[inline(always)]
fn put_inverse<W: Lanes<Number = f64>, E: Element>(
    view: &TileView<f64>,
    &Volume { normal, volume, seen_from_a_side }: &Volume<W>,
    planes: &mut TrianglePlanes<E>,
    at: usize,
) {
    let all = W::all;
    let over = all(view.scale) / volume;
    let n = normal.each(|n| seen_from_a_side.and(n * over));
    let ray = [view.dx, view.dy, view.dz].each(all);
    dot(n, ray).store(&mut planes.t0[at..]);
    (n[0] * all(view.step)).store(&mut planes.tx[at..]);
    (n[1] * all(view.down)).store(&mut planes.ty[at..]);
}

/// The weight of a light in one channel: WEIGHT.
#[inline(always)]
pub fn weight<W: Lanes>(colour: W, radiance: W::Number) -> W {
    colour * W::all(radiance)
}

/// Stores the effect of each light on triangles of these colours with a corner at `v`: |n . (l -
/// v)| / |n|, and the weights. `scale` is the scale of 1/t. The first `shades` belong to the first
/// lane.
#[inline(always)]
fn put_shades<W: Lanes<Number = f64>, E: Element>(
    lights: &[TileLight<f64>],
    scale: f64,
    v: [W; 3],
    normal: [W; 3],
    colour: [W; 3],
    shades: &mut [TileShade<E>],
) {
    let all = W::all;
    let per = W::of(1.0) / (dot(normal, normal).sqrt() * all(scale));
    for (number, light) in lights.iter().enumerate() {
        let along = dot(zip([light.x, light.y, light.z].each(all), v, W::sub), normal).abs() * per;
        let cosine = along.min(W::of(f64::INFINITY));
        let radiance = [light.red, light.green, light.blue];
        let weights = [0, 1, 2].each(|channel| weight(colour[channel], radiance[channel]));
        for lane in 0..W::COUNT {
            let [red, green, blue] = weights.each(|weight| E::from_f64(weight.lane(lane)));
            shades[lane * lights.len() + number] =
                TileShade { cosine: E::from_f64(cosine.lane(lane)), red, green, blue };
        }
    }
}

/// Stores the edges with the sign of the volume, divided by their rounding bounds: TRIANGLE_EDGE.
#[inline(always)]
fn put_edges<W: Lanes<Number = f64>, E: Element>(
    view: &TileView<f64>,
    [a, b, c]: [[W; 3]; 3],
    side: W,
    planes: &mut TrianglePlanes<E>,
    at: usize,
) {
    let [e0, ex, ey] = edge(view, a, b, side);
    e0.store(&mut planes.e10[at..]);
    ex.store(&mut planes.e1x[at..]);
    ey.store(&mut planes.e1y[at..]);
    let [e0, ex, ey] = edge(view, b, c, side);
    e0.store(&mut planes.e20[at..]);
    ex.store(&mut planes.e2x[at..]);
    ey.store(&mut planes.e2y[at..]);
    let [e0, ex, ey] = edge(view, c, a, side);
    e0.store(&mut planes.e30[at..]);
    ex.store(&mut planes.e3x[at..]);
    ey.store(&mut planes.e3y[at..]);
}

/// Sets up a chunk of triangles: as planes over a tile's pixels, with the effects of the lights.
pub fn set_up<W: Lanes<Number = f64>, E: Element>(
    view: &TileView<f64>,
    chunk: TriangleChunk<'_>,
    of: &mut TriangleArrays,
    planes: &mut TrianglePlanes<E>,
    shades: &mut [TileShade<E>],
) {
    let TriangleChunk { triangles, lights, candidates, first_id } = chunk;
    // The last packet is filled up with copies of the first triangle.
    let past = candidates.len().next_multiple_of(W::COUNT);
    transpose(triangles, (0..past).map(|i| candidates.get(i).unwrap_or(&candidates[0]).id as usize), of);
    for (i, candidate) in candidates.iter().enumerate() {
        (of.columns[i], of.rows[i], of.most[i]) = (candidate.columns, candidate.rows, candidate.most.to_bits());
    }
    for at in (0..past).step_by(W::COUNT) {
        put_best_corner_first::<W>(of, at);
        let corners = corners::<W>(of, at);
        let [a, b, c] = corners;
        let volume = Volume::new(a, zip(a, b, W::sub), zip(a, c, W::sub));
        let side = W::of(0.0).with_sign_of(volume.volume);
        put_inverse(view, &volume, planes, at);
        (W::of((first_id + at) as f64) + W::natural()).store(&mut planes.id[at..]);
        side.store(&mut planes.side[at..]);
        W::load_bits(&of.most[at..]).store(&mut planes.most[at..]);
        let colour = [&of.red, &of.green, &of.blue].each(|channel| W::load_bits(&channel[at..]));
        put_shades(lights, view.scale, a, volume.normal, colour, &mut shades[at * lights.len()..]);
        put_edges(view, corners, side, planes, at);
    }
}
