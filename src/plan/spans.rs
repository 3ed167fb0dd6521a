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

/// A scene's objects as one camera sees them.
pub struct Spans<E> {
    camera: Camera,
    grid: Grid<f64>,
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
    k0: f64,
    k1: f64,
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

/// The pixels of one row that one object covers, and what a kernel needs to shade them.
#[derive(Clone, Copy, Debug)]
pub struct RowSpan<E> {
    /// Which object, in the scene's order.
    pub object: usize,
    /// First column.
    pub start: u32,
    /// Column past the last.
    pub end: u32,
    /// The kernel's record; its `id` is 0.
    pub record: Record<E>,
}

/// A span record by the kernel that it is for.
#[derive(Clone, Copy, Debug)]
pub enum Record<E> {
    /// The short form, and the general one for where objects overlap.
    Lit(LitSpan<E>, OutsideSpan<E>),
    /// A sphere from outside.
    Outside(OutsideSpan<E>),
    /// A sphere from inside.
    Inside(InsideSpan<E>),
    /// A triangle.
    Triangle(TriangleSpan<E>),
}

impl<E: Element> Spans<E> {
    /// Plans `scene` for `camera`; `white` is what full light is in the output: 1, or 255 for bytes.
    pub fn new(scene: &Scene, camera: &Camera, white: f64) -> Self {
        let grid = camera.grid::<f64>();
        let lights = &scene.lights[..];
        let spheres = scene.spheres.iter().filter_map(|sphere| {
            let colour = white * sphere.colour.as_dvec3();
            let shape = Sphere::new(sphere.centre.as_dvec3(), sphere.radius.into(), colour, lights);
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
        Spans { camera: *camera, grid, objects: spheres.chain(triangles).collect() }
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
    pub fn row(&self, object: usize, row: u32) -> Option<RowSpan<E>> {
        let Object { rows, shape, .. } = &self.objects[object];
        if !rows.contains(&row) {
            return None;
        }
        let [_, y, z] = self.grid.ray(row, 0);
        let width = self.camera.width();
        let (columns, record) = match shape {
            Shape::Sphere(sphere) if sphere.k <= 0.0 => {
                let middle = width / 2;
                (0..width, Record::Inside(sphere.inside(&self.grid, self.ray(row, middle), middle, 0..width).round()))
            }
            Shape::Sphere(sphere) => {
                let silhouette = sphere.silhouette(y, z)?;
                let columns = columns(&self.grid, width, silhouette.left, silhouette.right);
                let middle = (columns.start + columns.end) / 2;
                let d = self.ray(row, middle);
                let general = sphere.outside(&self.grid, d, middle, &columns, &silhouette).round();
                let short = sphere.short.as_ref().filter(|_| silhouette.m > 0.0);
                let short = short.map(|form| sphere.lit(form, &self.grid, d, middle, &columns, &silhouette).round());
                (columns, short.map_or(Record::Outside(general), |short| Record::Lit(short, general)))
            }
            Shape::Triangle(triangle) => {
                let columns = triangle.columns(&self.grid, row, width);
                let middle = (columns.start + columns.end) / 2;
                let record = triangle.record(&self.grid, self.ray(row, middle), middle, &columns);
                (columns, Record::Triangle(record.round()))
            }
        };
        (columns.start < columns.end).then_some(RowSpan { object, start: columns.start, end: columns.end, record })
    }

    fn ray(&self, row: u32, col: u32) -> DVec3 {
        self.grid.ray(row, col).into()
    }
}

fn lit<E: Element>(to_light: DVec3, cosine: f64, colour: DVec3, light: &Light) -> Lit<E> {
    let weights = light.radiance().as_dvec3() * colour;
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

/// The columns whose rays have x from `left` to `right`.
fn columns(grid: &Grid<f64>, width: u32, left: f64, right: f64) -> Range<u32> {
    let column = |x: f64| (x + grid.half_width) / grid.step - 0.5;
    // Casts saturate: what is left of the picture is column 0, and a NaN too.
    let start = column(left).ceil() as u32;
    let end = (column(right).floor() + 1.0) as u32;
    start.min(width)..end.min(width)
}

/// The rows whose rays have y from `low` to `high`, and one more on each side for the rounding.
fn rows(grid: &Grid<f64>, height: u32, low: f64, high: f64) -> Option<Range<u32>> {
    let row = |y: f64| (grid.half_height - y) / grid.step - 0.5;
    let rows = (row(high).floor() - 1.0) as u32..((row(low).ceil() + 2.0) as u32).min(height);
    (rows.start < rows.end).then_some(rows)
}

/// Where a row's rays cross the silhouette of a sphere: those with x from `left` to `right`, either of them infinite if
/// the sphere reaches behind the camera's plane.
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
    fn new(centre: DVec3, radius: f64, colour: DVec3, lights: &[Light]) -> Self {
        let k = (centre.dot(centre) - radius * radius) / (radius * radius);
        let c = centre / radius;
        let short = match lights {
            [light] if k > 0.0 => {
                let l = light.position.as_dvec3() / radius;
                let light_from_centre = (light.position.as_dvec3() - centre) / radius;
                let (k0, k1) = (k - c.dot(l), l.dot(l) - k);
                let (far, gap) = (c.length() + 1.0, light_from_centre.length() - 1.0);
                let products = far * light_from_centre.length();
                let loss = f64::max((k0.abs() + products) / gap, (k1.abs() + 2.0 * products) / (gap * gap));
                let weights = 0.5 * light.radiance().as_dvec3() * colour;
                let fine = gap > 0.25 && loss < SHORT_FORM_LOSS;
                fine.then_some(ShortForm { light: light_from_centre, k0, k1, weights })
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

    fn outside(
        &self,
        grid: &Grid<f64>,
        d: DVec3,
        middle: u32,
        columns: &Range<u32>,
        s: &Silhouette,
    ) -> OutsideSpan<f64> {
        let c = self.centre;
        // Scaled so that h + sqrt D is 1/t.
        let scale = s.sign / self.k;
        let (h1, h0) = (c.x * grid.step / self.k, (s.h + c.x * d.x) / self.k);
        let at_middle = d - h0 * c;
        OutsideSpan {
            j: f64::from(columns.start) - f64::from(middle),
            end: f64::from(columns.end) - f64::from(middle),
            id: 0.0,
            near: 1.0 / self.radius,
            a1: -s.m * grid.step * scale,
            a0: (s.q - s.m * d.x) * scale,
            b1: grid.step * scale,
            b0: (d.x + s.p) * scale,
            h1,
            h0,
            x1: grid.step - h1 * c.x,
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

    fn lit(
        &self,
        form: &ShortForm,
        grid: &Grid<f64>,
        d: DVec3,
        middle: u32,
        columns: &Range<u32>,
        s: &Silhouette,
    ) -> LitSpan<f64> {
        // Scaled so that sqrt D is the root of (j - left) (right - j).
        let scale = 1.0 / (s.m.sqrt() * grid.step);
        LitSpan {
            j: f64::from(columns.start) - f64::from(middle),
            end: f64::from(columns.end) - f64::from(middle),
            id: 0.0,
            near: 0.0,
            left: (s.left - d.x) / grid.step,
            right: (s.right - d.x) / grid.step,
            h1: self.centre.x * grid.step * scale,
            h0: (s.h + self.centre.x * d.x) * scale,
            q1: 2.0 * self.k * form.light.x * grid.step * scale,
            q0: 2.0 * self.k * form.light.dot(d) * scale,
            k0: 2.0 * form.k0,
            k1: form.k1,
            red: form.weights.x,
            green: form.weights.y,
            blue: form.weights.z,
        }
    }

    fn inside(&self, grid: &Grid<f64>, d: DVec3, middle: u32, columns: Range<u32>) -> InsideSpan<f64> {
        let c = self.centre;
        InsideSpan {
            j: f64::from(columns.start) - f64::from(middle),
            end: f64::from(columns.end) - f64::from(middle),
            id: 0.0,
            near: 1.0 / self.radius,
            x1: grid.step,
            x0: d.x,
            y: d.y,
            z: d.z,
            g: d.y * d.y + d.z * d.z,
            h1: c.x * grid.step,
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
        let size = v1.abs().max(v2.abs()).max(v3.abs()).max_element();
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

    fn record(&self, grid: &Grid<f64>, d: DVec3, middle: u32, columns: &Range<u32>) -> TriangleSpan<f64> {
        let (w1, w0) = (self.plane.x * grid.step, self.plane.dot(d));
        let at_middle = d - w0 * self.vertex;
        TriangleSpan {
            j: f64::from(columns.start) - f64::from(middle),
            end: f64::from(columns.end) - f64::from(middle),
            id: 0.0,
            near: 1.0 / self.size,
            w1: w1 * self.size,
            w0: w0 * self.size,
            x1: grid.step - w1 * self.vertex.x,
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
