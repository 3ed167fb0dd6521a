//! Spans: which pixels of a row each object covers, and the records from which packet kernels shade them.
//!
//! Everything here is f64, in closed form, once per object or once per object and row. The rays that meet a convex
//! object through the pixels of one row are consecutive, so a span is two columns. Kernels then never ask whether a ray
//! hits, and what cancels in f32 (far spheres, far triangles) is subtracted here.

use std::ops::Range;

use glam::DVec3;

use super::light::{self, LightOn};
use super::omission::{Keep, Omission};
use super::{power_of_two, unit_rays};
use crate::kernels::{
    Element, InsideSpan, LitRow, LitSetup, LitSphere, NearSpan, ObjectLight, OutsideSpan, TriangleSpan,
};
use crate::reference::geometry;
use crate::scene::{self, Camera, Grid, Light, Scene};

/// The short form's error may be so many times that of its operations, see SPHERE_LIT. Estimates, which are right to
/// 1.5 2^-12, then still keep to three quarters of a level.
const SHORT_FORM_LOSS: f64 = 32.0;

/// Elements count columns exactly up to here.
const SHORT_FORM_WIDTH: u32 = 1 << 24;

/// Half of a silhouette may have so many columns; one column inside of it, p is then far above its rounding.
const SHORT_FORM_COLUMNS: f64 = 1048576.0;

/// A row of more spans than this is left to the depth of each pixel.
const MOST_CUT: usize = 32;

/// A sphere with less than this for k is less than sqrt 2 radii away: lights are seen from the camera then.
const NEAR: f64 = 1.0;

/// A triangle with edges of less than this share of its distance is seen from one of its vertices.
const SMALL_TRIANGLE: f64 = 0.25;

/// Powers of two that numbers must keep between for f32 to hold them, their squares and what these are multiplied by.
const SQUARED: f64 = (1u64 << 50) as f64;
const LINEAR: f64 = SQUARED * SQUARED;
/// The same for lengths in the short form, of which it multiplies three, and the weight squared.
const CUBED: f64 = (1u64 << 36) as f64;

/// A scene's objects as one camera sees them, and what is to be done for each.
pub struct Spans<E> {
    camera: Camera,
    /// The camera's rays times `unit`.
    grid: Grid<f64>,
    /// 1 / grid.step.
    columns_per_x: f64,
    keep: Keep,
    /// How often each omission was made among objects and lights.
    left_out: [u64; Omission::ALL.len()],
    /// What the camera's grid was multiplied by: a power of two.
    unit: f64,
    objects: Vec<Object>,
    /// 1/t of the camera's rays over what kernels compare.
    depth_unit: f64,
    /// The rows of the objects whose numbers f32 does not hold.
    wide: Vec<Range<u32>>,
    /// The lights of one object after those of another, for each scale that was asked for.
    lits: [Vec<ObjectLight<E>>; Scale::ALL.len()],
}

/// What full light is in the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// 1, for floats.
    Linear,
    /// 255, for bytes.
    Levels,
}

impl Scale {
    /// Both.
    pub const ALL: [Scale; 2] = [Scale::Linear, Scale::Levels];

    /// Full light.
    pub fn white(self) -> f64 {
        match self {
            Scale::Linear => 1.0,
            Scale::Levels => 255.0,
        }
    }
}

/// An object that some row of the picture may see.
struct Object {
    source: scene::Object,
    rows: Rows,
    /// Whether f32 holds the numbers of its records and its light.
    fits: bool,
    shape: Shape,
    /// Its lights' place in the lists.
    lits: Range<usize>,
    shading: Shading,
}

/// Rows of the picture.
#[derive(Clone)]
struct Rows {
    /// Those that may see an object.
    seeing: Range<u32>,
    /// Those in which it is looked for.
    traced: Range<u32>,
}

/// What the shading of an object may leave out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shading {
    /// All of it: no light reaches the object.
    pub unlit: bool,
    /// Two channels of three, where the form is short.
    pub grey: bool,
}

/// How the spans of a row are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// One by one, from left to right: they share no pixel.
    Apart,
    /// By the depth of each pixel.
    Nearest,
    /// The same, every object along all of the row.
    NearestInRow,
}

enum Shape {
    Sphere(Sphere),
    Triangle(Triangle),
    /// Never hit, and here only because nothing is to be left out.
    Nothing,
}

impl Shape {
    /// The 1/t that is compared over 1/t in its record; None of what is never hit.
    fn depth(&mut self) -> Option<&mut f64> {
        match self {
            Shape::Sphere(sphere) => Some(&mut sphere.depth),
            Shape::Triangle(triangle) => Some(&mut triangle.depth),
            Shape::Nothing => None,
        }
    }
}

/// A sphere in units of its radius.
struct Sphere {
    centre: DVec3,
    /// |c|^2 - 1: negative for a camera inside.
    k: f64,
    /// What 1/t is scaled by to be near 1 where the sphere is seen, a power of two.
    scale: f64,
    /// The 1/t that is compared over 1/t in this record.
    depth: f64,
    short: Option<Box<ShortForm>>,
}

/// A sphere from outside under one light, for SPHERE_LIT.
#[derive(Clone, Copy, Debug)]
pub struct ShortForm {
    /// What its rows are made of, in each scale.
    setups: [LitSetup<f64>; Scale::ALL.len()],
    /// What its rows share, in each scale.
    spheres: [LitSphere<f64>; Scale::ALL.len()],
}

struct Triangle {
    /// The planes through the camera and each edge; a ray inside is on the positive side of all or on one of them.
    edges: [DVec3; 3],
    /// Where its points are seen from: a vertex if it is far for its size, else the camera.
    origin: DVec3,
    /// n / (n . v): 1/t is its product with the ray.
    plane: DVec3,
    size: f64,
    /// The largest that the terms of 1/t become in the picture: what their roundings are relative to.
    reach: f64,
    /// The 1/t that is compared over 1/t in this record.
    depth: f64,
}

/// The pixels of one row that one object covers.
#[derive(Clone, Copy, Debug)]
pub struct RowSpan {
    /// Which object, in the scene's order.
    pub object: usize,
    /// First column.
    pub start: u32,
    /// Column past the last.
    pub end: u32,
    /// The column from which j counts. The object and the row decide it: an object's pixels are the same to the last bit
    /// whatever hides a part of it.
    origin: u32,
    /// For a sphere seen from outside.
    silhouette: Silhouette,
}

/// The spans of one row after another, in memory that all share.
#[derive(Default)]
pub struct RowSpans {
    /// Those of the present row.
    pub spans: Vec<RowSpan>,
    visible: Vec<RowSpan>,
    rest: Vec<RowSpan>,
    /// Where each begins and which it is, as one number: what is sorted, since spans are large.
    order: Vec<u64>,
}

impl RowSpans {
    /// Whether no two spans share a pixel; they are then sorted from left to right, and else in their order.
    fn are_apart(&mut self) -> bool {
        if self.spans.len() < 2 {
            return true;
        }
        self.order.clear();
        self.order.extend((0..).zip(&self.spans).map(|(i, span)| u64::from(span.start) << 32 | i));
        self.order.sort_unstable();
        let span = |i: u64| &self.spans[(i & 0xffff_ffff) as usize];
        let apart = self.order.windows(2).all(|pair| span(pair[0]).end <= span(pair[1]).start);
        if apart {
            self.visible.clear();
            self.visible.extend(self.order.iter().map(|i| *span(*i)));
            std::mem::swap(&mut self.spans, &mut self.visible);
        }
        apart
    }
}

impl RowSpan {
    /// The same span, of other columns: j counts from where it did.
    pub fn part(&self, columns: Range<u32>) -> RowSpan {
        RowSpan { start: columns.start, end: columns.end, ..*self }
    }
}

/// What to do with a span's record: one method for each kernel that there is.
///
/// Records are lent and not returned, so that they stay where their fields were rounded to: a copy would be read in wider
/// pieces than it was written in, and wait for those writes to leave the CPU's store buffer.
pub trait UseRecord<E> {
    /// What comes of it.
    type Result;
    /// A row of a sphere from outside under one light, in the short form; the first column is column 0.
    fn lit(self, sphere: &ShortForm, row: &LitRow<E>) -> Self::Result;
    /// A sphere from outside.
    fn outside(self, record: &OutsideSpan<E>) -> Self::Result;
    /// A sphere from outside at less than sqrt 2 radii.
    fn near(self, record: &NearSpan<E>) -> Self::Result;
    /// A sphere from inside.
    fn inside(self, record: &InsideSpan<E>) -> Self::Result;
    /// A triangle.
    fn triangle(self, record: &TriangleSpan<E>) -> Self::Result;
}

impl<E: Element> Spans<E> {
    /// Plans `scene` for the output of `scale`, or for any (None). What is in `keep` is not left out.
    pub fn new(scene: &Scene, scale: Option<Scale>, keep: Keep) -> Self {
        let (grid, unit) = unit_rays(&scene.camera);
        let mut spans = Spans {
            camera: scene.camera,
            grid,
            unit,
            depth_unit: 1.0,
            columns_per_x: 1.0 / grid.step,
            keep,
            left_out: [0; Omission::ALL.len()],
            objects: Vec::with_capacity(scene.spheres.len() + scene.triangle_count()),
            lits: Scale::ALL.map(|_| Vec::new()),
            wide: Vec::new(),
        };
        let lights = light::lights(scene, keep);
        spans.leave_out(Omission::DarkLights, scene.lights.iter().filter(|light| light::is_dark(light)).count());
        let scales = match scale {
            Some(scale) => &[scale][..],
            None => &Scale::ALL,
        };
        // The lights on one object: in one place for all, since there may be many objects.
        let mut on = Vec::with_capacity(lights.len());
        for (i, sphere) in scene.spheres.iter().enumerate() {
            spans.push_sphere(scene::Object::Sphere(i), sphere, &lights, &mut on, scales);
        }
        for (i, triangle) in scene.all_triangles().enumerate() {
            spans.push_triangle(scene::Object::Triangle(i), &triangle, &lights, &mut on, scales);
        }
        spans.compare_depths();
        spans
    }

    /// Depths are compared with each other alone: a power of two brings the nearest one's to about 1. What is then beyond
    /// f32 is noted, with what is so in itself.
    fn compare_depths(&mut self) {
        // What is never seen and only here because it is kept has no say.
        let seen = self.objects.iter_mut().filter(|object| !object.rows.seeing.is_empty());
        let depths = seen.filter_map(|object| object.shape.depth());
        let nearest = depths.fold(f64::MIN_POSITIVE, |nearest, depth| nearest.max(*depth)).min(f64::MAX);
        self.depth_unit = power_of_two(nearest);
        let deep = self.grid.focal * SQUARED > 1.0;
        for object in &mut self.objects {
            let Some(depth) = object.shape.depth() else { continue };
            *depth /= self.depth_unit;
            object.fits &= *depth * LINEAR > 1.0 && deep;
        }
        let wide = self.objects.iter().filter(|object| !object.fits);
        self.wide = wide.map(|object| object.rows.seeing.clone()).filter(|rows| !rows.is_empty()).collect();
    }

    /// Notes an omission; gives whether it is made.
    fn leave_out(&mut self, omission: Omission, count: usize) -> bool {
        self.left_out[omission as usize] += count as u64;
        !self.keep.has(omission)
    }

    /// The rows of an object of which `seen` is what is known, None if it is to be left out.
    fn rows_kept(&mut self, seen: Result<Range<u32>, Omission>) -> Option<Rows> {
        let seeing = match seen {
            Ok(rows) => rows,
            Err(why) if self.leave_out(why, 1) => return None,
            Err(_) => 0..0,
        };
        let traced = if self.keep.has(Omission::Misses) { 0..self.camera.height() } else { seeing.clone() };
        Some(Rows { seeing, traced })
    }

    fn push_sphere<'a>(
        &mut self,
        source: scene::Object,
        sphere: &scene::Sphere,
        lights: &[&'a Light],
        on: &mut Vec<LightOn<'a>>,
        scales: &[Scale],
    ) {
        let (centre, colour) = (sphere.centre.as_dvec3(), sphere.colour.as_dvec3());
        let radius = f64::from(sphere.radius);
        let mut shape = Sphere::new(centre, radius, self.unit);
        let Some(rows) = self.rows_kept(shape.seen(&self.grid, &self.camera)) else { return };
        on.clear();
        on.extend(lights.iter().map(|light| {
            let at = light.position.as_dvec3();
            let to_light = (at - centre) / radius;
            let seen = if shape.k < NEAR { at / radius } else { to_light };
            LightOn::on_sphere(shape.centre, to_light, seen, colour, light)
        }));
        let mut reaching = on.iter().filter(|light| light.reaches);
        if let (Some(one), None) = (reaching.next(), reaching.next())
            && let Some(short) = ShortForm::new::<E>(&shape, one, colour, &self.grid, &self.camera)
            && self.leave_out(Omission::Loop, 1)
        {
            shape.short = Some(Box::new(short));
        }
        let short = shape.short.is_some();
        let fits = shape.fits();
        self.push((source, fits, rows), Shape::Sphere(shape), colour, short, on, scales);
    }

    fn push_triangle<'a>(
        &mut self,
        source: scene::Object,
        triangle: &scene::Triangle,
        lights: &[&'a Light],
        on: &mut Vec<LightOn<'a>>,
        scales: &[Scale],
    ) {
        let (vertices, colour) = (triangle.vertices.map(|v| v.as_dvec3()), triangle.colour.as_dvec3());
        let shape = Triangle::new(vertices, self.unit, &self.grid);
        let seen =
            shape.as_ref().map_err(|why| *why).and_then(|_| seen_of_triangle(vertices, &self.grid, &self.camera));
        let Some(rows) = self.rows_kept(seen) else { return };
        on.clear();
        let (shape, fits) = match shape {
            Ok((shape, normal)) => {
                on.extend(lights.iter().map(|light| {
                    let at = light.position.as_dvec3();
                    let height = normal.dot(at - vertices[0]).abs() / shape.size;
                    LightOn::on_triangle::<E>(height, (at - shape.origin) / shape.size, colour, light)
                }));
                let fits = shape.fits(&vertices);
                (Shape::Triangle(shape), fits)
            }
            Err(_) => (Shape::Nothing, true),
        };
        self.push((source, fits, rows), shape, colour, false, on, scales);
    }

    /// Takes in an object, the lights `on` it, and what its shading may leave out. The lights that reach it decide that,
    /// whatever others are kept.
    fn push(
        &mut self,
        (source, fits, rows): (scene::Object, bool, Rows),
        shape: Shape,
        colour: DVec3,
        short: bool,
        on: &[LightOn<'_>],
        scales: &[Scale],
    ) {
        let reaching = || on.iter().filter(|light| light.reaches);
        let weights = |light: &LightOn<'_>| light.weights(Scale::Linear, colour);
        let light: DVec3 = reaching().map(weights).sum();
        // Those that do not reach it may be kept.
        let fits = fits && light::is_in_f32(on.iter().map(weights).sum());
        let idle = on.iter().filter(|light| !light.reaches && !light.is_dark()).count();
        self.leave_out(Omission::IdleLights, idle);
        let lit = reaching().next().is_some();
        let mut made = |omission, possible| possible && self.leave_out(omission, 1);
        let shading = Shading {
            unlit: made(Omission::Unlit, !lit),
            grey: made(Omission::Channels, short && light.x == light.y && light.y == light.z),
        };
        let start = self.lits[scales[0] as usize].len();
        let mut end = start;
        // The short form has its light in it.
        if !short {
            let keep = self.keep;
            for scale in scales {
                let lits = &mut self.lits[*scale as usize];
                lits.extend(on.iter().filter(|light| light.is_kept(keep)).map(|light| light.record(*scale, colour)));
                end = lits.len();
            }
        }
        self.objects.push(Object { source, rows, fits, shape, lits: start..end, shading });
    }

    /// What is not left out.
    pub fn keep(&self) -> Keep {
        self.keep
    }

    /// How much of an object, a light or its shading is left out, or would be but for [`Spans::keep`].
    pub fn left_out(&self, omission: Omission) -> u64 {
        self.left_out[omission as usize]
    }

    /// Spheres and triangles that are kept.
    pub fn counts(&self) -> (usize, usize) {
        let spheres = self.objects.iter().filter(|object| matches!(object.shape, Shape::Sphere(_))).count();
        (spheres, self.objects.len() - spheres)
    }

    /// Pixels of the picture.
    pub fn pixels(&self) -> u64 {
        self.camera.pixels()
    }

    /// Rays of a row against all objects.
    pub fn tests_in_row(&self) -> u64 {
        u64::from(self.camera.width()) * self.objects.len() as u64
    }

    /// Each row with the objects that it may see, in the scene's order.
    pub fn rows_and_objects(&self) -> impl Iterator<Item = (u32, Vec<usize>)> {
        let mut to_come: Vec<usize> = (0..self.objects.len()).collect();
        to_come.sort_by_key(|object| std::cmp::Reverse(self.objects[*object].rows.traced.start));
        let mut seen: Vec<usize> = Vec::new();
        (0..self.camera.height()).map(move |row| {
            seen.retain(|object| row < self.objects[*object].rows.traced.end);
            let before = seen.len();
            while let Some(object) = to_come.pop_if(|object| self.objects[*object].rows.traced.start <= row) {
                seen.push(object);
            }
            if seen.len() > before {
                seen.sort_unstable();
            }
            (row, seen.clone())
        })
    }

    /// The objects that some of `rows` may see, in the scene's order.
    pub fn seen_in(&self, rows: &Range<u32>) -> Vec<usize> {
        let meets = |object: &Object| object.rows.traced.start < rows.end && rows.start < object.rows.traced.end;
        (0..self.objects.len()).filter(|i| meets(&self.objects[*i])).collect()
    }

    /// The short form of an object, if it has one.
    pub fn short_form(&self, object: usize) -> Option<&ShortForm> {
        match &self.objects[object].shape {
            Shape::Sphere(sphere) => sphere.short.as_deref(),
            Shape::Triangle(_) | Shape::Nothing => None,
        }
    }

    /// 1/t of the camera's rays over what `depth` of the kernels writes.
    pub fn depth_unit(&self) -> f64 {
        self.depth_unit
    }

    /// Which of the scene's objects it is.
    pub fn source(&self, object: usize) -> scene::Object {
        self.objects[object].source
    }

    /// The unit normal of a triangle, on the side that is seen; None of a sphere, which has many.
    pub fn normal(&self, object: usize) -> Option<DVec3> {
        match &self.objects[object].shape {
            Shape::Triangle(triangle) => Some(-triangle.plane.normalize()),
            Shape::Sphere(_) | Shape::Nothing => None,
        }
    }

    /// Whether any object's numbers are beyond f32, so that there are rows to trace in f64.
    pub fn any_wide(&self) -> bool {
        !self.wide.is_empty()
    }

    /// Whether `row` may see an object whose numbers are beyond f32.
    pub fn is_wide(&self, row: u32) -> bool {
        self.wide.iter().any(|rows| rows.contains(&row))
    }

    /// The lights of an object, as weighted for a scale that was asked for.
    pub fn lits(&self, object: usize, scale: Scale) -> &[ObjectLight<E>] {
        &self.lits[scale as usize][self.objects[object].lits.clone()]
    }

    /// What the shading of an object leaves out.
    #[inline]
    pub fn shading(&self, object: usize) -> Shading {
        self.objects[object].shading
    }

    /// The spans of a row among the objects `seen`, and how they are to be traced: sorted from left to right if apart,
    /// else in the scene's order, in which the first of equals is the nearest.
    pub fn spans_in(&self, row: u32, seen: &[usize], in_row: &mut RowSpans) -> Way {
        let spans = &mut in_row.spans;
        spans.clear();
        if self.keep.has(Omission::Misses) {
            let nothing = |object| RowSpan { object, start: 0, end: 0, origin: 0, silhouette: Silhouette::default() };
            spans.extend(seen.iter().map(|&object| self.row(object, row).unwrap_or_else(|| nothing(object))));
            return Way::NearestInRow;
        }
        spans.extend(seen.iter().filter_map(|object| self.row(*object, row)));
        let apart = in_row.are_apart() || !self.keep.has(Omission::Depths) && self.cut_hidden(row, in_row);
        if apart && !self.keep.has(Omission::Search) {
            return Way::Apart;
        }
        if apart {
            in_row.spans.sort_unstable_by_key(|span| span.object);
        }
        Way::Nearest
    }

    /// The object of `seen` that has all pixels of its spans to itself since there is no other.
    pub fn alone(&self, seen: &[usize]) -> Option<usize> {
        let searches = self.keep.has(Omission::Search) || self.keep.has(Omission::Misses);
        if let ([object], false) = (seen, searches) { Some(*object) } else { None }
    }

    /// The pixels of `row` that `object` covers, if any.
    #[inline]
    pub fn row(&self, object: usize, row: u32) -> Option<RowSpan> {
        let Object { rows, shape, .. } = &self.objects[object];
        if !rows.traced.contains(&row) {
            return None;
        }
        let width = self.camera.width();
        // 1/t of a triangle is w1 j + w0: both terms are positive, and so exact but for two roundings, where j counts
        // from the farthest pixel.
        let mut from_end = None;
        let (columns, silhouette) = match shape {
            Shape::Sphere(sphere) if sphere.k < 0.0 => (0..width, Silhouette::default()),
            Shape::Sphere(sphere) if sphere.k == 0.0 => (sphere.half(&self.grid, row, width), Silhouette::default()),
            Shape::Sphere(sphere) => {
                let [_, y, z] = self.grid.ray(row, 0);
                let silhouette = sphere.silhouette(y, z)?;
                (self.columns(silhouette.left, silhouette.right), silhouette)
            }
            Shape::Triangle(triangle) => {
                from_end = Some(triangle.plane.x < 0.0);
                (triangle.columns(&self.grid, row, width), Silhouette::default())
            }
            Shape::Nothing => return None,
        };
        let Range { start, end } = columns;
        if start >= end {
            return None;
        }
        let origin = match from_end {
            None => (start + end) / 2,
            Some(false) => start,
            Some(true) => end - 1,
        };
        Some(RowSpan { object, start, end, origin, silhouette })
    }

    /// Cuts spans of triangles where a nearer one covers them: 1/t is linear along a row, so that one which is nearer at
    /// both ends of what two share is nearer all over it. Gives whether no two spans share a pixel any more; false, with
    /// nothing changed, where that would take a look at each pixel.
    fn cut_hidden(&self, row: u32, in_row: &mut RowSpans) -> bool {
        let RowSpans { spans, visible, rest, .. } = in_row;
        if spans.len() > MOST_CUT {
            return false;
        }
        visible.clear();
        rest.clone_from(spans);
        while let Some(new) = rest.pop() {
            let Some(at) = visible.iter().position(|old| old.start < new.end && new.start < old.end) else {
                visible.push(new);
                continue;
            };
            let old = visible.swap_remove(at);
            let shared = old.start.max(new.start)..old.end.min(new.end);
            let Some(new_in_front) = self.in_front(row, &new, &old, &shared) else { return false };
            let (front, back) = if new_in_front { (new, old) } else { (old, new) };
            // What is left of the one behind may be hidden by others, and the one in front too.
            let (left, right) = (back.part(back.start..shared.start), back.part(shared.end..back.end));
            rest.extend([front, left, right].into_iter().filter(|span| span.start < span.end));
        }
        visible.sort_unstable_by_key(|span| span.start);
        std::mem::swap(spans, visible);
        true
    }

    /// Whether `a` is in front of `b` all over `shared`, or `b` in front of `a`; None where neither is known to be so
    /// clearly that the depths which kernels compute say the same.
    fn in_front(&self, row: u32, a: &RowSpan, b: &RowSpan, shared: &Range<u32>) -> Option<bool> {
        let (Shape::Triangle(one), Shape::Triangle(other)) =
            (&self.objects[a.object].shape, &self.objects[b.object].shape)
        else {
            return None;
        };
        // A kernel's w1 j + w0 has two constants, a product and a sum that are rounded, none larger than 2 reach; and
        // the constants come from f64.
        let slack = 8.0 * E::EPSILON * (one.reach + other.reach);
        let nearer = |col: u32| {
            let d = DVec3::from(self.grid.ray(row, col));
            let gap = one.plane.dot(d) - other.plane.dot(d);
            (gap.abs() > slack).then_some(gap > 0.0)
        };
        let first = nearer(shared.start)?;
        (nearer(shared.end - 1)? == first).then_some(first)
    }

    /// Lends the record from which a kernel shades a span of `row` in a scale, or finds its depth (None), with the span's
    /// `id` in it. Only shading has a short form.
    #[inline]
    pub fn with_record<U: UseRecord<E>>(
        &self,
        span: &RowSpan,
        row: u32,
        id: f64,
        scale: Option<Scale>,
        user: U,
    ) -> U::Result {
        let d = DVec3::from(self.grid.ray(row, span.origin));
        let (j, end) = (f64::from(span.start) - f64::from(span.origin), f64::from(span.end) - f64::from(span.origin));
        let step = self.grid.step;
        match &self.objects[span.object].shape {
            Shape::Sphere(sphere) if sphere.k <= 0.0 => {
                user.inside(&InsideSpan { j, end, id, ..sphere.inside(step, d) }.round())
            }
            Shape::Sphere(sphere) => match (&sphere.short, scale) {
                (Some(form), Some(scale)) => {
                    let row = sphere.lit_row(form.setup(scale), span, d);
                    user.lit(form, &LitRow { start: 0.0, end: end - j, id, ..row }.round())
                }
                _ if sphere.k < NEAR => {
                    user.near(&NearSpan { j, end, id, ..sphere.near(step, d, &span.silhouette) }.round())
                }
                _ => user.outside(&OutsideSpan { j, end, id, ..sphere.outside(step, d, &span.silhouette) }.round()),
            },
            Shape::Triangle(triangle) => {
                user.triangle(&TriangleSpan { j, end, id, ..triangle.record(step, d) }.round())
            }
            Shape::Nothing => user.triangle(&TriangleSpan { j, end, id, ..TriangleSpan::default() }.round()),
        }
    }

    /// The columns whose rays have x from `left` to `right`.
    fn columns(&self, left: f64, right: f64) -> Range<u32> {
        let (offset, width) = (self.grid.half_width, self.camera.width());
        let column = |x: f64| (x + offset) * self.columns_per_x - 0.5;
        // Casts saturate: what is left of the picture is column 0, and a NaN too.
        let (start, end) = (column(left), column(right));
        let (first, last) = (start as u32, end as u32);
        let start = if start > f64::from(first) { first.saturating_add(1) } else { first };
        let end = if end >= 0.0 { last.saturating_add(1) } else { 0 };
        start.min(width)..end.min(width)
    }
}

/// Whether an object is beyond one of the four planes that border all rays of the picture and a pixel more on each side:
/// `beyond` says so of one, by its inward normal.
fn beside(grid: &Grid<f64>, beyond: impl Fn(DVec3) -> bool) -> bool {
    let (across, up) = (grid.half_width + grid.step, grid.half_height + grid.step);
    let f = grid.focal;
    [DVec3::new(f, 0.0, across), DVec3::new(-f, 0.0, across), DVec3::new(0.0, f, up), DVec3::new(0.0, -f, up)]
        .into_iter()
        .any(beyond)
}

/// The rows whose rays have y from `low` to `high`, and one more on each side for the rounding.
fn rows(grid: &Grid<f64>, height: u32, low: f64, high: f64) -> Option<Range<u32>> {
    let row = |y: f64| (grid.half_height - y) / grid.step - 0.5;
    let rows = (row(high).floor() - 1.0) as u32..((row(low).ceil() + 2.0) as u32).min(height);
    (rows.start < rows.end).then_some(rows)
}

/// Where a row's rays cross the silhouette of a sphere: those with x from `left` to `right`, either of them infinite if
/// the sphere reaches behind the camera's plane.
#[derive(Clone, Copy, Debug, Default)]
struct Silhouette {
    left: f64,
    right: f64,
    /// h at x = 0.
    h: f64,
    /// D(x) = sign (q - m x) sign (x + p), both factors at least 0 on the silhouette.
    m: f64,
    q: f64,
    p: f64,
    sign: f64,
}

impl ShortForm {
    /// Of a sphere under one light; None where its terms would cancel too much, or where it would have to clamp.
    fn new<E: Element>(
        sphere: &Sphere,
        light: &LightOn<'_>,
        colour: DVec3,
        grid: &Grid<f64>,
        camera: &Camera,
    ) -> Option<Self> {
        let (c, k, towards) = (sphere.centre, sphere.k, light.to_light);
        let (far, distance) = (c.length(), towards.length());
        let (kn, ke) = (-1.0 - c.dot(towards), distance * distance - 1.0);
        // k w + kn c, which is the length of c times smaller than its terms.
        let v = c.cross(towards.cross(c)) - towards - c;
        let (gap, terms) = (distance - 1.0, 3.0 * distance + 1.0);
        let loss = f64::max(terms / gap, (ke + 2.0 * terms) / (gap * gap));
        let m = c.y * c.y + c.z * c.z - 1.0;
        let columns = 1.0 / grid.step;
        // sqrt(k (g - across^2)) / m is half the width of the silhouette.
        let [_, y, z] = grid.ray(0, 0);
        let half_width = (k * (y * y + z * z)).sqrt() / m * columns;
        let dim = light.weights(Scale::Linear, colour).max_element() <= 1.0;
        let gain = Scale::ALL.map(|scale| 0.25 * light.weights(scale, colour).max_element().powi(2));
        // sqrt D is so many sqrt p.
        let pixel = m.sqrt() * grid.step;
        // Of the square of a half of the silhouette so little is less than p's rounding; of a row's, less than a column.
        let least = (E::EPSILON / 32.0 * (grid.focal / pixel).powi(2)).min(0.5);
        let reach = grid.half_width.hypot(grid.half_height).hypot(grid.focal);
        // A bound of (ke den - n) den / p.
        let largest = 16.0 * gain[1] * (distance * far * reach / pixel).powi(2) / least;
        let in_range = [far, distance, 1.0 / grid.focal, 1.0 / gain[0]].into_iter().all(|x| x < CUBED)
            && E::from_f64(largest).to_f64().is_finite();
        let fine = k >= NEAR && gap > 0.0 && loss < SHORT_FORM_LOSS && m > 0.0 && dim && in_range;
        if !(fine && half_width < SHORT_FORM_COLUMNS && camera.width() <= SHORT_FORM_WIDTH) {
            return None;
        }
        let setups = gain.map(|gain| LitSetup {
            step: grid.step,
            half_width: grid.half_width,
            half_height: grid.half_height,
            columns,
            width: camera.width().into(),
            cx: c.x,
            cy: c.y,
            cz: c.z,
            k,
            m,
            nx: 1.0 - c.x * c.x,
            zz: z * z,
            cyz: c.y * z,
            czz: c.z * z,
            h: 1.0 / pixel,
            q: 2.0 * gain / pixel,
            vx: v.x,
            vy: v.y,
            vzz: v.z * z,
        });
        let weights = light.weights(Scale::Linear, colour);
        let relative = if weights == DVec3::ZERO { weights } else { weights / weights.max_element() };
        let spheres = Scale::ALL.map(|scale| {
            let (setup, gain) = (&setups[scale as usize], gain[scale as usize]);
            LitSphere {
                h1: setup.cx * grid.step * setup.h,
                least,
                q1: setup.vx * grid.step * setup.q,
                kn: 2.0 * gain * kn,
                ke: gain * ke,
                red: relative.x,
                green: relative.y,
                blue: relative.z,
            }
        });
        Some(ShortForm { setups, spheres })
    }

    /// What its rows are made of.
    pub fn setup(&self, scale: Scale) -> &LitSetup<f64> {
        &self.setups[scale as usize]
    }

    /// What its rows share.
    pub fn sphere(&self, scale: Scale) -> &LitSphere<f64> {
        &self.spheres[scale as usize]
    }
}

impl Sphere {
    fn new(centre: DVec3, radius: f64, unit: f64) -> Self {
        let k = geometry::power(centre, radius) / (radius * radius);
        let scale = power_of_two(k.max(1.0).sqrt());
        Sphere { centre: centre / radius, k, scale, depth: 1.0 / (radius * unit * scale), short: None }
    }

    /// Whether f32 holds the numbers of its records and their squares.
    fn fits(&self) -> bool {
        self.k < LINEAR
    }

    /// The rays that may see it: those that its silhouette, an ellipse if it is in front of the camera's plane, reaches;
    /// or why there are none.
    fn seen(&self, grid: &Grid<f64>, camera: &Camera) -> Result<Range<u32>, Omission> {
        let DVec3 { y: cy, z: cz, .. } = self.centre;
        if cz <= -1.0 {
            return Err(Omission::Behind);
        }
        if self.k > 0.0 && beside(grid, |normal| self.centre.dot(normal) < -normal.length()) {
            return Err(Omission::Outside);
        }
        if self.k <= 0.0 || cz <= 1.0 {
            return Ok(0..camera.height());
        }
        // |c y f - c z y| <= sqrt(y^2 + f^2), solved for y.
        let m = cz * cz - 1.0;
        let root = (cy * cy + m).sqrt();
        let (low, high) = (grid.focal * (cy * cz - root) / m, grid.focal * (cy * cz + root) / m);
        rows(grid, camera.height(), low, high).ok_or(Omission::Outside)
    }

    /// Eq. 5's discriminant along a row, D(x) = (d . c)^2 - k d . d = -m x^2 + 2 b x + c0, and its roots.
    ///
    /// b^2 + m c0 = k (g^2 - (c x d)_x^2), which does not cancel for far spheres, and is k (h^2 - m g), which cancels less
    /// for near ones.
    fn silhouette(&self, y: f64, z: f64) -> Option<Silhouette> {
        let c = self.centre;
        let g = y * y + z * z;
        let h = c.y * y + c.z * z;
        let (m, c0, disc) = if self.k < NEAR {
            // Near by, k = |c|^2 - 1 is small and known to all of f64; what is small for its sake is made of it.
            let m = self.k - c.x * c.x;
            (m, h * h - self.k * g, self.k * (h * h - m * g))
        } else {
            let across = c.y * z - c.z * y;
            let m = c.y * c.y + c.z * c.z - 1.0;
            (m, (1.0 - c.x * c.x) * g - across * across, self.k * (g - across * across))
        };
        if disc.is_nan() || disc < 0.0 {
            return None;
        }
        let b = c.x * h;
        let q = b + disc.sqrt().copysign(b);
        let p = if q == 0.0 { 0.0 } else { c0 / q };
        if m > 0.0 {
            let (one, other) = (q / m, -p);
            let (left, right) = if one < other { (one, other) } else { (other, one) };
            let in_front = h + c.x * (0.5 * (left + right)) > 0.0;
            in_front.then_some(Silhouette { left, right, h, m, q, p, sign: if q < 0.0 { -1.0 } else { 1.0 } })
        } else {
            // The row leaves the cone of the sphere on one side only: where x has the sign of the centre's.
            let (one, other) = if m == 0.0 { (-p, -p) } else { (q / m, -p) };
            if m == 0.0 && h <= 0.0 {
                return None;
            }
            let right_open = c.x > 0.0;
            let left = if right_open { one.max(other) } else { f64::NEG_INFINITY };
            let right = if right_open { f64::INFINITY } else { one.min(other) };
            let sign = if right_open { 1.0 } else { -1.0 };
            Some(Silhouette { left, right, h, m, q, p, sign })
        }
    }

    /// The columns of a row whose rays leave a sphere that the camera is on: those ahead of it.
    fn half(&self, grid: &Grid<f64>, row: u32, width: u32) -> Range<u32> {
        let ahead = |col: u32| self.centre.dot(grid.ray(row, col).into()) > 0.0;
        if self.centre.x > 0.0 { partition(width, |col| !ahead(col))..width } else { 0..partition(width, ahead) }
    }

    fn near(&self, step: f64, d: DVec3, s: &Silhouette) -> NearSpan<f64> {
        let OutsideSpan { depth, a1, a0, b1, b0, h1, h0, cx, cy, cz, .. } = self.outside(step, d, s);
        let (j, end, id) = (0.0, 0.0, 0.0);
        let DVec3 { x: x0, y, z } = self.scale * d;
        NearSpan { j, end, id, depth, a1, a0, b1, b0, h1, h0, x1: self.scale * step, x0, y, z, cx, cy, cz }
    }

    fn outside(&self, step: f64, d: DVec3, s: &Silhouette) -> OutsideSpan<f64> {
        let c = self.centre;
        // Scaled so that h + sqrt D is 1/t, and that is near 1.
        let scale = s.sign / self.k;
        let (step, d, h, q, p) =
            (self.scale * step, self.scale * d, self.scale * s.h, self.scale * s.q, self.scale * s.p);
        let (h1, h0) = (c.x * step / self.k, (h + c.x * d.x) / self.k);
        let at_middle = d - h0 * c;
        OutsideSpan {
            j: 0.0,
            end: 0.0,
            id: 0.0,
            depth: self.depth,
            a1: -s.m * step * scale,
            a0: (q - s.m * d.x) * scale,
            b1: step * scale,
            b0: (d.x + p) * scale,
            h1,
            h0,
            x1: step - h1 * c.x,
            x0: at_middle.x,
            y1: -h1 * c.y,
            y0: at_middle.y,
            z1: -h1 * c.z,
            z0: at_middle.z,
            cx: c.x,
            cy: c.y,
            cz: c.z,
        }
    }

    /// A row of the short form; d is the ray at the span's origin. Kernels make many of them by the same operations, see
    /// asm/tracers/lit_rows.asm.
    fn lit_row(&self, setup: &LitSetup<f64>, span: &RowSpan, d: DVec3) -> LitRow<f64> {
        let s = &span.silhouette;
        let [start, end, origin] = [span.start, span.end, span.origin].map(f64::from);
        let half_width = 0.5 * (s.right - s.left) * setup.columns;
        LitRow {
            start,
            end,
            j: start - origin,
            stop: end - origin,
            m: (0.5 * (s.left + s.right) - d.x) * setup.columns,
            a: half_width * half_width,
            h0: (s.h + setup.cx * d.x) * setup.h,
            q0: (setup.vx * d.x + setup.vy * d.y + setup.vzz) * setup.q,
            id: 0.0,
        }
    }

    fn inside(&self, step: f64, d: DVec3) -> InsideSpan<f64> {
        let c = self.centre;
        InsideSpan {
            j: 0.0,
            end: 0.0,
            id: 0.0,
            depth: self.depth,
            x1: step,
            x0: d.x,
            y: d.y,
            z: d.z,
            g: d.y * d.y + d.z * d.z,
            h1: c.x * step,
            h0: c.dot(d),
            k: -self.k,
            cx: c.x,
            cy: c.y,
            cz: c.z,
        }
    }
}

/// The rows that may see a triangle: those between its projected vertices, or all if one is not in front of the camera;
/// or why there are none.
fn seen_of_triangle(vertices: [DVec3; 3], grid: &Grid<f64>, camera: &Camera) -> Result<Range<u32>, Omission> {
    if vertices.iter().all(|v| v.z <= 0.0) {
        Err(Omission::Behind)
    } else if beside(grid, |normal| vertices.iter().all(|v| v.dot(normal) < 0.0)) {
        Err(Omission::Outside)
    } else if vertices.iter().any(|v| v.z <= 0.0) {
        Ok(0..camera.height())
    } else {
        let y = vertices.map(|v| grid.focal * (v.y / v.z));
        let (low, high) = (y[0].min(y[1]).min(y[2]), y[0].max(y[1]).max(y[2]));
        rows(grid, camera.height(), low, high).ok_or(Omission::Outside)
    }
}

impl Triangle {
    /// With its unit normal. A triangle of no area or whose plane passes through the camera is never hit: the rule and
    /// the order of operations are those of `reference::geometry::triangle`.
    fn new(vertices: [DVec3; 3], unit: f64, grid: &Grid<f64>) -> Result<(Self, DVec3), Omission> {
        let [v1, v2, v3] = geometry::near_corner_first(vertices);
        let n = geometry::triangle_plane([v1, v2, v3]);
        let Some(volume) = geometry::triangle_volume([v1, v2, v3]) else {
            return Err(if geometry::has_no_area([v1, v2, v3]) { Omission::NoArea } else { Omission::EdgeOn });
        };
        let edges = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| v.cross(w) * volume.signum());
        let plane = n / volume;
        // From the camera, P = t d is as exact as from a vertex that is as far from P as the camera is.
        let far = (v2 - v1).length().max((v3 - v1).length()) < SMALL_TRIANGLE * v1.length();
        let origin = if far { v1 } else { DVec3::ZERO };
        // Of P, or of the way to the plane.
        let size = if far { v1.abs().max_element() } else { 1.0 / plane.length() };
        // A power of two, so that 1/t is the same for all triangles of a plane and the first of them wins a tie.
        let size = power_of_two(size);
        let reach = plane.abs().dot(DVec3::new(grid.half_width, grid.half_height, grid.focal));
        Ok((Triangle { edges, origin, plane, size, depth: 1.0 / (size * unit), reach }, n.normalize()))
    }

    /// Whether f32 holds the numbers of its records and their squares.
    fn fits(&self, vertices: &[DVec3; 3]) -> bool {
        let furthest = vertices.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
        furthest < SQUARED * self.size
    }

    /// The columns of a row whose rays are between the edges.
    ///
    /// Which side of an edge a ray is on is the sign of one dot product, the reference's own, at the pixel itself: the
    /// two triangles at an edge see exactly opposite numbers, so that no pixel between them is lost. The root only says
    /// where to look for the change of sign.
    fn columns(&self, grid: &Grid<f64>, row: u32, width: u32) -> Range<u32> {
        let mut columns = 0..width;
        for edge in self.edges {
            let inside = |col: u32| edge.dot(grid.ray(row, col).into()) >= 0.0;
            let [_, y, z] = grid.ray(row, 0);
            let root = ((-(edge.y * y + edge.z * z) / edge.x + grid.half_width) / grid.step - 0.5).ceil();
            let guess = root.clamp(0.0, width.into()) as u32;
            let changes_at = |col: u32, rising: bool| {
                (col == 0 || inside(col - 1) != rising) && (col == width || inside(col) == rising)
            };
            if edge.x > 0.0 {
                let start = if changes_at(guess, true) { guess } else { partition(width, |col| !inside(col)) };
                columns.start = columns.start.max(start);
            } else if edge.x < 0.0 {
                // A ray on the edge is inside, so the first one outside may be one further.
                let end = [guess, (guess + 1).min(width)].into_iter().find(|col| changes_at(*col, false));
                columns.end = columns.end.min(end.unwrap_or_else(|| partition(width, inside)));
            } else if !inside(0) {
                return 0..0;
            }
        }
        columns
    }

    fn record(&self, step: f64, d: DVec3) -> TriangleSpan<f64> {
        let (w1, w0) = (self.plane.x * step, self.plane.dot(d));
        let at_middle = d - w0 * self.origin;
        TriangleSpan {
            j: 0.0,
            end: 0.0,
            id: 0.0,
            depth: self.depth,
            w1: w1 * self.size,
            w0: w0 * self.size,
            x1: step - w1 * self.origin.x,
            x0: at_middle.x,
            y1: -w1 * self.origin.y,
            y0: at_middle.y,
            z1: -w1 * self.origin.z,
            z0: at_middle.z,
        }
    }
}

/// The first column for which `before` does not hold, if it holds for all columns up to one and for none after.
fn partition(width: u32, before: impl Fn(u32) -> bool) -> u32 {
    let mut columns = 0..width;
    while columns.start < columns.end {
        let middle = columns.start + (columns.end - columns.start) / 2;
        if before(middle) {
            columns.start = middle + 1;
        } else {
            columns.end = middle;
        }
    }
    columns.start
}
