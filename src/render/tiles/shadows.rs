//! The lights that do not reach a pixel, because an object is between or because they are behind the surface.
//!
//! A pixel in a shadow gets an object of its own: one that has the lights of the object there, without those that are hidden.
//! So shading, and the pixels that all lights reach, know nothing of shadows.

use glam::DVec3;

use super::TileTracer;
use super::nearest::TileObjects;
use crate::kernels::{
    Caster, CasterList, Casters, Element, GROUP, LitPoints, Plain, PointObject, SphereCaster, TILE_PIXELS, TileBuffers,
    TilePoints, TileWindow, TriangleCaster,
};
use crate::plan::{Cell, Kind, Shadows};

/// How many groups of objects of each kind a thread keeps as lights see them.
const MOST_KEPT: usize = 1 << 11;

/// The memory of a thread for shadows.
pub(super) struct ShadowScratch {
    points: Box<TilePoints<f64>>,
    /// By id.
    objects: Vec<PointObject<f64>>,
    owners: Vec<bool>,
    /// The object of all pixels of a group, if it is one.
    of_one: [Option<u32>; TILE_PIXELS / GROUP],
    /// The ids of pixels: of their objects, and of what is left of these.
    ids: Box<[u32; TILE_PIXELS]>,
    left: Box<[u32; TILE_PIXELS]>,
    /// The points of each group that a light may reach.
    open: [u32; TILE_PIXELS / GROUP],
    triangles: OfKind<TriangleCaster<f64>>,
    spheres: OfKind<SphereCaster<f64>>,
}

impl Default for ShadowScratch {
    fn default() -> Self {
        ShadowScratch {
            points: Box::new(TilePoints::ZERO),
            objects: Vec::new(),
            owners: Vec::new(),
            of_one: [None; TILE_PIXELS / GROUP],
            ids: Box::new([0; TILE_PIXELS]),
            left: Box::new([0; TILE_PIXELS]),
            open: [0; TILE_PIXELS / GROUP],
            triangles: OfKind::default(),
            spheres: OfKind::default(),
        }
    }
}

/// The objects of some cells as lights see them.
struct OfKind<C>(Vec<Kept<C>>);

impl<C> Default for OfKind<C> {
    fn default() -> Self {
        OfKind((0..MOST_KEPT).map(|_| Kept::default()).collect())
    }
}

/// Some objects of a cell.
struct Kept<C> {
    /// The cell's key, and how many objects are before these.
    key: (u64, usize),
    /// How many they are, with those of which the light sees only an edge.
    count: usize,
    list: CasterList<C>,
}

impl<C> Default for Kept<C> {
    fn default() -> Self {
        Kept { key: (u64::MAX, 0), count: 0, list: CasterList::default() }
    }
}

impl<C: Caster> OfKind<C> {
    /// Those of the open points that no object of a cell hides from a light.
    fn ask(
        &mut self,
        cell: &Cell<'_>,
        make: impl Fn(u32) -> Option<(C, [f32; 4])>,
        kernel: &Casters<C>,
        points: &LitPoints<'_>,
        mut open: u32,
    ) -> u32 {
        for (before, objects) in (0..).step_by(GROUP).zip(cell.objects.chunks(GROUP)) {
            let key = (cell.key, before);
            // Cells beside each other have different places.
            let place = (cell.key + before as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            let kept = &mut self.0[place as usize % MOST_KEPT];
            if kept.key != key {
                (kept.key, kept.count) = (key, 0);
                kept.list.clear();
            }
            if kept.count < objects.len() {
                let made = objects[kept.count..].iter().filter_map(|object| make(object.id));
                made.for_each(|(caster, bounds)| kept.list.push(caster, bounds));
                kept.count = objects.len();
            }
            open = kernel.call(points, &kept.list, open);
            if open == 0 {
                break;
            }
        }
        open
    }
}

/// With more of a tile's objects darkened, those without a pixel are forgotten.
const MOST_PARTS: usize = 4 * TILE_PIXELS;

/// Rounding of f64 and of f32 in shading, and more.
const MARGIN: f64 = 1e-5;

/// No object, or one that is dark: its points are nowhere.
const NOBODY: PointObject<f64> = PointObject { w: f64::NAN, own: -1.0, ..PointObject::ZERO };

/// Objects without some of their lights, as parts of a tile's objects: their ids come after those of these.
#[derive(Default)]
struct Darkened {
    /// The number of the tile's objects.
    count: usize,
    /// The object of each, and its last hidden light in `hidden`.
    parts: Vec<(u32, u32)>,
    /// Lights, each after the index of the one that was hidden before, or itself.
    hidden: Vec<(u32, u32)>,
}

impl Darkened {
    /// The id of what is left of one without a light more.
    fn without(&mut self, id: u32, light: usize) -> u32 {
        let next = self.hidden.len() as u32;
        let part = (id as usize).checked_sub(self.count).map(|part| self.parts[part]);
        let (object, before) = part.unwrap_or((id, next));
        self.hidden.push((before, light as u32));
        self.parts.push((object, next));
        (self.count + self.parts.len() - 1) as u32
    }

    /// Its hidden lights.
    fn lights(&self, (_, last): (u32, u32)) -> impl Iterator<Item = usize> {
        let before = |at: &u32| Some(self.hidden[*at as usize].0).filter(|before| before != at);
        std::iter::successors(Some(last), before).map(|at| self.hidden[at as usize].1 as usize)
    }

    /// Forgets those without a pixel.
    fn forget(&mut self, ids: &mut [u32; TILE_PIXELS]) {
        let mut numbers = vec![0; self.parts.len()];
        let parts = std::mem::take(&mut self.parts);
        for id in ids.iter_mut() {
            let Some(part) = (*id as usize).checked_sub(self.count) else { continue };
            if numbers[part] == 0 {
                self.parts.push(parts[part]);
                numbers[part] = (self.count + self.parts.len() - 1) as u32;
            }
            *id = numbers[part];
        }
    }
}

impl<E: Element> TileTracer<'_, E> {
    /// Takes the light that does not reach them from the pixels of a tile.
    pub(super) fn cast_shadows(
        &self,
        shadows: &Shadows<'_>,
        window: &TileWindow,
        buffers: &mut TileBuffers<E>,
        tile_objects: &mut TileObjects<E>,
        scratch: &mut ShadowScratch,
    ) {
        self.find_points(shadows, window, buffers, &tile_objects.order, scratch);
        let (boxes, all) = (boxes(&scratch.points), u32::from(u16::MAX));
        let mut darkened = Darkened { count: tile_objects.order.len(), ..Darkened::default() };
        let (mut instead, mut faces): (Vec<u32>, Vec<bool>) = Default::default();
        for (light, position) in shadows.lights().enumerate() {
            faces.clear();
            faces.extend(scratch.objects.iter().map(|object| is_lit(object, position)));
            for (group, points_box) in boxes.iter().enumerate() {
                let of_one = scratch.of_one[group].map(|id| id as usize);
                if of_one.is_some_and(|id| is_dark(&scratch.objects[id], position, *points_box)) {
                    // What is dark by the law of shading needs no shadow.
                    scratch.open[group] = all;
                    continue;
                }
                let ids = &scratch.ids.as_chunks::<GROUP>().0[group];
                scratch.open[group] = match of_one {
                    Some(id) => {
                        if faces[id] {
                            all
                        } else {
                            0
                        }
                    }
                    None => (0..).zip(ids).fold(0, |open, (i, id)| open | u32::from(faces[*id as usize]) << i),
                };
                let open = scratch.open[group];
                scratch.open[group] = self.open(shadows, (light, position), (group, *points_box), open, scratch);
            }
            instead.clear();
            instead.resize(darkened.count + darkened.parts.len(), 0);
            for (ids, open) in scratch.left.as_chunks_mut::<GROUP>().0.iter_mut().zip(scratch.open) {
                let dark = ids.iter_mut().enumerate().filter(|(i, id)| open >> i & 1 == 0 && **id > 0);
                for (_, id) in dark.filter(|_| open != all) {
                    let instead = &mut instead[*id as usize];
                    if *instead == 0 {
                        *instead = darkened.without(*id, light);
                    }
                    *id = *instead;
                }
            }
            if darkened.parts.len() > MOST_PARTS {
                darkened.forget(&mut scratch.left);
            }
        }
        darkened.forget(&mut scratch.left);
        if !darkened.parts.is_empty() {
            self.part_with(&darkened, buffers, tile_objects, &mut scratch.left);
        }
    }

    /// Finds what is visible in a tile, of objects at these places of the scene, and whose it is.
    fn find_points(
        &self,
        shadows: &Shadows<'_>,
        window: &TileWindow,
        buffers: &TileBuffers<E>,
        order: &[u32],
        ShadowScratch { points, objects, owners, of_one, ids, left, .. }: &mut ShadowScratch,
    ) {
        buffers.ids(ids);
        left.copy_from_slice(&ids[..]);
        owners.clear();
        owners.resize(order.len(), false);
        for (ids, of_one) in ids.as_chunks::<GROUP>().0.iter().zip(of_one) {
            *of_one = ids.iter().all(|id| *id == ids[0]).then_some(ids[0]);
            let different = if of_one.is_some() { &ids[..1] } else { &ids[..] };
            different.iter().for_each(|id| owners[*id as usize] = true);
        }
        objects.clear();
        objects.extend(order.iter().zip(&*owners).map(|(place, owns)| {
            let object = if *owns && *place > 0 { shadows.object(*place as usize - 1) } else { None };
            object.unwrap_or(NOBODY)
        }));
        self.kernels.tiles.points.call(&self.plan.point_view(), buffers, [window.column, window.row], objects, points);
    }

    /// Those of the open points of a group, in a box, from which nothing hides a light.
    fn open(
        &self,
        shadows: &Shadows<'_>,
        (light, position): (usize, DVec3),
        (group, points_box): (usize, [DVec3; 2]),
        mut open: u32,
        scratch: &mut ShadowScratch,
    ) -> u32 {
        let (kernels, at) = (self.packets, position.to_array());
        for side in shadows.sides(light) {
            let Some(seen) = side.seen(points_box).filter(|_| open != 0) else { continue };
            // Mostly they are of objects at different depths.
            let parts = side.is_wide(&seen).then(|| halves(&scratch.points, group * GROUP, open, points_box));
            if let Some(parts) = parts.filter(|parts| parts.iter().all(|(part, _)| *part != 0)) {
                let of_part =
                    |(part, points_box)| self.open(shadows, (light, position), (group, points_box), part, scratch);
                return parts.map(of_part).into_iter().fold(0, |open, part| open | part);
            }
            let ShadowScratch { points, triangles, spheres, .. } = scratch;
            let points = LitPoints { points, first: group * GROUP, light: &at, seen: seen.ends };
            side.each_cell(&seen, |cell| {
                open = match cell.kind {
                    Kind::Sphere => {
                        spheres.ask(cell, |id| Some(side.sphere(id)), &kernels.sphere_casters, &points, open)
                    }
                    Kind::Triangle => {
                        triangles.ask(cell, |id| side.triangle(id), &kernels.triangle_casters, &points, open)
                    }
                };
                open != 0
            });
        }
        open
    }

    /// Makes the shading records of objects that are without some lights, and gives the pixels their ids.
    fn part_with(
        &self,
        darkened: &Darkened,
        buffers: &mut TileBuffers<E>,
        TileObjects { shades, spheres, .. }: &mut TileObjects<E>,
        ids: &mut [u32; TILE_PIXELS],
    ) {
        let count = darkened.count;
        let lights = self.plan.points().len();
        let first_triangle = 1 + spheres.places.len();
        // Spheres come before triangles.
        let roots = (0..count as u32).chain(darkened.parts.iter().map(|(object, _)| *object));
        let is_sphere: Vec<_> = roots.map(|id| (1..first_triangle).contains(&(id as usize))).collect();
        let added = is_sphere[count..].iter().filter(|is_sphere| **is_sphere).count();
        let (mut sphere, mut triangle) = (first_triangle, count + added);
        let mut next = |(id, is_sphere): (usize, &bool)| {
            let number = match id {
                _ if id < first_triangle => return id as u32,
                _ if id < count => return (id + added) as u32,
                _ if *is_sphere => &mut sphere,
                _ => &mut triangle,
            };
            *number += 1;
            *number as u32 - 1
        };
        let numbers: Vec<_> = is_sphere.iter().enumerate().map(&mut next).collect();
        let all = is_sphere.len();
        shades.resize(shades.len().max(all * lights), Default::default());
        shades.copy_within(first_triangle * lights..count * lights, (first_triangle + added) * lights);
        shades[first_triangle * lights..(first_triangle + added) * lights].fill(Default::default());
        let mut place = spheres.places.iter().max().map_or(0, |most| 1 + *most as usize);
        spheres.records.hold(place + added, lights);
        for (part, (number, is_sphere)) in darkened.parts.iter().zip(numbers[count..].iter().zip(&is_sphere[count..])) {
            let object = numbers[part.0 as usize] as usize;
            if *is_sphere {
                let record = spheres.places[object - 1] as usize;
                spheres.records.without(record, place, darkened.lights(*part), lights);
                spheres.places.push(place as u32);
                place += 1;
            } else {
                let to = *number as usize * lights;
                shades.copy_within(object * lights..(object + 1) * lights, to);
                for light in darkened.lights(*part) {
                    let shade = &mut shades[to + light];
                    (shade.red, shade.green, shade.blue) = (E::ZERO, E::ZERO, E::ZERO);
                }
            }
        }
        ids.iter_mut().for_each(|id| *id = numbers[*id as usize]);
        buffers.set_ids(ids, all);
    }
}

/// Whether a light is on the camera's side of an object's surface: of the plane p . x = 1 of a triangle, and of a sphere where it
/// is seen from outside, but for what is dark by the law of shading.
fn is_lit(object: &PointObject<f64>, light: DVec3) -> bool {
    let &PointObject { x, y, z, a, b, own, .. } = object;
    let is_sphere = a != 0.0 || b != 0.0;
    own >= 0.0 && (is_sphere || DVec3::new(x, y, z).dot(light) < 1.0)
}

/// Whether all points of a sphere in a box are on its dark side, P . n < k, where eq. 11 gives nothing, by more than rounding.
fn is_dark(object: &PointObject<f64>, light: DVec3, [low, high]: [DVec3; 2]) -> bool {
    let &PointObject { x, y, z, a, b, w, .. } = object;
    let c = DVec3::new(x, y, z);
    // c.c - r^2 is 1 / w.
    let (n, k) = (light - c, c.dot(light) - 1.0 / w);
    let most = (low * n).max(high * n).element_sum();
    (a != 0.0 || b != 0.0) && most < k - MARGIN * (n.abs().dot(low.abs().max(high.abs())) + k.abs() + c.dot(c))
}

/// The least and the greatest coordinates of each group of points, but for those that are nowhere.
fn boxes(points: &TilePoints<f64>) -> Vec<[DVec3; 2]> {
    fn ends(axis: &[f64; GROUP]) -> [f64; 2] {
        let (mut low, mut high) = ([f64::INFINITY; 4], [f64::NEG_INFINITY; 4]);
        for four in axis.as_chunks::<4>().0 {
            for (i, x) in four.iter().enumerate() {
                // Not a number is neither less nor greater.
                low[i] = if *x < low[i] { *x } else { low[i] };
                high[i] = if *x > high[i] { *x } else { high[i] };
            }
        }
        [low.into_iter().fold(f64::INFINITY, f64::min), high.into_iter().fold(f64::NEG_INFINITY, f64::max)]
    }
    let group = |group: usize| {
        let [x, y, z] = [&points.x, &points.y, &points.z].map(|axis| ends(&axis.as_chunks().0[group]));
        [0, 1].map(|end| DVec3::new(x[end], y[end], z[end]))
    };
    (0..TILE_PIXELS / GROUP).map(group).collect()
}

/// The open points of a group on either side of the middle of their box's longest side, with boxes of their own.
fn halves(points: &TilePoints<f64>, first: usize, open: u32, [low, high]: [DVec3; 2]) -> [(u32, [DVec3; 2]); 2] {
    let longest = (high - low).max_position();
    let middle = low[longest] + 0.5 * (high - low)[longest];
    let mut halves = [(0, [DVec3::INFINITY, DVec3::NEG_INFINITY]); 2];
    for (i, at) in (first..first + GROUP).enumerate().filter(|(i, _)| open >> i & 1 == 1) {
        let p = DVec3::new(points.x[at], points.y[at], points.z[at]);
        let (bits, [low, high]) = &mut halves[usize::from(p[longest] > middle)];
        (*bits, *low, *high) = (*bits | 1 << i, low.min(p), high.max(p));
    }
    halves
}
