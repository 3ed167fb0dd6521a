//! What the packets hit: the spans that are traced, their 1/t and their normals as the kernels have them.

use std::ops::Range;

use glam::DVec3;

use super::PacketTracer;
use crate::kernels::{
    Element, InRow, InsideSpan, LitRow, NearSpan, OutsideSpan, Planes, Row, SpanKernels, TriangleSpan,
};
use crate::plan::{RowSpans, ShortForm, UseRecord, Way};
use crate::render::{Distance, Found};

/// What is asked about a span.
#[derive(Clone, Copy)]
enum Question {
    /// Who is nearest.
    Depth,
    /// The normals of those that are.
    Normals,
}

/// A span to ask about, in a row of buffers.
struct Asked<'a, E: 'static> {
    kernels: &'static SpanKernels<E>,
    row: &'a mut Row<E>,
    x: Range<usize>,
    question: Question,
}

impl<E: Element> Asked<'_, E> {
    fn ask<S>(self, bodies: &InRow<S, E>, normals: Option<&Planes<S, E>>, record: &S) {
        match (self.question, normals) {
            (Question::Depth, _) => bodies.depth.call(record, self.row, self.x),
            (Question::Normals, Some(normals)) => normals.call(record, &[], self.row, self.x),
            (Question::Normals, None) => {}
        }
    }
}

impl<E: Element> UseRecord<E> for Asked<'_, E> {
    type Result = ();

    fn lit(self, _: &ShortForm, _: &LitRow<E>) {
        unreachable!("the short form has neither t nor a normal, and is not asked");
    }
    fn outside(self, record: &OutsideSpan<E>) {
        let kernels = self.kernels;
        self.ask(&kernels.outside_in_row, Some(&kernels.outside_normals), record);
    }
    fn near(self, record: &NearSpan<E>) {
        let kernels = self.kernels;
        self.ask(&kernels.near_in_row, Some(&kernels.near_normals), record);
    }
    fn inside(self, record: &InsideSpan<E>) {
        let kernels = self.kernels;
        self.ask(&kernels.inside_in_row, Some(&kernels.inside_normals), record);
    }
    fn triangle(self, record: &TriangleSpan<E>) {
        let bodies = &self.kernels.triangle_in_row;
        self.ask(bodies, None, record);
    }
}

impl<E: Element> PacketTracer<E> {
    /// Says of each row of `rows` which of its pixels no ray hits, run by run and without a trace: every pixel of a span is a
    /// hit.
    pub(super) fn each_gap(&self, rows: Range<u32>, say: &mut dyn FnMut(u32, Range<u32>)) {
        let seen = self.plan.seen_in(&rows);
        let mut in_row = RowSpans::default();
        for row in rows {
            if let Some(wide) = self.wide.as_ref().filter(|_| self.plan.is_wide(row)) {
                wide.each_gap(row..row + 1, say);
                continue;
            }
            self.plan.spans_in(row, &seen, &mut in_row);
            in_row.spans.sort_unstable_by_key(|span| span.start);
            let mut done = 0;
            for span in &in_row.spans {
                if done < span.start {
                    say(row, done..span.start);
                }
                done = done.max(span.end);
            }
            if done < self.width as u32 {
                say(row, done..self.width as u32);
            }
        }
    }

    /// As [`super::super::Tracer::hits`].
    pub(super) fn found(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let plan = &self.plan;
        let seen = plan.seen_in(&rows);
        let mut buffers = Row::new(self.width);
        let mut found = Vec::with_capacity(rows.len() * self.width);
        let mut in_row = RowSpans::default();
        for row in rows {
            if let Some(wide) = self.wide.as_ref().filter(|_| plan.is_wide(row)) {
                found.extend(wide.found(row..row + 1));
                continue;
            }
            let by_depth = plan.spans_in(row, &seen, &mut in_row) != Way::Apart;
            in_row.spans.sort_unstable_by_key(|span| span.object);
            let spans = &in_row.spans;
            buffers.clear(0..self.width);
            for question in [Question::Depth, Question::Normals] {
                for (id, span) in (1..).zip(spans) {
                    let x = span.start as usize..span.end as usize;
                    let asked = Asked { kernels: self.spans, row: &mut buffers, x, question };
                    plan.with_record(span, row, id.into(), None, asked);
                }
            }
            let plane = |plane: usize, x: usize| buffers.plane(plane)[x].to_f64();
            let mut owners = vec![None; self.width];
            for (id, span) in (1..).zip(spans) {
                let (x, who) = (span.start as usize..span.end as usize, f64::from(id));
                // A span that is alone in its pixels is shaded there without a look at its depth.
                let own = |at: &E| !by_depth || at.to_f64() == who;
                let pixels = owners[x.clone()].iter_mut().zip(&buffers.plane(0)[x]);
                pixels.filter(|(_, at)| own(at)).for_each(|(owner, _)| *owner = Some((who, span.object)));
            }
            found.extend(owners.into_iter().enumerate().map(|(x, owner)| {
                let (who, object) = owner?;
                let normal = DVec3::new(plane(1, x), plane(2, x), plane(3, x));
                let known = plane(0, x) == who && normal != DVec3::ZERO;
                Some(Found {
                    object: plan.source(object),
                    distance: Distance::Inverse(plan.depth_unit() * plane(4, x)),
                    // A triangle's is made with the plan, and kernels have its product with each light.
                    normal: known.then_some(normal).or_else(|| plan.normal(object)),
                })
            }));
        }
        found
    }
}
