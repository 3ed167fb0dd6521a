//! The spheres of a tile: their shading records, made only for those that own a pixel, and their normals.

use glam::DVec3;

use super::{MOST_EFFECTS, TileTracer};
use crate::kernels::{
    AroundSphere, CHUNK, Candidate, Element, SphereChunk, SphereRecords, TileBuffers, TileWindow, normal_over_t,
};
use crate::plan::{Omission, Weighted};
use crate::reference::geometry;

/// A scene of at most this many spheres has their shading records made once, before its first tile. In scenes of more, or of
/// too many lights, each tile makes those of the spheres that own a pixel there.
const MOST_RECORDS: usize = 4096;

/// In a tile of fewer spheres it costs more to find those that own a pixel than to make all their records.
const FEWEST_OWNERS: usize = 128;

/// The set-up spheres of a tile, in the order of their ids from 1 on.
#[derive(Default)]
pub(super) struct TileSpheres<E> {
    pub candidates: Vec<Candidate>,
    /// Whether they own a pixel, by id, from 0 on.
    owners: Vec<bool>,
    /// The ones that do.
    owning: Vec<Candidate>,
    /// The indices of their records; any for those without a pixel.
    pub places: Vec<u32>,
    /// The tile's own records, unless the tracer has those of all.
    pub records: SphereRecords<E>,
}

impl<E: Element> TileTracer<'_, E> {
    /// The records of all spheres, if they are few.
    pub(super) fn records_of_all(&self, weighted: &Weighted) -> Option<&SphereRecords<E>> {
        let count = self.plan.spheres().len();
        let make = || {
            let mut records = SphereRecords::default();
            let all: Vec<_> = (0..count as u32).map(|id| Candidate { id, ..Candidate::default() }).collect();
            self.make_records(weighted, &all, &mut records);
            records
        };
        // A tile that has shadows has records of what they leave of a sphere.
        let effects = count * self.plan.sphere_lights().len();
        (count <= MOST_RECORDS && effects <= MOST_EFFECTS && self.plan.shadows().is_none())
            .then(|| self.records[usize::from(weighted.bytes)].get_or_init(make))
    }

    /// Makes the records of the candidates, in this order.
    pub(super) fn make_records(&self, weighted: &Weighted, candidates: &[Candidate], records: &mut SphereRecords<E>) {
        let short = weighted.bytes && !self.plan.keep().has(Omission::Loop);
        let lights = self.plan.sphere_lights();
        records.hold(candidates.len(), lights.len());
        for first in (0..candidates.len()).step_by(CHUNK) {
            let spheres = SphereChunk { spheres: self.plan.spheres(), candidates: &candidates[first..] };
            self.kernels.tiles.sphere_shading.call(&weighted.spheres, spheres, lights, short, first, records);
            for (i, candidate) in (first..).zip(&candidates[first..]).take(CHUNK) {
                let sphere = &self.plan.spheres()[candidate.id as usize];
                let Some(AroundSphere { cx, cy, cz, scale, .. }) = self.plan.around(sphere) else { continue };
                let record = &mut records.spheres[i];
                [record.ux, record.uy, record.uz] = [cx, cy, cz].map(|c| E::from_f64(c / scale));
                (record.mx, record.around) = (E::from_f64(scale / f64::from(sphere.radius)), E::from_f64(1.0));
                let white = weighted.spheres.white * sphere.colour.as_dvec3();
                for (lit, light) in records.lits[i * lights.len()..].iter_mut().zip(lights) {
                    let weights = [white.x * light.red, white.y * light.green, white.z * light.blue];
                    [lit.red, lit.green, lit.blue] = weights.map(E::from_f64);
                }
            }
        }
    }

    /// Provides the records of the spheres that own a pixel, or, `by_force`, of all that may be visible in the tile.
    pub(super) fn look_at_spheres(
        &self,
        weighted: &Weighted,
        buffers: &TileBuffers<E>,
        tile_spheres: &mut TileSpheres<E>,
        by_force: bool,
    ) {
        let TileSpheres { candidates, owners, owning, places, records } = tile_spheres;
        if self.records_of_all(weighted).is_some() {
            places.extend(candidates.iter().map(|candidate| candidate.id));
        } else if by_force || candidates.len() < FEWEST_OWNERS {
            places.extend(0..candidates.len() as u32);
            self.make_records(weighted, candidates, records);
        } else {
            owners.clear();
            owners.resize(1 + candidates.len(), false);
            buffers.mark_owners(owners);
            // Without branches, which would be mispredicted.
            owning.resize(candidates.len(), Candidate::default());
            places.resize(candidates.len(), 0);
            let mut count = 0;
            for ((candidate, owns), place) in candidates.iter().zip(&owners[1..]).zip(places) {
                owning[count] = *candidate;
                *place = count as u32;
                count += usize::from(*owns);
            }
            // If none owns a pixel, all of them have the record of the first.
            self.make_records(weighted, &owning[..count.max(1)], records);
        }
    }

    /// The normal of sphere `who` of a tile at one of its pixels, where 1/t is `near`: by the operations of the kernel
    /// in its elements, which give it divided by t.
    pub(super) fn normal_of_sphere(
        &self,
        (who, near): (usize, E),
        (window, row, column): (&TileWindow, usize, usize),
        tile_spheres: &TileSpheres<E>,
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
