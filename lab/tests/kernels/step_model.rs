//! The model of instructions compared with the CPU: it must know every instruction of every kernel,
//! and predict every bit of vector registers.

#[allow(dead_code)] // its kernels of rows are not called alone here
use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::Path;

use crate::extent;
use crate::kernel_cases::{Input, Numbers, implementations, seed, sphere};
use glam::{DVec3, Vec3};
use object::{Object, ObjectSection, ObjectSymbol};
use rayo::internals::kernels::step::{self, State, Step, Touched};
use rayo::internals::kernels::{Isa, OBJECTS, PacketElement, Vec4, packet_ops, paper};
use rayo::internals::render::{Engine, Film, PixelFormat};
use rayo::internals::scene::mesh::Placement;
use rayo::internals::scene::{self, Camera, Rng, Scene, ToCamera, many};
use rayo_lab::exact::digits::Exact;
use rayo_lab::exact::number::Number as _;
use rayo_lab::exact::shapes::{Ray, Sphere, Vector};
use rayo_lab::experiments::check::call;
use rayo_lab::experiments::step::model::{Check, Element, Float, Number, Operation, Place, What, model};
use rayo_lab::experiments::step::shadow::{Shadow, StepError};
use rayo_lab::measure::instructions;
use rayo_lab::measure::source::Unit;

/// The most instructions of a recording.
const MOST: usize = 20_000;
/// The numbers of the steps to record.
const ALL: &[Range<u64>] = std::slice::from_ref(&(0..u64::MAX));
/// The size of a picture traced in packets, wide enough for stores of whole registers, and of one
/// traced ray by ray. Both are small, because stepping is slow.
const SIZE: (u32, u32) = (49, 3);
const SIZE_OF_RAYS: (u32, u32) = (7, 3);

/// Sources of numbers with infinities, NaN, zeros and denormals.
const ODD: [Numbers; 3] = [Numbers::Special, Numbers::Bits, Numbers::Mixed];

#[test]
fn every_instruction_of_every_kernel_is_known() {
    let state = State {
        general: std::array::from_fn(|number| 0x0123_4567_89ab_cdef << number),
        rip: 0x1000,
        flags: 0,
        mxcsr: 0x1f80,
        vectors: [std::array::from_fn(|byte| (7 * byte) as u8); 32],
        masks: [0x5555_5555_5555_5555; 8],
    };
    let touched = Touched { address: 0x2000, bytes: 64, before: [1; 64], after: [1; 64] };
    let (mut known, mut unknown) = (0, BTreeMap::new());
    for isa in Isa::ALL {
        let (_, data) = OBJECTS.iter().find(|(name, _)| *name == isa.name()).unwrap();
        let file = object::File::parse(*data).unwrap();
        // Chains only exist to be timed.
        let is_kernel = |name: &str| name.starts_with("rayo_") && !name.contains("chain");
        for symbol in file.symbols().filter(|symbol| symbol.name().is_ok_and(is_kernel) && symbol.size() > 0) {
            let Some(section) = symbol.section_index() else { continue };
            let text = file.section_by_index(section).unwrap().data().unwrap();
            let bytes = &text[symbol.address() as usize..][..symbol.size() as usize];
            for instruction in instructions::decode(bytes, 0) {
                let mut code = [0; 16];
                code[..instruction.bytes].copy_from_slice(&bytes[instruction.offset..][..instruction.bytes]);
                let step = Step { before: &state, after: &state, code: &code, touched: Some(&touched), number: 0 };
                match model(&step) {
                    Ok(_) => known += 1,
                    Err(error) => _ = unknown.insert(instruction.text, format!("{}: {error}", symbol.name().unwrap())),
                }
            }
        }
    }
    assert!(unknown.is_empty(), "{unknown:#?}");
    assert!(known > 60_000, "only {known} instructions were found");
}

/// The address ranges of the engines' code.
fn watched() -> Vec<Range<usize>> {
    Isa::ALL.into_iter().filter_map(Unit::of).map(|unit| unit.code.clone()).collect()
}

/// The result of comparing recordings with the model.
#[derive(Debug, Default)]
struct Proof {
    steps: u64,
    bits: u64,
    /// The last wrong prediction for each mnemonic.
    wrong: BTreeMap<String, String>,
}

impl Proof {
    /// Records `action` and compares the model with each step; the model may round only once.
    fn of(&mut self, name: &str, action: impl FnOnce()) {
        let recording = step::record(&watched(), ALL, MOST, action).unwrap_or_else(|error| panic!("{name}: {error}"));
        let mut shadow = Shadow::new();
        for step in recording.steps() {
            self.steps += 1;
            let StepError { operations, check, errors, .. } = shadow.step(&step);
            let estimates = |o: &Operation| matches!(o.what, What::Float(_, Float::ReciprocalRoot(_)));
            if !operations.iter().any(estimates) {
                let worse = errors.iter().find(|error| error.added.abs() > 0.5);
                assert!(worse.is_none(), "{name}: {worse:?} by {operations:?}");
            }
            match check {
                Ok(Check { bits, differences }) if differences.is_empty() => self.bits += bits,
                wrong => {
                    let text = instructions::decode(step.code, step.before.rip).next().unwrap().text;
                    let mnemonic = text.split(' ').next().unwrap_or_default().to_owned();
                    self.wrong.insert(mnemonic, format!("{name}: {text}: {wrong:x?}"));
                }
            }
        }
    }

    fn holds(&self) {
        assert!(self.steps > 10_000 && self.bits > 128 * self.steps, "{} steps, {} bits", self.steps, self.bits);
        assert!(self.wrong.is_empty(), "{:#?}", self.wrong);
    }
}

/// Small scenes, the worst scenes found so far, and scenes with many objects, which are traced in
/// tiles.
fn scenes() -> Vec<(String, Scene)> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let small = ["sphere", "triangle", "tetrahedron", "two-lights"].map(|name| root.join(format!("scenes/{name}.in")));
    let worst = fs::read_dir(root.join("lab/tests/worst-cases")).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = small.into_iter().chain(worst).collect();
    files.sort();
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    let read = files.iter().map(|path| (name(path), scene::read(path).unwrap()));
    let many = [(33, 0), (0, 33), (20, 20)]
        .map(|(spheres, triangles)| (format!("{spheres} spheres, {triangles} triangles"), many(spheres, triangles, 7)));
    let mut of_mesh = scene::many(1, 1, 7);
    let mesh = scene::mesh::shapes::icosphere(80, 0.2, 7);
    let away = Placement { translate: DVec3::new(0.2, 0.1, 4.0), ..Placement::IDENTITY };
    assert!(of_mesh.faces.append(mesh.placed(ToCamera::IDENTITY.of_placed(&away), Vec3::ONE).unwrap()));
    read.chain(many).chain([("a mesh".to_owned(), of_mesh)]).collect()
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "instructions are recorded on Linux alone")]
fn the_model_gives_every_bit_of_every_step_of_every_engine() {
    let mut proof = Proof::default();
    for (index, (name, mut scene)) in extent::sampled(scenes().into_iter().enumerate(), 4) {
        let in_tiles = scene.spheres.len() + scene.triangle_count() >= 32;
        let of_paper = (!scene.shadows).then_some(&Engine::Paper);
        let stepped = Engine::ALL.iter().filter(|engine| engine.is_packet()).chain(of_paper);
        for (number, engine) in stepped.filter(|engine| engine.usable()).enumerate() {
            let (width, height) = if engine.is_packet() { SIZE } else { SIZE_OF_RAYS };
            scene.camera = Camera::new(width, height, scene.camera.focal(), scene.camera.film()).unwrap();
            // Formats alternate, and with many objects also precisions and instruction sets, since
            // stepping is slow.
            let precisions = engine.precisions();
            if in_tiles && engine.is_packet() && number % 3 != index % 3 {
                continue;
            }
            let turn = &precisions[index / 3 % precisions.len()..][..1];
            for &precision in if in_tiles { turn } else { precisions } {
                let name = format!("{name} by {engine} in {precision}");
                let tracer = engine.prepare(Some(precision), &scene).unwrap();
                let mut formats = PixelFormat::ALL.into_iter().filter(|&format| tracer.writes(format)).cycle();
                let format = formats.nth(index).expect("there is one at least");
                let mut film = Film::new(format, (width * height) as usize).unwrap();
                proof.of(&format!("{name}, {}", format.name()), || tracer.rows(0..height, film.as_mut()));
                if in_tiles && engine.is_packet() {
                    // Preparing a scene uses kernels, too.
                    proof.of(&name, || _ = engine.prepare(Some(precision), &scene));
                }
            }
        }
    }
    proof.holds();
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "instructions are recorded on Linux alone")]
fn the_model_gives_every_bit_of_what_is_stored_past_the_caches() {
    // A picture too large for any cache; only a row of it is traced.
    const WIDTH: u32 = 400;
    const HEIGHT: u32 = 65_535;
    let mut proof = Proof::default();
    for (name, mut scene) in scenes().into_iter().filter(|(name, _)| ["sphere.in", "two-lights.in"].contains(&&**name))
    {
        scene.camera = Camera::new(WIDTH, HEIGHT, scene.camera.focal(), scene.camera.film()).unwrap();
        let engines = Engine::ALL.iter().filter(|engine| engine.is_packet() && engine.usable());
        for engine in extent::sampled(engines, 2) {
            for &precision in extent::sampled(engine.precisions(), 2) {
                let tracer = engine.prepare(Some(precision), &scene).unwrap();
                for format in PixelFormat::ALL.into_iter().filter(|&format| tracer.writes(format)) {
                    let name = format!("{name} by {engine} in {precision}, {}", format.name());
                    let mut film = Film::new(format, WIDTH as usize).unwrap();
                    proof.of(&name, || tracer.rows(HEIGHT / 2..HEIGHT / 2 + 1, film.as_mut()));
                }
            }
        }
    }
    proof.holds();
}

/// Runs each operation on packets with numbers from each source.
fn prove_packets<E: PacketElement>(rng: &mut Rng, proof: &mut Proof) {
    for isa in Isa::ALL {
        for op in packet_ops::<E>(isa).into_iter().flatten() {
            for numbers in extent::sampled(ODD, 2) {
                let mut next = || E::from_f64(numbers.next(rng).into());
                let mut many = |count: usize| (0..count).map(|_| next()).collect::<Vec<E>>();
                let (a, mut out) = (many(6 * op.lanes), many(2 * op.lanes * op.shape.out_numbers));
                let b = many(2 * op.lanes * op.shape.b_numbers + op.shape.record);
                proof.of(op.symbol(), || op.call(&mut out, &a, &b));
            }
        }
    }
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "instructions are recorded on Linux alone")]
fn the_model_gives_every_bit_of_every_operation_on_odd_numbers() {
    let mut rng = Rng::new(seed());
    let mut proof = Proof::default();
    prove_packets::<f32>(&mut rng, &mut proof);
    prove_packets::<f64>(&mut rng, &mut proof);
    for (name, kernels) in implementations().into_iter().filter(|(name, _)| *name != "c") {
        for (op_name, op) in kernels.ops() {
            for numbers in extent::sampled(ODD, 2) {
                let inputs = [0; 8].map(|_| Input::random(op, numbers, true, &mut rng));
                proof.of(&format!("{name} {op_name}"), || inputs.iter().for_each(|input| _ = call(op, input)));
            }
        }
    }
    proof.holds();
}

/// The exact result of an operation on a vector and its other operand.
fn exactly(op: &str, a: [f64; 3], b: &[f64]) -> Vec<Exact> {
    let vector = Vector::new(a);
    let other = || Vector::new([b[0], b[1], b[2]]);
    match op {
        "add" => vector.sub(&other().scale(&Exact::new(-1.0))).0.to_vec(),
        "sub" => vector.sub(&other()).0.to_vec(),
        "scale" => vector.scale(&Exact::new(b[0])).0.to_vec(),
        "dot" => vec![vector.dot(&other())],
        "norm" => vec![vector.length()],
        "cross" => vector.cross(&other()).0.to_vec(),
        "normalise" => vector.normalize().0.to_vec(),
        _ => panic!("{op} is not computed here"),
    }
}

fn shadows_are_exact<E: PacketElement>(format: Number, rng: &mut Rng) {
    for isa in Isa::ALL {
        let simple = |name| ["add", "sub", "scale", "dot", "norm", "cross", "normalise"].contains(&name);
        for op in packet_ops::<E>(isa).into_iter().flatten().filter(|op| simple(op.name)) {
            // Numbers with more digits than f32 holds.
            let mut next = || f64::from(Numbers::Ordinary.next(rng)) + f64::from(rng.next_f32()) * 1e-7;
            let mut many = |count: usize| (0..count).map(|_| E::from_f64(next())).collect::<Vec<E>>();
            let (a, b) = (many(3 * op.lanes), many(op.lanes * op.shape.b_numbers));
            let mut out = many(op.lanes * op.shape.out_numbers);
            let mut shadow = Shadow::new();
            let (mut operations, mut largest) = (0, 0.0_f64);
            let recording = step::record(&watched(), ALL, MOST, || op.call(&mut out, &a, &b)).unwrap();
            for step in recording.steps() {
                let StepError { check, errors, overturned, restarted, .. } = shadow.step(&step);
                assert!(check.is_ok_and(|check| check.differences.is_empty()), "{}", op.symbol());
                assert!(overturned.is_empty() && restarted.is_empty(), "{}: {overturned:?} {restarted:?}", op.symbol());
                for error in errors {
                    assert!(error.added.abs() <= 0.5, "{}: {error:?}", op.symbol());
                    operations += usize::from(error.added != 0.0);
                    largest = largest.max(error.error.abs());
                }
            }
            assert!(operations > 0 && largest > 0.0, "{} rounds nothing", op.symbol());
            for lane in 0..op.lanes {
                let of = |numbers: &[E], count: usize| -> Vec<f64> {
                    (0..count).map(|i| numbers[i * op.lanes + lane].to_f64()).collect()
                };
                let exact = exactly(op.name, of(&a, 3).try_into().unwrap(), &of(&b, op.shape.b_numbers));
                for (i, exact) in exact.iter().enumerate() {
                    let number = &out[i * op.lanes + lane];
                    let at = Element::new(Place::Memory, std::ptr::from_ref(number) as u64, format.bytes());
                    let bits = if format == Number::Single {
                        u64::from((number.to_f64() as f32).to_bits())
                    } else {
                        number.to_f64().to_bits()
                    };
                    let found = shadow.value(at, format, bits).unwrap();
                    let error = (&found - exact).abs().to_f64() / exact.abs().to_f64();
                    assert!(error < 2.0_f64.powi(-200), "{}: {found:?} instead of {exact:?}", op.symbol());
                }
            }
        }
    }
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "instructions are recorded on Linux alone")]
fn shadow_of_a_result_is_exact_arithmetic() {
    let mut rng = Rng::new(seed());
    shadows_are_exact::<f32>(Number::Single, &mut rng);
    shadows_are_exact::<f64>(Number::Double, &mut rng);
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "instructions are recorded on Linux alone")]
fn wrong_decision_of_the_paper_is_seen_by_exact_values() {
    const CENTRE: [f64; 3] = [0.0, 0.0, 5000.0];
    let sphere_hit = paper().unwrap().sphere;
    let exact = Sphere::<Exact>::new(CENTRE, 1.0).unwrap();
    let far = sphere(Vec4::new(0.0, 0.0, 5000.0), 1.0);
    let mut wrong = 0;
    for step_aside in 0..40 {
        let ray = [0.05 * step_aside as f32, 0.0, 5000.0];
        let meeting = exact.meet(&Ray::new(ray.map(f64::from))).unwrap();
        let ray = Vec4::new(ray[0], ray[1], ray[2]);
        let mut t = 0.0;
        let recording = step::record(&watched(), ALL, MOST, || t = sphere_hit.call(&ray, &far)).unwrap();
        let (mut shadow, mut overturned, mut cancelled) = (Shadow::new(), 0, 0);
        for step in recording.steps() {
            let found = shadow.step(&step);
            overturned += found.overturned.len();
            cancelled = found.errors.iter().filter_map(|error| error.cancelled).fold(cancelled, u32::max);
        }
        assert!(cancelled >= 20, "b^2 and 4ac have all their digits in common: {cancelled}");
        if meeting.hit.is_some() != t.is_finite() {
            wrong += 1;
            assert!(overturned > 0, "{ray:?}: {t} instead of {meeting:?}");
        }
    }
    assert!(wrong > 0, "the paper has lost none");
}

#[test]
fn every_macro_of_a_step_is_described_by_a_whole_sentence() {
    let macros = || Isa::ALL.into_iter().filter_map(Unit::of).flat_map(|unit| &unit.macros);
    let cut: Vec<_> = macros().filter(|known| !known.says.is_empty() && !known.says.ends_with('.')).collect();
    assert!(cut.is_empty(), "{cut:#?}");
    for known in macros().filter(|known| known.name == "SPHERE_HIT3") {
        assert!(known.says.ends_with("and the mask of those that have one."), "{}", known.says);
    }
}
