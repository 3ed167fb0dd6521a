//! The operations on packets: each against its scalar twin to the last bit, and what they hit by hand and against each other.

use glam::DVec3;
use rayo::kernels::{Element, Isa, OpRef, PacketElement, PacketOp, Vec4, packet_ops, paper};
use rayo::plan::{InUnits, sphere_hit, triangle_hit};
use rayo::reference::packet::{self, Rounding};
use rayo::reference::{Real, geometry};
use rayo::scene::Rng;

use super::{MISS, SPHERES, TRIANGLES};
use crate::kernel_cases::{Input, Numbers, seed};

fn rounding(isa: Isa) -> Rounding {
    if isa == Isa::Sse41 { Rounding::Unfused } else { Rounding::Fused }
}

/// What the operation makes of one vector, by the twin.
fn twin<E: Real>(op: &str, rounding: Rounding, a: [E; 3], b: &[E]) -> Vec<E> {
    let three = |i: usize| [b[i], b[i + 1], b[i + 2]];
    match op {
        "add" => (0..3).map(|i| a[i] + b[i]).collect(),
        "sub" => (0..3).map(|i| a[i] - b[i]).collect(),
        "scale" => a.map(|a| a * b[0]).to_vec(),
        "dot" => vec![rounding.dot(a, three(0))],
        "norm" => vec![rounding.norm(a)],
        "cross" => rounding.cross(a, three(0)).to_vec(),
        "normalise" => rounding.normalise(a).to_vec(),
        "sphere" => vec![rounding.sphere_hit(&packet::SphereHit { centre: three(0), square: b[3], k: b[4] }, a)],
        "triangle" => {
            let edges = [4, 8, 12].map(|i| (three(i), b[i + 3]));
            vec![rounding.triangle_hit(&packet::TriangleHit { normal: three(0), k: b[3], edges }, a)]
        }
        "lambert" => {
            rounding.lambert(&packet::Light { position: three(0), weights: three(4) }, a, [E::ZERO; 3]).to_vec()
        }
        _ => panic!("the operation `{op}` on packets needs a twin"),
    }
}

/// Whether two results are the same number, with its sign, or both are NaN.
fn same<E: PacketElement>(a: &[E], b: &[E]) -> bool {
    let (a, b) = (a.iter().map(|x| x.to_f64()), b.iter().map(|x| x.to_f64()));
    a.zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan())
}

/// Calls `op` for so many packets of `numbers`, with a record where it takes one, and compares each result.
fn check<E: PacketElement + Real>(
    isa: Isa,
    op: &PacketOp<E>,
    packets: usize,
    record: &[E],
    mut numbers: impl FnMut() -> E,
) {
    let (shape, lanes, vectors) = (op.shape, op.lanes, packets * op.lanes);
    let mut many = |count: usize| (0..count).map(|_| numbers()).collect::<Vec<_>>();
    let a = many(3 * vectors);
    let mut b = many(shape.b_numbers * vectors);
    b.extend(record);
    let mut out = many(shape.out_numbers * vectors);
    assert_eq!(op.call_checked(&mut out, &a, &b), Ok(()), "{}", op.symbol());
    let mut again = many(out.len());
    op.call(&mut again, &a, &b);
    assert!(same(&again, &out), "{}", op.symbol());
    for vector in 0..vectors {
        let of = |numbers: &[E], count: usize| -> Vec<E> {
            (0..count).map(|i| numbers[(vector / lanes * count + i) * lanes + vector % lanes]).collect()
        };
        let ray: [E; 3] = of(&a, 3).try_into().unwrap();
        let own = if record.is_empty() { of(&b, shape.b_numbers) } else { record.to_vec() };
        let (found, expected) = (of(&out, shape.out_numbers), twin(op.name, rounding(isa), ray, &own));
        assert!(same(&found, &expected), "{}: {found:?} instead of {expected:?} of {ray:?} and {own:?}", op.symbol());
    }
}

fn all_equal_their_twins<E: PacketElement + Real>(rng: &mut Rng) {
    for isa in Isa::ALL {
        for op in packet_ops::<E>(isa).into_iter().flatten() {
            for numbers in Numbers::ALL {
                for case in 0..300 {
                    let record: Vec<E> =
                        (0..op.shape.record).map(|_| <E as Element>::from_f64(numbers.next(rng).into())).collect();
                    check(isa, op, case % 4, &record, || <E as Element>::from_f64(numbers.next(rng).into()));
                }
            }
        }
    }
}

#[test]
fn every_operation_on_packets_equals_its_twin_to_the_last_bit_and_keeps_the_calling_convention() {
    let mut rng = Rng::new(seed());
    all_equal_their_twins::<f32>(&mut rng);
    all_equal_their_twins::<f64>(&mut rng);
}

/// t of each of `rays`, by the operation `name` on packets.
fn hits<E: PacketElement>(isa: Isa, name: &str, rays: &[[f32; 3]], record: &[E]) -> Vec<f64> {
    let op = packet_ops::<E>(isa).unwrap().iter().find(|op| op.name == name).unwrap();
    let mut found = Vec::new();
    for rays in rays.chunks(op.lanes) {
        // The last packet is filled up with rays that have no direction.
        let number = |i: usize| rays.get(i % op.lanes).map_or(0.0, |ray| ray[i / op.lanes]);
        let a: Vec<_> = (0..3 * op.lanes).map(|i| E::from_f64(number(i).into())).collect();
        let mut out = vec![E::default(); op.lanes];
        op.call(&mut out, &a, record);
        found.extend(out[..rays.len()].iter().map(|t| t.to_f64()));
    }
    found
}

/// Calls `check` with each ISA that runs here and the function [`hits`] of f32 and of f64, records made by `record`.
fn in_every_form(mut check: impl FnMut(&str, &dyn Fn(&str, &[[f32; 3]], Object) -> Vec<f64>)) {
    fn of<E: PacketElement>(isa: Isa, name: &str, rays: &[[f32; 3]], object: Object) -> Vec<f64> {
        let reach = [0, 1, 2].map(|i| rays.iter().map(|ray| ray[i].abs()).fold(0.0, f32::max));
        let wide = |v: [f32; 3]| v.map(f64::from);
        let (record, unit): (Vec<E>, f64) = match object {
            Object::Sphere(centre, radius) => {
                let InUnits { record, unit } = sphere_hit(wide(centre), radius.into());
                (record.numbers(), unit)
            }
            Object::Triangle(vertices) => {
                let InUnits { record, unit } = triangle_hit(vertices.map(wide), wide(reach));
                (record.numbers(), unit)
            }
        };
        hits(isa, name, rays, &record).into_iter().map(|t| unit * t).collect()
    }
    for isa in Isa::ALL.into_iter().filter(|isa| isa.usable()) {
        check(&format!("{isa} f32"), &|name, rays, object| of::<f32>(isa, name, rays, object));
        check(&format!("{isa} f64"), &|name, rays, object| of::<f64>(isa, name, rays, object));
    }
}

#[derive(Clone, Copy)]
enum Object {
    Sphere([f32; 3], f32),
    Triangle([[f32; 3]; 3]),
}

#[test]
fn packets_hit_spheres_and_triangles_on_each_path_as_worked_out_by_hand() {
    in_every_form(|form, hits| {
        for (path, ray, centre, radius, t) in SPHERES {
            let found = hits("sphere", &[ray], Object::Sphere(centre, radius))[0];
            let close = path == "a slanting ray" && (found - f64::from(t)).abs() < 1e-6;
            assert!(found == f64::from(t) || close, "{form}, {path}: {found} instead of {t}");
        }
        for (path, ray, [a, b, c], t) in TRIANGLES {
            for vertices in [[a, b, c], [b, c, a], [c, a, b], [c, b, a], [b, a, c], [a, c, b]] {
                let found = hits("triangle", &[ray], Object::Triangle(vertices))[0];
                assert_eq!(found, f64::from(t), "{form}, {path}, {vertices:?}");
            }
        }
    });
}

impl Object {
    /// t in f64, by the readable geometry.
    fn truth(self, ray: DVec3) -> f64 {
        let point = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        let t = match self {
            Object::Sphere(centre, radius) => geometry::sphere(ray, point(centre), radius.into()),
            Object::Triangle(vertices) => geometry::triangle(ray, vertices.map(point)),
        };
        t.unwrap_or(MISS.into())
    }
}

#[test]
fn packets_hit_what_the_readable_geometry_hits_where_rounding_does_not_decide() {
    let mut rng = Rng::new(seed());
    let paper = paper().expect("every CPU that runs these tests has SSE4.1");
    let three = |v: Vec4| [v.x, v.y, v.z];
    let (mut clear, mut hit) = (0, 0);
    for op in [OpRef::Sphere(paper.sphere), OpRef::Triangle(paper.triangle)].into_iter().cycle().take(4_000) {
        let input = Input::aimed(op, &mut rng);
        let (name, ray, object) = match input {
            Input::Sphere(ray, s) => ("sphere", three(ray), Object::Sphere(three(s.centre), s.radius)),
            Input::Triangle(ray, t) => ("triangle", three(ray), Object::Triangle([t.v1, t.v2, t.v3].map(three))),
            _ => unreachable!("those are what was asked for"),
        };
        // A ray that is turned a little meets the object, too, and not far from there; or it misses it, too.
        let exact = DVec3::from(ray.map(f64::from));
        let by = 1e-4 * exact.abs().max_element();
        let t = object.truth(exact);
        let agrees = |other: f64, within: f64| other == t || (other - t).abs() <= within * t;
        let turned = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
        if !turned.iter().all(|axis| agrees(object.truth(exact + by * axis), 0.01)) {
            continue;
        }
        (clear, hit) = (clear + 1, hit + u32::from(t.is_finite()));
        in_every_form(|form, hits| {
            let found = hits(name, &[ray], object)[0];
            assert!(agrees(found, 1e-4), "{form}: {found} instead of {t} for {input:?}");
        });
    }
    assert!(clear > 3_000 && hit > 1_000, "{hit} of {clear}");
}

/// The second finding of the numerics: b^2 - 4 a c is lost there in f32.
#[test]
fn a_sphere_that_is_far_for_its_size_is_hit_where_it_is_by_those_that_have_fma() {
    let (centre, radius) = ([3.0, -2.0, 9_000.0], 1.0);
    let rays: Vec<[f32; 3]> = (-60..60).map(|i| [(3.0 + i as f32 / 50.0) / 9_000.0, -2.0 / 9_000.0, 1.0]).collect();
    let object = Object::Sphere(centre, radius);
    let expected: Vec<_> = rays.iter().map(|ray| object.truth(DVec3::from(ray.map(f64::from))).is_finite()).collect();
    let hit = expected.iter().filter(|hit| **hit).count();
    assert!((97..=103).contains(&hit), "{hit}: a hundred fit into its diameter");
    in_every_form(|form, hits| {
        let found: Vec<_> = hits("sphere", &rays, object).into_iter().map(f64::is_finite).collect();
        let wrong = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
        // Without FMA x is right to 2^-24 |C| |d|, here half a thousandth of the radius; the rays are fifty to a radius.
        assert!(wrong <= if form == "sse41 f32" { 2 } else { 0 }, "{form}: {wrong}");
    });
}

#[test]
fn triangles_that_share_an_edge_leave_no_crack() {
    let mut rng = Rng::new(seed());
    for _ in 0..500 {
        let mut point = || [rng.between(-2.0, 2.0), rng.between(-2.0, 2.0), rng.between(2.0, 6.0)];
        let [a, b] = [point(), point()];
        // One on each side of the edge, as seen from the origin.
        let (c, d) = ([-3.0, rng.between(-2.0, 2.0), 4.0], [3.0, rng.between(-2.0, 2.0), 4.0]);
        let side = |v: [f32; 3]| {
            let [a, b, v] = [a, b, v].map(|v| DVec3::from(v.map(f64::from)));
            a.cross(b).dot(v)
        };
        if side(c) * side(d) >= 0.0 {
            continue;
        }
        let rays: Vec<[f32; 3]> = (1..64)
            .map(|i| {
                let share = i as f32 / 64.0;
                [0, 1, 2].map(|i| a[i] + share * (b[i] - a[i]))
            })
            .collect();
        in_every_form(|form, hits| {
            let one = hits("triangle", &rays, Object::Triangle([a, b, c]));
            let other = hits("triangle", &rays, Object::Triangle([b, a, d]));
            for (ray, (one, other)) in rays.iter().zip(one.into_iter().zip(other)) {
                assert!(one.is_finite() || other.is_finite(), "{form}: {ray:?} between {a:?} {b:?} {c:?} {d:?}");
            }
        });
    }
}

#[test]
#[should_panic(expected = "whole packets")]
fn parts_of_packets_are_refused() {
    let op = &packet_ops::<f32>(Isa::Sse41).expect("every CPU that runs these tests has SSE4.1")[0];
    op.call(&mut [0.0; 12], &[0.0; 12], &[0.0; 11]);
}
