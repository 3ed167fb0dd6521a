//! The engines `sse41`, `avx2` and `avx512` on many objects: the nearest of each pixel tile by tile, then shaded once.

mod normals;

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::film::with_pixels;
use super::{Distance, FilmMut, Found, Pixel, PixelFormat, Tracer};
use crate::kernels::{
    CHUNK, Element, F32x3, Looks, PacketKernels, Rgb8, Rgba8, Seen, ShadeTile, SpanKernels, Spheres, TILE_HEIGHT,
    TILE_WIDTH, TileBuffers, TileOut, TileShade, TileWindow, Triangles, Vec4,
};
use crate::plan::{Omission, Report, TilePlace, TileSurvey, Tiles, Weighted};
use crate::reference::geometry;
use crate::scene::Object;

/// In a tile of fewer triangles it costs more to find out which of them others hide than to try them.
const FEWEST_HIDDEN: usize = 64;

/// A scene planned for tiles, and the kernels that trace it.
pub struct TileTracer<'a, E: 'static> {
    packets: &'static PacketKernels,
    kernels: &'static SpanKernels<E>,
    /// Whether the shade may come from estimates in floats too.
    fast: bool,
    plan: Tiles<'a, E>,
}

impl<'a, E: Element> TileTracer<'a, E> {
    /// Traces what is planned for the kernels; `kernels` are theirs for one element type.
    pub fn new(
        packets: &'static PacketKernels,
        kernels: &'static SpanKernels<E>,
        fast: bool,
        plan: Tiles<'a, E>,
    ) -> Self {
        TileTracer { packets, kernels, fast, plan }
    }

    /// See [`Tiles::is_plain`].
    pub fn is_plain(&self) -> bool {
        self.plan.is_plain()
    }
}

/// What differs between the outputs.
trait Output<E: 'static>: Pixel {
    fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted<E>;
    fn fill(tracer: &TileTracer<'_, E>, out: &mut [Self]);
    fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self>;
}

/// An output of floats: estimates are asked for.
macro_rules! floats {
    ($pixel:ty, $field:ident, $fast:ident) => {
        impl<E: Element> Output<E> for $pixel {
            fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted<E> {
                plan.linear()
            }
            fn fill(tracer: &TileTracer<'_, E>, out: &mut [Self]) {
                tracer.packets.fill.$field(out, false);
            }
            fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self> {
                if tracer.fast { &tracer.kernels.tiles.$fast } else { &tracer.kernels.tiles.$field }
            }
        }
    };
}

/// An output of bytes.
macro_rules! bytes {
    ($pixel:ty, $field:ident) => {
        impl<E: Element> Output<E> for $pixel {
            fn weighted<'a>(plan: &'a Tiles<'_, E>) -> &'a Weighted<E> {
                plan.levels()
            }
            fn fill(tracer: &TileTracer<'_, E>, out: &mut [Self]) {
                tracer.packets.fill.$field(out);
            }
            fn shade(tracer: &TileTracer<'_, E>) -> &'static ShadeTile<E, Self> {
                &tracer.kernels.tiles.$field
            }
        }
    };
}

floats!(Vec4, f32x4, f32x4_fast);
floats!(F32x3, f32x3, f32x3_fast);
bytes!(Rgba8, rgba8);
bytes!(Rgb8, rgb8);

/// What a thread needs beside the plan.
#[derive(Default)]
struct Scratch<E: Element> {
    buffers: TileBuffers<E>,
    seen_spheres: Vec<Seen>,
    /// Their numbers in the scene.
    spheres: Vec<u32>,
    /// Triangles that are not in one list of the plan's.
    room: Vec<Seen>,
    /// Those of them that are nearer and farther away, and what the last tiles left there.
    before: Vec<Seen>,
    behind: Vec<Seen>,
    /// Everyone's place in the scene, by their numbers in the tile.
    order: Vec<u32>,
    shades: Vec<TileShade<E>>,
    /// Triangles of the tile that were not set up.
    occluded: usize,
}

/// Is told who is nearest so far.
type SoFar<'a, E> = &'a mut dyn FnMut(&TileBuffers<E>, &[TileShade<E>], &[u32]);

impl<E: Element> TileTracer<'_, E> {
    fn trace<P: Output<E>>(&self, rows: Range<u32>, out: &mut [P]) {
        let width = self.plan.camera().width() as usize;
        assert_eq!(out.len(), rows.len() * width, "the film must have the size of the rows");
        let mut scratch = Scratch::default();
        self.each_tile(rows.clone(), |tile, window| {
            let first = (window.row + window.rows.start - rows.start) as usize * width + window.column as usize;
            self.trace_tile(tile, window, TileOut { pixels: &mut *out, first, width }, &mut scratch);
        });
    }

    /// Says of all tiles of `rows` that have something in them who is nearest where.
    fn each_nearest(&self, rows: Range<u32>, mut say: impl FnMut(&TileWindow, &Scratch<E>)) {
        let mut scratch = Scratch::default();
        self.each_tile(rows, |tile, window| {
            if self.find_nearest(tile, window, self.plan.linear(), &mut scratch, None) {
                say(window, &scratch);
            }
        });
    }

    /// What is left out of the whole picture.
    pub fn report(&self, bytes: bool) -> Report {
        let height = self.plan.camera().height();
        let starts = (0..height).into_par_iter().step_by(TILE_HEIGHT);
        let surveys = starts.map(|start| self.survey(start..height.min(start + TILE_HEIGHT as u32)));
        Report::of_tiles(&self.plan, surveys.reduce(TileSurvey::default, TileSurvey::and), bytes)
    }

    /// What is left out of `rows`.
    fn survey(&self, rows: Range<u32>) -> TileSurvey {
        let mut survey = TileSurvey::default();
        let mut seen = Vec::new();
        self.each_tile(rows.clone(), |_, _| survey.empty += 1);
        self.each_nearest(rows, |window, Scratch { buffers, order, occluded, .. }| {
            seen.clear();
            seen.resize(order.len(), false);
            pixels_of(window).for_each(|(row, column)| seen[buffers.pixel(self.kernels.lanes, column, row).1] = true);
            survey.empty -= 1;
            survey.occluded += *occluded as u64;
            survey.placed += (order.len() - 1 + *occluded) as u64;
            survey.unseen += seen[1..].iter().filter(|seen| !**seen).count() as u64;
        });
        survey
    }

    /// Says of all tiles of `rows` what of them is in these.
    fn each_tile(&self, rows: Range<u32>, mut say: impl FnMut(TilePlace, &TileWindow)) {
        let (width, height) = (self.plan.camera().width(), TILE_HEIGHT as u32);
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

    fn trace_tile<P: Output<E>>(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        out: TileOut<'_, P>,
        scratch: &mut Scratch<E>,
    ) {
        let weighted = P::weighted(&self.plan);
        let (_, rays) = self.plan.view(tile);
        let TileOut { pixels, first, width } = out;
        let mut shade = |buffers: &TileBuffers<E>, shades: &[TileShade<E>], spheres: &[u32]| {
            let looks = Looks {
                shades,
                lights: self.plan.points(),
                sphere_ids: spheres,
                spheres: self.plan.spheres(),
                lits: &weighted.lits,
                shorts: self.plan.shorts(),
            };
            P::shade(self).call(&rays, buffers, looks, window, TileOut { pixels: &mut *pixels, first, width });
        };
        let by_force = self.plan.keep().has(Omission::Unseen).then_some(&mut shade as SoFar<'_, E>);
        if !self.find_nearest(tile, window, weighted, scratch, by_force) {
            for row in 0..window.rows.len() {
                P::fill(self, &mut pixels[first + row * width..][..window.columns as usize]);
            }
            return;
        }
        let Scratch { buffers, spheres, shades, .. } = scratch;
        shade(buffers, shades, spheres);
        if spheres.iter().any(|sphere| self.plan.is_odd(*sphere)) {
            self.shade_odd(spheres, buffers, window, TileOut { pixels, first, width });
        }
    }

    /// Finds who is nearest at the pixels of a tile; false where nobody can be. `so_far` is called whenever that may have
    /// changed.
    fn find_nearest(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        weighted: &Weighted<E>,
        scratch: &mut Scratch<E>,
        mut so_far: Option<SoFar<'_, E>>,
    ) -> bool {
        let Scratch { buffers, seen_spheres, spheres, room, before, behind, order, shades, occluded } = scratch;
        let triangles = self.plan.seen_in(tile, seen_spheres, room);
        spheres.clear();
        spheres.extend(seen_spheres.iter().map(|seen| seen.id));
        *occluded = 0;
        if spheres.is_empty() && triangles.is_empty() && !self.plan.keep().has(Omission::EmptyTiles) {
            return false;
        }
        let (view, _) = self.plan.view(tile);
        let grid = self.plan.grid();
        buffers.clear();
        self.nearest_spheres(spheres, buffers, window);
        // Nobody's shades, and none for spheres, whose light is their own.
        let dark = (1 + spheres.len()) * weighted.lights.len();
        if shades.len() < dark {
            shades.resize(dark, TileShade::default());
        }
        shades[..dark].fill(TileShade::default());
        order.clear();
        order.resize(1 + spheres.len(), 0);
        let mut nearest = |seen: &[Seen], buffers: &mut TileBuffers<E>| {
            for start in (0..seen.len()).step_by(CHUNK) {
                let first_id = order.len();
                let seen = &seen[start..];
                let triangles = Triangles { facets: self.plan.facets(), lights: &weighted.lights, seen, first_id };
                order.extend(seen.iter().take(CHUNK).map(|seen| seen.id + 1));
                self.kernels.tiles.set_up.call(&view, triangles, buffers, shades);
                self.kernels.tiles.nearest_triangles.call(buffers, order, window, &grid);
                if let Some(so_far) = &mut so_far {
                    so_far(buffers, shades, spheres);
                }
            }
        };
        if triangles.len() < FEWEST_HIDDEN || self.plan.keep().has(Omission::Occluded) {
            nearest(triangles, buffers);
        } else {
            // The nearer half of what is there first; what is behind all that this leaves around it need not be set up.
            if behind.len() < triangles.len() {
                before.resize(triangles.len(), Seen::default());
                behind.resize(triangles.len(), Seen::default());
            }
            let near = self.packets.nearer_half.call(triangles, before, behind);
            let far = triangles.len() - near;
            nearest(&before[..near], buffers);
            let farthest = buffers.farthest(self.kernels.lanes);
            let mut left = 0;
            for i in 0..far {
                behind[left] = behind[i];
                left += usize::from(!farthest.hides(&behind[i], window));
            }
            *occluded = far - left;
            nearest(&behind[..left], buffers);
        }
        true
    }

    /// The spheres of a tile in their order: runs of those that the kernel takes, and between them the odd ones.
    fn nearest_spheres(&self, ids: &[u32], buffers: &mut TileBuffers<E>, window: &TileWindow) {
        let grid = self.plan.grid();
        let mut first_id = 1;
        for run in ids.chunk_by(|a, b| self.plan.is_odd(*a) == self.plan.is_odd(*b)) {
            if self.plan.is_odd(run[0]) {
                for (id, sphere) in (first_id..).zip(run) {
                    self.nearest_odd(*sphere, id, buffers, window);
                }
            } else {
                let (spheres, bounds) = (self.plan.spheres(), self.plan.sphere_bounds());
                let spheres = Spheres { spheres, bounds, ids: run, first_id };
                self.kernels.tiles.nearest_spheres.call(spheres, buffers, window, &grid);
            }
            first_id += run.len();
        }
    }

    /// A sphere around the camera, or one that reaches behind its plane: in f64, ray by ray.
    fn nearest_odd(&self, sphere: u32, id: usize, buffers: &mut TileBuffers<E>, window: &TileWindow) {
        let sphere = &self.plan.scene().spheres[sphere as usize];
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        for row in window.rows.clone() {
            for column in 0..window.columns {
                let d = self.ray(window, column, row);
                if let Some(t) = geometry::sphere(d, centre, radius) {
                    let near = E::from_f64(self.plan.scale() / t);
                    buffers.nearest(self.kernels.lanes, column as usize, row as usize, near, id);
                }
            }
        }
    }

    /// Shades what no kernel does.
    fn shade_odd<P: Output<E>>(&self, ids: &[u32], buffers: &TileBuffers<E>, window: &TileWindow, out: TileOut<'_, P>) {
        for row in window.rows.clone() {
            for column in 0..window.columns {
                let (_, who) = buffers.pixel(self.kernels.lanes, column as usize, row as usize);
                let Some(&id) = who.checked_sub(1).and_then(|i| ids.get(i)) else { continue };
                let d = self.ray(window, column, row);
                let sphere = &self.plan.scene().spheres[id as usize];
                let centre = sphere.centre.as_dvec3();
                if let (true, Some(t)) = (self.plan.is_odd(id), geometry::sphere(d, centre, sphere.radius.into())) {
                    let (p, n) = (t * d, geometry::sphere_normal(t * d, centre));
                    let light = |light: &crate::scene::Light| {
                        geometry::lambert(light.position.as_dvec3(), p, n) * light.radiance()
                    };
                    let light: DVec3 = self.plan.scene().lights.iter().map(light).sum();
                    let place = out.first + (row - window.rows.start) as usize * out.width + column as usize;
                    out.pixels[place] = P::of_colour(light * sphere.colour.as_dvec3());
                }
            }
        }
    }

    fn ray(&self, window: &TileWindow, column: u32, row: u32) -> DVec3 {
        self.plan.camera().grid::<f64>().ray(window.row + row, window.column + column).into()
    }
}

/// The rows and columns of a tile that are in a window.
fn pixels_of(window: &TileWindow) -> impl Iterator<Item = (usize, usize)> {
    let (rows, columns) = (window.rows.start as usize..window.rows.end as usize, window.columns as usize);
    rows.flat_map(move |row| (0..columns).map(move |column| (row, column)))
}

impl<E: Element> Tracer for TileTracer<'_, E> {
    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let width = self.plan.camera().width() as usize;
        let mut found = vec![None; rows.len() * width];
        self.each_nearest(rows.clone(), |window, Scratch { buffers, spheres, order, .. }| {
            for (row, column) in pixels_of(window) {
                let (near, who) = buffers.pixel(self.kernels.lanes, column, row);
                if who > 0 {
                    let object = match order[who] {
                        0 => Object::Sphere(spheres[who - 1] as usize),
                        triangle => Object::Triangle(triangle as usize - 1),
                    };
                    let distance = Distance::Inverse(near.to_f64() / self.plan.scale());
                    let place = (window.row as usize + row - rows.start as usize) * width;
                    found[place + window.column as usize + column] = Some(Found { object, distance, normal: None });
                }
            }
        });
        self.add_normals(rows, &mut found);
        found
    }

    fn count_hits(&self, rows: Range<u32>) -> u64 {
        let mut hits = 0;
        self.each_nearest(rows, |window, Scratch { buffers, .. }| {
            let hit = |(row, column): &(usize, usize)| buffers.pixel(self.kernels.lanes, *column, *row).1 > 0;
            hits += pixels_of(window).filter(hit).count() as u64;
        });
        hits
    }

    fn rows_together(&self) -> u32 {
        TILE_HEIGHT as u32
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        with_pixels!(FilmMut(out) = out => self.trace(rows, out));
    }
}
