//! Finds the lights that do not reach a pixel because an object, or the surface itself, hides them.
//!
//! A pixel in shadow is given to a copy of its object that lacks the hidden lights. Shading
//! therefore needs to know nothing of shadows, and at pixels that all lights reach they cost
//! nothing.

use glam::DVec3;

use super::TileTracer;
use super::hidden::{AlongCurve, OcclusionQuery};
use super::nearest::TileObjects;
use crate::kernels::{
    Element, GROUP, GROUPS, LitGroups, Plain, PointObject, TILE_PIXELS, TileBuffers, TilePoints, TileWindow, own_bits,
};
use crate::plan::{Casters, Omission, Shadows, TileSurvey};

/// The mask of all points in a group.
const ALL: u32 = (1 << GROUP) - 1;

/// A thread's scratch memory for shadows.
pub(super) struct ShadowScratch {
    points: Box<TilePoints>,
    groups: Box<LitGroups>,
    /// The tile's objects by id, in the form that the point kernel takes.
    objects: Vec<PointObject<f64>>,
    owners: Vec<bool>,
    /// The id at each pixel: in `ids` that of the visible object, in `left` that of its copy
    /// without the hidden lights.
    ids: Box<[u32; TILE_PIXELS]>,
    left: Box<[u32; TILE_PIXELS]>,
    /// The candidate occluders, as a light sees them.
    casters: Casters,
    /// The points behind a crowd, sorted; None until a crowd occurs.
    along_curve: Option<Box<AlongCurve>>,
    /// Counts of tests that were made and avoided, for the report.
    pub counts: TileSurvey,
}

impl Default for ShadowScratch {
    fn default() -> Self {
        ShadowScratch {
            points: Box::new(TilePoints::ZERO),
            groups: Box::new(LitGroups::ZERO),
            objects: Vec::new(),
            owners: Vec::new(),
            ids: Box::new([0; TILE_PIXELS]),
            left: Box::new([0; TILE_PIXELS]),
            casters: Casters::default(),
            along_curve: None,
            counts: TileSurvey::default(),
        }
    }
}

impl ShadowScratch {
    /// Finds for each pixel which of the eight lights from index `first` on are on the lit side of
    /// its surface: a bit for each. `faces` is scratch memory for these bits by object.
    fn find_faced(&self, shadows: &Shadows<'_>, first: usize, faces: &mut Vec<u8>, faced: &mut [u8; TILE_PIXELS]) {
        let eight: Vec<_> = shadows.lights().skip(first).take(8).collect();
        let lit = |object| eight.iter().rev().fold(0, |lit, light| lit << 1 | u8::from(is_lit(object, *light)));
        faces.clear();
        faces.extend(self.objects.iter().map(lit));
        faced.iter_mut().zip(&*self.ids).for_each(|(faced, id)| *faced = faces[*id as usize]);
    }
}

/// In a tile with more darkened copies, those without a pixel are dropped.
const MOST_PARTS: usize = TILE_PIXELS;

/// Stands for no object, and for an object that no light reaches: its points are NaN.
const NOBODY: PointObject<f64> = PointObject { w: f64::NAN, own: -1.0, ..PointObject::ZERO };

/// Copies of a tile's objects that lack some lights. Their ids follow those of the tile's objects.
#[derive(Default)]
struct Darkened {
    /// The number of the tile's objects.
    count: usize,
    /// For each copy the id of its object, and the index in `hidden` of the light that was hidden
    /// last.
    parts: Vec<(u32, u32)>,
    /// Linked lists of hidden lights. An entry has the index of the entry that was made before it,
    /// or its own index at the end of a list, and the number of a light.
    hidden: Vec<(u32, u32)>,
}

impl Darkened {
    /// Adds a copy of an object, or of another copy, that lacks one more light. Returns its id.
    fn without(&mut self, id: u32, light: usize) -> u32 {
        let next = self.hidden.len() as u32;
        let part = (id as usize).checked_sub(self.count).map(|part| self.parts[part]);
        let (object, before) = part.unwrap_or((id, next));
        self.hidden.push((before, light as u32));
        self.parts.push((object, next));
        (self.count + self.parts.len() - 1) as u32
    }

    /// The lights that are hidden from a copy.
    fn lights(&self, (_, last): (u32, u32)) -> impl Iterator<Item = usize> {
        let before = |at: &u32| Some(self.hidden[*at as usize].0).filter(|before| before != at);
        std::iter::successors(Some(last), before).map(|at| self.hidden[at as usize].1 as usize)
    }

    /// Gives the pixels that a light does not reach, whose points are not `open`, to copies of
    /// their objects without that light. `instead` is scratch memory.
    fn darken(&mut self, ids: &mut [u32; TILE_PIXELS], open: &[u32; GROUPS], light: usize, instead: &mut Vec<u32>) {
        instead.clear();
        instead.resize(self.count + self.parts.len(), 0);
        let mut without = |id: u32| {
            let instead = &mut instead[id as usize];
            if *instead == 0 && id > 0 {
                *instead = self.without(id, light);
            }
            *instead
        };
        for (ids, open) in ids.as_chunks_mut::<GROUP>().0.iter_mut().zip(open) {
            let mut dark = *open ^ ALL;
            if dark == ALL {
                ids.iter_mut().for_each(|id| *id = without(*id));
                continue;
            }
            while dark != 0 {
                let id = &mut ids[dark.trailing_zeros() as usize];
                *id = without(*id);
                dark &= dark - 1;
            }
        }
        if self.parts.len() > MOST_PARTS {
            self.forget(ids);
        }
    }

    /// Drops the copies that have no pixel, and renumbers the others.
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
    /// Finds which lights do not reach which pixels of a tile. If `darkens`, these pixels are given
    /// to copies of their objects without these lights; otherwise tests are only counted.
    pub(super) fn cast_shadows(
        &self,
        shadows: &Shadows<'_>,
        darkens: bool,
        window: &TileWindow,
        buffers: &mut TileBuffers<E>,
        tile_objects: &mut TileObjects<E>,
        scratch: &mut ShadowScratch,
    ) {
        self.find_points(shadows, window, buffers, &tile_objects.order, scratch);
        let mut darkened = Darkened { count: tile_objects.order.len(), ..Darkened::default() };
        let mut instead = Vec::new();
        let mut faces = Vec::new();
        let mut faced = [0; TILE_PIXELS];
        let mut ends_of_points = None;
        let visible = scratch.ids.iter().filter(|id| **id > 0).count() as u64;
        for light in 0..shadows.lights().len() {
            if light % 8 == 0 {
                scratch.find_faced(shadows, light, &mut faces, &mut faced);
            }
            for (open, faced) in scratch.groups.open.iter_mut().zip(faced.as_chunks().0) {
                *open = bits(u128::from_le_bytes(*faced) >> (light % 8));
            }
            let facing: u64 = scratch.groups.open.iter().map(|open| u64::from(open.count_ones())).sum();
            scratch.counts.averted += visible - facing;
            scratch.counts.facing += facing * shadows.objects(light);
            self.close_hidden(shadows, light, scratch, &mut ends_of_points);
            if darkens {
                darkened.darken(&mut scratch.left, &scratch.groups.open, light, &mut instead);
            }
        }
        if !darkened.parts.is_empty() {
            // With a single light, every copy has pixels.
            if shadows.lights().nth(1).is_some() {
                darkened.forget(&mut scratch.left);
            }
            self.part_with(&darkened, buffers, tile_objects, &mut scratch.left);
        }
    }

    /// Closes the points that an object hides from the light. A point is open for a light while its
    /// bit in `scratch.groups.open` is set: it faces the light, and no object tested so far hides
    /// it. `ends_of_points` are computed when they are first needed.
    fn close_hidden(
        &self,
        shadows: &Shadows<'_>,
        light: usize,
        scratch: &mut ShadowScratch,
        ends_of_points: &mut Option<[DVec3; 2]>,
    ) {
        let (sides, all_cells) = (shadows.sides(light), self.plan.keep().has(Omission::OtherCells));
        let several = sides.len() > 1 && !all_cells;
        for side in sides {
            if scratch.groups.open == [0; GROUPS] {
                break;
            }
            if several && !side.may_see(*ends_of_points.get_or_insert_with(|| ends_of_all(&scratch.points))) {
                continue;
            }
            self.packets.seen.call(side.view(), &mut scratch.points, side.axis(), &mut scratch.groups);
            if all_cells {
                let LitGroups { x, y, past_x, past_y, depth, .. } = &mut *scratch.groups;
                [x, y, past_x, past_y, depth].into_iter().for_each(|ends| ends.fill(f32::NEG_INFINITY.to_bits()));
            }
            let ShadowScratch { points, groups, casters, counts, along_curve, .. } = &mut *scratch;
            let culls = !all_cells;
            OcclusionQuery { packets: self.packets, side, culls, points, groups, casters, counts }.run(along_curve);
        }
    }

    /// Finds the visible point at each pixel of a tile, and the object that it is on. `order` has
    /// the objects' indices in the scene.
    fn find_points(
        &self,
        shadows: &Shadows<'_>,
        window: &TileWindow,
        buffers: &mut TileBuffers<E>,
        order: &[u32],
        ShadowScratch { points, groups, objects, owners, ids, left, .. }: &mut ShadowScratch,
    ) {
        buffers.close_around(self.kernels.lanes, window);
        buffers.ids(ids);
        left.copy_from_slice(&ids[..]);
        owners.clear();
        owners.resize(order.len(), false);
        for (ids, own) in ids.as_chunks::<GROUP>().0.iter().zip(&mut groups.own) {
            let id = ids[0] as usize;
            // Ids are compared by arithmetic, since comparing arrays would be a function call.
            let is_one = ids.iter().fold(0, |different, id| different | (id ^ ids[0])) == 0;
            *own = if is_one && id > 0 { own_bits(order[id] - 1) } else { 0 };
            let different = if is_one { &ids[..1] } else { &ids[..] };
            different.iter().for_each(|id| owners[*id as usize] = true);
        }
        objects.clear();
        objects.extend(order.iter().zip(&*owners).map(|(place, owns)| {
            let object = if *owns && *place > 0 { shadows.object(*place as usize - 1) } else { None };
            object.filter(|object| shadows.lights().any(|light| is_lit(object, light))).unwrap_or(NOBODY)
        }));
        self.kernels.tiles.points.call(&self.plan.point_view(), buffers, [window.column, window.row], objects, points);
    }

    /// Makes the shading records of the darkened copies, and stores their ids at the pixels.
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
        // The ids of spheres come before those of triangles.
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
        if added > 0 && first_triangle < count {
            ids.iter_mut().for_each(|id| *id = numbers[*id as usize]);
        }
        buffers.set_ids(ids, all);
    }
}

/// Whether a light is on the camera's side of a surface. For a triangle that is its side of the
/// plane p . x = 1. For a sphere it is whether the camera is outside of it: shading leaves the side
/// that faces away from the light dark in any case.
fn is_lit(object: &PointObject<f64>, light: DVec3) -> bool {
    let &PointObject { x, y, z, a, b, own, .. } = object;
    // Evaluated without branches.
    (own >= 0.0) & ((a != 0.0) | (b != 0.0) | (DVec3::new(x, y, z).dot(light) < 1.0))
}

/// Collects the lowest bits of 16 bytes.
fn bits(of: u128) -> u32 {
    // The multiplication moves the lowest bit of each byte to the top byte, in order. No two
    // partial products have a bit in common.
    let eight = |of: u64| (of & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080) >> 56;
    (eight(of as u64) | eight((of >> 64) as u64) << 8) as u32
}

/// The least and the greatest coordinates of the points. Pixels without an object have NaN, which
/// is ignored.
fn ends_of_all(TilePoints { x, y, z, .. }: &TilePoints) -> [DVec3; 2] {
    let of = |sign: f64| {
        [x, y, z].map(|field| {
            let least = |a: [f64; 8], b: &[f64; 8]| {
                std::array::from_fn(|i| if sign * b[i] < a[i] { sign * b[i] } else { a[i] })
            };
            let least = field.as_chunks().0.iter().fold([f64::INFINITY; 8], least);
            sign * least.into_iter().fold(f64::INFINITY, f64::min)
        })
    };
    [of(1.0), of(-1.0)].map(DVec3::from)
}
