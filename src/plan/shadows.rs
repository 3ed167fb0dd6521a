//! What each light sees: the objects that may hide it, in the cells of six pictures around it.
//!
//! A light is a camera. The segments from all visible points to a light meet in it, as the camera's
//! rays meet in the camera, so that objects can be found by their bounds here too: around the light
//! is a cube, each side of which is a picture, divided into cells. An object is entered in few
//! cells, and a point is tested only against the objects in the cells of its tile.
//!
//! How fine the cells are decides how long that takes, and no pixel. Each side has a pyramid of
//! grids. An object is entered once, in the grid whose cells are about as large as it is and in the
//! cell in which it begins; so it reaches at most into the next cells across and down.

use std::ops::Range;

use glam::{DVec3, Vec3A};

use super::team::Team;
use super::{PlanOptions, light};
use crate::kernels::{
    Cast, CasterList, Extent, LightSideView, MOST_CASTERS, MetCaster, ObjectList as _, Plain as _, PointObject,
    SphereCaster, TriangleArrays, TriangleCaster, TriangleList, own_number,
};
use crate::reference::geometry;
use crate::scene::{Scene, Sphere};

/// The sides of a cube around a light: the axis of each, and its sign.
const SIDES: [(usize, f64); 6] = [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)];

/// The number of cells across a side, and down, of the finest grid.
const FINEST: u32 = 4096;

/// Finer cells than this many pixels are not made: they would be smaller than what a group of
/// pixels sees.
const PIXELS_OF_A_CELL: u32 = 4;

/// A grid has at most this many cells for each of its objects. If a size of cells would have more,
/// its objects are entered in a coarser grid.
const CELLS_OF_AN_OBJECT: usize = 4;

/// The objects of a cell are sorted by depth if they are more than this.
const FEW: u32 = 8;

/// A bound of the rounding error of a coordinate on a side, which is from -1 to 1: three or four
/// roundings each of an object's bounds and of a point.
const SLACK: f64 = 8.0 * f64::EPSILON;

/// A bound of the rounding error of |P - c|^2 - r^2 in units of r times the sum of P's coordinates:
/// of P itself, and of its products.
const SPHERE_ROUNDING: f64 = 32.0 * f64::EPSILON;

/// A bound of the rounding error of a plane at a point, in units of the sum of the terms'
/// magnitudes.
const PLANE_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// If |P - c|^2 - r^2 is so many times as large as the same of the light, P is much farther from
/// the sphere than the light is.
const FAR_POWER: f64 = 1_048_576.0;

/// So many triangles that follow each other in the scene are entered as one object, if they are
/// also near each other.
const RUN: usize = 16;

/// Objects that follow each other in the scene, and are entered as one.
struct Run {
    /// The least and the greatest coordinates.
    ends: [DVec3; 2],
    /// The index of the first one in the scene, and how many they are.
    first: u32,
    count: u32,
}

/// The shadows of a scene.
pub struct Shadows<'a> {
    scene: &'a Scene,
    /// The lights that are not dark.
    lights: Vec<LightView>,
}

/// What one light sees.
struct LightView {
    position: DVec3,
    /// The sides with objects.
    sides: Vec<Side>,
}

/// The objects on a side of the cube.
#[derive(Clone, Default)]
struct Side {
    /// The index in [`SIDES`].
    number: usize,
    view: LightSideView<f64>,
    /// The objects of the first cell of the first grid, then those of the next cell, and so on.
    /// Within a cell of more than [`FEW`], from the nearest on.
    objects: Vec<Extent>,
    /// For each cell the index in `objects` of its first one; and last, their number.
    starts: Vec<u32>,
    /// The grids that have objects, from the finest on.
    grids: Vec<Grid>,
}

/// The cells of one size, row by row.
#[derive(Clone)]
struct Grid {
    /// The binary logarithm of the side of a cell, in cells of the finest grid.
    coarseness: u32,
    /// The index of the first cell among those of all grids.
    first: usize,
}

/// A side of a light's cube.
#[derive(Clone, Copy)]
pub struct LightSide<'a> {
    scene: &'a Scene,
    position: DVec3,
    side: &'a Side,
}

/// The bounds of points on a side, in cells: `past_x`, `past_y`, `x`, `y` and `depth` of
/// `LitGroups`, where greatest values are negated, so that all are least values.
pub type Ends = [f32; 5];

/// The points of a tile or of a part of it, by their bounds.
pub struct Window {
    ends: Ends,
    /// The columns and rows of the cells of the finest grid that they may be in.
    cells: [Range<u32>; 2],
}

impl Window {
    /// The middle cell of the window alone; the bounds stay those of all points.
    pub fn middle(&self) -> Window {
        let cells = self.cells.clone().map(|cells| {
            let middle = cells.start.midpoint(cells.end - 1);
            middle..middle + 1
        });
        Window { ends: self.ends, cells }
    }

    /// The least and the greatest coordinates of its points, in cells. Points beyond all cells have
    /// no objects in front of them, and do not count.
    pub fn corners(&self) -> [[f32; 2]; 2] {
        let [past_x, past_y, x, y, _] = self.ends;
        [[x, y].map(|x| x.max(0.0)), [-past_x, -past_y].map(|x| x.min(FINEST as f32))]
    }
}

/// The casters of one query: objects that may hide a light from some points, as it sees them.
pub struct Casters {
    /// Spheres, or triangles of one of the two kinds.
    pub list: CasterList,
    /// The records for the decision in f64, at the index that an object has in the list. Set only
    /// for objects that some group of points meets.
    pub spheres: Box<[SphereCaster<f64>]>,
    pub triangles: Box<[TriangleCaster<f64>]>,
    arrays: Box<TriangleArrays>,
}

/// If one end of an edge is so many times as far away as the other, the rounding of the edge's
/// middle matters near the nearer end.
const FAR_BESIDE_NEAR: f64 = 1024.0;

impl Default for Casters {
    fn default() -> Self {
        Casters {
            list: CasterList::default(),
            spheres: vec![SphereCaster::ZERO; MOST_CASTERS].into(),
            triangles: vec![TriangleCaster::ZERO; MOST_CASTERS].into(),
            arrays: Box::new(TriangleArrays::ZERO),
        }
    }
}

/// The bounds of an object on a side: its coordinates at depth 1, and its least depth.
#[derive(Clone, Copy)]
struct Bounds {
    low: [f64; 2],
    high: [f64; 2],
    depth: f64,
}

/// The bounds of an object that is beside the light or around it.
const WHOLE: Bounds = Bounds { low: [-1.0; 2], high: [1.0; 2], depth: 0.0 };

/// A vector in the axes of a side: across, down, and depth.
#[inline(always)]
fn turned(v: DVec3, side: usize) -> [f64; 3] {
    let (axis, sign) = SIDES[side];
    let v = v.to_array();
    [v[(axis + 1) % 3], v[(axis + 2) % 3], sign * v[axis]]
}

impl Bounds {
    /// The bounds of a box, given by its least and its greatest coordinates with the light at 0.
    /// None if the box is not on this side.
    #[inline(always)]
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

    /// Widened by [`SLACK`], and cut to the side; None if nothing is left.
    fn clipped(self) -> Option<Bounds> {
        let (low, high) = (self.low.map(|x| (x - SLACK).max(-1.0)), self.high.map(|x| (x + SLACK).min(1.0)));
        (low[0] <= high[0] && low[1] <= high[1]).then_some(Bounds { low, high, ..self })
    }
}

/// The bounds of an object in cells, in f32. Points are rounded to f32 by the same operations,
/// which keep the order of numbers: a point within the bounds stays within.
fn extent(view: &LightSideView<f64>, of: &Bounds, Run { first, count, .. }: &Run) -> Extent {
    let at = |[x, y]: [f64; 2]| [((x - view.low_x) * view.scale_x) as f32, ((y - view.low_y) * view.scale_y) as f32];
    // The depth is rounded down.
    let depth = (of.depth * (1.0 - f64::from(f32::EPSILON))) as f32;
    Extent { low: at(of.low), high: at(of.high), depth, first: *first, count: *count }
}

/// The finest cell that a coordinate is in.
fn cell(x: f32) -> u32 {
    (x as u32).min(FINEST - 1)
}

impl Side {
    /// Enters runs on one side of a light. All of them together have the bounds `whole` there; the
    /// picture's longer side has so many `pixels`.
    fn of(runs: &[Run], light: DVec3, (number, whole): (usize, &Bounds), pixels: u32) -> Self {
        let (low, high) = (whole.low.map(|x| x - 4.0 * SLACK), whole.high.map(|x| x + 4.0 * SLACK));
        let [scale_x, scale_y] = [0, 1].map(|i| f64::from(FINEST) / (high[i] - low[i]));
        let ((_, sign), [across, down, depth]) = (SIDES[number], turned(light, number));
        let (depth, [low_x, low_y]) = (sign * depth, low);
        let slack = SLACK * scale_x.max(scale_y);
        let view = LightSideView { across, down, depth, sign, low_x, low_y, scale_x, scale_y, slack };
        let mut unsorted = Vec::with_capacity(runs.len());
        for run in runs {
            let Some(of) = Bounds::of_box(run.ends.map(|v| v - light), number) else { continue };
            let extent = extent(&view, &of, run);
            unsorted.push((extent, Place::of(&extent)));
        }
        let useful = (pixels / PIXELS_OF_A_CELL).next_power_of_two().min(FINEST);
        let (grids, starts, objects) = Grid::of(&unsorted, (FINEST / useful).ilog2());
        Side { number, view, objects, starts, grids }
    }
}

/// Where an object is entered: the column and the row in the finest grid at which it begins, and
/// the binary logarithm of the side of cells of which it meets at most two across and two down.
#[derive(Clone, Copy)]
struct Place {
    column: u16,
    row: u16,
    level: u8,
}

impl Place {
    fn of(Extent { low, high, .. }: &Extent) -> Place {
        let [[column, last_column], [row, last_row]] = [0, 1].map(|i| [low[i], high[i]].map(cell));
        let most = (last_column - column).max(last_row - row);
        Place { column: column as u16, row: row as u16, level: most.next_power_of_two().ilog2() as u8 }
    }
}

impl Grid {
    /// Makes the grids for some objects, none finer than `finest`. Returns them with the `starts`
    /// and the `objects` of [`Side`].
    fn of(unsorted: &[(Extent, Place)], finest: u32) -> (Vec<Grid>, Vec<u32>, Vec<Extent>) {
        const LEVELS: usize = 1 + FINEST.ilog2() as usize;
        let mut counts = [0; LEVELS];
        unsorted.iter().for_each(|(_, place)| counts[usize::from(place.level).max(finest as usize)] += 1);
        // `of_level` has the index of the grid of each level.
        let (mut grids, mut of_level, mut count, mut cells) = (Vec::new(), [0; LEVELS], 0, 0);
        for level in 0..LEVELS {
            of_level[level] = grids.len();
            count += counts[level];
            let of_grid = (FINEST as usize >> level).pow(2);
            if count > 0 && of_grid <= CELLS_OF_AN_OBJECT * count {
                grids.push(Grid { coarseness: level as u32, first: cells });
                (count, cells) = (0, cells + of_grid);
            }
        }
        let cell = |place: &Place| {
            grids[of_level[usize::from(place.level)]].cell(u32::from(place.column), u32::from(place.row))
        };
        // A counting sort. First `starts[cell + 2]` is the number of objects of a cell; after the
        // sums, `starts[cell + 1]` is where its next object goes; and in the end, where its last
        // one ends.
        let mut starts = vec![0; cells + 2];
        unsorted.iter().for_each(|(_, place)| starts[cell(place) + 2] += 1);
        let mut crowded = Vec::new();
        for i in 2..starts.len() {
            if starts[i] > FEW {
                crowded.push(i - 2);
            }
            starts[i] += starts[i - 1];
        }
        let mut objects = vec![Extent::default(); unsorted.len()];
        for (of, place) in unsorted {
            let next = &mut starts[cell(place) + 1];
            objects[*next as usize] = *of;
            *next += 1;
        }
        for cell in crowded {
            let of_cell = &mut objects[starts[cell] as usize..starts[cell + 1] as usize];
            of_cell.sort_unstable_by(|a, b| a.depth.total_cmp(&b.depth));
        }
        (grids, starts, objects)
    }

    /// The index of the cell that holds this column and row of the finest grid.
    fn cell(&self, column: u32, row: u32) -> usize {
        let Grid { coarseness, first } = self;
        first + ((row >> coarseness) * (FINEST >> coarseness) + (column >> coarseness)) as usize
    }
}

/// The objects of a scene in runs.
fn runs(scene: &Scene) -> Vec<Run> {
    let sphere = |(sphere, first): (&Sphere, u32)| {
        let centre = sphere.centre.as_dvec3();
        // The radius of a far sphere may be less than the rounding of these sums.
        let radius = DVec3::splat(sphere.radius.into()) + f64::EPSILON * centre.abs();
        Run { ends: [centre - radius, centre + radius], first, count: 1 }
    };
    let mut runs: Vec<_> = scene.spheres.iter().zip(0..).map(sphere).collect();
    for (triangles, first) in lists(scene) {
        let run = |of: Range<usize>| {
            let (mut low, mut high, mut sizes) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY, 0.0);
            for at in of.clone() {
                let [a, b, c] = triangles.vertices(at).map(Vec3A::from);
                let (least, most) = (a.min(b).min(c), a.max(b).max(c));
                (low, high) = (low.min(least), high.max(most));
                sizes += (most - least).element_sum();
            }
            let ends = [low.as_dvec3(), high.as_dvec3()];
            let are_near = (high - low).element_sum() <= sizes;
            (Run { ends, first: first + of.start as u32, count: of.len() as u32 }, are_near)
        };
        for start in (0..triangles.len()).step_by(RUN) {
            let of = start..triangles.len().min(start + RUN);
            match run(of.clone()) {
                (run, true) => runs.push(run),
                (_, false) => runs.extend(of.map(|at| run(at..at + 1).0)),
            }
        }
    }
    runs
}

/// Both lists of triangles, and the index in the scene, where spheres come first, of the first
/// triangle of each.
fn lists(scene: &Scene) -> [(TriangleList<'_>, u32); 2] {
    let (first, count) = (scene.spheres.len() as u32, scene.triangles.len() as u32);
    [(TriangleList::Apart(&scene.triangles), first), (TriangleList::Joined((&scene.faces).into()), first + count)]
}

/// The corners of a triangle at this place in the scene.
fn corners(scene: &Scene, place: u32) -> [DVec3; 3] {
    let [apart, joined] = lists(scene);
    let (list, first) = if place < joined.1 { apart } else { joined };
    list.vertices((place - first) as usize).map(|v| v.as_dvec3())
}

impl<'a> Shadows<'a> {
    /// Plans the shadows of all lights that are not dark.
    pub fn new(scene: &'a Scene, options: PlanOptions<'_>) -> Self {
        let (runs, pixels) = (runs(scene), scene.camera.width().max(scene.camera.height()));
        let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let all = runs.iter().fold(none, |[low, high], run| [low.min(run.ends[0]), high.max(run.ends[1])]);
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
        let team = Team::up_to(options.threads);
        team.share(tasks.collect::<Vec<_>>().into_iter(), |(light, (number, whole), side)| {
            if options.is_cancelled() {
                return;
            }
            *side = Side::of(&runs, light, (number, &whole), pixels);
        });
        let is_alone = scene.spheres.len() + scene.triangle_count() == 1;
        shadows.lights.iter_mut().for_each(|light| light.sides.retain(|side| !is_alone && !side.grids.is_empty()));
        shadows
    }

    /// The number of objects that may hide a light.
    pub fn objects(&self, light: usize) -> u64 {
        if self.lights[light].sides.is_empty() {
            0
        } else {
            (self.scene.spheres.len() + self.scene.triangle_count()) as u64
        }
    }

    /// The number of lights that no object can hide.
    pub fn unhidden(&self) -> u64 {
        self.lights.iter().filter(|light| light.sides.is_empty()).count() as u64
    }

    /// The positions of the lights.
    pub fn lights(&self) -> impl ExactSizeIterator<Item = DVec3> {
        self.lights.iter().map(|light| light.position)
    }

    /// The sides on which a light sees objects.
    pub fn sides(&self, light: usize) -> impl ExactSizeIterator<Item = LightSide<'_>> {
        let LightView { position, sides } = &self.lights[light];
        sides.iter().map(move |side| LightSide { scene: self.scene, position: *position, side })
    }

    /// The record by which the visible points of an object are found; `place` is its index in the
    /// scene, spheres first. None if no light reaches what is visible of it: a sphere around the
    /// camera, or a triangle that no ray hits.
    pub fn object(&self, place: usize) -> Option<PointObject<f64>> {
        let own = own_number(place as u32);
        let of = |DVec3 { x, y, z }: DVec3| PointObject { x, y, z, own, w: 1.0, ..PointObject::default() };
        let Some(sphere) = self.scene.spheres.get(place) else {
            return geometry::plane_of_one(corners(self.scene, place as u32)).map(|plane| of(plane.p));
        };
        let (c, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let (r2, k) = (radius * radius, geometry::power(c, radius));
        let is_near = c.dot(c) < 2.0 * r2;
        let [a, b, e] = if is_near { [-k, 1.0, 0.0] } else { [r2, 0.0, 1.0] };
        (k > 0.0).then(|| PointObject { a, b, e, w: 1.0 / k, ..of(c) })
    }
}

impl<'a> LightSide<'a> {
    /// The view of the kernels that find points and triangles on this side.
    pub fn view(&self) -> &LightSideView<f64> {
        &self.side.view
    }

    /// The axis that it looks along.
    pub fn axis(&self) -> usize {
        SIDES[self.side.number].0
    }

    /// Whether points with these least and greatest coordinates may be on it.
    pub fn may_see(&self, [low, high]: [DVec3; 2]) -> bool {
        let rounding = DVec3::splat(SLACK * (low.abs().max(high.abs()) + self.position.abs()).max_element());
        Bounds::of_box([low - rounding, high + rounding].map(|v| v - self.position), self.side.number).is_some()
    }

    /// Where the light is.
    pub fn light(&self) -> [f64; 3] {
        self.position.to_array()
    }

    /// The window of points with these bounds; None if none of them is on this side where objects
    /// are.
    pub fn window(&self, ends: Ends) -> Option<Window> {
        let ([past_x, past_y, x, y, _], end) = (ends, FINEST as f32);
        (x <= end && y <= end && past_x <= 0.0 && past_y <= 0.0)
            .then(|| Window { ends, cells: [cell(x)..cell(-past_x) + 1, cell(y)..cell(-past_y) + 1] })
    }

    /// The number of objects in the cells of a window.
    pub fn crowd(&self, window: &Window) -> usize {
        self.rows(window).map(|starts| (starts[starts.len() - 1] - starts[0]) as usize).sum()
    }

    /// For each row of cells of each grid that a window meets, the indices at which its cells'
    /// objects begin, and the end of the last.
    fn rows(&self, Window { cells, .. }: &Window) -> impl Iterator<Item = &'a [u32]> {
        self.side.grids.iter().flat_map(move |grid| {
            // An object that begins one cell before may reach into the window.
            let side = 1 << grid.coarseness;
            let [columns, rows] = [0, 1].map(|i| cells[i].start.saturating_sub(side)..cells[i].end);
            let rows = (rows.start >> grid.coarseness << grid.coarseness..rows.end).step_by(side as usize);
            rows.map(move |row| &self.side.starts[grid.cell(columns.start, row)..grid.cell(columns.end - 1, row) + 2])
        })
    }

    /// Adds the objects in the cells of a window that may be in front of its points, to the list of
    /// their kind: spheres, and both kinds of triangles.
    pub fn gather(&self, window: &Window, all: &mut [Vec<&'a Extent>; 3]) {
        let [past_x, past_y, x, y, depth] = window.ends;
        let meets = |of: &&Extent| {
            let is_before = of.low[0] <= -past_x && of.low[1] <= -past_y && of.depth <= -depth;
            is_before && of.high[0] >= x && of.high[1] >= y
        };
        let [of_triangles, of_faces] = lists(self.scene).map(|(_, first)| first);
        for starts in self.rows(window) {
            for ends in starts.windows(2) {
                let placed = &self.side.objects[ends[0] as usize..ends[1] as usize];
                let may_be_before = |of: &&Extent| placed.len() <= FEW as usize || of.depth <= -depth;
                for of in placed.iter().take_while(may_be_before).filter(meets) {
                    all[usize::from(of.first >= of_triangles) + usize::from(of.first >= of_faces)].push(of);
                }
            }
        }
    }

    /// Makes casters of the first of these objects, all of one kind, as many as there is room for.
    /// Returns the others.
    pub fn cast<'b>(
        &self,
        (kind, objects): (usize, &'b [&'a Extent]),
        kernel: &Cast,
        Casters { list, arrays, .. }: &mut Casters,
    ) -> &'b [&'a Extent] {
        let mut room = MOST_CASTERS as u32;
        let mut fits = |object: &&Extent| {
            let fits = object.count <= room;
            room = room.saturating_sub(object.count);
            fits
        };
        let (now, later) = objects.split_at(objects.iter().position(|object| !fits(object)).unwrap_or(objects.len()));
        list.clear();
        now.iter().for_each(|object| list.push(object));
        if let Some(of_triangles) = kind.checked_sub(1) {
            let (triangles, first) = lists(self.scene)[of_triangles];
            kernel.call(self.view(), self.axis(), triangles, first, arrays, list);
        }
        later
    }

    /// Makes the records for the decision in f64, of those casters that some group of points meets.
    pub fn make_met(&self, Casters { list, spheres, triangles, .. }: &mut Casters) {
        for MetCaster { number, place } in list.each_met() {
            match self.scene.spheres.get(place as usize) {
                Some(sphere) => spheres[number] = self.sphere(sphere, place),
                None => triangles[number] = self.triangle(place),
            }
        }
    }

    /// A triangle as the light sees it, at this place in the scene.
    fn triangle(&self, place: u32) -> TriangleCaster<f64> {
        let corners = corners(self.scene, place);
        let (normal, light) = (geometry::triangle_plane(corners), self.position);
        let Some(side) = geometry::side_of_plane(corners, normal, light, 0.0) else {
            // The light sees it as an edge: it hides nothing.
            return TriangleCaster { e10: -1.0, ..TriangleCaster::ZERO };
        };
        let distances = [light, DVec3::ZERO].map(|from| corners.map(|v| (v - from).abs().max_element()));
        let nearer = |i: usize, j: usize, from: usize| if distances[from][j] < distances[from][i] { j } else { i };
        // An edge's plane, through the light and both ends, depends on the edge alone, so that two
        // triangles that share an edge have the same one up to its sign.
        let edge = |i: usize, j: usize| {
            let (v, w) = (corners[i], corners[j]);
            let is_near = |of: [f64; 3]| of[i].max(of[j]) > of[i].min(of[j]) * FAR_BESIDE_NEAR;
            let (mut seen, mut known) = (0.5 * (v + w), 0.5 * (v + w));
            if distances.into_iter().any(is_near) {
                // The middle's rounding would matter: the plane is taken through the ends instead.
                let nearest = nearer(i, j, 1);
                let is_light = light.abs().max_element() < distances[1][nearest];
                (seen, known) = (corners[nearer(i, j, 0)], if is_light { light } else { corners[nearest] });
            }
            let edge = (seen - light).cross(w - v) * side.signum();
            (edge, -edge.dot(known))
        };
        let [(e1, e10), (e2, e20), (e3, e30)] = [edge(0, 1), edge(1, 2), edge(2, 0)];
        let (p, known) = (-normal * side.signum(), corners[nearer(nearer(0, 1, 1), 2, 1)]);
        let bound = normal.abs().max_element() * PLANE_ROUNDING;
        TriangleCaster {
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
            p0: known.abs().element_sum() * bound - p.dot(known),
            bound,
            own: own_number(place),
        }
    }

    /// A sphere as the light sees it, at this place in the scene.
    fn sphere(&self, sphere: &Sphere, place: u32) -> SphereCaster<f64> {
        let (c, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let l = c - self.position;
        let (r2, of_light) = (radius * radius, geometry::power(l, radius));
        let is_outside = of_light > 0.0;
        // Points near a large sphere are lost in the rounding of |P - c|^2 - r^2. For such a sphere
        // it is P . (P - 2 c), and |c|^2 - r^2 from exact squares.
        let is_large = c.dot(c) < 4.0 * r2;
        let (u, w, k) = if is_large { (DVec3::ZERO, 2.0 * c, geometry::power(c, radius)) } else { (c, c, -r2) };
        SphereCaster {
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
            lx: l.x,
            ly: l.y,
            lz: l.z,
            far: FAR_POWER * of_light.abs(),
            r2,
            side: if is_outside { 1.0 } else { -1.0 },
            past: if is_outside { 0.0 } else { f64::NEG_INFINITY },
            most: if of_light < 0.0 { f64::INFINITY } else { 0.0 },
            bound: SPHERE_ROUNDING * radius,
            own: own_number(place),
        }
    }
}
