//! The engines of packets: the nearest of each pixel tile by tile, then shaded once.

mod interleaved;
mod normals;

pub use interleaved::Interleaved;

use std::ops::Range;
use std::sync::{Mutex, OnceLock, PoisonError};

use glam::DVec3;

use super::plan::PacketPlan;
use super::{Counted, Distance, FilmMut, Found, Pixel, PixelFormat, Tracer, Wanted};
use crate::kernels::{
    AroundSphere, CHUNK, Candidate, Element, ElementKernels, Fill, Narrow, ObjectList, PacketKernels, Parts, Plain,
    Rgba8, ShadeTile, ShadingRecords, SphereChunk, SphereRecords, TILE_HEIGHT, TILE_WIDTH, TileBuffers, TileOut,
    TileShade, TileView, TileWindow, TriangleChunk, Vec4, sys,
};
use crate::plan::{Keep, LargeObjects, Omission, Raster, Report, TilePlace, TileSurvey, Tiles, Weighted, on_all_cores};
use crate::scene::{Object, Scene};

/// In a tile of fewer triangles, or spheres, it costs more to find out which of them others hide than to try them.
const FEWEST_HIDDEN: usize = 64;

/// The same where they cover the tile more often than [`DEEP`].
const FEWEST_DEEP: usize = 16;

/// What covers a tile more often is cut in two once more, and its nearer part traced first.
const DEEP: u32 = 4;

/// And more often than this it is not: what is left is as near.
const MOST_LAYERS: usize = 24;

/// So many of a tile's objects that are in many tiles are looked at with the others, the nearest of them; and then, where
/// something may yet be hidden by nobody, so many times as many as before.
const LARGE_AT_FIRST: usize = 64;
const LARGE_MORE: usize = 4;

/// How often the bounds of what is `seen`, by a sample of a few, cover the window.
fn covers(candidates: &[Candidate], window: &TileWindow) -> u32 {
    let step = candidates.len().div_ceil(8);
    // Of what is small bounds are more than it covers: by a pixel about.
    let length = |bounds: u32, first: u32, side: usize| {
        (bounds >> 16).min(first + side as u32).saturating_sub((bounds & 0xffff).max(first) + 1)
    };
    let area = |candidate: &Candidate| {
        length(candidate.columns, window.column, TILE_WIDTH) * length(candidate.rows, window.row, TILE_HEIGHT)
    };
    let sample: u32 = candidates.iter().step_by(step).map(area).sum();
    (u64::from(sample) * step as u64 / (TILE_WIDTH * TILE_HEIGHT) as u64) as u32
}

/// A scene of as many spheres has their records for shading made once, before its first tile. Those of a scene of more are
/// made by each tile, of the spheres that have a pixel there.
const MOST_RECORDS: usize = 4096;

/// A tile of more spheres forgets those that have no pixel of it: their numbers stay within what f32 counts.
const MOST_SPHERES: usize = 1 << 16;

/// In a tile of fewer spheres it costs more to find out which of them have a pixel than to make all their records.
const FEWEST_OWNERS: usize = 128;

/// A scene planned for tiles, and the kernels that trace it.
pub struct TileTracer<'a, E: Element> {
    packets: &'static PacketKernels,
    kernels: &'static ElementKernels<E>,
    /// Whether the shade may come from estimates in floats too.
    fast: bool,
    plan: Tiles<'a, E>,
    /// The records of all spheres, if they are few, in linear floats and in levels.
    records: [OnceLock<SphereRecords<E>>; 2],
    /// For the tiles that have an object whose numbers are beyond f32.
    wide: Option<Box<TileTracer<'a, f64>>>,
    /// What threads needed for the rows that they have done, for those to come.
    free: Mutex<Vec<Scratches<E>>>,
}

impl<'a, E: Element> TileTracer<'a, E> {
    /// Plans `scene` for kernels, of which `kernels` are those for one element type, with estimates where `fast`; see
    /// [`Tiles::new`].
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

/// What differs between the outputs of four channels; of three there are none but by way of these.
trait Output<E: Element>: Pixel + Plain {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted;
    fn fill(tracer: &TileTracer<'_, E>, out: &mut [Self]);
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self>;
}

impl<E: Element> Output<E> for Vec4 {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted {
        plan.linear()
    }
    fn fill(tracer: &TileTracer<'_, E>, out: &mut [Self]) {
        tracer.packets.fill.f32x4(out, false);
    }
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self> {
        if tracer.fast { &tracer.kernels.tiles.f32x4_fast } else { &tracer.kernels.tiles.f32x4 }
    }
}

impl<E: Element> Output<E> for Rgba8 {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted {
        plan.levels()
    }
    fn fill(tracer: &TileTracer<'_, E>, out: &mut [Self]) {
        tracer.packets.fill.rgba8(out, false);
    }
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self> {
        &tracer.kernels.tiles.rgba8
    }
}

/// What a thread needs beside the plan, for its own tiles and for those in f64.
type Scratches<E> = (Scratch<E>, Option<Scratch<f64>>);

/// What a thread needs beside the plan.
#[derive(Default)]
struct Scratch<E: Element> {
    buffers: TileBuffers<E>,
    /// What the tile may see, where it is not in one list of the plan's.
    room: Vec<Candidate>,
    layers: Layers,
    /// Everyone's place in the scene by their numbers in the tile: 0 is nobody's, spheres come before triangles.
    order: Vec<u32>,
    shades: Vec<TileShade<E>>,
    tile_spheres: TileSpheres<E>,
    /// Objects that were set up, and forgotten since.
    forgotten: usize,
}

/// A tile's objects in layers from near to far, and what the last tiles left there.
#[derive(Default)]
struct Layers {
    nearest: Vec<Candidate>,
    /// Room for the nearest when they are cut again.
    room: Vec<Candidate>,
    /// The others, the farthest first.
    others: Vec<Candidate>,
    /// Where each layer of the others begins, and how many there are in it.
    starts: Vec<(usize, usize)>,
}

/// The spheres of a tile that were set up, in the order of their numbers from 1 on.
#[derive(Default)]
struct TileSpheres<E> {
    candidates: Vec<Candidate>,
    /// Whether they have a pixel, from nobody on.
    owners: Vec<bool>,
    /// Those that do.
    owning: Vec<Candidate>,
    /// Where everyone's records are; of those without a pixel, anywhere.
    places: Vec<u32>,
    /// The tile's own, unless the tracer has those of all.
    records: SphereRecords<E>,
}

/// What there is to do about pixels that nobody has, and about the others.
struct Misses<P> {
    /// What those pixels become; None: black.
    rest: Option<P>,
    /// How many the others are so far, if they are counted.
    hits: Option<u64>,
}

/// Tiles side by side that have nobody: they are filled together, since memory takes long pieces sooner.
struct Nobody {
    rows: Range<u32>,
    columns: Range<u32>,
}

impl Nobody {
    /// Adds a window, and gives those that it is not beside.
    fn add(those: &mut Option<Nobody>, window: &TileWindow) -> Option<Nobody> {
        let rows = window.row + window.rows.start..window.row + window.rows.end;
        let columns = window.column..window.column + window.columns;
        match those {
            Some(those) if those.rows == rows && those.columns.end == columns.start => {
                those.columns.end = columns.end;
                None
            }
            _ => those.replace(Nobody { rows, columns }),
        }
    }

    /// Says of each row where its pixels are in a film of `rows` of so many pixels.
    fn each_row(self, rows: &Range<u32>, width: usize, mut say: impl FnMut(Range<usize>)) {
        for row in self.rows {
            let first = (row - rows.start) as usize * width;
            say(first + self.columns.start as usize..first + self.columns.end as usize);
        }
    }
}

/// Is told who is nearest so far.
type SoFar<'a, E> = &'a mut dyn FnMut(&TileBuffers<E>, &[TileShade<E>], &TileSpheres<E>);

impl<E: Element> TileTracer<'_, E> {
    /// Traces rows; at how many pixels there is something, where that is to be `counted`.
    fn trace_film(&self, rows: Range<u32>, out: FilmMut<'_>, counted: bool) -> Option<u64> {
        let (wanted, hits): (&Wanted<'_>, _) = (&|rows, _| rows, counted.then_some(0));
        match out {
            FilmMut::F32x4(out) => self.trace(rows, wanted, out, Misses { rest: None, hits }),
            FilmMut::F32x3(out) => {
                self.trace_three::<_, Vec4>(rows, out, &self.packets.narrow_f32x3, Fill::f32x3, hits)
            }
            FilmMut::Rgba8(out) => self.trace(rows, wanted, out, Misses { rest: None, hits }),
            FilmMut::Rgb8(out) => self.trace_three::<_, Rgba8>(rows, out, &self.packets.narrow_rgb8, Fill::rgb8, hits),
        }
    }

    /// Traces the tiles of rows that are `wanted`; the hits, if they are counted.
    fn trace<P: Output<E> + Output<f64>>(
        &self,
        rows: Range<u32>,
        wanted: &Wanted<'_>,
        out: &mut [P],
        mut misses: Misses<P>,
    ) -> Option<u64> {
        let width = self.plan.size()[0] as usize;
        assert_eq!(out.len(), rows.len() * width, "the film must have the size of the rows");
        let (mut scratches, mut nobody, rest) = (self.scratches(), None, misses.rest);
        let fill = |out: &mut [P], nobody: Nobody| {
            nobody.each_row(&rows, width, |pixels| match rest {
                Some(rest) => out[pixels].fill(rest),
                None => P::fill(self, &mut out[pixels]),
            });
        };
        self.each_wanted(rows.clone(), wanted, |tile, window| {
            let first = first_pixel(window, &rows, width);
            ask_for_next(out, window, first, width);
            let own = TileOut { pixels: &mut *out, first, width };
            if !self.trace_tile(tile, window, own, &mut scratches, &mut misses) {
                Nobody::add(&mut nobody, window).into_iter().for_each(|nobody| fill(out, nobody));
            }
        });
        nobody.into_iter().for_each(|nobody| fill(out, nobody));
        self.put_back(scratches);
        misses.hits
    }

    /// Three channels, a tile of four channels after another.
    fn trace_three<P, Four: Output<E> + Output<f64>>(
        &self,
        rows: Range<u32>,
        out: &mut [P],
        narrow: &Narrow<Four, P>,
        fill: fn(&Fill, &mut [P], bool),
        hits: Option<u64>,
    ) -> Option<u64> {
        let width = self.plan.size()[0] as usize;
        assert_eq!(out.len(), rows.len() * width, "the film must have the size of the rows");
        let (mut scratches, mut nobody, mut misses) = (self.scratches(), None, Misses { rest: None, hits });
        let fill = |out: &mut [P], nobody: Nobody| {
            nobody.each_row(&rows, width, |pixels| fill(&self.packets.fill, &mut out[pixels], false));
        };
        let mut four = vec![Four::ZERO; TILE_WIDTH * TILE_HEIGHT];
        self.each_tile(rows.clone(), |tile, window| {
            ask_for_next(out, window, first_pixel(window, &rows, width), width);
            let own = TileOut { pixels: &mut four, first: 0, width: TILE_WIDTH };
            if !self.trace_tile(tile, window, own, &mut scratches, &mut misses) {
                Nobody::add(&mut nobody, window).into_iter().for_each(|nobody| fill(out, nobody));
                return;
            }
            let columns = window.columns as usize;
            let out = out[first_pixel(window, &rows, width)..].chunks_mut(width);
            for (four, out) in four.chunks(TILE_WIDTH).zip(out).take(window.rows.len()) {
                narrow.call(&four[..columns], &mut out[..columns]);
            }
        });
        nobody.into_iter().for_each(|nobody| fill(out, nobody));
        self.put_back(scratches);
        misses.hits
    }

    fn scratches(&self) -> Scratches<E> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn put_back(&self, scratches: Scratches<E>) {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).push(scratches);
    }

    /// A tile in the elements that hold its objects; false, and nothing written, where nobody can be in it.
    fn trace_tile<P: Output<E> + Output<f64>>(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        out: TileOut<'_, P>,
        (scratch, wide_scratch): &mut Scratches<E>,
        misses: &mut Misses<P>,
    ) -> bool {
        match &self.wide {
            Some(wide) if self.plan.is_wide(tile) => {
                wide.trace_own(tile, window, out, wide_scratch.get_or_insert_default(), misses)
            }
            _ => self.trace_own(tile, window, out, scratch, misses),
        }
    }

    /// What `ask` has to say of the tiles that it traces itself, and of those that are for f64, each of them being told
    /// which are its own.
    fn ask_both<T>(
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

    /// Says of those tiles of `rows` that are its `own` and have something in them who is nearest where.
    fn each_nearest(
        &self,
        rows: Range<u32>,
        own: &dyn Fn(TilePlace) -> bool,
        mut say: impl FnMut(&TileWindow, &Scratch<E>),
    ) {
        let mut scratch = Scratch::default();
        self.each_tile(rows, |tile, window| {
            if own(tile) && self.find_nearest(tile, window, None, self.plan.linear(), &mut scratch) {
                say(window, &scratch);
            }
        });
    }

    /// How many spheres in the picture have the short form in bytes.
    fn count_short(&self) -> u64 {
        let candidates: Vec<_> = self.plan.seen_spheres().filter(|candidate| candidate.most < Candidate::ANY).collect();
        let mut records = SphereRecords::default();
        let count = |candidates: &[Candidate]| {
            self.make_records(self.plan.levels(), candidates, &mut records);
            records.spheres[..candidates.len()].iter().filter(|sphere| sphere.short != E::ZERO).count() as u64
        };
        candidates.chunks(CHUNK).map(count).sum()
    }

    /// What is left out of its `own` tiles of `rows`.
    fn survey(&self, rows: Range<u32>, own: &dyn Fn(TilePlace) -> bool) -> TileSurvey {
        let mut survey = TileSurvey::default();
        let mut candidates = Vec::new();
        self.each_tile(rows.clone(), |tile, _| survey.empty += u64::from(own(tile)));
        self.each_nearest(rows, own, |window, Scratch { buffers, order, forgotten, .. }| {
            candidates.clear();
            candidates.resize(order.len(), false);
            pixels_of(window)
                .for_each(|(row, column)| candidates[buffers.pixel(self.kernels.lanes, column, row).1] = true);
            survey.empty -= 1;
            let placed = self.plan.count_in(window);
            survey.occluded += (placed - (order.len() - 1 + *forgotten)) as u64;
            survey.placed += placed as u64;
            survey.unseen += (*forgotten + candidates[1..].iter().filter(|candidate| !**candidate).count()) as u64;
        });
        survey
    }

    /// Says of all tiles of `rows` what of them is in these.
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

    /// The same of those in which pixels are `wanted`, and of no other rows of theirs than these need.
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
        let mut shade = |buffers: &TileBuffers<E>, shades: &[TileShade<E>], spheres: &TileSpheres<E>| {
            let SphereRecords { spheres: records, lits, shorts } =
                self.records_of_all(weighted).unwrap_or(&spheres.records);
            let tile_spheres = ShadingRecords {
                shades,
                lights: self.plan.points(),
                sphere_ids: &spheres.places,
                spheres: records,
                lits,
                shorts,
            };
            P::shade(self).call(&rays, buffers, tile_spheres, window, TileOut { pixels: &mut *pixels, first, width });
        };
        let by_force = self.plan.keep().has(Omission::Unseen).then_some(&mut shade as SoFar<'_, E>);
        if !self.find_nearest(tile, window, by_force, weighted, scratch) {
            return false;
        }
        let Scratch { buffers, tile_spheres, shades, .. } = scratch;
        if let Some(hits) = &mut misses.hits {
            *hits += buffers.count_hits(self.kernels.lanes, window);
        }
        shade(buffers, shades, tile_spheres);
        if let Some(rest) = misses.rest {
            buffers.fill_rest(self.kernels.lanes, window, rest, TileOut { pixels: &mut *pixels, first, width });
        }
        true
    }

    /// Finds who is nearest at the pixels of a tile; false where nobody can be. `so_far` is called whenever that may have
    /// changed.
    fn find_nearest(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        // A pair of pointers, not the last: on the stack it would be stored as two and loaded as one, which waits for all
        // stores before.
        mut so_far: Option<SoFar<'_, E>>,
        weighted: &Weighted,
        scratch: &mut Scratch<E>,
    ) -> bool {
        let Scratch { buffers, room, layers, order, shades, tile_spheres, forgotten } = scratch;
        *forgotten = 0;
        tile_spheres.candidates.clear();
        tile_spheres.places.clear();
        room.clear();
        let [mut large_spheres, large @ ..] = self.plan.large();
        large_spheres.add(tile, LARGE_AT_FIRST, 0.0, room);
        self.plan.spheres_in(tile, room);
        let mut any = !room.is_empty() || self.plan.keep().has(Omission::EmptyTiles);
        if any {
            buffers.clear();
        }
        let (view, _) = self.plan.view(tile);
        let (grid, kernels) = (self.plan.grid(), &self.kernels.tiles);
        order.clear();
        order.push(0);
        if !room.is_empty() {
            self.nearest_spheres(room, weighted, buffers, layers, order, (tile_spheres, forgotten), window);
            self.each_large(large_spheres, (tile, window), room, buffers, |candidates, buffers| {
                self.nearest_spheres(candidates, weighted, buffers, layers, order, (tile_spheres, forgotten), window);
            });
            let by_force = so_far.is_some();
            self.look_at_spheres(weighted, buffers, tile_spheres, by_force);
        }
        let mut before = 1 + self.plan.spheres().len() as u32;
        let first_triangle = order.len();
        let all = self.plan.triangle_lists();
        for (kind, (list, mut large)) in all.iter().zip(large).enumerate() {
            let mut trace = |triangles: &[Candidate], buffers: &mut TileBuffers<E>| {
                if !any {
                    buffers.clear();
                    any = true;
                }
                if order.len() == first_triangle {
                    // Nobody's shades, and none for spheres, whose light is their own.
                    let dark = first_triangle * weighted.lights.len();
                    shades.resize(shades.len().max(dark), TileShade::default());
                    shades[..dark].fill(TileShade::default());
                } else if order.len() - first_triangle > TILE_WIDTH * TILE_HEIGHT {
                    let owns = forget_unseen(buffers, first_triangle, order, shades, weighted.lights.len());
                    *forgotten += owns.into_iter().filter(|owns| !owns).count();
                }
                self.near_first(triangles, layers, buffers, window, |candidates, buffers| {
                    for start in (0..candidates.len()).step_by(CHUNK) {
                        let first_id = order.len();
                        let candidates = &candidates[start..];
                        let triangles =
                            TriangleChunk { triangles: *list, lights: &weighted.lights, candidates, first_id };
                        order.extend(candidates.iter().take(CHUNK).map(|candidate| before + candidate.id));
                        kernels.set_up.call(&view, triangles, buffers, shades);
                        self.refine(kind, triangles, &view, buffers, shades);
                        kernels.nearest_triangles.call(buffers, order, window, &grid, self.fewest_across());
                        if let Some(so_far) = &mut so_far {
                            so_far(buffers, shades, tile_spheres);
                        }
                    }
                });
            };
            room.clear();
            large.add(tile, LARGE_AT_FIRST, 0.0, room);
            self.plan.triangles_in(kind, tile, room, |candidates| trace(candidates, buffers));
            self.each_large(large, (tile, window), room, buffers, |candidates, buffers| trace(candidates, buffers));
            before += list.len() as u32;
        }
        any
    }

    /// Sets what was set up to the planes that the plan has, if it has them.
    fn refine(
        &self,
        kind: usize,
        TriangleChunk { lights, candidates, first_id, .. }: TriangleChunk<'_>,
        view: &TileView<f64>,
        buffers: &mut TileBuffers<E>,
        shades: &mut [TileShade<E>],
    ) {
        let Some(planes) = self.plan.planes(kind) else { return };
        for (i, candidate) in candidates.iter().take(CHUNK).enumerate() {
            let plane = &planes[candidate.id as usize];
            buffers.set_inverse(i, plane.inverse(view).map(E::from_f64));
            let shades = &mut shades[(first_id + i) * lights.len()..][..lights.len()];
            for (shade, light) in shades.iter_mut().zip(lights) {
                shade.cosine = E::from_f64(plane.height(light));
            }
        }
    }

    /// Has those traced of what is in many tiles that are still to come, and not behind all of this one.
    fn each_large(
        &self,
        mut large: LargeObjects<'_>,
        (tile, window): (TilePlace, &TileWindow),
        room: &mut Vec<Candidate>,
        buffers: &mut TileBuffers<E>,
        mut trace: impl FnMut(&mut Vec<Candidate>, &mut TileBuffers<E>),
    ) {
        let mut count = LARGE_AT_FIRST;
        while !large.are_through() {
            count = LARGE_MORE.saturating_mul(count);
            let least = if self.plan.keep().has(Omission::Occluded) { 0.0 } else { self.farthest(buffers, window).1 };
            room.clear();
            large.add(tile, count, least, room);
            if !room.is_empty() {
                trace(room, buffers);
            }
        }
    }

    /// Has what is `seen` traced, layer by layer from near to far, but for what is hidden by all that there is around it by
    /// then.
    fn near_first(
        &self,
        candidates: &[Candidate],
        Layers { nearest, room, others, starts }: &mut Layers,
        buffers: &mut TileBuffers<E>,
        window: &TileWindow,
        mut trace: impl FnMut(&[Candidate], &mut TileBuffers<E>),
    ) {
        let few =
            candidates.len() < FEWEST_HIDDEN && (candidates.len() < FEWEST_DEEP || covers(candidates, window) <= DEEP);
        if few || self.plan.keep().has(Omission::Occluded) {
            return trace(candidates, buffers);
        }
        // Kernels fill registers.
        let enough = candidates.len() + CHUNK;
        for layer in [&mut *nearest, room, others] {
            layer.resize(layer.len().max(enough), Candidate::default());
        }
        let mut near = self.packets.nearer_half.call(candidates, nearest, others);
        let mut end = candidates.len() - near;
        starts.clear();
        starts.push((0, end));
        while starts.len() < MOST_LAYERS && covers(&nearest[..near], window) > DEEP {
            let nearer = self.packets.nearer_half.call(&nearest[..near], room, &mut others[end..]);
            if nearer == near {
                break;
            }
            std::mem::swap(nearest, room);
            starts.push((end, near - nearer));
            (near, end) = (nearer, end + near - nearer);
        }
        let mut farthest = None;
        let mut trace_layer = |layer: &mut [Candidate], count: usize| {
            let mut left = count;
            if buffers.has_somebody() {
                let (parts, least) = farthest.get_or_insert_with(|| self.farthest(buffers, window));
                left = not_behind(layer, count, *least);
                left = self.packets.visible.call(layer, left, parts, window);
            }
            if left > 0 {
                trace(&layer[..left], buffers);
                farthest = None;
            }
        };
        trace_layer(nearest, near);
        starts.iter().rev().for_each(|(start, count)| trace_layer(&mut others[*start..], *count));
    }

    /// What is farthest in the parts of a tile, and in all of it.
    fn farthest(&self, buffers: &mut TileBuffers<E>, window: &TileWindow) -> (Parts, f32) {
        buffers.close_around(self.kernels.lanes, window);
        let alone = self.kernels.tiles.farthest.call(buffers).map(|near| near.to_f64() as f32);
        (Parts::new(alone), alone.into_iter().fold(f32::MAX, f32::min))
    }

    /// Spheres of a tile: first those that are not in front.
    #[expect(clippy::too_many_arguments, reason = "parts of one Scratch")]
    fn nearest_spheres(
        &self,
        spheres: &mut Vec<Candidate>,
        weighted: &Weighted,
        buffers: &mut TileBuffers<E>,
        layers: &mut Layers,
        order: &mut Vec<u32>,
        (tile_spheres, forgotten): (&mut TileSpheres<E>, &mut usize),
        window: &TileWindow,
    ) {
        let (grid, kernels) = (self.plan.grid(), &self.kernels.tiles);
        if spheres.iter().any(|candidate| candidate.most == Candidate::ANY) {
            for candidate in spheres.extract_if(.., |candidate| candidate.most == Candidate::ANY) {
                let sphere = &self.plan.spheres()[candidate.id as usize];
                let Some(around) = self.plan.around(sphere) else { continue };
                order.push(1 + candidate.id);
                tile_spheres.candidates.push(candidate);
                if self.plan.keep().has(Omission::Misses) || !self.plan.misses(window, sphere) {
                    kernels.around.call(&around, window, buffers, order);
                }
            }
        }
        self.near_first(spheres, layers, buffers, window, |candidates, buffers| {
            for start in (0..candidates.len()).step_by(CHUNK) {
                if order.len() > MOST_SPHERES {
                    let owns = forget_unseen(buffers, 1, order, &mut [], 0);
                    let mut owns = owns.into_iter().skip(1);
                    *forgotten += tile_spheres.candidates.len();
                    tile_spheres.candidates.retain(|_| owns.next() == Some(true));
                    *forgotten -= tile_spheres.candidates.len();
                }
                let first_id = order.len();
                let candidates = &candidates[start..];
                let chunk = &candidates[..candidates.len().min(CHUNK)];
                order.extend(chunk.iter().map(|candidate| 1 + candidate.id));
                tile_spheres.candidates.extend_from_slice(chunk);
                let spheres = SphereChunk { spheres: self.plan.spheres(), candidates };
                kernels.sphere_set_up.call(&weighted.spheres, spheres, first_id, buffers);
                kernels.nearest_spheres.call(buffers, order, window, &grid, self.fewest_across());
            }
        });
    }

    /// A triangle whose bounds have fewer blocks in a row is asked at all of them: how many of a few are left is not foreseen,
    /// so that leaving some out costs as much as it saves.
    fn fewest_across(&self) -> u32 {
        let all = self.plan.keep().has(Omission::Misses);
        if all { u32::MAX } else { (TILE_WIDTH / self.kernels.lanes.min(4) / 2) as u32 }
    }

    /// The records of all spheres, if they are few.
    fn records_of_all(&self, weighted: &Weighted) -> Option<&SphereRecords<E>> {
        let count = self.plan.spheres().len();
        let make = || {
            let mut records = SphereRecords::default();
            let all: Vec<_> = (0..count as u32).map(|id| Candidate { id, ..Candidate::default() }).collect();
            self.make_records(weighted, &all, &mut records);
            records
        };
        (count <= MOST_RECORDS).then(|| self.records[usize::from(weighted.bytes)].get_or_init(make))
    }

    /// Makes the records of the spheres that are `seen`, in this order.
    fn make_records(&self, weighted: &Weighted, candidates: &[Candidate], records: &mut SphereRecords<E>) {
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

    /// Has the records at hand of the spheres that have a pixel, or, `by_force`, of all that the tile may see.
    fn look_at_spheres(
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
            // Without branches, which could not be foreseen.
            owning.resize(candidates.len(), Candidate::default());
            places.resize(candidates.len(), 0);
            let mut count = 0;
            for ((candidate, owns), place) in candidates.iter().zip(&owners[1..]).zip(places) {
                owning[count] = *candidate;
                *place = count as u32;
                count += usize::from(*owns);
            }
            // Where nobody has a pixel, all of them have the records of the first.
            self.make_records(weighted, &owning[..count.max(1)], records);
        }
    }

    fn ray(&self, window: &TileWindow, column: u32, row: u32) -> DVec3 {
        self.plan.ray(window.row + row, window.column + column)
    }

    /// As [`Tracer::hits`], of its `own` tiles.
    fn found(&self, rows: Range<u32>, own: &dyn Fn(TilePlace) -> bool) -> Vec<Option<Found>> {
        let width = self.plan.size()[0] as usize;
        let mut found = vec![None; rows.len() * width];
        let spheres = self.plan.spheres().len();
        self.each_nearest(rows.clone(), own, |window, scratch| {
            for (row, column) in pixels_of(window) {
                let (near, who) = scratch.buffers.pixel(self.kernels.lanes, column, row);
                if who > 0 {
                    let place = scratch.order[who] as usize - 1;
                    let (object, normal) = match place.checked_sub(spheres) {
                        None => {
                            let normal = self.normal_of_sphere((who, near), (window, row, column), scratch);
                            (Object::Sphere(place), normal)
                        }
                        Some(triangle) => (Object::Triangle(triangle), self.normal_of_triangle(triangle)),
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
}

/// Brings those of the first `count` to the front, in order, that are not behind all of a tile, and gives how many they are.
fn not_behind(candidates: &mut [Candidate], count: usize, least: f32) -> usize {
    if least <= 0.0 {
        return count;
    }
    let mut left = 0;
    for i in 0..count {
        candidates[left] = candidates[i];
        left += usize::from(candidates[i].most >= least);
    }
    left
}

/// Forgets those objects of a tile, from number `first` on, that have no pixel of it, and gives the others the numbers from
/// there on. Who had a pixel, by the numbers before; those up to the first are taken to have one.
fn forget_unseen<E: Element>(
    buffers: &mut TileBuffers<E>,
    first: usize,
    order: &mut Vec<u32>,
    shades: &mut [TileShade<E>],
    lights: usize,
) -> Vec<bool> {
    let mut owners = vec![false; order.len()];
    buffers.mark_owners(&mut owners);
    owners[..first].fill(true);
    let mut left = 0;
    let mut numbers = Vec::with_capacity(order.len());
    for (i, owns) in owners.iter().copied().enumerate() {
        numbers.push(left as u32);
        if owns {
            order[left] = order[i];
            shades.copy_within(i * lights..(i + 1) * lights, left * lights);
            left += 1;
        }
    }
    buffers.renumber(&numbers, left);
    order.truncate(left);
    owners
}

/// Has the memory fetched of the pixels to the right of a window: they are written next, and in pieces of a row each, which a
/// core does not foresee.
fn ask_for_next<P>(out: &[P], window: &TileWindow, first: usize, width: usize) {
    let left = width - window.column as usize - window.columns as usize;
    for row in 0..window.rows.len() {
        let next = first + row * width + window.columns as usize;
        sys::ask_for(&out[next..next + left.min(TILE_WIDTH)]);
    }
}

/// Where the first pixel of a window is in a film of these rows.
fn first_pixel(window: &TileWindow, rows: &Range<u32>, width: usize) -> usize {
    (window.row + window.rows.start - rows.start) as usize * width + window.column as usize
}

/// The rows and columns of a tile that are in a window.
fn pixels_of(window: &TileWindow) -> impl Iterator<Item = (usize, usize)> {
    let (rows, columns) = (window.rows.start as usize..window.rows.end as usize, window.columns as usize);
    rows.flat_map(move |row| (0..columns).map(move |column| (row, column)))
}

impl<E: Element> TileTracer<'_, E> {
    /// What is left out of the whole picture.
    fn survey_all(&self) -> TileSurvey {
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
}

impl<E: Element> PacketPlan for TileTracer<'_, E> {
    fn report(&self, bytes: bool) -> Report {
        Report::of_tiles(&[&self.plan], self.survey_all(), bytes)
    }
}

impl<E: Element> Tracer for TileTracer<'_, E> {
    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let both = |narrow: Vec<Option<Found>>, wide: Vec<_>| {
            narrow.into_iter().zip(wide).map(|(narrow, wide)| narrow.or(wide)).collect()
        };
        self.ask_both(|own| self.found(rows.clone(), own), |wide, own| wide.found(rows.clone(), own), both)
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
