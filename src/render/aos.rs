//! The engines `c` and `paper`: Algorithm 1 over packed lists, one vector in one register.

use std::ops::Range;

use glam::DVec3;

use super::{Counted, Distance, FilmMut, Found, PixelFormat, Tracer, Wanted, assert_rows, existing, is_wanted};
use crate::kernels::{AosKernels, Frame, Hits, Plain, Surface, Vec4};
use crate::plan::Packed;
use crate::scene::Scene;

/// A scene, and the kernels that trace it.
pub struct AosTracer {
    kernels: &'static AosKernels,
    hits: Hits,
    packed: Packed,
    size: [u32; 2],
}

impl AosTracer {
    /// Packs `scene` for `kernels`; `hits` is the variant of their tracer that returns hits.
    pub fn new(kernels: &'static AosKernels, hits: Hits, scene: &Scene) -> Self {
        AosTracer { kernels, hits, packed: Packed::new(scene), size: [scene.camera.width(), scene.camera.height()] }
    }
}

impl Tracer for AosTracer {
    fn writes(&self, format: PixelFormat) -> bool {
        format == PixelFormat::F32x4
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        let FilmMut::F32x4(out) = out else { panic!("the paper's engines write floats") };
        assert_rows(&rows, self.size, out.len());
        self.kernels.trace.call(self.packed.frame(), self.packed.objects(), rows, out);
    }

    fn light(&self, rows: Range<u32>, wanted: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        assert_rows(&rows, self.size, out.len());
        let width = self.packed.frame().width as usize;
        for (row, out) in rows.zip(out.chunks_exact_mut(width)) {
            let is_wanted: Vec<_> = (0..width as u32).map(|column| is_wanted(wanted, row, column)).collect();
            let mut first = 0;
            for run in is_wanted.chunk_by(|a, b| a == b) {
                let columns = first..first + run.len();
                if run[0] {
                    let frame =
                        Frame { background, first: first as u64, width: run.len() as u64, ..*self.packed.frame() };
                    self.kernels.trace.call(&frame, self.packed.objects(), row..row + 1, &mut out[columns.clone()]);
                }
                first = columns.end;
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
