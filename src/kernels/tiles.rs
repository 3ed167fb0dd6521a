//! The tile kernels: a table of them per ISA and element type, their records, and safe calls.

#[cfg(rayo_asm)]
use std::marker::PhantomData;
#[cfg(rayo_asm)]
use std::ops::Range;

use glam::Vec3;

#[cfg(rayo_asm)]
use super::checked::{self, Fault};
#[cfg(rayo_asm)]
use super::spans::Lit;
use super::spans::{Element, records};
use super::types::Plain;

/// Pixels of a tile, across.
pub const TILE_WIDTH: usize = 64;
/// Pixels of a tile, down.
pub const TILE_HEIGHT: usize = 32;
/// Objects that are set up at a time.
pub const CHUNK: usize = 64;

/// A flat triangle, seen from both sides: as a scene holds it, where set-up reads it in place.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Facet {
    /// Red, green, blue, each at least 0.
    pub colour: Vec3,
    /// The three corners, in the camera's frame and in the file's order.
    pub vertices: [Vec3; 3],
}

// SAFETY: twelve floats that fill it, as the offsets asserted in types.rs show.
unsafe impl Plain for Facet {
    const ZERO: Self = Facet { colour: Vec3::ZERO, vertices: [Vec3::ZERO; 3] };
}

/// A sphere, eq. 2 of the paper: all points at distance `radius` from `centre`. As a scene holds it, where set-up reads it in
/// place.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Ball {
    /// Greater than 0.
    pub radius: f32,
    /// Red, green, blue, each at least 0.
    pub colour: Vec3,
    /// The centre, in the camera's frame.
    pub centre: Vec3,
}

// SAFETY: seven floats that fill it, as the offsets asserted in types.rs show.
unsafe impl Plain for Ball {
    const ZERO: Self = Ball { radius: 0.0, colour: Vec3::ZERO, centre: Vec3::ZERO };
}

/// An object that a tile may see.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Seen {
    /// Its number in the scene.
    pub id: u32,
    /// The columns of the picture where it may be: the first, and the one past the last in the upper 16 bits.
    pub columns: u32,
    /// The rows.
    pub rows: u32,
    /// What its 1/t cannot exceed: [`Seen::ANY`] if it may be any.
    pub near: f32,
}

impl Seen {
    /// As `near`: a triangle that reaches behind the camera's plane, or a sphere that does or is around the camera, which no
    /// kernel traces.
    pub const ANY: f32 = f32::MAX;
}

// SAFETY: four numbers that fill it, as the offsets asserted in types.rs show.
unsafe impl Plain for Seen {
    const ZERO: Self = Seen { id: 0, columns: 0, rows: 0, near: 0.0 };
}

records! {
    /// What turns corners into bounds.
    BoundsView { to_pixels, column, row, low, high, width, height, near, all_columns, all_rows, reach, outside }
    /// The rays of a tile as set-up sees them.
    TileView { dx, dy, dz, step, down, scale, bound_x, bound_y, bound_z, bound_0 }
    /// A light as set-up sees it.
    TileLight { x, y, z, red, green, blue }
    /// The rays as set-up of spheres sees them.
    SphereView { step, half_width, half_height, focal, scale, width, height, near, far, white }
    /// What shading needs to know of a sphere in front of the camera, seen from outside.
    TileSphere {
        column, row, d0, dx, dy, dxx, dxy, dyy, mx, mxx, mxy, my, myx, myy, mz, mzx, mzy, ux, uy, uz, short, pad1, pad2, pad3,
    }
    /// What one light does to a sphere, in the short form.
    ShortLit { q0, qx, qy, kn, ke, red, green, blue }
    /// The rays of a tile as shading sees them.
    TileRays { dx, dy, dz, step, down }
    /// What one light does to a triangle.
    TileShade { cosine, red, green, blue }
}

/// Where a light stands, seen from the camera, and a 0.
pub type TilePoint<E> = [E; 4];

/// Defines a structure of a chunk's numbers, all of one field after another, and what it is before anything is written.
macro_rules! turned_round {
    ($(#[$doc:meta])* $name:ident $(<$element:ident>)? { $($type:ty: $($field:ident)*;)* }) => {
        $(#[$doc])*
        #[derive(Clone)]
        #[repr(C, align(64))]
        #[expect(missing_docs, reason = "tile_layout.inc says what each field is")]
        pub struct $name $(<$element>)? {
            $($(pub $field: [$type; CHUNK],)*)*
        }

        #[cfg(rayo_asm)]
        impl $(<$element: Element>)? $name $(<$element>)? {
            const ZERO: Self = $name { $($($field: [<$type as Plain>::ZERO; CHUNK],)*)* };
        }
    };
}

turned_round! {
    /// The corners of a chunk of triangles, turned round.
    Corners {
        f32: ax ay az bx by bz cx cy cz red green blue;
        u32: columns rows;
        f32: near;
    }
}

turned_round! {
    /// A chunk of spheres, turned round.
    Balls {
        f32: x y z radius red green blue;
        u32: columns rows;
        f32: near;
    }
}

turned_round! {
    /// A chunk of spheres as functions of the pixels from their own origins.
    SpherePlanes<E> {
        E: column row d0 dx dy dxx dxy dyy bound h hx hy most id;
    }
}

turned_round! {
    /// A chunk of triangles as functions of a tile's pixels.
    TrianglePlanes<E> {
        E: e1x e1y e10 e2x e2y e20 e3x e3y e30 tx ty t0 most side id;
    }
}

/// The pixels of a tile in blocks: 1/t and who.
#[cfg(rayo_asm)]
#[derive(Clone)]
#[repr(C, align(64))]
pub struct Tile<E> {
    pub(super) near: [E; TILE_PIXELS],
    pub(super) who: [E; TILE_PIXELS],
}

/// Pixels of a tile.
#[cfg(rayo_asm)]
const TILE_PIXELS: usize = TILE_WIDTH * TILE_HEIGHT;

/// More elements than a register has of f64.
#[cfg(rayo_asm)]
const MOST_SET_UP: usize = 8;

/// More elements than any register has.
#[cfg(rayo_asm)]
const MOST_LANES: usize = 16;

/// Defines `call`, and `call_checked`, of a kernel that takes a view and the task that `Self::task` makes of the other
/// arguments and of some room.
#[cfg(rayo_asm)]
macro_rules! calls {
    ($(#[$doc:meta])* ($view:ty, $($argument:ident: $type:ty),*) with $room:expr) => {
        $(#[$doc])*
        pub fn call(&self, view: &$view, $($argument: $type),*) {
            let mut room = $room;
            let task = Self::task($($argument,)* &mut room);
            // SAFETY: task() proves what it says of ids, places and lengths; the references prove the rest. The table that
            // the code came from was handed out by packets(), which had checked the CPU.
            unsafe { (self.code)(view, &task) }
        }

        /// As `call`, with a look at whether the kernel keeps the calling convention.
        pub fn call_checked(&self, view: &$view, $($argument: $type),*) -> Result<(), Vec<Fault>> {
            let mut room = $room;
            let task = Self::task($($argument,)* &mut room);
            let args = [std::ptr::from_ref(view) as u64, std::ptr::from_ref(&task) as u64, 0, 0, 0, 0];
            // SAFETY: as in call; these are the arguments of its signature.
            unsafe { checked::call(self.code as *const (), args) }
        }
    };
}

#[cfg(rayo_asm)]
mod spheres;

#[cfg(rayo_asm)]
pub use calls::*;
#[cfg(rayo_asm)]
pub use spheres::*;

#[cfg(rayo_asm)]
mod calls {
    use super::*;

    /// As bounds reads it.
    #[repr(C)]
    pub(in crate::kernels) struct BoundsTask {
        pub(in crate::kernels) objects: *const (),
        pub(in crate::kernels) count: u64,
        pub(in crate::kernels) first_id: u64,
        pub(in crate::kernels) keep_all: u64,
        pub(in crate::kernels) turned: *mut (),
        pub(in crate::kernels) seen: *mut Seen,
        pub(in crate::kernels) found: *mut BoundsFound,
    }

    /// As bounds writes it.
    #[repr(C)]
    pub(in crate::kernels) struct BoundsFound {
        pub(in crate::kernels) most: [u32; MOST_LANES],
        pub(in crate::kernels) least: [u32; MOST_LANES],
        pub(in crate::kernels) brightest: [u32; MOST_LANES],
        pub(in crate::kernels) coloured: [u32; MOST_LANES],
        pub(in crate::kernels) nearest: [u32; MOST_LANES],
        pub(in crate::kernels) count: u64,
    }

    /// The extremes of a scene's objects. What is not a number, and a negative colour or radius, is among them for sure.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Extremes {
        /// The greatest size, which is that of an object's greatest coordinate or radius.
        pub most: f32,
        /// The least: a triangle's by its greatest coordinate, a sphere's by its radius.
        pub least: f32,
        /// The greatest number in a colour, or a negative one.
        pub brightest: f32,
        /// Whether red, green and blue differ in any bit of some colour.
        pub coloured: bool,
        /// The greatest [`Seen::near`] of those in front of the camera.
        pub nearest: f32,
    }

    impl Extremes {
        /// Those of both.
        pub fn and(self, other: Self) -> Self {
            let most = |a: f32, b: f32| f32::from_bits(a.to_bits().max(b.to_bits()));
            Extremes {
                most: most(self.most, other.most),
                least: f32::from_bits(self.least.to_bits().min(other.least.to_bits())),
                brightest: most(self.brightest, other.brightest),
                coloured: self.coloured | other.coloured,
                nearest: most(self.nearest, other.nearest),
            }
        }
    }

    /// As set-up reads it: addresses of elements have no type, so that one layout serves both.
    #[repr(C)]
    pub(in crate::kernels) struct SetupTask {
        pub(in crate::kernels) objects: *const (),
        pub(in crate::kernels) seen: *const Seen,
        pub(in crate::kernels) count: u64,
        pub(in crate::kernels) ahead: u64,
        pub(in crate::kernels) turned: *mut (),
        pub(in crate::kernels) planes: *mut (),
        pub(in crate::kernels) shades: *mut (),
        pub(in crate::kernels) shorts: *mut (),
        pub(in crate::kernels) lights: *const TileLight<f64>,
        pub(in crate::kernels) light_count: u64,
        pub(in crate::kernels) first_id: u64,
    }

    /// As the kernels that find the nearest read it.
    #[repr(C)]
    pub(in crate::kernels) struct NearestTask {
        pub(in crate::kernels) tile: *mut (),
        pub(in crate::kernels) turned: *const (),
        pub(in crate::kernels) order: *const u32,
        pub(in crate::kernels) count: u64,
        pub(in crate::kernels) column: u64,
        pub(in crate::kernels) row: u64,
        pub(in crate::kernels) end_column: u64,
        pub(in crate::kernels) start_row: u64,
        pub(in crate::kernels) end_row: u64,
        pub(in crate::kernels) half_step: f64,
        pub(in crate::kernels) half_width: f64,
        pub(in crate::kernels) half_height: f64,
        pub(in crate::kernels) focal: f64,
    }

    /// As shading reads it.
    #[repr(C)]
    pub(in crate::kernels) struct ShadeTask {
        pub(in crate::kernels) tile: *const (),
        pub(in crate::kernels) shades: *const (),
        pub(in crate::kernels) lights: *const (),
        pub(in crate::kernels) light_count: u64,
        pub(in crate::kernels) sphere_count: u64,
        pub(in crate::kernels) triangle_count: u64,
        pub(in crate::kernels) sphere_ids: *const u32,
        pub(in crate::kernels) spheres: *const (),
        pub(in crate::kernels) lits: *const (),
        pub(in crate::kernels) shorts: *const (),
        pub(in crate::kernels) out: *mut (),
        pub(in crate::kernels) pitch: u64,
        pub(in crate::kernels) column: u64,
        pub(in crate::kernels) row: u64,
        pub(in crate::kernels) end_column: u64,
        pub(in crate::kernels) start_row: u64,
        pub(in crate::kernels) end_row: u64,
    }

    /// The pixels of each of many objects: the first column (row), and the one past the last in the upper 16 bits.
    #[derive(Clone, Debug, Default)]
    pub struct PixelBounds {
        /// Columns.
        pub columns: Vec<u32>,
        /// Rows.
        pub rows: Vec<u32>,
    }

    /// The grid of rays in f64.
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
        /// Columns of the tile, from its first on.
        pub columns: u32,
        /// Rows of the tile.
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

    /// Objects of one kind that are set up.
    pub struct Chunk<T, P> {
        pub(super) turned: Box<T>,
        pub(super) planes: Box<P>,
        pub(super) count: usize,
    }

    /// What the objects of a kind become in a tile.
    pub trait InTile: Sized {
        /// Its numbers.
        type Element: Element;
        /// The same objects turned round.
        type Turned;
        /// The nearest objects of a tile, and those of this kind that were set up for it last.
        fn in_tile(
            buffers: &mut TileBuffers<Self::Element>,
        ) -> (&mut Tile<Self::Element>, &mut Chunk<Self::Turned, Self>);
        /// Where the objects' columns are.
        fn columns(turned: &mut Self::Turned) -> &mut [u32; CHUNK];
    }

    /// Says of planes where they are in the buffers, and what is turned round for them.
    macro_rules! planes {
        ($planes:ident, $turned:ident, $field:ident) => {
            impl<E: Element> InTile for $planes<E> {
                type Element = E;
                type Turned = $turned;
                fn in_tile(buffers: &mut TileBuffers<E>) -> (&mut Tile<E>, &mut Chunk<$turned, Self>) {
                    (&mut buffers.tile, &mut buffers.$field)
                }
                fn columns(turned: &mut $turned) -> &mut [u32; CHUNK] {
                    &mut turned.columns
                }
            }
        };
    }

    planes!(TrianglePlanes, Corners, triangles);
    planes!(SpherePlanes, Balls, spheres);

    /// A tile's nearest objects, and the chunks of triangles and of spheres that are set up for it: half of a core's cache.
    pub struct TileBuffers<E> {
        tile: Box<Tile<E>>,
        triangles: Chunk<Corners, TrianglePlanes<E>>,
        pub(super) spheres: Chunk<Balls, SpherePlanes<E>>,
        /// The greatest number of an object of the tile.
        pub(super) most: usize,
    }

    impl<E: Element> Default for TileBuffers<E> {
        fn default() -> Self {
            TileBuffers {
                tile: Box::new(Tile { near: [E::ZERO; TILE_PIXELS], who: [E::ZERO; TILE_PIXELS] }),
                triangles: Chunk { turned: Box::new(Corners::ZERO), planes: Box::new(TrianglePlanes::ZERO), count: 0 },
                spheres: Chunk { turned: Box::new(Balls::ZERO), planes: Box::new(SpherePlanes::ZERO), count: 0 },
                most: 0,
            }
        }
    }

    impl<E: Element> TileBuffers<E> {
        /// Forgets all objects: nobody, infinitely far.
        pub fn clear(&mut self) {
            self.tile.near.fill(E::ZERO);
            self.tile.who.fill(E::ZERO);
            (self.triangles.count, self.spheres.count, self.most) = (0, 0, 0);
        }

        /// The 1/t of the farthest pixel of each part of the tile, 0 where a pixel is nobody's, for kernels of so many
        /// lanes.
        pub fn farthest(&self, lanes: usize) -> Farthest {
            let least = |a: E, b: E| if b < a { b } else { a };
            let mut parts = [[E::from_f64(f64::INFINITY); PART_SIDE]; PARTS_ACROSS * PARTS_DOWN];
            // A part's pixels in a row of blocks follow one another.
            let block_height = (lanes / 4).max(1);
            for (i, row) in self.tile.near.chunks_exact(TILE_WIDTH * block_height).enumerate() {
                let parts = &mut parts[i * block_height / PART_SIDE * PARTS_ACROSS..][..PARTS_ACROSS];
                for (part, near) in parts.iter_mut().zip(row.chunks_exact(PART_SIDE * block_height)) {
                    for near in near.as_chunks::<PART_SIDE>().0 {
                        part.iter_mut().zip(near).for_each(|(part, near)| *part = least(*part, *near));
                    }
                }
            }
            let parts = parts.map(|part| part.into_iter().fold(part[0], least).to_f64());
            Farthest { all: parts.into_iter().fold(f64::INFINITY, f64::min), parts }
        }

        /// The triangles that were set up last.
        pub fn planes(&self) -> &TrianglePlanes<E> {
            &self.triangles.planes
        }

        /// The spheres that were set up last.
        pub fn sphere_planes(&self) -> &SpherePlanes<E> {
            &self.spheres.planes
        }

        /// Where the pixel of a tile is in [`TileBuffers::pixel`] of kernels with as many lanes.
        fn index(lanes: usize, column: usize, row: usize) -> usize {
            let width = lanes.min(4);
            let height = lanes / width;
            let block = row / height * (TILE_WIDTH / width) + column / width;
            block * lanes + row % height * width + column % width
        }

        /// 1/t and who at a pixel of the tile, for kernels of so many lanes.
        pub fn pixel(&self, lanes: usize, column: usize, row: usize) -> (E, usize) {
            let i = Self::index(lanes, column, row);
            (self.tile.near[i], self.tile.who[i].to_f64() as usize)
        }

        /// Makes a pixel the object's number `who`, with this 1/t, unless something as near is there.
        pub fn nearest(&mut self, lanes: usize, column: usize, row: usize, near: E, who: usize) {
            let i = Self::index(lanes, column, row);
            if near.to_f64() > self.tile.near[i].to_f64() {
                self.tile.near[i] = near;
                self.tile.who[i] = E::from_f64(who as f64);
                self.most = self.most.max(who);
            }
        }

        /// Says true of the numbers of all objects that some pixel has, and of nobody's where one has none.
        pub fn mark_owners(&self, owners: &mut [bool]) {
            assert!(self.most < owners.len());
            self.tile.who.iter().for_each(|who| owners[who.to_index()] = true);
        }

        /// Gives everyone who has a pixel another number, below `end`: the one at the place of the present one.
        pub fn renumber(&mut self, numbers: &[u32], end: usize) {
            assert!(self.most < numbers.len());
            for who in &mut self.tile.who {
                let number = numbers[who.to_index()];
                assert!((number as usize) < end);
                *who = E::from_f64(number.into());
            }
            self.most = end - 1;
        }
    }

    /// Sides of a part of a tile, in pixels: a square whose farthest pixel is known.
    const PART_SIDE: usize = 8;
    const PARTS_ACROSS: usize = TILE_WIDTH / PART_SIDE;
    const PARTS_DOWN: usize = TILE_HEIGHT / PART_SIDE;

    /// What is farthest in each part of a tile: 1/t.
    pub struct Farthest {
        /// Of the whole tile.
        all: f64,
        parts: [f64; PARTS_ACROSS * PARTS_DOWN],
    }

    impl Farthest {
        /// Whether all pixels of a window of the tile where the triangle may be have something nearer than it can be.
        #[inline]
        pub fn hides(&self, seen: &Seen, window: &TileWindow) -> bool {
            if self.all > seen.near.into() {
                return true;
            }
            let parts = |bounds: u32, first: u32, start: u32, end: u32| {
                let (start, end) = ((bounds & 0xffff).max(first + start) - first, (bounds >> 16).min(first + end));
                (start as usize / PART_SIDE, (end.saturating_sub(first + 1)) as usize / PART_SIDE)
            };
            let (left, right) = parts(seen.columns, window.column, 0, window.columns);
            let (top, bottom) = parts(seen.rows, window.row, window.rows.start, window.rows.end);
            let at = |row: usize, column: usize| self.parts[(row * PARTS_ACROSS + column) % self.parts.len()];
            if right > left + 1 || bottom > top + 1 {
                return (top..=bottom).all(|row| (left..=right).all(|column| at(row, column) > seen.near.into()));
            }
            let farthest = f64::min(at(top, left).min(at(top, right)), at(bottom, left).min(at(bottom, right)));
            farthest > seen.near.into()
        }
    }

    /// An object whose bounds a kernel finds.
    pub trait Bounded: Plain {
        /// How it sees the picture.
        type View;
        /// A chunk of them, turned round.
        type Turned;
        /// One that is not filled yet.
        const TURNED: Self::Turned;
    }

    impl Bounded for Facet {
        type View = BoundsView<f32>;
        type Turned = Corners;
        const TURNED: Corners = Corners::ZERO;
    }

    impl Bounded for Ball {
        type View = SphereView<f64>;
        type Turned = Balls;
        const TURNED: Balls = Balls::ZERO;
    }

    /// Finds the bounds of triangles, or of spheres.
    pub struct Bounds<T: Bounded> {
        pub(in crate::kernels) code: unsafe extern "sysv64" fn(*const T::View, *const BoundsTask),
        pub(in crate::kernels) symbol: &'static str,
    }

    impl<T: Bounded> Bounds<T> {
        /// The symbol of its code.
        pub fn symbol(&self) -> &'static str {
            self.symbol
        }

        /// Writes those of the objects that may be seen to the front of `seen`, in order, the first object being number
        /// `first_id` of the scene; and gives how many they are, and the extremes of all. With `keep_all` all of them may
        /// be. There must be room for all objects, up to a multiple of [`CHUNK`]. None where there is no object.
        pub fn call(
            &self,
            view: &T::View,
            objects: &[T],
            first_id: u32,
            keep_all: bool,
            seen: &mut [Seen],
        ) -> Option<(usize, Extremes)> {
            let (mut turned, mut found) = (T::TURNED, BoundsFound::NONE);
            let task = Self::task(objects, first_id, keep_all, seen, &mut turned, &mut found)?;
            // SAFETY: task() proves that there is an object and room for the results; the references the rest. The table it
            // came from was handed out by packets(), which had checked the CPU.
            unsafe { (self.code)(view, &task) }
            // What fills the last chunk comes last.
            let past = first_id + objects.len() as u32;
            let count = seen[..found.count as usize].iter().rposition(|seen| seen.id < past).map_or(0, |last| last + 1);
            Some((count, found.extremes()))
        }

        /// As [`Bounds::call`], with a look at whether the kernel keeps the calling convention.
        pub fn call_checked(
            &self,
            view: &T::View,
            objects: &[T],
            first_id: u32,
            keep_all: bool,
            seen: &mut [Seen],
        ) -> Result<(), Vec<Fault>> {
            let (mut turned, mut found) = (T::TURNED, BoundsFound::NONE);
            let task = Self::task(objects, first_id, keep_all, seen, &mut turned, &mut found);
            let Some(task) = task else { return Ok(()) };
            let args = [std::ptr::from_ref(view) as u64, std::ptr::from_ref(&task) as u64, 0, 0, 0, 0];
            // SAFETY: as in call; these are the arguments of its signature.
            unsafe { checked::call(self.code as *const (), args) }
        }

        fn task(
            objects: &[T],
            first_id: u32,
            keep_all: bool,
            seen: &mut [Seen],
            turned: &mut T::Turned,
            found: &mut BoundsFound,
        ) -> Option<BoundsTask> {
            assert!(seen.len() >= objects.len().next_multiple_of(CHUNK), "whole chunks are written");
            assert!(first_id as usize + objects.len() <= 1 << 24, "f32 has every number up to here");
            (!objects.is_empty()).then_some(BoundsTask {
                objects: objects.as_ptr().cast(),
                count: objects.len() as u64,
                first_id: first_id.into(),
                keep_all: if keep_all { (1 << MOST_LANES) - 1 } else { 0 },
                turned: std::ptr::from_mut(turned).cast(),
                seen: seen.as_mut_ptr(),
                found,
            })
        }
    }

    impl BoundsFound {
        /// Of no triangle.
        const NONE: BoundsFound = BoundsFound {
            most: [0; MOST_LANES],
            least: [u32::MAX; MOST_LANES],
            brightest: [0; MOST_LANES],
            coloured: [0; MOST_LANES],
            nearest: [0; MOST_LANES],
            count: 0,
        };

        fn extremes(&self) -> Extremes {
            let most = |of: &[u32]| f32::from_bits(of.iter().fold(0, |a, b| a.max(*b)));
            let least = f32::from_bits(self.least.iter().fold(u32::MAX, |a, b| a.min(*b)));
            let coloured = self.coloured.iter().any(|bits| *bits != 0);
            Extremes {
                most: most(&self.most),
                least,
                brightest: most(&self.brightest),
                coloured,
                nearest: most(&self.nearest),
            }
        }
    }

    /// As the kernel that cuts in halves reads it.
    #[repr(C)]
    pub(in crate::kernels) struct HalfTask {
        pub(in crate::kernels) seen: *const Seen,
        pub(in crate::kernels) count: u64,
        pub(in crate::kernels) nearer: *mut Seen,
        pub(in crate::kernels) farther: *mut Seen,
    }

    /// Cuts the objects of a tile in two halves.
    pub struct NearerHalf {
        pub(in crate::kernels) code: unsafe extern "sysv64" fn(*const HalfTask) -> u64,
        pub(in crate::kernels) symbol: &'static str,
    }

    impl NearerHalf {
        /// The symbol of its code.
        pub fn symbol(&self) -> &'static str {
            self.symbol
        }

        /// Copies those of `seen` that are nearer than half way from the nearest to the farthest to the front of
        /// `nearer`, and the others to that of `farther`, in order; and gives how many are nearer. What is behind them there
        /// is spoiled. There must be room for all in both.
        pub fn call(&self, seen: &[Seen], nearer: &mut [Seen], farther: &mut [Seen]) -> usize {
            if seen.is_empty() {
                return 0;
            }
            let task = Self::task(seen, nearer, farther);
            // SAFETY: task() proves that there is room; the references the rest. The CPU as in Bounds.
            unsafe { (self.code)(&task) as usize }
        }

        /// As [`NearerHalf::call`], with a look at whether the kernel keeps the calling convention.
        pub fn call_checked(&self, seen: &[Seen], nearer: &mut [Seen], farther: &mut [Seen]) -> Result<(), Vec<Fault>> {
            assert!(!seen.is_empty());
            let task = Self::task(seen, nearer, farther);
            // SAFETY: as in call; this is the argument of its signature.
            unsafe { checked::call(self.code as *const (), [std::ptr::from_ref(&task) as u64, 0, 0, 0, 0, 0]) }
        }

        fn task(seen: &[Seen], nearer: &mut [Seen], farther: &mut [Seen]) -> HalfTask {
            assert!(nearer.len() >= seen.len() && farther.len() >= seen.len(), "either may get all");
            HalfTask {
                seen: seen.as_ptr(),
                count: seen.len() as u64,
                nearer: nearer.as_mut_ptr(),
                farther: farther.as_mut_ptr(),
            }
        }
    }

    /// Triangles, the lights, and which of them a chunk is.
    #[derive(Clone, Copy)]
    pub struct Triangles<'a> {
        /// All triangles of the scene.
        pub facets: &'a [Facet],
        /// The lights.
        pub lights: &'a [TileLight<f64>],
        /// The first [`CHUNK`] of them, or as many as there are, are the chunk; the next ones are fetched ahead.
        pub seen: &'a [Seen],
        /// The number in the tile of the first of them.
        pub first_id: usize,
    }

    /// Turns triangles into planes over a tile's pixels.
    pub struct SetUp<E> {
        pub(in crate::kernels) code: unsafe extern "sysv64" fn(*const TileView<f64>, *const SetupTask),
        pub(in crate::kernels) symbol: &'static str,
        pub(in crate::kernels) writes: PhantomData<E>,
    }

    impl<E: Element> SetUp<E> {
        /// The symbol of its code.
        pub fn symbol(&self) -> &'static str {
            self.symbol
        }

        calls! {
            /// Sets up a chunk of triangles in `buffers`. `shades`, which begin at nobody's and have as many for each object
            /// of the tile as there are lights, get those of the chunk, and grow where they must.
            (TileView<f64>, triangles: Triangles<'_>, buffers: &mut TileBuffers<E>, shades: &mut Vec<TileShade<E>>) with ()
        }

        /// The ids are those of facets, and there is room for planes and shades.
        fn task(
            triangles: Triangles<'_>,
            buffers: &mut TileBuffers<E>,
            shades: &mut Vec<TileShade<E>>,
            (): &mut (),
        ) -> SetupTask {
            let Triangles { facets, lights, seen, first_id } = triangles;
            let (seen, ahead) = chunk_of(seen, facets.len());
            // The last packet writes as many as it has lanes.
            let before = first_id * lights.len();
            let past = before + (seen.len() + MOST_SET_UP) * lights.len();
            if shades.len() < past {
                shades.resize(past, TileShade::ZERO);
            }
            buffers.triangles.count = seen.len();
            buffers.most = buffers.most.max(first_id + seen.len() - 1);
            SetupTask {
                objects: facets.as_ptr().cast(),
                seen: seen.as_ptr(),
                count: seen.len() as u64,
                ahead,
                turned: std::ptr::from_mut(&mut *buffers.triangles.turned).cast(),
                planes: std::ptr::from_mut(&mut *buffers.triangles.planes).cast(),
                shades: shades[before..].as_mut_ptr().cast(),
                shorts: std::ptr::null_mut(),
                lights: lights.as_ptr(),
                light_count: lights.len() as u64,
                first_id: first_id as u64,
            }
        }
    }

    /// The first of what is seen, which is a chunk of so many objects, and how many of the next ones are fetched ahead. (What
    /// is fetched ahead may be anywhere: a prefetch does not fault. Its ids are read, and lie after the chunk's.)
    pub(super) fn chunk_of(seen: &[Seen], objects: usize) -> (&[Seen], u64) {
        let (seen, ahead) = seen.split_at(seen.len().min(CHUNK));
        assert!(!seen.is_empty());
        assert!(seen.iter().all(|seen| (seen.id as usize) < objects), "ids of objects");
        (seen, ahead.len().min(CHUNK) as u64)
    }

    /// Finds the nearest of triangles, or of spheres.
    pub struct Nearest<P> {
        pub(in crate::kernels) code: unsafe extern "sysv64" fn(*const P, *const NearestTask),
        pub(in crate::kernels) symbol: &'static str,
    }

    impl<P: InTile> Nearest<P> {
        /// The symbol of its code.
        pub fn symbol(&self) -> &'static str {
            self.symbol
        }

        /// Makes the pixels of the window those of the objects that were set up last, where nothing is nearer, and
        /// nothing as near that comes first: `order` has everyone's place in the scene by the numbers in the tile, from 1
        /// on, and 0 for nobody.
        pub fn call(&self, buffers: &mut TileBuffers<P::Element>, order: &[u32], window: &TileWindow, grid: &TileGrid) {
            if let Some((planes, task)) = Self::task(buffers, order, window, grid) {
                // SAFETY: the buffers have room for a chunk and a tile, and the kernel clips all bounds to the window,
                // which task() holds within the tile. The CPU as in Bounds.
                unsafe { (self.code)(planes, &task) }
            }
        }

        /// As [`Nearest::call`], with a look at whether the kernel keeps the calling convention.
        pub fn call_checked(
            &self,
            buffers: &mut TileBuffers<P::Element>,
            order: &[u32],
            window: &TileWindow,
            grid: &TileGrid,
        ) -> Result<(), Vec<Fault>> {
            let (planes, task) = Self::task(buffers, order, window, grid).expect("objects that are set up");
            let args = [std::ptr::from_ref(planes) as u64, std::ptr::from_ref(&task) as u64, 0, 0, 0, 0];
            // SAFETY: as in call; these are the arguments of its signature.
            unsafe { checked::call(self.code as *const (), args) }
        }

        /// None where nothing is set up.
        fn task<'b>(
            buffers: &'b mut TileBuffers<P::Element>,
            order: &[u32],
            window: &TileWindow,
            grid: &TileGrid,
        ) -> Option<(&'b P, NearestTask)> {
            window.check();
            assert!(buffers.most < order.len(), "everyone has a place in the scene");
            let (tile, Chunk { turned, planes, count }) = P::in_tile(buffers);
            // Whole packets are read: what is past the chunk is seen nowhere.
            P::columns(turned)[*count..count.next_multiple_of(MOST_LANES)].fill(0);
            let task = NearestTask {
                tile: std::ptr::from_mut(tile).cast(),
                turned: std::ptr::from_ref(&**turned).cast(),
                order: order.as_ptr(),
                count: *count as u64,
                column: window.column.into(),
                row: window.row.into(),
                end_column: window.columns.into(),
                start_row: window.rows.start.into(),
                end_row: window.rows.end.into(),
                half_step: 0.5 * grid.step,
                half_width: grid.half_width,
                half_height: grid.half_height,
                focal: grid.focal,
            };
            (*count > 0).then_some((planes, task))
        }
    }

    /// What the objects of a tile look like.
    #[derive(Clone, Copy)]
    pub struct Looks<'a, E> {
        /// As many for each object of the tile as there are lights, from nobody on; zeros for the spheres.
        pub shades: &'a [TileShade<E>],
        /// Where the lights stand.
        pub lights: &'a [TilePoint<E>],
        /// Where the records are of the spheres of the tile, which come before its triangles.
        pub sphere_ids: &'a [u32],
        /// The records of those that have a pixel.
        pub spheres: &'a [TileSphere<E>],
        /// As many for each of them as there are lights.
        pub lits: &'a [Lit<E>],
        /// As many, weighted for bytes, for those that have `short` set.
        pub shorts: &'a [ShortLit<E>],
    }

    /// Where a tile's pixels go.
    pub struct TileOut<'a, P> {
        /// Whole rows of the picture.
        pub pixels: &'a mut [P],
        /// The place of the first pixel of the window among them.
        pub first: usize,
        /// Pixels from row to row.
        pub width: usize,
    }

    /// Shades a tile.
    pub struct ShadeTile<E, P> {
        pub(in crate::kernels) code: unsafe extern "sysv64" fn(*const TileRays<E>, *const ShadeTask),
        pub(in crate::kernels) symbol: &'static str,
        pub(in crate::kernels) writes: PhantomData<P>,
    }

    impl<E: Element, P> ShadeTile<E, P> {
        /// The symbol of its code.
        pub fn symbol(&self) -> &'static str {
            self.symbol
        }

        calls! {
            /// Writes the pixels of the window.
            (
                TileRays<E>, buffers: &TileBuffers<E>, looks: Looks<'_, E>, window: &TileWindow, out: TileOut<'_, P>
            ) with ()
        }

        /// Every object of the tile has its shades or is a sphere with its lights, and the window's pixels are in `out`.
        fn task(
            buffers: &TileBuffers<E>,
            looks: Looks<'_, E>,
            window: &TileWindow,
            out: TileOut<'_, P>,
            (): &mut (),
        ) -> ShadeTask {
            window.check();
            let Looks { shades, lights, sphere_ids, spheres, lits, shorts } = looks;
            let (objects, count) = (buffers.most + 1, lights.len());
            // Spheres that no kernel traces may be more than have a pixel.
            let triangle_count = objects.saturating_sub(1 + sphere_ids.len());
            assert!(triangle_count == 0 || shades.len() >= objects * count);
            assert!(lits.len() >= spheres.len() * count && shorts.len() >= spheres.len() * count);
            assert!(objects * count * size_of::<TileShade<E>>() <= u32::MAX as usize, "offsets have 32 bits");
            assert!(sphere_ids.iter().all(|id| (*id as usize) < spheres.len()), "places of records");
            let rows = window.rows.len();
            assert!(window.columns as usize <= out.width);
            assert!(out.first + (rows - 1) * out.width + window.columns as usize <= out.pixels.len());
            ShadeTask {
                tile: std::ptr::from_ref(&*buffers.tile).cast(),
                shades: shades.as_ptr().cast(),
                lights: lights.as_ptr().cast(),
                light_count: count as u64,
                sphere_count: sphere_ids.len() as u64,
                triangle_count: triangle_count as u64,
                sphere_ids: sphere_ids.as_ptr(),
                spheres: spheres.as_ptr().cast(),
                lits: lits.as_ptr().cast(),
                shorts: shorts.as_ptr().cast(),
                out: out.pixels[out.first..].as_mut_ptr().cast(),
                pitch: (out.width * size_of::<P>()) as u64,
                column: window.column.into(),
                row: window.row.into(),
                end_column: window.columns.into(),
                start_row: window.rows.start.into(),
                end_row: window.rows.end.into(),
            }
        }
    }
}
