//! The packet engines: the nearest hit of each pixel, tile by tile, then shaded once.

mod found;
mod interleaved;
mod nearest;
mod shadows;
mod spheres;

pub use interleaved::Interleaved;

use std::ops::Range;
use std::sync::{Mutex, OnceLock, PoisonError};

use self::nearest::{Scratch, SoFar, TileObjects};
use super::{Counted, FilmMut, Found, Pixel, PixelFormat, Tracer, Wanted, assert_rows, existing};
use crate::kernels::{
    Element, ElementKernels, Narrow, PacketKernels, Plain, Rgba8, ShadeTile, ShadingRecords, SphereRecords,
    TILE_HEIGHT, TILE_WIDTH, TileBuffers, TileOut, TileWindow, Vec4,
};
use crate::plan::{Keep, Omission, Raster, Report, TilePlace, Tiles, Weighted};
use crate::scene::Scene;

/// One thread has traced this many objects in many tiles, and so many entries in lists of tiles, in a picture of this many
/// pixels, before another one has memory for its part.
const FEW: usize = 8;
const FEW_LISTED: usize = 1 << 12;
const QUICK: u64 = 1 << 21;

/// Each object of a tile, and each pixel that is in shadows of its own, has a record of what each light does there. For more
/// of these a tile forgets the objects that have no pixel, and is traced in parts, row by row at the least.
const MOST_EFFECTS: usize = 1 << 22;

/// The most lights: a row of a tile in shadows, before it and after it, then has records to which 32 bits can point.
pub const MOST_LIGHTS: usize = 1 << 18;

/// A scene planned for tiles, and the kernels that trace it.
pub struct TileTracer<'a, E: Element> {
    packets: &'static PacketKernels,
    kernels: &'static ElementKernels<E>,
    /// Whether shades may come from estimates in floats too.
    fast: bool,
    plan: Tiles<'a, E>,
    /// The records of all spheres, if they are few, in linear floats and in levels.
    records: [OnceLock<SphereRecords<E>>; 2],
    /// Traces the tiles that have an object whose numbers are beyond f32.
    wide: Option<Box<TileTracer<'a, f64>>>,
    /// The memory of threads that are done with their rows, to be reused.
    free: Mutex<Vec<Scratches<E>>>,
}

impl<'a, E: Element> TileTracer<'a, E> {
    /// Plans `scene` for `kernels` of one element type, with estimates if `fast`; see [`Tiles::new`].
    pub fn new(
        packets: &'static PacketKernels,
        (kernels, fast): (&'static ElementKernels<E>, bool),
        (scene, raster): (&'a Scene, Raster),
        (keep, threads): (Keep, usize),
    ) -> Self {
        let plan = Tiles::new(scene, raster, packets, keep, threads);
        let wide = || Box::new(TileTracer::of(packets, &packets.double, plan.in_f64(packets, threads)));
        TileTracer { wide: plan.any_wide().then(wide), fast, ..Self::of(packets, kernels, plan) }
    }

    fn of(packets: &'static PacketKernels, kernels: &'static ElementKernels<E>, plan: Tiles<'a, E>) -> Self {
        TileTracer {
            packets,
            kernels,
            fast: false,
            plan,
            records: Default::default(),
            wide: None,
            free: Mutex::default(),
        }
    }

    /// See [`Tiles::is_valid`].
    pub fn is_valid(&self) -> bool {
        self.plan.is_valid()
    }
}

/// The differences between the outputs of four channels, from which those of three are made.
trait Output<E: Element>: Pixel + Plain {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted;
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self>;
}

impl<E: Element> Output<E> for Vec4 {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted {
        plan.linear()
    }
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self> {
        if tracer.fast { &tracer.kernels.tiles.f32x4_fast } else { &tracer.kernels.tiles.f32x4 }
    }
}

impl<E: Element> Output<E> for Rgba8 {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted {
        plan.levels()
    }
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self> {
        &tracer.kernels.tiles.rgba8
    }
}

/// The memory of a thread beside the plan, for its own tiles and for those in f64.
type Scratches<E> = (Scratch<E>, Option<Scratch<f64>>);

/// What to do with pixels without a hit, and with the others.
struct Misses<P> {
    /// The background; None: black.
    rest: Option<P>,
    /// The number of hits so far, if they are counted.
    hits: Option<u64>,
}

impl<E: Element> TileTracer<'_, E> {
    /// Traces rows; returns the number of hits, if they are to be `counted`.
    fn trace_film(&self, rows: Range<u32>, out: FilmMut<'_>, counted: bool) -> Option<u64> {
        let (wanted, hits): (&Wanted<'_>, _) = (&|rows, _| rows, counted.then_some(0));
        match out {
            FilmMut::F32x4(out) => self.trace(rows, wanted, out, Misses { rest: None, hits }),
            FilmMut::F32x3(out) => self.trace_three(rows, out, &self.packets.narrow_f32x3, hits),
            FilmMut::Rgba8(out) => self.trace(rows, wanted, out, Misses { rest: None, hits }),
            FilmMut::Rgb8(out) => self.trace_three(rows, out, &self.packets.narrow_rgb8, hits),
        }
    }

    /// Traces the `wanted` tiles of rows; returns the number of hits, if they are counted.
    fn trace<P: Output<E> + Output<f64>>(
        &self,
        rows: Range<u32>,
        wanted: &Wanted<'_>,
        out: &mut [P],
        mut misses: Misses<P>,
    ) -> Option<u64> {
        let width = self.plan.size()[0] as usize;
        assert_rows(&rows, self.plan.size(), out.len());
        let (mut scratches, rest) = (self.scratches(), misses.rest.unwrap_or(P::of_linear(&Vec4::ZERO)));
        self.each_wanted(rows.clone(), wanted, |tile, window| {
            let first = first_pixel(window, &rows, width);
            let own = TileOut { pixels: &mut *out, first, width };
            if !self.trace_tile(tile, window, own, &mut scratches, &mut misses) {
                rows_of(out, window, first, width).for_each(|row| row.fill(rest));
            }
        });
        self.put_back(scratches);
        misses.hits
    }

    /// Traces in four channels, tile by tile, and narrows them to three.
    fn trace_three<T: Plain, Four: Output<E> + Output<f64>>(
        &self,
        rows: Range<u32>,
        out: &mut [[T; 3]],
        narrow: &Narrow<Four, [T; 3]>,
        hits: Option<u64>,
    ) -> Option<u64> {
        let width = self.plan.size()[0] as usize;
        assert_rows(&rows, self.plan.size(), out.len());
        let (mut scratches, mut misses) = (self.scratches(), Misses { rest: None, hits });
        let mut four = vec![Four::ZERO; TILE_WIDTH * TILE_HEIGHT];
        self.each_tile(rows.clone(), |tile, window| {
            let first = first_pixel(window, &rows, width);
            let own = TileOut { pixels: &mut four, first: 0, width: TILE_WIDTH };
            let is_empty = !self.trace_tile(tile, window, own, &mut scratches, &mut misses);
            for (four, row) in four.chunks(TILE_WIDTH).zip(rows_of(out, window, first, width)) {
                if is_empty {
                    row.as_flattened_mut().fill(T::ZERO);
                } else {
                    narrow.call(&four[..row.len()], row);
                }
            }
        });
        self.put_back(scratches);
        misses.hits
    }

    fn scratches(&self) -> Scratches<E> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn put_back(&self, scratches: Scratches<E>) {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).push(scratches);
    }

    /// Traces a tile in the elements that hold its objects; false, and nothing written, if no object can be in it.
    fn trace_tile<P: Output<E> + Output<f64>>(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        out: TileOut<'_, P>,
        (scratch, wide_scratch): &mut Scratches<E>,
        misses: &mut Misses<P>,
    ) -> bool {
        let top = window.rows.start;
        self.parts(window).all(|window| {
            let window = &window;
            let first = out.first + (window.rows.start - top) as usize * out.width;
            let out = TileOut { pixels: &mut *out.pixels, first, width: out.width };
            match &self.wide {
                Some(wide) if self.plan.is_wide(tile) => {
                    wide.trace_own(tile, window, out, wide_scratch.get_or_insert_default(), misses)
                }
                _ => self.trace_own(tile, window, out, scratch, misses),
            }
        })
    }

    /// A window in parts of so many rows that [`MOST_EFFECTS`] holds. If no object can be in the first, none can be in the tile.
    fn parts(&self, window: &TileWindow) -> impl Iterator<Item = TileWindow> + use<E> {
        let lights = self.plan.points().len().max(1);
        let most = (MOST_EFFECTS / (lights * TILE_WIDTH)).clamp(1, TILE_HEIGHT);
        let TileWindow { column, row, columns, rows } = window.clone();
        let part =
            move |start: u32| TileWindow { column, row, columns, rows: start..rows.end.min(start + most as u32) };
        window.rows.clone().step_by(most).map(part)
    }

    /// Calls `say` for all tiles of `rows` with their windows within these.
    fn each_tile(&self, rows: Range<u32>, mut say: impl FnMut(TilePlace, &TileWindow)) {
        let (width, height) = (self.plan.size()[0], TILE_HEIGHT as u32);
        if rows.is_empty() {
            return;
        }
        for down in rows.start / height..rows.end.div_ceil(height) {
            let first = down * height;
            let tile_rows = rows.start.max(first)..rows.end.min(first + height);
            for across in 0..width.div_ceil(TILE_WIDTH as u32) {
                let column = across * TILE_WIDTH as u32;
                let window = TileWindow {
                    column,
                    row: first,
                    columns: (width - column).min(TILE_WIDTH as u32),
                    rows: tile_rows.start - first..tile_rows.end - first,
                };
                say(TilePlace { across, down }, &window);
            }
        }
    }

    /// The same for tiles with `wanted` pixels, and only for the rows of them that these need.
    fn each_wanted(&self, rows: Range<u32>, wanted: &Wanted<'_>, mut say: impl FnMut(TilePlace, &TileWindow)) {
        self.each_tile(rows, |tile, window| {
            let TileWindow { column, row, columns, .. } = *window;
            let all = row + window.rows.start..row + window.rows.end;
            let rows = wanted(all.clone(), column..column + columns);
            let rows = rows.start.max(all.start)..rows.end.min(all.end);
            if !rows.is_empty() {
                say(tile, &TileWindow { rows: rows.start - row..rows.end - row, ..*window });
            }
        });
    }

    fn trace_own<P: Output<E>>(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        out: TileOut<'_, P>,
        scratch: &mut Scratch<E>,
        misses: &mut Misses<P>,
    ) -> bool {
        let weighted = P::weighted(&self.plan);
        let (_, rays) = self.plan.view(tile);
        let TileOut { pixels, first, width } = out;
        let mut shade = |buffers: &TileBuffers<E>, TileObjects { shades, spheres, .. }: &TileObjects<E>| {
            let SphereRecords { spheres: records, lits, shorts } =
                self.records_of_all(weighted).unwrap_or(&spheres.records);
            let records = ShadingRecords {
                shades,
                lights: self.plan.points(),
                sphere_ids: &spheres.places,
                spheres: records,
                lits,
                shorts,
            };
            P::shade(self).call(&rays, buffers, records, window, TileOut { pixels: &mut *pixels, first, width });
        };
        let by_force = self.plan.keep().has(Omission::Unseen).then_some(&mut shade as SoFar<'_, E>);
        if !self.find_nearest(tile, window, by_force, weighted, scratch) {
            return false;
        }
        if let Some(of) = self.plan.shadows() {
            let Scratch { buffers, objects, shadows, .. } = scratch;
            self.cast_shadows((of, true), window, buffers, objects, shadows.get_or_insert_default());
        }
        let Scratch { buffers, objects, .. } = scratch;
        let hits = misses.hits.as_mut().map(|sum| {
            let hits = buffers.count_hits(self.kernels.lanes, window);
            *sum += hits;
            hits
        });
        shade(buffers, objects);
        let all = u64::from(window.columns) * window.rows.len() as u64;
        if let Some(rest) = misses.rest.filter(|_| hits != Some(all)) {
            buffers.fill_rest(self.kernels.lanes, window, rest, TileOut { pixels: &mut *pixels, first, width });
        }
        true
    }
}

/// The rows of a window's pixels in a film, of which this is the first.
fn rows_of<'a, P>(
    out: &'a mut [P],
    window: &TileWindow,
    first: usize,
    width: usize,
) -> impl Iterator<Item = &'a mut [P]> {
    let columns = window.columns as usize;
    out[first..].chunks_mut(width).take(window.rows.len()).map(move |row| &mut row[..columns])
}

/// The index of a window's first pixel in a film of these rows.
fn first_pixel(window: &TileWindow, rows: &Range<u32>, width: usize) -> usize {
    (window.row + window.rows.start - rows.start) as usize * width + window.column as usize
}

impl<E: Element> Tracer for TileTracer<'_, E> {
    fn report(&self, bytes: bool) -> Option<Report> {
        Some(Report::of_tiles(&[&self.plan], self.survey_all(), bytes))
    }

    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let rows = existing(rows, self.plan.size()[1]);
        let both = |narrow: Vec<Option<Found>>, wide: Vec<_>| {
            narrow.into_iter().zip(wide).map(|(narrow, wide)| narrow.or(wide)).collect()
        };
        self.ask_both(|own| self.found(rows.clone(), own), |wide, own| wide.found(rows.clone(), own), both)
    }

    fn is_quick(&self) -> bool {
        let ([large, listed], [width, height]) = (self.plan.counts(), self.plan.size());
        let few = large <= FEW && listed <= FEW_LISTED && self.plan.shadows().is_none();
        few && u64::from(width) * u64::from(height) <= QUICK
    }

    fn rows_together(&self) -> u32 {
        TILE_HEIGHT as u32
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        self.trace_film(rows, out, false);
    }

    fn light(&self, rows: Range<u32>, wanted: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        let (rays, rest) = (out.len() as u64, Some(background).filter(|light| *light != Vec4::default()));
        let hits = self.trace(rows, wanted, out, Misses { rest, hits: Some(0) });
        hits.map(|hits| Counted { rays, hits })
    }

    fn counted_rows(&self, rows: Range<u32>, out: FilmMut<'_>) -> Option<Counted> {
        let rays = out.len() as u64;
        self.trace_film(rows, out, true).map(|hits| Counted { rays, hits })
    }
}
