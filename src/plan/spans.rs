//! Spans: which pixels of a row each object covers, and the records from which packet kernels shade them.
//!
//! Everything here is f64, in closed form, once per object or once per object and row. The rays that meet a convex
//! object through the pixels of one row are consecutive, so a span is two columns. Kernels then never ask whether a ray
//! hits, and what cancels in f32 (far spheres, far triangles) is subtracted here.

use std::ops::Range;

use glam::DVec3;

use crate::kernels::{Element, InsideSpan, Lit, LitSpan, OutsideSpan, TriangleSpan};
use crate::scene::{Camera, Grid, Light, Scene};

/// The short form loses about as many bits as this number has; f32 then still keeps an error below a tenth of a level.
const SHORT_FORM_LOSS: f64 = 64.0;

/// A row of more spans than this is left to the depth of each pixel.
const MOST_CUT: usize = 16;

/// A scene's objects as one camera sees them.
pub struct Spans<E> {
    camera: Camera,
    grid: Grid<f64>,
    /// 1 / grid.step.
    columns_per_x: f64,
    objects: Vec<Object<E>>,
}

/// An object that some row of the picture may see.
struct Object<E> {
    rows: Range<u32>,
    shape: Shape,
    /// Its lights, weighted for floats.
    lits: Vec<Lit<E>>,
}

enum Shape {
    Sphere(Sphere),
    Triangle(Triangle),
}

/// A sphere in units of its radius.
struct Sphere {
    centre: DVec3,
    /// |c|^2 - 1: negative for a camera inside.
    k: f64,
    radius: f64,
    short: Option<ShortForm>,
}

/// The constants of the short form, SPHERE_LIT.
struct ShortForm {
    /// From the centre to the light.
    light: DVec3,
    /// What sqrt D is over the root of (j - left) (right - j), in units of x.
    slope: f64,
    kn: f64,
    ke: f64,
    weights: DVec3,
}

struct Triangle {
    /// The planes through the camera and each edge; a ray inside is on the positive side of all or on one of them.
    edges: [DVec3; 3],
    vertex: DVec3,
    /// n / (n . v): 1/t is its product with the ray.
    plane: DVec3,
    size: f64,
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
    /// For a sphere seen from outside.
    silhouette: Silhouette,
}

/// What to do with a span's record: one method for each kernel that there is.
///
/// Records are lent and not returned, so that they stay where their fields were rounded to: a copy would be read in wider
/// pieces than it was written in, and wait for those writes to leave the CPU's store buffer.
pub trait UseRecord<E> {
    /// What comes of it.
    type Result;
    /// A sphere from outside under one light, in the short form.
    fn lit(self, record: &LitSpan<E>) -> Self::Result;
    /// A sphere from outside.
    fn outside(self, record: &OutsideSpan<E>) -> Self::Result;
    /// A sphere from inside.
    fn inside(self, record: &InsideSpan<E>) -> Self::Result;
    /// A triangle.
    fn triangle(self, record: &TriangleSpan<E>) -> Self::Result;
}

impl<E: Element> Spans<E> {
    /// Plans `scene` for `camera`; `white` is what full light is in the output: 1, or 255 for bytes.
    pub fn new(scene: &Scene, camera: &Camera, white: f64) -> Self {
        let grid = camera.grid::<f64>();
        let lights = &scene.lights[..];
        let spheres = scene.spheres.iter().filter_map(|sphere| {
            let colour = white * sphere.colour.as_dvec3();
            let shape = Sphere::new(sphere.centre.as_dvec3(), sphere.radius.into(), colour, white, lights);
            let rows = shape.rows(&grid, camera.height())?;
            let lits = lights.iter().map(|light| {
                lit((light.position.as_dvec3() - sphere.centre.as_dvec3()) / shape.radius, 0.0, colour, light)
            });
            Some(Object { rows, lits: lits.collect(), shape: Shape::Sphere(shape) })
        });
        let triangles = scene.triangles.iter().filter_map(|triangle| {
            let vertices = triangle.vertices.map(|v| v.as_dvec3());
            let colour = white * triangle.colour.as_dvec3();
            let (shape, normal) = Triangle::new(vertices)?;
            let rows = rows_of_triangle(vertices, &grid, camera.height())?;
            let lits = lights.iter().map(|light| {
                let to_light = (light.position.as_dvec3() - shape.vertex) / shape.size;
                lit(to_light, normal.dot(to_light).abs(), colour, light)
            });
            Some(Object { rows, lits: lits.collect(), shape: Shape::Triangle(shape) })
        });
        Spans { camera: *camera, grid, columns_per_x: 1.0 / grid.step, objects: spheres.chain(triangles).collect() }
    }

    /// The objects that some of `rows` may see, in the scene's order.
    pub fn seen_in(&self, rows: &Range<u32>) -> Vec<usize> {
        let meets = |object: &Object<E>| object.rows.start < rows.end && rows.start < object.rows.end;
        (0..self.objects.len()).filter(|i| meets(&self.objects[*i])).collect()
    }

    /// The lights of an object.
    pub fn lits(&self, object: usize) -> &[Lit<E>] {
        &self.objects[object].lits
    }

    /// The pixels of `row` that `object` covers, if any.
    #[inline]
    pub fn row(&self, object: usize, row: u32) -> Option<RowSpan> {
        let Object { rows, shape, .. } = &self.objects[object];
        if !rows.contains(&row) {
            return None;
        }
        let width = self.camera.width();
        let (columns, silhouette) = match shape {
            Shape::Sphere(sphere) if sphere.k <= 0.0 => (0..width, Silhouette::default()),
            Shape::Sphere(sphere) => {
                let [_, y, z] = self.grid.ray(row, 0);
                let silhouette = sphere.silhouette(y, z)?;
                (self.columns(silhouette.left, silhouette.right), silhouette)
            }
            Shape::Triangle(triangle) => (triangle.columns(&self.grid, row, width), Silhouette::default()),
        };
        let Range { start, end } = columns;
        (start < end).then_some(RowSpan { object, start, end, silhouette })
    }

    /// Cuts spans of triangles where a nearer one covers them: 1/t is linear along a row, so that one which is nearer at
    /// both ends of what two share is nearer all over it. Gives whether no two spans share a pixel any more; false, with
    /// nothing changed, where that would take a look at each pixel.
    pub fn cut_hidden(&self, row: u32, spans: &mut Vec<RowSpan>) -> bool {
        if spans.len() > MOST_CUT {
            return false;
        }
        let mut visible: Vec<RowSpan> = Vec::with_capacity(2 * spans.len());
        let mut rest = spans.clone();
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
            let left = RowSpan { end: shared.start, ..back };
            let right = RowSpan { start: shared.end, ..back };
            rest.extend([front, left, right].into_iter().filter(|span| span.start < span.end));
        }
        visible.sort_unstable_by_key(|span| span.start);
        *spans = visible;
        true
    }

    /// Whether `a` is in front of `b` all over `shared`, or `b` in front of `a`; None where neither is known to be.
    fn in_front(&self, row: u32, a: &RowSpan, b: &RowSpan, shared: &Range<u32>) -> Option<bool> {
        let (Shape::Triangle(one), Shape::Triangle(other)) =
            (&self.objects[a.object].shape, &self.objects[b.object].shape)
        else {
            return None;
        };
        let nearer = |col: u32| {
            let d = DVec3::from(self.grid.ray(row, col));
            let (one, other) = (one.plane.dot(d), other.plane.dot(d));
            // The first of equals is in front.
            if a.object < b.object { one >= other } else { one > other }
        };
        let (first, last) = (nearer(shared.start), nearer(shared.end - 1));
        (first == last).then_some(first)
    }

    /// Lends the record from which a kernel shades a span of `row`, with the span's `id` in it; in the short form if
    /// `short` and the object has one.
    #[inline]
    pub fn with_record<U: UseRecord<E>>(&self, span: &RowSpan, row: u32, id: f64, short: bool, user: U) -> U::Result {
        // j counts from a pixel in the middle of the span.
        let middle = (span.start + span.end) / 2;
        let d = DVec3::from(self.grid.ray(row, middle));
        let (j, end) = (f64::from(span.start) - f64::from(middle), f64::from(span.end) - f64::from(middle));
        let step = self.grid.step;
        match &self.objects[span.object].shape {
            Shape::Sphere(sphere) if sphere.k <= 0.0 => {
                user.inside(&InsideSpan { j, end, id, ..sphere.inside(step, d) }.round())
            }
            Shape::Sphere(sphere) => match &sphere.short {
                Some(form) if short => {
                    let record = sphere.lit(form, step, self.columns_per_x, d, &span.silhouette);
                    user.lit(&LitSpan { j, end, id, ..record }.round())
                }
                _ => user.outside(&OutsideSpan { j, end, id, ..sphere.outside(step, d, &span.silhouette) }.round()),
            },
            Shape::Triangle(triangle) => {
                user.triangle(&TriangleSpan { j, end, id, ..triangle.record(step, d) }.round())
            }
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

/// One light on one object: `to_light` and `cosine` as in the record, the object's colour as it is weighted.
pub(super) fn lit<E: Element>(to_light: DVec3, cosine: f64, colour: DVec3, light: &Light) -> Lit<E> {
    let weights = weights(light, colour);
    Lit {
        x: to_light.x,
        y: to_light.y,
        z: to_light.z,
        cosine,
        red: weights.x,
        green: weights.y,
        blue: weights.z,
        padding: 0.0,
    }
    .round()
}

/// I_L C, finite in f32 too: an infinite weight would make a NaN of a cosine of 0.
pub(super) fn weights(light: &Light, colour: DVec3) -> DVec3 {
    (light.radiance().as_dvec3() * colour).min(DVec3::splat(f32::MAX.into()))
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

impl Sphere {
    fn new(centre: DVec3, radius: f64, colour: DVec3, white: f64, lights: &[Light]) -> Self {
        let k = (centre.dot(centre) - radius * radius) / (radius * radius);
        let c = centre / radius;
        let short = match lights {
            [light] if k > 0.0 => {
                let l = light.position.as_dvec3() / radius;
                let light_from_centre = (light.position.as_dvec3() - centre) / radius;
                let (kn, ke) = (k - c.dot(l), l.dot(l) - k);
                let (far, gap) = (c.length() + 1.0, light_from_centre.length() - 1.0);
                let products = far * light_from_centre.length();
                let loss = f64::max((kn.abs() + products) / gap, (ke.abs() + 2.0 * products) / (gap * gap));
                let weights = 0.5 * weights(light, colour);
                let slope = (c.y * c.y + c.z * c.z - 1.0).sqrt();
                // It does not clamp.
                let dim = weights.max_element() <= 0.5 * white;
                let fine = gap > 0.25 && loss < SHORT_FORM_LOSS && slope > 0.0 && dim;
                fine.then_some(ShortForm { light: light_from_centre, slope, kn, ke, weights })
            }
            _ => None,
        };
        Sphere { centre: c, k, radius, short }
    }

    /// The rows that may see it: those that its silhouette, an ellipse if it is in front of the camera's plane, reaches.
    fn rows(&self, grid: &Grid<f64>, height: u32) -> Option<Range<u32>> {
        let DVec3 { y: cy, z: cz, .. } = self.centre;
        if cz <= -1.0 {
            return None;
        }
        if self.k <= 0.0 || cz <= 1.0 {
            return Some(0..height);
        }
        // |c y f - c z y| <= sqrt(y^2 + f^2), solved for y.
        let m = cz * cz - 1.0;
        let root = (cy * cy + m).sqrt();
        rows(grid, height, grid.focal * (cy * cz - root) / m, grid.focal * (cy * cz + root) / m)
    }

    /// Eq. 5's discriminant along a row, D(x) = (d . c)^2 - k d . d = -m x^2 + 2 b x + c0, and its roots.
    ///
    /// b^2 + m c0 = k (g^2 - (c x d)_x^2), which does not cancel for far spheres.
    fn silhouette(&self, y: f64, z: f64) -> Option<Silhouette> {
        let c = self.centre;
        let g = y * y + z * z;
        let across = c.y * z - c.z * y;
        let disc = self.k * (g - across * across);
        if disc.is_nan() || disc < 0.0 {
            return None;
        }
        let h = c.y * y + c.z * z;
        let m = c.y * c.y + c.z * c.z - 1.0;
        let b = c.x * h;
        let c0 = (1.0 - c.x * c.x) * g - across * across;
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
            if m == 0.0 && b <= 0.0 {
                return None;
            }
            let right_open = c.x > 0.0;
            let left = if right_open { one.max(other) } else { f64::NEG_INFINITY };
            let right = if right_open { f64::INFINITY } else { one.min(other) };
            let sign = if m == 0.0 || right_open { 1.0 } else { -1.0 };
            Some(Silhouette { left, right, h, m, q, p, sign })
        }
    }

    fn outside(&self, step: f64, d: DVec3, s: &Silhouette) -> OutsideSpan<f64> {
        let c = self.centre;
        // Scaled so that h + sqrt D is 1/t.
        let scale = s.sign / self.k;
        let (h1, h0) = (c.x * step / self.k, (s.h + c.x * d.x) / self.k);
        let at_middle = d - h0 * c;
        OutsideSpan {
            j: 0.0,
            end: 0.0,
            id: 0.0,
            near: 1.0 / self.radius,
            a1: -s.m * step * scale,
            a0: (s.q - s.m * d.x) * scale,
            b1: step * scale,
            b0: (d.x + s.p) * scale,
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

    fn lit(&self, form: &ShortForm, step: f64, columns_per_x: f64, d: DVec3, s: &Silhouette) -> LitSpan<f64> {
        // Scaled so that sqrt D is the root of (j - left) (right - j).
        let scale = columns_per_x / form.slope;
        LitSpan {
            j: 0.0,
            end: 0.0,
            id: 0.0,
            near: 0.0,
            left: (s.left - d.x) * columns_per_x,
            right: (s.right - d.x) * columns_per_x,
            h1: self.centre.x * step * scale,
            h0: (s.h + self.centre.x * d.x) * scale,
            q1: 2.0 * self.k * form.light.x * step * scale,
            q0: 2.0 * self.k * form.light.dot(d) * scale,
            kn: 2.0 * form.kn,
            ke: form.ke,
            red: form.weights.x,
            green: form.weights.y,
            blue: form.weights.z,
        }
    }

    fn inside(&self, step: f64, d: DVec3) -> InsideSpan<f64> {
        let c = self.centre;
        InsideSpan {
            j: 0.0,
            end: 0.0,
            id: 0.0,
            near: 1.0 / self.radius,
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

/// The rows that may see a triangle: those between its projected vertices, or all if one is not in front of the camera.
fn rows_of_triangle(vertices: [DVec3; 3], grid: &Grid<f64>, height: u32) -> Option<Range<u32>> {
    if vertices.iter().all(|v| v.z <= 0.0) {
        None
    } else if vertices.iter().any(|v| v.z <= 0.0) {
        Some(0..height)
    } else {
        let y = vertices.map(|v| grid.focal * (v.y / v.z));
        rows(grid, height, y[0].min(y[1]).min(y[2]), y[0].max(y[1]).max(y[2]))
    }
}

impl Triangle {
    /// With its unit normal. None for a triangle of no area or whose plane passes through the camera, which is never
    /// hit: the rule and the order of operations are those of `reference::geometry::triangle`.
    fn new([v1, v2, v3]: [DVec3; 3]) -> Option<(Self, DVec3)> {
        let n = (v1 - v2).cross(v1 - v3);
        let volume = v1.dot(n);
        if volume.is_nan() || volume.abs() <= 4.0 * f64::EPSILON * v1.abs().dot(n.abs()) {
            return None;
        }
        let edges = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| v.cross(w) * volume.signum());
        // A power of two, so that 1/t is the same for all triangles of a plane and the first of them wins a tie.
        let size = 2f64.powi(v1.abs().max(v2.abs()).max(v3.abs()).max_element().log2() as i32);
        Some((Triangle { edges, vertex: v1, plane: n / volume, size }, n.normalize()))
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
        let at_middle = d - w0 * self.vertex;
        TriangleSpan {
            j: 0.0,
            end: 0.0,
            id: 0.0,
            near: 1.0 / self.size,
            w1: w1 * self.size,
            w0: w0 * self.size,
            x1: step - w1 * self.vertex.x,
            x0: at_middle.x,
            y1: -w1 * self.vertex.y,
            y0: at_middle.y,
            z1: -w1 * self.vertex.z,
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
