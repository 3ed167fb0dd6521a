//! Tiles: what a scene of many objects becomes for the tile kernels, each object's bounds, and which tiles it may be in.
//!
//! All rays leave one point, so that the pixels which see an object are known before the first ray: of each triangle the
//! bounds of its projected corners, of each sphere those of its silhouette. Triangles stay where the scene has them;
//! each tile sets up its own. What is kept of one is its bounds and its number in the lists of a few tiles.

use std::ops::Range;
use std::panic::resume_unwind;
use std::thread;

use glam::DVec3;

use super::light;
use super::omission::{Keep, Omission};
use super::tile_report::Frustum;
use crate::kernels::sys;
use crate::kernels::{
    Bounds, BoundsView, CHUNK, Element, Extremes, Lit, PixelBounds, Seen, ShortLit, TILE_HEIGHT, TILE_WIDTH, TileGrid,
    TileLight, TilePoint, TileRays, TileSphere, TileView,
};
use crate::scene::{Camera, Grid, Light, Scene, Sphere, Triangle};

/// An object in more tiles than this is in the list that all tiles look through: 16 bytes in each, and 16 while planning.
const MOST_TILES: usize = 11;

/// Spheres are fewer.
const MOST_TILES_OF_A_SPHERE: usize = 64;

/// Numbers of objects are kept in f32, which has every integer up to here.
const MOST_OBJECTS: usize = 1 << 24;

/// Bounds have 16 bits.
const LONGEST_SIDE: u32 = u16::MAX as u32;

/// From here on objects are traced tile by tile: where the two cross, as docs/performance.md has measured it.
pub(super) const FEWEST_OBJECTS: usize = 32;

/// A thread that plans fewer triangles costs more than it brings.
const FEWEST_PER_THREAD: usize = 1 << 14;

/// Lengths between its inverse and this have squares and products that f32 holds.
const MODERATE: f32 = (1u64 << 60) as f32;

/// Whether a scene is to be traced tile by tile, rather than span by span: it has many objects, and none whose numbers the
/// spans may have to leave to f64.
pub fn tiles_pay(scene: &Scene, camera: &Camera) -> bool {
    objects_are_many(scene, camera) && is_moderate(scene)
}

/// Whether tiles pay for so many objects, if their numbers are moderate: see [`is_moderate`].
pub fn objects_are_many(scene: &Scene, camera: &Camera) -> bool {
    (FEWEST_OBJECTS..MOST_OBJECTS).contains(&(scene.spheres.len() + scene.triangles.len()))
        && camera.width().max(camera.height()) <= LONGEST_SIDE
}

/// Whether f32 holds squares and products of all lengths in a scene.
pub fn is_moderate(scene: &Scene) -> bool {
    let triangle = |t: &Triangle| {
        let [one, other, third] = t.vertices.map(glam::Vec3::abs);
        is_moderate_size(one.max(other).max(third).max_element())
    };
    spheres_are_moderate(scene) && scene.triangles.iter().all(triangle)
}

fn spheres_are_moderate(scene: &Scene) -> bool {
    let sphere = |s: &Sphere| is_moderate_size(s.radius) && s.centre.abs().max_element() < MODERATE;
    scene.spheres.iter().all(sphere)
}

fn is_moderate_size(size: f32) -> bool {
    (1.0 / MODERATE..MODERATE).contains(&size)
}

/// A scene planned for tiles.
pub struct Tiles<'a, E> {
    scene: &'a Scene,
    camera: Camera,
    grid: Grid<f64>,
    /// A power of two that brings 1/t to size.
    scale: f64,
    keep: Keep,
    /// Where the lights stand, those that are too far for f32 brought nearer.
    points: Vec<TilePoint<E>>,
    linear: Weighted<E>,
    levels: Weighted<E>,
    spheres: Vec<TileSphere<E>>,
    shorts: Vec<ShortLit<E>>,
    /// Spheres around the camera, or that reach behind its plane.
    odd: Vec<bool>,
    sphere_bounds: PixelBounds,
    sphere_bins: Bins,
    triangle_bins: Vec<Bins>,
    /// Of all triangles; None where there are none.
    extremes: Option<Extremes>,
}

/// What depends on what white is in the output.
pub struct Weighted<E> {
    /// For set-up.
    pub lights: Vec<TileLight<f64>>,
    /// As many for each sphere as there are lights.
    pub lits: Vec<Lit<E>>,
}

/// The objects that each tile may see.
struct Bins {
    /// Where each tile's begin, and where the last one's end.
    starts: Vec<u32>,
    seen: Vec<Seen>,
    /// Those that are in many tiles.
    large: Vec<Seen>,
    /// Whether the large are in all tiles, wherever they may be seen.
    everywhere: bool,
}

/// One tile of the picture.
#[derive(Clone, Copy, Debug)]
pub struct TilePlace {
    /// From the left.
    pub across: u32,
    /// From the top.
    pub down: u32,
}

impl TilePlace {
    /// Its first column and row.
    pub fn first(self) -> (u32, u32) {
        (self.across * TILE_WIDTH as u32, self.down * TILE_HEIGHT as u32)
    }
}

impl<'a, E: Element> Tiles<'a, E> {
    /// Plans `scene` for `camera` on so many threads, by a kernel that finds bounds, without the omissions in `keep`.
    pub fn new(scene: &'a Scene, camera: &Camera, bounds: &Bounds, keep: Keep, threads: usize) -> Self {
        let grid = camera.grid::<f64>();
        let extent = extent(scene);
        let scale = power_of_two(extent / grid.focal);
        let far = if size_of::<E>() == 4 { 1e10 } else { 1e100 };
        // What a dark one would add is 0; the form of a sphere depends on how well each light's is known.
        let lights = light::lights(scene, Keep::NOTHING);
        let positions: Vec<_> = lights.iter().map(|light| nearer(light.position.as_dvec3(), far * extent)).collect();
        let points = positions.iter().map(|l| *l / scale);
        let points = points.map(|l| [l.x, l.y, l.z, 0.0].map(E::from_f64)).collect();
        let weighted = |white: f64| Weighted {
            lights: lights
                .iter()
                .zip(&positions)
                .map(|(light, l)| {
                    let radiance = white * light.radiance();
                    TileLight { x: l.x, y: l.y, z: l.z, red: radiance.x, green: radiance.y, blue: radiance.z }
                })
                .collect(),
            lits: scene
                .spheres
                .iter()
                .flat_map(|sphere| {
                    let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
                    let colour = white * sphere.colour.as_dvec3();
                    lights.iter().map(move |light| {
                        let from_centre = (light.position.as_dvec3() - centre) / radius;
                        lit(nearer(from_centre, far), colour, light)
                    })
                })
                .collect(),
        };
        let picture = Picture { width: camera.width(), height: camera.height() };
        let mut planned: Vec<_> = scene
            .spheres
            .iter()
            .map(|sphere| in_front(sphere.centre.as_dvec3(), sphere.radius.into(), &grid, scale, picture))
            .collect();
        let mut shorts = Vec::with_capacity(scene.spheres.len() * lights.len());
        for (planned, sphere) in planned.iter_mut().zip(&scene.spheres) {
            let mut short = !keep.has(Omission::Loop);
            for light in &lights {
                let (lit, accurate) = short_lit(planned.as_ref(), sphere, light, &grid, scale);
                shorts.push(lit.round());
                short &= accurate;
            }
            if let Some(planned) = planned {
                planned.sphere.short = f64::from(u8::from(short));
            }
        }
        let sphere_bounds: Vec<_> =
            planned.iter().map(|planned| planned.as_ref().map_or(picture.whole(), |planned| planned.bounds)).collect();
        let mut sphere_bounds = PixelBounds {
            columns: sphere_bounds.iter().map(|b| b[0]).collect(),
            rows: sphere_bounds.iter().map(|b| b[1]).collect(),
        };
        let widening = Widening { keep, frustum: Frustum::new(&grid), whole: picture.whole() };
        for (sphere, (columns, rows)) in
            scene.spheres.iter().zip(sphere_bounds.columns.iter_mut().zip(&mut sphere_bounds.rows))
        {
            widening.widen(columns, rows, || widening.frustum.unseen_sphere(sphere));
        }
        let bounded = (0..).zip(sphere_bounds.columns.iter().zip(&sphere_bounds.rows));
        let bounded: Vec<_> =
            bounded.map(|(id, (&columns, &rows))| Seen { id, columns, rows, near: f32::MAX }).collect();
        let view = bounds_view(&grid, scale, picture);
        // No object is in so few tiles where each is to be in all.
        let most_tiles = |most: usize| (!keep.has(Omission::OtherTiles)).then_some(most);
        let bins = |seen: &[Seen]| Bins::new(seen, picture, most_tiles(MOST_TILES));
        let (triangle_bins, extremes) = plan_triangles(&scene.triangles, &view, bounds, &widening, &bins, threads);
        Tiles {
            scene,
            camera: *camera,
            grid,
            scale,
            keep,
            points,
            shorts,
            linear: weighted(1.0),
            levels: weighted(255.0),
            odd: planned.iter().map(Option::is_none).collect(),
            spheres: planned
                .into_iter()
                .map(|planned| planned.map_or(TileSphere::<f64>::default(), |p| p.sphere).round())
                .collect(),
            sphere_bins: Bins::new(&bounded, picture, most_tiles(MOST_TILES_OF_A_SPHERE)),
            triangle_bins,
            extremes,
            sphere_bounds,
        }
    }

    /// Whether planning has seen that the scene is valid as far as its triangles go, and [moderate](is_moderate). Where it
    /// has not, the scene may yet be both.
    pub fn is_plain(&self) -> bool {
        let plain = |extremes: Extremes| {
            let Extremes { most, least, brightest } = extremes;
            is_moderate_size(most) && is_moderate_size(least) && (0.0..f32::INFINITY).contains(&brightest)
        };
        spheres_are_moderate(self.scene) && self.extremes.is_none_or(plain)
    }

    /// What is planned.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// As whom it is seen.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// All triangles.
    pub fn facets(&self) -> &[Triangle] {
        &self.scene.triangles
    }

    /// All spheres.
    pub fn spheres(&self) -> &[TileSphere<E>] {
        &self.spheres
    }

    /// As many for each sphere as there are lights, weighted for bytes.
    pub fn shorts(&self) -> &[ShortLit<E>] {
        &self.shorts
    }

    /// The bounds of all spheres.
    pub fn sphere_bounds(&self) -> &PixelBounds {
        &self.sphere_bounds
    }

    /// The bounds of all triangles, empty of those that no ray can hit.
    pub fn triangle_bounds(&self) -> PixelBounds {
        let none = vec![0; self.scene.triangles.len()];
        let mut bounds = PixelBounds { columns: none.clone(), rows: none };
        for seen in self.triangle_bins.iter().flat_map(|bins| bins.seen.iter().chain(&bins.large)) {
            bounds.columns[seen.id as usize] = seen.columns;
            bounds.rows[seen.id as usize] = seen.rows;
        }
        bounds
    }

    /// Whether a sphere is around the camera or reaches behind its plane, which no kernel takes.
    pub fn is_odd(&self, sphere: u32) -> bool {
        self.odd[sphere as usize]
    }

    /// Where the lights stand, for shading.
    pub fn points(&self) -> &[TilePoint<E>] {
        &self.points
    }

    /// What is weighted for floats.
    pub fn linear(&self) -> &Weighted<E> {
        &self.linear
    }

    /// What is weighted for bytes.
    pub fn levels(&self) -> &Weighted<E> {
        &self.levels
    }

    /// What is not left out.
    pub fn keep(&self) -> Keep {
        self.keep
    }
    /// Who is seen from where, to say why something is not.
    pub(super) fn frustum(&self) -> Frustum {
        Frustum::new(&self.grid)
    }

    /// Pixels of the picture.
    pub(super) fn pixels(&self) -> u64 {
        self.camera.pixels()
    }

    /// How many spheres in the picture have the short form in bytes.
    pub(super) fn in_short_form(&self) -> usize {
        let seen = self.sphere_bounds.columns.iter().zip(&self.sphere_bounds.rows);
        let seen = seen.map(|(columns, rows)| covered(*columns, *rows) > 0);
        self.spheres.iter().zip(seen).filter(|(sphere, seen)| *seen && sphere.short != E::ZERO).count()
    }

    /// How many tiles there are, across and down.
    pub(super) fn tiles(&self) -> [u32; 2] {
        [self.camera.width().div_ceil(TILE_WIDTH as u32), self.camera.height().div_ceil(TILE_HEIGHT as u32)]
    }

    /// A power of two: the tile's 1/t is this over t.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The grid of rays.
    pub fn grid(&self) -> TileGrid {
        let Grid { step, half_width, half_height, focal } = self.grid;
        TileGrid { step, half_width, half_height, focal }
    }

    /// The spheres and the triangles that a tile may see, in the scene's order. The latter are copied to `room` if they are
    /// not in one list.
    pub fn seen_in<'s>(&'s self, tile: TilePlace, spheres: &mut Vec<Seen>, room: &'s mut Vec<Seen>) -> &'s [Seen] {
        spheres.clear();
        self.sphere_bins.seen_in(tile, self.camera.width(), spheres);
        if let [bins] = &*self.triangle_bins
            && bins.large.is_empty()
        {
            return bins.of_tile(tile, self.camera.width());
        }
        room.clear();
        for bins in &self.triangle_bins {
            bins.seen_in(tile, self.camera.width(), room);
        }
        room
    }

    /// A tile's rays, for set-up and for shading.
    pub fn view(&self, tile: TilePlace) -> (TileView<f64>, TileRays<E>) {
        let (column, row) = tile.first();
        let [dx, dy, dz] = self.grid.ray(row + TILE_HEIGHT as u32 / 2, column + TILE_WIDTH as u32 / 2);
        let Grid { step, half_width, half_height, focal } = self.grid;
        // Of edges in the tile's elements, from the origin: three roundings of each constant and product, and some more
        // for safety. Of what set-up and the reference round in f64: a few units of the largest d there is.
        let unit = if size_of::<E>() == 4 { f64::from(f32::EPSILON) } else { f64::EPSILON };
        let (relative, exact) = (3.0 * unit, 16.0 * f64::EPSILON);
        let half = (TILE_WIDTH / 2) as f64;
        let view = TileView {
            dx,
            dy,
            dz,
            step,
            down: -step,
            scale: self.scale,
            bound_x: exact * 2.0 * half_width + relative * half * step,
            bound_y: exact * 2.0 * half_height + relative * half * step,
            bound_z: exact * focal,
            bound_0: relative,
        };
        (view, TileRays { dx, dy, dz, step, down: -step }.round())
    }
}

/// The size of a scene: about that of its farthest coordinate, found among a sample.
fn extent(scene: &Scene) -> f64 {
    let stride = scene.triangles.len() / 1024 + 1;
    let corners = scene.triangles.iter().step_by(stride).flat_map(|triangle| triangle.vertices);
    let stride = scene.spheres.len() / 1024 + 1;
    let centres = scene.spheres.iter().step_by(stride).map(|sphere| sphere.centre);
    let extent = corners.chain(centres).map(|v| f64::from(v.abs().max_element())).fold(0.0, f64::max);
    if extent > 0.0 && extent.is_finite() { extent } else { 1.0 }
}

/// The power of two below a positive number.
fn power_of_two(x: f64) -> f64 {
    2f64.powi(x.log2().floor() as i32)
}

/// A point, brought along its direction to a distance of at most `far`.
fn nearer(point: DVec3, far: f64) -> DVec3 {
    let distance = point.length();
    if distance > far { point * (far / distance) } else { point }
}

/// The size of the picture.
#[derive(Clone, Copy)]
struct Picture {
    width: u32,
    height: u32,
}

impl Picture {
    /// The bounds of an object that may be anywhere.
    fn whole(self) -> [u32; 2] {
        [self.width << 16, self.height << 16]
    }
}

/// How the kernel finds bounds in a picture.
fn bounds_view(grid: &Grid<f64>, scale: f64, picture: Picture) -> BoundsView<f32> {
    let [all_columns, all_rows] = picture.whole();
    let (width, height) = (f64::from(picture.width), f64::from(picture.height));
    // Several roundings of numbers up to the picture's size, each of 2^-24 of it.
    let margin = (width + height) / f64::from(1 << 20);
    let view = BoundsView {
        to_pixels: grid.focal / grid.step,
        column: 0.5 * width - 0.5,
        row: 0.5 * height - 0.5,
        low: 1.0 - margin,
        high: 1.0 + margin,
        width,
        height,
        // Some roundings more than the kernels' own.
        near: scale * grid.focal * (1.0 + 1.0 / f64::from(1 << 20)),
        all_columns: 0.0,
        all_rows: 0.0,
        // Within these bounds are two columns and two rows at most. An edge there is a sum of two products whose factors
        // are below 3, each off by the margin.
        reach: 2.0 - 4.0 * margin,
        outside: -13.0 * margin,
    };
    BoundsView { all_columns: f32::from_bits(all_columns), all_rows: f32::from_bits(all_rows), ..view.round::<f32>() }
}

/// Which tiles all triangles may be in, and their extremes. Each thread takes as many triangles, which lie side by side;
/// what they find is one after another, so that nobody sees how many there were.
fn plan_triangles(
    facets: &[Triangle],
    view: &BoundsView<f32>,
    kernel: &Bounds,
    widening: &Widening,
    bins: &(impl Fn(&[Seen]) -> Bins + Sync),
    threads: usize,
) -> (Vec<Bins>, Option<Extremes>) {
    let plan = |first_id: u32, facets: &[Triangle]| {
        let mut seen = roomy(facets.len().next_multiple_of(CHUNK));
        let all = widening.keep != Keep::NOTHING;
        let (count, extremes) = kernel.call(view, facets, first_id, all, &mut seen).unzip();
        seen.truncate(count.unwrap_or(0));
        if all {
            for Seen { id, columns, rows, .. } in &mut seen {
                let facet = &facets[(*id - first_id) as usize];
                widening.widen(columns, rows, || widening.frustum.unseen_triangle(facet));
            }
        }
        (bins(&seen), extremes)
    };
    let threads = threads.clamp(1, facets.len().div_ceil(FEWEST_PER_THREAD).max(1));
    let part = facets.len().div_ceil(threads).next_multiple_of(CHUNK).max(CHUNK);
    let plan = &plan;
    let mut parts = (0..).step_by(part).zip(facets.chunks(part)).map(|(first, facets)| move || plan(first, facets));
    let own = parts.next();
    let planned: Vec<_> = thread::scope(|scope| {
        let others: Vec<_> = parts.map(|part| scope.spawn(part)).collect();
        let own = own.map(|part| part());
        let others = others.into_iter().map(|other| other.join().unwrap_or_else(|panic| resume_unwind(panic)));
        own.into_iter().chain(others).collect()
    });
    let (bins, extremes): (Vec<_>, Vec<_>) = planned.into_iter().unzip();
    (bins, extremes.into_iter().flatten().reduce(Extremes::and))
}

/// Gives those objects the whole picture that are not to be left out.
struct Widening {
    keep: Keep,
    frustum: Frustum,
    whole: [u32; 2],
}

impl Widening {
    /// Of an object with these bounds; it may be `unseen` for a reason that is to be kept.
    fn widen(&self, columns: &mut u32, rows: &mut u32, unseen: impl Fn() -> Omission) {
        let keep = self.keep;
        if keep.has(Omission::Misses) || keep != Keep::NOTHING && covered(*columns, *rows) == 0 && keep.has(unseen()) {
            [*columns, *rows] = self.whole;
        }
    }
}

/// Pixels within bounds.
pub(super) fn covered(columns: u32, rows: u32) -> u64 {
    range(columns).len() as u64 * range(rows).len() as u64
}

/// A sphere for the kernels.
struct InFront {
    sphere: TileSphere<f64>,
    bounds: [u32; 2],
}

/// A sphere that is wholly in front of the camera's plane, with the camera outside; None if it is not.
fn in_front(centre: DVec3, radius: f64, grid: &Grid<f64>, scale: f64, picture: Picture) -> Option<InFront> {
    let Grid { step, half_width, half_height, focal } = *grid;
    // In units of the radius.
    let c = centre / radius;
    let k = c.dot(c) - 1.0;
    if c.z.is_nan() || c.z < 1.001 || !k.is_finite() {
        return if c.z <= -1.0 { Some(behind()) } else { None };
    }
    let columns = silhouette(c.x, c.z).map(|x| (focal * x + half_width) / step - 0.5);
    let rows = silhouette(c.y, c.z).map(|y| (half_height - focal * y) / step - 0.5);
    let rows = [rows[1], rows[0]];
    let middle = |[low, high]: [f64; 2]| (0.5 * (low + high)).round().clamp(-4e6, 4e6);
    let (column, row) = (middle(columns), middle(rows));
    // The ray at the origin, and what i columns and j rows add to it.
    let d = DVec3::new(step * (column + 0.5) - half_width, half_height - step * (row + 0.5), focal);
    let (across, down) = (DVec3::X * step, DVec3::Y * -step);
    // D = d.d - |c x d|^2, both of them quadratic in i and j: no difference of large numbers for a far sphere.
    let (a, u, v) = (c.cross(d), c.cross(across), c.cross(down));
    let square = (scale / (k * radius)).powi(2);
    let quadratic = [
        d.dot(d) - a.dot(a),
        2.0 * (d.dot(across) - a.dot(u)),
        2.0 * (d.dot(down) - a.dot(v)),
        across.dot(across) - u.dot(u),
        -2.0 * u.dot(v),
        down.dot(down) - v.dot(v),
    ];
    let [d0, dx, dy, dxx, dxy, dyy] = quadratic.map(|x| x * square);
    let reach = |[low, high]: [f64; 2], origin: f64| (high - origin).max(origin - low) + 1.0;
    let (i, j) = (reach(columns, column), reach(rows, row));
    let unit = f64::from(f32::EPSILON);
    let terms = [d0, dx * i, dy * j, dxx * i * i, dxy * i * j, dyy * j * j];
    let bound = 4.0 * unit * terms.iter().map(|term| term.abs()).sum::<f64>();
    let (over, h) = (scale / (k * radius), c.dot(d));
    // n / t = (d - h c / k) - sqrt(D) c / k, over the radius.
    let normal = |d: DVec3, h: f64| (d - h / k * c) * (scale / radius);
    let (m, mx, my) = (normal(d, h), normal(across, c.dot(across)), normal(down, c.dot(down)));
    let sphere = TileSphere {
        column,
        row,
        d0,
        dx,
        dy,
        dxx,
        dxy,
        dyy,
        bound,
        h: h * over,
        hx: c.dot(across) * over,
        hy: c.dot(down) * over,
        mx: m.x,
        mxx: mx.x,
        mxy: my.x,
        my: m.y,
        myx: mx.y,
        myy: my.y,
        mz: m.z,
        mzx: mx.z,
        mzy: my.z,
        ux: c.x,
        uy: c.y,
        uz: c.z,
        cx: centre.x,
        cy: centre.y,
        cz: centre.z,
        radius,
        short: 0.0,
    };
    Some(InFront { sphere, bounds: [first_and_past(columns, picture.width), first_and_past(rows, picture.height)] })
}

/// One light on a sphere in the short form, and whether that is accurate enough for bytes in f32.
fn short_lit(
    planned: Option<&InFront>,
    sphere: &Sphere,
    light: &Light,
    grid: &Grid<f64>,
    scale: f64,
) -> (ShortLit<f64>, bool) {
    /// The terms of the short form may be this many times as large as what they leave: half of the bits of f32.
    const LOSS: f64 = 1024.0;
    let Some(InFront { sphere: origin, .. }) = planned else { return (ShortLit::default(), false) };
    let radius = f64::from(sphere.radius);
    let (c, l) = (sphere.centre.as_dvec3() / radius, light.position.as_dvec3() / radius);
    let from_centre = (light.position.as_dvec3() - sphere.centre.as_dvec3()) / radius;
    let k = c.dot(c) - 1.0;
    let (kn, ke) = (k - c.dot(l), l.dot(l) - k);
    let (products, gap) = ((c.length() + 1.0) * from_centre.length(), from_centre.length() - 1.0);
    let loss = f64::max((kn.abs() + products) / gap, (ke.abs() + 2.0 * products) / (gap * gap));
    let step = grid.step;
    let d = DVec3::new(
        step * (origin.column + 0.5) - grid.half_width,
        grid.half_height - step * (origin.row + 0.5),
        grid.focal,
    );
    let q = from_centre * (scale / radius);
    let weights = weights(light, 255.0 * sphere.colour.as_dvec3());
    let lit = ShortLit {
        q0: q.dot(d),
        qx: q.x * step,
        qy: -q.y * step,
        kn,
        ke,
        red: weights.x,
        green: weights.y,
        blue: weights.z,
    };
    (lit, gap > 0.25 && loss < LOSS)
}

/// What no ray sees.
fn behind() -> InFront {
    InFront { sphere: TileSphere::default(), bounds: [0; 2] }
}

/// Where a sphere's silhouette ends along one axis at distance 1: |cx - cz x| = sqrt(x^2 + 1), solved for x.
fn silhouette(cx: f64, cz: f64) -> [f64; 2] {
    let m = cz * cz - 1.0;
    let root = (cx * cx + m).sqrt();
    let b = cx * cz;
    // The product of the two is (cx^2 - 1) / m.
    let product = (cx - 1.0) * (cx + 1.0);
    if b >= 0.0 { [product / (b + root), (b + root) / m] } else { [(b - root) / m, product / (b - root)] }
}

/// The first pixel of a range of coordinates, and the one past the last << 16.
fn first_and_past([low, high]: [f64; 2], side: u32) -> u32 {
    const MARGIN: f64 = 1e-3;
    // Casts saturate.
    let first = ((low - MARGIN).ceil() as u32).min(side);
    let past = ((high + MARGIN).floor() + 1.0).clamp(0.0, side.into()) as u32;
    first | past << 16
}

/// The first of a pair in 32 bits, and the one past the last.
fn range(bounds: u32) -> Range<u32> {
    (bounds & 0xffff)..(bounds >> 16)
}

impl Bins {
    /// An object in more than `most_tiles` is large; if None, all of them are, and in all tiles.
    fn new(seen: &[Seen], picture: Picture, most_tiles: Option<usize>) -> Self {
        let across = picture.width.div_ceil(TILE_WIDTH as u32);
        let tiles = (across * picture.height.div_ceil(TILE_HEIGHT as u32)) as usize;
        let Some(most_tiles) = most_tiles else {
            return Bins { starts: vec![0; tiles + 1], seen: Vec::new(), large: seen.to_vec(), everywhere: true };
        };
        // How many objects each tile has, and then where its next one goes.
        let mut counts = vec![0_u32; tiles];
        let mut large = Vec::new();
        each_place(seen, most_tiles, |run, tiles| {
            let Some((x, y)) = tiles else { return };
            y.for_each(|row| {
                x.clone().for_each(|column| counts[(row * across + column) as usize] += run.len() as u32);
            });
        });
        let mut starts = Vec::with_capacity(tiles + 1);
        let mut sum = 0;
        for count in &mut counts {
            starts.push(sum);
            sum += std::mem::replace(count, sum);
        }
        starts.push(sum);
        let mut placed = roomy(sum as usize);
        each_place(seen, most_tiles, |run, tiles| {
            let Some((x, y)) = tiles else { return large.extend_from_slice(run) };
            y.for_each(|row| {
                x.clone().for_each(|column| {
                    let next = &mut counts[(row * across + column) as usize];
                    placed[*next as usize..][..run.len()].copy_from_slice(run);
                    *next += run.len() as u32;
                });
            });
        });
        Bins { starts, seen: placed, large, everywhere: false }
    }

    /// What a tile may see of what is in few tiles.
    fn of_tile(&self, tile: TilePlace, width: u32) -> &[Seen] {
        let across = width.div_ceil(TILE_WIDTH as u32);
        let index = (tile.down * across + tile.across) as usize;
        &self.seen[self.starts[index] as usize..self.starts[index + 1] as usize]
    }

    /// Adds what a tile may see, in order.
    fn seen_in(&self, tile: TilePlace, width: u32, seen: &mut Vec<Seen>) {
        let own = self.of_tile(tile, width);
        if self.large.is_empty() {
            seen.extend_from_slice(own);
            return;
        }
        let (column, row) = tile.first();
        let in_tile = |large: &&Seen| {
            if self.everywhere {
                return true;
            }
            let (x, y) = (range(large.columns), range(large.rows));
            x.start < column + TILE_WIDTH as u32 && column < x.end && y.start < row + TILE_HEIGHT as u32 && row < y.end
        };
        let mut own = own.iter().copied().peekable();
        for large in self.large.iter().filter(in_tile) {
            while let Some(own) = own.next_if(|own| own.id < large.id) {
                seen.push(own);
            }
            seen.push(*large);
        }
        seen.extend(own);
    }
}

/// From pixels to tiles; not empty.
fn tile_range(pixels: Range<u32>, side: usize) -> Range<u32> {
    pixels.start / side as u32..(pixels.end - 1) / side as u32 + 1
}

/// Columns and rows of tiles.
type TileRanges = (Range<u32>, Range<u32>);

/// Says of all objects that may be seen in which tiles: as many that follow one another and are in one and the same tile
/// at a time, the others one by one, and None for those that are in too many. Neighbours in a mesh are mostly in one tile.
fn each_place(seen: &[Seen], most_tiles: usize, mut say: impl FnMut(&[Seen], Option<TileRanges>)) {
    let places = |seen: &Seen| {
        let (x, y) = (range(seen.columns), range(seen.rows));
        (tile_range(x, TILE_WIDTH), tile_range(y, TILE_HEIGHT))
    };
    let is_empty = |seen: &Seen| range(seen.columns).is_empty() || range(seen.rows).is_empty();
    let mut rest = seen;
    while let Some(first) = rest.first() {
        if is_empty(first) {
            rest = &rest[1..];
            continue;
        }
        let (x, y) = places(first);
        let tiles = x.len() * y.len();
        let mut run = 1;
        if tiles == 1 {
            // Of those that are in this tile alone.
            let (left, top) = (x.start * TILE_WIDTH as u32, y.start * TILE_HEIGHT as u32);
            let within = |bounds: u32, first: u32, side: usize| {
                first <= (bounds & 0xffff)
                    && (bounds & 0xffff) < (bounds >> 16)
                    && (bounds >> 16) <= first + side as u32
            };
            let alike = |seen: &&Seen| within(seen.columns, left, TILE_WIDTH) & within(seen.rows, top, TILE_HEIGHT);
            run += rest[1..].iter().take_while(alike).count();
        }
        let (of_run, others) = rest.split_at(run);
        say(of_run, (tiles <= most_tiles).then_some((x, y)));
        rest = others;
    }
}

/// Zeros, on large pages where they are many: a page that is touched for the first time costs as much as a thousand
/// triangles' numbers on it.
fn roomy(len: usize) -> Vec<Seen> {
    let mut zeros = sys::zeros(len);
    sys::large_pages(&mut zeros);
    zeros
}

/// One light on one sphere, as it is seen from the centre in radii.
fn lit<E: Element>(to_light: DVec3, colour: DVec3, light: &Light) -> Lit<E> {
    let weights = weights(light, colour);
    Lit {
        x: to_light.x,
        y: to_light.y,
        z: to_light.z,
        red: weights.x,
        green: weights.y,
        blue: weights.z,
        ..Lit::default()
    }
    .round()
}

/// I_L C, finite in f32 too: an infinite weight would make a NaN of a cosine of 0.
fn weights(light: &Light, colour: DVec3) -> DVec3 {
    (light.radiance() * colour).min(DVec3::splat(f32::MAX.into()))
}
