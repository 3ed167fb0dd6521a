//! The engines `c` and `paper`: Algorithm 1 over packed lists, one vector in one register.

use std::ops::Range;

use glam::DVec3;

use super::{Distance, FilmMut, Found, PixelFormat, Tracer};
use crate::kernels::{AosKernels, Hits, Plain, Surface};
use crate::plan::Packed;
use crate::scene::Scene;

/// A scene, and the kernels that trace it.
pub struct AosTracer {
    kernels: &'static AosKernels,
    hits: Hits,
    packed: Packed,
}

impl AosTracer {
    /// Packs `scene` for `kernels`; `hits` is the variant of their tracer that returns hits.
    pub fn new(kernels: &'static AosKernels, hits: Hits, scene: &Scene) -> Self {
        AosTracer { kernels, hits, packed: Packed::new(scene) }
    }
}

impl Tracer for AosTracer {
    fn writes(&self, format: PixelFormat) -> bool {
        format == PixelFormat::F32x4
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        let FilmMut::F32x4(out) = out else { panic!("the paper's engines write floats") };
        self.kernels.trace.call(self.packed.frame(), self.packed.objects(), rows, out);
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let numbered = self.packed.numbered();
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
