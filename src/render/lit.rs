//! The engines of packets on one sphere under one light: whole rows in closed form.

use std::ops::Range;
use std::sync::OnceLock;

use super::film::with_pixels;
use super::tiles::{Interleaved, TileTracer};
use super::{Counted, FilmMut, Found, Pixel, PixelFormat, Purpose, Tracer, Wanted, existing};
use crate::kernels::{
    Element, ElementKernels, F32x3, LIT_ROWS, LitBodies, LitRows, PacketKernels, Rgb8, Rgba8, ShadeRows, Vec4, sys,
};
use crate::measure::caches;
use crate::plan::{Keep, LitForm, Raster, Report, Scale};
use crate::scene::Scene;

/// Whether a picture of this many pixels is stored past the caches, because it does not fit into its share of them.
///
/// The share of floats is an eighth of the third level, since other cores have theirs, and so do other machines on the
/// same chip; and at most 16 MiB, which is also the limit if the level does not exist or is unknown. Bytes are stored
/// as fast as they are made until the level is full, or 32 MiB of a larger, shared one: docs/performance.md.
fn is_past_caches(pixels: u64, format: PixelFormat) -> bool {
    const MOST: u64 = 16 << 20;
    const MOST_OF_BYTES: u64 = 2 * MOST;
    static THIRD_LEVEL: OnceLock<Option<u64>> = OnceLock::new();
    let third = *THIRD_LEVEL
        .get_or_init(|| caches().into_iter().find(|cache| cache.level == 3).map(|cache| cache.bytes as u64));
    let most =
        third.map_or(MOST, |bytes| if format.is_8bit() { MOST_OF_BYTES.min(bytes) } else { MOST.min(bytes / 8) });
    // Packets of three bytes are never aligned.
    format != PixelFormat::Rgb8 && pixels * format.bytes() as u64 > most
}

/// The pixels of a sphere that one thread has made before another one has the memory for its own.
const QUICK: u64 = 1 << 22;

/// A scene of one sphere under one light, and the kernels that make its rows.
pub struct LitTracer<'a, E: Element> {
    packets: &'static PacketKernels,
    kernels: &'static ElementKernels<E>,
    /// Whether shades may come from estimates in floats too.
    fast: bool,
    scene: &'a Scene,
    form: LitForm,
    /// The number of pixels of the film.
    pixels: u64,
}

impl<'a, E: Element> LitTracer<'a, E> {
    /// Plans `scene`, whose numbers are valid, for `kernels` of one element type, with estimates if `fast`. None if it
    /// is for tiles.
    pub fn new(
        packets: &'static PacketKernels,
        (kernels, fast): (&'static ElementKernels<E>, bool),
        scene: &'a Scene,
        purpose: Purpose,
    ) -> Option<Self> {
        let form = LitForm::of::<E>(scene, purpose.keep)?;
        let pixels = if purpose.in_bands { 0 } else { scene.camera.pixels() };
        Some(LitTracer { packets, kernels, fast, scene, form, pixels })
    }

    /// Pixels in a row.
    fn width(&self) -> usize {
        self.scene.camera.width() as usize
    }

    /// Calls `say` for some of `rows` at a time: with the first of them, their number, and their spans of the sphere.
    fn each_rows(&self, rows: Range<u32>, scale: Scale, mut say: impl FnMut(u32, usize, &LitRows<E>)) {
        let mut lit_rows: LitRows<E> = crate::kernels::Plain::ZERO;
        for first in rows.clone().step_by(LIT_ROWS) {
            let count = ((rows.end - first) as usize).min(LIT_ROWS);
            self.kernels.lit_rows.call(self.form.setup(scale), first, count, &mut lit_rows);
            say(first, count, &lit_rows);
        }
    }

    /// Calls `say` for each of `rows` with the columns that see the sphere.
    fn each_span(&self, rows: Range<u32>, mut say: impl FnMut(u32, Range<usize>)) {
        self.each_rows(rows, Scale::Linear, |first, count, lit_rows| {
            for i in 0..count {
                let [start, end] = [lit_rows.start[i], lit_rows.end[i]].map(|column| column.to_f64() as usize);
                say(first + i as u32, start..end.max(start));
            }
        });
    }

    fn trace<P: Output<E>>(&self, rows: Range<u32>, out: &mut [P], streaming: bool) {
        assert_eq!(out.len(), rows.len() * self.width(), "the film must have the size of the rows");
        let kernel = P::kernel(if self.form.makes_grey() { &self.kernels.grey } else { &self.kernels.lit }, self.fast);
        let (sphere, width, start) = (self.form.sphere(P::SCALE).round(), self.width(), rows.start);
        self.each_rows(rows, P::SCALE, |first, count, lit_rows| {
            let out = &mut out[(first - start) as usize * width..][..count * width];
            kernel.call(&sphere, lit_rows, out, width, streaming);
        });
    }
}

/// The differences between the outputs.
trait Output<E: Element>: Pixel {
    /// The value of full light.
    const SCALE: Scale;
    /// The kernel that makes rows, with estimates if `fast`.
    fn kernel(bodies: &LitBodies<E>, fast: bool) -> &ShadeRows<E, Self>;
}

macro_rules! outputs {
    ($($pixel:ty, $scale:ident, $exact:ident, $fast:ident;)*) => {$(
        impl<E: Element> Output<E> for $pixel {
            const SCALE: Scale = Scale::$scale;

            fn kernel(bodies: &LitBodies<E>, fast: bool) -> &ShadeRows<E, Self> {
                if fast { &bodies.$fast } else { &bodies.$exact }
            }
        }
    )*};
}

// Bytes have estimates wherever these are accurate enough.
outputs! {
    Vec4, Linear, f32x4, f32x4_fast;
    F32x3, Linear, f32x3, f32x3_fast;
    Rgba8, Levels, rgba8, rgba8;
    Rgb8, Levels, rgb8, rgb8;
}

impl<E: Element> Tracer for LitTracer<'_, E> {
    fn report(&self, bytes: bool) -> Option<Report> {
        let hits = self.count(0..self.scene.camera.height()).hits;
        Some(Report::of_lit(self.scene, &self.form, hits, bytes))
    }

    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn is_quick(&self) -> bool {
        self.scene.camera.pixels() <= QUICK
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        let streaming = is_past_caches(self.pixels, out.format());
        with_pixels!(FilmMut(out) = out => self.trace(rows, out, streaming));
        if streaming {
            sys::store_fence();
        }
    }

    fn light(&self, rows: Range<u32>, _: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        self.rows(rows.clone(), FilmMut::F32x4(out));
        if background != Vec4::default() {
            let (width, first) = (self.width(), rows.start);
            self.each_span(rows, |row, span| {
                let out = &mut out[(row - first) as usize * width..][..width];
                out[..span.start].fill(background);
                out[span.end..].fill(background);
            });
        }
        None
    }

    /// The form has neither t nor a normal: tiles provide them.
    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let planning = (Keep::NOTHING, 1);
        let by_tiles = |raster| TileTracer::new(self.packets, (self.kernels, false), (self.scene, raster), planning);
        let parts = Raster::of(&self.scene.camera).into_iter().map(by_tiles).collect();
        Interleaved::new(&self.scene.camera, parts).hits(rows)
    }

    fn count(&self, rows: Range<u32>) -> Counted {
        let rows = existing(rows, self.scene.camera.height());
        let rays = (rows.len() * self.width()) as u64;
        let mut hits = 0;
        self.each_span(rows, |_, span| hits += span.len() as u64);
        Counted { rays, hits }
    }
}
