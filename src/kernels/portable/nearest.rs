//! Finds the nearest object at each pixel of a tile, and what culling hidden objects needs.
//!
//! The twins of the kernels in asm/tracers/nearest.asm, around.asm and nearer_half.asm.

use std::marker::PhantomData;
use std::ops::Range;

use glam::DVec3;

use super::super::records::{
    AroundSphere, Candidate, Element, SphereArrays, SpherePlanes, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, Tile,
    TriangleArrays, TrianglePlanes,
};
use super::super::tiles::{SetUpObjects, TileGrid, TileWindow};
use super::lanes::{Each, Lanes, Number, Packet, cross_unfused, dot_unfused};
use super::spheres;

/// The division of a tile into blocks, each of which has a pixel for every lane.
pub struct Blocks<L>(PhantomData<L>);

impl<L: Lanes> Blocks<L> {
    pub const WIDTH: usize = if L::COUNT < 4 { L::COUNT } else { 4 };
    pub const HEIGHT: usize = L::COUNT / Self::WIDTH;
    pub const ACROSS: usize = TILE_WIDTH / Self::WIDTH;

    /// The columns and rows of a block's pixels, relative to its first pixel.
    #[inline(always)]
    pub fn pixels() -> [L; 2] {
        let number = |i: usize| L::Number::from_f64(i as f64);
        [L::from_fn(|i| number(i % Self::WIDTH)), L::from_fn(|i| number(i / Self::WIDTH))]
    }

    /// The column and row in the tile of the pixel at an index.
    pub fn pixel(at: usize) -> [usize; 2] {
        let (block, lane) = (at / L::COUNT, at % L::COUNT);
        let (column, row) = (block % Self::ACROSS * Self::WIDTH, block / Self::ACROSS * Self::HEIGHT);
        [column + lane % Self::WIDTH, row + lane / Self::WIDTH]
    }
}

/// A linear function along a row: name0 + namey y, and namex, its coefficient of x: PLANE_ROW and
/// PLANE_AT.
pub type Row<L> = [L; 2];

#[inline(always)]
fn at<L: Lanes>([row, factor]: Row<L>, x: L) -> L {
    row.fma(factor, x)
}

/// The columns and rows where an object may be, as in [`Candidate`], and the object's id in the
/// tile.
pub struct PixelsAndId<E> {
    columns: u32,
    rows: u32,
    id: E,
}

/// Objects of one kind as functions of a tile's pixels. All lanes of a packet have the same object.
pub trait Planes<L: Lanes> {
    /// The objects' bounds, and the data by which f64 decides a hit where the functions cannot.
    type Transposed;
    /// An object's functions along a row of pixels.
    type Row: Copy;

    /// The pixels where an object may be, and its id in the tile.
    fn place(&self, of: &Self::Transposed, at: usize) -> PixelsAndId<L::Number>;
    /// Two limits of `measure`: below the first no ray hits the object, and from the second on
    /// every ray surely does. Between them, rounding may decide.
    fn bounds(&self, at: usize) -> [L; 2];
    /// The functions along a row of blocks, whose pixels have the distances y from the tile's
    /// middle; the middle is at `middle` in the picture.
    fn row(&self, at: usize, y: L, middle: [f64; 2]) -> Self::Row;
    fn measure(row: Self::Row, x: L) -> L;
    /// The object's 1/t at x, where its measure is `measure`.
    fn inverse(row: Self::Row, x: L, measure: L) -> L;
    /// Whether the ray `d` hits the object.
    fn hits(&self, of: &Self::Transposed, at: usize, d: DVec3) -> bool;
}

/// A vector from numbers given as bits, in f64.
fn wide(numbers: [&[u32]; 3], at: usize) -> DVec3 {
    DVec3::from_array(numbers.each(|numbers| f32::from_bits(numbers[at]).into()))
}

/// A single number in f64, without fused operations, by which the reference's decisions are
/// repeated.
type ScalarF64 = Packet<f64, 1, false>;

fn one(v: DVec3) -> [ScalarF64; 3] {
    v.to_array().each(ScalarF64::of)
}

/// Whether a ray is inside all edges of a triangle whose volume has the sign of `side`:
/// IF_OUTSIDE_TRIANGLE.
#[inline(always)]
pub fn is_in_triangle<W: Lanes<Number = f64>>([a, b, c]: [[W; 3]; 3], side: W, d: [W; 3]) -> bool {
    let side = W::of(1.0).with_sign_of(side);
    let is_inside = |(v, w)| (dot_unfused(d, cross_unfused(v, w)) * side).not_less(W::of(0.0)).any();
    [(a, b), (b, c), (c, a)].into_iter().all(is_inside)
}

/// Whether a ray meets a sphere: IF_OUTSIDE_SPHERE. That computes c x d, whose squares are those of
/// d x c.
#[inline(always)]
pub fn is_in_sphere<W: Lanes<Number = f64>>(centre: [W; 3], radius: W, d: [W; 3]) -> bool {
    let across = cross_unfused(d, centre);
    (dot_unfused(d, d) * radius * radius).not_less(dot_unfused(across, across)).any()
}

/// A sphere's functions along a row of pixels, relative to the sphere's own origin.
#[derive(Clone, Copy)]
pub struct SphereFunctions<L> {
    /// The discriminant D at x = 0, and its coefficients of x and x^2.
    pub d: [L; 3],
    pub h: Row<L>,
}

/// A sphere's functions along the row y, relative to its origin: SPHERE_ROW.
#[inline(always)]
pub fn sphere_row<L: Lanes>(planes: &SpherePlanes<L::Number>, at: usize, y: L) -> SphereFunctions<L> {
    let all = |numbers: &[L::Number; _]| L::all(numbers[at]);
    let d = all(&planes.d0).fma(all(&planes.dy).fma(all(&planes.dyy), y), y);
    let linear = all(&planes.dx).fma(all(&planes.dxy), y);
    let h = all(&planes.h).fma(all(&planes.hy), y);
    SphereFunctions { d: [d, linear, all(&planes.dxx)], h: [h, all(&planes.hx)] }
}

/// The discriminant D at x, relative to a sphere's origin: SPHERE_D_AT.
#[inline(always)]
pub fn sphere_d<L: Lanes>([d, linear, square]: [L; 3], x: L) -> L {
    d.fma(linear.fma(square, x), x)
}

/// 1/t at x, where the discriminant is `d`: SPHERE_INVERSE_AT.
#[inline(always)]
pub fn sphere_inverse<L: Lanes>(h: Row<L>, x: L, d: L, most: L) -> L {
    (at(h, x) + d.max(L::of(0.0)).sqrt()).min(most)
}

/// A triangle's functions along a row of pixels.
#[derive(Clone, Copy)]
pub struct TriangleRow<L> {
    edges: [Row<L>; 3],
    /// 1/t along the row; `most` is its upper bound.
    inverse: Row<L>,
    most: L,
}

impl<L: Lanes> Planes<L> for TrianglePlanes<L::Number> {
    type Transposed = TriangleArrays;
    type Row = TriangleRow<L>;

    #[inline(always)]
    fn place(&self, of: &TriangleArrays, at: usize) -> PixelsAndId<L::Number> {
        PixelsAndId { columns: of.columns[at], rows: of.rows[at], id: self.id[at] }
    }
    #[inline(always)]
    fn bounds(&self, _: usize) -> [L; 2] {
        [L::of(-1.0), L::of(1.0)]
    }
    #[inline(always)]
    fn row(&self, at: usize, y: L, _: [f64; 2]) -> Self::Row {
        let planes = [
            (&self.e10, &self.e1x, &self.e1y),
            (&self.e20, &self.e2x, &self.e2y),
            (&self.e30, &self.e3x, &self.e3y),
            (&self.t0, &self.tx, &self.ty),
        ];
        let along = |(origin, across, down): (&[_; _], &[_; _], &[_; _])| {
            [L::all(origin[at]).fma(L::all(down[at]), y), L::all(across[at])]
        };
        let [first, second, third, inverse] = planes.each(along);
        TriangleRow { edges: [first, second, third], inverse, most: L::all(self.most[at]) }
    }
    #[inline(always)]
    fn measure(TriangleRow { edges: [a, b, c], .. }: Self::Row, x: L) -> L {
        at(a, x).min(at(b, x)).min(at(c, x))
    }
    #[inline(always)]
    fn inverse(TriangleRow { inverse, most, .. }: Self::Row, x: L, _: L) -> L {
        at(inverse, x).min(most)
    }
    fn hits(&self, of: &TriangleArrays, at: usize, d: DVec3) -> bool {
        let [a, b, c] = [[&of.ax, &of.ay, &of.az], [&of.bx, &of.by, &of.bz], [&of.cx, &of.cy, &of.cz]]
            .each(|corner| wide(corner.each(|numbers| &numbers[..]), at));
        is_in_triangle([a, b, c].each(one), ScalarF64::of(self.side[at].to_f64()), one(d))
    }
}

/// A sphere's functions along a row of pixels.
#[derive(Clone, Copy)]
pub struct SphereRow<L> {
    functions: SphereFunctions<L>,
    /// An upper bound of 1/t.
    most: L,
    /// The distance of the sphere's origin from the tile's middle, in columns.
    offset: L,
}

impl<L: Lanes> Planes<L> for SpherePlanes<L::Number> {
    type Transposed = SphereArrays;
    type Row = SphereRow<L>;

    #[inline(always)]
    fn place(&self, of: &SphereArrays, at: usize) -> PixelsAndId<L::Number> {
        PixelsAndId { columns: of.columns[at], rows: of.rows[at], id: self.id[at] }
    }
    #[inline(always)]
    fn bounds(&self, at: usize) -> [L; 2] {
        let bound = L::all(self.bound[at]);
        [bound.negated(), bound]
    }
    #[inline(always)]
    fn row(&self, at: usize, y: L, [column, row]: [f64; 2]) -> Self::Row {
        let all = |numbers: &[L::Number; _]| L::all(numbers[at]);
        let y = y + (L::of(row) - all(&self.row));
        let functions = sphere_row(self, at, y);
        SphereRow { functions, most: all(&self.most), offset: L::of(column) - all(&self.column) }
    }
    #[inline(always)]
    fn measure(SphereRow { functions, offset, .. }: Self::Row, x: L) -> L {
        sphere_d(functions.d, x + offset)
    }
    #[inline(always)]
    fn inverse(SphereRow { functions, most, offset }: Self::Row, x: L, d: L) -> L {
        sphere_inverse(functions.h, x + offset, d, most)
    }
    fn hits(&self, of: &SphereArrays, at: usize, d: DVec3) -> bool {
        is_in_sphere(one(wide([&of.x, &of.y, &of.z], at)), ScalarF64::of(f32::from_bits(of.radius[at]).into()), one(d))
    }
}

/// The range of columns, or rows, of an object's bounds that are within a window of the tile that
/// begins at `tile`.
fn within(bounds: u32, tile: u32, window: Range<u32>) -> Range<usize> {
    let place = |x: u32| x.saturating_sub(tile) as usize;
    place(bounds & 0xffff).max(window.start as usize)..place(bounds >> 16).min(window.end as usize)
}

/// An object that is tested at the pixels of a tile.
struct TestedObject<'a, L: Lanes, P: Planes<L>> {
    planes: &'a P,
    arrays: &'a P::Transposed,
    order: &'a [u32],
    window: &'a TileWindow,
    grid: &'a TileGrid,
    /// The object's index among the objects that were set up.
    index: usize,
    id: L::Number,
    /// The two limits of the measure; see [`Planes::bounds`].
    inside: L,
    sure: L,
}

/// The measure and 1/t of an object at the pixels of a block, and 1/t of the nearest object so far.
#[derive(Clone, Copy)]
struct BlockOfHits<L> {
    measure: L,
    w: L,
    there: L,
    /// A mask of the lanes that the object may hit, within rounding, and where it is not farther
    /// than the nearest object so far.
    hit: L,
}

impl<L: Lanes, P: Planes<L>> TestedObject<'_, L, P> {
    /// Gives the object those pixels of a block where it is nearest. The block's first pixel has
    /// the index `first` in the tile; x are the columns of its pixels, from the tile's middle.
    #[inline(always)]
    fn test_block(&self, row: P::Row, x: L, first: usize, near: &mut [L::Number], who: &mut [L::Number]) {
        let measure = P::measure(row, x);
        let there = L::load(near);
        let hit = measure.not_less(self.inside);
        if hit.any() {
            let w = P::inverse(row, x, measure);
            let mut hit = hit.and(w.not_less(there));
            if hit.any() {
                let open = w.equal(there).zip(self.sure.greater(measure), Number::or);
                if hit.and(open).any() {
                    let block = BlockOfHits { measure, w, there, hit };
                    hit = L::from_fn(|lane| Number::mask(self.stays(&block, lane, first + lane, who[lane])));
                }
                hit.select(w, there).store(near);
                hit.select(L::all(self.id), L::load(who)).store(who);
            }
        }
    }

    /// Whether a hit counts that is exactly as near as another one, or within rounding of an edge.
    /// Of two equally near objects the first in the scene wins; an empty pixel keeps any tie.
    /// Within rounding f64 decides, as in the reference.
    #[inline(always)]
    fn stays(&self, block: &BlockOfHits<L>, lane: usize, pixel: usize, owner: L::Number) -> bool {
        let place = |id: L::Number| self.order[id.to_index() as usize];
        let comes_first = || place(owner) > place(self.id);
        let is_hit = || {
            let [column, row] = Blocks::<L>::pixel(pixel);
            let centre = |tile: u32, pixel: usize| self.grid.step * (f64::from(tile) + pixel as f64 + 0.5);
            let x = centre(self.window.column, column) - self.grid.half_width;
            let y = self.grid.half_height - centre(self.window.row, row);
            self.planes.hits(self.arrays, self.index, DVec3::new(x, y, self.grid.focal))
        };
        let is_tie = block.w.lane(lane) == block.there.lane(lane);
        let is_sure = block.measure.lane(lane) >= self.sure.lane(lane);
        block.hit.lane(lane).is_set() && (!is_tie || comes_first()) && (is_sure || is_hit())
    }
}

/// Gives pixels of the window to the objects that are nearest there. Of equally near objects the
/// first in the scene wins.
pub fn nearest<L: Lanes, P: Planes<L>>(
    tile: &mut Tile<L::Number>,
    SetUpObjects { planes, arrays, count }: SetUpObjects<'_, P, P::Transposed>,
    order: &[u32],
    window: &TileWindow,
    grid: &TileGrid,
) {
    let [block_x, block_y] = Blocks::<L>::pixels();
    let (width, height) = (Blocks::<L>::WIDTH, Blocks::<L>::HEIGHT);
    let middle = [window.column as usize + TILE_WIDTH / 2, window.row as usize + TILE_HEIGHT / 2].each(|x| x as f64);
    for index in 0..count {
        let PixelsAndId { columns, rows, id } = planes.place(arrays, index);
        let columns = within(columns, window.column, 0..window.columns);
        let rows = within(rows, window.row, window.rows.clone());
        if columns.is_empty() || rows.is_empty() {
            continue;
        }
        let blocks = columns.start / width..columns.end.div_ceil(width);
        let [inside, sure] = planes.bounds(index);
        let tested = TestedObject { planes, arrays, order, window, grid, index, id, inside, sure };
        for down in rows.start / height..rows.end.div_ceil(height) {
            let y = L::of((down * height) as f64 - (TILE_HEIGHT / 2) as f64) + block_y;
            let row = planes.row(index, y, middle);
            let mut x = L::of((blocks.start * width) as f64 - (TILE_WIDTH / 2) as f64) + block_x;
            let pixels = (down * Blocks::<L>::ACROSS + blocks.start) * L::COUNT
                ..(down * Blocks::<L>::ACROSS + blocks.end) * L::COUNT;
            let near = tile.near[pixels.clone()].chunks_exact_mut(L::COUNT);
            let who = tile.who[pixels.clone()].chunks_exact_mut(L::COUNT);
            for ((near, who), first) in near.zip(who).zip(pixels.step_by(L::COUNT)) {
                tested.test_block(row, x, first, near, who);
                x = x + L::of(width as f64);
            }
        }
    }
}

/// Computes 1/t of a sphere that contains the camera or is beside it, at all pixels of the tile
/// that begins at `column` and `row`.
pub fn around<L: Lanes, W: Lanes<Number = f64>>(
    sphere: &AroundSphere<f64>,
    near: &mut [L::Number; TILE_PIXELS],
    [column, row]: [u32; 2],
) {
    for first in (0..TILE_PIXELS).step_by(W::COUNT) {
        let [x, y] = [(0, column), (1, row)]
            .each(|(axis, tile)| W::of(tile.into()) + W::from_fn(|lane| Blocks::<L>::pixel(first + lane)[axis] as f64));
        spheres::around(sphere, x, y).store(&mut near[first..]);
    }
}

/// Partitions candidates by their upper bounds of 1/t at the middle, by their bits, of the nearest
/// and the farthest.
pub fn nearer_half(candidates: &[Candidate], nearer: &mut [Candidate], farther: &mut [Candidate]) -> usize {
    let bits = || candidates.iter().map(|candidate| candidate.most.to_bits());
    let most = bits().filter(|most| *most != f32::MAX.to_bits()).max().unwrap_or(0);
    let middle = (bits().min().unwrap_or(0) + most) / 2;
    let (mut near, mut far) = (0, 0);
    // Without a branch, which would be mispredicted.
    for candidate in candidates {
        let is_near = candidate.most.to_bits() >= middle;
        (nearer[near], farther[far]) = (*candidate, *candidate);
        (near, far) = (near + usize::from(is_near), far + usize::from(!is_near));
    }
    near
}
