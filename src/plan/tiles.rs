//! A scene prepared for the tile kernels: the bounds of each object, and the tiles that it may be
//! in.
//!
//! All rays leave one point, so that the pixels in which an object may be visible are known before
//! the first ray: those within the bounds of a triangle's projected corners, or of a sphere's
//! silhouette. The plan only keeps these bounds and the object's index, in the lists of the tiles
//! that the bounds meet. Each tile sets up its objects from the scene when it is traced.
//! docs/no-hit-is-lost.md proves that this finds every hit.

mod bins;
pub(super) mod bounds;
pub(super) mod forms;
mod place;

use std::sync::Arc;

use glam::{DVec3, Vec3};

pub use self::bins::LargeInRow;
use self::bins::{Bins, MOST_SORTED, NextLarge, WideTiles};
use self::bounds::{Planning, Widening, bounds_view, sphere_view};
use self::forms::Forms;
use self::place::Picture;
pub use self::place::TilePlace;
pub(super) use self::place::covered;
use super::frustum::Frustum;
use super::omission::{Keep, Omission};
use super::shadows::Shadows;
use super::{PlanOptions, UnitRays, light, power_of_two, unit_rays};
use crate::kernels::{
    AroundSphere, Candidate, Element, Extremes, LightPosition, ObjectList, PacketKernels, PixelBounds, PointView,
    SphereView, TILE_HEIGHT, TILE_WIDTH, TileGrid, TileLight, TileRays, TileView, TileWindow, TriangleList,
};
use crate::reference::geometry;
use crate::scene::{Grid, MAX_SIDE, Scene, Sphere, Triangle};

/// The error bound of an edge over a tile, in units of u (half of EPSILON of the tile's element
/// type) times its terms. A term goes through at most four roundings, which `rayo ops --proofs`
/// counts; the other third covers the errors of the set-up in f64, as `proofs/edge-*.g` prove.
pub const EDGE_ROUNDINGS: f64 = 6.0;

/// A triangle in more tiles than this is large: it is in one list that all tiles go through, and
/// not in the list of each tile, where it would take 16 bytes, and 16 more during planning.
const MOST_TILES: usize = 11;

/// In a scene with at most this many triangles, they may be in as many tiles as spheres before they
/// are large, since the lists take little memory.
const FEW_TRIANGLES: usize = 1 << 12;
const MOST_TILES_OF_FEW: usize = 64;

/// This many triangles of a tile are traced at once; then those without a pixel are dropped. The
/// memory of a tile, beside its lists, therefore does not grow with the number of triangles.
const MOST_AT_ONCE: usize = 1 << 14;

/// A sphere in more tiles than this is large. Scenes have fewer spheres than triangles.
const MOST_TILES_OF_A_SPHERE: usize = 64;

// Bounds are stored in 16 bits.
const _: () = assert!(MAX_SIDE <= u16::MAX as u32);

/// A scene that has been planned for tiles.
pub struct Tiles<'a, E> {
    scene: &'a Scene,
    frame: Frame,
    keep: Keep,
    /// The positions of the lights for shading. Those that are too far away for f32 are moved
    /// nearer.
    points: Vec<LightPosition<E>>,
    /// The same lights for the set-up of spheres, at their true positions and with their radiance.
    sphere_lights: Vec<TileLight<f64>>,
    linear: Weighted,
    levels: Weighted,
    binned: Arc<Binned>,
    /// What each light sees, cell by cell; None in a scene without shadows.
    shadows: Option<Arc<Shadows<'a>>>,
    /// The planes of both kinds of triangles, computed in f64, if there are few triangles: the
    /// planes of the kernels lose digits in slivers.
    planes: Option<[Vec<ExactPlane>; 2]>,
}

/// The rays, scaled, and the unit in which 1/t is stored.
#[derive(Clone, Copy)]
struct Frame {
    /// The camera's grid, scaled by `unit`.
    grid: Grid<f64>,
    picture: Picture,
    /// A power of two by which the grid is scaled so that its longest sides are about 1.
    unit: f64,
    /// The extent of the scene; see [`extent`].
    extent: f64,
    /// A power of two by which 1/t is multiplied so that it is about 1 in the middle of the scene.
    scale: f64,
}

/// The bins of all objects, which the plans for f32 and f64 share.
struct Binned {
    of_spheres: Bins,
    /// The bins of both kinds of triangles; indices of either kind begin at 0.
    of_triangles: [Bins; 2],
    /// The tiles that have an object whose numbers f32 cannot hold.
    wide: WideTiles,
    /// The extremes of all objects; None if there are no objects.
    extremes: Option<Extremes>,
}

/// What set-up takes that depends on the value of white in the output: 1 for floats, 255 for bytes.
pub struct Weighted {
    /// The lights for triangles, whose radiance is multiplied by white.
    pub lights: Vec<TileLight<f64>>,
    pub spheres: SphereView<f64>,
    /// Whether white is 255, so that spheres may have the short form.
    pub bytes: bool,
}

/// Goes through the objects that are in many tiles, from near to far.
pub struct LargeObjects<'a> {
    bins: &'a Bins,
    in_row: &'a mut LargeInRow,
    next: NextLarge,
    more: bool,
}

impl LargeObjects<'_> {
    /// Whether all objects have been visited.
    pub fn are_through(&self) -> bool {
        !self.more
    }

    /// Adds up to `count` of the next objects that may be visible in a tile and may have a 1/t of
    /// at least `least` there.
    pub fn add(&mut self, tile: TilePlace, count: usize, least: f32, room: &mut Vec<Candidate>) {
        let count = count.min(MOST_AT_ONCE);
        self.more = self.more && self.bins.add_large(tile, self.in_row, &mut self.next, count, least, room);
    }
}

/// The plane of a triangle, accurate to the last bits of f64. Triangles in the same plane have the
/// same `inverse` if their coordinates have few bits.
pub struct ExactPlane {
    /// The vector whose product with a ray is 1/t.
    inverse: DVec3,
    /// The unit normal divided by the scale.
    normal: DVec3,
    corner: DVec3,
}

impl ExactPlane {
    fn of(triangle: &Triangle, scale: f64) -> Self {
        let corners = triangle.vertices.map(|v| v.as_dvec3());
        let n = geometry::triangle_plane(corners);
        let inverse = geometry::triangle_volume(corners).map_or(DVec3::ZERO, |volume| scale * (n / volume));
        ExactPlane { inverse, normal: n.normalize_or_zero() / scale, corner: geometry::near_corner_first(corners)[0] }
    }

    /// 1/t in the middle of a tile, and its increments per column and per row.
    pub fn inverse(&self, view: &TileView<f64>) -> [f64; 3] {
        let DVec3 { x, y, .. } = self.inverse;
        [self.inverse.dot(DVec3::new(view.dx, view.dy, view.dz)), x * view.step, y * view.down]
    }

    /// The distance of a light from the plane, divided by the scale.
    pub fn height(&self, light: &TileLight<f64>) -> f64 {
        self.normal.dot(DVec3::new(light.x, light.y, light.z) - self.corner).abs()
    }
}

impl Frame {
    fn new(scene: &Scene) -> Self {
        let camera = &scene.camera;
        let UnitRays { grid, unit } = unit_rays(camera.grid());
        let picture = Picture { width: camera.width(), height: camera.height() };
        let extent = extent(scene);
        Frame { grid, picture, unit, extent, scale: power_of_two(extent / grid.focal) }
    }
}

fn is_f32<E>() -> bool {
    size_of::<E>() == 4
}

/// The greatest distance at which the element type E can hold a light; lights farther away are
/// moved to it.
fn far<E>(extent: f64) -> f64 {
    if is_f32::<E>() { extent * forms::FAR } else { f64::MAX }
}

impl Binned {
    /// Plans for kernels in f32 (`in_f32`) or in f64.
    fn new(
        scene: &Scene,
        &Frame { grid, picture, extent, scale, .. }: &Frame,
        kernels: &PacketKernels,
        options: PlanOptions<'_>,
        in_f32: bool,
    ) -> Self {
        let keep = options.keep;
        let forms = Forms::new(grid, scale, &light::lights(scene), far::<f32>(extent));
        let widening = Widening { keep, frustum: Frustum::new(&grid), whole: picture.whole() };
        // None if every object is to be in all tiles.
        let most_tiles = |most: usize| (!keep.has(Omission::OtherTiles)).then_some(most);
        let spheres = Planning {
            kernel: &kernels.sphere_bounds,
            view: sphere_view(&grid, scale, picture, forms::FAR_IN_RADII, 1.0),
            picture,
            widening: &widening,
            unseen: Frustum::unseen_sphere,
            surely_narrow: &|extremes| forms.surely_narrow_spheres(extremes),
            form: &|sphere, candidate| forms.of_sphere(sphere, candidate),
            steep: &|_, _, _| (),
            most_tiles: most_tiles(MOST_TILES_OF_A_SPHERE),
            most_sorted: MOST_SORTED,
            in_f32,
        };
        let triangles = Planning {
            kernel: &kernels.bounds,
            view: bounds_view(&grid, scale, picture),
            picture,
            widening: &widening,
            unseen: Frustum::unseen_triangle,
            surely_narrow: &|extremes| forms.surely_narrow_triangles(extremes),
            form: &|triangle, candidate| forms.of_triangle(triangle, candidate),
            steep: &|triangle, candidate, tiles| forms.steep_tiles(triangle, candidate, tiles),
            most_tiles: most_tiles(if scene.triangle_count() <= FEW_TRIANGLES {
                MOST_TILES_OF_FEW
            } else {
                MOST_TILES
            }),
            most_sorted: 0,
            in_f32,
        };
        let of_spheres = spheres.plan(&scene.spheres, options);
        let of_triangles = triangles.plan(TriangleList::Apart(&scene.triangles), options);
        let of_faces = triangles.plan(TriangleList::Joined((&scene.faces).into()), options);
        let all = [of_spheres.extremes, of_triangles.extremes, of_faces.extremes];
        let wide = of_spheres.wide.and(of_triangles.wide).and(of_faces.wide);
        let (mut of_spheres, mut of_triangles) = (of_spheres.bins, [of_triangles.bins, of_faces.bins]);
        of_spheres.sort(|_| None);
        for (bins, triangles) in of_triangles.iter_mut().zip(triangle_lists(scene)) {
            bins.sort(|id| forms::most_at(&triangles.get(id as usize), grid, scale, picture));
        }
        Binned { of_spheres, of_triangles, wide, extremes: all.into_iter().flatten().reduce(Extremes::and) }
    }
}

impl<'a, E: Element> Tiles<'a, E> {
    /// Plans `scene` with the kernels of bounds.
    pub fn new(scene: &'a Scene, kernels: &PacketKernels, options: PlanOptions<'_>) -> Self {
        let frame = Frame::new(scene);
        let binned = Binned::new(scene, &frame, kernels, options, is_f32::<E>());
        let shadows = scene.shadows.then(|| Arc::new(Shadows::new(scene, options)));
        Self::of(scene, frame, options.keep, Arc::new(binned), shadows)
    }

    /// The plan for kernels in f64, for the same scene and rays.
    pub fn in_f64(&self, kernels: &PacketKernels, options: PlanOptions<'_>) -> Tiles<'a, f64> {
        let &Tiles { scene, frame, keep, ref binned, ref shadows, .. } = self;
        let binned = if keep == Keep::NOTHING {
            Arc::clone(binned)
        } else {
            Arc::new(Binned::new(scene, &frame, kernels, PlanOptions { keep, ..options }, false))
        };
        Tiles::of(scene, frame, keep, binned, shadows.clone())
    }

    fn of(scene: &'a Scene, frame: Frame, keep: Keep, binned: Arc<Binned>, shadows: Option<Arc<Shadows<'a>>>) -> Self {
        let Frame { grid, picture, extent, scale, .. } = frame;
        let far_in_radii = if is_f32::<E>() { forms::FAR_IN_RADII } else { 1e30 };
        // A dark light would add 0, and the form of a sphere depends on how accurately each light
        // is known.
        let lights = light::lights(scene);
        let far = far::<E>(extent);
        let positions: Vec<_> = lights.iter().map(|light| nearer(light.position.as_dvec3(), far)).collect();
        let points = positions.iter().map(|l| *l / scale);
        let points = points.map(|l| [l.x, l.y, l.z, 0.0].map(E::from_f64)).collect();
        let light = |DVec3 { x, y, z }: DVec3, radiance: DVec3| TileLight {
            x,
            y,
            z,
            red: radiance.x,
            green: radiance.y,
            blue: radiance.z,
        };
        let weighted = |white: f64, bytes: bool| Weighted {
            lights: lights.iter().zip(&positions).map(|(of, l)| light(*l, white * of.radiance())).collect(),
            spheres: sphere_view(&grid, scale, picture, far_in_radii, white),
            bytes,
        };
        let few = !is_f32::<E>() && scene.triangle_count() <= FEW_TRIANGLES;
        let planes = triangle_lists(scene);
        let plane = |triangles: TriangleList<'_>| {
            (0..triangles.len()).map(|i| ExactPlane::of(&triangles.get(i), scale)).collect()
        };
        let planes = few.then(|| planes.map(plane));
        Tiles {
            scene,
            frame,
            keep,
            points,
            sphere_lights: lights.iter().map(|of| light(of.position.as_dvec3(), of.radiance())).collect(),
            linear: weighted(1.0, false),
            levels: weighted(255.0, true),
            binned,
            shadows,
            planes,
        }
    }

    /// Whether planning has shown that the numbers of the scene's objects are valid. If not, they
    /// may be valid all the same.
    pub fn is_valid(&self) -> bool {
        let valid = |extremes: Extremes| {
            let Extremes { most, least, brightest, .. } = extremes;
            // The kernels compare bits, by which -0 and negative numbers are above all others. If
            // there is such a number, nothing is known of the other ones.
            let fine = |most: f32| most.is_sign_positive() && most.is_finite();
            fine(most) && least > 0.0 && fine(brightest)
        };
        self.binned.extremes.is_none_or(valid)
    }

    /// A lower bound of 1/t at all pixels of a tile, if the nearest of the large triangles covers
    /// the tile; otherwise 0.
    pub fn least_of_large(&self, tile: TilePlace) -> f32 {
        let Frame { grid, scale, picture, .. } = self.frame;
        let of_kinds = self.binned.of_triangles.iter().zip(self.triangle_lists());
        of_kinds.fold(0.0, |least, (bins, triangles)| {
            let of = |id| forms::least_over(&triangles.get(id as usize), grid, scale, picture, tile);
            bins.first_large().map_or(least, |id| least.max(of(id)))
        })
    }

    /// Whether any tile has an object whose numbers f32 cannot hold.
    pub fn any_wide(&self) -> bool {
        !self.binned.wide.is_empty()
    }

    /// Whether a tile has an object whose numbers f32 cannot hold. All of it is then traced in f64.
    pub fn is_wide(&self, tile: TilePlace) -> bool {
        self.binned.wide.has(tile)
    }

    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// The number of pixels in a row, and of rows.
    pub fn size(&self) -> [u32; 2] {
        [self.frame.picture.width, self.frame.picture.height]
    }

    /// All triangles: those with corners of their own, and those that share corners.
    pub fn triangle_lists(&self) -> [TriangleList<'_>; 2] {
        triangle_lists(self.scene)
    }

    /// The planes of one kind of triangles in f64, if the plan has them because those of the
    /// kernels are not accurate enough.
    pub fn planes(&self, kind: usize) -> Option<&[ExactPlane]> {
        self.planes.as_ref().map(|planes| &planes[kind][..])
    }

    pub fn spheres(&self) -> &[Sphere] {
        &self.scene.spheres
    }

    /// The spheres that are candidates in some tile, each once.
    pub fn seen_spheres(&self) -> impl Iterator<Item = Candidate> {
        let mut candidates: Vec<_> = self.binned.of_spheres.listed().collect();
        candidates.sort_unstable_by_key(|candidate| candidate.id);
        candidates.dedup_by_key(|candidate| candidate.id);
        candidates.into_iter().copied()
    }

    /// The bounds of all spheres, empty for those that no ray can hit.
    pub fn sphere_bounds(&self) -> PixelBounds {
        bounds_in(&self.binned.of_spheres, self.scene.spheres.len())
    }

    /// The bounds of all triangles, empty for those that no ray can hit.
    pub fn triangle_bounds(&self) -> PixelBounds {
        let [mut bounds, of_faces] =
            [0, 1].map(|kind| bounds_in(&self.binned.of_triangles[kind], self.triangle_lists()[kind].len()));
        bounds.columns.extend(of_faces.columns);
        bounds.rows.extend(of_faces.rows);
        bounds
    }

    /// The lights for the set-up of spheres.
    pub fn sphere_lights(&self) -> &[TileLight<f64>] {
        &self.sphere_lights
    }

    /// The positions of the lights, for shading.
    pub fn points(&self) -> &[LightPosition<E>] {
        &self.points
    }

    /// The lights and the view of spheres for output in floats, where white is 1.
    pub fn linear(&self) -> &Weighted {
        &self.linear
    }

    /// The lights and the view of spheres for output in bytes, where white is 255.
    pub fn levels(&self) -> &Weighted {
        &self.levels
    }

    /// The shadows, if the scene has them.
    pub fn shadows(&self) -> Option<&Shadows<'a>> {
        self.shadows.as_deref()
    }

    /// The rays, as the kernel that finds visible points takes them.
    pub fn point_view(&self) -> PointView<f64> {
        let Grid { step, half_width, half_height, focal } = self.frame.grid;
        PointView { step, half_width, half_height, focal }
    }

    /// The omissions that are switched off.
    pub fn keep(&self) -> Keep {
        self.keep
    }

    /// The number of large objects, and the number of entries in bins.
    pub fn counts(&self) -> [usize; 2] {
        let Binned { of_spheres, of_triangles: [triangles, faces], .. } = &*self.binned;
        let of = [of_spheres, triangles, faces].map(Bins::counts);
        [0, 1].map(|kind| of.iter().map(|counts| counts[kind]).sum())
    }

    /// The number of candidates in a tile.
    pub fn count_in(&self, &TileWindow { column, row, .. }: &TileWindow) -> usize {
        let tile = TilePlace { across: column / TILE_WIDTH as u32, down: row / TILE_HEIGHT as u32 };
        let [triangles, faces] = &self.binned.of_triangles;
        let mut large = Vec::new();
        for mut of in self.large(&mut Default::default()) {
            while !of.are_through() {
                of.add(tile, MOST_AT_ONCE, 0.0, &mut large);
            }
        }
        let in_few =
            [&self.binned.of_spheres, triangles, faces].map(|bins| bins.of_tile(tile).map(<[Candidate]>::len).sum());
        large.len() + in_few.iter().sum::<usize>()
    }

    /// The record of a sphere that contains the camera or is beside it, for the kernel of such
    /// spheres. None for a sphere in front of the camera.
    pub fn around(&self, sphere: &Sphere) -> Option<AroundSphere<f64>> {
        if forms::is_quadratic(sphere) {
            return None;
        }
        let Frame { grid: Grid { step, half_width, half_height, focal }, scale, .. } = self.frame;
        let (c, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let (r2, k) = (radius * radius, geometry::power(c, radius));
        Some(AroundSphere {
            step,
            half_width,
            half_height,
            square: focal * focal,
            cx: c.x,
            cy: c.y,
            cz: c.z,
            along: focal * c.z,
            cx_focal: c.x * focal,
            cy_focal: c.y * focal,
            r2,
            k,
            over_k: if k == 0.0 { 0.0 } else { scale / k },
            scale,
            far: if c.dot(c) < 2.0 * r2 { 0.0 } else { 1.0 },
        })
    }

    /// Whether a sphere has to be shaded in coordinates relative to the camera: see
    /// `forms::is_shaded_from_camera`.
    pub fn is_shaded_from_camera(&self, sphere: &Sphere) -> bool {
        let lights = self.sphere_lights.iter().filter(|_| is_f32::<E>());
        let lights =
            lights.map(|light| (DVec3::new(light.x, light.y, light.z), DVec3::new(light.red, light.green, light.blue)));
        forms::is_shaded_from_camera(sphere, lights)
    }

    /// Whether no ray of a tile meets a sphere.
    pub fn misses(&self, &TileWindow { column, row, .. }: &TileWindow, sphere: &Sphere) -> bool {
        let (first, past) = (self.ray(row, column), self.ray(row + TILE_HEIGHT as u32, column + TILE_WIDTH as u32));
        let half = 0.5 * self.frame.grid.step;
        let frustum = Frustum::between([first.x - half, past.x - half], [past.y + half, first.y + half], first.z);
        frustum.unseen_sphere(sphere) != Omission::Between
    }

    /// The number of tiles, across and down.
    pub(super) fn tiles(&self) -> [u32; 2] {
        self.frame.picture.tiles()
    }

    /// A power of two, the factor by which tiles store 1/t, where t belongs to the rays of
    /// [`Tiles::ray`].
    pub fn scale(&self) -> f64 {
        self.frame.scale
    }

    /// As [`scale`](Self::scale), where t belongs to the camera's own rays.
    pub fn inverse_unit(&self) -> f64 {
        self.frame.scale * self.frame.unit
    }

    /// The ray through a pixel: the camera's ray times a power of two.
    pub fn ray(&self, row: u32, column: u32) -> DVec3 {
        self.frame.grid.ray(row, column).into()
    }

    /// The grid of the rays of [`Tiles::ray`].
    pub fn grid(&self) -> TileGrid {
        let Grid { step, half_width, half_height, focal } = self.frame.grid;
        TileGrid { step, half_width, half_height, focal }
    }

    /// Adds the spheres that are candidates in a tile, except large ones.
    pub fn spheres_in(&self, tile: TilePlace, spheres: &mut Vec<Candidate>) {
        let bins = &self.binned.of_spheres;
        bins.of_tile(tile).for_each(|candidates| spheres.extend_from_slice(candidates));
    }

    /// Calls `say` with the candidates in a tile that are triangles of one of the
    /// [kinds](Tiles::triangle_lists), at most `MOST_AT_ONCE` at a time. They are copied to `room`
    /// unless they are in a single list. Candidates that `room` already has come first; other large
    /// triangles are not included.
    pub fn triangles_in(
        &self,
        kind: usize,
        tile: TilePlace,
        room: &mut Vec<Candidate>,
        mut say: impl FnMut(&[Candidate]),
    ) {
        let bins = &self.binned.of_triangles[kind];
        let mut lists = bins.of_tile(tile).filter(|candidates| !candidates.is_empty());
        if let (true, Some(only), None) = (room.is_empty(), lists.next(), lists.next()) {
            return only.chunks(MOST_AT_ONCE).for_each(say);
        }
        for mut candidates in bins.of_tile(tile) {
            while !candidates.is_empty() {
                let (first, others) = candidates.split_at(candidates.len().min(MOST_AT_ONCE - room.len()));
                room.extend_from_slice(first);
                if room.len() == MOST_AT_ONCE {
                    say(room);
                    room.clear();
                }
                candidates = others;
            }
        }
        if !room.is_empty() {
            say(room);
        }
    }

    /// The large objects: spheres, and triangles of both [kinds](Tiles::triangle_lists).
    pub fn large<'b>(&'b self, in_row: &'b mut [LargeInRow; 3]) -> [LargeObjects<'b>; 3] {
        let [triangles, faces] = &self.binned.of_triangles;
        let [first, second, third] = in_row;
        [(&self.binned.of_spheres, first), (triangles, second), (faces, third)].map(|(bins, in_row)| LargeObjects {
            bins,
            in_row,
            next: NextLarge::default(),
            more: true,
        })
    }

    /// The ray at a tile's middle.
    fn middle_ray(&self, tile: TilePlace) -> DVec3 {
        let (column, row) = tile.first();
        self.ray(row + TILE_HEIGHT as u32 / 2, column + TILE_WIDTH as u32 / 2)
    }

    /// The rays of a tile, as set-up takes them.
    pub fn view(&self, tile: TilePlace) -> TileView<f64> {
        let DVec3 { x: dx, y: dy, z: dz } = self.middle_ray(tile);
        let Grid { step, half_width, half_height, focal } = self.frame.grid;
        // The error bound of an edge has two parts. `relative` is for roundings in the tile's
        // element type, of terms relative to the tile's middle. `exact` is for roundings in f64, in
        // set-up and in the reference, of the terms of the longest ray d.
        let unit = if size_of::<E>() == 4 { f64::from(f32::EPSILON) } else { f64::EPSILON };
        let (relative, exact) = (EDGE_ROUNDINGS * unit / 2.0, 16.0 * f64::EPSILON);
        let half = (TILE_WIDTH / 2) as f64;
        TileView {
            dx,
            dy,
            dz,
            step,
            down: -step,
            scale: self.frame.scale,
            bound_x: exact * 2.0 * half_width + relative * half * step,
            bound_y: exact * 2.0 * half_height + relative * half * step,
            bound_z: exact * focal,
            bound_0: relative,
        }
    }

    /// The rays of a tile, as shading takes them.
    pub fn rays(&self, tile: TilePlace) -> TileRays<E> {
        let DVec3 { x: dx, y: dy, z: dz } = self.middle_ray(tile);
        let step = self.frame.grid.step;
        TileRays { dx, dy, dz, step, down: -step }.round()
    }
}

fn triangle_lists(scene: &Scene) -> [TriangleList<'_>; 2] {
    [TriangleList::Apart(&scene.triangles), TriangleList::Joined((&scene.faces).into())]
}

/// The size of a scene: the median of the coordinates of a sample of objects, so that a sun or a
/// grain of dust does not make the numbers of all other objects small or large.
fn extent(scene: &Scene) -> f64 {
    let (count, spheres) = (scene.triangle_count(), scene.spheres.len());
    // Sizes as bits, whose order is that of non-negative numbers.
    let mut sizes = Vec::new();
    let mut add = |v: Vec3| {
        let size = v.to_array().map(|x| x.abs().to_bits()).into_iter().fold(0, u32::max);
        sizes.extend((size > 0 && size < f32::INFINITY.to_bits()).then_some(size));
    };
    (0..count).step_by(count / 1024 + 1).for_each(|i| scene.triangle(i).vertices.into_iter().for_each(&mut add));
    // A sphere around the camera with its centre at 0 counts with its radius.
    let reach = |sphere: &Sphere| if sphere.centre == Vec3::ZERO { Vec3::splat(sphere.radius) } else { sphere.centre };
    scene.spheres.iter().step_by(spheres / 1024 + 1).for_each(|sphere| add(reach(sphere)));
    let middle = sizes.len() / 2;
    if sizes.is_empty() { 1.0 } else { f32::from_bits(*sizes.select_nth_unstable(middle).1).into() }
}

/// A point, moved along its direction to at most the distance `far`.
fn nearer(point: DVec3, far: f64) -> DVec3 {
    let distance = point.length();
    if distance > far { point * (far / distance) } else { point }
}

/// The bounds of `objects` objects; empty for objects that are no candidates.
fn bounds_in(bins: &Bins, objects: usize) -> PixelBounds {
    let none = vec![0; objects];
    let mut bounds = PixelBounds { columns: none.clone(), rows: none };
    for candidate in bins.listed() {
        bounds.columns[candidate.id as usize] = candidate.columns;
        bounds.rows[candidate.id as usize] = candidate.rows;
    }
    bounds
}
