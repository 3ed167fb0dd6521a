//! What each light sees: the objects that may hide it, in the cells of six pictures around it.
//!
//! A light is a camera. The rays from all visible points to a light meet in it, so that what bounds and tiles do for the
//! camera's rays they do for these: an object is in few cells of a cube around the light, and a point asks those of its tile's
//! cells. How fine the cells are decides how long that takes, and nothing else. Of a pyramid of grids an object is in that
//! whose cells are about as large as it, in the one where it begins, and so reaches at most into the next ones.

use std::ops::Range;

use glam::{DVec3, Vec3A};

use super::light;
use super::team::Team;
use crate::kernels::{
    Cast, CasterList, Extent, LightSideView, MOST_CASTERS, ObjectList as _, Plain as _, PointObject, SphereCaster,
    TriangleArrays, TriangleCaster, TriangleList, own_number,
};
use crate::reference::geometry;
use crate::scene::{Scene, Sphere};

/// The sides of a cube around a light: the axis of each, and its sign.
const SIDES: [(usize, f64); 6] = [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)];

/// The finest cells, across a side.
const FINEST: u32 = 4096;

/// Cells are not much smaller than what a group of pixels sees.
const PIXELS_OF_A_CELL: u32 = 4;

/// A grid has at most so many cells for each of its objects; smaller ones are in coarser grids.
const CELLS_OF_AN_OBJECT: usize = 4;

/// More objects of a cell are sorted by depth.
const FEW: u32 = 8;

/// The rounding of a coordinate on a side, which is within 1.
const SLACK: f64 = 8.0 * f64::EPSILON;

/// What P's rounding, and that of products with it, may make of the power of a sphere.
const SPHERE_ROUNDING: f64 = 32.0 * f64::EPSILON;

/// What rounding may make of a plane, for terms whose magnitudes have the sum 1.
const PLANE_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A point whose power for a sphere is so many times that of the light is much farther from the sphere than the light is.
const FAR_POWER: f64 = 1_048_576.0;

/// Triangles next to each other in the scene that are one object of a side, if they are also near each other.
const RUN: usize = 16;

/// Objects that are next to each other in the scene.
struct Run {
    /// The least and the greatest coordinates.
    ends: [DVec3; 2],
    /// The first one's place in the scene, and how many they are.
    first: u32,
    count: u32,
}

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
    /// In [`SIDES`].
    number: usize,
    view: LightSideView<f64>,
    /// Grid by grid and cell by cell; those of a cell, if they are more than [`FEW`], from the nearest on.
    objects: Vec<Extent>,
    /// Where the objects of each cell begin, and the end of the last.
    starts: Vec<u32>,
    /// The grids that have objects, from the finest on.
    grids: Vec<Grid>,
}

/// The cells of one size with objects, row by row.
#[derive(Clone)]
struct Grid {
    /// The binary logarithm of a cell's side in the finest ones.
    coarseness: u32,
    /// The first cell's number among those of all grids.
    first: usize,
}

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
pub struct Casters {
    /// Spheres, or triangles of one kind.
    pub list: CasterList,
    pub spheres: Vec<SphereCaster<f64>>,
    pub triangles: Vec<TriangleCaster<f64>>,
    arrays: Box<TriangleArrays>,
}

/// The greatest distance of an edge's ends beside the least one, from which the rounding of its middle matters near the latter.
const FAR_BESIDE_NEAR: f64 = 1024.0;

impl Default for Casters {
    fn default() -> Self {
        let (list, spheres, triangles) = Default::default();
        Casters { list, spheres, triangles, arrays: Box::new(TriangleArrays::ZERO) }
    }
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
#[inline(always)]
fn turned(v: DVec3, side: usize) -> [f64; 3] {
    let (axis, sign) = SIDES[side];
    let v = v.to_array();
    [v[(axis + 1) % 3], v[(axis + 2) % 3], sign * v[axis]]
}

impl Bounds {
    /// Those of a box, from its least coordinates to its greatest, with the light at 0; None if it is not on this side.
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

    /// Within the side, and wider by what rounding may move.
    fn clipped(self) -> Option<Bounds> {
        let (low, high) = (self.low.map(|x| (x - SLACK).max(-1.0)), self.high.map(|x| (x + SLACK).min(1.0)));
        (low[0] <= high[0] && low[1] <= high[1]).then_some(Bounds { low, high, ..self })
    }
}

/// The bounds of an object in cells. Rounding keeps the order of all numbers on a side: those of points are as well.
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
    /// Of runs whose bounds are `whole`; the picture's longer side has so many `pixels`.
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

/// Where an object is: the first of the finest columns and rows; and the binary logarithm of the side of cells of which it is in
/// at most two across and two down.
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
    /// Those of objects, from the `finest` coarseness on; and where in these the objects of each cell begin, and the objects.
    fn of(unsorted: &[(Extent, Place)], finest: u32) -> (Vec<Grid>, Vec<u32>, Vec<Extent>) {
        const LEVELS: usize = 1 + FINEST.ilog2() as usize;
        let mut counts = [0; LEVELS];
        unsorted.iter().for_each(|(_, place)| counts[usize::from(place.level).max(finest as usize)] += 1);
        // The grid of each level.
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
        // Of each cell first the number of its objects, two places later; then where the next of them goes, one place later.
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

    /// The cell with one of the finest columns and rows.
    fn cell(&self, column: u32, row: u32) -> usize {
        let Grid { coarseness, first } = self;
        first + ((row >> coarseness) * (FINEST >> coarseness) + (column >> coarseness)) as usize
    }
}

/// The objects of a scene in runs.
fn runs(scene: &Scene) -> Vec<Run> {
    let sphere = |(sphere, first): (&Sphere, u32)| {
        let centre = sphere.centre.as_dvec3();
        // A far one has less than the rounding of its centre.
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

/// The triangles of a scene, as kernels read them, and the place of the first of each list.
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
    /// Those of all lights of a scene that are not dark.
    pub fn new(scene: &'a Scene, team: &Team) -> Self {
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
        team.share(tasks.collect::<Vec<_>>().into_iter(), |(light, (number, whole), side)| {
            *side = Side::of(&runs, light, (number, &whole), pixels);
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
    pub fn lights(&self) -> impl ExactSizeIterator<Item = DVec3> {
        self.lights.iter().map(|light| light.position)
    }

    /// The sides on which a light sees objects.
    pub fn sides(&self, light: usize) -> impl ExactSizeIterator<Item = LightSide<'_>> {
        let LightView { position, sides } = &self.lights[light];
        sides.iter().map(move |side| LightSide { scene: self.scene, position: *position, side })
    }

    /// The object at this place in the scene, spheres first, as its visible points are found; None if no light reaches what is
    /// visible of it: it is around the camera, or has no points.
    pub fn object(&self, place: usize) -> Option<PointObject<f64>> {
        let own = own_number(place as u32);
        let of = |DVec3 { x, y, z }: DVec3| PointObject { x, y, z, own, w: 1.0, ..PointObject::default() };
        let Some(sphere) = self.scene.spheres.get(place) else {
            return geometry::plane_of_one(corners(self.scene, place as u32)).map(|(plane, _)| of(plane));
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

    /// The cells of points with these ends; None if none is on this side, among objects.
    pub fn window(&self, ends: Ends) -> Option<Window> {
        let ([past_x, past_y, x, y, _], end) = (ends, FINEST as f32);
        (x <= end && y <= end && past_x <= 0.0 && past_y <= 0.0)
            .then(|| Window { ends, cells: [cell(x)..cell(-past_x) + 1, cell(y)..cell(-past_y) + 1] })
    }

    /// Adds the objects in its cells that may be before its points, to spheres and to either kind of triangles.
    pub fn gather(&self, Window { ends, cells }: &Window, all: &mut [Vec<&'a Extent>; 3]) {
        let [past_x, past_y, x, y, depth] = *ends;
        let meets = |of: &&Extent| {
            let is_before = of.low[0] <= -past_x && of.low[1] <= -past_y && of.depth <= -depth;
            is_before && of.high[0] >= x && of.high[1] >= y
        };
        let [of_triangles, of_faces] = lists(self.scene).map(|(_, first)| first);
        for grid in &self.side.grids {
            // What begins in the cells before may reach into them.
            let side = 1 << grid.coarseness;
            let [columns, rows] = [0, 1].map(|i| cells[i].start.saturating_sub(side)..cells[i].end);
            for row in (rows.start >> grid.coarseness << grid.coarseness..rows.end).step_by(side as usize) {
                let of_row = grid.cell(columns.start, row)..grid.cell(columns.end - 1, row) + 2;
                for ends in self.side.starts[of_row].windows(2) {
                    let placed = &self.side.objects[ends[0] as usize..ends[1] as usize];
                    let may_be_before = |of: &&Extent| placed.len() <= FEW as usize || of.depth <= -depth;
                    for of in placed.iter().take_while(may_be_before).filter(meets) {
                        all[usize::from(of.first >= of_triangles) + usize::from(of.first >= of_faces)].push(of);
                    }
                }
            }
        }
    }

    /// Lists the first of some objects of a kind as the light sees them, as many as there is room for; returns the others.
    pub fn cast<'b>(
        &self,
        (kind, objects): (usize, &'b [&'a Extent]),
        kernel: &Cast,
        Casters { list, spheres, arrays, .. }: &mut Casters,
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
        } else {
            spheres.clear();
            spheres.extend(now.iter().map(|object| self.sphere(object.first)));
        }
        later
    }

    /// Makes the triangles that groups of points meet.
    pub fn make_met(&self, Casters { list, triangles, .. }: &mut Casters) {
        let mut numbers = [None; MOST_CASTERS];
        triangles.clear();
        list.renumber(|at, place| {
            *numbers[at].get_or_insert_with(|| {
                triangles.push(self.triangle(place));
                (triangles.len() - 1) as u8
            })
        });
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
        // A rule for edges alone: triangles that share one have the same plane.
        let edge = |i: usize, j: usize| {
            let (v, w) = (corners[i], corners[j]);
            let is_near = |of: [f64; 3]| of[i].max(of[j]) > of[i].min(of[j]) * FAR_BESIDE_NEAR;
            let (mut seen, mut known) = (0.5 * (v + w), 0.5 * (v + w));
            if distances.into_iter().any(is_near) {
                // The rounding of its middle matters: it is taken through its ends.
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
    fn sphere(&self, place: u32) -> SphereCaster<f64> {
        let sphere: &Sphere = &self.scene.spheres[place as usize];
        let (c, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let l = c - self.position;
        let (r2, of_light) = (radius * radius, geometry::power(l, radius));
        let is_outside = of_light > 0.0;
        // Points of a large sphere may be so near that |P - c|^2 - r^2 loses them.
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
