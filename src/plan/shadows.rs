//! What each light sees: the objects that may hide it, in the cells of six pictures around it.
//!
//! A light is a camera. The rays from all visible points to a light meet in it, so that what bounds and tiles do for the
//! camera's rays they do for these: an object is in few cells of a cube around the light, and a point asks those of its tile's
//! cells. How fine the cells are decides how long that takes, and nothing else. Of a pyramid of grids an object is in that
//! whose cells are about as large as it, and so in at most four of them.

use std::ops::Range;

use glam::{DVec3, Vec3};

use super::light;
use super::team::Team;
use crate::kernels::{CasterList, Extent, LightSideView, PointObject, SphereCaster, TilePoints, TriangleCaster};
use crate::reference::geometry;
use crate::scene::{Scene, Sphere, Triangle};

/// The sides of a cube around a light: the axis of each, and its sign.
const SIDES: [(usize, f64); 6] = [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)];

/// The finest cells, across a side.
const FINEST: u32 = 4096;

/// Cells are not much smaller than what a group of pixels sees.
const PIXELS_OF_A_CELL: u32 = 4;

/// A group that may be in more cells is asked for in parts.
const MOST_CELLS: u32 = 36;

/// A grid has at most so many cells for each of its objects; smaller ones are in coarser grids.
const CELLS_OF_AN_OBJECT: usize = 8;

/// The rounding of a coordinate on a side, which is within 1.
const SLACK: f64 = 8.0 * f64::EPSILON;

/// What P's rounding, and that of products with it, may make of the plane of a triangle and of the power of a sphere.
const TRIANGLE_ROUNDING: f64 = 8.0 * f64::EPSILON;
const SPHERE_ROUNDING: f64 = 32.0 * f64::EPSILON;

/// With a larger share of what its terms are a volume has no doubtful sign, however thin the triangle.
const PLAIN: f64 = 1e-10;

/// The shadows of a scene.
pub struct Shadows<'a> {
    scene: &'a Scene,
    /// Those that are not dark.
    lights: Vec<LightView>,
}

/// What one light sees.
struct LightView {
    position: DVec3,
    /// Those with objects.
    sides: Vec<Side>,
}

/// The objects on a side of the cube.
#[derive(Clone, Default)]
struct Side {
    /// The axis that it looks along.
    axis: usize,
    view: LightSideView<f64>,
    objects: Vec<Extent>,
    /// The grids that have objects, from the finest on.
    grids: Vec<Grid>,
}

/// The cells of one size with objects.
#[derive(Clone)]
struct Grid {
    /// The binary logarithm of a cell's side in the finest ones.
    coarseness: u32,
    /// Where the objects of each cell begin, row by row; and the end of the last.
    starts: Vec<u32>,
    placed: Vec<u32>,
}

/// An object in a cell is its index in those of a side, and whether this is its first cell in a row, and in a column.
const FIRST_COLUMN: u32 = 1 << 31;
const FIRST_ROW: u32 = 1 << 30;
const FIRSTS: u32 = FIRST_COLUMN | FIRST_ROW;

/// A side of a light's cube.
#[derive(Clone, Copy)]
pub struct LightSide<'a> {
    scene: &'a Scene,
    position: DVec3,
    side: &'a Side,
}

/// The ends of points on a side, in cells, as the fields of `LitGroups` have them: greatest ones are negated.
pub type Ends = [f32; 5];

/// Points with the same ends.
pub struct Window {
    ends: Ends,
    /// The finest cells that they may be in: columns and rows.
    cells: [Range<u32>; 2],
}

/// Objects as a light sees them.
#[derive(Default)]
pub struct Casters {
    pub triangles: CasterList<TriangleCaster<f64>>,
    pub spheres: CasterList<SphereCaster<f64>>,
}

/// The bounds of an object on a side: its coordinates at depth 1, and its least depth.
#[derive(Clone, Copy)]
struct Bounds {
    low: [f64; 2],
    high: [f64; 2],
    depth: f64,
}

/// Of what is beside the light or around it.
const WHOLE: Bounds = Bounds { low: [-1.0; 2], high: [1.0; 2], depth: 0.0 };

/// A vector in the axes of a side: across, down, and depth.
fn turned(v: DVec3, side: usize) -> [f64; 3] {
    let (axis, sign) = SIDES[side];
    let v = v.to_array();
    [v[(axis + 1) % 3], v[(axis + 2) % 3], sign * v[axis]]
}

impl Bounds {
    /// Those of a box, from its least coordinates to its greatest; None if it is not on this side.
    fn of_box([low, high]: [DVec3; 2], side: usize) -> Option<Bounds> {
        let (a, b) = (turned(low, side), turned(high, side));
        let (near, far) = (a[2].min(b[2]), a[2].max(b[2]));
        if far <= 0.0 || (0..2).any(|i| a[i] > far || -b[i] > far) {
            return None;
        }
        if near <= 0.0 {
            return Some(WHOLE);
        }
        let least = |i: usize| a[i] / if a[i] < 0.0 { near } else { far };
        let most = |i: usize| b[i] / if b[i] < 0.0 { far } else { near };
        Bounds { low: [least(0), least(1)], high: [most(0), most(1)], depth: near }.clipped()
    }

    /// Those of a sphere, from a light.
    fn of_sphere(sphere: &Sphere, light: DVec3, side: usize) -> Option<Bounds> {
        let (centre, radius) = (sphere.centre.as_dvec3() - light, DVec3::splat(sphere.radius.into()));
        Bounds::of_box([centre - radius, centre + radius], side)
    }

    /// Those of a triangle.
    fn of_triangle(triangle: &Triangle, light: DVec3, side: usize) -> Option<Bounds> {
        let corners = triangle.vertices.map(|v| turned(v.as_dvec3() - light, side));
        let all = |beside: fn(&[f64; 3]) -> bool| corners.iter().all(beside);
        let is_outside = all(|v| v[2] <= 0.0)
            || all(|v| v[0] > v[2])
            || all(|v| -v[0] > v[2])
            || all(|v| v[1] > v[2])
            || all(|v| -v[1] > v[2]);
        if is_outside {
            return None;
        }
        if corners.iter().any(|v| v[2] <= 0.0) {
            return Some(WHOLE);
        }
        let [a, b, c] = corners.map(|[x, y, z]| [x * z.recip(), y * z.recip(), z]);
        let least = |i: usize| a[i].min(b[i]).min(c[i]);
        let most = |i: usize| a[i].max(b[i]).max(c[i]);
        Bounds { low: [least(0), least(1)], high: [most(0), most(1)], depth: least(2) }.clipped()
    }

    /// Within the side, and wider by what rounding may move.
    fn clipped(self) -> Option<Bounds> {
        let (low, high) = (self.low.map(|x| (x - SLACK).max(-1.0)), self.high.map(|x| (x + SLACK).min(1.0)));
        (low[0] <= high[0] && low[1] <= high[1]).then_some(Bounds { low, high, ..self })
    }
}

/// The bounds of an object in cells. Rounding keeps the order of all numbers on a side: those of points are as well.
fn extent(view: &LightSideView<f64>, of: &Bounds, own: u32) -> Extent {
    let at = |[x, y]: [f64; 2]| [((x - view.low_x) * view.scale_x) as f32, ((y - view.low_y) * view.scale_y) as f32];
    // The depth is rounded down.
    let depth = (of.depth * (1.0 - f64::from(f32::EPSILON))) as f32;
    Extent { low: at(of.low), high: at(of.high), depth, own }
}

/// The finest cell that a coordinate is in.
fn cell(x: f32) -> u32 {
    (x as u32).min(FINEST - 1)
}

impl Side {
    /// Of the objects of a scene whose bounds are `whole`; the picture's longer side has so many `pixels`.
    fn of(scene: &Scene, light: DVec3, (number, whole): (usize, &Bounds), pixels: u32) -> Self {
        let (low, high) = (whole.low.map(|x| x - 4.0 * SLACK), whole.high.map(|x| x + 4.0 * SLACK));
        let [scale_x, scale_y] = [0, 1].map(|i| f64::from(FINEST) / (high[i] - low[i]));
        let ((axis, sign), [across, down, depth]) = (SIDES[number], turned(light, number));
        let (depth, [low_x, low_y]) = (sign * depth, low);
        let view = LightSideView { across, down, depth, sign, low_x, low_y, scale_x, scale_y };
        let (mut own, mut objects) = (0, Vec::new());
        let mut add = |of: Option<Bounds>| {
            objects.extend(of.map(|of| extent(&view, &of, own)));
            own += 1;
        };
        scene.spheres.iter().for_each(|sphere| add(Bounds::of_sphere(sphere, light, number)));
        scene.all_triangles().for_each(|triangle| add(Bounds::of_triangle(&triangle, light, number)));
        let useful = (pixels / PIXELS_OF_A_CELL).next_power_of_two().min(FINEST);
        let grids = Grid::of(&objects, (FINEST / useful).ilog2());
        Side { axis, view, objects, grids }
    }
}

/// The first and the last of the finest columns that an object is in, and of the rows; and the binary logarithm of the side of
/// cells of which it is in at most two across and two down.
fn cells(Extent { low, high, .. }: &Extent) -> ([[usize; 2]; 2], usize) {
    let cells = [0, 1].map(|i| [low[i], high[i]].map(|x| cell(x) as usize));
    let [across, down] = cells.map(|[first, last]| last - first);
    (cells, across.max(down).next_power_of_two().ilog2() as usize)
}

impl Grid {
    /// Those of objects, from the `finest` coarseness on.
    fn of(objects: &[Extent], finest: u32) -> Vec<Grid> {
        const LEVELS: usize = 1 + FINEST.ilog2() as usize;
        let mut counts = [0; LEVELS];
        objects.iter().for_each(|of| counts[cells(of).1.max(finest as usize)] += 1);
        // The grid of each level.
        let (mut grids, mut of_level, mut count) = (Vec::new(), [0; LEVELS], 0);
        for level in 0..LEVELS {
            of_level[level] = grids.len();
            count += counts[level];
            let across = FINEST as usize >> level;
            if count > 0 && across.pow(2) <= CELLS_OF_AN_OBJECT * count {
                // Two more: see below.
                grids.push(Grid { coarseness: level as u32, starts: vec![0; across.pow(2) + 2], placed: Vec::new() });
                count = 0;
            }
        }
        let each_cell = |grids: &mut Vec<Grid>, say: fn(&mut Grid, usize, u32)| {
            for (object, of) in (0..).zip(objects) {
                let (cells, level) = cells(of);
                let grid = &mut grids[of_level[level]];
                let (shift, across) = (grid.coarseness, FINEST as usize >> grid.coarseness);
                let [columns, rows] = cells.map(|of| of.map(|cell| cell >> shift));
                for row in rows[0]..=rows[1] {
                    for column in columns[0]..=columns[1] {
                        let first = if column == columns[0] { FIRST_COLUMN } else { 0 };
                        say(grid, row * across + column, object | first | if row == rows[0] { FIRST_ROW } else { 0 });
                    }
                }
            }
        };
        // First where the next object of a cell goes, at the index after its own; and so in the end where the next cell begins.
        each_cell(&mut grids, |grid, cell, _| grid.starts[cell + 2] += 1);
        for Grid { starts, placed, .. } in &mut grids {
            (2..starts.len()).for_each(|cell| starts[cell] += starts[cell - 1]);
            placed.resize(starts[starts.len() - 1] as usize, 0);
        }
        each_cell(&mut grids, |grid, cell, object| {
            let next = &mut grid.starts[cell + 1];
            grid.placed[*next as usize] = object;
            *next += 1;
        });
        grids
    }
}

/// The least and the greatest coordinates of a scene's objects.
fn ends(scene: &Scene) -> [DVec3; 2] {
    let spheres = scene.spheres.iter().flat_map(|sphere| {
        let (centre, radius) = (sphere.centre.as_dvec3(), DVec3::splat(sphere.radius.into()));
        [centre - radius, centre + radius]
    });
    spheres
        .chain(scene.vertices().map(|v| v.as_dvec3()))
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

impl<'a> Shadows<'a> {
    /// Those of all lights of a scene that are not dark.
    pub fn new(scene: &'a Scene, team: &Team) -> Self {
        let (all, pixels) = (ends(scene), scene.camera.width().max(scene.camera.height()));
        let view = |position| LightView { position, sides: vec![Side::default(); SIDES.len()] };
        let lights = light::lights(scene).into_iter().map(|light| light.position.as_dvec3());
        let mut shadows = Shadows { scene, lights: lights.map(view).collect() };
        let tasks = shadows.lights.iter_mut().flat_map(|LightView { position, sides }| {
            let light = *position;
            let sides = sides.iter_mut().enumerate();
            sides.filter_map(move |(number, side)| {
                Some((light, (number, Bounds::of_box(all.map(|v| v - light), number)?), side))
            })
        });
        team.share(tasks.collect::<Vec<_>>().into_iter(), |(light, (number, whole), side)| {
            *side = Side::of(scene, light, (number, &whole), pixels);
        });
        let is_alone = scene.spheres.len() + scene.triangle_count() == 1;
        shadows.lights.iter_mut().for_each(|light| light.sides.retain(|side| !is_alone && !side.grids.is_empty()));
        shadows
    }

    /// How many objects may hide a light.
    pub fn objects(&self, light: usize) -> u64 {
        if self.lights[light].sides.is_empty() {
            0
        } else {
            (self.scene.spheres.len() + self.scene.triangle_count()) as u64
        }
    }

    /// How many lights nothing hides.
    pub fn unhidden(&self) -> u64 {
        self.lights.iter().filter(|light| light.sides.is_empty()).count() as u64
    }

    /// Where the lights are.
    pub fn lights(&self) -> impl Iterator<Item = DVec3> {
        self.lights.iter().map(|light| light.position)
    }

    /// The sides on which a light sees objects.
    pub fn sides(&self, light: usize) -> impl Iterator<Item = LightSide<'_>> {
        let LightView { position, sides } = &self.lights[light];
        sides.iter().map(move |side| LightSide { scene: self.scene, position: *position, side })
    }

    /// The object at this place in the scene, spheres first, as its visible points are found; None if no light reaches what is
    /// visible of it: it is around the camera, or has no points.
    pub fn object(&self, place: usize) -> Option<PointObject<f64>> {
        let own = place as f64;
        let of = |DVec3 { x, y, z }: DVec3| PointObject { x, y, z, own, w: 1.0, ..PointObject::default() };
        let Some(sphere) = self.scene.spheres.get(place) else {
            let triangle = self.scene.triangle(place - self.scene.spheres.len());
            let corners = triangle.vertices.map(|v: Vec3| v.as_dvec3());
            let volume = geometry::triangle_volume(corners)?;
            return Some(of(geometry::triangle_plane(corners) / volume));
        };
        let (c, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let (r2, k) = (radius * radius, geometry::power(c, radius));
        let is_near = c.dot(c) < 2.0 * r2;
        let [a, b, e] = if is_near { [-k, 1.0, 0.0] } else { [r2, 0.0, 1.0] };
        (k > 0.0).then(|| PointObject { a, b, e, w: 1.0 / k, ..of(c) })
    }
}

impl<'a> LightSide<'a> {
    /// How points are found on it.
    pub fn view(&self) -> &LightSideView<f64> {
        &self.side.view
    }

    /// The axis that it looks along.
    pub fn axis(&self) -> usize {
        self.side.axis
    }

    /// Where the light is.
    pub fn light(&self) -> [f64; 3] {
        self.position.to_array()
    }

    /// The ends of a point, by the operations of the kernel for many; None if it is not on this side.
    pub fn ends(&self, points: &TilePoints<f64>, at: usize) -> Option<Ends> {
        let view = self.view();
        let [x, y, z] = [1, 2, 0].map(|next| [&points.x, &points.y, &points.z][(self.axis() + next) % 3][at]);
        let (x, y, z) = (x - view.across, y - view.down, (z - view.depth) * view.sign);
        let over = 1.0 / z;
        let x = ((x * over - view.low_x) * view.scale_x) as f32;
        let y = ((y * over - view.low_y) * view.scale_y) as f32;
        (z > 0.0).then_some([-x, -y, x, y, -z as f32])
    }

    /// The cells of points with these ends; None if none is on this side, among objects.
    pub fn window(&self, ends: Ends) -> Option<Window> {
        let ([past_x, past_y, x, y, _], end) = (ends, FINEST as f32);
        (x <= end && y <= end && past_x <= 0.0 && past_y <= 0.0)
            .then(|| Window { ends, cells: [cell(x)..cell(-past_x) + 1, cell(y)..cell(-past_y) + 1] })
    }

    /// Whether it has so many cells that it pays to ask for parts of the points alone.
    pub fn is_wide(&self, Window { cells, .. }: &Window) -> bool {
        let finest = self.side.grids.first().map_or(0, |grid| grid.coarseness);
        let [columns, rows] = [0, 1].map(|i| (cells[i].end - cells[i].start) >> finest);
        (columns + 1) * (rows + 1) > MOST_CELLS
    }

    /// Calls `say` for each grid and each row of its cells in a window.
    fn each_row(&self, window: &Window, mut say: impl FnMut(&Grid, Range<usize>, u32)) {
        for grid in &self.side.grids {
            let across = FINEST >> grid.coarseness;
            let [columns, rows] = [0, 1]
                .map(|i| &window.cells[i])
                .map(|of| of.start >> grid.coarseness..((of.end - 1) >> grid.coarseness) + 1);
            for row in rows.clone() {
                let first = if row == rows.start { FIRST_ROW } else { 0 };
                say(grid, (row * across + columns.start) as usize..(row * across + columns.end) as usize, first);
            }
        }
    }

    /// How many objects are in its cells; in several cells they count as often.
    pub fn count(&self, window: &Window) -> u32 {
        let mut count = 0;
        self.each_row(window, |grid, cells, _| count += grid.starts[cells.end] - grid.starts[cells.start]);
        count
    }

    /// Adds the objects in its cells that may be before its points.
    pub fn gather(&self, window: &Window, all: &mut Vec<&'a Extent>) {
        let [past_x, past_y, x, y, depth] = window.ends;
        let meets = |of: &&Extent| {
            of.low[0] <= -past_x && of.low[1] <= -past_y && of.high[0] >= x && of.high[1] >= y && of.depth <= -depth
        };
        self.each_row(window, |grid, cells, first_row| {
            let mut first = first_row | FIRST_COLUMN;
            for cell in cells {
                let placed = &grid.placed[grid.starts[cell] as usize..grid.starts[cell + 1] as usize];
                let firsts = placed.iter().filter(|object| (**object | first) & FIRSTS == FIRSTS);
                all.extend(firsts.map(|object| &self.side.objects[(object & !FIRSTS) as usize]).filter(meets));
                first = first_row;
            }
        });
    }

    /// Adds objects as the light sees them, but for triangles of which it sees an edge alone.
    pub fn cast(&self, objects: &[&Extent], casters: &mut Casters) {
        for object in objects {
            match self.scene.spheres.get(object.own as usize) {
                Some(sphere) => self.cast_sphere(object, sphere, &mut casters.spheres),
                None => self.cast_triangle(object, &mut casters.triangles),
            }
        }
    }

    fn cast_triangle(&self, object: &Extent, casters: &mut CasterList<TriangleCaster<f64>>) {
        let triangle = self.scene.triangle(object.own as usize - self.scene.spheres.len());
        let corners = triangle.vertices.map(|v| v.as_dvec3());
        let n = geometry::triangle_plane(corners);
        let from_light = corners[0] - self.position;
        let volume = from_light.dot(n);
        let is_plain = volume.abs() > PLAIN * from_light.abs().element_sum() * n.abs().max_element();
        let volume = if is_plain { Some(volume) } else { geometry::side_of_plane(corners, n, self.position, 0.0) };
        let Some(side) = volume.map(f64::signum) else { return };
        // The plane through the light and an edge; turned round, the edge has exactly the other side.
        let edge = |v: DVec3, w: DVec3| {
            let middle = 0.5 * (v + w);
            let n = side * (middle - self.position).cross(w - v);
            (n, -n.dot(middle))
        };
        let [v1, v2, v3] = corners;
        let [(e1, e10), (e2, e20), (e3, e30)] = [edge(v1, v2), edge(v2, v3), edge(v3, v1)];
        let [nearest, ..] = geometry::near_corner_first(corners);
        let (p, bound) = (-side * n, TRIANGLE_ROUNDING * n.abs().max_element());
        let caster = TriangleCaster {
            e1x: e1.x,
            e1y: e1.y,
            e1z: e1.z,
            e10,
            e2x: e2.x,
            e2y: e2.y,
            e2z: e2.z,
            e20,
            e3x: e3.x,
            e3y: e3.y,
            e3z: e3.z,
            e30,
            px: p.x,
            py: p.y,
            pz: p.z,
            p0: bound * nearest.abs().element_sum() - p.dot(nearest),
            bound,
            own: object.own.into(),
        };
        casters.push(caster, object);
    }

    fn cast_sphere(&self, object: &Extent, sphere: &Sphere, casters: &mut CasterList<SphereCaster<f64>>) {
        let (c, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let (r2, of_light) = (radius * radius, geometry::power(c - self.position, radius));
        let is_outside = of_light > 0.0;
        // Points of a large sphere may be so near that |P - c|^2 - r^2 loses them.
        let is_large = c.dot(c) < 4.0 * r2;
        let (u, w, k) = if is_large { (DVec3::ZERO, 2.0 * c, geometry::power(c, radius)) } else { (c, c, -r2) };
        let caster = SphereCaster {
            x: c.x,
            y: c.y,
            z: c.z,
            ux: u.x,
            uy: u.y,
            uz: u.z,
            wx: w.x,
            wy: w.y,
            wz: w.z,
            k,
            r2,
            side: if is_outside { 1.0 } else { -1.0 },
            past: if is_outside { 0.0 } else { f64::NEG_INFINITY },
            most: if of_light < 0.0 { f64::INFINITY } else { 0.0 },
            bound: SPHERE_ROUNDING * radius,
            own: object.own.into(),
        };
        casters.push(caster, object);
    }
}
