//! The engines `c` and `paper`: Algorithm 1 over packed lists, one vector in one register.

use std::ops::Range;

use glam::DVec3;

use super::{
    Counted, Distance, FilmMut, Found, PixelFormat, Tracer, Wanted, assert_rows, existing, is_wanted, rows_by_floats,
};
use crate::kernels::{AosKernels, Frame, Hits, Plain, Surface, Vec4};
use crate::plan::Packed;
use crate::scene::Scene;

/// A packed scene, with the kernels that trace it.
pub struct AosTracer {
    kernels: &'static AosKernels,
    hits: Hits,
    packed: Packed,
    size: [u32; 2],
}

impl AosTracer {
    /// Packs `scene` for `kernels`; `hits` is the variant of their tracer that returns hits instead
    /// of colours.
    pub fn new(kernels: &'static AosKernels, hits: Hits, scene: &Scene) -> Self {
        AosTracer { kernels, hits, packed: Packed::new(scene), size: [scene.camera.width(), scene.camera.height()] }
    }
}

impl Tracer for AosTracer {
    fn writes(&self, format: PixelFormat) -> bool {
        format == PixelFormat::F32x4
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        let FilmMut::F32x4(out) = out else { return rows_by_floats(self, rows, self.size, out) };
        assert_rows(&rows, self.size, out.len());
        self.kernels.trace.call(self.packed.frame(), self.packed.objects(), rows, out);
    }

    fn light(&self, rows: Range<u32>, wanted: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        assert_rows(&rows, self.size, out.len());
        let (width, whole) = (self.size[0], self.packed.frame());
        for (row, out) in rows.zip(out.chunks_exact_mut(width as usize)) {
            let mut end = 0;
            while end < width {
                // A row may have few wanted pixels: 64 pixels are checked at a time, so that the
                // others are skipped quickly.
                let mut block = end..width.min(end + 64);
                end = block.end;
                if wanted(row..row + 1, block.clone()).is_empty() {
                    continue;
                }
                let first = block.find(|column| is_wanted(wanted, row, *column)).unwrap_or(end);
                end = (first..width).find(|column| !is_wanted(wanted, row, *column)).unwrap_or(width);
                let frame = Frame { background, first: first.into(), width: (end - first).into(), ..*whole };
                let out = &mut out[first as usize..end as usize];
                self.kernels.trace.call(&frame, self.packed.objects(), row..row + 1, out);
            }
        }
        None
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let (numbered, rows) = (self.packed.numbered(), existing(rows, self.size[1]));
        let mut surfaces = vec![Surface::ZERO; rows.len() * numbered.frame().width as usize];
        self.hits.call(numbered.frame(), numbered.objects(), rows, &mut surfaces);
        let found = |Surface { point, normal, colour }: Surface| {
            let normal = DVec3::new(normal.x.into(), normal.y.into(), normal.z.into());
            let object = numbered.object(colour)?;
            Some(Found { object, distance: Distance::T(point.w.into()), normal: Some(normal) })
        };
        surfaces.into_iter().map(found).collect()
    }
}
