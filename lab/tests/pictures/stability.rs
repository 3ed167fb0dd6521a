//! Ill-conditioned and extreme scenes: packets compared with exact results, and with themselves on
//! rotated and scaled scenes.

use std::fs;
use std::path::Path;

use crate::extent;
use crate::mixtures;
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use rayo::internals::render::{FilmMut, PixelFormat, Precision, Tracer};
use rayo::internals::scene::{self, Camera, Light, Scene, Sphere, Triangle, View};
use rayo_lab::experiments::accuracy::{Contender, contenders, judge};
use rayo_lab::families::{Case, FAMILIES, Family, family};
use rayo_lab::truth::Truth;

/// The side of a picture in these tests. `rayo stability` traces larger ones.
const SIDE: u32 = 18;
const SEED: u64 = 5;

fn is_packet(contender: &Contender) -> bool {
    contender.engine.is_packet()
}

/// The contenders that must be right everywhere.
fn robust() -> Vec<Contender> {
    contenders()
        .into_iter()
        .filter(|contender| is_packet(contender) || contender.engine.name() == "reference")
        .collect()
}

/// A case of each level of a family, with the variants alternating.
fn cases(family: &'static Family) -> impl Iterator<Item = Case> {
    let variants = family.variants.len();
    let case = move |level: usize| family.case(level * variants + level % variants, SEED, SIDE);
    // Large pictures with odd sizes are covered by another test.
    (0..family.levels.len()).map(case).filter(|case| case.valid && case.scene.camera.pixels() <= 2000)
}

fn prepare<'a>(contender: &Contender, scene: &'a Scene) -> Box<dyn Tracer + 'a> {
    contender.engine.prepare(Some(contender.precision), scene).unwrap_or_else(|error| panic!("{error}"))
}

/// The bits of the picture's floats and, if the engine writes bytes, its bytes, traced by this
/// thread alone.
fn picture(contender: &Contender, scene: &Scene) -> (Vec<[u32; 4]>, Vec<[u8; 4]>) {
    traced(prepare(contender, scene).as_ref(), scene)
}

fn traced(tracer: &dyn Tracer, scene: &Scene) -> (Vec<[u32; 4]>, Vec<[u8; 4]>) {
    let pixels = scene.camera.pixels() as usize;
    let rows = 0..scene.camera.height();
    let mut floats = vec![rayo::internals::kernels::Vec4::default(); pixels];
    tracer.rows(rows.clone(), FilmMut::F32x4(&mut floats));
    let floats = floats.into_iter().map(|pixel| pixel.lanes().map(f32::to_bits)).collect();
    let mut bytes = vec![[0; 4]; pixels];
    if tracer.writes(PixelFormat::Rgba8) {
        tracer.rows(rows, FilmMut::Rgba8(&mut bytes));
    }
    (floats, bytes)
}

/// Asserts that nothing outside of the margin is wrong, that no pixel is missing, and that t is
/// within its bound.
fn check(scene: &Scene, covered: bool, contenders: &[Contender], what: &str) {
    for judged in judge(scene, contenders).unwrap_or_else(|error| panic!("{what}: {error}")) {
        let (errors, Contender { engine, precision, .. }) = (judged.errors, judged.entry.contender);
        let who = format!("{what}: {engine} in {precision}: {errors:?}");
        assert_eq!((errors.wrong_hits, errors.wrong_objects, errors.off_by_2), (0, 0, 0), "{who}");
        assert!(!covered || errors.wrong_hits_inside == 0, "a hole: {who}");
        if precision == Precision::Double {
            // Engines in f64 only round their result to f32, which alone can change a level.
            assert!(!judged.entry.output.is_8bit() || errors.off_by_1 == 0, "{who}");
        }
        assert!(errors.bound_share.is_none_or(|share| share <= 1.0), "{who}");
    }
}

#[test]
fn robust_engines_are_right_on_every_family() {
    let robust = robust();
    for family in FAMILIES {
        for case in extent::sampled(cases(family), 5) {
            check(&case.scene, case.covered, &robust, &format!("{} case {}, seed {SEED}", case.family, case.index));
        }
    }
}

#[test]
fn the_worst_scenes_that_were_found_are_right() {
    let directory = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("lab/tests/worst-cases");
    let mut checked = 0;
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        let scene = scene::read(&path).unwrap_or_else(|error| panic!("{error}"));
        check(&scene, false, &robust(), &path.display().to_string());
        checked += 1;
    }
    assert!(checked >= 4, "only {checked} scenes were found");
}

#[test]
fn nan_in_a_scene_is_an_error_for_every_engine() {
    let family = family("N1").unwrap();
    let fields = ["radius", "centre", "colour", "vertices", "colour", "position", "colour", "intensity"];
    for index in 0..family.cases() {
        let case = family.case(index, SEED, SIDE);
        for Contender { engine, precision, .. } in contenders() {
            let Err(error) = engine.prepare(Some(precision), &case.scene) else {
                panic!("{engine} in {precision}: {} {}", case.level, case.variant);
            };
            let (text, field) = (error.to_string().to_lowercase(), fields[case.level.value as usize]);
            assert!(text.contains(&format!("'s {field} must be finite")), "{text}");
            assert!(text.contains("nan") || text.contains("inf"), "{text}");
        }
    }
}

#[cfg(all(feature = "asm", target_arch = "x86_64"))]
#[test]
fn operations_alone_keep_their_bounds_over_their_range() {
    use rayo_lab::experiments::stability::operations::{self, OperationRow};
    use std::collections::BTreeSet;
    let families: Vec<_> = FAMILIES.iter().collect();
    let rows = operations::sweep(&families, SEED, true);
    for row in &rows {
        // Without FMA the cross product for a far sphere is rounded twice, and is no more accurate
        // than b/2 is.
        let known = row.engine == "sse41" && row.family == "S1";
        assert!(row.wrong_hits == 0 || known, "{row:?}");
        assert!(row.bound.is_none_or(|share| share <= 1.0) || known, "{row:?}");
        assert!(row.holes.is_none_or(|holes| holes == 0), "{row:?}");
        assert_eq!(row.worst.is_none(), ["N1", "T6"].contains(&&*row.family), "{row:?}");
        assert_eq!(row.holes.is_some(), row.family == "T6", "{row:?}");
    }
    // Engines of one arithmetic class have exactly the same errors.
    for row in rows.iter().filter(|row| row.engine == "avx2") {
        let same = |other: &&OperationRow| {
            (&other.family, &other.operation, &other.precision) == (&row.family, &row.operation, &row.precision)
        };
        let figures = |row: &OperationRow| (row.worst, row.bound, row.wrong_hits, row.holes);
        for other in rows.iter().filter(|other| other.engine == "avx512").filter(same) {
            assert_eq!(figures(row), figures(other), "{row:?}");
        }
    }
    let swept: BTreeSet<_> = rows.iter().map(|row| &*row.family).collect();
    assert_eq!(swept.len(), 15, "{swept:?}");
    let f64_of = |family: &str| rows.iter().find(|row| row.family == family && row.precision == "double").unwrap();
    assert_eq!((f64_of("S1").to.as_str(), f64_of("S3").from.as_str()), ("1e14", "1e-300"));
}

#[test]
fn a_scene_scaled_by_a_power_of_two_has_the_same_bytes() {
    let packets: Vec<_> = contenders().into_iter().filter(is_packet).collect();
    let mut compared = 0;
    for id in ["S1", "S2", "S3", "S5", "S6", "S7", "T1", "T2", "T4", "T5", "T6", "L1", "H1", "H3", "H5"] {
        for case in extent::sampled(cases(family(id).unwrap()).step_by(2), 2) {
            for exponent in [-40, -7, 1, 23, 40] {
                let other = case.scene.scaled(2f32.powi(exponent));
                // Skip scenes with numbers near the limits of f32, which cannot be scaled by that
                // factor and back.
                if other.scaled(2f32.powi(-exponent)) != case.scene {
                    continue;
                }
                for contender in &packets {
                    let same = picture(contender, &case.scene) == picture(contender, &other);
                    let Contender { engine, precision, .. } = contender;
                    assert!(same, "{engine} in {precision}: {id} case {}, seed {SEED}, 2^{exponent}", case.index);
                    compared += 1;
                }
            }
        }
    }
    assert!(
        cfg!(not(all(feature = "asm", target_arch = "x86_64"))) || compared > if extent::all() { 1000 } else { 400 },
        "only {compared} were compared"
    );
}

#[test]
fn orbit_is_the_same_around_a_scaled_scene() {
    let world = scene::many(5, 40, 3);
    for exponent in [-60, -7, 23, 40, 52, 60, 100] {
        let scaled = |scene: &Scene| scene.scaled(2f32.powi(exponent));
        for up in [DVec3::Y, DVec3::new(0.0, 0.8, 0.6)] {
            for part in [0.0, 1e-5, 0.2, 0.25, 0.5, 0.77, 1.0] {
                let world = Scene { view: View { up, ..View::default() }, ..world.clone() };
                let seen = |world: &Scene| world.seen_from(world.orbit(part).unwrap()).unwrap();
                assert!(scaled(&seen(&world)) == seen(&scaled(&world)), "2^{exponent}: {part} of a turn about {up}");
            }
        }
    }
}

#[test]
fn engines_of_one_arithmetic_class_agree_to_the_last_bit() {
    let own = |c: crate::contenders::Contender| Contender { engine: c.engine, precision: c.precision, keep_all: false };
    let twins: Vec<_> = crate::contenders::twins().into_iter().map(|pair| pair.map(own)).collect();
    if !twins.iter().any(|[_, other]| other.engine.name() == "avx512") {
        extent::not_run("avx512", "avx2 and avx512 give the same bits on the families");
    }
    for [one, other] in twins {
        for family in FAMILIES {
            for case in extent::sampled(cases(family), 5) {
                let same = picture(&one, &case.scene).0 == picture(&other, &case.scene).0;
                assert!(same, "{one:?} and {other:?}: {} case {}, seed {SEED}", case.family, case.index);
            }
        }
    }
}

#[cfg(all(feature = "asm", target_arch = "x86_64"))]
#[test]
fn nothing_depends_on_denormal_numbers() {
    for family in FAMILIES {
        for case in extent::sampled(cases(family), 5) {
            // Only for kernels in assembly: Rust assumes that denormals are not flushed.
            let in_assembly = |c: &&Contender| is_packet(c) && c.engine.name() != "portable";
            for contender in contenders().iter().filter(in_assembly) {
                let found = picture(contender, &case.scene);
                let without = rayo::internals::kernels::harness::without_denormals(|| picture(contender, &case.scene));
                let what = format!("{} case {}, seed {SEED}", case.family, case.index);
                assert!(found.1 == without.1, "{what}: bytes of {} in {}", contender.engine, contender.precision);
                // The result itself may be a denormal float.
                let flushed =
                    |pixel: &[u32; 4]| pixel.map(|bits| if bits < f32::MIN_POSITIVE.to_bits() { 0 } else { bits });
                let same = found.0.iter().zip(&without.0).all(|(a, b)| flushed(a) == flushed(b));
                assert!(same, "{what}: floats of {} in {}", contender.engine, contender.precision);
            }
        }
    }
}

fn one_light(camera: Camera, position: Vec3) -> Scene {
    let light = Light { intensity: 0.9, colour: Vec3::ONE, position };
    Scene { lights: vec![light], ..Scene::new(camera) }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any distance from inside to 10^7 radii, any radius, any direction off the axis that the
    /// camera sees.
    #[test]
    fn a_sphere_is_hit_within_its_bound(
        exponent in -0.3f32..7.0, size in -18f32..18.0, x in -1f32..1.0, y in -1f32..1.0, light in 0.1f32..3.0,
    ) {
        let (kappa, radius) = (10f32.powf(exponent), 10f32.powf(size));
        let half = if kappa > 1.2 { 1.0 / kappa } else { 1.0 };
        let camera = Camera::new(12, 12, 1.0, 4.0 * half).unwrap();
        let distance = kappa * radius;
        let mut scene = one_light(camera, Vec3::new(-light * distance, distance, -0.25 * distance));
        let centre = distance * Vec3::new(x * half, y * half, 1.0);
        scene.spheres.push(Sphere { radius, colour: Vec3::ONE, centre });
        check(&scene, false, &robust(), &format!("{scene:?}"));
    }

    /// Any shape from slivers to large triangles, at any distance and with any tilt.
    #[test]
    fn a_triangle_is_hit_within_its_bound(
        corners in prop::array::uniform9(-1f32..1.0), thin in -6f32..0.0, distance in -1f32..6.0, size in -18f32..18.0,
    ) {
        let (thin, distance, size) = (10f32.powf(thin), 10f32.powf(distance), 10f32.powf(size));
        let [a, b, c, d, e, f, g, h, i] = corners;
        let corner = |x: f32, y: f32, z: f32| size * Vec3::new(x, thin * y, distance + z);
        let camera = Camera::new(12, 12, 1.0, (4.0 / distance).min(4.0)).unwrap();
        let mut scene = one_light(camera, size * Vec3::new(2.0, 3.0, -1.0));
        let vertices = [corner(a, b, c), corner(d, e, f), corner(g, h, i)];
        scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
        check(&scene, false, &robust(), &format!("{scene:?}"));
    }
}

/// Whether two numbers differ by at most this share of the larger one, or of 1 if that is larger.
fn near(a: f64, b: f64, share: f64) -> bool {
    a == b || (a - b).abs() <= share * a.abs().max(b.abs()).max(1.0)
}

#[test]
fn truth_in_few_bits_is_that_in_1024_where_sure() {
    let (mut pixels, mut sure, mut hits) = (0, 0, 0);
    for (seed, scene) in mixtures::scenes(150).enumerate() {
        let truth = Truth::new(&scene);
        // A subset of the pixels, in a different order in every picture.
        let step = 7 + seed % 5;
        let all = (0..scene.camera.height()).flat_map(|row| (0..scene.camera.width()).map(move |col| (row, col)));
        for (row, col) in all.step_by(step) {
            pixels += 1;
            let Some(quick) = truth.quick_pixel(row, col) else { continue };
            sure += 1;
            let exact = truth.exact_pixel(row, col);
            let what = || format!("seed {seed} row {row} col {col}: {quick:?} {exact:?}");
            let margins = [quick.margin, exact.margin];
            assert!(
                near(1.0, margins[0] / margins[1], 1e-8) || margins[0] == margins[1] || margins[1] < 1e-17,
                "{}",
                what()
            );
            assert_eq!(quick.hit.is_some(), exact.hit.is_some(), "{}", what());
            let (Some(quick), Some(exact)) = (&quick.hit, &exact.hit) else { continue };
            hits += 1;
            assert_eq!((quick.object, quick.colour.is_some()), (exact.object, exact.colour.is_some()), "{}", what());
            assert!((exact.t.error_of(quick.t.high) + quick.t.low).abs() <= 1e-17 * exact.t.high, "{}", what());
            for (a, b) in quick.normal.iter().zip(exact.normal) {
                assert!((b.error_of(a.high) + a.low).abs() < 1e-17, "{}", what());
            }
            for (a, b) in quick.cosines.iter().zip(&exact.cosines) {
                assert!((a - b).abs() < 2e-16, "{}", what());
            }
            assert!(near(quick.bound, exact.bound, 1e-8) && near(quick.lever, exact.lever, 1e-8), "{}", what());
        }
    }
    println!("{pixels} pixels, {sure} sure, {hits} hits");
    assert!(hits > 10_000 && sure as f64 > 0.95 * f64::from(pixels), "{pixels} pixels, {sure} sure, {hits} hits");
}
