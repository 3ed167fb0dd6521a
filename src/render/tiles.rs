//! Packet engines in tiles: they find the nearest hit of each pixel, and then shade it once.

mod found;
mod hidden;
mod kept;
mod nearest;
mod shadows;
mod spheres;

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use self::kept::KEPT;
use self::nearest::{NearestSoFar, Scratch, TileObjects};
use super::film::{narrow, rgba_to_bgra};
use super::plan::PacketKernelSet;
use super::{Counted, FilmMut, Found, Pixel, PixelFormat, Tracer, Wanted, assert_rows, existing};
use crate::kernels::{
    Element, ElementKernels, PacketKernels, Plain, Rgba8, ShadeTile, ShadingRecords, SphereRecords, TILE_HEIGHT,
    TILE_WIDTH, TileBuffers, TileOut, TileWindow, Vec4,
};
use crate::plan::{Omission, PlanOptions, Report, TilePlace, Tiles, Weighted};
use crate::scene::Scene;

/// The limits of a picture that one thread finishes before the memory for another thread's part
/// would be ready: the number of large objects, of entries in bins, and of pixels.
const FEW: usize = 8;
const FEW_LISTED: usize = 1 << 12;
const QUICK: u64 = 1 << 21;

/// The number of effects that a tile may have. An effect is a record of one light for one object,
/// or for a pixel whose shadows make it a separate object. With more, a tile drops the objects
/// without a pixel, and is traced in parts, of a single row if need be.
const MOST_EFFECTS: usize = 1 << 22;

/// The number of lights that a scene may have. With more, 32 bits could not hold the byte offsets
/// of the shading records of a single row of a tile, which is the least part that is traced:
/// shadows may make a separate object of each of its pixels, and each object has a record for every
/// light.
pub const MOST_LIGHTS: usize = 1 << 18;

/// A scene that is planned for tiles, with the kernels that trace it.
pub struct TileTracer<'a, E: Element> {
    packets: &'static PacketKernels,
    kernels: &'static ElementKernels<E>,
    /// Whether floats too may be computed with estimates of roots. Bytes always are.
    estimates: bool,
    plan: Tiles<'a, E>,
    /// The records of all spheres, if there are few: for linear floats, and for levels.
    records: [OnceLock<SphereRecords<E>>; 2],
    /// Traces the tiles that have an object whose numbers f32 cannot hold.
    wide: Option<Box<TileTracer<'a, f64>>>,
    free: FreeScratches<E>,
}

impl<'a, E: Element> TileTracer<'a, E> {
    /// Plans `scene` for these kernels; see [`Tiles::new`].
    pub fn new(kernels: PacketKernelSet<E>, scene: &'a Scene, options: PlanOptions<'_>) -> Self {
        let packets = kernels.packets;
        let plan = Tiles::new(scene, packets, options);
        let in_f64 = PacketKernelSet { packets, element: &packets.double, estimates: false };
        let wide = || Box::new(TileTracer::with_plan(in_f64, plan.in_f64(packets, options)));
        TileTracer { wide: plan.any_wide().then(wide), ..Self::with_plan(kernels, plan) }
    }

    /// The tracer of a plan without tiles in f64.
    fn with_plan(kernels: PacketKernelSet<E>, plan: Tiles<'a, E>) -> Self {
        let PacketKernelSet { packets, element, estimates } = kernels;
        TileTracer {
            packets,
            kernels: element,
            estimates,
            plan,
            records: Default::default(),
            wide: None,
            free: FreeScratches::default(),
        }
    }

    /// See [`Tiles::is_valid`].
    pub fn is_valid(&self) -> bool {
        self.plan.is_valid()
    }
}

/// An output of four channels, floats or bytes. Pixels of other formats are converted from one of
/// the two.
trait Output<E: Element>: Pixel + Plain {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted;
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self>;
}

impl<E: Element> Output<E> for Vec4 {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted {
        plan.linear()
    }
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self> {
        if tracer.estimates { &tracer.kernels.tiles.f32x4_fast } else { &tracer.kernels.tiles.f32x4 }
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

/// The scratch memory of a thread.
#[derive(Default)]
struct Scratches<E: Element> {
    /// Scratch memory for tiles in the tracer's own element type.
    own: Scratch<E>,
    /// Scratch memory for tiles in f64.
    wide: Option<Scratch<f64>>,
}

/// The scratch memory of threads that have finished their rows; others reuse it.
#[derive(Default)]
struct FreeScratches<E: Element>(Mutex<Vec<Scratches<E>>>);

impl<E: Element> FreeScratches<E> {
    fn lock(&self) -> MutexGuard<'_, Vec<Scratches<E>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<E: Element> Drop for FreeScratches<E> {
    /// Keeps some of the memory for the next pictures.
    fn drop(&mut self) {
        for Scratches { own: scratch, .. } in self.lock().drain(..) {
            if let Some(scratch) = scratch.for_other_plans() {
                KEPT.give(Scratches { own: scratch, wide: None });
            }
        }
    }
}

/// What to do with pixels without a hit, and whether to count hits.
struct HitOptions<P> {
    /// The colour of pixels without a hit; None leaves them black.
    miss_colour: Option<P>,
    /// The number of hits so far, if they are counted.
    hit_count: Option<u64>,
}

impl<E: Element> TileTracer<'_, E> {
    /// Traces rows. Returns the number of hits if `counted`.
    fn trace_film(&self, rows: Range<u32>, out: FilmMut<'_>, counted: bool) -> Option<u64> {
        let all: &Wanted<'_> = &|rows, _| rows;
        let hit_count = counted.then_some(0);
        match out {
            FilmMut::F32x4(out) => self.trace(rows, all, out, HitOptions { miss_colour: None, hit_count }),
            FilmMut::F32x3(out) => self.trace_others(rows, out, narrow(&self.packets.narrow_f32x3), hit_count),
            FilmMut::Rgba8(out) => self.trace(rows, all, out, HitOptions { miss_colour: None, hit_count }),
            FilmMut::Rgb8(out) => self.trace_others(rows, out, narrow(&self.packets.narrow_rgb8), hit_count),
            FilmMut::Bgra8(out) => self.trace_others(rows, out, rgba_to_bgra, hit_count),
        }
    }

    /// Traces the `wanted` tiles of rows. Returns the number of hits, if they are counted.
    fn trace<P: Output<E> + Output<f64>>(
        &self,
        rows: Range<u32>,
        wanted: &Wanted<'_>,
        out: &mut [P],
        mut options: HitOptions<P>,
    ) -> Option<u64> {
        let width = self.plan.size()[0] as usize;
        assert_rows(&rows, self.plan.size(), out.len());
        let mut scratches = self.scratches();
        let miss_colour = options.miss_colour.unwrap_or(P::of_linear(&Vec4::ZERO));
        self.each_wanted(rows.clone(), wanted, |tile, window| {
            let first = first_pixel(window, &rows, width);
            let own = TileOut { pixels: &mut *out, first, width };
            if !self.trace_tile(tile, window, own, &mut scratches, &mut options) {
                rows_of(out, window, first, width).for_each(|row| row.fill(miss_colour));
            }
        });
        self.put_back(scratches);
        options.hit_count
    }

    /// Traces in four channels, tile by tile, and converts rows of pixels by `convert`.
    fn trace_others<Four: Output<E> + Output<f64>, P: Pixel>(
        &self,
        rows: Range<u32>,
        out: &mut [P],
        convert: impl Fn(&[Four], &mut [P]),
        hit_count: Option<u64>,
    ) -> Option<u64> {
        let width = self.plan.size()[0] as usize;
        assert_rows(&rows, self.plan.size(), out.len());
        let mut scratches = self.scratches();
        let mut options = HitOptions { miss_colour: None, hit_count };
        let mut four = vec![Four::ZERO; TILE_WIDTH * TILE_HEIGHT];
        self.each_tile(rows.clone(), |tile, window| {
            let first = first_pixel(window, &rows, width);
            let own = TileOut { pixels: &mut four, first: 0, width: TILE_WIDTH };
            let is_empty = !self.trace_tile(tile, window, own, &mut scratches, &mut options);
            for (four, row) in four.chunks(TILE_WIDTH).zip(rows_of(out, window, first, width)) {
                if is_empty {
                    row.fill(P::of_linear(&Vec4::ZERO));
                } else {
                    convert(&four[..row.len()], row);
                }
            }
        });
        self.put_back(scratches);
        options.hit_count
    }

    fn scratches(&self) -> Scratches<E> {
        self.free.lock().pop().or_else(|| KEPT.take()).unwrap_or_default()
    }

    fn put_back(&self, scratches: Scratches<E>) {
        self.free.lock().push(scratches);
    }

    /// Traces a tile, in f64 if f32 cannot hold its objects. Returns false, and writes nothing, if
    /// no object can be in the tile.
    fn trace_tile<P: Output<E> + Output<f64>>(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        out: TileOut<'_, P>,
        scratches: &mut Scratches<E>,
        options: &mut HitOptions<P>,
    ) -> bool {
        let top = window.rows.start;
        self.parts(window).all(|window| {
            let window = &window;
            let first = out.first + (window.rows.start - top) as usize * out.width;
            let out = TileOut { pixels: &mut *out.pixels, first, width: out.width };
            match &self.wide {
                Some(wide) if self.plan.is_wide(tile) => {
                    wide.trace_own(tile, window, out, scratches.wide.get_or_insert_default(), options)
                }
                _ => self.trace_own(tile, window, out, &mut scratches.own, options),
            }
        })
    }

    /// Divides a window into parts with so few rows that each has at most [`MOST_EFFECTS`]. If no
    /// object can be in the first part, none can be in the tile.
    fn parts(&self, window: &TileWindow) -> impl Iterator<Item = TileWindow> + use<E> {
        let lights = self.plan.points().len().max(1);
        let most = (MOST_EFFECTS / (lights * TILE_WIDTH)).clamp(1, TILE_HEIGHT);
        let TileWindow { column, row, columns, rows } = window.clone();
        let part =
            move |start: u32| TileWindow { column, row, columns, rows: start..rows.end.min(start + most as u32) };
        window.rows.clone().step_by(most).map(part)
    }

    /// Calls `say` for every tile that contains some of `rows`, with the window of these rows.
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

    /// As [`each_tile`](Self::each_tile), but only for tiles with `wanted` pixels, and with windows
    /// of the rows that have these.
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
        options: &mut HitOptions<P>,
    ) -> bool {
        let weighted = P::weighted(&self.plan);
        let rays = self.plan.rays(tile);
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
        let by_force = self.plan.keep().has(Omission::Unseen).then_some(&mut shade as NearestSoFar<'_, E>);
        if !self.find_nearest(tile, window, by_force, weighted, scratch) {
            return false;
        }
        if let Some(of) = self.plan.shadows() {
            let Scratch { buffers, objects, shadows, .. } = scratch;
            self.cast_shadows(of, true, window, buffers, objects, shadows.get_or_insert_default());
        }
        let Scratch { buffers, objects, .. } = scratch;
        let hits = options.hit_count.as_mut().map(|sum| {
            let hits = buffers.count_hits(self.kernels.lanes, window);
            *sum += hits;
            hits
        });
        shade(buffers, objects);
        let all = u64::from(window.columns) * window.rows.len() as u64;
        if let Some(colour) = options.miss_colour.filter(|_| hits != Some(all)) {
            buffers.fill_rest(self.kernels.lanes, window, colour, TileOut { pixels: &mut *pixels, first, width });
        }
        true
    }
}

/// The part of each row of a film that belongs to a window; `out` begins with the window's first
/// pixel.
fn rows_of<'a, P>(
    out: &'a mut [P],
    window: &TileWindow,
    first: usize,
    width: usize,
) -> impl Iterator<Item = &'a mut [P]> {
    let columns = window.columns as usize;
    out[first..].chunks_mut(width).take(window.rows.len()).map(move |row| &mut row[..columns])
}

/// The index of a window's first pixel in a film that holds `rows`.
fn first_pixel(window: &TileWindow, rows: &Range<u32>, width: usize) -> usize {
    (window.row + window.rows.start - rows.start) as usize * width + window.column as usize
}

impl<E: Element> Tracer for TileTracer<'_, E> {
    fn report(&self, bytes: bool) -> Option<Report> {
        Some(Report::of_tiles(&self.plan, self.survey_all(), bytes))
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
        let rays = out.len() as u64;
        let miss_colour = Some(background).filter(|light| *light != Vec4::default());
        let hits = self.trace(rows, wanted, out, HitOptions { miss_colour, hit_count: Some(0) });
        hits.map(|hits| Counted { rays, hits })
    }

    fn counted_rows(&self, rows: Range<u32>, out: FilmMut<'_>) -> Option<Counted> {
        let rays = out.len() as u64;
        self.trace_film(rows, out, true).map(|hits| Counted { rays, hits })
    }
}
