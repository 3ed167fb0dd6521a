//! Finds the nearest object at each pixel of a tile: in layers from near to far, with culling.

use std::ops::Range;

use super::shadows::ShadowScratch;
use super::spheres::TileSpheres;
use super::{MOST_EFFECTS, TileTracer};
use crate::kernels::{
    CHUNK, Candidate, Element, ObjectList, PART_SIDE, SphereChunk, TILE_HEIGHT, TILE_PARTS, TILE_WIDTH, TileBuffers,
    TileShade, TileView, TileWindow, TriangleChunk, TriangleList,
};
use crate::plan::{LargeInRow, LargeObjects, Omission, TilePlace, Weighted, compact};

/// In a tile of fewer triangles, or of fewer spheres, culling hidden ones costs more than testing
/// them all.
const FEWEST_HIDDEN: usize = 64;

/// The limit used instead of [`FEWEST_HIDDEN`] where the candidates cover the tile more than
/// [`DEEP`] times.
const FEWEST_DEEP: usize = 16;

/// Candidates that cover a tile more often than this are partitioned once more, and the nearer part
/// is traced first.
const DEEP: u32 = 4;

/// The number of layers of a tile: after so many partitions the remaining candidates are about
/// equally near.
const MOST_LAYERS: usize = 24;

/// How many of the large objects, from the nearest on, are traced together with the tile's own
/// candidates. As long as farther ones may be visible, more follow: each time `LARGE_MORE` times as
/// many as before.
const LARGE_AT_FIRST: usize = 64;
const LARGE_MORE: usize = 4;

/// How many times the candidates' bounds cover the window, estimated from a sample.
fn covers(candidates: &[Candidate], window: &TileWindow) -> u32 {
    let step = candidates.len().div_ceil(8);
    // The bounds of small objects extend about a pixel beyond what the objects cover.
    let length = |bounds: u32, first: u32, side: usize| {
        (bounds >> 16).min(first + side as u32).saturating_sub((bounds & 0xffff).max(first) + 1)
    };
    let area = |candidate: &Candidate| {
        length(candidate.columns, window.column, TILE_WIDTH) * length(candidate.rows, window.row, TILE_HEIGHT)
    };
    let sample: u32 = candidates.iter().step_by(step).map(area).sum();
    (u64::from(sample) * step as u64 / (TILE_WIDTH * TILE_HEIGHT) as u64) as u32
}

/// In a tile with more spheres, or more triangles, those without a pixel are dropped, so that ids
/// remain integers that f32 holds exactly.
const MOST_OBJECTS: usize = 1 << 16;

/// The scratch memory of a thread.
#[derive(Default)]
pub(super) struct Scratch<E: Element> {
    pub buffers: TileBuffers<E>,
    /// The large objects that are in the current row of tiles: spheres, and both kinds of
    /// triangles.
    large: [LargeInRow; 3],
    /// The candidates of a tile, put together here if they come from more than one list of the
    /// plan.
    room: Vec<Candidate>,
    layers: Layers,
    pub objects: TileObjects<E>,
    /// The scratch memory for shadows, if the scene has any.
    pub shadows: Option<Box<ShadowScratch>>,
}

impl<E: Element> Scratch<E> {
    /// If a piece of memory is larger than this, it is not kept.
    const MOST_KEPT: usize = 1 << 20;

    /// The memory to be kept for other plans, without what belongs to this one. None if it is too
    /// much.
    pub(super) fn for_other_plans(self) -> Option<Self> {
        let Scratch { buffers, room, layers, mut objects, .. } = self;
        let Layers { nearest, room: other_room, others, .. } = &layers;
        let candidates = [&room, nearest, other_room, others].map(Vec::capacity).iter().sum::<usize>();
        let bytes = candidates * size_of::<Candidate>() + objects.bytes();
        objects.shades.clear();
        objects.spheres.records.clear();
        (bytes <= Self::MOST_KEPT).then(|| Scratch { buffers, room, layers, objects, ..Scratch::default() })
    }
}

/// The objects of a tile that have been set up, by their ids in the tile. Id 0 is no object;
/// spheres come before triangles.
#[derive(Default)]
pub(super) struct TileObjects<E> {
    /// The objects' indices in the scene.
    pub order: Vec<u32>,
    /// The effect of each light on each triangle. They are 0 for spheres, which have records of
    /// their own.
    pub shades: Vec<TileShade<E>>,
    pub spheres: TileSpheres<E>,
    /// The number of objects that were dropped because they had no pixel.
    pub forgotten: usize,
}

impl<E: Element> TileObjects<E> {
    /// About how much memory the objects take.
    fn bytes(&self) -> usize {
        let TileObjects { order, shades, spheres, .. } = self;
        let records = &spheres.records;
        let of_spheres = size_of_val(&records.spheres[..]) + size_of_val(&records.lits[..]);
        4 * order.capacity() + size_of::<TileShade<E>>() * shades.capacity() + 2 * of_spheres
    }
}

/// A tile's candidates in layers from near to far. The memory is reused from tile to tile.
#[derive(Default)]
struct Layers {
    nearest: Vec<Candidate>,
    /// Memory for partitioning the nearest candidates once more.
    room: Vec<Candidate>,
    /// The candidates of the other layers, the farthest first.
    others: Vec<Candidate>,
    /// The range in `others` of each of these layers.
    ranges: Vec<Range<usize>>,
}

/// The hierarchical depth buffer of a tile.
struct TileDepth {
    /// The least 1/t in each part of the tile.
    parts: [f32; TILE_PARTS],
    /// The least 1/t in the whole tile.
    least: f32,
}

impl<E> TileObjects<E> {
    /// Removes all objects.
    fn clear(&mut self) {
        self.forgotten = 0;
        self.order.clear();
        self.order.push(0);
        self.spheres.candidates.clear();
        self.spheres.places.clear();
    }
}

/// A callback that is given the nearest objects found so far.
pub(super) type NearestSoFar<'a, E> = &'a mut dyn FnMut(&TileBuffers<E>, &TileObjects<E>);

impl<E: Element> TileTracer<'_, E> {
    /// Finds the nearest objects at the pixels of a tile; false if the tile has no candidate.
    /// `so_far` is called after each chunk of triangles.
    pub(super) fn find_nearest(
        &self,
        tile: TilePlace,
        window: &TileWindow,
        // This is not the last argument because it is a pair of pointers: passed on the stack it
        // would be stored in two halves and loaded as a whole, which has to wait for both stores.
        so_far: Option<NearestSoFar<'_, E>>,
        weighted: &Weighted,
        scratch: &mut Scratch<E>,
    ) -> bool {
        let Scratch { buffers, large, room, layers, objects, .. } = scratch;
        objects.clear();
        room.clear();
        let [mut large_spheres, large_triangles @ ..] = self.plan.large(large);
        large_spheres.add(tile, LARGE_AT_FIRST, 0.0, room);
        self.plan.spheres_in(tile, room);
        let is_cleared = !room.is_empty() || self.plan.keep().has(Omission::EmptyTiles);
        if is_cleared {
            buffers.clear();
        }
        if !room.is_empty() {
            if room.len() >= FEWEST_HIDDEN && !self.plan.keep().has(Omission::Occluded) {
                let least = self.plan.least_of_large(tile);
                room.retain(|candidate| candidate.most >= least);
            }
            self.nearest_spheres(room, weighted, buffers, layers, objects, window);
            self.each_large(large_spheres, tile, window, room, buffers, |candidates, buffers| {
                self.nearest_spheres(candidates, weighted, buffers, layers, objects, window);
            });
            self.look_at_spheres(weighted, buffers, &mut objects.spheres, so_far.is_some());
        }
        let mut search = TriangleSearch {
            tracer: self,
            window,
            weighted,
            view: self.plan.view(tile),
            so_far,
            first_triangle: objects.order.len(),
            objects,
            is_cleared,
        };
        let mut first_place = 1 + self.plan.spheres().len() as u32;
        let lists = self.plan.triangle_lists();
        for (kind, (triangles, mut large)) in lists.into_iter().zip(large_triangles).enumerate() {
            let list = TracedList { kind, triangles, first_place };
            room.clear();
            large.add(tile, LARGE_AT_FIRST, 0.0, room);
            self.plan.triangles_in(kind, tile, room, |candidates| search.trace(&list, candidates, layers, buffers));
            self.each_large(large, tile, window, room, buffers, |candidates, buffers| {
                search.trace(&list, candidates, layers, buffers);
            });
            first_place += triangles.len() as u32;
        }
        search.is_cleared
    }

    /// Replaces the planes of the last set-up by the plan's more accurate ones, where the plan has
    /// them.
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

    /// Traces the remaining large objects, except those that are behind everything in this tile.
    fn each_large(
        &self,
        mut large: LargeObjects<'_>,
        tile: TilePlace,
        window: &TileWindow,
        room: &mut Vec<Candidate>,
        buffers: &mut TileBuffers<E>,
        mut trace: impl FnMut(&mut Vec<Candidate>, &mut TileBuffers<E>),
    ) {
        let mut count = LARGE_AT_FIRST;
        while !large.are_through() {
            count = LARGE_MORE.saturating_mul(count);
            let least =
                if self.plan.keep().has(Omission::Occluded) { 0.0 } else { self.farthest(buffers, window).least };
            room.clear();
            large.add(tile, count, least, room);
            if !room.is_empty() {
                trace(room, buffers);
            }
        }
    }

    /// Traces the candidates layer by layer from near to far, except those that earlier layers
    /// hide.
    fn near_first(
        &self,
        candidates: &[Candidate],
        Layers { nearest, room, others, ranges }: &mut Layers,
        buffers: &mut TileBuffers<E>,
        window: &TileWindow,
        mut trace: impl FnMut(&[Candidate], &mut TileBuffers<E>),
    ) {
        let few =
            candidates.len() < FEWEST_HIDDEN && (candidates.len() < FEWEST_DEEP || covers(candidates, window) <= DEEP);
        if few || self.plan.keep().has(Omission::Occluded) {
            return trace(candidates, buffers);
        }
        // The partitioning kernel writes whole registers, and so beyond the end of its results.
        let enough = candidates.len() + CHUNK;
        for layer in [&mut *nearest, room, others] {
            layer.resize(layer.len().max(enough), Candidate::default());
        }
        let mut near = self.packets.nearer_half.call(candidates, nearest, others);
        let mut end = candidates.len() - near;
        ranges.clear();
        ranges.push(0..end);
        while ranges.len() < MOST_LAYERS && covers(&nearest[..near], window) > DEEP {
            let nearer = self.packets.nearer_half.call(&nearest[..near], room, &mut others[end..]);
            if nearer == near {
                break;
            }
            std::mem::swap(nearest, room);
            ranges.push(end..end + near - nearer);
            (near, end) = (nearer, end + near - nearer);
        }
        let mut farthest = None;
        let mut trace_layer = |layer: &mut [Candidate]| {
            let mut left = layer.len();
            if buffers.has_somebody() {
                let depth = farthest.get_or_insert_with(|| self.farthest(buffers, window));
                left = not_behind(layer, depth.least);
                left = visible(&mut layer[..left], &depth.parts, window);
            }
            if left > 0 {
                trace(&layer[..left], buffers);
                farthest = None;
            }
        };
        trace_layer(&mut nearest[..near]);
        for range in ranges.iter().rev() {
            trace_layer(&mut others[range.clone()]);
        }
    }

    /// The hierarchical depth of a tile, within a window.
    fn farthest(&self, buffers: &mut TileBuffers<E>, window: &TileWindow) -> TileDepth {
        buffers.close_around(self.kernels.lanes, window);
        let parts = buffers.farthest(self.kernels.lanes);
        TileDepth { parts, least: parts.into_iter().fold(f32::MAX, f32::min) }
    }

    /// Traces the spheres of a tile: first those that contain the camera or are beside it, then
    /// those in front of it.
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

    /// How many objects a tile sets up before it drops those without a pixel, given
    /// [`MOST_EFFECTS`] and [`MOST_OBJECTS`].
    fn most_objects(&self, window: &TileWindow) -> usize {
        let pixels = window.columns as usize * window.rows.len();
        (MOST_EFFECTS / self.plan.points().len().max(1)).clamp(pixels, MOST_OBJECTS)
    }

    /// A triangle whose bounds are fewer blocks wide is tested at all of them. For so few blocks
    /// the CPU mispredicts how many are left after culling, so that culling costs as much as it
    /// saves.
    fn fewest_across(&self) -> u32 {
        let all = self.plan.keep().has(Omission::Misses);
        if all { u32::MAX } else { (TILE_WIDTH / self.kernels.lanes.min(4) / 2) as u32 }
    }
}

/// A list of triangles in which a tile's candidates are.
struct TracedList<'a> {
    /// The list's index among the plan's lists.
    kind: usize,
    triangles: TriangleList<'a>,
    /// What is added to a triangle's index in the list to give its place among all objects, which
    /// are counted from 1.
    first_place: u32,
}

/// The search for the nearest triangles at the pixels of a tile. The spheres have been searched
/// before.
struct TriangleSearch<'a, 't, 'f, E: Element> {
    tracer: &'a TileTracer<'t, E>,
    window: &'a TileWindow,
    weighted: &'a Weighted,
    view: TileView<f64>,
    so_far: Option<NearestSoFar<'f, E>>,
    objects: &'a mut TileObjects<E>,
    /// The id of the tile's first triangle.
    first_triangle: usize,
    /// Whether the buffers have been cleared for this tile, which is done before its first object.
    is_cleared: bool,
}

impl<E: Element> TriangleSearch<'_, '_, '_, E> {
    /// Traces the candidates of a list, from near to far.
    fn trace(
        &mut self,
        list: &TracedList<'_>,
        candidates: &[Candidate],
        layers: &mut Layers,
        buffers: &mut TileBuffers<E>,
    ) {
        if !self.is_cleared {
            buffers.clear();
            self.is_cleared = true;
        }
        let TileObjects { order, shades, .. } = &mut *self.objects;
        if order.len() == self.first_triangle {
            let dark = self.first_triangle * self.weighted.lights.len();
            shades.resize(shades.len().max(dark), TileShade::default());
            shades[..dark].fill(TileShade::default());
        } else if order.len() - self.first_triangle > TILE_WIDTH * TILE_HEIGHT {
            self.forget_unseen(buffers);
        }
        let (tracer, window) = (self.tracer, self.window);
        let most = tracer.most_objects(window);
        tracer.near_first(candidates, layers, buffers, window, |candidates, buffers| {
            for start in (0..candidates.len()).step_by(CHUNK) {
                if self.objects.order.len() - self.first_triangle > most {
                    self.forget_unseen(buffers);
                }
                self.trace_chunk(list, &candidates[start..], buffers);
            }
        });
    }

    /// Traces the first chunk of the candidates.
    fn trace_chunk(&mut self, list: &TracedList<'_>, candidates: &[Candidate], buffers: &mut TileBuffers<E>) {
        let TriangleSearch { tracer, window, weighted, ref view, .. } = *self;
        let (grid, kernels) = (tracer.plan.grid(), &tracer.kernels.tiles);
        let TileObjects { order, shades, .. } = &mut *self.objects;
        let first_id = order.len();
        let triangles = TriangleChunk { triangles: list.triangles, lights: &weighted.lights, candidates, first_id };
        order.extend(candidates.iter().take(CHUNK).map(|candidate| list.first_place + candidate.id));
        kernels.set_up.call(view, triangles, buffers, shades);
        tracer.refine(list.kind, triangles, view, buffers, shades);
        kernels.nearest_triangles.call(buffers, order, window, &grid, tracer.fewest_across());
        if let Some(so_far) = &mut self.so_far {
            so_far(buffers, self.objects);
        }
    }

    /// Drops the triangles that have no pixel so far.
    fn forget_unseen(&mut self, buffers: &mut TileBuffers<E>) {
        let TileObjects { order, shades, forgotten, .. } = &mut *self.objects;
        let owns = forget_unseen(buffers, self.first_triangle, order, shades, self.weighted.lights.len());
        *forgotten += owns.into_iter().filter(|owns| !owns).count();
    }
}

/// Moves the candidates that are not behind everything in the tile to the front, in order, and
/// returns their number.
fn not_behind(candidates: &mut [Candidate], least: f32) -> usize {
    if least <= 0.0 {
        return candidates.len();
    }
    compact(candidates, |candidate| candidate.most >= least)
}

/// Moves the candidates that may be visible in the window to the front, in order, and returns their
/// number. The others are behind everything in all those parts of the tile that their bounds meet
/// within the window.
fn visible(candidates: &mut [Candidate], parts: &[f32; TILE_PARTS], window: &TileWindow) -> usize {
    const ACROSS: usize = TILE_WIDTH / PART_SIDE;
    // The first and the last part that the bounds meet, across or down. If they meet none, the last
    // is before the first.
    let ends = |bounds: u32, tile: u32, [start, end]: [u32; 2]| {
        let first = (bounds & 0xffff).max(tile + start) - tile;
        let last = (bounds >> 16).min(tile + end).saturating_sub(tile + 1);
        [first, last].map(|pixel| pixel as usize / PART_SIDE)
    };
    compact(candidates, |candidate| {
        let [left, right] = ends(candidate.columns, window.column, [0, window.columns]);
        let [top, bottom] = ends(candidate.rows, window.row, [window.rows.start, window.rows.end]);
        let hides = |row: usize, column: usize| parts[(row * ACROSS + column) % TILE_PARTS] > candidate.most;
        let is_hidden = if right.wrapping_sub(left) < 2 && bottom.wrapping_sub(top) < 2 {
            // `&` and not `&&`, since a branch would be mispredicted.
            hides(top, left) & hides(top, right) & hides(bottom, left) & hides(bottom, right)
        } else {
            (top..=bottom).all(|row| (left..=right).all(|column| hides(row, column)))
        };
        !is_hidden
    })
}

/// Drops the objects of a tile that have no pixel, from the id `first` on, and renumbers the
/// others. Returns for each old id whether its object had a pixel; ids below `first` count as
/// having one.
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
