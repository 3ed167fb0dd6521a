//! The normals by which tiles are shaded.

use glam::DVec3;

use super::{Scratch, TileTracer};
use crate::kernels::{Candidate, Element, SphereRecords, TileWindow, normal_over_t};
use crate::reference::geometry;

impl<E: Element> TileTracer<'_, E> {
    /// That of a triangle, as the plan has it: kernels have its product with each light.
    pub(super) fn normal_of_triangle(&self, triangle: usize) -> DVec3 {
        geometry::triangle_plane(self.plan.scene().triangle(triangle).vertices.map(|v| v.as_dvec3())).normalize()
    }

    /// That of the sphere number `who` of a tile at one of its pixels, where 1/t is `near`: by the operations of the kernel in
    /// its elements, which leave it over t.
    pub(super) fn normal_of_sphere(
        &self,
        (who, near): (usize, E),
        (window, row, column): (&TileWindow, usize, usize),
        Scratch { tile_spheres, .. }: &Scratch<E>,
    ) -> DVec3 {
        let (row, column) = (row as u32, column as u32);
        let Candidate { id, most, .. } = tile_spheres.candidates[who - 1];
        if most == Candidate::ANY {
            let d = self.ray(window, column, row);
            return geometry::sphere_normal(
                self.plan.scale() / near.to_f64() * d,
                self.plan.spheres()[id as usize].centre.as_dvec3(),
            );
        }
        let SphereRecords { spheres, .. } = self.records_of_all(self.plan.linear()).unwrap_or(&tile_spheres.records);
        let record = spheres[tile_spheres.places[who - 1] as usize].widen();
        let [x, y] = [(window.column + column, record.column), (window.row + row, record.row)]
            .map(|(pixel, origin)| f64::from(pixel) - origin);
        let over_t = normal_over_t([size_of::<E>() == 4, self.kernels.fused], &record, x, y);
        DVec3::from(over_t) / near.to_f64()
    }
}
