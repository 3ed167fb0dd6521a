//! Whole rows of a picture of one sphere under one light: asm/tracers/lit_rows.asm and lit.asm.

use super::super::packet::{F32x3, Rgb8, Rgba8};
use super::super::records::{Element, LitRows, LitSetup, LitSphere};
use super::super::types::Vec4;
use super::lanes::{Lanes, Number};

/// A pixel of a picture.
pub trait Pixel: Copy {
    /// That of no light.
    const BLACK: Self;
    /// That of a colour.
    fn of<E: Number>(colour: [E; 3]) -> Self;

    /// Whether full light is 255.
    const LEVELS: bool;

    /// Makes pixels of the lanes from number `first` on: of as many as there are mostly at once.
    #[inline(always)]
    fn put<L: Lanes>(pixels: &mut [Self], colour: [L; 3], first: usize, mostly: usize) {
        let pixel = |i: usize| Self::of(colour.map(|channel| channel.lane(first + i)));
        if pixels.len() == mostly {
            (0..mostly).for_each(|i| pixels[i] = pixel(i));
        } else {
            pixels.iter_mut().enumerate().for_each(|(i, to)| *to = pixel(i));
        }
    }
}

impl Pixel for Vec4 {
    const BLACK: Self = Vec4 { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };
    const LEVELS: bool = false;
    #[inline(always)]
    fn of<E: Number>([red, green, blue]: [E; 3]) -> Self {
        Vec4 { x: red.to_float(), y: green.to_float(), z: blue.to_float(), w: 0.0 }
    }
}

impl Pixel for F32x3 {
    const BLACK: Self = [0.0; 3];
    const LEVELS: bool = false;
    #[inline(always)]
    fn of<E: Number>(colour: [E; 3]) -> Self {
        colour.map(E::to_float)
    }
}

impl Pixel for Rgba8 {
    const BLACK: Self = [0, 0, 0, 255];
    const LEVELS: bool = true;
    #[inline(always)]
    fn of<E: Number>([red, green, blue]: [E; 3]) -> Self {
        [red.to_level(), green.to_level(), blue.to_level(), 255]
    }
}

impl Pixel for Rgb8 {
    const BLACK: Self = [0; 3];
    const LEVELS: bool = true;
    #[inline(always)]
    fn of<E: Number>(colour: [E; 3]) -> Self {
        colour.map(E::to_level)
    }
}

/// The rows from number `first` on.
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
        // NaN where the row misses the sphere.
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

/// The pixels of rows.
pub fn shade_rows<L: Lanes, P: Pixel>(
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
        let mut j = L::all(rows.j[row]) + L::natural();
        let [m, a, h0, q0] = [rows.m[row], rows.a[row], rows.h0[row], rows.q0[row]].map(L::all);
        for pixels in out[start..end].chunks_mut(L::COUNT) {
            let light = sphere_lit(sphere, [m, a, h0, q0], j);
            let colour = [sphere.red, sphere.green, sphere.blue].map(|weight| light * L::all(weight));
            P::put(pixels, colour, 0, L::COUNT);
            j = j + L::of(L::COUNT as f64);
        }
    }
}

/// SPHERE_LIT of a packet with an end of the span in it: inside of one p is above 0.
#[inline(always)]
fn sphere_lit<L: Lanes>(sphere: &LitSphere<L::Number>, [m, a, h0, q0]: [L; 4], j: L) -> L {
    let u = j - m;
    let root = a.fnma(u, u).max(L::of(0.0)).sqrt();
    let den = h0.fma(j, L::all(sphere.h1)) + root;
    let n = q0.fma(j, L::all(sphere.q1)).fma(root, L::all(sphere.kn));
    let e = den.fms(L::all(sphere.ke), n) * den;
    (n / e.sqrt()).max(L::of(0.0))
}
