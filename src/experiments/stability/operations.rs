//! The operations by themselves: rays of any direction against one object, over ranges that no scene has.

use std::time::Instant;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::side;
use crate::experiments::accuracy::errors::{Errors, Tally};
use crate::kernels::{Isa, PacketElement, PacketOp, packet_ops};
use crate::measure::Name;
use crate::measure::statistics::median;
use crate::plan::{InUnits, on_all_cores, sphere_hit, triangle_hit};
use crate::reference::exact::Exact;
use crate::reference::number::{Number as _, Split};
use crate::reference::shapes::{self, Meeting, Ray, Vector};
use crate::render::{Colour, Distance, Found, Precision, TrueHit, TruePixel};
use crate::scene::families::{Family, Level};
use crate::scene::{self, Camera, Object, Rng, Scene};

/// One operation of one instruction set over a family. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct OperationRow {
    pub family: Name,
    /// `sphere` or `triangle`.
    pub operation: Name,
    pub engine: Name,
    pub precision: Name,
    pub from: String,
    pub to: String,
    /// Rays of a value at least, each against one object.
    pub rays: usize,
    /// The largest error of t in units of its last place; null where nothing is to be hit.
    pub worst: Option<f64>,
    /// The same as a share of the documented bound.
    pub bound: Option<f64>,
    /// Outside of the margin.
    pub wrong_hits: usize,
    /// Rays that meet no triangle of a mesh that covers the picture; null where there is no mesh.
    pub holes: Option<usize>,
    /// The first value, from the ordinary one outwards, at which it breaks its bound or hits wrongly.
    pub breaks_at: Option<String>,
    /// The largest ratio of a value's time to that of the ordinary one.
    pub slowdown: f64,
}

/// Rays of a value at least, of a quick sweep and of any other.
const RAYS: [usize; 2] = [3_000, 100_000];
/// Objects that share them.
const OBJECTS: usize = 20;
/// Runs of which the fastest counts.
const RUNS: usize = 5;
/// What f64 has beyond the levels of a family: distances in radii, and units of length.
const FURTHER: [f64; 4] = [1e9, 1e11, 1e13, 1e14];
const LARGER: [f64; 9] = [1e-300, 1e-250, 1e-150, 1e-100, 1e-40, 1e60, 1e150, 1e250, 1e300];

/// The object that rays are compared with.
#[derive(Clone, Copy)]
enum Shape {
    Sphere { centre: DVec3, radius: f64 },
    Triangle([DVec3; 3]),
}

/// How the single objects of a family are made.
struct Sweep {
    id: &'static str,
    operation: &'static str,
    beyond: &'static [f64],
    /// A shape at a value of the parameter, and the points that rays are aimed at: as far beside it as on it.
    make: fn(f64, &mut Rng) -> (Shape, Vec<DVec3>),
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

/// Points about a sphere as far off its centre as its outline is seen, and a little further.
fn about(centre: DVec3, radius: f64) -> Vec<DVec3> {
    // Lengths whose squares are beyond f64 are in a unit of their own.
    let unit = centre.abs().max_element();
    let distance = (centre / unit).length();
    let (side, up) = (centre / unit / distance).any_orthonormal_pair();
    let seen = 1.1 * radius / (1.0 - (radius / unit / distance).powi(2)).max(0.1).sqrt();
    vec![centre - seen * (side + up), 2.0 * seen * side, 2.0 * seen * up]
}

fn far_sphere(kappa: f64, rng: &mut Rng) -> (Shape, Vec<DVec3>) {
    let (radius, direction) = (between(rng, 0.5, 2.0), point(rng, 0.5, 1.0, 1.0).normalize());
    let (centre, radius) = rounded(kappa < 1e8, kappa * radius * direction, radius);
    (Shape::Sphere { centre, radius }, about(centre, radius))
}

fn sphere_of_unit(unit: f64, rng: &mut Rng) -> (Shape, Vec<DVec3>) {
    let (centre, radius) = (unit * point(rng, 1.0, 3.0, 5.0), unit * between(rng, 0.5, 2.0));
    let (centre, radius) = rounded((1e-25..1e21).contains(&unit), centre, radius);
    (Shape::Sphere { centre, radius }, about(centre, radius))
}

fn triangle_of_unit(unit: f64, rng: &mut Rng) -> (Shape, Vec<DVec3>) {
    let narrow = (1e-25..1e21).contains(&unit);
    let vertices = [(); 3].map(|()| rounded(narrow, unit * point(rng, 1.5, 2.0, 6.0), 0.0).0);
    let [a, b, c] = vertices;
    (Shape::Triangle(vertices), vec![a - 0.1 * (b - a) - 0.1 * (c - a), 1.2 * (b - a), 1.2 * (c - a)])
}

/// Numbers within the range of f32 are rounded to it, as those of a scene are.
fn rounded(narrow: bool, centre: DVec3, radius: f64) -> (DVec3, f64) {
    if narrow { (centre.as_vec3().as_dvec3(), f64::from(radius as f32)) } else { (centre, radius) }
}

/// A shape, its rays, and the truth of each.
struct Held<E> {
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

    /// Its record for rays whose components are at most `reach`, and the unit.
    fn record<E: PacketElement>(self, reach: [f64; 3]) -> (Vec<E>, f64) {
        match self {
            Shape::Sphere { centre, radius } => {
                let InUnits { record, unit } = sphere_hit::<E>(centre.into(), radius);
                (record.numbers(), unit)
            }
            Shape::Triangle(vertices) => {
                let InUnits { record, unit } = triangle_hit::<E>(vertices.map(Into::into), reach);
                (record.numbers(), unit)
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

/// Rays of lengths from 1/2 to 1 through a parallelogram, which is given by a corner and two sides.
fn aimed<E: PacketElement>(at: &[DVec3], count: usize, rng: &mut Rng) -> Vec<[E; 3]> {
    let ray = |rng: &mut Rng| {
        let [corner, one, other] = at[..] else { panic!("a corner and two sides") };
        let place = corner + between(rng, 0.0, 1.0) * one + between(rng, 0.0, 1.0) * other;
        // Numbers whose squares are beyond f64 are brought nearer first.
        let direction = (place / place.abs().max_element()).normalize();
        (between(rng, 0.5, 1.0) * direction).to_array().map(E::from_f64)
    };
    (0..count).map(|_| ray(rng)).collect()
}

impl<E: PacketElement> Held<E> {
    fn of(shape: Shape, rays: Vec<[E; 3]>) -> Self {
        let exact: Vec<_> = rays.iter().map(|ray| ray.map(|x| x.to_f64())).collect();
        let reach = reach_of(&rays);
        let (record, unit) = shape.record(reach);
        Held { record, unit, rays, expected: shape.expected(&exact, reach) }
    }

    /// t of each ray, and nanoseconds of all, the fastest of so many runs.
    fn call(&self, op: &PacketOp<E>, runs: usize) -> (Vec<f64>, f64) {
        let packets = packed(&self.rays, op.lanes);
        let mut out = vec![E::default(); packets.len() / 3];
        let mut fastest = f64::INFINITY;
        for _ in 0..runs {
            let start = Instant::now();
            op.call(&mut out, &packets, &self.record);
            fastest = fastest.min(start.elapsed().as_secs_f64());
        }
        let t = out.iter().take(self.rays.len()).map(|t| self.unit * t.to_f64()).collect();
        (t, 1e9 * fastest)
    }
}

/// The largest of each component.
fn reach_of<E: PacketElement>(rays: &[[E; 3]]) -> [f64; 3] {
    std::array::from_fn(|axis| rays.iter().map(|ray| ray[axis].to_f64().abs()).fold(0.0, f64::max))
}

/// Whole packets of `lanes` rays; the last is filled up with rays that have no direction.
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

/// Families whose objects are held against rays of their scene's own picture.
const PICTURES: [&str; 10] = ["S2", "S4", "S5", "S6", "S8", "T1", "T2", "T3", "T4", "T7"];

/// Sweeps the operations over those of `families` that are of single objects, and for cracks over T6.
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

/// A row without figures.
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

/// One operation over one parameter.
struct Over<'a> {
    id: &'static str,
    operation: &'static str,
    /// The values as they are written, and which of them is ordinary.
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
    let over = Over { id: family.id, operation: sweep.operation, values: &written, ordinary };
    rows_of::<E>(&over, |i| {
        let mut rng = Rng::new(seed ^ ((i as u64) << 32));
        let object = |_| {
            let (shape, at) = (sweep.make)(values[i], &mut rng);
            Held::of(shape, aimed::<E>(&at, rays.div_ceil(OBJECTS), &mut rng))
        };
        (0..OBJECTS).map(object).collect()
    })
}

/// The rays of a picture, rounded to E.
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
    let held = |level: usize, operation: &str| -> Vec<Held<E>> {
        let cases = (0..variants).map(|i| family.case(level * variants + i, seed, side(family, quick)).scene);
        let of_case = |scene: Scene| {
            let (shapes, rays) = (shapes(&scene, operation), rays_of::<E>(&scene.camera));
            let share = |i: usize| rays.iter().skip(i).step_by(shapes.len()).copied().collect();
            shapes.iter().enumerate().map(|(i, shape)| Held::of(*shape, share(i))).collect::<Vec<_>>()
        };
        cases.flat_map(of_case).collect()
    };
    let values: Vec<_> = family.levels.iter().map(ToString::to_string).collect();
    let operation = if family.id.starts_with('S') { "sphere" } else { "triangle" };
    let over = Over { id: family.id, operation, values: &values, ordinary: family.ordinary };
    rows_of(&over, |level| held(level, operation))
}

/// A row for each instruction set; `held` makes what is held against the truth at a value.
fn rows_of<E: PacketElement>(over: &Over<'_>, held: impl Fn(usize) -> Vec<Held<E>>) -> Vec<OperationRow> {
    let isas: Vec<_> = usable().collect();
    // Of each value, each instruction set's errors, and nanoseconds of an object.
    let mut found: Vec<Vec<(Errors, f64)>> = Vec::new();
    for value in 0..over.values.len() {
        let held = held(value);
        let of = |isa: &Isa| {
            let op = op_of::<E>(*isa, over.operation).expect("every instruction set has it");
            let (mut tally, mut ns) = (Tally::of_exact_rays(is_double::<E>()), 0.0);
            for held in &held {
                let (hits, time) = held.call(op, RUNS);
                ns += time / held.rays.len() as f64;
                for (expected, t) in held.expected.iter().zip(hits) {
                    let object = expected.hit.as_ref().map_or(Object::Sphere(0), |hit| hit.object);
                    let hit = Found { object, distance: Distance::T(t), normal: None };
                    // Infinity is a miss, and what is no number is wrong.
                    tally.add(expected, (t != f64::INFINITY).then_some(&hit), Colour::Levels([0; 3]));
                }
            }
            (tally.errors(), ns / held.len() as f64)
        };
        found.push(isas.iter().map(of).collect());
    }
    let Over { id, operation, values, ordinary } = *over;
    let row = |(i, isa): (usize, &Isa)| {
        let own = || found.iter().map(|of| &of[i]);
        let largest = |of: fn(&Errors) -> Option<f64>| own().filter_map(|(errors, _)| of(errors)).reduce(f64::max);
        let breaks = |errors: &Errors| errors.wrong_hits > 0 || errors.bound_share.is_some_and(|share| share > 1.0);
        let broken = own().enumerate().filter(|(_, (errors, _))| breaks(errors)).map(|(level, _)| level);
        let usual = found[ordinary][i].1;
        OperationRow {
            from: values[0].clone(),
            to: values[values.len() - 1].clone(),
            rays: own().map(|(errors, _)| errors.rays).min().unwrap_or(0),
            worst: largest(|errors| errors.max_ulp),
            bound: largest(|errors| errors.bound_share),
            wrong_hits: own().map(|(errors, _)| errors.wrong_hits).sum(),
            breaks_at: broken.min_by_key(|level| level.abs_diff(ordinary)).map(|level| values[level].clone()),
            slowdown: own().map(|(_, ns)| ns / usual).fold(0.0, f64::max),
            ..empty::<E>(id, operation, *isa)
        }
    };
    isas.iter().enumerate().map(row).collect()
}

/// The meshes that cover their picture, triangle by triangle: how many rays meet none of them, though each meets some.
fn of_meshes<E: PacketElement>(family: &Family, seed: u64, quick: bool) -> Vec<OperationRow> {
    let case = |level: usize| family.case(level * family.variants.len(), seed, side(family, quick));
    let cases: Vec<_> = (0..family.levels.len()).map(case).filter(|case| case.covered).collect();
    let rays: Vec<_> = cases.iter().map(|case| rays_of::<E>(&case.scene.camera)).collect();
    let of = |isa: Isa| {
        let op = op_of::<E>(isa, "triangle").expect("every instruction set has it");
        let (mut holes, mut ns) = (0, Vec::new());
        for (case, rays) in cases.iter().zip(&rays) {
            let packets = packed(rays, op.lanes);
            let (mut out, mut hit) = (vec![E::default(); packets.len() / 3], vec![false; rays.len()]);
            let reach = reach_of(rays);
            let mut taken = Vec::new();
            for triangle in &case.scene.triangles {
                let (record, _) = Shape::Triangle(triangle.vertices.map(Into::into)).record(reach);
                let start = Instant::now();
                op.call(&mut out, &packets, &record);
                taken.push(start.elapsed().as_secs_f64());
                hit.iter_mut().zip(&out).for_each(|(hit, t)| *hit |= t.to_f64() != f64::INFINITY);
            }
            holes += hit.iter().filter(|hit| !**hit).count();
            ns.push(median(&taken) / rays.len() as f64);
        }
        OperationRow {
            from: cases[0].level.to_string(),
            to: cases[cases.len() - 1].level.to_string(),
            rays: rays.iter().map(Vec::len).min().unwrap_or(0),
            holes: Some(holes),
            slowdown: ns.iter().map(|of| of / ns[0]).fold(0.0, f64::max),
            ..empty::<E>(family.id, "triangle", isa)
        }
    };
    usable().map(of).collect()
}

/// An ordinary sphere and triangle with each number in turn made NaN or infinite, and rays that are: nothing is hit.
fn not_numbers<E: PacketElement>(seed: u64, rays: usize) -> Vec<OperationRow> {
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    let of = |sweep: &Sweep| {
        let mut rng = Rng::new(seed);
        let (mut shape, at) = (sweep.make)(1.0, &mut rng);
        let numbers = shape.numbers().len();
        let rays = aimed::<E>(&at, rays, &mut rng);
        let reach = reach_of(&rays);
        let spoilt = |at: usize, bad: f64| {
            let mut shape = shape;
            *shape.numbers().swap_remove(at) = bad;
            (shape, rays.clone())
        };
        let mut cases = vec![(shape, rays.clone())];
        cases.extend((0..numbers).flat_map(|at| bad.map(|bad| spoilt(at, bad))));
        cases.extend((0..3).map(|axis| {
            let mut rays = rays.clone();
            rays.iter_mut().for_each(|ray| ray[axis] = E::from_f64(f64::NAN));
            (shape, rays)
        }));
        let values = [vec!["NaN".to_owned(); cases.len() - 1], vec!["infinity".into()]].concat();
        let over = Over { id: "N1", operation: sweep.operation, values: &values, ordinary: 0 };
        let held = |case: usize| {
            let (shape, rays) = &cases[case];
            let (record, unit) = shape.record(reach);
            // Of the ordinary one only the time is asked for.
            let miss = TruePixel { hit: None, margin: f64::INFINITY };
            let expected = vec![miss; if case == 0 { 0 } else { rays.len() }];
            vec![Held { record, unit, rays: rays.clone(), expected }]
        };
        rows_of(&over, held).into_iter().map(|row| OperationRow { rays: rays.len(), ..row }).collect::<Vec<_>>()
    };
    SWEEPS[1..].iter().flat_map(of).collect()
}
