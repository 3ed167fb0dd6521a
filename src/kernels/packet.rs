//! The arguments of the packet kernels that render rows of pixels.

use std::ptr;

use super::kernel::{Callee, function, kinds, reads, writes};
use super::records::{Element, LIT_ROWS, LitRows, LitSetup, LitSphere};
use super::types::bytes;

/// Pixels of four bytes: red, green, blue, and 255.
pub type Rgba8 = [u8; 4];
/// Pixels of three bytes: red, green, blue.
pub type Rgb8 = [u8; 3];
/// Pixels of three floats: linear red, green, blue.
pub type F32x3 = [f32; 3];

// The references prove addresses and lengths. Kernels read records and lights, and only write what
// is passed as `&mut`, where any bits are valid.
kinds! {
    /// Finds the rows of a sphere under one light.
    RowSetup<E: Element> as fn(&LitSetup<f64>, u32, usize, &mut LitRows<E>);

    /// Sets the first `count` rows of `rows` to the picture's rows from `first` on.
    ///
    /// # Panics
    /// If `rows` has no room for them.
    fn call(setup: &LitSetup<f64>, first: u32, count: usize, rows: &mut LitRows<E>); |way| {
        assert!(count <= LIT_ROWS, "{count} rows do not fit");
        if count > 0 {
            // LIT_ROWS is a multiple of the lanes of every packet, so that there is room for the
            // last packet of rows.
            match way {
                Callee::Code(enter) => _ = enter([reads(setup), first.into(), count as u64, writes(rows), 0, 0]),
                Callee::Rust(find) => find(setup, first, count, rows),
            }
        }
    }

    /// Renders whole rows of a picture of one sphere under one light.
    ShadeRows<E: Element, P> as fn(&LitSphere<E>, &LitRows<E>, &mut [P], usize);

    /// Renders the rows of `out`, which have `width` pixels each, from as many of `rows`. If
    /// `streaming`, they are stored past the caches where that is possible.
    ///
    /// # Panics
    /// If `out` is not a whole number of rows, or has more than `rows`, or if a span exceeds its
    /// row.
    fn call(sphere: &LitSphere<E>, rows: &LitRows<E>, out: &mut [P], width: usize, streaming: bool); |way| {
        if !out.is_empty() {
            let count = out.len() / width;
            assert!(count <= LIT_ROWS && count * width == out.len(), "{} pixels are no rows of {width}", out.len());
            for row in 0..count {
                let (start, end) = (rows.start[row].to_f64(), rows.end[row].to_f64());
                let columns = 0.0..=width as f64;
                assert!(start >= 0.0 && columns.contains(&end), "columns {start} to {end} of {width}");
            }
            match way {
                Callee::Code(enter) => {
                    let call = |out| {
                        enter([reads(sphere), reads(rows), count as u64, out, width as u64, streaming.into()]);
                    };
                    // Rust does not align pixels of four bytes, which kernels write as 32-bit
                    // numbers.
                    if size_of::<P>() != 4 || out.as_ptr().cast::<u32>().is_aligned() {
                        call(writes(out));
                    } else {
                        let (mut numbers, to) = (vec![0_u32; out.len()], out.as_mut_ptr().cast());
                        call(writes(&mut *numbers));
                        // SAFETY: pixels of 32 bits, for which any bits are valid; both slices have
                        // as many.
                        unsafe { ptr::copy_nonoverlapping(bytes(&numbers).as_ptr(), to, 4 * numbers.len()) };
                    }
                }
                Callee::Rust(shade) => shade(sphere, rows, out, width),
            }
        }
    }

    /// Drops the fourth channel of pixels.
    Narrow<Four, Three> as fn(&[Four], &mut [Three]);

    /// Makes the pixels of `three` from the pixels of `four`.
    ///
    /// # Panics
    /// If they do not have the same number of pixels.
    fn call(four: &[Four], three: &mut [Three]); |way| {
        assert_eq!(four.len(), three.len(), "each pixel is made from one");
        if !three.is_empty() {
            match way {
                Callee::Code(enter) => _ = enter([reads(four), writes(three), three.len() as u64, 0, 0, 0]),
                Callee::Rust(narrow) => narrow(four, three),
            }
        }
    }
}
