//! The arguments of the tile kernels: objects and their bounds, a tile and its chunks of objects
//! that have been set up, and its output.

use std::ops::Range;

use super::kernel::{Callee, function, kinds, reads, writes};
use super::objects::{ObjectList, TriangleList};
use super::records::{
    AroundSphere, BoundsFound, BoundsTask, BoundsView, CHUNK, Candidate, Element, HalfTask, LightPosition, MOST_LANES,
    NearestTask, ObjectLight, PART_SIDE, SetupTask, ShadeTask, ShortLight, Sphere, SphereArrays, SpherePlanes,
    SphereView, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, Tile, TileLight, TileRays, TileShade, TileSphere, TileView,
    Triangle, TriangleArrays, TrianglePlanes,
};
use super::types::Plain;

/// The number of squares of a tile in its hierarchical depth buffer.
pub const TILE_PARTS: usize = TILE_PIXELS / (PART_SIDE * PART_SIDE);

/// The greatest id in a tile: f32 holds every integer up to this exactly.
const MOST_ID: usize = 1 << 24;

/// At least as many f64 as any register has.
const MOST_SET_UP: usize = 8;

// The references prove the addresses of the views and slices that kernels read and write, as the
// tasks say. Any bits are valid values of what kernels write.
kinds! {
    /// Finds the bounds of triangles, or of spheres.
    Bounds<T: Bounded> as fn(
        &T::View, T::Many<'_>, u32, bool, &mut [Candidate],
    ) -> CandidatesFound;

    /// Writes the objects that may be visible to the front of `candidates`, in order; all objects
    /// if `keep_all`. The first object has the id `first_id` in the scene. There must be room for
    /// all objects, rounded up to a multiple of [`CHUNK`]. Returns None if there is no object.
    fn call(
        view: &T::View, objects: T::Many<'_>, first_id: u32, keep_all: bool, candidates: &mut [Candidate],
    ) -> Option<CandidatesFound>; |way| {
        assert!(candidates.len() >= objects.len().next_multiple_of(CHUNK), "whole chunks are written");
        assert!(first_id as usize + objects.len() <= MOST_ID, "f32 has every number up to here");
        if objects.is_empty() {
            return None;
        }
        let CandidatesFound { count, mut extremes } = match way {
            Callee::Code(enter) => {
                let (mut arrays, mut found) = (T::Arrays::ZERO, BoundsFound::NONE);
                let [objects_at, vertices] = objects.addresses();
                let task = BoundsTask {
                    objects: objects_at,
                    vertices,
                    count: objects.len() as u64,
                    first_id: first_id.into(),
                    keep_all: if keep_all { (1 << MOST_LANES) - 1 } else { 0 },
                    arrays: writes(&mut arrays),
                    candidates: writes(candidates),
                    found: writes(&mut found),
                };
                enter([reads(view), reads(&task), 0, 0, 0, 0]);
                // The padding of the last chunk comes last in the list.
                let past = first_id + objects.len() as u32;
                let found_here = &candidates[..found.count as usize];
                let last = found_here.iter().rposition(|candidate| candidate.id < past);
                CandidatesFound { count: last.map_or(0, |last| last + 1), extremes: found.extremes() }
            }
            Callee::Rust(find) => find(view, objects, first_id, keep_all, candidates),
        };
        let colours = objects.colours().flat_map(|colour| colour.to_array());
        extremes.brightest = colours.fold(extremes.brightest, above);
        Some(CandidatesFound { count, extremes })
    }

    /// Partitions the candidates of a tile into nearer and farther ones.
    NearerHalf as fn(&[Candidate], &mut [Candidate], &mut [Candidate]) -> usize;

    /// Copies the candidates that are nearer than half way from the nearest to the farthest to the
    /// front of `nearer`, and the others to the front of `farther`, in order. Returns the number of
    /// nearer ones. The memory after them is overwritten. Both must have room for all candidates.
    fn call(candidates: &[Candidate], nearer: &mut [Candidate], farther: &mut [Candidate]) -> usize; |way| {
        assert!(nearer.len() >= candidates.len() && farther.len() >= candidates.len(), "either may get all");
        if candidates.is_empty() {
            return 0;
        }
        match way {
            Callee::Code(enter) => {
                let count = candidates.len() as u64;
                let (candidates, nearer, farther) = (reads(candidates), writes(nearer), writes(farther));
                enter([reads(&HalfTask { candidates, count, nearer, farther }), 0, 0, 0, 0, 0]) as usize
            }
            Callee::Rust(halve) => halve(candidates, nearer, farther),
        }
    }

    /// Finds the nearest wall of a sphere that contains the camera or is beside it.
    Around<E: Element> as fn(&AroundSphere<f64>, &mut [E; TILE_PIXELS], [u32; 2]);

    /// Gives pixels of the tile to this sphere where it is nearest; of equally near objects the
    /// first in the scene wins. The sphere is the last object of `order`, which has the place in
    /// the scene of each object of the tile, and 0 for none.
    fn call(sphere: &AroundSphere<f64>, window: &TileWindow, buffers: &mut TileBuffers<E>, order: &[u32]); |way| {
        window.check();
        let mut near = [E::ZERO; TILE_PIXELS];
        let [column, row] = [window.column, window.row];
        match way {
            Callee::Code(enter) => _ = enter([reads(sphere), writes(&mut near), column.into(), row.into(), 0, 0]),
            Callee::Rust(find) => find(sphere, &mut near, [column, row]),
        }
        buffers.keep_nearer(&near, order);
    }

    /// Sets up triangles as planes over a tile's pixels.
    SetUp<E: Element> as fn(
        &TileView<f64>, TriangleChunk<'_>, &mut TriangleArrays, &mut TrianglePlanes<E>, &mut [TileShade<E>],
    );

    /// Sets up a chunk of triangles in `buffers`. `shades` has a record per light for each id of
    /// the tile, from 0 on. The records of the chunk are written, and `shades` grows if need be.
    fn call(
        view: &TileView<f64>, triangles: TriangleChunk<'_>, buffers: &mut TileBuffers<E>, shades: &mut Vec<TileShade<E>>,
    ); |way| {
        let TriangleChunk { triangles, lights, candidates, first_id } = triangles;
        let PrefetchedChunk { candidates, ahead, later } = chunk_of(candidates, triangles.len());
        let arrays = &mut *buffers.triangles.arrays;
        if let TriangleList::Joined(faces) = triangles {
            faces.paint(candidates, [&mut arrays.red, &mut arrays.green, &mut arrays.blue]);
        }
        let last_id = last_id(first_id, candidates.len());
        // The last packet writes all of its lanes.
        let past = for_each(last_id + 1 + MOST_SET_UP, lights.len());
        let before = first_id * lights.len();
        if shades.len() < past {
            shades.resize(past, TileShade::ZERO);
        }
        buffers.triangles.count = candidates.len();
        buffers.most = buffers.most.max(last_id);
        let (planes, shades) = (&mut *buffers.triangles.planes, &mut shades[before..past]);
        let enter = match way {
            Callee::Code(enter) => enter,
            Callee::Rust(set_up) => {
                let chunk = TriangleChunk { triangles, lights, candidates, first_id };
                return set_up(view, chunk, arrays, planes, shades);
            }
        };
        let [objects, vertices] = triangles.addresses();
        let task = SetupTask {
            objects,
            vertices,
            candidates: reads(candidates),
            count: candidates.len() as u64,
            ahead,
            later,
            arrays: writes(arrays),
            planes: writes(planes),
            shades: writes(shades),
            shorts: 0,
            lights: reads(lights),
            light_count: lights.len() as u64,
            first_id: first_id as u64,
        };
        enter([reads(view), reads(&task), 0, 0, 0, 0]);
    }

    /// Sets up spheres as functions of pixels, each relative to the sphere's own origin.
    SphereSetUp<E: Element> as fn(&SphereView<f64>, SphereChunk<'_>, usize, &mut SphereArrays, &mut SpherePlanes<E>);

    /// Sets up a chunk of spheres in `buffers`. The first of them has the id `first_id` in the
    /// tile.
    fn call(
        view: &SphereView<f64>, spheres: SphereChunk<'_>, first_id: usize, buffers: &mut TileBuffers<E>,
    ); |way| {
        // There is room for a chunk, and so for a chunk's last packet.
        let Chunk { arrays, planes, count } = &mut buffers.spheres;
        let prefetched = spheres.chunk();
        let chunk = SphereChunk { candidates: prefetched.candidates, ..spheres };
        buffers.most = buffers.most.max(last_id(first_id, chunk.candidates.len()));
        *count = chunk.candidates.len();
        match way {
            Callee::Code(enter) => {
                let (planes, first_id) = (writes(&mut **planes), first_id as u64);
                let task = SetupTask { planes, first_id, ..chunk.task(&prefetched, arrays) };
                enter([reads(view), reads(&task), 0, 0, 0, 0]);
            }
            Callee::Rust(set_up) => set_up(view, chunk, first_id, arrays, planes),
        }
    }

    /// Makes the shading records of spheres.
    SphereShading<E: Element> as fn(
        &SphereView<f64>, SphereChunk<'_>, &[TileLight<f64>], bool, usize, &mut SphereRecords<E>,
    );

    /// Makes the records of a chunk of spheres under these lights, from the index `first` on. If
    /// `short`, they have the short form where that is accurate enough; otherwise they have the
    /// long form.
    fn call(
        view: &SphereView<f64>, spheres: SphereChunk<'_>, lights: &[TileLight<f64>], short: bool, first: usize,
        records: &mut SphereRecords<E>,
    ); |way| {
        let prefetched = spheres.chunk();
        let chunk = SphereChunk { candidates: prefetched.candidates, ..spheres };
        records.hold(1 + last_id(first, chunk.candidates.len()), lights.len());
        let enter = match way {
            Callee::Code(enter) => enter,
            Callee::Rust(shade) => return shade(view, chunk, lights, short, first, records),
        };
        let (mut arrays, before) = (SphereArrays::ZERO, first * lights.len());
        let task = SetupTask {
            planes: writes(&mut records.spheres[first..]),
            shades: writes(&mut records.lits[before..]),
            shorts: if short { writes(&mut records.shorts[before..]) } else { 0 },
            lights: reads(lights),
            light_count: lights.len() as u64,
            ..chunk.task(&prefetched, &mut arrays)
        };
        enter([reads(view), reads(&task), 0, 0, 0, 0]);
    }

    /// Finds the nearest of triangles, or of spheres.
    Nearest<P: InTile> as fn(
        &mut Tile<P::Element>, SetUpObjects<'_, P, P::Arrays>, &[u32], &TileWindow, &TileGrid,
    );

    /// Gives pixels of the window to the objects that were set up last where these are nearest; of
    /// equally near objects the first in the scene wins. `order` has the place in the scene of each
    /// id of the tile, from 1, and 0 for none. If the bounds of a triangle are at least
    /// `fewest_across` blocks wide, its blocks outside an edge are culled.
    fn call(
        buffers: &mut TileBuffers<P::Element>, order: &[u32], window: &TileWindow, grid: &TileGrid, fewest_across: u32,
    ); |way| {
        window.check();
        assert!(buffers.most < order.len(), "everyone has a place in the scene");
        let TileAndChunk { tile, chunk: Chunk { arrays, planes, count } } = P::in_tile(buffers);
        if *count == 0 {
            return;
        }
        let enter = match way {
            Callee::Code(enter) => enter,
            Callee::Rust(find) => {
                return find(tile, SetUpObjects { planes, arrays, count: *count }, order, window, grid);
            }
        };
        // Whole packets are read; the padding after the chunk has empty bounds.
        P::columns(arrays)[*count..count.next_multiple_of(MOST_LANES)].fill(0);
        // There is room for a chunk and a tile. The kernel clips all bounds to the window, which is
        // within the tile.
        let task = NearestTask {
            tile: writes(tile),
            arrays: reads(&**arrays),
            order: reads(order),
            count: *count as u64,
            column: window.column.into(),
            row: window.row.into(),
            end_column: window.columns.into(),
            start_row: window.rows.start.into(),
            end_row: window.rows.end.into(),
            half_step: (0.5 * grid.step).to_bits(),
            half_width: grid.half_width.to_bits(),
            half_height: grid.half_height.to_bits(),
            focal: grid.focal.to_bits(),
            fewest_across: fewest_across.into(),
        };
        enter([reads(&**planes), reads(&task), 0, 0, 0, 0]);
    }

    ShadeTile<E: Element, P> as fn(
        &TileRays<E>, &Tile<E>, ShadingRecords<'_, E>, &TileWindow, TileOut<'_, P>,
    );

    /// Shades and writes the pixels of the window.
    fn call(
        rays: &TileRays<E>, buffers: &TileBuffers<E>, shading: ShadingRecords<'_, E>, window: &TileWindow, out: TileOut<'_, P>,
    ); |way| {
        // Every object of the tile has shades, or is a sphere that has records for its lights. The
        // window's pixels are within `out`.
        window.check();
        let ShadingRecords { shades, lights, sphere_ids, spheres, lits, shorts } = shading;
        let (objects, count) = (buffers.most + 1, lights.len());
        // There may be spheres around the camera beside those with a pixel.
        let triangle_count = objects.saturating_sub(1 + sphere_ids.len());
        let shade_count = for_each(objects, count);
        assert!(triangle_count == 0 || shades.len() >= shade_count);
        assert!(lits.len().min(shorts.len()) >= for_each(spheres.len(), count));
        let most = u32::MAX as usize / size_of::<TileShade<E>>();
        assert!(triangle_count == 0 || shade_count <= most, "offsets of triangles' records have 32 bits");
        assert!(sphere_ids.iter().all(|id| (*id as usize) < spheres.len()), "places of records");
        out.check(window);
        let enter = match way {
            Callee::Code(enter) => enter,
            Callee::Rust(shade) => return shade(rays, &buffers.tile, shading, window, out),
        };
        let task = ShadeTask {
            tile: reads(&*buffers.tile),
            shades: reads(shades),
            lights: reads(lights),
            light_count: count as u64,
            sphere_count: sphere_ids.len() as u64,
            triangle_count: triangle_count as u64,
            sphere_ids: reads(sphere_ids),
            spheres: reads(spheres),
            lits: reads(lits),
            shorts: reads(shorts),
            out: writes(&mut out.pixels[out.first..]),
            // If there is a single row, no kernel reads the pitch.
            pitch: out.width.wrapping_mul(size_of::<P>()) as u64,
            column: window.column.into(),
            row: window.row.into(),
            end_column: window.columns.into(),
            start_row: window.rows.start.into(),
            end_row: window.rows.end.into(),
        };
        enter([reads(rays), reads(&task), 0, 0, 0, 0]);
    }
}

/// The last of the ids of this many objects of a tile, at least one, of which `first` is the first.
fn last_id(first: usize, count: usize) -> usize {
    let last = first.saturating_add(count - 1);
    assert!(last <= MOST_ID, "f32 has no number for object {last} of a tile");
    last
}

/// The number of records of this many objects that have `lights` each.
fn for_each(objects: usize, lights: usize) -> usize {
    objects.checked_mul(lights).expect("as many records as memory can hold")
}

/// What is found out about some objects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CandidatesFound {
    /// The number of objects that may be visible.
    pub count: usize,
    /// The extremes of all objects.
    pub extremes: Extremes,
}

/// The extremes of a scene's objects. If a number is NaN, or a colour or radius negative, one of
/// the extremes is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremes {
    /// The greatest size. The size of an object is its greatest coordinate or radius.
    pub most: f32,
    /// The least size: of a triangle, its greatest coordinate; of a sphere, its radius.
    pub least: f32,
    /// The greatest component of a colour, or a negative one if there is any.
    pub brightest: f32,
    /// The greatest [`Candidate::most`] of objects in front of the camera.
    pub nearest: f32,
    /// The longest side of a triangle's bounds, in pixels.
    pub longest: f32,
}

impl Extremes {
    /// The extremes of no objects.
    pub(super) const NONE: Extremes =
        Extremes { most: 0.0, least: f32::from_bits(u32::MAX), brightest: 0.0, nearest: 0.0, longest: 0.0 };

    /// The extremes of the objects of both.
    pub fn and(self, other: Self) -> Self {
        Extremes {
            most: above(self.most, other.most),
            least: f32::from_bits(self.least.to_bits().min(other.least.to_bits())),
            brightest: above(self.brightest, other.brightest),
            nearest: above(self.nearest, other.nearest),
            longest: above(self.longest, other.longest),
        }
    }
}

/// The greater of two numbers by their bits, by which negative numbers are above all others.
pub(super) fn above(a: f32, b: f32) -> f32 {
    f32::from_bits(a.to_bits().max(b.to_bits()))
}

impl BoundsFound {
    /// The record for no triangles.
    const NONE: BoundsFound = BoundsFound {
        most: [0; MOST_LANES],
        least: [u32::MAX; MOST_LANES],
        brightest: [0; MOST_LANES],
        nearest: [0; MOST_LANES],
        longest: [0; MOST_LANES],
        count: 0,
    };

    fn extremes(&self) -> Extremes {
        let most = |of: &[u32]| f32::from_bits(of.iter().fold(0, |a, b| a.max(*b)));
        let least = f32::from_bits(self.least.iter().fold(u32::MAX, |a, b| a.min(*b)));
        Extremes {
            most: most(&self.most),
            least,
            brightest: most(&self.brightest),
            nearest: most(&self.nearest),
            longest: most(&self.longest),
        }
    }
}

/// The pixels of each of many objects: the first column (row), and in the upper 16 bits one past
/// the last.
#[derive(Clone, Debug, Default)]
pub struct PixelBounds {
    pub columns: Vec<u32>,
    pub rows: Vec<u32>,
}

/// The grid of rays, in f64.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "those of scene::Grid")]
pub struct TileGrid {
    pub step: f64,
    pub half_width: f64,
    pub half_height: f64,
    pub focal: f64,
}

/// The part of a tile that is to be traced.
#[derive(Clone, Debug)]
pub struct TileWindow {
    /// The tile's first column in the picture.
    pub column: u32,
    /// The tile's first row in the picture.
    pub row: u32,
    /// The number of columns to trace, from the tile's first one on; `rows` are the tile's rows.
    pub columns: u32,
    pub rows: Range<u32>,
}

impl TileWindow {
    fn check(&self) {
        let TileWindow { column, row, columns, rows } = self;
        let sides = (TILE_WIDTH as u32, TILE_HEIGHT as u32);
        assert!((1..=sides.0).contains(columns) && rows.start < rows.end && rows.end <= sides.1);
        assert!(*column < 1 << 16 && *row < 1 << 16, "bounds have 16 bits");
    }
}

/// Objects of one kind that have been set up.
pub struct Chunk<T, P> {
    arrays: Box<T>,
    planes: Box<P>,
    count: usize,
}

/// Objects of one kind that have been set up, as kernels in Rust get them.
pub struct SetUpObjects<'a, P, A> {
    pub(super) planes: &'a P,
    /// The same objects, transposed.
    pub(super) arrays: &'a A,
    pub(super) count: usize,
}

/// The nearest objects of a tile, and the objects of one kind that were set up last.
pub struct TileAndChunk<'a, E, A, P> {
    tile: &'a mut Tile<E>,
    chunk: &'a mut Chunk<A, P>,
}

/// A kind of objects that are set up for a tile. The trait cannot be named outside of this module,
/// so that only kernels use it: the owner of a tile could otherwise give it another tile's objects.
pub trait InTile: Sized {
    type Element: Element;
    /// The type that holds the same objects, transposed.
    type Arrays;
    /// The tile, and the objects of this kind that were set up for it last.
    fn in_tile(buffers: &mut TileBuffers<Self::Element>) -> TileAndChunk<'_, Self::Element, Self::Arrays, Self>;
    /// The first and last columns of the objects.
    fn columns(arrays: &mut Self::Arrays) -> &mut [u32; CHUNK];
}

/// Implements [`InTile`] for planes, which have transposed arrays and a field of the buffers.
macro_rules! planes {
    ($planes:ident, $arrays:ident, $field:ident) => {
        impl<E: Element> InTile for $planes<E> {
            type Element = E;
            type Arrays = $arrays;
            fn in_tile(buffers: &mut TileBuffers<E>) -> TileAndChunk<'_, E, $arrays, Self> {
                TileAndChunk { tile: &mut buffers.tile, chunk: &mut buffers.$field }
            }
            fn columns(arrays: &mut $arrays) -> &mut [u32; CHUNK] {
                &mut arrays.columns
            }
        }
    };
}

planes!(TrianglePlanes, TriangleArrays, triangles);
planes!(SpherePlanes, SphereArrays, spheres);

/// The nearest object at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestAtPixel<E> {
    /// The object's 1/t; 0 for no object.
    pub inverse_t: E,
    /// The object's id in the tile; 0 for no object.
    pub id: usize,
}

/// A tile's nearest objects, and its chunks of triangles and spheres that have been set up.
/// Together they take half of a core's second-level cache.
pub struct TileBuffers<E> {
    tile: Box<Tile<E>>,
    triangles: Chunk<TriangleArrays, TrianglePlanes<E>>,
    spheres: Chunk<SphereArrays, SpherePlanes<E>>,
    /// The greatest id in the tile.
    most: usize,
}

impl<E: Element> Default for TileBuffers<E> {
    fn default() -> Self {
        TileBuffers {
            tile: Box::new(Tile { near: [E::ZERO; TILE_PIXELS], who: [E::ZERO; TILE_PIXELS] }),
            triangles: Chunk {
                arrays: Box::new(TriangleArrays::ZERO),
                planes: Box::new(TrianglePlanes::ZERO),
                count: 0,
            },
            spheres: Chunk { arrays: Box::new(SphereArrays::ZERO), planes: Box::new(SpherePlanes::ZERO), count: 0 },
            most: 0,
        }
    }
}

impl<E: Element> TileBuffers<E> {
    /// Removes all objects: every pixel is without a hit and infinitely far.
    pub fn clear(&mut self) {
        self.tile.near.fill(E::ZERO);
        self.tile.who.fill(E::ZERO);
        (self.triangles.count, self.spheres.count, self.most) = (0, 0, 0);
    }

    /// The ids at the pixels, block by block; each is below `end`.
    ///
    /// # Panics
    /// If an id may be `end` or more.
    pub(super) fn who(&self, end: usize) -> &[E; TILE_PIXELS] {
        assert!(self.most < end, "ids of {end} objects");
        &self.tile.who
    }

    /// Writes the ids at the pixels as integers.
    pub(crate) fn ids(&self, ids: &mut [u32; TILE_PIXELS]) {
        ids.iter_mut().zip(&self.tile.who).for_each(|(id, who)| *id = who.to_index());
    }

    /// Replaces the ids at all pixels by others, below `end`, whose objects are not set up.
    pub(crate) fn set_ids(&mut self, ids: &[u32; TILE_PIXELS], end: usize) {
        assert!(ids.iter().all(|id| (*id as usize) < end));
        self.most = last_id(end - 1, 1);
        (self.triangles.count, self.spheres.count) = (0, 0);
        self.tile.who.iter_mut().zip(ids).for_each(|(who, id)| *who = E::from_f64(f64::from(*id as i32)));
    }

    /// The triangles that were set up last.
    pub fn planes(&self) -> &TrianglePlanes<E> {
        &self.triangles.planes
    }

    /// The spheres that were set up last.
    pub fn sphere_planes(&self) -> &SpherePlanes<E> {
        &self.spheres.planes
    }

    /// Changes the 1/t of a triangle that was set up last: its value at the tile's middle, and its
    /// increments per column and per row.
    pub fn set_inverse(&mut self, triangle: usize, [at_middle, across, down]: [E; 3]) {
        let planes = &mut self.triangles.planes;
        (planes.t0[triangle], planes.tx[triangle], planes.ty[triangle]) = (at_middle, across, down);
    }

    /// The index of a pixel in the tile's arrays, for kernels with this many lanes.
    fn index(lanes: usize, column: usize, row: usize) -> usize {
        let width = lanes.min(4);
        let height = lanes / width;
        let block = row / height * (TILE_WIDTH / width) + column / width;
        block * lanes + row % height * width + column % width
    }

    /// The nearest object at a pixel of the tile, for kernels with this many lanes.
    pub fn pixel(&self, lanes: usize, column: usize, row: usize) -> NearestAtPixel<E> {
        let i = Self::index(lanes, column, row);
        NearestAtPixel { inverse_t: self.tile.near[i], id: self.tile.who[i].to_f64() as usize }
    }

    /// Gives the pixels outside a window an infinite 1/t and no object: they count as nearer than
    /// anything, and so do not affect the hierarchical depth, which is a least 1/t.
    pub(crate) fn close_around(&mut self, lanes: usize, window: &TileWindow) {
        let (width, height) = (window.columns as usize, window.rows.start as usize..window.rows.end as usize);
        for row in 0..TILE_HEIGHT {
            for column in if height.contains(&row) { width } else { 0 }..TILE_WIDTH {
                let i = Self::index(lanes, column, row);
                (self.tile.near[i], self.tile.who[i]) = (E::from_f64(f64::INFINITY), E::ZERO);
            }
        }
    }

    /// Whether any object has been set up.
    pub fn has_somebody(&self) -> bool {
        self.most > 0
    }

    /// The hierarchical depth of the tile, for kernels with this many lanes: the least 1/t in each
    /// square of [`PART_SIDE`] pixels, row by row, which is 0 if a pixel has no hit. It is in f32,
    /// to which it is rounded in order.
    pub fn farthest(&self, lanes: usize) -> [f32; TILE_PARTS] {
        /// At least this many pixels of a square are contiguous, whatever the number of lanes.
        const TOGETHER: usize = PART_SIDE;
        // Blocks have rows of up to four pixels.
        let height = lanes.div_ceil(4);
        let lesser = |a: E, b: E| if a < b { a } else { b };
        let mut least = [[E::from_f64(f64::MAX); TOGETHER]; TILE_PARTS];
        let rows = self.tile.near.chunks_exact(TILE_WIDTH * height);
        for (row, near) in rows.enumerate() {
            let squares = &mut least[row * height / PART_SIDE * (TILE_WIDTH / PART_SIDE)..];
            for (least, near) in squares.iter_mut().zip(near.chunks_exact(PART_SIDE * height)) {
                let mut so_far = *least;
                for near in near.as_chunks::<TOGETHER>().0 {
                    so_far = std::array::from_fn(|i| lesser(so_far[i], near[i]));
                }
                *least = so_far;
            }
        }
        least.map(|[a, b, c, d, e, f, g, h]| {
            let [a, b, c, d] = [lesser(a, e), lesser(b, f), lesser(c, g), lesser(d, h)];
            lesser(lesser(a, c), lesser(b, d)).to_f64() as f32
        })
    }

    /// Gives pixels to the last object of the tile, whose 1/t at each pixel is in `near`, 0 for a
    /// miss: where it is greater than the pixel's 1/t, or equal and the object comes first in the
    /// scene. `order` has the place in the scene of each object of the tile.
    fn keep_nearer(&mut self, near: &[E; TILE_PIXELS], order: &[u32]) {
        assert!(self.most < order.len(), "everyone has a place in the scene");
        let who = order.len() - 1;
        self.most = self.most.max(last_id(who, 1));
        let (own, mut ties) = (E::from_f64(who as f64), false);
        // Without branches, so that the compiler uses vector instructions.
        for ((near, there), there_who) in near.iter().zip(&mut self.tile.near).zip(&mut self.tile.who) {
            ties |= *near == *there;
            *there_who = if *near > *there { own } else { *there_who };
            *there = if *near > *there { *near } else { *there };
        }
        if ties {
            for ((near, there), there_who) in near.iter().zip(&self.tile.near).zip(&mut self.tile.who) {
                if *near == *there && *near > E::ZERO && order[who] < order[there_who.to_index() as usize] {
                    *there_who = own;
                }
            }
        }
    }

    /// Counts the pixels of a window that have a hit, for kernels with this many lanes.
    pub(crate) fn count_hits(&self, lanes: usize, window: &TileWindow) -> u64 {
        // Counters as wide as the compared numbers, so that a register holds as many of both.
        let somebody = |who: &E| u32::from(*who != E::ZERO);
        if (window.rows.len(), window.columns as usize) == (TILE_HEIGHT, TILE_WIDTH) {
            return self.tile.who.iter().map(somebody).sum::<u32>().into();
        }
        let row = |row: u32| {
            let at = move |column: u32| Self::index(lanes, column as usize, row as usize);
            (0..window.columns).map(|column| somebody(&self.tile.who[at(column)])).sum::<u32>()
        };
        window.rows.clone().map(row).sum::<u32>().into()
    }

    /// Sets the pixels of a window that have no hit to `rest`, for kernels with this many lanes.
    pub fn fill_rest<P: Copy>(&self, lanes: usize, window: &TileWindow, rest: P, out: TileOut<'_, P>) {
        let across = lanes.min(4);
        for (row, out) in window.rows.clone().zip(out.pixels[out.first..].chunks_mut(out.width)) {
            let blocks = self.tile.who[Self::index(lanes, 0, row as usize)..].chunks(lanes);
            for (who, out) in blocks.zip(out[..window.columns as usize].chunks_mut(across)) {
                out.iter_mut().zip(who).filter(|(_, who)| **who == E::ZERO).for_each(|(out, _)| *out = rest);
            }
        }
    }

    /// Sets `owners` to true at the ids of all objects that have a pixel, and at 0 if some pixel
    /// has no hit.
    pub(crate) fn mark_owners(&self, owners: &mut [bool]) {
        assert!(self.most < owners.len());
        // Converts 16 numbers to integers at once: converting them one by one takes longer than
        // everything else here.
        for who in self.tile.who.as_chunks::<16>().0 {
            who.map(E::to_index).into_iter().for_each(|who| owners[who as usize] = true);
        }
    }

    /// Replaces each id at a pixel by a new one, below `end`: the number at its index.
    pub(crate) fn renumber(&mut self, numbers: &[u32], end: usize) {
        assert!(self.most < numbers.len() && end > 0);
        // This comes first, since a number that is not below `end` would panic and leave the rest
        // undone. Objects that are set up have the old ids.
        self.most = self.most.max(last_id(end - 1, 1));
        (self.triangles.count, self.spheres.count) = (0, 0);
        for who in &mut self.tile.who {
            let number = numbers[who.to_index() as usize];
            assert!((number as usize) < end);
            *who = E::from_f64(number.into());
        }
        self.most = end - 1;
    }
}

/// An object whose bounds a kernel computes.
pub trait Bounded: Plain {
    type Many<'a>: ObjectList<Object = Self>;
    /// The view of the picture that the kernel takes.
    type View;
    /// A chunk of objects, transposed.
    type Arrays: Plain;
}

impl Bounded for Triangle {
    type Many<'a> = TriangleList<'a>;
    type View = BoundsView<f32>;
    type Arrays = TriangleArrays;
}

impl Bounded for Sphere {
    type Many<'a> = &'a [Sphere];
    type View = SphereView<f64>;
    type Arrays = SphereArrays;
}

/// Triangles, the lights on them, and a selection of triangles whose first chunk is processed.
#[derive(Clone, Copy)]
pub struct TriangleChunk<'a> {
    /// All triangles of the scene that share corners, or all that do not.
    pub triangles: TriangleList<'a>,
    pub lights: &'a [TileLight<f64>],
    /// The first [`CHUNK`] candidates, or all if there are fewer, are the chunk. The next ones are
    /// prefetched.
    pub candidates: &'a [Candidate],
    /// The id in the tile of the first candidate.
    pub first_id: usize,
}

/// Spheres, and a selection of spheres whose first chunk is processed.
#[derive(Clone, Copy)]
pub struct SphereChunk<'a> {
    /// All spheres of the scene.
    pub spheres: &'a [Sphere],
    /// The first [`CHUNK`] candidates, or all if there are fewer, are the chunk. The next ones are
    /// prefetched.
    pub candidates: &'a [Candidate],
}

impl<'a> SphereChunk<'a> {
    /// The candidates of the chunk, and what is prefetched after it.
    fn chunk(self) -> PrefetchedChunk<'a> {
        chunk_of(self.candidates, self.spheres.len())
    }

    /// The task for both kernels that set up spheres: the objects of this chunk, what is prefetched
    /// after it, and their arrays, but no output.
    fn task(self, prefetched: &PrefetchedChunk<'_>, arrays: &mut SphereArrays) -> SetupTask {
        let SphereChunk { spheres, candidates } = self;
        SetupTask {
            objects: reads(spheres),
            candidates: reads(candidates),
            count: candidates.len() as u64,
            ahead: prefetched.ahead,
            later: prefetched.later,
            arrays: writes(arrays),
            ..SetupTask::default()
        }
    }
}

/// The candidates of a chunk, and how many candidates the next two chunks have, which are
/// prefetched.
struct PrefetchedChunk<'a> {
    candidates: &'a [Candidate],
    ahead: u64,
    later: u64,
}

/// The first chunk of these candidates, which are indices of `objects` objects.
fn chunk_of(candidates: &[Candidate], objects: usize) -> PrefetchedChunk<'_> {
    let (candidates, others) = candidates.split_at(candidates.len().min(CHUNK));
    let (ahead, others) = others.split_at(others.len().min(CHUNK));
    // Faces of later chunks are read too, to prefetch their vertices.
    let most = candidates.iter().chain(ahead).map(|candidate| candidate.id).max();
    assert!(most.is_some_and(|most| (most as usize) < objects), "ids of objects");
    PrefetchedChunk { candidates, ahead: ahead.len() as u64, later: others.len().min(CHUNK) as u64 }
}

/// The shading records of the spheres that have a pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SphereRecords<E> {
    pub spheres: Vec<TileSphere<E>>,
    /// Records of the long form: for each sphere as many as there are lights.
    pub lits: Vec<ObjectLight<E>>,
    /// Records of the short form: for each sphere as many as there are lights.
    pub shorts: Vec<ShortLight<E>>,
}

impl<E: Element> SphereRecords<E> {
    /// Reserves memory for this many spheres, with this many lights each. The vectors would grow by
    /// themselves, but copy their content.
    pub(crate) fn hold(&mut self, spheres: usize, lights: usize) {
        fn grow<T: Plain>(records: &mut Vec<T>, len: usize) {
            records.resize(records.len().max(len), T::ZERO);
        }
        // The last packet writes all of its lanes.
        grow(&mut self.spheres, spheres.saturating_add(MOST_SET_UP));
        // As many as there are records of spheres, whatever number was requested.
        let lits = for_each(self.spheres.len(), lights);
        grow(&mut self.lits, lits);
        grow(&mut self.shorts, lits);
    }

    /// Drops all records; the next ones may have another number of lights.
    pub(crate) fn clear(&mut self) {
        self.spheres.clear();
        self.lits.clear();
        self.shorts.clear();
    }

    /// Copies the record of a sphere to another index, without the `hidden` ones of its `lights`.
    pub(crate) fn without(&mut self, from: usize, to: usize, hidden: impl Iterator<Item = usize>, lights: usize) {
        self.spheres[to] = self.spheres[from];
        self.lits.copy_within(from * lights..(from + 1) * lights, to * lights);
        self.shorts.copy_within(from * lights..(from + 1) * lights, to * lights);
        for light in hidden {
            let (lit, short) = (&mut self.lits[to * lights + light], &mut self.shorts[to * lights + light]);
            (lit.red, lit.green, lit.blue) = (E::ZERO, E::ZERO, E::ZERO);
            (short.red, short.green, short.blue) = (E::ZERO, E::ZERO, E::ZERO);
        }
    }
}

/// The shading records of the objects of a tile.
#[derive(Clone, Copy)]
pub struct ShadingRecords<'a, E> {
    /// A record per light for each id of the tile, from 0 on; zeros for spheres.
    pub shades: &'a [TileShade<E>],
    pub lights: &'a [LightPosition<E>],
    /// The index of the record of each of the tile's spheres, which come before its triangles.
    pub sphere_ids: &'a [u32],
    /// The records of the spheres that have a pixel.
    pub spheres: &'a [TileSphere<E>],
    /// Records of the long form: for each of these spheres as many as there are lights.
    pub lits: &'a [ObjectLight<E>],
    /// Records of the short form, weighted for bytes, for the spheres whose `short` is set.
    pub shorts: &'a [ShortLight<E>],
}

/// Where a tile's pixels are written.
pub struct TileOut<'a, P> {
    /// The pixels of whole rows of the picture.
    pub pixels: &'a mut [P],
    /// The index of the window's first pixel in `pixels`.
    pub first: usize,
    /// The number of pixels from one row to the next.
    pub width: usize,
}

impl<P> TileOut<'_, P> {
    /// Checks that `pixels` has the pixels of a window, which is not empty.
    fn check(&self, window: &TileWindow) {
        let columns = window.columns as usize;
        assert!(columns <= self.width, "rows of {} pixels", self.width);
        let past = (window.rows.len() - 1).checked_mul(self.width).and_then(|rows| rows.checked_add(columns));
        let past = past.and_then(|past| past.checked_add(self.first));
        assert!(past.is_some_and(|past| past <= self.pixels.len()), "a window past the last pixel");
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::*;

    #[test]
    fn numbers_of_a_tile_are_within_the_told_greatest() {
        type Change = fn(&mut TileBuffers<f32>);
        let changes: [(&str, Change, usize); 4] = [
            ("a number that f32 has not", |buffers| buffers.keep_nearer(&[1.0; TILE_PIXELS], &vec![0; MOST_ID + 2]), 1),
            ("new numbers of which one is past the end", |buffers| buffers.renumber(&[5000, 9000], 6000), 5999),
            ("new numbers of which f32 has not all", |buffers| buffers.renumber(&[0, 1], MOST_ID + 2), 1),
            ("new numbers of which there is none", |buffers| buffers.renumber(&[0, 1], 0), 1),
        ];
        for (what, change, most) in changes {
            let mut buffers = TileBuffers::<f32>::default();
            buffers.keep_nearer(&[1.0; TILE_PIXELS], &[0, 1]);
            assert!(catch_unwind(AssertUnwindSafe(|| change(&mut buffers))).is_err(), "{what}");
            assert_eq!(buffers.most, most, "{what}");
        }
        let mut buffers = TileBuffers::<f32>::default();
        (buffers.triangles.count, buffers.spheres.count) = (1, 1);
        buffers.keep_nearer(&[1.0; TILE_PIXELS], &[0, 1, 2, 3]);
        buffers.renumber(&[0, 0, 0, 1], 2);
        assert_eq!((buffers.most, buffers.triangles.count, buffers.spheres.count), (1, 0, 0), "set up by old numbers");
    }
}
