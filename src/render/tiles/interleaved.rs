//! Pictures with a side too long for tiles: several pictures of every n-th pixel, interleaved.

use std::ops::Range;

use super::TileTracer;
use crate::kernels::{Element, Vec4};
use crate::plan::{Report, TileSurvey};
use crate::render::film::with_pixels;
use crate::render::{Counted, FilmMut, Found, Pixel, PixelFormat, Tracer, Wanted, assert_rows, existing};
use crate::scene::Camera;

/// A scene planned for the [rasters](crate::plan::Raster::of) of its picture.
pub struct Interleaved<'a, E: Element> {
    /// Pixels in a row, and rows.
    size: [usize; 2],
    parts: Vec<TileTracer<'a, E>>,
}

impl<'a, E: Element> Interleaved<'a, E> {
    /// The tracer of a camera's picture with these parts.
    pub fn new(camera: &Camera, parts: Vec<TileTracer<'a, E>>) -> Self {
        Interleaved { size: [camera.width() as usize, camera.height() as usize], parts }
    }

    /// Calls `say` for each part with those of its rows that are among `rows`, and the places of their pixels in these.
    fn each_part(
        &self,
        rows: &Range<u32>,
        mut say: impl FnMut(&TileTracer<'a, E>, Range<u32>, &dyn Fn(usize) -> usize),
    ) {
        for part in &self.parts {
            let (raster, columns) = (part.plan.raster(), part.plan.size()[0] as usize);
            let ([across, down], every) = (raster.first.map(|first| first as usize), raster.every as usize);
            // The number of its rows before a row of the picture.
            let before = |row: u32| (row as usize).saturating_sub(down).div_ceil(every);
            let own = before(rows.start)..before(rows.end);
            let place = |i: usize| {
                let row = down + (own.start + i / columns) * every - rows.start as usize;
                row * self.size[0] + across + i % columns * every
            };
            if !own.is_empty() {
                say(part, own.start as u32..own.end as u32, &place);
            }
        }
    }
}

impl<E: Element> Tracer for Interleaved<'_, E> {
    fn report(&self, bytes: bool) -> Option<Report> {
        let tiles: Vec<_> = self.parts.iter().map(|part| &part.plan).collect();
        let surveys: Vec<_> = self.parts.iter().map(TileTracer::survey_all).collect();
        let short = surveys.iter().map(|survey| survey.short).max().unwrap_or(0);
        let survey = surveys.into_iter().fold(TileSurvey::default(), TileSurvey::and);
        Some(Report::of_tiles(&tiles, TileSurvey { short, ..survey }, bytes))
    }

    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        assert_rows(&rows, self.size.map(|side| side as u32), out.len());
        with_pixels!(FilmMut(out) = out => self.each_part(&rows, |part, own, place| {
            let mut pixels = vec![out[0]; own.len() * part.plan.size()[0] as usize];
            part.rows(own, Pixel::film(&mut pixels));
            pixels.into_iter().enumerate().for_each(|(i, pixel)| out[place(i)] = pixel);
        }));
    }

    fn light(&self, rows: Range<u32>, _: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        assert_rows(&rows, self.size.map(|side| side as u32), out.len());
        let mut counted = Some(Counted::default());
        self.each_part(&rows, |part, own, place| {
            let mut pixels = vec![Vec4::default(); own.len() * part.plan.size()[0] as usize];
            let of_part = part.light(own, &|rows, _| rows, background, &mut pixels);
            counted = counted.zip(of_part).map(|(sum, of_part)| sum + of_part);
            pixels.into_iter().enumerate().for_each(|(i, pixel)| out[place(i)] = pixel);
        });
        counted
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let rows = existing(rows, self.size[1] as u32);
        let mut hits = vec![None; rows.len() * self.size[0]];
        self.each_part(&rows, |part, own, place| {
            part.hits(own).into_iter().enumerate().for_each(|(i, hit)| hits[place(i)] = hit);
        });
        hits
    }
}
