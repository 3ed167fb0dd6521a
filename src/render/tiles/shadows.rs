//! The lights that do not reach a pixel, because an object is between or because they are behind the surface.
//!
//! A pixel in a shadow gets an object of its own: one that has the lights of the object there, without those that are hidden.
//! So shading, and the pixels that all lights reach, know nothing of shadows.

use glam::DVec3;

use super::TileTracer;
use super::nearest::TileObjects;
use crate::kernels::{
    Element, GROUP, LitGroups, LitPoints, Plain, PointObject, TILE_PIXELS, TileBuffers, TilePoints, TileWindow,
    own_bits,
};
use crate::plan::{Casters, Ends, LightSide, Omission, Shadows, TileSurvey};

/// The groups of a tile.
const GROUPS: usize = TILE_PIXELS / GROUP;

/// All points of a group.
const ALL: u32 = (1 << GROUP) - 1;

/// The memory of a thread for shadows.
pub(super) struct ShadowScratch {
    points: Box<TilePoints>,
    groups: Box<LitGroups>,
    /// By id.
    objects: Vec<PointObject<f64>>,
    owners: Vec<bool>,
    /// The ids of pixels: of their objects, and of what is left of these.
    ids: Box<[u32; TILE_PIXELS]>,
    left: Box<[u32; TILE_PIXELS]>,
    /// Objects as a light sees them.
    casters: Casters,
    /// Of questions, for the report.
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
            counts: TileSurvey::default(),
        }
    }
}

/// With more of a tile's objects darkened, those without a pixel are forgotten.
const MOST_PARTS: usize = TILE_PIXELS;

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
    /// Asks which light does not reach the pixels of a tile, and takes it from them if `darkens`.
    pub(super) fn cast_shadows(
        &self,
        (shadows, darkens): (&Shadows<'_>, bool),
        window: &TileWindow,
        buffers: &mut TileBuffers<E>,
        tile_objects: &mut TileObjects<E>,
        scratch: &mut ShadowScratch,
    ) {
        self.find_points(shadows, window, buffers, &tile_objects.order, scratch);
        let mut darkened = Darkened { count: tile_objects.order.len(), ..Darkened::default() };
        let (mut instead, mut faces) = <(Vec<u32>, Vec<u8>)>::default();
        // Which of eight lights each pixel faces, a bit for each.
        let mut faced = [0; TILE_PIXELS];
        let mut ends_of_points = None;
        let visible = scratch.ids.iter().filter(|id| **id > 0).count() as u64;
        for light in 0..shadows.lights().len() {
            if light % 8 == 0 {
                let eight: Vec<_> = shadows.lights().skip(light).take(8).collect();
                let lit = |object| eight.iter().rev().fold(0, |lit, light| lit << 1 | u8::from(is_lit(object, *light)));
                faces.clear();
                faces.extend(scratch.objects.iter().map(lit));
                faced.iter_mut().zip(&*scratch.ids).for_each(|(faced, id)| *faced = faces[*id as usize]);
            }
            for (open, faced) in scratch.groups.open.iter_mut().zip(faced.as_chunks().0) {
                *open = bits(u128::from_le_bytes(*faced) >> (light % 8));
            }
            let facing: u64 = scratch.groups.open.iter().map(|open| u64::from(open.count_ones())).sum();
            scratch.counts.averted += visible - facing;
            scratch.counts.facing += facing * shadows.objects(light);
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
                self.ask(&side, !all_cells, scratch);
            }
            if !darkens {
                continue;
            }
            instead.clear();
            instead.resize(darkened.count + darkened.parts.len(), 0);
            let mut without = |id: u32| {
                let instead = &mut instead[id as usize];
                if *instead == 0 && id > 0 {
                    *instead = darkened.without(id, light);
                }
                *instead
            };
            for (ids, open) in scratch.left.as_chunks_mut::<GROUP>().0.iter_mut().zip(scratch.groups.open) {
                let mut dark = open ^ ALL;
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
            if darkened.parts.len() > MOST_PARTS {
                darkened.forget(&mut scratch.left);
            }
        }
        if !darkened.parts.is_empty() {
            // Under one light all have pixels.
            if shadows.lights().nth(1).is_some() {
                darkened.forget(&mut scratch.left);
            }
            self.part_with(&darkened, buffers, tile_objects, &mut scratch.left);
        }
    }

    /// Finds what is visible in a tile, of objects at these places of the scene, and whose it is.
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
            // All at once: comparing arrays is a call.
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

    /// Closes the open points from which something on a side hides its light; `culls` those that are not within its edges.
    fn ask(&self, side: &LightSide<'_>, culls: bool, scratch: &mut ShadowScratch) {
        let ShadowScratch { points, groups, casters, counts, .. } = scratch;
        let Some(window) = side.window(ends(groups)) else { return };
        let light = side.light();
        let points = LitPoints { points, light: &light };
        let mut near = [0; 3].map(|_| Vec::with_capacity(GROUPS));
        side.gather(&window, &mut near);
        let open: u64 = groups.open.iter().map(|open| u64::from(open.count_ones())).sum();
        for (kind, near) in near.iter_mut().enumerate() {
            let count = near.iter().map(|of| of.count as usize).sum::<usize>();
            counts.asked += open * count as u64;
            near.sort_unstable_by_key(|of| of.depth.to_bits());
            let mut near = &near[..];
            // What is farther than all points that are still open hides none.
            while near.first().is_some_and(|of| of.depth <= farthest(groups)) {
                near = side.cast((kind, near), &self.packets.cast, casters);
                self.packets.meet.call(points.points, groups, culls, &mut casters.list);
                if kind == 0 {
                    self.packets.sphere_casters.call(&points, &casters.spheres, &casters.list, groups);
                } else {
                    side.make_met(casters);
                    self.packets.triangle_casters.call(&points, &casters.triangles, &casters.list, groups);
                }
            }
        }
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
        if added > 0 && first_triangle < count {
            ids.iter_mut().for_each(|id| *id = numbers[*id as usize]);
        }
        buffers.set_ids(ids, all);
    }
}

/// Whether a light is on the camera's side of an object's surface: of the plane p . x = 1 of a triangle, and of a sphere where it
/// is seen from outside, but for what is dark by the law of shading.
fn is_lit(object: &PointObject<f64>, light: DVec3) -> bool {
    let &PointObject { x, y, z, a, b, own, .. } = object;
    // Without branches.
    (own >= 0.0) & ((a != 0.0) | (b != 0.0) | (DVec3::new(x, y, z).dot(light) < 1.0))
}

/// The lowest bits of 16 bytes.
fn bits(of: u128) -> u32 {
    // No two products of a bit meet, and those of the eight are in the last byte in their order.
    let eight = |of: u64| (of & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080) >> 56;
    (eight(of as u64) | eight((of >> 64) as u64) << 8) as u32
}

/// The least and the greatest coordinates of points; those of nobody are no numbers.
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

/// The ends of all points on a side: those of groups without one are infinite.
fn ends(LitGroups { x, y, past_x, past_y, depth, .. }: &LitGroups) -> Ends {
    [x, y, past_x, past_y, depth].map(|field| least(|group| f32::from_bits(field[group])))
}

/// The farthest open point of all.
fn farthest(LitGroups { depth, open, .. }: &LitGroups) -> f32 {
    -least(|group| if open[group] != 0 { f32::from_bits(depth[group]) } else { f32::INFINITY })
}

/// The least of what groups have.
fn least(of: impl Fn(usize) -> f32) -> f32 {
    // Several at a time: of one alone each waits for the one before.
    let mut all = [f32::INFINITY; 8];
    for group in (0..GROUPS).step_by(all.len()) {
        all = std::array::from_fn(|i| if of(group + i) < all[i] { of(group + i) } else { all[i] });
    }
    all.into_iter().fold(f32::INFINITY, f32::min)
}
