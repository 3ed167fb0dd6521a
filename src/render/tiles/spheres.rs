//! The shading records of a tile's spheres, made only for spheres that have a pixel, and normals of
//! spheres.

use glam::DVec3;

use super::{MOST_EFFECTS, TileTracer};
use crate::kernels::{
    CHUNK, Candidate, Element, NearestAtPixel, SphereChunk, SphereRecords, TileBuffers, TileWindow, normal_over_t,
};
use crate::plan::{Omission, Weighted};
use crate::reference::geometry;

/// The most spheres whose shading records are made once for the whole picture, when a tile first
/// needs one: in f32 and under one light they take 640 KiB, which stay in the second-level cache.
/// With more spheres, too many lights, few pixels or shadows, each tile makes the records of the
/// spheres that have a pixel in it.
const MOST_RECORDS: usize = 4096;

/// In a picture with fewer pixels per sphere most spheres have no pixel: for 1,000 spheres in 16 x
/// 16 pixels, making all records took a third of the time.
const FEWEST_PIXELS: usize = 4;

/// In a tile with fewer spheres, finding those that have a pixel costs more than making the records
/// of all.
const FEWEST_OWNERS: usize = 128;

/// The spheres of a tile that have been set up, in the order of their ids, which begin at 1.
#[derive(Default)]
pub(super) struct TileSpheres<E> {
    pub candidates: Vec<Candidate>,
    /// For each id, from 0 on, whether it has a pixel.
    owners: Vec<bool>,
    /// The spheres that have a pixel.
    owning: Vec<Candidate>,
    /// For each sphere the index of its record; arbitrary for spheres without a pixel.
    pub places: Vec<u32>,
    /// The tile's own records, unless the tracer has the records of all spheres.
    pub records: SphereRecords<E>,
}

impl<E: Element> TileTracer<'_, E> {
    /// The records of all spheres, if there are few spheres.
    pub(super) fn records_of_all(&self, weighted: &Weighted) -> Option<&SphereRecords<E>> {
        let count = self.plan.spheres().len();
        let make = || {
            let mut records = SphereRecords::default();
            let all: Vec<_> = (0..count as u32).map(|id| Candidate { id, ..Candidate::default() }).collect();
            self.make_records(weighted, &all, &mut records);
            records
        };
        // With shadows, tiles need records of their own, for darkened copies of spheres.
        let effects = count * self.plan.sphere_lights().len();
        let [width, height] = self.plan.size();
        let pixels = width as usize * height as usize;
        let has_many_pixels = pixels / FEWEST_PIXELS >= count;
        (count <= MOST_RECORDS && effects <= MOST_EFFECTS && has_many_pixels && self.plan.shadows().is_none())
            .then(|| self.records[usize::from(weighted.bytes)].get_or_init(make))
    }

    /// Makes a record for each candidate, in their order.
    pub(super) fn make_records(&self, weighted: &Weighted, candidates: &[Candidate], records: &mut SphereRecords<E>) {
        let short = weighted.bytes && !self.plan.keep().has(Omission::Loop);
        let lights = self.plan.sphere_lights();
        records.hold(candidates.len(), lights.len());
        for first in (0..candidates.len()).step_by(CHUNK) {
            let spheres = SphereChunk { spheres: self.plan.spheres(), candidates: &candidates[first..] };
            self.kernels.tiles.sphere_shading.call(&weighted.spheres, spheres, lights, short, first, records);
            for (i, candidate) in (first..).zip(&candidates[first..]).take(CHUNK) {
                let sphere = &self.plan.spheres()[candidate.id as usize];
                if !self.plan.is_shaded_from_camera(sphere) {
                    continue;
                }
                let (centre, scale) = (sphere.centre.as_dvec3(), self.plan.scale());
                let record = &mut records.spheres[i];
                [record.ux, record.uy, record.uz] = (centre / scale).to_array().map(E::from_f64);
                (record.mx, record.around) = (E::from_f64(scale / f64::from(sphere.radius)), E::from_f64(1.0));
                let white = weighted.spheres.white * sphere.colour.as_dvec3();
                for (lit, light) in records.lits[i * lights.len()..].iter_mut().zip(lights) {
                    let weights = [white.x * light.red, white.y * light.green, white.z * light.blue];
                    [lit.red, lit.green, lit.blue] = weights.map(E::from_f64);
                }
            }
        }
    }

    /// Provides the records of the spheres that have a pixel or, if `by_force`, of all that may be
    /// visible in the tile.
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
            // Compacted without branches, which would be mispredicted.
            owning.resize(candidates.len(), Candidate::default());
            places.resize(candidates.len(), 0);
            let mut count = 0;
            for ((candidate, owns), place) in candidates.iter().zip(&owners[1..]).zip(places) {
                owning[count] = *candidate;
                *place = count as u32;
                count += usize::from(*owns);
            }
            // If no sphere has a pixel, all have index 0, and one record is made for it.
            self.make_records(weighted, &owning[..count.max(1)], records);
        }
    }

    /// The normal of a tile's sphere at one of its pixels, by the same operations in the same
    /// element type as in the kernel, which computes the normal divided by t.
    pub(super) fn normal_of_sphere(
        &self,
        nearest: NearestAtPixel<E>,
        window: &TileWindow,
        row: u32,
        column: u32,
        tile_spheres: &TileSpheres<E>,
    ) -> DVec3 {
        let index = nearest.id - 1;
        let inverse_t = nearest.inverse_t.to_f64();
        let Candidate { id, .. } = tile_spheres.candidates[index];
        let SphereRecords { spheres, .. } = self.records_of_all(self.plan.linear()).unwrap_or(&tile_spheres.records);
        let record = spheres[tile_spheres.places[index] as usize].widen();
        if record.around != 0.0 {
            let d = self.ray(window, column, row);
            return geometry::sphere_normal(
                self.plan.scale() / inverse_t * d,
                self.plan.spheres()[id as usize].centre.as_dvec3(),
            );
        }
        let [x, y] = [(window.column + column, record.column), (window.row + row, record.row)]
            .map(|(pixel, origin)| f64::from(pixel) - origin);
        let over_t = normal_over_t([size_of::<E>() == 4, self.kernels.fused], &record, x, y);
        DVec3::from(over_t) / inverse_t
    }
}
