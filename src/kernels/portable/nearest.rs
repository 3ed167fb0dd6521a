//! Finding the nearest object at each pixel of a tile, and what culling hidden objects needs.
//!
//! The twins of asm/tracers/nearest.asm, around.asm and nearer_half.asm.

use std::marker::PhantomData;
use std::ops::Range;

use glam::DVec3;

use super::super::records::{
    AroundSphere, Candidate, Element, SphereArrays, SpherePlanes, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, Tile,
    TriangleArrays, TrianglePlanes,
};
use super::super::tiles::{TileGrid, TileWindow};
use super::lanes::{Each, Lanes, Number};
use super::spheres;

/// The division of a tile into blocks, each of as many pixels as there are lanes.
pub struct Blocks<L>(PhantomData<L>);

impl<L: Lanes> Blocks<L> {
    pub const WIDTH: usize = if L::COUNT < 4 { L::COUNT } else { 4 };
    pub const HEIGHT: usize = L::COUNT / Self::WIDTH;
    pub const ACROSS: usize = TILE_WIDTH / Self::WIDTH;

    /// The columns and rows of a block's pixels, from its first one.
    #[inline(always)]
    pub fn pixels() -> [L; 2] {
        let number = |i: usize| L::Number::from_f64(i as f64);
        [L::from_fn(|i| number(i % Self::WIDTH)), L::from_fn(|i| number(i / Self::WIDTH))]
    }

    /// The column and row in the tile of a pixel's index.
    pub fn pixel(at: usize) -> [usize; 2] {
        let (block, lane) = (at / L::COUNT, at % L::COUNT);
        let (column, row) = (block % Self::ACROSS * Self::WIDTH, block / Self::ACROSS * Self::HEIGHT);
        [column + lane % Self::WIDTH, row + lane / Self::WIDTH]
    }
}

/// name0 + namex x + namey y, along a row: PLANE_ROW and PLANE_AT.
type Row<L> = [L; 2];

#[inline(always)]
fn at<L: Lanes>([row, factor]: Row<L>, x: L) -> L {
    row.fma(factor, x)
}

/// Objects of a kind as functions of a tile's pixels. All lanes have the same object.
pub trait Planes<L: Lanes> {
    /// Their bounds, and the data that decide a hit where the functions cannot.
    type Transposed;
    /// The function of an object along a row.
    type Row: Copy;

    /// The columns and rows where an object may be, and its id in the tile.
    fn place(&self, of: &Self::Transposed, at: usize) -> ([u32; 2], L::Number);
    /// The values of its measure from which it may be hit, within rounding, and from which it surely is.
    fn bounds(&self, at: usize) -> [L; 2];
    /// The function along a row of blocks, with pixels y from the tile's middle, which is at `middle` in the picture.
    fn row(&self, at: usize, y: L, middle: [f64; 2]) -> Self::Row;
    fn measure(row: Self::Row, x: L) -> L;
    /// Its 1/t at x, where it has this measure.
    fn inverse(row: Self::Row, x: L, measure: L) -> L;
    /// Whether the ray `d` hits it.
    fn hits(&self, of: &Self::Transposed, at: usize, d: DVec3) -> bool;
}

/// As a DVec3.
fn wide(numbers: [&[u32]; 3], at: usize) -> DVec3 {
    DVec3::from_array(numbers.each(|numbers| f32::from_bits(numbers[at]).into()))
}

impl<L: Lanes> Planes<L> for TrianglePlanes<L::Number> {
    type Transposed = TriangleArrays;
    /// Three edges, 1/t, and the upper bound of 1/t.
    type Row = ([Row<L>; 4], L);

    #[inline(always)]
    fn place(&self, of: &TriangleArrays, at: usize) -> ([u32; 2], L::Number) {
        ([of.columns[at], of.rows[at]], self.id[at])
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
        (planes.each(along), L::all(self.most[at]))
    }
    #[inline(always)]
    fn measure(([a, b, c, _], _): Self::Row, x: L) -> L {
        at(a, x).min(at(b, x)).min(at(c, x))
    }
    #[inline(always)]
    fn inverse(([_, _, _, t], most): Self::Row, x: L, _: L) -> L {
        at(t, x).min(most)
    }
    fn hits(&self, of: &TriangleArrays, at: usize, d: DVec3) -> bool {
        let [a, b, c] = [[&of.ax, &of.ay, &of.az], [&of.bx, &of.by, &of.bz], [&of.cx, &of.cy, &of.cz]]
            .each(|corner| wide(corner.each(|numbers| &numbers[..]), at));
        let side = 1f64.copysign(self.side[at].to_f64());
        [(a, b), (b, c), (c, a)].into_iter().all(|(v, w)| d.dot(v.cross(w)) * side >= 0.0)
    }
}

impl<L: Lanes> Planes<L> for SpherePlanes<L::Number> {
    type Transposed = SphereArrays;
    /// D at x = 0, its coefficients of x and x^2, h, the upper bound of 1/t, and its origin's offset from the middle.
    type Row = ([L; 3], Row<L>, L, L);

    #[inline(always)]
    fn place(&self, of: &SphereArrays, at: usize) -> ([u32; 2], L::Number) {
        ([of.columns[at], of.rows[at]], self.id[at])
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
        let d = all(&self.d0).fma(all(&self.dy).fma(all(&self.dyy), y), y);
        let linear = all(&self.dx).fma(all(&self.dxy), y);
        let h = all(&self.h).fma(all(&self.hy), y);
        ([d, linear, all(&self.dxx)], [h, all(&self.hx)], all(&self.most), L::of(column) - all(&self.column))
    }
    #[inline(always)]
    fn measure(([d, linear, square], _, _, offset): Self::Row, x: L) -> L {
        let x = x + offset;
        d.fma(linear.fma(square, x), x)
    }
    #[inline(always)]
    fn inverse((_, h, most, offset): Self::Row, x: L, d: L) -> L {
        (at(h, x + offset) + d.max(L::of(0.0)).sqrt()).min(most)
    }
    fn hits(&self, of: &SphereArrays, at: usize, d: DVec3) -> bool {
        let (radius, x) = (f64::from(f32::from_bits(of.radius[at])), wide([&of.x, &of.y, &of.z], at).cross(d));
        d.dot(d) * radius * radius >= x.dot(x)
    }
}

/// The range of columns, or rows, of bounds within a tile that begins at `tile`.
fn within(bounds: u32, tile: u32, window: Range<u32>) -> Range<usize> {
    let place = |x: u32| x.saturating_sub(tile) as usize;
    place(bounds & 0xffff).max(window.start as usize)..place(bounds >> 16).min(window.end as usize)
}

/// Gives the window's pixels where nothing is nearer, or as near and first, to the first `count` objects.
pub fn nearest<L: Lanes, P: Planes<L>>(
    tile: &mut Tile<L::Number>,
    (planes, of, count): (&P, &P::Transposed, usize),
    order: &[u32],
    window: &TileWindow,
    grid: &TileGrid,
) {
    let [block_x, block_y] = Blocks::<L>::pixels();
    let (width, height) = (Blocks::<L>::WIDTH, Blocks::<L>::HEIGHT);
    let middle = [window.column as usize + TILE_WIDTH / 2, window.row as usize + TILE_HEIGHT / 2].each(|x| x as f64);
    for object in 0..count {
        let ([columns, rows], id) = planes.place(of, object);
        let (columns, rows) =
            (within(columns, window.column, 0..window.columns), within(rows, window.row, window.rows.clone()));
        if columns.is_empty() || rows.is_empty() {
            continue;
        }
        let blocks = columns.start / width..columns.end.div_ceil(width);
        let ([inside, sure], own) = (planes.bounds(object), L::all(id));
        for down in rows.start / height..rows.end.div_ceil(height) {
            let y = L::of((down * height) as f64 - (TILE_HEIGHT / 2) as f64) + block_y;
            let row = planes.row(object, y, middle);
            let mut x = L::of((blocks.start * width) as f64 - (TILE_WIDTH / 2) as f64) + block_x;
            let pixels = (down * Blocks::<L>::ACROSS + blocks.start) * L::COUNT
                ..(down * Blocks::<L>::ACROSS + blocks.end) * L::COUNT;
            let near = tile.near[pixels.clone()].chunks_exact_mut(L::COUNT);
            let who = tile.who[pixels.clone()].chunks_exact_mut(L::COUNT);
            for ((near, who), first) in near.zip(who).zip(pixels.step_by(L::COUNT)) {
                let measure = P::measure(row, x);
                let there = L::load(near);
                let hit = measure.not_less(inside);
                if hit.any() {
                    let w = P::inverse(row, x, measure);
                    let mut hit = hit.and(w.not_less(there));
                    if hit.any() {
                        let open = w.equal(there).zip(sure.greater(measure), Number::or);
                        if hit.and(open).any() {
                            // Equally near: the first in the scene wins, and an empty pixel wins any tie. Within the
                            // rounding f64 decides, as in the reference.
                            hit = L::from_fn(|lane| {
                                let comes_first =
                                    || order[who[lane].to_index() as usize] > order[id.to_index() as usize];
                                let is_hit = || {
                                    let [column, row] = Blocks::<L>::pixel(first + lane);
                                    let centre =
                                        |tile: u32, pixel: usize| grid.step * (f64::from(tile) + pixel as f64 + 0.5);
                                    let x = centre(window.column, column) - grid.half_width;
                                    let y = grid.half_height - centre(window.row, row);
                                    planes.hits(of, object, DVec3::new(x, y, grid.focal))
                                };
                                let is_tie = w.lane(lane) == there.lane(lane);
                                let is_sure = measure.lane(lane) >= sure.lane(lane);
                                let stays =
                                    hit.lane(lane).is_set() && (!is_tie || comes_first()) && (is_sure || is_hit());
                                Number::mask(stays)
                            });
                        }
                        hit.select(w, there).store(near);
                        hit.select(own, L::load(who)).store(who);
                    }
                }
                x = x + L::of(width as f64);
            }
        }
    }
}

/// 1/t of a sphere around the camera or beside it at all pixels of the tile that begins there.
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

/// Partitions candidates at the middle, by their bits, of the nearest and the farthest.
pub fn nearer_half(candidates: &[Candidate], nearer: &mut [Candidate], farther: &mut [Candidate]) -> usize {
    let bits = || candidates.iter().map(|candidate| candidate.most.to_bits());
    let most = bits().filter(|most| *most != f32::MAX.to_bits()).max().unwrap_or(0);
    let middle = (bits().min().unwrap_or(0) + most) / 2;
    let (mut near, mut far) = (0, 0);
    // A branch would be mispredicted.
    for candidate in candidates {
        let is_near = candidate.most.to_bits() >= middle;
        (nearer[near], farther[far]) = (*candidate, *candidate);
        (near, far) = (near + usize::from(is_near), far + usize::from(!is_near));
    }
    near
}
