//! The hits of a picture in tiles, for measuring errors, and counts of what tiles cull.

use std::ops::Range;

use glam::DVec3;

use super::TileTracer;
use super::nearest::Scratch;
use crate::kernels::{CHUNK, Candidate, Element, SphereRecords, TILE_HEIGHT, TileWindow};
use crate::plan::{TilePlace, TileSurvey, on_all_cores};
use crate::reference::geometry;
use crate::render::{Distance, Found};
use crate::scene::Object;

impl<E: Element> TileTracer<'_, E> {
    /// The counts for the whole picture.
    pub(super) fn survey_all(&self) -> TileSurvey {
        let height = self.plan.size()[1];
        let surveys = on_all_cores((height as usize).div_ceil(TILE_HEIGHT), |down| {
            let start = (down * TILE_HEIGHT) as u32;
            let rows = start..height.min(start + TILE_HEIGHT as u32);
            self.ask_both(
                |own| self.survey(rows.clone(), own),
                |wide, own| wide.survey(rows.clone(), own),
                TileSurvey::and,
            )
        });
        let survey = surveys.into_iter().fold(TileSurvey::default(), TileSurvey::and);
        TileSurvey { short: self.count_short(), ..survey }
    }

    /// Combines the result of `narrow`, for the tiles that this tracer traces in its own element
    /// type, with the result of `wide`, for those that are traced in f64. Each is given a predicate
    /// that selects its tiles.
    pub(super) fn ask_both<T>(
        &self,
        narrow: impl FnOnce(&dyn Fn(TilePlace) -> bool) -> T,
        wide: impl FnOnce(&TileTracer<'_, f64>, &dyn Fn(TilePlace) -> bool) -> T,
        both: impl FnOnce(T, T) -> T,
    ) -> T {
        let own = narrow(&|tile| !self.plan.is_wide(tile));
        match &self.wide {
            Some(tracer) => both(own, wide(tracer, &|tile| self.plan.is_wide(tile))),
            None => own,
        }
    }

    /// Calls `say` for those tiles of `rows` that `own` selects and that have objects, with the
    /// nearest objects at their pixels.
    fn each_nearest(
        &self,
        rows: Range<u32>,
        own: &dyn Fn(TilePlace) -> bool,
        mut say: impl FnMut(&TileWindow, &mut Scratch<E>),
    ) {
        let mut scratch = Scratch::default();
        self.each_tile(rows, |tile, window| {
            for part in self.parts(window).filter(|_| own(tile)) {
                if !self.find_nearest(tile, &part, None, self.plan.linear(), &mut scratch) {
                    break;
                }
                say(&part, &mut scratch);
            }
        });
    }

    /// The counts for those tiles of `rows` that `own` selects.
    fn survey(&self, rows: Range<u32>, own: &dyn Fn(TilePlace) -> bool) -> TileSurvey {
        let mut survey = TileSurvey::default();
        let mut owners = Vec::new();
        self.each_tile(rows.clone(), |tile, _| survey.empty += u64::from(own(tile)));
        self.each_nearest(rows, own, |window, scratch| {
            survey.empty -= u64::from(window.rows.start == 0);
            survey = survey.and(self.survey_window(window, &mut owners, scratch));
        });
        survey
    }

    /// The counts for a tile, or a part of one, whose nearest objects have been found. `owners` is
    /// scratch memory.
    fn survey_window(&self, window: &TileWindow, owners: &mut Vec<bool>, scratch: &mut Scratch<E>) -> TileSurvey {
        let Scratch { buffers, objects, shadows, .. } = scratch;
        owners.clear();
        owners.resize(objects.order.len(), false);
        for (row, column) in pixels_of(window) {
            owners[buffers.pixel(self.kernels.lanes, column, row).id] = true;
        }
        let placed = self.plan.count_in(window);
        let without_pixel = owners[1..].iter().filter(|owns| !**owns).count();
        let survey = TileSurvey {
            occluded: (placed - (objects.order.len() - 1 + objects.forgotten)) as u64,
            placed: placed as u64,
            unseen: (objects.forgotten + without_pixel) as u64,
            ..TileSurvey::default()
        };
        let Some(planned) = self.plan.shadows() else { return survey };
        let scratch = shadows.get_or_insert_default();
        self.cast_shadows(planned, false, window, buffers, objects, scratch);
        survey.and(std::mem::take(&mut scratch.counts))
    }

    /// How many spheres of the picture have the short form in bytes.
    fn count_short(&self) -> u64 {
        let candidates: Vec<_> = self.plan.seen_spheres().filter(|candidate| candidate.most < Candidate::ANY).collect();
        let mut records = SphereRecords::default();
        let count = |candidates: &[Candidate]| {
            self.make_records(self.plan.levels(), candidates, &mut records);
            records.spheres[..candidates.len()].iter().filter(|sphere| sphere.short != E::ZERO).count() as u64
        };
        candidates.chunks(CHUNK).map(count).sum()
    }

    /// As `Tracer::hits`, for only those tiles that `own` selects.
    pub(super) fn found(&self, rows: Range<u32>, own: &dyn Fn(TilePlace) -> bool) -> Vec<Option<Found>> {
        let width = self.plan.size()[0] as usize;
        let mut found = vec![None; rows.len() * width];
        self.each_nearest(rows.clone(), own, |window, scratch| {
            for (row, column) in pixels_of(window) {
                let place = (window.row as usize + row - rows.start as usize) * width;
                let at = place + window.column as usize + column;
                found[at] = self.found_at(window, row, column, scratch);
            }
        });
        found
    }

    /// The hit at a pixel of a tile whose nearest objects have been found.
    fn found_at(&self, window: &TileWindow, row: usize, column: usize, scratch: &Scratch<E>) -> Option<Found> {
        let nearest = scratch.buffers.pixel(self.kernels.lanes, column, row);
        if nearest.id == 0 {
            return None;
        }
        let place = scratch.objects.order[nearest.id] as usize - 1;
        let distance = Distance::Inverse(nearest.inverse_t.to_f64() / self.plan.inverse_unit());
        Some(match place.checked_sub(self.plan.spheres().len()) {
            None => {
                let normal =
                    self.normal_of_sphere(nearest, window, row as u32, column as u32, &scratch.objects.spheres);
                Found { object: Object::Sphere(place), distance, normal: Some(normal) }
            }
            // The normal is computed from the scene, since the kernels only have its products with
            // the lights.
            Some(i) => {
                let corners = self.plan.scene().triangle(i).vertices.map(|v| v.as_dvec3());
                let normal = geometry::triangle_plane(corners).normalize();
                Found { object: Object::Triangle(i), distance, normal: Some(normal) }
            }
        })
    }

    pub(super) fn ray(&self, window: &TileWindow, column: u32, row: u32) -> DVec3 {
        self.plan.ray(window.row + row, window.column + column)
    }
}

/// The rows and columns of the tile's pixels that are in a window.
fn pixels_of(window: &TileWindow) -> impl Iterator<Item = (usize, usize)> {
    let (rows, columns) = (window.rows.start as usize..window.rows.end as usize, window.columns as usize);
    rows.flat_map(move |row| (0..columns).map(move |column| (row, column)))
}
