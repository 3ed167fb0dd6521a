//! The engines `sse41`, `avx2` and `avx512`: packets of rays along the spans of each row.

mod hits;

use std::marker::PhantomData;
use std::ops::Range;

use super::{FilmMut, Found, PixelFormat, Tracer};
use crate::kernels::sys;
use crate::kernels::{
    Bodies, Element, Emit, InsideSpan, Lit, LitSpan, NearSpan, OutsideSpan, PacketKernels, Planes, Rgba8, Row, Shade,
    SpanKernels, TriangleSpan, Vec4,
};
use crate::plan::{RowSpan, Spans, UseRecord};
use crate::scene::{Camera, Scene};

/// Float pictures larger than this do not stay in any cache, and are stored past it.
const STREAMING_BYTES: u64 = 16 << 20;

/// A scene planned for packets, and the kernels that trace it.
pub struct PacketTracer<E: 'static> {
    kernels: &'static PacketKernels,
    spans: &'static SpanKernels<E>,
    /// Whether the shade may come from estimates in floats too.
    fast: bool,
    width: usize,
    streaming: bool,
    /// Weighted for floats.
    linear: Spans<E>,
    /// Weighted for bytes.
    levels: Spans<E>,
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
        camera: &Camera,
    ) -> Self {
        PacketTracer {
            wide: None,
            kernels,
            spans,
            fast,
            width: camera.width() as usize,
            streaming: camera.pixels() * size_of::<Vec4>() as u64 > STREAMING_BYTES,
            linear: Spans::new(scene, camera, 1.0),
            levels: Spans::new(scene, camera, 255.0),
        }
    }
}

impl PacketTracer<f32> {
    /// Plans `scene` for the kernels in f32, with estimates where `fast`.
    pub fn single(kernels: &'static PacketKernels, fast: bool, scene: &Scene, camera: &Camera) -> Self {
        let tracer = Self::planned(kernels, &kernels.single, fast, scene, camera);
        let wide = tracer.linear.any_wide().then(|| Box::new(PacketTracer::double(kernels, scene, camera)));
        PacketTracer { wide, ..tracer }
    }
}

impl PacketTracer<f64> {
    /// Plans `scene` for the kernels in f64.
    pub fn double(kernels: &'static PacketKernels, scene: &Scene, camera: &Camera) -> Self {
        Self::planned(kernels, &kernels.double, false, scene, camera)
    }
}

/// What differs between the outputs.
trait Output<E: 'static>: Sized {
    fn fill(tracer: &PacketTracer<E>, out: &mut [Self]);
    /// The kernel that shades a sphere in the short form.
    fn lit<'a>(tracer: &'a PacketTracer<E>, record: &LitSpan<E>) -> &'a Shade<LitSpan<E>, E, Self>;
    /// The kernel that shades a span that is alone.
    fn shade<'a, S>(tracer: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Shade<S, E, Self>;
    /// The kernel that shades where spans overlap.
    fn planes<'a, S>(tracer: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Planes<S, E>;
    fn emit(tracer: &PacketTracer<E>) -> &Emit<E, Self>;
}

impl<E: Element> Output<E> for Vec4 {
    fn fill(tracer: &PacketTracer<E>, out: &mut [Self]) {
        tracer.kernels.fill.f32x4(out, tracer.streaming);
    }

    fn lit<'a>(tracer: &'a PacketTracer<E>, _: &LitSpan<E>) -> &'a Shade<LitSpan<E>, E, Self> {
        if tracer.fast { &tracer.spans.lit_f32x4_fast } else { &tracer.spans.lit_f32x4 }
    }

    fn shade<'a, S>(tracer: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Shade<S, E, Self> {
        if tracer.fast { &bodies.f32x4_fast } else { &bodies.f32x4 }
    }

    fn planes<'a, S>(tracer: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Planes<S, E> {
        if tracer.fast { &bodies.planes_fast } else { &bodies.planes }
    }

    fn emit(tracer: &PacketTracer<E>) -> &Emit<E, Self> {
        &tracer.spans.emit_f32x4
    }
}

impl<E: Element> Output<E> for Rgba8 {
    fn fill(tracer: &PacketTracer<E>, out: &mut [Self]) {
        tracer.kernels.fill.rgba8(out);
    }

    fn lit<'a>(tracer: &'a PacketTracer<E>, record: &LitSpan<E>) -> &'a Shade<LitSpan<E>, E, Self> {
        let grey = record.red == record.green && record.green == record.blue;
        if grey { &tracer.spans.grey_rgba8 } else { &tracer.spans.lit_rgba8 }
    }

    fn shade<'a, S>(_: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Shade<S, E, Self> {
        &bodies.rgba8
    }

    fn planes<'a, S>(_: &PacketTracer<E>, bodies: &'a Bodies<S, E>) -> &'a Planes<S, E> {
        &bodies.planes_fast
    }

    fn emit(tracer: &PacketTracer<E>) -> &Emit<E, Self> {
        &tracer.spans.emit_rgba8
    }
}

/// Shades a span that is alone in its pixels.
struct Alone<'a, E: 'static, P> {
    tracer: &'a PacketTracer<E>,
    lits: &'a [Lit<E>],
    out: &'a mut [P],
}

impl<E: Element, P: Output<E>> UseRecord<E> for Alone<'_, E, P> {
    type Result = ();

    fn lit(self, record: &LitSpan<E>) {
        P::lit(self.tracer, record).call(record, self.lits, self.out, self.tracer.streaming);
    }
    fn outside(self, record: &OutsideSpan<E>) {
        let kernel = P::shade(self.tracer, &self.tracer.spans.outside);
        kernel.call(record, self.lits, self.out, self.tracer.streaming);
    }
    fn near(self, record: &NearSpan<E>) {
        let kernel = P::shade(self.tracer, &self.tracer.spans.near);
        kernel.call(record, self.lits, self.out, self.tracer.streaming);
    }
    fn inside(self, record: &InsideSpan<E>) {
        let kernel = P::shade(self.tracer, &self.tracer.spans.inside);
        kernel.call(record, self.lits, self.out, self.tracer.streaming);
    }
    fn triangle(self, record: &TriangleSpan<E>) {
        let kernel = P::shade(self.tracer, &self.tracer.spans.triangle);
        kernel.call(record, self.lits, self.out, self.tracer.streaming);
    }
}

/// Finds the nearest, or shades it, along one of several spans that overlap.
struct Overlapping<'a, E: 'static, P> {
    tracer: &'a PacketTracer<E>,
    row: &'a mut Row<E>,
    x: Range<usize>,
    /// None: find the nearest. Some: shade it under these lights.
    lits: Option<&'a [Lit<E>]>,
    output: PhantomData<P>,
}

impl<E: Element, P: Output<E>> Overlapping<'_, E, P> {
    fn call<S>(self, bodies: &Bodies<S, E>, record: &S) {
        match self.lits {
            None => bodies.depth.call(record, self.row, self.x),
            Some(lits) => P::planes(self.tracer, bodies).call(record, lits, self.row, self.x),
        }
    }
}

impl<E: Element, P: Output<E>> UseRecord<E> for Overlapping<'_, E, P> {
    type Result = ();

    fn lit(self, _: &LitSpan<E>) {
        unreachable!("the short form is not asked for where spans overlap");
    }
    fn outside(self, record: &OutsideSpan<E>) {
        let bodies = &self.tracer.spans.outside;
        self.call(bodies, record);
    }
    fn near(self, record: &NearSpan<E>) {
        let bodies = &self.tracer.spans.near;
        self.call(bodies, record);
    }
    fn inside(self, record: &InsideSpan<E>) {
        let bodies = &self.tracer.spans.inside;
        self.call(bodies, record);
    }
    fn triangle(self, record: &TriangleSpan<E>) {
        let bodies = &self.tracer.spans.triangle;
        self.call(bodies, record);
    }
}

impl<E: Element> PacketTracer<E> {
    fn trace<P: Output<E>>(&self, plan: &Spans<E>, rows: Range<u32>, out: &mut [P]) {
        assert_eq!(out.len(), rows.len() * self.width, "the film must have the size of the rows");
        let seen = plan.seen_in(&rows);
        let mut spans: Vec<RowSpan> = Vec::with_capacity(seen.len());
        let mut buffers = None;
        // The pixels of `out` that are written: nothing is written twice, and what no span covers in one piece.
        let mut done = 0;
        // What is in front of `span` since the last one, and the span, which is alone in its pixels.
        let shade_alone = |span: &RowSpan, row: u32, start: usize, done: &mut usize, out: &mut [P]| {
            let (first, end) = (start + span.start as usize, start + span.end as usize);
            P::fill(self, &mut out[*done..first]);
            let alone = Alone { tracer: self, lits: plan.lits(span.object), out: &mut out[first..end] };
            plan.with_record(span, row, 0.0, true, alone);
            *done = end;
        };
        // One object has nothing to overlap with, and its span need not pass through the list.
        if let [object] = seen[..] {
            for row in rows.clone() {
                let start = (row - rows.start) as usize * self.width;
                if let Some(span) = plan.row(object, row) {
                    shade_alone(&span, row, start, &mut done, out);
                }
            }
            P::fill(self, &mut out[done..]);
            return;
        }
        for row in rows.clone() {
            spans.clear();
            spans.extend(seen.iter().filter_map(|object| plan.row(*object, row)));
            let start = (row - rows.start) as usize * self.width;
            if overlap(&mut spans) && !plan.cut_hidden(row, &mut spans) {
                let columns = columns(&spans);
                let buffers = buffers.get_or_insert_with(|| Row::new(self.width));
                P::fill(self, &mut out[done..start + columns.start]);
                self.trace_overlapping::<P>(plan, row, &mut spans, buffers, columns.clone());
                done = start + columns.end;
                P::emit(self).call(buffers, columns.start, &mut out[start + columns.start..done]);
            } else {
                for span in &spans {
                    shade_alone(span, row, start, &mut done, out);
                }
            }
        }
        P::fill(self, &mut out[done..]);
    }

    /// Rows whose objects have numbers that the elements hold.
    fn narrow_rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        match out {
            FilmMut::F32x4(out) => {
                self.trace(&self.linear, rows, out);
                if self.streaming {
                    sys::store_fence();
                }
            }
            FilmMut::Rgba8(out) => self.trace(&self.levels, rows, out),
        }
    }

    /// Finds who is nearest at each pixel, and then shades each object's own.
    fn trace_overlapping<P: Output<E>>(
        &self,
        plan: &Spans<E>,
        row: u32,
        spans: &mut [RowSpan],
        buffers: &mut Row<E>,
        columns: Range<usize>,
    ) {
        // The first of equals is the nearest: the scene's order.
        spans.sort_unstable_by_key(|span| span.object);
        buffers.clear(columns);
        for shading in [false, true] {
            for (id, span) in (1..).zip(&*spans) {
                let lits = shading.then(|| plan.lits(span.object));
                let x = span.start as usize..span.end as usize;
                let user = Overlapping { tracer: self, row: buffers, x, lits, output: PhantomData::<P> };
                plan.with_record(span, row, id.into(), false, user);
            }
        }
    }
}

/// Whether any two spans share a pixel; leaves them sorted from left to right.
fn overlap(spans: &mut [RowSpan]) -> bool {
    if spans.len() < 2 {
        return false;
    }
    spans.sort_unstable_by_key(|span| span.start);
    spans.windows(2).any(|pair| pair[1].start < pair[0].end)
}

/// The columns from the first span to the end of the last.
fn columns(spans: &[RowSpan]) -> Range<usize> {
    let start = spans.iter().map(|span| span.start).min().unwrap_or(0);
    let end = spans.iter().map(|span| span.end).max().unwrap_or(0);
    start as usize..end as usize
}

impl<E: Element> Tracer for PacketTracer<E> {
    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn rows(&self, rows: Range<u32>, mut out: FilmMut<'_>) {
        assert_eq!(out.len(), rows.len() * self.width, "the film must have the size of the rows");
        let Some(wide) = &self.wide else { return self.narrow_rows(rows, out) };
        // Row by row, so that no row depends on those it is traced with.
        for row in rows.clone() {
            let range = (row - rows.start) as usize * self.width..(row + 1 - rows.start) as usize * self.width;
            let out = match &mut out {
                FilmMut::F32x4(out) => FilmMut::F32x4(&mut out[range]),
                FilmMut::Rgba8(out) => FilmMut::Rgba8(&mut out[range]),
            };
            if self.linear.is_wide(row) {
                wide.rows(row..row + 1, out);
            } else {
                self.narrow_rows(row..row + 1, out);
            }
        }
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        rows.flat_map(|row| match &self.wide {
            Some(wide) if self.linear.is_wide(row) => wide.found(row..row + 1),
            _ => self.found(row..row + 1),
        })
        .collect()
    }
}
