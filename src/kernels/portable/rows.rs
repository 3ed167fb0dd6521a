//! Renders whole rows of a picture of one sphere under one light: asm/tracers/lit_rows.asm and
//! lit.asm.

use super::super::packet::{F32x3, Rgb8, Rgba8};
use super::super::records::{Element, LitRows, LitSetup, LitSphere, MOST_LANES};
use super::super::types::Vec4;
use super::lanes::{Each, Lanes, Number};

pub trait Pixel: Copy {
    /// The pixel that no light reaches.
    const BLACK: Self;
    /// Whether white is 255 and not 1.
    const LEVELS: bool;

    /// Stores a pixel for each lane, from the index `first` on.
    fn put<L: Lanes>(to: &mut [Self], colour: [L; 3], first: usize);

    /// Stores the pixels of a span from the index `first` on.
    #[inline(always)]
    fn span<L: Lanes, const GREY: bool>(of: &Span<'_, L, GREY>, first: usize, to: &mut [Self]) {
        let mut j = L::all(of.j) + L::of(first as f64) + L::natural();
        let mut packets = to.chunks_exact_mut(L::COUNT);
        for pixels in &mut packets {
            Self::put(pixels, of.colour(j), 0);
            j = j + L::of(L::COUNT as f64);
        }
        Self::put_some(packets.into_remainder(), of.colour(j), 0, L::COUNT);
    }

    /// Stores the pixels of the first `lanes` lanes, or as many as `to` has room for.
    #[inline(always)]
    fn put_some<L: Lanes>(to: &mut [Self], colour: [L; 3], first: usize, lanes: usize) {
        if to.len() == lanes {
            return Self::put(&mut to[..lanes], colour, first);
        }
        let mut all = [Self::BLACK; MOST_LANES];
        Self::put(&mut all[..lanes], colour, first);
        to.copy_from_slice(&all[..to.len()]);
    }
}

impl Pixel for Vec4 {
    const BLACK: Self = Vec4 { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };
    const LEVELS: bool = false;
    #[inline(always)]
    fn put<L: Lanes>(to: &mut [Self], colour: [L; 3], first: usize) {
        for (i, to) in to.iter_mut().enumerate() {
            let [x, y, z] = colour.each(|channel| channel.lane(first + i).to_float());
            *to = Vec4 { x, y, z, w: 0.0 };
        }
    }
}

impl Pixel for Rgba8 {
    const BLACK: Self = [0, 0, 0, 255];
    const LEVELS: bool = true;
    #[inline(always)]
    fn put<L: Lanes>(to: &mut [Self], colour: [L; 3], first: usize) {
        // One channel after the other, each as 32-bit numbers.
        let [red, green, blue] = colour.each(|channel| {
            let mut levels = [0; MOST_LANES];
            for (i, level) in levels[..to.len()].iter_mut().enumerate() {
                *level = channel.lane(first + i).to_level();
            }
            levels
        });
        for (i, to) in to.iter_mut().enumerate() {
            *to = (red[i] | green[i] << 8 | blue[i] << 16 | 255 << 24).to_le_bytes();
        }
    }
}

/// The lower three bytes of each of four numbers, whose highest byte is 0.
#[inline(always)]
fn side_by_side([a, b, c, d]: [u32; 4]) -> [Rgb8; 4] {
    let words = [a | b << 24, b >> 8 | c << 16, c >> 16 | d << 8];
    let mut pixels = [[0; 3]; 4];
    pixels.as_flattened_mut().copy_from_slice(words.each(u32::to_le_bytes).as_flattened());
    pixels
}

/// Drops the fourth channel of pixels of bytes.
pub fn narrow_rgb8(four: &[Rgba8], three: &mut [Rgb8]) {
    let ((fours, rest), (threes, others)) = (four.as_chunks::<4>(), three.as_chunks_mut::<4>());
    for (four, three) in fours.iter().zip(threes) {
        *three = side_by_side((*four).each(|pixel| u32::from_le_bytes(pixel) & 0xff_ffff));
    }
    rest.iter().zip(others).for_each(|([red, green, blue, _], to)| *to = [*red, *green, *blue]);
}

/// Drops the fourth channel of pixels of floats.
pub fn narrow_f32x3(four: &[Vec4], three: &mut [F32x3]) {
    four.iter().zip(three).for_each(|(four, three)| *three = [four.x, four.y, four.z]);
}

/// Finds the columns that a lit sphere covers in `count` rows of the picture, from row `first` on.
pub fn lit_rows<W: Lanes<Number = f64>, E: Element>(
    setup: &LitSetup<f64>,
    first: u32,
    count: usize,
    rows: &mut LitRows<E>,
) {
    let (all, half) = (W::all, W::of(0.5));
    let LitSetup { step, half_width, half_height, columns, width, cx, cy, cz, .. } = *setup;
    for at in (0..count).step_by(W::COUNT) {
        let row = W::of(first.into()) + W::of(at as f64) + W::natural();
        let y = all(half_height) - (row + half) * all(step);
        let g = y * y + all(setup.zz);
        let across = all(setup.cyz) - y * all(cz);
        let squared = across * across;
        // NaN in rows that miss the sphere.
        let root = ((g - squared) * all(setup.k)).sqrt();
        let h = y * all(cy) + all(setup.czz);
        let b = h * all(cx);
        let q = root.with_sign_of(b) + b;
        let p = (g * all(setup.nx) - squared) / q;
        let p = q.equal(W::of(0.0)).select(W::of(0.0), p);
        let (one, other) = (q / all(setup.m), W::of(0.0) - p);
        let (left, right) = (one.min(other), other.max(one));
        let middle = (left + right) * half;
        let in_front = (middle * all(cx) + h).greater(W::of(0.0));
        let column = |x: W| (x + all(half_width)) * all(columns) - half;
        let inside = |x: W| x.max(W::of(0.0)).min(all(width));
        let start = inside(column(left).ceil());
        let end = inside(column(right).floor() + W::of(1.0)).and(in_front);
        let origin = ((start + end) * half).floor();
        let x = (origin + half) * all(step) - all(half_width);
        let a = (right - left) * half * all(columns);
        start.store(&mut rows.start[at..]);
        end.store(&mut rows.end[at..]);
        (start - origin).store(&mut rows.j[at..]);
        (end - origin).store(&mut rows.stop[at..]);
        ((middle - x) * all(columns)).store(&mut rows.m[at..]);
        (a * a).store(&mut rows.a[at..]);
        ((x * all(cx) + h) * all(setup.h)).store(&mut rows.h0[at..]);
        ((x * all(setup.vx) + y * all(setup.vy) + all(setup.vzz)) * all(setup.q)).store(&mut rows.q0[at..]);
    }
}

/// Renders rows of pixels; the light's three weights are equal if `GREY`. It is inlined so that it
/// uses the instructions that its caller may use.
#[inline(always)]
pub fn shade_rows<L: Lanes, P: Pixel, const GREY: bool>(
    sphere: &LitSphere<L::Number>,
    rows: &LitRows<L::Number>,
    out: &mut [P],
    width: usize,
) {
    for (row, out) in out.chunks_exact_mut(width).enumerate() {
        let start = (rows.start[row].to_f64() as usize).min(width);
        let end = (rows.end[row].to_f64() as usize).max(start);
        out[..start].fill(P::BLACK);
        out[end..].fill(P::BLACK);
        let [m, a, h0, q0] = [rows.m[row], rows.a[row], rows.h0[row], rows.q0[row]].each(L::all);
        P::span(&Span::<L, GREY> { sphere, j: rows.j[row], m, a, h0, q0 }, 0, &mut out[start..end]);
    }
}

/// Consecutive pixels of a row whose rays meet the sphere, with the row's constants from
/// [`LitRows`].
pub struct Span<'a, L: Lanes, const GREY: bool> {
    pub sphere: &'a LitSphere<L::Number>,
    /// The column of the first pixel, counted from the sphere's own origin.
    pub j: L::Number,
    pub m: L,
    pub a: L,
    pub h0: L,
    pub q0: L,
}

impl<L: Lanes, const GREY: bool> Span<'_, L, GREY> {
    /// The colours of the pixels in columns j.
    #[inline(always)]
    fn colour(&self, j: L) -> [L; 3] {
        let light = self.light(j);
        if GREY {
            return [light; 3];
        }
        [self.sphere.red, self.sphere.green, self.sphere.blue].each(|weight| light * L::all(weight))
    }

    /// SPHERE_LIT for a packet that contains an end of the span. Where the whole packet is within
    /// the span, the discriminant p is above 0.
    #[inline(always)]
    pub fn light(&self, j: L) -> L {
        let LitSphere { h1, q1, kn, ke, .. } = *self.sphere;
        let u = j - self.m;
        let root = self.a.fnma(u, u).max(L::of(0.0)).sqrt();
        let den = self.h0.fma(j, L::all(h1)) + root;
        let n = self.q0.fma(j, L::all(q1)).fma(root, L::all(kn));
        let e = den.fms(L::all(ke), n) * den;
        (n / e.sqrt()).max(L::of(0.0))
    }
}
