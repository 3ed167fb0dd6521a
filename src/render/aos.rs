//! The engines `c` and `paper`: Algorithm 1 over packed lists, one vector in one register.

use std::ops::Range;

use super::{FilmMut, PixelFormat, Tracer};
use crate::kernels::AosKernels;
use crate::plan::Packed;
use crate::scene::{Camera, Scene};

/// A scene, and the kernels that trace it.
pub struct AosTracer {
    kernels: &'static AosKernels,
    packed: Packed,
}

impl AosTracer {
    /// Packs `scene` for `kernels`.
    pub fn new(kernels: &'static AosKernels, scene: &Scene, camera: &Camera) -> Self {
        AosTracer { kernels, packed: Packed::new(scene, camera) }
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
}
