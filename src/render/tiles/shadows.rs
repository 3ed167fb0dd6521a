//! The lights that do not reach a pixel, because an object is between or because they are behind the surface.
//!
//! A pixel in a shadow gets an object of its own: one that has the lights of the object there, without those that are hidden.
//! So shading, and the pixels that all lights reach, know nothing of shadows.

use std::mem;

use glam::DVec3;

use super::TileTracer;
use super::nearest::TileObjects;
use crate::kernels::{
    CHUNK, Caster, Casters, Element, GROUP, LitPoints, Plain, PointObject, SphereCaster, TILE_PIXELS, TileBuffers,
    TilePoints, TileWindow, TriangleCaster,
};
use crate::plan::{Cell, Kind, Shadows};

/// The cells whose objects a thread keeps as lights see them, of each kind.
const MOST_CELLS: usize = 1 << 9;

/// The memory of a thread for shadows.
pub(super) struct ShadowScratch {
    points: Box<TilePoints<f64>>,
    /// By id; where there is no light, those that no light reaches.
    objects: Vec<PointObject<f64>>,
    owners: Vec<bool>,
    /// The ids of pixels: of their objects, and of what is left of these.
    ids: Box<[u32; TILE_PIXELS]>,
    left: Box<[u32; TILE_PIXELS]>,
    triangles: Vec<Kept<TriangleCaster<f64>>>,
    spheres: Vec<Kept<SphereCaster<f64>>>,
}

impl Default for ShadowScratch {
    fn default() -> Self {
        ShadowScratch {
            points: Box::new(TilePoints::ZERO),
            objects: Vec::new(),
            owners: Vec::new(),
            ids: Box::new([0; TILE_PIXELS]),
            left: Box::new([0; TILE_PIXELS]),
            triangles: vec![Kept::default(); MOST_CELLS],
            spheres: vec![Kept::default(); MOST_CELLS],
        }
    }
}

/// The nearest [`CHUNK`] objects of a cell, as the light sees them.
#[derive(Clone)]
struct Kept<C> {
    key: u64,
    casters: Vec<C>,
    bounds: Vec<[f32; 4]>,
    /// How many of the cell's objects they are, with those of which the light sees only an edge.
    count: usize,
}

impl<C> Default for Kept<C> {
    fn default() -> Self {
        Kept { key: u64::MAX, casters: Vec::new(), bounds: Vec::new(), count: 0 }
    }
}

/// No object, or one that is dark: its points are nowhere.
const NOBODY: PointObject<f64> = PointObject { w: f64::NAN, own: -1.0, ..PointObject::ZERO };

/// An object without one of its lights.
#[derive(Clone, Copy)]
struct Without {
    id: u32,
    light: usize,
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
        let (boxes, count) = (boxes(&scratch.points), tile_objects.order.len());
        let (mut less, mut instead, mut faces): (Vec<Without>, Vec<u32>, Vec<bool>) = Default::default();
        for (light, position) in shadows.lights().enumerate() {
            faces.clear();
            faces.extend(scratch.objects.iter().map(|object| is_lit(object, position)));
            instead.clear();
            instead.resize(count + less.len(), 0);
            for (group, seen) in boxes.iter().enumerate().filter(|(_, [low, _])| low.x < f64::INFINITY) {
                let first = group * GROUP;
                let (mut somebody, mut open) = (0, 0);
                for (i, id) in scratch.ids[first..first + GROUP].iter().enumerate() {
                    somebody |= u32::from(*id > 0) << i;
                    open |= u32::from(faces[*id as usize]) << i;
                }
                if open != 0 {
                    open = self.open(shadows, (light, position), (first, *seen), open, scratch);
                }
                let mut dark = somebody & !open;
                while dark != 0 {
                    let id = &mut scratch.left[first + dark.trailing_zeros() as usize];
                    let instead = &mut instead[*id as usize];
                    if *instead == 0 {
                        *instead = (count + less.len()) as u32;
                        less.push(Without { id: *id, light });
                    }
                    *id = *instead;
                    dark &= dark - 1;
                }
            }
        }
        if !less.is_empty() {
            self.part_with(count, &less, buffers, tile_objects, &mut scratch.left);
        }
    }

    /// Finds what is visible in a tile, of objects at these places of the scene, and whose it is.
    fn find_points(
        &self,
        shadows: &Shadows<'_>,
        window: &TileWindow,
        buffers: &TileBuffers<E>,
        order: &[u32],
        ShadowScratch { points, objects, owners, ids, left, .. }: &mut ShadowScratch,
    ) {
        owners.clear();
        owners.resize(order.len(), false);
        buffers.mark_owners(owners);
        objects.clear();
        objects.extend(order.iter().zip(&*owners).map(|(place, owns)| {
            let object = if *owns && *place > 0 { shadows.object(*place as usize - 1) } else { None };
            object.unwrap_or(NOBODY)
        }));
        self.kernels.tiles.points.call(&self.plan.point_view(), buffers, [window.column, window.row], objects, points);
        buffers.ids(ids);
        left.copy_from_slice(&ids[..]);
    }

    /// Those of the open points of a group, in a box, that nothing hides from a light.
    fn open(
        &self,
        shadows: &Shadows<'_>,
        (light, DVec3 { x, y, z }): (usize, DVec3),
        (first, points_box): (usize, [DVec3; 2]),
        mut open: u32,
        ShadowScratch { points, spheres, triangles, .. }: &mut ShadowScratch,
    ) -> u32 {
        let at = [x, y, z, x.abs() + y.abs() + z.abs()];
        shadows.cells_of(light, points_box, |cell| {
            let points = LitPoints { points, first, light: &at, seen: cell.seen };
            let (kernels, side) = (self.packets, cell.side);
            open = match cell.kind {
                Kind::Sphere => {
                    let make = |id| Some(shadows.sphere(light, side, id));
                    ask(&points, cell, &kernels.sphere_casters, spheres, open, make)
                }
                Kind::Triangle => {
                    let make = |id| shadows.triangle(light, side, id);
                    ask(&points, cell, &kernels.triangle_casters, triangles, open, make)
                }
            };
            open != 0
        });
        open
    }

    /// Makes the shading records of objects that are without some lights, after `count` others, and gives the pixels their ids.
    fn part_with(
        &self,
        count: usize,
        less: &[Without],
        buffers: &mut TileBuffers<E>,
        TileObjects { shades, spheres, .. }: &mut TileObjects<E>,
        ids: &mut [u32; TILE_PIXELS],
    ) {
        let lights = self.plan.points().len();
        let first_triangle = 1 + spheres.places.len();
        // Spheres come before triangles.
        let mut is_sphere: Vec<_> = (0..count).map(|id| (1..first_triangle).contains(&id)).collect();
        for Without { id, .. } in less {
            is_sphere.push(is_sphere[*id as usize]);
        }
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
        for (Without { id, light }, (number, is_sphere)) in
            less.iter().zip(numbers[count..].iter().zip(&is_sphere[count..]))
        {
            let from = numbers[*id as usize] as usize;
            if *is_sphere {
                let old = spheres.places[from - 1] as usize;
                spheres.records.without(old, place, *light, lights);
                spheres.places.push(place as u32);
                place += 1;
            } else {
                let to = *number as usize * lights;
                shades.copy_within(from * lights..(from + 1) * lights, to);
                let shade = &mut shades[to + light];
                (shade.red, shade.green, shade.blue) = (E::ZERO, E::ZERO, E::ZERO);
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

/// The least and the greatest coordinates of each group of points, but for those that are nowhere.
fn boxes(points: &TilePoints<f64>) -> Vec<[DVec3; 2]> {
    let group = |group: usize| {
        let [x, y, z] = [&points.x, &points.y, &points.z].map(|axis| &axis.as_chunks::<GROUP>().0[group]);
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            // Not a number is neither less nor greater.
            for (i, x) in [*x, *y, *z].into_iter().enumerate() {
                low[i] = if x < low[i] { x } else { low[i] };
                high[i] = if x > high[i] { x } else { high[i] };
            }
        }
        [low, high]
    };
    (0..TILE_PIXELS / GROUP).map(group).collect()
}

/// Those of the open points that no object of a cell hides from a light.
fn ask<C: Caster>(
    points: &LitPoints<'_>,
    cell: &Cell<'_>,
    kernel: &Casters<C>,
    kept: &mut [Kept<C>],
    mut open: u32,
    make: impl Fn(u32) -> Option<(C, [f32; 4])>,
) -> u32 {
    // Cells beside each other have different places.
    let hash = cell.key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    let kept = &mut kept[hash as usize % MOST_CELLS];
    if kept.key != cell.key {
        *kept = Kept {
            key: cell.key,
            count: 0,
            casters: mem::take(&mut kept.casters),
            bounds: mem::take(&mut kept.bounds),
        };
        kept.casters.clear();
        kept.bounds.clear();
    }
    // The others are behind all points.
    let near = cell.objects.partition_point(|object| object.depth <= cell.depth);
    let here = near.min(CHUNK);
    if kept.count < here {
        for (caster, bounds) in cell.objects[kept.count..here].iter().filter_map(|object| make(object.id)) {
            kept.casters.push(caster);
            kept.bounds.push(bounds);
        }
        kept.count = here;
    }
    open = kernel.call(points, &kept.casters, &kept.bounds, open);
    for objects in cell.objects[here..near].chunks(CHUNK) {
        if open == 0 {
            break;
        }
        let (casters, bounds): (Vec<_>, Vec<_>) = objects.iter().filter_map(|object| make(object.id)).unzip();
        open = kernel.call(points, &casters, &bounds, open);
    }
    open
}
