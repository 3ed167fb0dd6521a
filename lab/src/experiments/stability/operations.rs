//! Single operations: rays of any direction tested against one object.

use std::time::Instant;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::side;
use crate::exact::digits::Exact;
use crate::exact::number::{Number as _, Split};
use crate::exact::shapes::{self, Meeting, Ray, Vector};
use crate::experiments::accuracy::errors::{Errors, Tally};
use crate::families::{Family, Level};
use crate::measure::Name;
use crate::measure::statistics::median;
use crate::operands::{InUnits, sphere_hit, triangle_hit};
use crate::truth::{TrueHit, TruePixel};
use rayo::internals::kernels::{Isa, PacketElement, PacketOp, packet_ops};
use rayo::internals::plan::on_all_cores;
use rayo::internals::render::{Colour, Distance, Found, Precision};
use rayo::internals::scene::{self, Camera, Object, Rng, Scene};

/// The results of one operation of one instruction set over a family. The field names are those of
/// the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct OperationRow {
    pub family: Name,
    /// `sphere` or `triangle`.
    pub operation: Name,
    pub engine: Name,
    pub precision: Name,
    pub from: String,
    pub to: String,
    /// The least number of rays at any value of the parameter; each is tested against one object.
    pub rays: usize,
    /// The largest error of t in units of its last place; null if there is nothing to hit.
    pub worst: Option<f64>,
    /// The largest relative error of t divided by its documented bound.
    pub bound: Option<f64>,
    /// The number of wrong hits outside of the margin.
    pub wrong_hits: usize,
    /// The number of rays that meet no triangle of a mesh that covers the picture; null for
    /// families without a mesh.
    pub holes: Option<usize>,
    /// The first value, going away from the ordinary one, at which t exceeds its bound or a hit is
    /// wrong.
    pub breaks_at: Option<String>,
    /// The largest ratio of the time at a value to the time at the ordinary value.
    pub slowdown: f64,
}

/// The least number of rays at each value, in a quick sweep and in a full one.
const RAYS: [usize; 2] = [3_000, 100_000];
/// The number of objects among which the rays are divided.
const OBJECTS: usize = 20;
/// The number of timed runs, of which the fastest counts.
const RUNS: usize = 5;
/// Values for f64 beyond those of a family: `FURTHER` are distances in radii, `LARGER` units of
/// length.
const FURTHER: [f64; 4] = [1e9, 1e11, 1e13, 1e14];
const LARGER: [f64; 9] = [1e-300, 1e-250, 1e-150, 1e-100, 1e-40, 1e60, 1e150, 1e250, 1e300];

/// The object that rays are tested against.
#[derive(Clone, Copy)]
enum Shape {
    Sphere { centre: DVec3, radius: f64 },
    Triangle([DVec3; 3]),
}

/// A shape, and the parallelogram that rays are aimed at. About half of it lies beside the shape,
/// so that some rays miss.
struct Target {
    shape: Shape,
    parallelogram: Parallelogram,
}

struct Parallelogram {
    corner: DVec3,
    sides: [DVec3; 2],
}

/// A sweep over the parameter of a family, with a single object at each value.
struct Sweep {
    id: &'static str,
    operation: &'static str,
    beyond: &'static [f64],
    /// Makes a shape at a value of the parameter.
    make: fn(f64, &mut Rng) -> Target,
}

const SWEEPS: [Sweep; 3] = [
    Sweep { id: "S1", operation: "sphere", beyond: &FURTHER, make: far_sphere },
    Sweep { id: "S3", operation: "sphere", beyond: &LARGER, make: sphere_of_unit },
    Sweep { id: "T5", operation: "triangle", beyond: &LARGER, make: triangle_of_unit },
];

fn between(rng: &mut Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * f64::from(rng.next_f32())
}

fn point(rng: &mut Rng, across: f64, near: f64, far: f64) -> DVec3 {
    DVec3::new(between(rng, -across, across), between(rng, -across, across), between(rng, near, far))
}

/// The parallelogram through a sphere's centre, perpendicular to the view, that reaches a little
/// beyond the sphere's outline.
fn about(centre: DVec3, radius: f64) -> Parallelogram {
    // Lengths are first divided by the largest component, since squares may exceed f64.
    let unit = centre.abs().max_element();
    let distance = (centre / unit).length();
    let (side, up) = (centre / unit / distance).any_orthonormal_pair();
    let seen = 1.1 * radius / (1.0 - (radius / unit / distance).powi(2)).max(0.1).sqrt();
    Parallelogram { corner: centre - seen * (side + up), sides: [2.0 * seen * side, 2.0 * seen * up] }
}

/// A sphere with the parallelogram around it.
fn sphere_target(centre: DVec3, radius: f64) -> Target {
    Target { shape: Shape::Sphere { centre, radius }, parallelogram: about(centre, radius) }
}

fn far_sphere(kappa: f64, rng: &mut Rng) -> Target {
    let (radius, direction) = (between(rng, 0.5, 2.0), point(rng, 0.5, 1.0, 1.0).normalize());
    let narrow = kappa < 1e8;
    sphere_target(rounded_point(narrow, kappa * radius * direction), rounded(narrow, radius))
}

fn sphere_of_unit(unit: f64, rng: &mut Rng) -> Target {
    let (centre, radius) = (unit * point(rng, 1.0, 3.0, 5.0), unit * between(rng, 0.5, 2.0));
    let narrow = (1e-25..1e21).contains(&unit);
    sphere_target(rounded_point(narrow, centre), rounded(narrow, radius))
}

fn triangle_of_unit(unit: f64, rng: &mut Rng) -> Target {
    let narrow = (1e-25..1e21).contains(&unit);
    let vertices = [(); 3].map(|()| rounded_point(narrow, unit * point(rng, 1.5, 2.0, 6.0)));
    let [a, b, c] = vertices;
    let corner = a - 0.1 * (b - a) - 0.1 * (c - a);
    let parallelogram = Parallelogram { corner, sides: [1.2 * (b - a), 1.2 * (c - a)] };
    Target { shape: Shape::Triangle(vertices), parallelogram }
}

/// Rounds a number to f32 if `narrow`, as a scene does. The numbers of f64 sweeps may be beyond
/// f32's range.
fn rounded(narrow: bool, x: f64) -> f64 {
    if narrow { f64::from(x as f32) } else { x }
}

/// Rounds the coordinates of a point by [`rounded`].
fn rounded_point(narrow: bool, point: DVec3) -> DVec3 {
    DVec3::from_array(point.to_array().map(|x| rounded(narrow, x)))
}

/// The distances that an operation returns, and its time.
struct TimedDistances {
    /// t of each ray.
    t: Vec<f64>,
    /// The nanoseconds of all rays in the fastest run.
    ns: f64,
}

/// A shape, some rays, and the true result of each ray.
struct ShapeAndRays<E> {
    record: Vec<E>,
    unit: f64,
    rays: Vec<[E; 3]>,
    expected: Vec<TruePixel>,
}

impl Shape {
    fn object(self) -> Object {
        match self {
            Shape::Sphere { .. } => Object::Sphere(0),
            Shape::Triangle(_) => Object::Triangle(0),
        }
    }

    fn numbers(&mut self) -> Vec<&mut f64> {
        match self {
            Shape::Sphere { centre, radius } => centre.as_mut().iter_mut().chain([radius]).collect(),
            Shape::Triangle(vertices) => vertices.iter_mut().flat_map(|vertex| vertex.as_mut()).collect(),
        }
    }

    /// The numbers of the shape's record, for rays whose components are at most `reach` in
    /// magnitude.
    fn record<E: PacketElement>(self, reach: [f64; 3]) -> InUnits<Vec<E>> {
        match self {
            Shape::Sphere { centre, radius } => {
                let InUnits { record, unit } = sphere_hit::<E>(centre.into(), radius);
                InUnits { record: record.numbers(), unit }
            }
            Shape::Triangle(vertices) => {
                let InUnits { record, unit } = triangle_hit::<E>(vertices.map(Into::into), reach);
                InUnits { record: record.numbers(), unit }
            }
        }
    }

    fn expected(self, rays: &[[f64; 3]], reach: [f64; 3]) -> Vec<TruePixel> {
        let sphere_or_triangle = match self {
            Shape::Sphere { centre, radius } => {
                Ok(shapes::Sphere::new(centre.into(), radius).expect("it has a radius"))
            }
            Shape::Triangle(vertices) => Err(shapes::Triangle::<Exact>::new(vertices.map(Into::into))),
        };
        let meet = |ray: &Ray<Exact>| match &sphere_or_triangle {
            Ok(sphere) => sphere.meet(ray),
            Err(Some(triangle)) => triangle.meet(ray),
            Err(None) => Some(Meeting::NEVER),
        };
        let expected = |ray: &[f64; 3]| {
            let met = meet(&Ray::within(Vector::new(*ray), reach));
            let Meeting { hit, margin, alone: bound, .. } = met.expect("exact numbers know everything");
            let nothing = Split { high: 0.0, low: 0.0 };
            let target = |t: &Exact| TrueHit {
                object: self.object(),
                t: t.split(),
                normal: [nothing; 3],
                cosines: Vec::new(),
                dazzled: false,
                colour: None,
                bound,
                lever: 0.0,
                shadow: f64::INFINITY,
            };
            TruePixel { hit: hit.as_ref().map(target), margin }
        };
        on_all_cores(rays.len(), |i| expected(&rays[i]))
    }
}

/// Random rays with lengths from 1/2 to 1 through a parallelogram.
fn aimed<E: PacketElement>(at: &Parallelogram, count: usize, rng: &mut Rng) -> Vec<[E; 3]> {
    let ray = |rng: &mut Rng| {
        let Parallelogram { corner, sides: [one, other] } = *at;
        let place = corner + between(rng, 0.0, 1.0) * one + between(rng, 0.0, 1.0) * other;
        // The vector is first divided by its largest component, since squares may exceed f64.
        let direction = (place / place.abs().max_element()).normalize();
        (between(rng, 0.5, 1.0) * direction).to_array().map(E::from_f64)
    };
    (0..count).map(|_| ray(rng)).collect()
}

impl<E: PacketElement> ShapeAndRays<E> {
    fn of(shape: Shape, rays: Vec<[E; 3]>) -> Self {
        let exact: Vec<_> = rays.iter().map(|ray| ray.map(|x| x.to_f64())).collect();
        let reach = reach_of(&rays);
        let InUnits { record, unit } = shape.record(reach);
        ShapeAndRays { record, unit, rays, expected: shape.expected(&exact, reach) }
    }

    /// Calls the operation `runs` times.
    fn call(&self, op: &PacketOp<E>, runs: usize) -> TimedDistances {
        let packets = packed(&self.rays, op.lanes);
        let mut out = vec![E::default(); packets.len() / 3];
        let mut fastest = f64::INFINITY;
        for _ in 0..runs {
            let start = Instant::now();
            op.call(&mut out, &packets, &self.record);
            fastest = fastest.min(start.elapsed().as_secs_f64());
        }
        let t = out.iter().take(self.rays.len()).map(|t| self.unit * t.to_f64()).collect();
        TimedDistances { t, ns: 1e9 * fastest }
    }
}

/// The largest magnitude of each component of the rays.
fn reach_of<E: PacketElement>(rays: &[[E; 3]]) -> [f64; 3] {
    std::array::from_fn(|axis| rays.iter().map(|ray| ray[axis].to_f64().abs()).fold(0.0, f64::max))
}

/// Arranges rays in whole packets of `lanes`. The last packet is filled up with rays of direction
/// 0.
fn packed<E: PacketElement>(rays: &[[E; 3]], lanes: usize) -> Vec<E> {
    let of = |rays: &[[E; 3]]| {
        let number = |i: usize| rays.get(i % lanes).map_or(E::default(), |ray| ray[i / lanes]);
        (0..3 * lanes).map(number).collect::<Vec<_>>()
    };
    rays.chunks(lanes).flat_map(of).collect()
}

fn op_of<E: PacketElement>(isa: Isa, name: &str) -> Option<&'static PacketOp<E>> {
    packet_ops::<E>(isa)?.iter().find(|op| op.name == name)
}

/// The families whose objects are tested with the rays of their scene's picture.
const PICTURES: [&str; 10] = ["S2", "S4", "S5", "S6", "S8", "T1", "T2", "T3", "T4", "T7"];

/// Tests the operations on those of `families` whose scenes consist of single objects, and on the
/// meshes of T6 in search of cracks.
pub fn sweep(families: &[&Family], seed: u64, quick: bool) -> Vec<OperationRow> {
    let both = |family: &&Family| {
        [of_precision::<f32>(family, seed, quick), of_precision::<f64>(family, seed, quick)].concat()
    };
    families.iter().flat_map(both).collect()
}

fn of_precision<E: PacketElement>(family: &Family, seed: u64, quick: bool) -> Vec<OperationRow> {
    let rays = RAYS[usize::from(!quick)];
    if let Some(sweep) = SWEEPS.iter().find(|sweep| sweep.id == family.id) {
        let mut values: Vec<f64> = family.levels.iter().map(|level| level.value).collect();
        if is_double::<E>() {
            values.extend(sweep.beyond);
            values.sort_unstable_by(f64::total_cmp);
        }
        return of_element::<E>(family, sweep, &values, seed, rays);
    }
    match family.id {
        id if PICTURES.contains(&id) => of_pictures::<E>(family, seed, quick),
        "T6" => of_meshes::<E>(family, seed, quick),
        "N1" => not_numbers::<E>(seed, rays),
        _ => Vec::new(),
    }
}

fn is_double<E: PacketElement>() -> bool {
    size_of::<E>() == size_of::<f64>()
}

/// A row without figures yet.
fn empty<E: PacketElement>(family: &'static str, operation: &'static str, isa: Isa) -> OperationRow {
    let precision = if is_double::<E>() { Precision::Double } else { Precision::Single }.name();
    OperationRow {
        family: family.into(),
        operation: operation.into(),
        engine: isa.name().into(),
        precision: precision.into(),
        ..OperationRow::default()
    }
}

fn usable() -> impl Iterator<Item = Isa> {
    Isa::ALL.into_iter().filter(|isa| isa.usable())
}

/// One operation and the values of one parameter.
struct SweptOp<'a> {
    id: &'static str,
    operation: &'static str,
    /// The values as they are printed; `ordinary` is the index of the ordinary one.
    values: &'a [String],
    ordinary: usize,
}

fn of_element<E: PacketElement>(
    family: &Family,
    sweep: &Sweep,
    values: &[f64],
    seed: u64,
    rays: usize,
) -> Vec<OperationRow> {
    let usual = family.levels[family.ordinary].value;
    let ordinary = values.iter().position(|value| *value == usual).expect("the ordinary value is one of them");
    let written: Vec<_> = values.iter().map(|value| Level { value: *value, label: "" }.to_string()).collect();
    let over = SweptOp { id: family.id, operation: sweep.operation, values: &written, ordinary };
    rows_of::<E>(&over, |i| {
        let mut rng = Rng::new(seed ^ ((i as u64) << 32));
        let object = |_| {
            let Target { shape, parallelogram } = (sweep.make)(values[i], &mut rng);
            ShapeAndRays::of(shape, aimed::<E>(&parallelogram, rays.div_ceil(OBJECTS), &mut rng))
        };
        (0..OBJECTS).map(object).collect()
    })
}

/// The rays of a picture, rounded to `E`.
fn rays_of<E: PacketElement>(camera: &Camera) -> Vec<[E; 3]> {
    let grid = camera.grid::<f64>();
    let row = |row| (0..camera.width()).map(move |col| grid.ray(row, col).map(E::from_f64));
    (0..camera.height()).flat_map(row).collect()
}

fn of_pictures<E: PacketElement>(family: &Family, seed: u64, quick: bool) -> Vec<OperationRow> {
    let variants = family.variants.len();
    let shapes = |scene: &Scene, operation: &str| -> Vec<Shape> {
        let sphere = |s: &scene::Sphere| Shape::Sphere { centre: s.centre.into(), radius: s.radius.into() };
        let triangle = |t: &scene::Triangle| Shape::Triangle(t.vertices.map(Into::into));
        match operation {
            "sphere" => scene.spheres.iter().map(sphere).collect(),
            _ => scene.triangles.iter().map(triangle).collect(),
        }
    };
    // The objects of a scene share the rays of its picture.
    let held = |level: usize, operation: &str| -> Vec<ShapeAndRays<E>> {
        let cases = (0..variants).map(|i| family.case(level * variants + i, seed, side(family, quick)).scene);
        let of_case = |scene: Scene| {
            let (shapes, rays) = (shapes(&scene, operation), rays_of::<E>(&scene.camera));
            let share = |i: usize| rays.iter().skip(i).step_by(shapes.len()).copied().collect();
            shapes.iter().enumerate().map(|(i, shape)| ShapeAndRays::of(*shape, share(i))).collect::<Vec<_>>()
        };
        cases.flat_map(of_case).collect()
    };
    let values: Vec<_> = family.levels.iter().map(ToString::to_string).collect();
    let operation = if family.id.starts_with('S') { "sphere" } else { "triangle" };
    let over = SweptOp { id: family.id, operation, values: &values, ordinary: family.ordinary };
    rows_of(&over, |level| held(level, operation))
}

/// What was found at one value of the parameter, for one instruction set.
struct FoundAtValue {
    errors: Errors,
    ns_per_object: f64,
}

impl FoundAtValue {
    /// Whether t exceeds its bound, or a hit is wrong.
    fn breaks(&self) -> bool {
        self.errors.wrong_hits > 0 || self.errors.bound_share.is_some_and(|share| share > 1.0)
    }
}

/// A row for each instruction set. `held` makes the shapes at a value, with their rays and true
/// results.
fn rows_of<E: PacketElement>(over: &SweptOp<'_>, held: impl Fn(usize) -> Vec<ShapeAndRays<E>>) -> Vec<OperationRow> {
    let isas: Vec<_> = usable().collect();
    // For each instruction set, what was found at each value.
    let mut found: Vec<Vec<FoundAtValue>> = isas.iter().map(|_| Vec::new()).collect();
    for value in 0..over.values.len() {
        let held = held(value);
        for (isa, found) in isas.iter().zip(&mut found) {
            found.push(find_at_value(op_of::<E>(*isa, over.operation).expect("every instruction set has it"), &held));
        }
    }
    isas.iter().zip(&found).map(|(isa, found)| row_of::<E>(over, *isa, found)).collect()
}

/// Compares an operation with the truth of each ray, and times it.
fn find_at_value<E: PacketElement>(op: &PacketOp<E>, held: &[ShapeAndRays<E>]) -> FoundAtValue {
    let mut tally = Tally::of_exact_rays(is_double::<E>());
    let mut ns = 0.0;
    for held in held {
        let answers = held.call(op, RUNS);
        ns += answers.ns / held.rays.len() as f64;
        for (expected, t) in held.expected.iter().zip(answers.t) {
            let object = expected.hit.as_ref().map_or(Object::Sphere(0), |hit| hit.object);
            let hit = Found { object, distance: Distance::T(t), normal: None };
            // Infinity means a miss; a NaN counts as a hit that is wrong.
            tally.add(expected, (t != f64::INFINITY).then_some(&hit), Colour::Levels([0; 3]));
        }
    }
    FoundAtValue { errors: tally.errors(), ns_per_object: ns / held.len() as f64 }
}

/// The row of an instruction set, from its results at each value.
fn row_of<E: PacketElement>(over: &SweptOp<'_>, isa: Isa, found: &[FoundAtValue]) -> OperationRow {
    let SweptOp { id, operation, values, ordinary } = *over;
    let largest = |of: fn(&Errors) -> Option<f64>| found.iter().filter_map(|found| of(&found.errors)).reduce(f64::max);
    let broken = found.iter().enumerate().filter(|(_, found)| found.breaks()).map(|(level, _)| level);
    let usual = found[ordinary].ns_per_object;
    OperationRow {
        from: values[0].clone(),
        to: values[values.len() - 1].clone(),
        rays: found.iter().map(|found| found.errors.rays).min().unwrap_or(0),
        worst: largest(|errors| errors.max_ulp),
        bound: largest(|errors| errors.bound_share),
        wrong_hits: found.iter().map(|found| found.errors.wrong_hits).sum(),
        breaks_at: broken.min_by_key(|level| level.abs_diff(ordinary)).map(|level| values[level].clone()),
        slowdown: found.iter().map(|found| found.ns_per_object / usual).fold(0.0, f64::max),
        ..empty::<E>(id, operation, isa)
    }
}

/// Tests every triangle of the meshes that cover their picture, and counts the rays that meet no
/// triangle although each meets one in exact arithmetic.
fn of_meshes<E: PacketElement>(family: &Family, seed: u64, quick: bool) -> Vec<OperationRow> {
    let case = |level: usize| family.case(level * family.variants.len(), seed, side(family, quick));
    let cases: Vec<_> = (0..family.levels.len()).map(case).filter(|case| case.covered).collect();
    let rays: Vec<_> = cases.iter().map(|case| rays_of::<E>(&case.scene.camera)).collect();
    let mut rows = Vec::new();
    for isa in usable() {
        let op = op_of::<E>(isa, "triangle").expect("every instruction set has it");
        let found: Vec<_> = cases.iter().zip(&rays).map(|(case, rays)| find_holes(op, &case.scene, rays)).collect();
        rows.push(OperationRow {
            from: cases[0].level.to_string(),
            to: cases[cases.len() - 1].level.to_string(),
            rays: rays.iter().map(Vec::len).min().unwrap_or(0),
            holes: Some(found.iter().map(|found| found.holes).sum()),
            slowdown: found.iter().map(|of| of.ns_per_ray / found[0].ns_per_ray).fold(0.0, f64::max),
            ..empty::<E>(family.id, "triangle", isa)
        });
    }
    rows
}

/// What was found in a mesh that covers its picture.
struct Holes {
    /// The number of rays that meet no triangle.
    holes: usize,
    /// The median time of a triangle.
    ns_per_ray: f64,
}

/// Tests each ray against each triangle of a mesh.
fn find_holes<E: PacketElement>(op: &PacketOp<E>, scene: &Scene, rays: &[[E; 3]]) -> Holes {
    let packets = packed(rays, op.lanes);
    let mut out = vec![E::default(); packets.len() / 3];
    let mut hit = vec![false; rays.len()];
    let reach = reach_of(rays);
    let mut times = Vec::new();
    for triangle in &scene.triangles {
        let record = Shape::Triangle(triangle.vertices.map(Into::into)).record(reach).record;
        let start = Instant::now();
        op.call(&mut out, &packets, &record);
        times.push(start.elapsed().as_secs_f64());
        for (hit, t) in hit.iter_mut().zip(&out) {
            *hit |= t.to_f64() != f64::INFINITY;
        }
    }
    Holes { holes: hit.iter().filter(|hit| !**hit).count(), ns_per_ray: median(&times) / rays.len() as f64 }
}

/// Tests an ordinary sphere and triangle of which each number in turn is made NaN or infinite, and
/// rays with such numbers. Nothing may be hit.
fn not_numbers<E: PacketElement>(seed: u64, rays: usize) -> Vec<OperationRow> {
    SWEEPS[1..].iter().flat_map(|sweep| not_numbers_of::<E>(sweep, seed, rays)).collect()
}

/// A shape and rays, in which at most one number is not finite.
struct NonFiniteCase<E> {
    shape: Shape,
    rays: Vec<[E; 3]>,
}

/// The rows of [`not_numbers`] for the operation of one sweep.
fn not_numbers_of<E: PacketElement>(sweep: &Sweep, seed: u64, rays: usize) -> Vec<OperationRow> {
    let mut rng = Rng::new(seed);
    let Target { shape, parallelogram } = (sweep.make)(1.0, &mut rng);
    let rays = aimed::<E>(&parallelogram, rays, &mut rng);
    let reach = reach_of(&rays);
    let cases = spoilt_cases(shape, &rays);
    let values = [vec!["NaN".to_owned(); cases.len() - 1], vec!["infinity".into()]].concat();
    let over = SweptOp { id: "N1", operation: sweep.operation, values: &values, ordinary: 0 };
    let held = |case: usize| {
        let NonFiniteCase { shape, rays } = &cases[case];
        let InUnits { record, unit } = shape.record(reach);
        // Of the ordinary case, the first, only the time is used.
        let miss = TruePixel { hit: None, margin: f64::INFINITY };
        let expected = vec![miss; if case == 0 { 0 } else { rays.len() }];
        vec![ShapeAndRays { record, unit, rays: rays.clone(), expected }]
    };
    rows_of(&over, held).into_iter().map(|row| OperationRow { rays: rays.len(), ..row }).collect()
}

/// First the shape and the rays as they are; then each number of the shape in turn NaN, and
/// infinite; then each component of all rays NaN.
fn spoilt_cases<E: PacketElement>(shape: Shape, rays: &[[E; 3]]) -> Vec<NonFiniteCase<E>> {
    let mut cases = vec![NonFiniteCase { shape, rays: rays.to_vec() }];
    let count = { shape }.numbers().len();
    for index in 0..count {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut shape = shape;
            *shape.numbers().swap_remove(index) = bad;
            cases.push(NonFiniteCase { shape, rays: rays.to_vec() });
        }
    }
    for axis in 0..3 {
        let mut rays = rays.to_vec();
        for ray in &mut rays {
            ray[axis] = E::from_f64(f64::NAN);
        }
        cases.push(NonFiniteCase { shape, rays });
    }
    cases
}
