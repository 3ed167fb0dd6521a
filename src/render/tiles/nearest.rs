//! The nearest object at each pixel of a tile: layers from near to far, culling hidden objects before set-up.

use super::shadows::ShadowScratch;
use super::spheres::TileSpheres;
use super::{MOST_EFFECTS, TileTracer};
use crate::kernels::{
    CHUNK, Candidate, Element, ObjectList, PART_SIDE, SphereChunk, TILE_HEIGHT, TILE_PARTS, TILE_WIDTH, TileBuffers,
    TileShade, TileView, TileWindow, TriangleChunk,
};
use crate::plan::{LargeInRow, LargeObjects, Omission, TilePlace, Weighted};

/// In a tile of fewer triangles, or spheres, culling the hidden ones costs more than testing all.
const FEWEST_HIDDEN: usize = 64;

/// The same if they cover the tile more often than [`DEEP`].
const FEWEST_DEEP: usize = 16;

/// Objects that cover a tile more often are partitioned once more, and the nearer part is traced first.
const DEEP: u32 = 4;

/// The most layers of a tile: beyond these the rest is about equally near.
const MOST_LAYERS: usize = 24;

/// Of the objects in many tiles, the nearest 64 are traced with the tile's own; then, while pixels may be open to farther
/// ones, each time 4 times as many as before.
const LARGE_AT_FIRST: usize = 64;
const LARGE_MORE: usize = 4;

/// How often the bounds of the candidates, judged by a sample of a few, cover the window.
fn covers(candidates: &[Candidate], window: &TileWindow) -> u32 {
    let step = candidates.len().div_ceil(8);
    // The bounds of small objects exceed what they cover, by about a pixel.
    let length = |bounds: u32, first: u32, side: usize| {
        (bounds >> 16).min(first + side as u32).saturating_sub((bounds & 0xffff).max(first) + 1)
    };
    let area = |candidate: &Candidate| {
        length(candidate.columns, window.column, TILE_WIDTH) * length(candidate.rows, window.row, TILE_HEIGHT)
    };
    let sample: u32 = candidates.iter().step_by(step).map(area).sum();
    (u64::from(sample) * step as u64 / (TILE_WIDTH * TILE_HEIGHT) as u64) as u32
}

/// A tile of more spheres, or triangles, drops those without a pixel: ids stay within the integers of f32.
const MOST_OBJECTS: usize = 1 << 16;

/// The memory of a thread beside the plan.
#[derive(Default)]
pub(super) struct Scratch<E: Element> {
    pub buffers: TileBuffers<E>,
    /// Of spheres and of both kinds of triangles.
    large: [LargeInRow; 3],
    /// The candidates of a tile, if they are not in one list of the plan.
    room: Vec<Candidate>,
    layers: Layers,
    pub objects: TileObjects<E>,
    /// If there are shadows.
    pub shadows: Option<Box<ShadowScratch>>,
}

/// The set-up objects of a tile, by their ids in it: 0 is no object, spheres come before triangles.
#[derive(Default)]
pub(super) struct TileObjects<E> {
    /// Their places in the scene.
    pub order: Vec<u32>,
    /// The effect of each light on each triangle; zeros for spheres, which have records of their own.
    pub shades: Vec<TileShade<E>>,
    pub spheres: TileSpheres<E>,
    /// The number of objects dropped since, because they had no pixel.
    pub forgotten: usize,
}

/// A tile's objects in layers from near to far, in memory reused from tile to tile.
#[derive(Default)]
struct Layers {
    nearest: Vec<Candidate>,
    /// Memory for the nearest when they are partitioned again.
    room: Vec<Candidate>,
    /// The others, the farthest first.
    others: Vec<Candidate>,
    /// The beginning of each layer of the others, and its length.
    starts: Vec<(usize, usize)>,
}

/// Called with the nearest objects so far.
pub(super) type SoFar<'a, E> = &'a mut dyn FnMut(&TileBuffers<E>, &TileObjects<E>);

impl<E: Element> TileTracer<'_, E> {
    /// Finds the nearest objects at the pixels of a tile; false if there can be none. `so_far` is called on progress.
    pub(super) fn find_nearest(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        // A pair of pointers, not the last argument: on the stack it would be stored as two and loaded as one, which
        // waits for all earlier stores.
        mut so_far: Option<SoFar<'_, E>>,
        weighted: &Weighted,
        scratch: &mut Scratch<E>,
    ) -> bool {
        let Scratch { buffers, large, room, layers, objects, .. } = scratch;
        objects.forgotten = 0;
        objects.order.clear();
        objects.order.push(0);
        objects.spheres.candidates.clear();
        objects.spheres.places.clear();
        room.clear();
        let [mut large_spheres, large @ ..] = self.plan.large(large);
        large_spheres.add(tile, LARGE_AT_FIRST, 0.0, room);
        self.plan.spheres_in(tile, room);
        let mut any = !room.is_empty() || self.plan.keep().has(Omission::EmptyTiles);
        if any {
            buffers.clear();
        }
        let (view, _) = self.plan.view(tile);
        let (grid, kernels) = (self.plan.grid(), &self.kernels.tiles);
        if !room.is_empty() {
            if room.len() >= FEWEST_HIDDEN && !self.plan.keep().has(Omission::Occluded) {
                let least = self.plan.least_of_large(tile);
                room.retain(|candidate| candidate.most >= least);
            }
            self.nearest_spheres(room, weighted, buffers, layers, objects, window);
            self.each_large(large_spheres, (tile, window), room, buffers, |candidates, buffers| {
                self.nearest_spheres(candidates, weighted, buffers, layers, objects, window);
            });
            self.look_at_spheres(weighted, buffers, &mut objects.spheres, so_far.is_some());
        }
        let mut before = 1 + self.plan.spheres().len() as u32;
        let (first_triangle, most) = (objects.order.len(), self.most_objects(window));
        let forget_triangles = |buffers: &mut TileBuffers<E>, objects: &mut TileObjects<E>| {
            let TileObjects { order, shades, forgotten, .. } = objects;
            let owns = forget_unseen(buffers, first_triangle, order, shades, weighted.lights.len());
            *forgotten += owns.into_iter().filter(|owns| !owns).count();
        };
        let all = self.plan.triangle_lists();
        for (kind, (list, mut large)) in all.iter().zip(large).enumerate() {
            let mut trace = |triangles: &[Candidate], buffers: &mut TileBuffers<E>| {
                if !any {
                    buffers.clear();
                    any = true;
                }
                let TileObjects { order, shades, .. } = &mut *objects;
                if order.len() == first_triangle {
                    let dark = first_triangle * weighted.lights.len();
                    shades.resize(shades.len().max(dark), TileShade::default());
                    shades[..dark].fill(TileShade::default());
                } else if order.len() - first_triangle > TILE_WIDTH * TILE_HEIGHT {
                    forget_triangles(buffers, objects);
                }
                self.near_first(triangles, layers, buffers, window, |candidates, buffers| {
                    for start in (0..candidates.len()).step_by(CHUNK) {
                        if objects.order.len() - first_triangle > most {
                            forget_triangles(buffers, objects);
                        }
                        let TileObjects { order, shades, .. } = &mut *objects;
                        let first_id = order.len();
                        let candidates = &candidates[start..];
                        let triangles =
                            TriangleChunk { triangles: *list, lights: &weighted.lights, candidates, first_id };
                        order.extend(candidates.iter().take(CHUNK).map(|candidate| before + candidate.id));
                        kernels.set_up.call(&view, triangles, buffers, shades);
                        self.refine(kind, triangles, &view, buffers, shades);
                        kernels.nearest_triangles.call(buffers, order, window, &grid, self.fewest_across());
                        if let Some(so_far) = &mut so_far {
                            so_far(buffers, objects);
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

    /// Replaces the planes of the last set-up by the plan's more accurate ones, if it has them.
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

    /// Traces the remaining objects in many tiles, except those behind all of this one.
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

    /// Traces the candidates, layer by layer from near to far, except those that the layers so far hide.
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
        // Kernels write whole registers.
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
                left = not_behind(&mut layer[..count], *least);
                left = visible(&mut layer[..left], parts, window);
            }
            if left > 0 {
                trace(&layer[..left], buffers);
                farthest = None;
            }
        };
        trace_layer(nearest, near);
        starts.iter().rev().for_each(|(start, count)| trace_layer(&mut others[*start..], *count));
    }

    /// The hierarchical depth of a tile, and the least 1/t in all of it.
    fn farthest(&self, buffers: &mut TileBuffers<E>, window: &TileWindow) -> ([f32; TILE_PARTS], f32) {
        buffers.close_around(self.kernels.lanes, window);
        let parts = buffers.farthest(self.kernels.lanes);
        (parts, parts.into_iter().fold(f32::MAX, f32::min))
    }

    /// Traces the spheres of a tile: first those that are not in front.
    fn nearest_spheres(
        &self,
        spheres: &mut Vec<Candidate>,
        weighted: &Weighted,
        buffers: &mut TileBuffers<E>,
        layers: &mut Layers,
        objects: &mut TileObjects<E>,
        window: &TileWindow,
    ) {
        let (grid, kernels, most) = (self.plan.grid(), &self.kernels.tiles, self.most_objects(window));
        let forget_beyond = |most: usize, buffers: &mut TileBuffers<E>, objects: &mut TileObjects<E>| {
            let TileObjects { order, spheres, forgotten, .. } = objects;
            if order.len() > most {
                let mut owns = forget_unseen(buffers, 1, order, &mut [], 0).into_iter().skip(1);
                *forgotten += spheres.candidates.len();
                spheres.candidates.retain(|_| owns.next() == Some(true));
                *forgotten -= spheres.candidates.len();
            }
        };
        if spheres.iter().any(|candidate| candidate.most == Candidate::ANY) {
            for candidate in spheres.extract_if(.., |candidate| candidate.most == Candidate::ANY) {
                let sphere = &self.plan.spheres()[candidate.id as usize];
                let Some(around) = self.plan.around(sphere) else { continue };
                forget_beyond(most, buffers, objects);
                objects.order.push(1 + candidate.id);
                objects.spheres.candidates.push(candidate);
                if self.plan.keep().has(Omission::Misses) || !self.plan.misses(window, sphere) {
                    kernels.around.call(&around, window, buffers, &objects.order);
                }
            }
        }
        self.near_first(spheres, layers, buffers, window, |candidates, buffers| {
            for start in (0..candidates.len()).step_by(CHUNK) {
                forget_beyond(most, buffers, objects);
                let TileObjects { order, spheres, .. } = &mut *objects;
                let first_id = order.len();
                let candidates = &candidates[start..];
                let chunk = &candidates[..candidates.len().min(CHUNK)];
                order.extend(chunk.iter().map(|candidate| 1 + candidate.id));
                spheres.candidates.extend_from_slice(chunk);
                let spheres = SphereChunk { spheres: self.plan.spheres(), candidates };
                kernels.sphere_set_up.call(&weighted.spheres, spheres, first_id, buffers);
                kernels.nearest_spheres.call(buffers, order, window, &grid, self.fewest_across());
            }
        });
    }

    /// See [`MOST_EFFECTS`] and [`MOST_OBJECTS`].
    fn most_objects(&self, window: &TileWindow) -> usize {
        let pixels = window.columns as usize * window.rows.len();
        (MOST_EFFECTS / self.plan.points().len().max(1)).clamp(pixels, MOST_OBJECTS)
    }

    /// A triangle whose bounds have fewer blocks in a row is tested at all of them: with a few, the number left is
    /// mispredicted, so that culling costs as much as it saves.
    fn fewest_across(&self) -> u32 {
        let all = self.plan.keep().has(Omission::Misses);
        if all { u32::MAX } else { (TILE_WIDTH / self.kernels.lanes.min(4) / 2) as u32 }
    }
}

/// Moves those candidates to the front, in order, that are not behind all of a tile; returns their number.
fn not_behind(candidates: &mut [Candidate], least: f32) -> usize {
    if least <= 0.0 {
        return candidates.len();
    }
    let mut count = 0;
    for i in 0..candidates.len() {
        candidates[count] = candidates[i];
        count += usize::from(candidates[i].most >= least);
    }
    count
}

/// Moves those candidates to the front, in order, that may be visible in the window, and returns their number. The others are
/// behind all of the parts of the tile, within the window, where they may be.
fn visible(candidates: &mut [Candidate], parts: &[f32; TILE_PARTS], window: &TileWindow) -> usize {
    const ACROSS: usize = TILE_WIDTH / PART_SIDE;
    // The first and the last part, across or down; the last one comes first if there is none.
    let ends = |bounds: u32, tile: u32, [start, end]: [u32; 2]| {
        let first = (bounds & 0xffff).max(tile + start) - tile;
        let last = (bounds >> 16).min(tile + end).saturating_sub(tile + 1);
        [first, last].map(|pixel| pixel as usize / PART_SIDE)
    };
    let mut count = 0;
    for i in 0..candidates.len() {
        let candidate = candidates[i];
        let [left, right] = ends(candidate.columns, window.column, [0, window.columns]);
        let [top, bottom] = ends(candidate.rows, window.row, [window.rows.start, window.rows.end]);
        let hides = |row: usize, column: usize| parts[(row * ACROSS + column) % TILE_PARTS] > candidate.most;
        let is_hidden = if right.wrapping_sub(left) < 2 && bottom.wrapping_sub(top) < 2 {
            // A branch would be mispredicted.
            hides(top, left) & hides(top, right) & hides(bottom, left) & hides(bottom, right)
        } else {
            (top..=bottom).all(|row| (left..=right).all(|column| hides(row, column)))
        };
        candidates[count] = candidate;
        count += usize::from(!is_hidden);
    }
    count
}

/// Drops the objects of a tile, from id `first` on, that have no pixel, and renumbers the others from there on. Returns
/// which had a pixel, by their old ids; those below `first` count as having one.
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
