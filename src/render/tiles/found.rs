//! The hits of a picture in tiles before shading, to measure errors, and the counts of what tiles cull.

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

    /// The result of `narrow` for the tiles that this tracer traces itself, combined with that of `wide` for those in
    /// f64; each is told which tiles are its own.
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

    /// Calls `say` for those tiles of `rows` that are its `own` and have objects, with their nearest objects.
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

    /// The counts for its `own` tiles of `rows`.
    fn survey(&self, rows: Range<u32>, own: &dyn Fn(TilePlace) -> bool) -> TileSurvey {
        let mut survey = TileSurvey::default();
        let mut candidates = Vec::new();
        self.each_tile(rows.clone(), |tile, _| survey.empty += u64::from(own(tile)));
        self.each_nearest(rows, own, |window, Scratch { buffers, objects, shadows, .. }| {
            candidates.clear();
            candidates.resize(objects.order.len(), false);
            pixels_of(window)
                .for_each(|(row, column)| candidates[buffers.pixel(self.kernels.lanes, column, row).1] = true);
            survey.empty -= u64::from(window.rows.start == 0);
            let placed = self.plan.count_in(window);
            survey.occluded += (placed - (objects.order.len() - 1 + objects.forgotten)) as u64;
            survey.placed += placed as u64;
            survey.unseen +=
                (objects.forgotten + candidates[1..].iter().filter(|candidate| !**candidate).count()) as u64;
            if let Some(of) = self.plan.shadows() {
                let scratch = shadows.get_or_insert_default();
                self.cast_shadows((of, false), window, buffers, objects, scratch);
                survey = survey.and(std::mem::take(&mut scratch.counts));
            }
        });
        survey
    }

    /// The number of spheres in the picture that have the short form in bytes.
    fn count_short(&self) -> u64 {
        let candidates: Vec<_> = self.plan.seen_spheres().filter(|candidate| candidate.most < Candidate::ANY).collect();
        let mut records = SphereRecords::default();
        let count = |candidates: &[Candidate]| {
            self.make_records(self.plan.levels(), candidates, &mut records);
            records.spheres[..candidates.len()].iter().filter(|sphere| sphere.short != E::ZERO).count() as u64
        };
        candidates.chunks(CHUNK).map(count).sum()
    }

    /// As [`Tracer::hits`], for its `own` tiles.
    pub(super) fn found(&self, rows: Range<u32>, own: &dyn Fn(TilePlace) -> bool) -> Vec<Option<Found>> {
        let width = self.plan.size()[0] as usize;
        let mut found = vec![None; rows.len() * width];
        let spheres = self.plan.spheres().len();
        self.each_nearest(rows.clone(), own, |window, scratch| {
            for (row, column) in pixels_of(window) {
                let (near, who) = scratch.buffers.pixel(self.kernels.lanes, column, row);
                if who > 0 {
                    let place = scratch.objects.order[who] as usize - 1;
                    let (object, normal) = match place.checked_sub(spheres) {
                        None => {
                            let normal =
                                self.normal_of_sphere((who, near), (window, row, column), &scratch.objects.spheres);
                            (Object::Sphere(place), normal)
                        }
                        // From the scene: kernels have only its product with each light.
                        Some(i) => {
                            let corners = self.plan.scene().triangle(i).vertices.map(|v| v.as_dvec3());
                            (Object::Triangle(i), geometry::triangle_plane(corners).normalize())
                        }
                    };
                    let distance = Distance::Inverse(near.to_f64() / self.plan.inverse_unit());
                    let place = (window.row as usize + row - rows.start as usize) * width;
                    let at = place + window.column as usize + column;
                    found[at] = Some(Found { object, distance, normal: Some(normal) });
                }
            }
        });
        found
    }

    pub(super) fn ray(&self, window: &TileWindow, column: u32, row: u32) -> DVec3 {
        self.plan.ray(window.row + row, window.column + column)
    }
}

/// The rows and columns of a tile within a window.
fn pixels_of(window: &TileWindow) -> impl Iterator<Item = (usize, usize)> {
    let (rows, columns) = (window.rows.start as usize..window.rows.end as usize, window.columns as usize);
    rows.flat_map(move |row| (0..columns).map(move |column| (row, column)))
}
