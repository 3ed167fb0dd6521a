//! What the packet kernels of spans take: records of spans and lights, rows of pixels, and rows of buffers.

use std::ops::Range;

use super::kernel::{kinds, reads, writes};
use super::records::{Element, LIT_ROWS, LitRows, LitSetup, LitSphere, MOST_LANES, ObjectLight};
use super::types::{Plain, Vec4};

/// Pixels of four bytes: red, green, blue, and 255.
pub type Rgba8 = [u8; 4];
/// Pixels of three bytes: red, green, blue.
pub type Rgb8 = [u8; 3];
/// Pixels of three floats: linear red, green, blue.
pub type F32x3 = [f32; 3];

// The references prove addresses and lengths; kernels read records and lights and write what is handed to them as `&mut`
// alone, of which any bits are values.
kinds! {
    /// Shades a span: `S` is its record, `P` the pixels it makes.
    Shade<S, E, P>

    /// Writes the span's pixels to `out`, which has exactly as many. `streaming`: past the cache, where the output can and
    /// is aligned to 4 bytes.
    fn call(span: &S, lits: &[ObjectLight<E>], out: &mut [P], streaming: bool); |enter| {
        if !out.is_empty() {
            let streaming = streaming && is_aligned(out);
            let pixels = out.len() as u64;
            enter([reads(span), reads(lits), lits.len() as u64, writes(out), pixels, streaming.into()]);
        }
    }

    /// Shades, of a span in a row of buffers, the pixels that are its own.
    Planes<S, E: Element>

    /// Shades the pixels `span_x` of the row that carry the span's id.
    fn call(span: &S, lits: &[ObjectLight<E>], row: &mut Row<E>, span_x: Range<usize>); |enter| {
        if !span_x.is_empty() {
            let [first, pixels, stride] = row.part(span_x);
            enter([reads(span), reads(lits), lits.len() as u64, first, pixels, stride]);
        }
    }

    /// The same for the first row of a sphere under one light.
    LitPlanes<E: Element>

    /// Shades the pixels `span_x` of the row that carry the id of the first of `rows`.
    fn call(sphere: &LitSphere<E>, rows: &LitRows<E>, row: &mut Row<E>, span_x: Range<usize>); |enter| {
        if !span_x.is_empty() {
            let [first, pixels, stride] = row.part(span_x);
            enter([reads(sphere), reads(rows), 0, first, pixels, stride]);
        }
    }

    /// Makes a span's pixels in a row of buffers its own where it is nearest.
    Depth<S, E: Element>

    /// Makes those of the pixels `span_x` of the row the span's own that have nothing as near.
    fn call(span: &S, row: &mut Row<E>, span_x: Range<usize>); |enter| {
        if !span_x.is_empty() {
            let [first, pixels, stride] = row.part(span_x);
            enter([reads(span), first, pixels, stride, 0, 0]);
        }
    }

    /// Finds the rows of a sphere under one light.
    RowSetup<E: Element>

    /// Sets the first `count` of `rows`, which are the picture's rows from `first` on.
    ///
    /// # Panics
    /// Where there is no room for as many.
    fn call(setup: &LitSetup<f64>, first: u32, count: usize, rows: &mut LitRows<E>); |enter| {
        assert!(count <= LIT_ROWS, "{count} rows do not fit");
        if count > 0 {
            // LIT_ROWS is a multiple of every packet's lanes, so that there is room for the last packet of rows.
            enter([reads(setup), first.into(), count as u64, writes(rows), 0, 0]);
        }
    }

    /// Makes whole rows of a picture in which there is one sphere under one light.
    ShadeRows<E: Element, P>

    /// Makes the rows of `out`, each `width` pixels, from as many of `rows`. `streaming`: past the cache, where the
    /// output can.
    ///
    /// # Panics
    /// Where `out` is of numbers of 32 bits and not aligned to these, has no whole number of rows or more than there are,
    /// or where one of the spans does not lie in its row.
    fn call(sphere: &LitSphere<E>, rows: &LitRows<E>, out: &mut [P], width: usize, streaming: bool); |enter| {
        if !out.is_empty() {
            assert!(is_aligned(out), "pixels must be aligned to 4 bytes");
            let count = out.len() / width;
            assert!(count <= LIT_ROWS && count * width == out.len(), "{} pixels are no rows of {width}", out.len());
            for row in 0..count {
                let (start, end) = (rows.start[row].to_f64(), rows.end[row].to_f64());
                let columns = 0.0..=width as f64;
                assert!(start >= 0.0 && columns.contains(&end), "columns {start} to {end} of {width}");
            }
            enter([reads(sphere), reads(rows), count as u64, writes(out), width as u64, streaming.into()]);
        }
    }

    /// Writes a row of buffers out.
    Emit<E: Element, P>

    /// Writes the pixels of the row from `start` on to `out`, as many as there are.
    fn call(row: &mut Row<E>, start: usize, out: &mut [P]); |enter| {
        if !out.is_empty() {
            let [first, pixels, stride] = row.part(start..start.saturating_add(out.len()));
            enter([first, stride, writes(out), pixels, 0, 0]);
        }
    }

    /// Leaves out the fourth channel.
    Narrow<Four, Three>

    /// Makes the pixels of `three` from those of `four`.
    ///
    /// # Panics
    /// Where these are not as many.
    fn call(four: &[Four], three: &mut [Three]); |enter| {
        assert_eq!(four.len(), three.len(), "each pixel is made from one");
        if !three.is_empty() {
            enter([reads(four), writes(three), three.len() as u64, 0, 0, 0]);
        }
    }

    /// Writes one pattern over many pixels.
    Fill

    /// Writes `pattern` to all of `out`. `streaming`: past the cache.
    fn call(out: &mut [u32], pattern: u32, streaming: bool); |enter| {
        if !out.is_empty() {
            enter([writes(out), out.len() as u64, pattern.into(), streaming.into(), 0, 0]);
        }
    }
}

/// Whether pixels of numbers of 32 bits are aligned to these, as all other pixels are.
fn is_aligned<P>(out: &[P]) -> bool {
    !size_of::<P>().is_multiple_of(4) || out.as_ptr().cast::<u32>().is_aligned()
}

impl Fill {
    /// Black floats. `streaming`: past the cache.
    pub fn f32x4(&self, out: &mut [Vec4], streaming: bool) {
        self.fill(out, Vec4::ZERO, 0, streaming);
    }

    /// Black floats. `streaming`: past the cache.
    pub fn f32x3(&self, out: &mut [F32x3], streaming: bool) {
        self.fill(out, F32x3::ZERO, 0, streaming);
    }

    /// Black levels. `streaming`: past the cache.
    pub fn rgba8(&self, out: &mut [Rgba8], streaming: bool) {
        let black = [0, 0, 0, 255];
        self.fill(out, black, u32::from_le_bytes(black), streaming);
    }

    /// Black levels. `streaming`: past the cache.
    pub fn rgb8(&self, out: &mut [Rgb8], streaming: bool) {
        self.fill(out.as_flattened_mut(), 0, 0, streaming);
    }

    /// Fills `out` with a value, of which `pattern` is made.
    fn fill<T: Plain>(&self, out: &mut [T], value: T, pattern: u32, streaming: bool) {
        // SAFETY: any bits are numbers of 32 bits, and any of these are a Plain type.
        let (before, numbers, after) = unsafe { out.align_to_mut() };
        // All of it, where no value begins at a number.
        before.fill(value);
        self.call(numbers, pattern, streaming);
        after.fill(value);
    }
}

/// A row of buffers: for each pixel who is nearest (0 for nobody), its colour and its 1/t. It stays in cache.
#[derive(Clone, Debug)]
pub struct Row<E> {
    elements: Vec<E>,
    /// Elements from one plane to the next: the width, and room for a whole packet past its end.
    stride: usize,
}

impl<E: Element> Row<E> {
    /// For `width` pixels.
    pub fn new(width: usize) -> Self {
        let stride = width.checked_add(MOST_LANES).and_then(|width| width.checked_next_multiple_of(MOST_LANES));
        let elements = stride.and_then(|stride| stride.checked_mul(5));
        let (stride, elements) = stride.zip(elements).expect("a row that memory can hold");
        Row { elements: vec![E::ZERO; elements], stride }
    }

    /// Forgets the pixels of `x`: nobody, black, infinitely far.
    pub fn clear(&mut self, x: Range<usize>) {
        for plane in self.elements.chunks_exact_mut(self.stride) {
            plane[x.clone()].fill(E::ZERO);
        }
    }

    /// A plane: 0 who, 1 to 3 red, green and blue, 4 1/t.
    pub fn plane(&self, plane: usize) -> &[E] {
        &self.elements[plane * self.stride..][..self.stride]
    }

    /// Where the first of the pixels `x` is, how many there are, and the bytes from plane to plane: for kernels, which touch five
    /// planes from there, each up to a packet past the last pixel.
    fn part(&mut self, x: Range<usize>) -> [u64; 3] {
        assert!(x.end <= self.stride - MOST_LANES, "the pixels must be in the row");
        [writes(&mut self.elements[x.start..]), x.len() as u64, (self.stride * size_of::<E>()) as u64]
    }
}
