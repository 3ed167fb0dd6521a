//! Packet engines on one sphere under one light: they render whole rows in closed form.

use std::ops::Range;
use std::sync::OnceLock;

use super::film::{narrow, rgba_to_bgra};
use super::plan::PacketKernelSet;
use super::tiles::TileTracer;
use super::{Counted, FilmMut, Found, Pixel, PixelFormat, Purpose, Tracer, Wanted, assert_rows, existing};
use crate::kernels::caches;
use crate::kernels::{Element, LIT_ROWS, LitBodies, LitRow, LitRows, LitSphere, Plain, Rgba8, ShadeRows, Vec4, sys};
use crate::plan::{LitForm, PlanOptions, Report, Scale};
use crate::scene::Scene;

/// Whether a picture of this many pixels is stored with non-temporal stores, which bypass the
/// caches, because it would not fit into its share of them.
///
/// For floats this share is an eighth of the third-level cache, which other cores, and other
/// virtual machines on the chip, use too, and at most 16 MiB; without such a cache, or if its size
/// is unknown, it is 16 MiB. For bytes it is the whole cache, and at most 32 MiB: up to that size
/// they are stored as fast as they are computed (docs/performance.md).
fn is_past_caches(pixels: u64, format: PixelFormat) -> bool {
    const MOST: u64 = 16 << 20;
    const MOST_OF_BYTES: u64 = 2 * MOST;
    static THIRD_LEVEL: OnceLock<Option<u64>> = OnceLock::new();
    let third = *THIRD_LEVEL
        .get_or_init(|| caches().into_iter().find(|cache| cache.level == 3).map(|cache| cache.bytes as u64));
    let most =
        third.map_or(MOST, |bytes| if format.is_8bit() { MOST_OF_BYTES.min(bytes) } else { MOST.min(bytes / 8) });
    // Pixels of three channels are converted from four, so that they are never stored this way.
    matches!(format, PixelFormat::F32x4 | PixelFormat::Rgba8) && pixels * format.bytes() as u64 > most
}

/// For a sphere, one thread finishes a picture of up to this many pixels before the memory for
/// another thread's part would be ready.
const QUICK: u64 = 1 << 22;

/// A scene of one sphere under one light, and the kernels that make its rows.
pub struct LitTracer<'a, E: Element> {
    kernels: PacketKernelSet<E>,
    scene: &'a Scene,
    form: LitForm,
    /// The number of pixels of the film, which decides whether it is stored past the caches.
    pixels: u64,
}

impl<'a, E: Element> LitTracer<'a, E> {
    /// Plans `scene`, whose numbers must be valid, for these kernels. None if the scene has no
    /// closed form and has to be traced in tiles.
    pub fn new(kernels: PacketKernelSet<E>, scene: &'a Scene, purpose: Purpose<'_>) -> Option<Self> {
        let form = LitForm::of::<E>(scene, purpose.keep)?;
        let pixels = if purpose.in_bands { 0 } else { scene.camera.pixels() };
        Some(LitTracer { kernels, scene, form, pixels })
    }

    /// Pixels in a row.
    fn width(&self) -> usize {
        self.scene.camera.width() as usize
    }

    /// Calls `report` for a few of `rows` at a time: with the first of them, their number, and the
    /// sphere's spans in them.
    fn each_rows(&self, rows: Range<u32>, scale: Scale, mut report: impl FnMut(u32, usize, &LitRows<E>)) {
        let mut lit_rows: LitRows<E> = Plain::ZERO;
        for first in rows.clone().step_by(LIT_ROWS) {
            let count = ((rows.end - first) as usize).min(LIT_ROWS);
            self.kernels.element.lit_rows.call(self.form.setup(scale), first, count, &mut lit_rows);
            report(first, count, &lit_rows);
        }
    }

    /// Calls `report` for each of `rows` with the columns whose rays hit the sphere.
    fn each_span(&self, rows: Range<u32>, mut report: impl FnMut(u32, Range<usize>)) {
        self.each_rows(rows, Scale::Linear, |first, count, lit_rows| {
            (0..count).for_each(|row| report(first + row as u32, span_of(lit_rows, row)));
        });
    }

    /// The kernel that writes an output.
    fn kernel<P: Output<E>>(&self) -> &'static ShadeRows<E, P> {
        let bodies = if self.form.makes_grey() { &self.kernels.element.grey } else { &self.kernels.element.lit };
        P::kernel(bodies, self.kernels.estimates)
    }

    /// The sphere, as the kernel of an output takes it.
    fn sphere<P: Output<E>>(&self) -> LitSphere<E> {
        self.form.sphere(P::SCALE).round()
    }

    fn trace<P: Output<E>>(&self, rows: Range<u32>, out: &mut [P], streaming: bool) {
        let kernel = self.kernel::<P>();
        let sphere = self.sphere::<P>();
        let width = self.width();
        let start = rows.start;
        self.each_rows(rows, P::SCALE, |first, count, lit_rows| {
            let out = &mut out[(first - start) as usize * width..][..count * width];
            kernel.call(&sphere, lit_rows, out, width, streaming);
        });
    }

    /// Traces the span of each row in four channels, and converts its pixels by `convert`.
    fn trace_others<Four: Output<E>, P: Pixel>(
        &self,
        rows: Range<u32>,
        out: &mut [P],
        convert: impl Fn(&[Four], &mut [P]),
    ) {
        let kernel = self.kernel::<Four>();
        let sphere = self.sphere::<Four>();
        let width = self.width();
        let black = P::of_linear(&Vec4::ZERO);
        let (mut four, mut one, mut out) = (vec![Four::ZERO; width], LitRows::ZERO, out.chunks_mut(width));
        self.each_rows(rows, Four::SCALE, |_, count, lit_rows| {
            for (row, out) in (0..count).zip(&mut out) {
                let span = span_of(lit_rows, row);
                let end = E::from_f64(span.len() as f64);
                one.set_row(0, &LitRow { start: E::default(), end, ..lit_rows.row(row) });
                kernel.call(&sphere, &one, &mut four[..span.len()], span.len(), false);
                out[..span.start].fill(black);
                out[span.end..].fill(black);
                convert(&four[..span.len()], &mut out[span]);
            }
        });
    }
}

/// The columns of a row whose rays hit the sphere.
fn span_of<E: Element>(lit_rows: &LitRows<E>, row: usize) -> Range<usize> {
    let [start, end] = [lit_rows.start[row], lit_rows.end[row]].map(|column| column.to_f64() as usize);
    start..end.max(start)
}

/// An output of four channels, floats or bytes. Pixels of other formats are converted from one of
/// the two.
trait Output<E: Element>: Pixel + Plain {
    /// What white is in a channel: 1 in floats, 255 in bytes.
    const SCALE: Scale;
    /// The kernel that renders rows; with estimates of roots if `fast`.
    fn kernel(bodies: &LitBodies<E>, fast: bool) -> &ShadeRows<E, Self>;
}

impl<E: Element> Output<E> for Vec4 {
    const SCALE: Scale = Scale::Linear;
    fn kernel(bodies: &LitBodies<E>, fast: bool) -> &ShadeRows<E, Self> {
        if fast { &bodies.f32x4_fast } else { &bodies.f32x4 }
    }
}

impl<E: Element> Output<E> for Rgba8 {
    const SCALE: Scale = Scale::Levels;
    /// For bytes, estimates of roots are always accurate enough.
    fn kernel(bodies: &LitBodies<E>, _: bool) -> &ShadeRows<E, Self> {
        &bodies.rgba8
    }
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
        assert_rows(&rows, [self.scene.camera.width(), self.scene.camera.height()], out.len());
        match out {
            FilmMut::F32x4(out) => self.trace(rows, out, streaming),
            FilmMut::F32x3(out) => self.trace_others(rows, out, narrow(&self.kernels.packets.narrow_f32x3)),
            FilmMut::Rgba8(out) => self.trace(rows, out, streaming),
            FilmMut::Rgb8(out) => self.trace_others(rows, out, narrow(&self.kernels.packets.narrow_rgb8)),
            FilmMut::Bgra8(out) => self.trace_others(rows, out, rgba_to_bgra),
        }
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

    /// The closed form computes neither t nor normals, so that hits come from tracing in tiles.
    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let kernels = PacketKernelSet { estimates: false, ..self.kernels };
        TileTracer::new(kernels, self.scene, PlanOptions::default()).hits(rows)
    }

    fn count(&self, rows: Range<u32>) -> Counted {
        let rows = existing(rows, self.scene.camera.height());
        let rays = (rows.len() * self.width()) as u64;
        let mut hits = 0;
        self.each_span(rows, |_, span| hits += span.len() as u64);
        Counted { rays, hits }
    }
}
