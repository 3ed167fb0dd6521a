//! Spheres: their bounds in the picture, functions of its pixels that they are set up as, and
//! shading records.
//!
//! The twins of the kernels in asm/tracers/sphere_bounds.asm, sphere_set_up.asm and around.asm.

use super::super::records::{
    AroundSphere, CHUNK, Candidate, Element, ObjectLight, ShortLight, Sphere, SphereArrays, SpherePlanes, SphereView,
    TileLight, TileSphere,
};
use super::super::tiles::{CandidatesFound, Extremes, SphereChunk, SphereRecords, above};
use super::super::types::Plain;
use super::lanes::{Each, Lanes, Number, cross_unfused, dot_unfused, zip};
use super::set_up::Bounds;

/// A sphere counts as in front if its centre is at least this many radii in front of the camera's
/// plane.
const FRONT: f64 = 1.001;
/// By how many pixels the bounds of a sphere are widened.
pub const OUTLINE: f64 = 1e-3;
/// A bound on the rounding error of the discriminant D, relative to its terms.
pub const ROUNDINGS: f64 = 4.0 * f32::EPSILON as f64;
/// The largest f64 below 1/2.
const BELOW_HALF: f64 = 0.5 - f64::EPSILON / 4.0;
/// The short form is accurate enough if the light's distance from the sphere, in radii, is between
/// the first two numbers, and if cancellation leaves at least 1 / the third number of the terms.
const SHORT: [f64; 3] = [0.25, (1u64 << 36) as f64, 1024.0];

fn transpose<'a>(spheres: impl Iterator<Item = &'a Sphere>, to: &mut SphereArrays) {
    for (i, sphere) in spheres.enumerate() {
        (to.x[i], to.y[i], to.z[i]) = (sphere.centre.x.to_bits(), sphere.centre.y.to_bits(), sphere.centre.z.to_bits());
        let colour = sphere.colour;
        (to.red[i], to.green[i], to.blue[i]) = (colour.x.to_bits(), colour.y.to_bits(), colour.z.to_bits());
        to.radius[i] = sphere.radius.to_bits();
    }
}

/// The centres and radii of a packet of spheres.
struct CentresAndRadii<W> {
    centre: [W; 3],
    radius: W,
}

/// The centres and radii of the spheres from the index `at` on.
#[inline(always)]
fn centres_and_radii<W: Lanes>(of: &SphereArrays, at: usize) -> CentresAndRadii<W> {
    CentresAndRadii {
        centre: [&of.x, &of.y, &of.z].each(|numbers| W::load_bits(&numbers[at..])),
        radius: W::load_bits(&of.radius[at..]),
    }
}

/// The ends of silhouettes along one axis, on the film at distance 1: SILHOUETTE.
#[inline(always)]
fn silhouette<W: Lanes>(cx: W, cz: W, m: W) -> [W; 2] {
    let one = W::of(1.0);
    let root = (cx * cx + m).sqrt();
    let b = cx * cz;
    let is_right = b.not_less(W::of(0.0));
    let q = is_right.select(b + root, b - root);
    // The product of the two ends is (cx^2 - 1) / m.
    let (e, of_q) = ((cx - one) * (cx + one) / q, q / m);
    [is_right.select(e, of_q), is_right.select(of_q, e)]
}

/// The columns and rows between which silhouettes lie, in fractions of pixels: SPHERE_BOX.
#[inline(always)]
pub fn outline<W: Lanes<Number = f64>>(view: &SphereView<f64>, [cx, cy, cz]: [W; 3]) -> [[W; 2]; 2] {
    let (all, half) = (W::all, W::of(0.5));
    let m = cz * cz - W::of(1.0);
    let [bottom, top] = silhouette(cy, cz, m);
    let column = |x: W| (x * all(view.focal) + all(view.half_width)) / all(view.step) - half;
    let row = |y: W| (all(view.half_height) - y * all(view.focal)) / all(view.step) - half;
    [silhouette(cx, cz, m).each(column), [row(top), row(bottom)]]
}

pub fn bounds<W: Lanes<Number = f64>>(
    view: &SphereView<f64>,
    spheres: &[Sphere],
    first_id: u32,
    keep_all: bool,
    candidates: &mut [Candidate],
) -> CandidatesFound {
    let mut count = 0;
    let mut extremes = Extremes::NONE;
    let mut of = SphereArrays::ZERO;
    for (chunk, first) in spheres.chunks(CHUNK).zip((first_id..).step_by(CHUNK)) {
        for Sphere { radius, colour, centre } in chunk {
            let size = centre.abs().to_array().into_iter().fold(*radius, above);
            extremes.most = above(extremes.most, size);
            extremes.least = f32::from_bits(extremes.least.to_bits().min(radius.to_bits()));
            extremes.brightest = colour.to_array().into_iter().fold(extremes.brightest, above);
        }
        // The last packet is filled up with copies of the last sphere.
        let past = chunk.len().next_multiple_of(W::COUNT);
        transpose((0..past).map(|i| chunk.get(i).unwrap_or(&chunk[chunk.len() - 1])), &mut of);
        for at in (0..past).step_by(W::COUNT) {
            let CentresAndRadii { centre, radius } = centres_and_radii::<W>(&of, at);
            let bounds = bounds_of(view, centre, radius);
            for lane in 0..W::COUNT {
                extremes.nearest = above(extremes.nearest, bounds.most.lane(lane) as f32);
            }
            bounds.push(first + at as u32..first + chunk.len() as u32, keep_all, candidates, &mut count);
        }
    }
    CandidatesFound { count, extremes }
}

/// The first pixel between two coordinates, and one past the last: PIXELS_BETWEEN.
#[inline(always)]
pub fn pixels_between<W: Lanes<Number = f64>>([low, high]: [W; 2], side: f64) -> [W; 2] {
    let (first, past) = ((low - W::of(OUTLINE)).ceil(), (high + W::of(OUTLINE)).floor() + W::of(1.0));
    [first, past].each(|x| x.max(W::of(0.0)).min(W::all(side)))
}

/// The pixel at the middle of two coordinates, rounded half away from 0, within the picture:
/// NEAREST_PIXEL.
#[inline(always)]
fn nearest_pixel<W: Lanes<Number = f64>>([a, b]: [W; 2], side: W) -> W {
    let middle = (a + b) * W::of(0.5);
    (middle.abs() + W::of(BELOW_HALF)).floor().with_sign_of(middle).min(side).max(W::of(0.0))
}

/// The greatest distance from the origin of the part of the outline that is in the picture, plus
/// one pixel: REACH.
#[inline(always)]
fn reach<W: Lanes<Number = f64>>([a, b]: [W; 2], origin: W, side: W) -> W {
    (b.min(side) - origin).max(origin - a.max(W::of(0.0))) + W::of(1.0)
}

/// Finds the bounds of spheres. The upper bound of 1/t is `most` divided by the distance of the
/// nearest point. It is the largest f32 if planes cannot trace the sphere, or if they may lose
/// digits because it is far to the side.
#[inline(always)]
pub fn bounds_of<W: Lanes<Number = f64>>(view: &SphereView<f64>, centre: [W; 3], radius: W) -> Bounds<W> {
    let (all, one) = (W::all, W::of(1.0));
    let most = all(view.most) / (centre[2] - radius);
    let c = centre.each(|x| x / radius);
    let (cz, squared) = (c[2], dot_unfused(c, c));
    let [columns, rows] = outline(view, c);
    let in_front = cz.not_less(W::of(FRONT)).and(W::of(f64::INFINITY).greater(squared));
    let in_part = cz.greater(W::of(-1.0));
    let known = |[first, past]: [W; 2], side: f64| [in_front.and(first), in_part.and(in_front.select(past, all(side)))];
    let keeps_digits = in_front.and((cz * cz + cz * cz - one).not_less(squared));
    let most = in_part.and(keeps_digits.select(most, W::of(f32::MAX.into())));
    Bounds {
        columns: known(pixels_between(columns, view.width), view.width),
        rows: known(pixels_between(rows, view.height), view.height),
        most,
    }
}

/// What bounds and shading records both need of spheres in front of the camera: SPHERE_D.
pub struct InFront<W> {
    /// The centre, in radii.
    pub c: [W; 3],
    /// c . c; `k` is c . c - 1.
    pub squared: W,
    pub k: W,
    /// The scale divided by k and by the radius.
    pub over: W,
    /// The sphere's own origin, which is a pixel; `reach` is the greatest distance of its outline
    /// from there.
    pub origin: [W; 2],
    pub reach: [W; 2],
    /// The ray at the origin; `h` is c . d there, and its increments per column and per row.
    pub ray: [W; 3],
    pub h: [W; 3],
    /// The discriminant D: its value at the origin, and its coefficients of x, y, x^2, x y and y^2.
    pub d: [W; 6],
}

impl<W: Lanes<Number = f64>> InFront<W> {
    #[inline(always)]
    pub fn new(view: &SphereView<f64>, centre: [W; 3], radius: W) -> Self {
        let (all, half, one) = (W::all, W::of(0.5), W::of(1.0));
        let step = all(view.step);
        let c = centre.each(|x| x / radius);
        let squared = dot_unfused(c, c);
        let k = (c[2] + one) * ((centre[2] - radius) / radius) + c[0] * c[0] + c[1] * c[1];
        let over = all(view.scale) / (k * radius);
        let outline = outline(view, c);
        let sides = [view.width, view.height].each(all);
        let origin = [0, 1].each(|axis| nearest_pixel(outline[axis], sides[axis]));
        let reach = [0, 1].each(|axis| reach(outline[axis], origin[axis], sides[axis]));
        let x = (origin[0] + half) * step - all(view.half_width);
        let y = all(view.half_height) - (origin[1] + half) * step;
        let ray = [x, y, all(view.focal)];
        let across = cross_unfused(c, ray);
        let [sx, sy, sz] = c.each(|c| c * step);
        let square = over * over;
        let twice = |x: W| x + x;
        let d = [
            dot_unfused(ray, ray) - dot_unfused(across, across),
            twice(x * step - (across[1] * sz - across[2] * sy)),
            twice(y * step + (across[0] * sz - across[2] * sx)).negated(),
            step * step - (sy * sy + sz * sz),
            twice(sy * sx).negated(),
            step * step - (sx * sx + sz * sz),
        ];
        let d = d.each(|x| x * square);
        InFront { c, squared, k, over, origin, reach, ray, h: [dot_unfused(c, ray), sx, sy], d }
    }
}

/// Transposes the spheres of a chunk and their bounds, up to a whole number of packets, and returns
/// how many spheres these have.
fn chunk<W: Lanes>(SphereChunk { spheres, candidates }: SphereChunk<'_>, of: &mut SphereArrays) -> usize {
    let past = candidates.len().next_multiple_of(W::COUNT);
    transpose((0..past).map(|i| &spheres[candidates.get(i).unwrap_or(&candidates[0]).id as usize]), of);
    for (i, candidate) in candidates.iter().enumerate() {
        (of.columns[i], of.rows[i], of.most[i]) = (candidate.columns, candidate.rows, candidate.most.to_bits());
    }
    past
}

/// The sum of the magnitudes of the terms of D at so many columns and rows from its origin. TERM
/// adds each term but the first.
#[inline(always)]
pub fn sum_of_terms<W: Lanes>(d: [W; 6], [i, j]: [W; 2]) -> W {
    let terms = [d[1] * i, d[2] * j, d[3] * i * i, d[4] * i * j, d[5] * j * j];
    terms.into_iter().fold(d[0].abs(), |sum, term| sum + term.abs())
}

/// The vector from centres to a light, in radii: TO_LIGHT.
#[inline(always)]
pub fn to_light<W: Lanes<Number = f64>>(light: &TileLight<f64>, centre: [W; 3], radius: W) -> [W; 3] {
    zip([light.x, light.y, light.z].each(W::all), centre, |l, c| (l - c) / radius)
}

/// The weight of a light in one channel, where white is `white`, at most `most` unless that is
/// infinite: SPHERE_WEIGHT.
#[inline(always)]
pub fn weight<W: Lanes<Number = f64>>(colour: W, radiance: f64, white: f64, most: f64) -> W {
    let weight = colour * W::all(white) * W::all(radiance);
    if most.is_finite() { weight.min(W::all(most)) } else { weight }
}

/// The first part of the normal divided by t, n / t = (d - h c / k) - sqrt(D) c / k over the radius,
/// along one axis, and its increments per column and per row: NORMAL. `t` is h / k and its
/// increments, `ray` is d, its increment per column and its decrement per row, and `per` is the
/// scale divided by the radius.
#[inline(always)]
pub fn normal<W: Lanes>(c: W, t: [W; 3], ray: [W; 3], per: W) -> [W; 3] {
    let t = t.each(|t| t * c);
    [ray[0] - t[0], ray[1] - t[1], t[2] - ray[2]].each(|x| x * per)
}

/// Sets up a chunk of spheres as functions of the pixels, each relative to the sphere's own origin.
pub fn set_up<W: Lanes<Number = f64>, E: Element>(
    view: &SphereView<f64>,
    spheres: SphereChunk<'_>,
    first_id: usize,
    of: &mut SphereArrays,
    planes: &mut SpherePlanes<E>,
) {
    for at in (0..chunk::<W>(spheres, of)).step_by(W::COUNT) {
        let CentresAndRadii { centre, radius } = centres_and_radii::<W>(of, at);
        let InFront { over, origin, reach, h: [h, hx, hy], d, .. } = InFront::new(view, centre, radius);
        // The rounding error of D is at most a few units of its terms at the outline.
        let bound = sum_of_terms(d, reach) * W::of(ROUNDINGS);
        let fields = [
            (&mut planes.d0, d[0]),
            (&mut planes.dx, d[1]),
            (&mut planes.dy, d[2]),
            (&mut planes.dxx, d[3]),
            (&mut planes.dxy, d[4]),
            (&mut planes.dyy, d[5]),
            (&mut planes.bound, bound),
            (&mut planes.column, origin[0]),
            (&mut planes.row, origin[1]),
            (&mut planes.h, over * h),
            (&mut planes.hx, over * hx),
            (&mut planes.hy, (over * hy).negated()),
            (&mut planes.most, W::load_bits(&of.most[at..])),
            (&mut planes.id, W::of((first_id + at) as f64) + W::natural()),
        ];
        fields.into_iter().for_each(|(field, numbers)| numbers.store(&mut field[at..]));
    }
}

/// A packet of spheres in front of the camera whose shading records are made.
struct ShadedPacket<'a, W> {
    view: &'a SphereView<f64>,
    lights: &'a [TileLight<f64>],
    centre: [W; 3],
    radius: W,
    in_front: InFront<W>,
    colour: [W; 3],
    /// The scale divided by the radius.
    per: W,
    /// The greatest weight that is stored; infinity if weights are not clamped.
    most_weight: f64,
    /// The index of the first sphere's record; `lanes` is how many spheres of the packet have one.
    first: usize,
    lanes: usize,
}

impl<W: Lanes<Number = f64>> ShadedPacket<'_, W> {
    /// The weights of a light in each channel, where white is `white`.
    #[inline(always)]
    fn weights(&self, light: &TileLight<f64>, white: f64) -> [W; 3] {
        let radiance = [light.red, light.green, light.blue];
        [0, 1, 2].each(|channel| weight(self.colour[channel], radiance[channel], white, self.most_weight))
    }

    /// The index of the record of a light for the sphere in a lane.
    fn index(&self, lane: usize, light: usize) -> usize {
        (self.first + lane) * self.lights.len() + light
    }

    /// Makes the records of the short form. Returns a mask of the spheres for which that form is
    /// accurate enough, which depends on how far the terms of kn and ke cancel.
    #[inline(always)]
    fn put_shorts<E: Element>(&self, records: &mut SphereRecords<E>) -> W {
        let (all, one) = (W::all, W::of(1.0));
        let InFront { c, squared, k, ray, .. } = self.in_front;
        let step = all(self.view.step);
        let mut accurate = all(f64::mask(true));
        let length = squared.sqrt() + one;
        for (number, light) in self.lights.iter().enumerate() {
            let from_centre = to_light(light, self.centre, self.radius);
            let distance = dot_unfused(from_centre, from_centre).sqrt();
            let (gap, products) = (distance - one, distance * length);
            let l = [light.x, light.y, light.z].each(|x| all(x) / self.radius);
            let (kn, ke) = (k - dot_unfused(l, c), dot_unfused(l, l) - k);
            let loss = ((kn.abs() + products) / gap).max((ke.abs() + (products + products)) / (gap * gap));
            let [near, far, most] = SHORT.each(W::of);
            accurate = accurate.and(gap.greater(near)).and(far.greater(gap)).and(most.greater(loss));
            let q = from_centre.each(|x| x * self.per);
            let [red, green, blue] = self.weights(light, 255.0);
            let (q0, qx, qy) = (dot_unfused(q, ray), q[0] * step, (q[1] * step).negated());
            for lane in 0..self.lanes {
                let [q0, qx, qy, kn, ke, red, green, blue] =
                    [q0, qx, qy, kn, ke, red, green, blue].each(|x| x.lane(lane));
                records.shorts[self.index(lane, number)] = ShortLight { q0, qx, qy, kn, ke, red, green, blue }.round();
            }
        }
        accurate
    }

    /// Makes the records of the long form, from the position of each light relative to the centre.
    #[inline(always)]
    fn put_longs<E: Element>(&self, records: &mut SphereRecords<E>) {
        let far = W::all(self.view.far);
        for (number, light) in self.lights.iter().enumerate() {
            let from_centre = to_light(light, self.centre, self.radius);
            let distance = dot_unfused(from_centre, from_centre).sqrt();
            let is_far = distance.greater(far);
            let over = far / distance;
            let [x, y, z] = from_centre.each(|x| is_far.select(x * over, x));
            let [red, green, blue] = self.weights(light, self.view.white);
            for lane in 0..self.lanes {
                let [x, y, z, red, green, blue] = [x, y, z, red, green, blue].each(|x| x.lane(lane));
                records.lits[self.index(lane, number)] =
                    ObjectLight { x, y, z, cosine: 0.0, red, green, blue, padding: 0.0 }.round();
            }
        }
    }

    /// The first part of n / t along each axis, and its increments per column and per row.
    #[inline(always)]
    fn normals(&self) -> [[W; 3]; 3] {
        let InFront { c, k, ray, h, .. } = self.in_front;
        let (step, zero) = (W::all(self.view.step), W::of(0.0));
        let t = h.each(|h| h / k);
        [
            normal(c[0], t, [ray[0], step, zero], self.per),
            normal(c[1], t, [ray[1], zero, step], self.per),
            normal(c[2], t, [ray[2], zero, zero], self.per),
        ]
    }

    /// Makes the records of the spheres. Those in the mask `accurate` have the short form.
    #[inline(always)]
    fn put_spheres<E: Element>(&self, accurate: W, records: &mut SphereRecords<E>) {
        let InFront { c, d, origin, .. } = self.in_front;
        let normals = self.normals();
        let shorts = accurate.and(W::of(1.0));
        for lane in 0..self.lanes {
            let number = |x: W| x.lane(lane);
            let [[mx, mxx, mxy], [my, myx, myy], [mz, mzx, mzy]] = normals.each(|m| m.each(number));
            let ([d0, dx, dy, dxx, dxy, dyy], [ux, uy, uz]) = (d.each(number), c.each(number));
            let [column, row, short] = [origin[0], origin[1], shorts].each(number);
            records.spheres[self.first + lane] = TileSphere {
                column,
                row,
                d0,
                dx,
                dy,
                dxx,
                dxy,
                dyy,
                mx,
                mxx,
                mxy,
                my,
                myx,
                myy,
                mz,
                mzx,
                mzy,
                ux,
                uy,
                uz,
                short,
                ..TileSphere::ZERO
            }
            .round();
        }
    }
}

/// Makes the shading records of a chunk of spheres, from the index `first` on. If `short`, they
/// have the short form where that is accurate enough.
pub fn shading<W: Lanes<Number = f64>, E: Element>(
    view: &SphereView<f64>,
    spheres: SphereChunk<'_>,
    lights: &[TileLight<f64>],
    short: bool,
    first: usize,
    records: &mut SphereRecords<E>,
) {
    let mut of = SphereArrays::ZERO;
    // A weight beyond f32 is clamped: no kernel in f32 shades that sphere, but 0 times its weight
    // is added to its neighbours in the packet, and 0 times infinity would be NaN.
    let most_weight = if size_of::<E>() == size_of::<f32>() { f32::MAX.into() } else { f64::INFINITY };
    for at in (0..chunk::<W>(spheres, &mut of)).step_by(W::COUNT) {
        let CentresAndRadii { centre, radius } = centres_and_radii::<W>(&of, at);
        let packet = ShadedPacket {
            view,
            lights,
            centre,
            radius,
            in_front: InFront::new(view, centre, radius),
            colour: [&of.red, &of.green, &of.blue].each(|channel| W::load_bits(&channel[at..])),
            per: W::all(view.scale) / radius,
            most_weight,
            first: first + at,
            lanes: W::COUNT.min(spheres.candidates.len() - at),
        };
        let accurate = if short { packet.put_shorts(records) } else { W::all(f64::mask(false)) };
        if !(0..W::COUNT).all(|lane| accurate.lane(lane).is_set()) {
            packet.put_longs(records);
        }
        packet.put_spheres(accurate, records);
    }
}

/// The scaled 1/t, at some pixels, of the nearest wall of a sphere that contains the camera or is
/// beside it; 0 if the ray misses the sphere.
#[inline(always)]
pub fn around<W: Lanes<Number = f64>>(sphere: &AroundSphere<f64>, column: W, row: W) -> W {
    let AroundSphere { step, half_width, half_height, square, cx, cy, cz, .. } = *sphere;
    let (all, half, zero) = (W::all, W::of(0.5), W::of(0.0));
    let x = (column + half) * all(step) - all(half_width);
    let y = all(half_height) - (row + half) * all(step);
    let a = x * x + y * y + all(square);
    let h = x * all(cx) + y * all(cy) + all(sphere.along);
    let disc = if sphere.far == 0.0 {
        h * h - a * all(sphere.k)
    } else {
        let across =
            [all(sphere.cy_focal) - y * all(cz), x * all(cz) - all(sphere.cx_focal), y * all(cx) - x * all(cy)];
        a * all(sphere.r2) - dot_unfused(across, across)
    };
    let q = h + disc.sqrt().with_sign_of(h);
    let one = (q * all(sphere.over_k)).max(zero);
    let other = (a * all(sphere.scale) / q).max(zero);
    one.max(W::of(f64::INFINITY).greater(other).and(other))
}
