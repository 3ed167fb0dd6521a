//! What each light sees: the objects that may hide it, in the cells of six pictures around it.
//!
//! A light is a camera. The rays from all visible points to a light meet in it, so that what bounds and tiles do for the
//! camera's rays they do for these: an object is in few cells of a cube around the light, and a point asks those of its own
//! cell. How fine the cells are decides how long that takes, and nothing else. Of a pyramid of grids an object is in that
//! whose cells are about as large as it, and so in at most four of them.

use std::ops::Range;

use glam::{DVec3, Vec3};

use super::light;
use super::team::Team;
use crate::kernels::{PointObject, SphereCaster, TriangleCaster};
use crate::reference::geometry;
use crate::scene::{Scene, Sphere, Triangle};

/// The sides of a cube around a light: the axis of each, and its sign.
const SIDES: [(usize, f64); 6] = [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)];

/// The finest cells, across a side.
const FINEST: u32 = 4096;

/// Cells are not much smaller than what a group of pixels sees.
const PIXELS_OF_A_CELL: u32 = 4;

/// Points that may be in more cells are asked for in parts.
const MOST_CELLS: u32 = 36;

/// A grid has at most so many cells for each of its objects; smaller ones are in coarser grids.
const CELLS_OF_AN_OBJECT: usize = 8;

/// The rounding of a coordinate on a side, which is within 1.
const SLACK: f64 = 8.0 * f64::EPSILON;

/// What P's rounding, and that of products with it, may make of the plane of a triangle and of the power of a sphere.
const TRIANGLE_ROUNDING: f64 = 8.0 * f64::EPSILON;
const SPHERE_ROUNDING: f64 = 32.0 * f64::EPSILON;

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
    /// Its index.
    number: usize,
    cells: Cells,
    /// The grids that have objects, from the finest on.
    grids: Vec<Grid>,
}

/// The part of a side that objects are in, and how many of the finest cells it has for a unit across and down.
#[derive(Clone, Copy, Default)]
struct Cells {
    low: [f64; 2],
    high: [f64; 2],
    scale: [f64; 2],
}

/// The cells of one size with objects of a kind.
#[derive(Clone)]
struct Grid {
    kind: Kind,
    /// The binary logarithm of a cell's side in the finest ones.
    coarseness: u32,
    /// Where the objects of each cell begin, row by row; and the end of the last.
    starts: Vec<u32>,
    /// Those of a cell are sorted by depth.
    objects: Vec<Near>,
}

/// The kinds of objects.
#[derive(Clone, Copy)]
pub enum Kind {
    Sphere,
    Triangle,
}

/// An object in a cell.
#[derive(Clone, Copy, Default)]
pub struct Near {
    /// Its index among those of its kind.
    pub id: u32,
    /// A lower bound of its depth on this side.
    depth: f32,
}

/// A side of a light's cube.
#[derive(Clone, Copy)]
pub struct LightSide<'a> {
    scene: &'a Scene,
    light: usize,
    position: DVec3,
    side: &'a Side,
}

/// Points as a light sees them on a side.
pub struct Seen {
    /// The finest cells that they may be in: columns and rows.
    cells: [Range<u32>; 2],
    /// The depth of the farthest, rounded up.
    depth: f32,
    /// The greatest x and y, in cells, and the least, negated.
    pub ends: [f32; 4],
}

/// Objects that may hide a light from such points: they are not all behind.
pub struct Cell<'a> {
    pub kind: Kind,
    /// Tells it from all others of the scene.
    pub key: u64,
    /// Sorted by depth.
    pub objects: &'a [Near],
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
        let [a, b, c] = corners.map(|v| [v[0] / v[2], v[1] / v[2], v[2]]);
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

impl Cells {
    /// The finest cells that bounds meet: columns and rows.
    fn range(&self, of: &Bounds) -> [Range<u32>; 2] {
        let cell = |x: f64, i: usize| {
            let finest = (x.clamp(self.low[i], self.high[i]) - self.low[i]) * self.scale[i];
            (finest as u32).min(FINEST - 1)
        };
        [0, 1].map(|i| cell(of.low[i], i)..cell(of.high[i], i) + 1)
    }

    fn meet(&self, of: &Bounds) -> bool {
        (0..2).all(|i| of.high[i] >= self.low[i] && of.low[i] <= self.high[i])
    }

    /// The least coordinates in cells, rounded down, and the greatest, rounded up.
    fn ends(&self, of: &Bounds) -> [[f32; 2]; 2] {
        let at = |x: f64, i: usize| ((x - self.low[i]) * self.scale[i]) as f32;
        [[0, 1].map(|i| at(of.low[i], i).next_down()), [0, 1].map(|i| at(of.high[i], i).next_up())]
    }
}

impl Side {
    /// Of spheres and triangles with these bounds, if they are there; the picture's longer side has so many `pixels`.
    fn of(
        number: usize,
        pixels: u32,
        spheres: impl Iterator<Item = Option<Bounds>>,
        triangles: impl Iterator<Item = Option<Bounds>>,
    ) -> Self {
        let (mut low, mut high) = ([1.0_f64; 2], [-1.0_f64; 2]);
        let mut there = |bounds: Option<Bounds>| {
            for (i, of) in bounds.iter().flat_map(|of| [(0, of), (1, of)]) {
                (low[i], high[i]) = (low[i].min(of.low[i]), high[i].max(of.high[i]));
            }
            bounds
        };
        let spheres: Vec<_> = (0..).zip(spheres).filter_map(|(id, of)| Some((id, there(of)?))).collect();
        let triangles: Vec<_> = (0..).zip(triangles).filter_map(|(id, of)| Some((id, there(of)?))).collect();
        let scale = [0, 1].map(|i| f64::from(FINEST) / (high[i] - low[i]).max(f64::MIN_POSITIVE));
        let (cells, mut grids) = (Cells { low, high, scale }, Vec::new());
        let useful = (pixels / PIXELS_OF_A_CELL).next_power_of_two().min(FINEST);
        let finest = (FINEST / useful).ilog2();
        cells.place(Kind::Sphere, &spheres, finest, &mut grids);
        cells.place(Kind::Triangle, &triangles, finest, &mut grids);
        Side { number, cells, grids }
    }
}

/// An object with the finest cells that it may be in.
struct Placed {
    near: Near,
    /// The first and last column, then row.
    cells: [[u16; 2]; 2],
}

impl Placed {
    /// The binary logarithm of the side of cells of which it is in at most two across and two down.
    fn level(&self) -> u32 {
        let [across, down] = self.cells.map(|[first, last]| last - first);
        across.max(down).next_power_of_two().ilog2()
    }
}

impl Cells {
    /// Adds the grids, from the `finest` coarseness on, of objects of a kind with these bounds.
    fn place(&self, kind: Kind, objects: &[(u32, Bounds)], finest: u32, grids: &mut Vec<Grid>) {
        let mut counts = [0; 1 + FINEST.ilog2() as usize];
        let place = |(id, bounds): &(u32, Bounds)| {
            let cells = self.range(bounds).map(|of| [of.start as u16, of.end as u16 - 1]);
            // Rounded down.
            let depth = (bounds.depth * (1.0 - f64::from(f32::EPSILON))) as f32;
            let object = Placed { near: Near { id: *id, depth }, cells };
            counts[object.level().max(finest) as usize] += 1;
            object
        };
        let placed: Vec<_> = objects.iter().map(place).collect();
        let (mut first, mut count) = (0, 0);
        for (level, here) in (0..).zip(counts) {
            count += here;
            if count > 0 && (FINEST as usize >> level).pow(2) <= CELLS_OF_AN_OBJECT * count {
                let levels = first..=level;
                grids.push(Grid::new(kind, placed.iter().filter(|of| levels.contains(&of.level())), level));
                (first, count) = (level + 1, 0);
            }
        }
    }
}

impl Grid {
    fn new<'a>(kind: Kind, placed: impl Iterator<Item = &'a Placed> + Clone, coarseness: u32) -> Self {
        let across = FINEST as usize >> coarseness;
        let each_cell = |of: &Placed, say: &mut dyn FnMut(usize)| {
            let [columns, rows] = of.cells.map(|of| of.map(|cell| usize::from(cell) >> coarseness));
            for row in rows[0]..=rows[1] {
                (columns[0]..=columns[1]).for_each(|column| say(row * across + column));
            }
        };
        // First where the next object of a cell goes, at the index after its own; and so in the end where the next cell begins.
        let mut starts = vec![0_u32; across * across + 2];
        placed.clone().for_each(|of| each_cell(of, &mut |cell| starts[cell + 2] += 1));
        for cell in 2..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let mut objects = vec![Near::default(); starts[starts.len() - 1] as usize];
        for of in placed {
            each_cell(of, &mut |cell| {
                objects[starts[cell + 1] as usize] = of.near;
                starts[cell + 1] += 1;
            });
        }
        starts.pop();
        for ends in starts.windows(2).filter(|ends| ends[1] - ends[0] > 1) {
            objects[ends[0] as usize..ends[1] as usize].sort_unstable_by(|a, b| a.depth.total_cmp(&b.depth));
        }
        Grid { kind, coarseness, starts, objects }
    }
}

/// The least and the greatest coordinates of a scene's objects.
fn extent(scene: &Scene) -> [DVec3; 2] {
    let spheres = scene.spheres.iter().flat_map(|sphere| {
        let (centre, radius) = (sphere.centre.as_dvec3(), DVec3::splat(sphere.radius.into()));
        [centre - radius, centre + radius]
    });
    let corners = scene.all_triangles().flat_map(|triangle| triangle.vertices.map(|v| v.as_dvec3()));
    spheres.chain(corners).fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

impl<'a> Shadows<'a> {
    /// Those of all lights of a scene that are not dark.
    pub fn new(scene: &'a Scene, team: &Team) -> Self {
        let (all, pixels) = (extent(scene), scene.camera.width().max(scene.camera.height()));
        let view = |position| LightView { position, sides: vec![Side::default(); SIDES.len()] };
        let lights = light::lights(scene).into_iter().map(|light| light.position.as_dvec3());
        let mut shadows = Shadows { scene, lights: lights.map(view).collect() };
        let tasks = shadows.lights.iter_mut().flat_map(|LightView { position, sides }| {
            sides.iter_mut().enumerate().map(|(number, side)| (*position, number, side))
        });
        let seen = tasks.filter(|(light, number, _)| Bounds::of_box(all.map(|v| v - *light), *number).is_some());
        team.share(seen.collect::<Vec<_>>().into_iter(), |(light, number, side)| {
            let spheres = scene.spheres.iter().map(|sphere| Bounds::of_sphere(sphere, light, number));
            let triangle = |id| Bounds::of_triangle(&scene.triangle(id), light, number);
            *side = Side::of(number, pixels, spheres, (0..scene.triangle_count()).map(triangle));
        });
        shadows.lights.iter_mut().for_each(|light| light.sides.retain(|side| !side.grids.is_empty()));
        shadows
    }

    /// Where the lights are.
    pub fn lights(&self) -> impl Iterator<Item = DVec3> {
        self.lights.iter().map(|light| light.position)
    }

    /// The sides on which a light sees objects.
    pub fn sides(&self, light: usize) -> impl Iterator<Item = LightSide<'_>> {
        let LightView { position, sides } = &self.lights[light];
        sides.iter().map(move |side| LightSide { scene: self.scene, light, position: *position, side })
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

impl LightSide<'_> {
    /// Points in a box, given by its least and its greatest coordinates; None if none is on this side, among objects.
    pub fn seen(&self, points: [DVec3; 2]) -> Option<Seen> {
        let Side { number, cells, .. } = self.side;
        let points = points.map(|v| v - self.position);
        let bounds = Bounds::of_box(points, *number).filter(|bounds| cells.meet(bounds))?;
        let (near, far) = (turned(points[0], *number)[2], turned(points[1], *number)[2]);
        let depth = (near.max(far) * (1.0 + f64::from(f32::EPSILON))) as f32;
        let [low, high] = cells.ends(&bounds);
        Some(Seen { cells: cells.range(&bounds), depth, ends: [high[0], high[1], -low[0], -low[1]] })
    }

    /// Whether they may be in so many cells that it pays to ask for parts of them alone.
    pub fn is_wide(&self, seen: &Seen) -> bool {
        let finest = self.side.grids.first().map_or(0, |grid| grid.coarseness);
        let [columns, rows] = [0, 1].map(|i| (seen.cells[i].end - seen.cells[i].start) >> finest);
        (columns + 1) * (rows + 1) > MOST_CELLS
    }

    /// Calls `say` for all cells with objects that may be before these points, until it returns false.
    pub fn each_cell(&self, seen: &Seen, mut say: impl FnMut(&Cell<'_>) -> bool) {
        let side = self.light * SIDES.len() + self.side.number;
        for Grid { kind, coarseness, starts, objects } in &self.side.grids {
            let across = FINEST >> coarseness;
            let [columns, rows] =
                [0, 1].map(|i| &seen.cells[i]).map(|of| of.start >> coarseness..=(of.end - 1) >> coarseness);
            for row in rows {
                for cell in row * across + columns.start()..=row * across + columns.end() {
                    let cell = cell as usize;
                    let all = &objects[starts[cell] as usize..starts[cell + 1] as usize];
                    let near = all.iter().position(|object| object.depth > seen.depth).unwrap_or(all.len());
                    if near > 0 {
                        let grid = (side * 2 + *kind as usize) << 4 | *coarseness as usize;
                        let key = (grid as u64) << (2 * FINEST.ilog2()) | cell as u64;
                        if !say(&Cell { kind: *kind, key, objects: &all[..near] }) {
                            return;
                        }
                    }
                }
            }
        }
    }

    /// The bounds of an object, as kernels compare them with [`Seen::ends`].
    fn ends(&self, bounds: Option<Bounds>) -> [f32; 4] {
        let [low, high] = self.side.cells.ends(&bounds.unwrap_or(WHOLE));
        [low[0], low[1], -high[0], -high[1]]
    }

    /// A triangle as the light sees it, and its bounds; None if it sees its edge alone.
    pub fn triangle(&self, id: u32) -> Option<(TriangleCaster<f64>, [f32; 4])> {
        let triangle = self.scene.triangle(id as usize);
        let corners = triangle.vertices.map(|v| v.as_dvec3());
        let n = geometry::triangle_plane(corners);
        let side = geometry::side_of_plane(corners, n, self.position, 0.0)?.signum();
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
            own: (self.scene.spheres.len() + id as usize) as f64,
        };
        Some((caster, self.ends(Bounds::of_triangle(&triangle, self.position, self.side.number))))
    }

    /// A sphere as the light sees it, and its bounds.
    pub fn sphere(&self, id: u32) -> (SphereCaster<f64>, [f32; 4]) {
        let sphere = &self.scene.spheres[id as usize];
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
            own: id.into(),
        };
        (caster, self.ends(Bounds::of_sphere(sphere, self.position, self.side.number)))
    }
}
