//! What each light sees: the objects that may hide it from a point, in the cells of the six sides
//! of a cube around it.
//!
//! A light is treated like a camera. The segments from all visible points to a light meet in the
//! light, as the camera's rays meet in the camera, so that here too objects can be found by their
//! bounds. Around the light is a cube, each side of which is a picture that is divided into cells.
//! An object is entered in few cells, and a point is tested only against the objects in the cells
//! that its tile meets.
//!
//! The size of the cells affects the time that this takes, but no pixel. Each side has a pyramid of
//! grids. An object is entered once: in the grid whose cells are about as large as the object, and
//! in the cell in which it begins. It therefore extends at most into the next cell across and down.

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

/// The least size of cells in pixels: finer cells would be smaller than what a group of pixels
/// sees.
const PIXELS_OF_A_CELL: u32 = 4;

/// How many cells a grid may have per object. If a grid would have more, its objects are entered in
/// a coarser grid.
const CELLS_OF_AN_OBJECT: usize = 4;

/// The objects of a cell are sorted by depth if there are more than this.
const FEW: u32 = 8;

/// A bound on the rounding error of a coordinate on a side, which is from -1 to 1: three or four
/// roundings each for an object's bounds and for a point.
const SLACK: f64 = 8.0 * f64::EPSILON;

/// A bound on the rounding error of |P - c|^2 - r^2, in units of r times the sum of the magnitudes
/// of P's coordinates. It includes the rounding of P itself and of its products.
const SPHERE_ROUNDING: f64 = 32.0 * f64::EPSILON;

/// A bound on the rounding error of a plane's value at a point, in units of the sum of the
/// magnitudes of its terms.
const PLANE_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// If |P - c|^2 - r^2 is this many times as large as that of the light, the point P is much farther
/// from the sphere than the light is.
const FAR_POWER: f64 = 1_048_576.0;

/// This many triangles that follow each other in the scene are entered as one object, if they are
/// also near each other.
const RUN: usize = 16;

/// Objects that follow each other in the scene and are entered as one object.
struct Run {
    /// The least and the greatest coordinates of the objects.
    ends: [DVec3; 2],
    /// The index of the first object in the scene; `count` is the number of objects.
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
    /// The sides of the cube that have objects.
    sides: Vec<CubeSide>,
}

/// A side of the cube, with its objects.
#[derive(Clone, Default)]
struct CubeSide {
    /// The index in [`SIDES`].
    number: usize,
    view: LightSideView<f64>,
    /// The objects of the first cell of the first grid, then those of the next cell, and so on. A
    /// cell with more than [`FEW`] objects has them sorted from the nearest to the farthest.
    objects: Vec<Extent>,
    /// For each cell the index in `objects` of its first object; and at the end the number of all
    /// objects.
    starts: Vec<u32>,
    /// The grids that have objects, from the finest to the coarsest.
    grids: Vec<Grid>,
}

/// A grid of cells of one size, row by row.
#[derive(Clone)]
struct Grid {
    /// The binary logarithm of the side of a cell, in cells of the finest grid.
    coarseness: u32,
    /// The index of the grid's first cell among the cells of all grids.
    first: usize,
}

/// A side of a light's cube.
#[derive(Clone, Copy)]
pub struct LightSide<'a> {
    scene: &'a Scene,
    position: DVec3,
    side: &'a CubeSide,
}

/// The bounds of points on a side, in cells: `past_x`, `past_y`, `x`, `y` and `depth` of
/// `LitGroups`. The greatest coordinates are negated, so that all five are minima.
pub type SideBounds = [f32; 5];

/// The bounds of the points of a tile, or of some of them, and the cells that they meet.
pub struct Window {
    ends: SideBounds,
    /// The columns and rows of cells of the finest grid in which the points may be.
    cells: [Range<u32>; 2],
}

impl Window {
    /// A window with the middle cell alone. Its bounds are still those of all points.
    pub fn middle(&self) -> Window {
        let cells = self.cells.clone().map(|cells| {
            let middle = cells.start.midpoint(cells.end - 1);
            middle..middle + 1
        });
        Window { ends: self.ends, cells }
    }

    /// The least and the greatest coordinates of the points, in cells. Points beyond all cells are
    /// not considered, since no object is in front of them.
    pub fn corners(&self) -> [[f32; 2]; 2] {
        let [past_x, past_y, x, y, _] = self.ends;
        [[x, y].map(|x| x.max(0.0)), [-past_x, -past_y].map(|x| x.min(FINEST as f32))]
    }
}

/// The casters of one occlusion query: objects that may hide a light from some points, as the light
/// sees them.
pub struct Casters {
    /// The objects: spheres, or triangles of one of the two kinds.
    pub list: CasterList,
    /// The records by which f64 decides, at the same index as the object in the list. They are only
    /// set for objects that some group of points meets.
    pub spheres: Box<[SphereCaster<f64>]>,
    pub triangles: Box<[TriangleCaster<f64>]>,
    arrays: Box<TriangleArrays>,
}

/// If one end of an edge is this many times as far away as the other, the rounding of the edge's
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

/// The bounds of an object on a side: its coordinates where the depth is 1, and its least depth.
#[derive(Clone, Copy)]
struct Bounds {
    low: [f64; 2],
    high: [f64; 2],
    depth: f64,
}

/// The bounds of an object that is beside the light or contains it.
const WHOLE: Bounds = Bounds { low: [-1.0; 2], high: [1.0; 2], depth: 0.0 };

/// A vector in the axes of a side: across, down and depth.
#[inline(always)]
fn turned(v: DVec3, side: usize) -> [f64; 3] {
    let (axis, sign) = SIDES[side];
    let v = v.to_array();
    [v[(axis + 1) % 3], v[(axis + 2) % 3], sign * v[axis]]
}

impl Bounds {
    /// The bounds of a box that is given by its least and its greatest coordinates relative to the
    /// light. None if the light does not see the box through this side.
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

    /// The bounds, widened by [`SLACK`] and clipped to the side; None if nothing is left.
    fn clipped(self) -> Option<Bounds> {
        let (low, high) = (self.low.map(|x| (x - SLACK).max(-1.0)), self.high.map(|x| (x + SLACK).min(1.0)));
        (low[0] <= high[0] && low[1] <= high[1]).then_some(Bounds { low, high, ..self })
    }
}

/// The bounds of an object in cells, in f32. Points are rounded to f32 by the same operations,
/// which preserve order, so that a point within the bounds stays within them.
fn extent(view: &LightSideView<f64>, of: &Bounds, Run { first, count, .. }: &Run) -> Extent {
    let at = |[x, y]: [f64; 2]| [((x - view.low_x) * view.scale_x) as f32, ((y - view.low_y) * view.scale_y) as f32];
    // Rounded so that it is not above the exact depth.
    let depth = (of.depth * (1.0 - f64::from(f32::EPSILON))) as f32;
    Extent { low: at(of.low), high: at(of.high), depth, first: *first, count: *count }
}

/// The column or row of the finest cell that contains a coordinate.
fn cell(x: f32) -> u32 {
    (x as u32).min(FINEST - 1)
}

impl CubeSide {
    /// Enters runs on one side of a light. `whole` are the bounds of all runs there; the picture's
    /// longer side has `pixels` pixels.
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
            unsorted.push((extent, CellPlace::of(&extent)));
        }
        let useful = (pixels / PIXELS_OF_A_CELL).next_power_of_two().min(FINEST);
        let (grids, starts, objects) = Grid::of(&unsorted, (FINEST / useful).ilog2());
        CubeSide { number, view, objects, starts, grids }
    }
}

/// Where an object is entered: the column and the row in the finest grid at which it begins, and
/// the binary logarithm of the side of cells of which it meets at most two across and two down.
#[derive(Clone, Copy)]
struct CellPlace {
    column: u16,
    row: u16,
    level: u8,
}

impl CellPlace {
    fn of(Extent { low, high, .. }: &Extent) -> CellPlace {
        let [[column, last_column], [row, last_row]] = [0, 1].map(|i| [low[i], high[i]].map(cell));
        let most = (last_column - column).max(last_row - row);
        CellPlace { column: column as u16, row: row as u16, level: most.next_power_of_two().ilog2() as u8 }
    }
}

impl Grid {
    /// Makes the grids for some objects, none finer than `finest`. Returns them with the `starts`
    /// and the `objects` for [`CubeSide`].
    fn of(unsorted: &[(Extent, CellPlace)], finest: u32) -> (Vec<Grid>, Vec<u32>, Vec<Extent>) {
        const LEVELS: usize = 1 + FINEST.ilog2() as usize;
        let mut counts = [0; LEVELS];
        unsorted.iter().for_each(|(_, place)| counts[usize::from(place.level).max(finest as usize)] += 1);
        // For each level `of_level` has the index of its grid.
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
        let cell = |place: &CellPlace| {
            grids[of_level[usize::from(place.level)]].cell(u32::from(place.column), u32::from(place.row))
        };
        // A counting sort. At first `starts[cell + 2]` is the number of objects in a cell; after
        // the prefix sums `starts[cell + 1]` is where its next object goes; and at the end it is
        // where its last object ends.
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

    /// The index of the cell that contains this column and row of the finest grid.
    fn cell(&self, column: u32, row: u32) -> usize {
        let Grid { coarseness, first } = self;
        first + ((row >> coarseness) * (FINEST >> coarseness) + (column >> coarseness)) as usize
    }
}

/// Divides the objects of a scene into runs.
fn runs(scene: &Scene) -> Vec<Run> {
    let sphere = |(sphere, first): (&Sphere, u32)| {
        let centre = sphere.centre.as_dvec3();
        // The radius of a distant sphere may be less than the rounding of these sums, so that their
        // error is added.
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

/// Both lists of triangles, each with the index of its first triangle in the scene, where spheres
/// come first.
fn lists(scene: &Scene) -> [(TriangleList<'_>, u32); 2] {
    let (first, count) = (scene.spheres.len() as u32, scene.triangles.len() as u32);
    [(TriangleList::Apart(&scene.triangles), first), (TriangleList::Joined((&scene.faces).into()), first + count)]
}

/// The corners of the triangle at this index in the scene.
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
        let view = |position| LightView { position, sides: vec![CubeSide::default(); SIDES.len()] };
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
            *side = CubeSide::of(&runs, light, (number, &whole), pixels);
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

    /// The sides of its cube through which a light sees objects.
    pub fn sides(&self, light: usize) -> impl ExactSizeIterator<Item = LightSide<'_>> {
        let LightView { position, sides } = &self.lights[light];
        sides.iter().map(move |side| LightSide { scene: self.scene, position: *position, side })
    }

    /// The record by which the visible points of an object are computed; `place` is the object's
    /// index in the scene, where spheres come first. None if no light reaches its visible points:
    /// for a sphere that contains the camera, or a triangle that no ray hits.
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
    /// The view that the kernels which find points and triangles on this side take.
    pub fn view(&self) -> &LightSideView<f64> {
        &self.side.view
    }

    /// The axis that the side is perpendicular to.
    pub fn axis(&self) -> usize {
        SIDES[self.side.number].0
    }

    /// Whether the light may see points with these least and greatest coordinates through this
    /// side.
    pub fn may_see(&self, [low, high]: [DVec3; 2]) -> bool {
        let rounding = DVec3::splat(SLACK * (low.abs().max(high.abs()) + self.position.abs()).max_element());
        Bounds::of_box([low - rounding, high + rounding].map(|v| v - self.position), self.side.number).is_some()
    }

    /// Where the light is.
    pub fn light(&self) -> [f64; 3] {
        self.position.to_array()
    }

    /// The window of points with these bounds. None if no point is where this side has objects.
    pub fn window(&self, ends: SideBounds) -> Option<Window> {
        let ([past_x, past_y, x, y, _], end) = (ends, FINEST as f32);
        (x <= end && y <= end && past_x <= 0.0 && past_y <= 0.0)
            .then(|| Window { ends, cells: [cell(x)..cell(-past_x) + 1, cell(y)..cell(-past_y) + 1] })
    }

    /// The number of objects in the cells of a window.
    pub fn crowd(&self, window: &Window) -> usize {
        self.rows(window).map(|starts| (starts[starts.len() - 1] - starts[0]) as usize).sum()
    }

    /// For each row of cells, in each grid, that a window meets: the indices at which the objects
    /// of its cells begin, and the end of the last.
    fn rows(&self, Window { cells, .. }: &Window) -> impl Iterator<Item = &'a [u32]> {
        self.side.grids.iter().flat_map(move |grid| {
            // An object that begins in the cell before may extend into the window.
            let side = 1 << grid.coarseness;
            let [columns, rows] = [0, 1].map(|i| cells[i].start.saturating_sub(side)..cells[i].end);
            let rows = (rows.start >> grid.coarseness << grid.coarseness..rows.end).step_by(side as usize);
            rows.map(move |row| &self.side.starts[grid.cell(columns.start, row)..grid.cell(columns.end - 1, row) + 2])
        })
    }

    /// Adds the objects in the cells of a window that may be in front of its points to the list of
    /// their kind: spheres, or one of the two kinds of triangles.
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

    /// Makes casters of the first of these objects, all of the same kind, as many as there is room
    /// for. Returns the remaining objects.
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

    /// Makes the records by which f64 decides, for the casters that some group of points meets.
    pub fn make_met(&self, Casters { list, spheres, triangles, .. }: &mut Casters) {
        for MetCaster { number, place } in list.each_met() {
            match self.scene.spheres.get(place as usize) {
                Some(sphere) => spheres[number] = self.sphere(sphere, place),
                None => triangles[number] = self.triangle(place),
            }
        }
    }

    /// The record of the triangle at this index in the scene, as the light sees it.
    fn triangle(&self, place: u32) -> TriangleCaster<f64> {
        let corners = corners(self.scene, place);
        let (normal, light) = (geometry::triangle_plane(corners), self.position);
        let Some(side) = geometry::side_of_plane(corners, normal, light, 0.0) else {
            // The light is in the triangle's plane, so that the triangle hides nothing from it.
            return TriangleCaster { e10: -1.0, ..TriangleCaster::ZERO };
        };
        let distances = [light, DVec3::ZERO].map(|from| corners.map(|v| (v - from).abs().max_element()));
        let nearer = |i: usize, j: usize, from: usize| if distances[from][j] < distances[from][i] { j } else { i };
        // The plane through the light and both ends of an edge depends on the edge alone, so that
        // two triangles that share the edge have the same plane, up to its sign.
        let edge = |i: usize, j: usize| {
            let (v, w) = (corners[i], corners[j]);
            let is_near = |of: [f64; 3]| of[i].max(of[j]) > of[i].min(of[j]) * FAR_BESIDE_NEAR;
            let (mut seen, mut known) = (0.5 * (v + w), 0.5 * (v + w));
            if distances.into_iter().any(is_near) {
                // The rounding of the edge's middle would matter here: the plane is taken through
                // an end instead.
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

    /// The record of a sphere, at this index in the scene, as the light sees it.
    fn sphere(&self, sphere: &Sphere, place: u32) -> SphereCaster<f64> {
        let (c, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let l = c - self.position;
        let (r2, of_light) = (radius * radius, geometry::power(l, radius));
        let is_outside = of_light > 0.0;
        // Points near a large sphere would be lost in the rounding of |P - c|^2 - r^2. For such a
        // sphere it is computed as P . (P - 2 c) + (|c|^2 - r^2), the latter from exact squares.
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
