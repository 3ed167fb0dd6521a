//! The engines `sse41`, `avx2` and `avx512`: packets of rays along the spans of each row.

use std::ops::Range;

use super::{FilmMut, PixelFormat, Tracer};
use crate::kernels::{Depth, Element, Lit, PacketKernels, Planes, Rgba8, Row, Shade, SpanKernels, Vec4};
use crate::plan::{Record, RowSpan, Spans};
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
}

impl<E: Element> PacketTracer<E> {
    /// Plans `scene` for the kernels; `spans` is theirs for one element type.
    pub fn new(
        kernels: &'static PacketKernels,
        spans: &'static SpanKernels<E>,
        fast: bool,
        scene: &Scene,
        camera: &Camera,
    ) -> Self {
        PacketTracer {
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

/// What differs between the outputs.
trait Output<E: 'static>: Sized {
    fn fill(tracer: &PacketTracer<E>, out: &mut [Self]);
    fn shade(tracer: &PacketTracer<E>, record: &Record<E>, lits: &[Lit<E>], out: &mut [Self]);
    fn emit(tracer: &PacketTracer<E>, row: &mut Row<E>, start: usize, out: &mut [Self]);
    /// Whether overlapping spans are shaded with estimates.
    fn estimates(tracer: &PacketTracer<E>) -> bool;
}

impl<E: Element> Output<E> for Vec4 {
    fn fill(tracer: &PacketTracer<E>, out: &mut [Self]) {
        tracer.kernels.fill.f32x4(out, tracer.streaming);
    }

    fn shade(tracer: &PacketTracer<E>, record: &Record<E>, lits: &[Lit<E>], out: &mut [Self]) {
        let PacketTracer { spans, fast, streaming, .. } = tracer;
        fn pick<'a, S, E>(fast: bool, yes: &'a Shade<S, E, Vec4>, no: &'a Shade<S, E, Vec4>) -> &'a Shade<S, E, Vec4> {
            if fast { yes } else { no }
        }
        match record {
            Record::Lit(span, _) => {
                pick(*fast, &spans.lit_f32x4_fast, &spans.lit_f32x4).call(span, lits, out, *streaming);
            }
            Record::Outside(span) => {
                pick(*fast, &spans.outside.f32x4_fast, &spans.outside.f32x4).call(span, lits, out, *streaming);
            }
            Record::Inside(span) => {
                pick(*fast, &spans.inside.f32x4_fast, &spans.inside.f32x4).call(span, lits, out, *streaming);
            }
            Record::Triangle(span) => {
                pick(*fast, &spans.triangle.f32x4_fast, &spans.triangle.f32x4).call(span, lits, out, *streaming);
            }
        }
    }

    fn emit(tracer: &PacketTracer<E>, row: &mut Row<E>, start: usize, out: &mut [Self]) {
        tracer.spans.emit_f32x4.call(row, start, out);
    }

    fn estimates(tracer: &PacketTracer<E>) -> bool {
        tracer.fast
    }
}

impl<E: Element> Output<E> for Rgba8 {
    fn fill(tracer: &PacketTracer<E>, out: &mut [Self]) {
        tracer.kernels.fill.rgba8(out);
    }

    fn shade(tracer: &PacketTracer<E>, record: &Record<E>, lits: &[Lit<E>], out: &mut [Self]) {
        let spans = tracer.spans;
        match record {
            Record::Lit(span, _) => spans.lit_rgba8.call(span, lits, out, false),
            Record::Outside(span) => spans.outside.rgba8.call(span, lits, out, false),
            Record::Inside(span) => spans.inside.rgba8.call(span, lits, out, false),
            Record::Triangle(span) => spans.triangle.rgba8.call(span, lits, out, false),
        }
    }

    fn emit(tracer: &PacketTracer<E>, row: &mut Row<E>, start: usize, out: &mut [Self]) {
        tracer.spans.emit_rgba8.call(row, start, out);
    }

    fn estimates(_: &PacketTracer<E>) -> bool {
        true
    }
}

impl<E: Element> PacketTracer<E> {
    fn trace<P: Output<E>>(&self, plan: &Spans<E>, rows: Range<u32>, out: &mut [P]) {
        assert_eq!(out.len(), rows.len() * self.width, "the film must have the size of the rows");
        let seen = plan.seen_in(&rows);
        let mut spans: Vec<RowSpan<E>> = Vec::with_capacity(seen.len());
        let mut buffers = None;
        // The pixels of `out` that are written: nothing is written twice, and what no span covers in one piece.
        let mut done = 0;
        for row in rows.clone() {
            spans.clear();
            spans.extend(seen.iter().filter_map(|object| plan.row(*object, row)));
            let start = (row - rows.start) as usize * self.width;
            if overlap(&mut spans) {
                let columns = columns(&spans);
                let buffers = buffers.get_or_insert_with(|| Row::new(self.width));
                P::fill(self, &mut out[done..start + columns.start]);
                self.trace_overlapping::<P>(plan, &mut spans, buffers, columns.clone());
                P::emit(self, buffers, columns.start, &mut out[start + columns.start..start + columns.end]);
                done = start + columns.end;
            } else {
                for span in &spans {
                    let (first, end) = (start + span.start as usize, start + span.end as usize);
                    P::fill(self, &mut out[done..first]);
                    P::shade(self, &span.record, plan.lits(span.object), &mut out[first..end]);
                    done = end;
                }
            }
        }
        P::fill(self, &mut out[done..]);
    }

    /// Finds who is nearest at each pixel, and then shades each object's own.
    fn trace_overlapping<P: Output<E>>(
        &self,
        plan: &Spans<E>,
        spans: &mut [RowSpan<E>],
        buffers: &mut Row<E>,
        columns: Range<usize>,
    ) {
        // The first of equals is the nearest: the scene's order.
        spans.sort_unstable_by_key(|span| span.object);
        buffers.clear(columns);
        let estimates = P::estimates(self);
        for (i, span) in spans.iter_mut().enumerate() {
            let x = span.start as usize..span.end as usize;
            let id = E::from_f64((i + 1) as f64);
            match &mut span.record {
                Record::Lit(_, record) | Record::Outside(record) => {
                    record.id = id;
                    Depth::call(&self.spans.outside.depth, record, buffers, x);
                }
                Record::Inside(record) => {
                    record.id = id;
                    Depth::call(&self.spans.inside.depth, record, buffers, x);
                }
                Record::Triangle(record) => {
                    record.id = id;
                    Depth::call(&self.spans.triangle.depth, record, buffers, x);
                }
            }
        }
        for span in spans.iter() {
            let x = span.start as usize..span.end as usize;
            let lits = plan.lits(span.object);
            fn pick<'a, S, E>(fast: bool, yes: &'a Planes<S, E>, no: &'a Planes<S, E>) -> &'a Planes<S, E> {
                if fast { yes } else { no }
            }
            match &span.record {
                Record::Lit(_, record) | Record::Outside(record) => {
                    let bodies = &self.spans.outside;
                    pick(estimates, &bodies.planes_fast, &bodies.planes).call(record, lits, buffers, x);
                }
                Record::Inside(record) => {
                    let bodies = &self.spans.inside;
                    pick(estimates, &bodies.planes_fast, &bodies.planes).call(record, lits, buffers, x);
                }
                Record::Triangle(record) => {
                    let bodies = &self.spans.triangle;
                    pick(estimates, &bodies.planes_fast, &bodies.planes).call(record, lits, buffers, x);
                }
            }
        }
    }
}

/// Whether any two spans share a pixel; leaves them sorted from left to right.
fn overlap<E>(spans: &mut [RowSpan<E>]) -> bool {
    if spans.len() < 2 {
        return false;
    }
    spans.sort_unstable_by_key(|span| span.start);
    spans.windows(2).any(|pair| pair[1].start < pair[0].end)
}

/// The columns from the first span to the end of the last.
fn columns<E>(spans: &[RowSpan<E>]) -> Range<usize> {
    let start = spans.iter().map(|span| span.start).min().unwrap_or(0);
    let end = spans.iter().map(|span| span.end).max().unwrap_or(0);
    start as usize..end as usize
}

impl<E: Element> Tracer for PacketTracer<E> {
    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        match out {
            FilmMut::F32x4(out) => self.trace(&self.linear, rows, out),
            FilmMut::Rgba8(out) => self.trace(&self.levels, rows, out),
        }
    }
}
