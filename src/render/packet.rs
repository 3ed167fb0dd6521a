//! The engines `sse41`, `avx2` and `avx512`: packets of rays along the spans of each row.

mod hits;

use std::marker::PhantomData;
use std::ops::Range;
use std::sync::OnceLock;

use super::film::with_pixels;
use super::plan::PacketPlan;
use super::{Counted, FilmMut, Found, Pixel, PixelFormat, Purpose, Tracer, Wanted};
use crate::kernels::sys;
use crate::kernels::{
    Bodies, Element, Emit, F32x3, InRow, InsideSpan, LIT_ROWS, LitBodies, LitPlanes, LitRow, LitRows, Narrow, NearSpan,
    ObjectLight, OutsideSpan, PacketKernels, Plain, Planes, Rgb8, Rgba8, Row, Shade, ShadeRows, SpanKernels,
    TriangleSpan, Vec4,
};
use crate::measure::caches;
use crate::plan::{Omission, Report, RowSpan, RowSpans, Scale, Shading, ShortForm, Spans, UseRecord, Way};
use crate::scene::Scene;

/// Whether a picture of so many pixels is stored past the caches: it does not find its place in them.
///
/// Of floats, an eighth of the third level is their share, since other cores have theirs, and other machines on the same
/// chip; and at most 16 MiB, which are taken too where there is no such level or nobody tells. Bytes are stored as fast as
/// they are made until the whole of it is full, or 32 MiB of one that is larger and has more to share it. docs/performance.md
/// has what was measured.
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

/// As many bytes of four channels are made at a time on the way to three: they stay in a core's caches.
const BYTES_OF_FOUR: usize = 1 << 16;

/// A scene planned for packets, and the kernels that trace it.
pub struct PacketTracer<E: 'static> {
    kernels: &'static PacketKernels,
    spans: &'static SpanKernels<E>,
    /// Whether the shade may come from estimates in floats too.
    fast: bool,
    width: usize,
    /// Pixels of the film.
    pixels: u64,
    /// The one scale of light that it is ready for; None: any.
    scale: Option<Scale>,
    plan: Spans<E>,
    /// For the rows that see an object whose numbers are beyond f32.
    wide: Option<Box<PacketTracer<f64>>>,
}

impl<E: Element> PacketTracer<E> {
    /// Plans `scene` for the kernels; `spans` is theirs for one element type.
    fn planned(
        kernels: &'static PacketKernels,
        spans: &'static SpanKernels<E>,
        fast: bool,
        scene: &Scene,
        purpose: Purpose,
    ) -> Self {
        let scale = purpose.format.map(scale_of);
        PacketTracer {
            kernels,
            spans,
            fast,
            width: scene.camera.width() as usize,
            pixels: if purpose.in_bands { 0 } else { scene.camera.pixels() },
            scale,
            plan: Spans::new(scene, scale, purpose.keep),
            wide: None,
        }
    }
}

impl PacketTracer<f32> {
    /// Plans `scene` for the kernels in f32, with estimates where `fast`.
    pub fn single(kernels: &'static PacketKernels, fast: bool, scene: &Scene, purpose: Purpose) -> Self {
        let tracer = Self::planned(kernels, &kernels.single, fast, scene, purpose);
        let wide = || Box::new(PacketTracer::double(kernels, scene, purpose));
        PacketTracer { wide: tracer.plan.any_wide().then(wide), ..tracer }
    }
}

impl PacketTracer<f64> {
    /// Plans `scene` for the kernels in f64.
    pub fn double(kernels: &'static PacketKernels, scene: &Scene, purpose: Purpose) -> Self {
        Self::planned(kernels, &kernels.double, false, scene, purpose)
    }
}

/// What differs between the outputs.
trait Output<E: 'static>: Pixel {
    /// What full light is.
    const SCALE: Scale;
    /// Makes pixels black; `streaming`: past the caches, here and below.
    fn fill(tracer: &PacketTracer<E>, out: &mut [Self], streaming: bool);
    /// The kernel that makes rows of a sphere in the short form.
    fn lit<'a>(tracer: &PacketTracer<E>, bodies: &'a LitBodies<E>) -> &'a ShadeRows<E, Self>;
}

/// What differs between those of four channels, which all kernels make.
trait FourChannels<E: 'static>: Output<E> + Plain {
    /// The kernel that shades a span that is alone.
    fn shade<'a, S>(tracer: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Shade<S, E, Self>;
    /// The kernels that shade where spans overlap.
    fn planes<'a, S>(tracer: &PacketTracer<E>, bodies: &'a InRow<S, E>) -> &'a Planes<S, E>;
    fn lit_planes(tracer: &PacketTracer<E>) -> &LitPlanes<E>;
    fn emit(tracer: &PacketTracer<E>) -> &Emit<E, Self>;
}

/// An output of floats: estimates are asked for.
macro_rules! floats {
    ($pixel:ty, $field:ident, $fast:ident) => {
        impl<E: Element> Output<E> for $pixel {
            const SCALE: Scale = Scale::Linear;

            fn fill(tracer: &PacketTracer<E>, out: &mut [Self], streaming: bool) {
                tracer.kernels.fill.$field(out, streaming);
            }

            fn lit<'a>(tracer: &PacketTracer<E>, bodies: &'a LitBodies<E>) -> &'a ShadeRows<E, Self> {
                if tracer.fast { &bodies.$fast } else { &bodies.$field }
            }
        }
    };
}

/// An output of bytes: there are estimates wherever they are good enough.
macro_rules! bytes {
    ($pixel:ty, $field:ident) => {
        impl<E: Element> Output<E> for $pixel {
            const SCALE: Scale = Scale::Levels;

            fn fill(tracer: &PacketTracer<E>, out: &mut [Self], streaming: bool) {
                tracer.kernels.fill.$field(out, streaming);
            }

            fn lit<'a>(_: &PacketTracer<E>, bodies: &'a LitBodies<E>) -> &'a ShadeRows<E, Self> {
                &bodies.$field
            }
        }
    };
}

floats!(Vec4, f32x4, f32x4_fast);
floats!(F32x3, f32x3, f32x3_fast);
bytes!(Rgba8, rgba8);
bytes!(Rgb8, rgb8);

impl<E: Element> FourChannels<E> for Vec4 {
    fn shade<'a, S>(tracer: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Shade<S, E, Self> {
        if tracer.fast { &bodies.f32x4_fast } else { &bodies.f32x4 }
    }

    fn planes<'a, S>(tracer: &PacketTracer<E>, bodies: &'a InRow<S, E>) -> &'a Planes<S, E> {
        if tracer.fast { &bodies.planes_fast } else { &bodies.planes }
    }

    fn lit_planes(tracer: &PacketTracer<E>) -> &LitPlanes<E> {
        if tracer.fast { &tracer.spans.lit_planes_fast } else { &tracer.spans.lit_planes }
    }

    fn emit(tracer: &PacketTracer<E>) -> &Emit<E, Self> {
        &tracer.spans.emit_f32x4
    }
}

impl<E: Element> FourChannels<E> for Rgba8 {
    fn shade<'a, S>(_: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Shade<S, E, Self> {
        &bodies.rgba8
    }

    fn planes<'a, S>(_: &PacketTracer<E>, bodies: &'a InRow<S, E>) -> &'a Planes<S, E> {
        &bodies.planes_fast
    }

    fn lit_planes(tracer: &PacketTracer<E>) -> &LitPlanes<E> {
        &tracer.spans.lit_planes_fast
    }

    fn emit(tracer: &PacketTracer<E>) -> &Emit<E, Self> {
        &tracer.spans.emit_rgba8
    }
}

/// What full light is in a format.
fn scale_of(format: PixelFormat) -> Scale {
    if format.is_8bit() { Scale::Levels } else { Scale::Linear }
}

/// For each kind of record, which method takes the kernels of its kind.
macro_rules! by_record {
    ($($kind:ident($record:ident) => $method:ident($kernels:ident)),*) => {
        $(fn $kind(self, record: &$record<E>) {
            let kernels = &self.tracer.spans.$kernels;
            self.$method(kernels, record);
        })*
    };
}

/// Shades a span that is alone in its pixels.
struct Alone<'a, E: 'static, P> {
    tracer: &'a PacketTracer<E>,
    shading: Shading,
    lits: &'a [ObjectLight<E>],
    buffers: &'a mut Buffers<E>,
    out: &'a mut [P],
    streaming: bool,
}

impl<E: Element, P: FourChannels<E>> Alone<'_, E, P> {
    fn call<S>(self, bodies: &Bodies<S, E>, record: &S) {
        P::shade(self.tracer, bodies).call(record, self.lits, self.out, self.streaming);
    }

    /// By way of a row of buffers, in which all pixels are nobody's, as the record is.
    fn call_in_row<S>(self, bodies: &InRow<S, E>, record: &S) {
        let (row, x) = (self.buffers.row(self.tracer.width), 0..self.out.len());
        row.clear(x.clone());
        P::planes(self.tracer, bodies).call(record, self.lits, row, x);
        P::emit(self.tracer).call(row, 0, self.out);
    }
}

impl<E: Element, P: FourChannels<E>> UseRecord<E> for Alone<'_, E, P> {
    type Result = ();

    fn lit(self, form: &ShortForm, row: &LitRow<E>) {
        self.buffers.lit_rows.set_row(0, row);
        let kernel = self.tracer.lit::<P>(self.shading);
        let (sphere, width) = (form.sphere(P::SCALE).round(), self.out.len());
        kernel.call(&sphere, &self.buffers.lit_rows, self.out, width, self.streaming);
    }

    by_record! {
        outside(OutsideSpan) => call(outside),
        near(NearSpan) => call_in_row(near_in_row),
        inside(InsideSpan) => call_in_row(inside_in_row),
        triangle(TriangleSpan) => call(triangle)
    }
}

/// What is in cache while spans that overlap are traced.
struct Buffers<E> {
    /// Made when it is needed.
    row: Option<Row<E>>,
    /// Where the row of a short form is put.
    lit_rows: LitRows<E>,
}

impl<E: Element> Buffers<E> {
    fn row(&mut self, width: usize) -> &mut Row<E> {
        self.both(width).0
    }

    fn both(&mut self, width: usize) -> (&mut Row<E>, &LitRows<E>) {
        (self.row.get_or_insert_with(|| Row::new(width)), &self.lit_rows)
    }
}

/// Finds the nearest, or shades it, along one of several spans that overlap.
struct Overlapping<'a, E: 'static, P> {
    tracer: &'a PacketTracer<E>,
    buffers: &'a mut Buffers<E>,
    x: Range<usize>,
    /// None: find the nearest. Some: shade it under these lights.
    lits: Option<&'a [ObjectLight<E>]>,
    output: PhantomData<P>,
}

impl<E: Element, P: FourChannels<E>> Overlapping<'_, E, P> {
    fn call<S>(self, bodies: &InRow<S, E>, record: &S) {
        let row = self.buffers.row(self.tracer.width);
        match self.lits {
            None => bodies.depth.call(record, row, self.x),
            Some(lits) => P::planes(self.tracer, bodies).call(record, lits, row, self.x),
        }
    }
}

impl<E: Element, P: FourChannels<E>> UseRecord<E> for Overlapping<'_, E, P> {
    type Result = ();

    fn lit(self, form: &ShortForm, row: &LitRow<E>) {
        self.buffers.lit_rows.set_row(0, row);
        let (row, lit_rows) = self.buffers.both(self.tracer.width);
        P::lit_planes(self.tracer).call(&form.sphere(P::SCALE).round(), lit_rows, row, self.x);
    }

    by_record! {
        outside(OutsideSpan) => call(outside_in_row),
        near(NearSpan) => call(near_in_row),
        inside(InsideSpan) => call(inside_in_row),
        triangle(TriangleSpan) => call(triangle_in_row)
    }
}

impl<E: Element> PacketTracer<E> {
    /// The kernel for a sphere in the short form.
    fn lit<P: Output<E>>(&self, shading: Shading) -> &ShadeRows<E, P> {
        P::lit(self, if shading.grey { &self.spans.grey } else { &self.spans.lit })
    }

    /// Makes rows in which there is nothing but one sphere under one light.
    fn trace_lit<P: Output<E>>(
        &self,
        (form, shading): (&ShortForm, Shading),
        rows: Range<u32>,
        out: &mut [P],
        streaming: bool,
    ) {
        let (kernel, sphere) = (self.lit(shading), form.sphere(P::SCALE).round());
        let mut lit_rows = LitRows::default();
        for (first, out) in rows.step_by(LIT_ROWS).zip(out.chunks_mut(LIT_ROWS * self.width)) {
            self.spans.lit_rows.call(form.setup(P::SCALE), first, out.len() / self.width, &mut lit_rows);
            kernel.call(&sphere, &lit_rows, out, self.width, streaming);
        }
    }

    /// Three channels by way of four, some rows at a time and in cache, unless kernels write them.
    fn trace_three<P: Output<E>, Four: FourChannels<E>>(
        &self,
        rows: Range<u32>,
        out: &mut [P],
        narrow: &Narrow<Four, P>,
        streaming: bool,
    ) {
        if let Some(lit) = self.one_lit(&rows) {
            return self.trace_lit(lit, rows, out, streaming);
        }
        let together = (BYTES_OF_FOUR / size_of::<Four>() / self.width.max(1)).clamp(1, rows.len().max(1));
        let mut four = vec![Four::ZERO; together * self.width];
        for (first, out) in rows.step_by(together).zip(out.chunks_mut(together * self.width)) {
            let four = &mut four[..out.len()];
            self.trace(first..first + (out.len() / self.width) as u32, four, false);
            narrow.call(four, out);
        }
    }

    /// The one object of these rows, if it is a sphere in the short form that some light reaches.
    fn one_lit(&self, rows: &Range<u32>) -> Option<(&ShortForm, Shading)> {
        let object = self.plan.alone(&self.plan.seen_in(rows))?;
        let shading = self.plan.shading(object);
        self.plan.short_form(object).filter(|_| !shading.unlit).map(|form| (form, shading))
    }

    fn trace<P: FourChannels<E>>(&self, rows: Range<u32>, out: &mut [P], streaming: bool) {
        if let Some(lit) = self.one_lit(&rows) {
            return self.trace_lit(lit, rows, out, streaming);
        }
        let plan = &self.plan;
        let seen = plan.seen_in(&rows);
        // The pixels of `out` that are written: nothing is written twice, and what no span covers in one piece.
        let mut done = 0;
        // What is in front of `span` since the last one, and the span, which is alone in its pixels.
        let mut buffers = Buffers { row: None, lit_rows: LitRows::default() };
        let shade_alone = |span: &RowSpan, row: u32, start: usize, done: &mut usize, out: &mut [P], buffers: &mut _| {
            let shading = plan.shading(span.object);
            if shading.unlit {
                return;
            }
            let (first, end) = (start + span.start as usize, start + span.end as usize);
            P::fill(self, &mut out[*done..first], streaming);
            let lits = plan.lits(span.object, P::SCALE);
            let out = &mut out[first..end];
            let alone = Alone { tracer: self, shading, lits, buffers, out, streaming };
            plan.with_record(span, row, 0.0, Some(P::SCALE), alone);
            *done = end;
        };
        // One object has nothing to overlap with, and its span need not pass through the list.
        if let Some(object) = plan.alone(&seen) {
            for row in rows.clone() {
                let start = (row - rows.start) as usize * self.width;
                if let Some(span) = plan.row(object, row) {
                    shade_alone(&span, row, start, &mut done, out, &mut buffers);
                }
            }
            P::fill(self, &mut out[done..], streaming);
            return;
        }
        let mut in_row = RowSpans::default();
        for row in rows.clone() {
            let way = plan.spans_in(row, &seen, &mut in_row);
            let spans = &in_row.spans[..];
            let start = (row - rows.start) as usize * self.width;
            if way == Way::Apart {
                for span in spans {
                    shade_alone(span, row, start, &mut done, out, &mut buffers);
                }
                continue;
            }
            let columns = if way == Way::NearestInRow { 0..self.width } else { columns(spans) };
            P::fill(self, &mut out[done..start + columns.start], streaming);
            buffers.row(self.width).clear(columns.clone());
            match (way, plan.keep().has(Omission::Hidden)) {
                (Way::Nearest, false) => self.trace_overlapping::<P>(row, spans, &mut buffers),
                (_, hidden) => {
                    let all = (way == Way::NearestInRow).then_some(columns.clone());
                    self.trace_by_force::<P>(row, spans, all, hidden, &mut buffers);
                }
            }
            done = start + columns.end;
            P::emit(self).call(buffers.row(self.width), columns.start, &mut out[start + columns.start..done]);
        }
        P::fill(self, &mut out[done..], streaming);
    }

    /// Rows whose objects have numbers that the elements hold.
    fn narrow_rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        assert_eq!(out.len(), rows.len() * self.width, "the film must have the size of the rows");
        let streaming = is_past_caches(self.pixels, out.format());
        match out {
            FilmMut::F32x4(out) => self.trace(rows, out, streaming),
            FilmMut::F32x3(out) => self.trace_three(rows, out, &self.kernels.narrow_f32x3, streaming),
            FilmMut::Rgba8(out) => self.trace(rows, out, streaming),
            FilmMut::Rgb8(out) => self.trace_three(rows, out, &self.kernels.narrow_rgb8, streaming),
        }
        if streaming {
            sys::store_fence();
        }
    }

    /// Finds who is nearest at each pixel, and then shades each object's own.
    fn trace_overlapping<P: FourChannels<E>>(&self, row: u32, spans: &[RowSpan], buffers: &mut Buffers<E>) {
        for (id, span) in (1..).zip(spans) {
            self.pass::<P>(row, span, id, span.start..span.end, false, buffers);
        }
        for (id, span) in (1..).zip(spans) {
            self.pass::<P>(row, span, id, span.start..span.end, true, buffers);
        }
    }

    /// The same with work that need not be: along all of `columns` for each object, if there are any, and shading what may
    /// yet be hidden, if `hidden`.
    #[cold]
    fn trace_by_force<P: FourChannels<E>>(
        &self,
        row: u32,
        spans: &[RowSpan],
        columns: Option<Range<usize>>,
        hidden: bool,
        buffers: &mut Buffers<E>,
    ) {
        let pass = |id: u32, span: &RowSpan, x: Range<u32>, shading: bool, buffers: &mut Buffers<E>| {
            self.pass::<P>(row, span, id, x, shading, buffers);
        };
        let columns = columns.map(|columns| columns.start as u32..columns.end as u32);
        let both = |id: u32, span: &RowSpan, [depth, shading]: [bool; 2], buffers: &mut Buffers<E>| {
            let x = columns.clone().unwrap_or(span.start..span.end);
            if depth {
                // Before the span all rays miss, and so do those past its end, which the record tells.
                pass(id, &span.part(x.start..x.start), x.start..span.start, false, buffers);
                pass(id, span, span.start..x.end, false, buffers);
            }
            if shading {
                pass(id, &span.part(x.start..span.end), x, true, buffers);
            }
        };
        let passes = if hidden { &[[true, true]][..] } else { &[[true, false], [false, true]] };
        for which in passes {
            (1..).zip(spans).for_each(|(id, span)| both(id, span, *which, buffers));
        }
    }

    /// Makes the pixels `x` of the row a span's own where it is nearest; or shades those that are its own.
    #[inline(always)]
    fn pass<P: FourChannels<E>>(
        &self,
        row: u32,
        span: &RowSpan,
        id: u32,
        x: Range<u32>,
        shading: bool,
        buffers: &mut Buffers<E>,
    ) {
        if shading && self.plan.shading(span.object).unlit {
            return;
        }
        let lits = shading.then(|| self.plan.lits(span.object, P::SCALE));
        let x = x.start as usize..x.end as usize;
        let user = Overlapping { tracer: self, buffers, x, lits, output: PhantomData::<P> };
        self.plan.with_record(span, row, id.into(), shading.then_some(P::SCALE), user);
    }
}

/// The columns from the first span to the end of the last.
fn columns(spans: &[RowSpan]) -> Range<usize> {
    let start = spans.iter().map(|span| span.start).min().unwrap_or(0);
    let end = spans.iter().map(|span| span.end).max().unwrap_or(0);
    start as usize..end as usize
}

impl<E: Element> PacketPlan for PacketTracer<E> {
    fn report(&self, scene: &Scene, bytes: bool) -> Report {
        Report::new(scene, &self.plan, &Omission::ALL, bytes)
    }
}

impl<E: Element> Tracer for PacketTracer<E> {
    fn writes(&self, format: PixelFormat) -> bool {
        self.scale.is_none_or(|own| own == scale_of(format))
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        assert_eq!(out.len(), rows.len() * self.width, "the film must have the size of the rows");
        assert!(self.writes(out.format()), "the plan is not for {}", out.format().name());
        let Some(wide) = &self.wide else { return self.narrow_rows(rows, out) };
        // Row by row, so that no row depends on those it is traced with.
        with_pixels!(FilmMut(out) = out => {
            for (row, out) in rows.zip(out.chunks_exact_mut(self.width)) {
                let out = Pixel::film(out);
                if self.plan.is_wide(row) {
                    wide.rows(row..row + 1, out);
                } else {
                    self.narrow_rows(row..row + 1, out);
                }
            }
        });
    }

    fn light(&self, rows: Range<u32>, _: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        self.rows(rows.clone(), FilmMut::F32x4(out));
        if background != Vec4::default() {
            self.each_gap(rows.clone(), &mut |row, gap| {
                let start = (row - rows.start) as usize * self.width;
                out[start + gap.start as usize..start + gap.end as usize].fill(background);
            });
        }
        None
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        rows.flat_map(|row| match &self.wide {
            Some(wide) if self.plan.is_wide(row) => wide.found(row..row + 1),
            _ => self.found(row..row + 1),
        })
        .collect()
    }

    fn count(&self, rows: Range<u32>) -> Counted {
        let rays = (rows.len() * self.width) as u64;
        let mut missed = 0;
        self.each_gap(rows, &mut |_, gap| missed += gap.len() as u64);
        Counted { rays, hits: rays - missed }
    }
}
