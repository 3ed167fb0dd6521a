//! The operations on packets: each against its scalar twin to the last bit, and what they hit by hand and against each other.

use std::fmt::Debug;

use glam::DVec3;
use rayo::kernels::harness::faults;
use rayo::kernels::harness::lanes::{Lanes, Number, Packet, dot};
use rayo::kernels::{Isa, OpRef, PacketElement, PacketOp, Vec4, packet_ops, paper};
use rayo::plan::{InUnits, sphere_hit, triangle_hit};
use rayo::reference::geometry;
use rayo::scene::Rng;

use super::{MISS, SPHERES, TRIANGLES};
use crate::kernel_cases::{Input, Numbers, seed};

/// SPHERE_HIT3: t, or infinity where the ray `d` misses, by the fields of SphereHit.
pub fn t_of_sphere<L: Lanes>(d: [L; 3], [x, y, z, square, k]: [L; 5]) -> L {
    let c = [x, y, z];
    // VDIFFERENCE: Kahan's difference of products.
    let across = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let w = d[i] * c[j];
        let difference = d[j].fms(c[i], w);
        if L::FUSED { difference + w.fnma(d[i], c[j]) } else { difference }
    });
    let h = dot(d, c);
    let q = h + (dot(d, d) * square - dot(across, across)).sqrt().with_sign_of(h);
    let t = (q * k).greater(L::of(0.0)).select(k / q, q / dot(d, d));
    t.greater(L::of(0.0)).select(t, L::of(f64::INFINITY))
}

/// TRIANGLE_HIT3: t, or infinity where the ray `d` misses, by the fields of TriangleHit.
fn t_of_triangle<L: Lanes>(d: [L; 3], [[x, y, z, k], edges @ ..]: [[L; 4]; 4]) -> L {
    let w = dot(d, [x, y, z]);
    let inside = edges.map(|[x, y, z, bound]| bound.greater(dot(d, [x, y, z])));
    let hit = inside.into_iter().fold(w.greater(L::of(0.0)), L::and);
    hit.select(k / w, L::of(f64::INFINITY))
}

/// LAMBERT3: a colour, and what the light, an ObjectLight, adds to it at the point o of a sphere of radius 1 about the origin.
pub fn lambert<L: Lanes>([x, y, z, _, weights @ ..]: [L; 7], o: [L; 3], colour: [L; 3]) -> [L; 3] {
    let l = [x - o[0], y - o[1], z - o[2]];
    let cosine = (dot(o, l) / dot(l, l).sqrt()).max(L::of(0.0)).min(L::of(1.0));
    [0, 1, 2].map(|i| colour[i].fma(cosine, weights[i]))
}

/// What the operation makes of one vector: one lane of the macros of asm/include, in the same order.
fn twin<L: Lanes>(op: &str, a: [L::Number; 3], b: &[L::Number]) -> Vec<L::Number> {
    let (a, b): (_, Vec<_>) = (a.map(L::all), b.iter().map(|b| L::all(*b)).collect());
    let three = || [b[0], b[1], b[2]];
    let found = match op {
        "add" => (0..3).map(|i| a[i] + b[i]).collect(),
        "sub" => (0..3).map(|i| a[i] - b[i]).collect(),
        "scale" => a.map(|a| a * b[0]).to_vec(),
        "dot" => vec![dot(a, three())],
        "norm" => vec![dot(a, a).sqrt()],
        "cross" => [(1, 2), (2, 0), (0, 1)].map(|(i, j)| (a[i] * b[j]).fnma(a[j], b[i])).to_vec(),
        "normalise" => a.map(|x| x / dot(a, a).sqrt()).to_vec(),
        "sphere" => vec![t_of_sphere(a, b[..5].try_into().unwrap())],
        "triangle" => vec![t_of_triangle(a, [0, 4, 8, 12].map(|i| b[i..i + 4].try_into().unwrap()))],
        "lambert" => lambert(b[..7].try_into().unwrap(), a, [L::of(0.0); 3]).to_vec(),
        _ => panic!("the operation `{op}` on packets needs a twin"),
    };
    found.into_iter().map(|x: L| x.lane(0)).collect()
}

/// Whether two results are the same number, with its sign, or both are NaN.
fn same<E: PacketElement>(a: &[E], b: &[E]) -> bool {
    let (a, b) = (a.iter().map(|x| x.to_f64()), b.iter().map(|x| x.to_f64()));
    a.zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan())
}

/// Calls `op` for so many packets of `numbers`, with a record where it takes one, and compares each result.
fn check<E: PacketElement + Number + Debug>(
    isa: Isa,
    op: &PacketOp<E>,
    packets: usize,
    record: &[E],
    mut numbers: impl FnMut() -> E,
) {
    let twin = if isa == Isa::Sse41 { twin::<Packet<E, 1, false>> } else { twin::<Packet<E, 1, true>> };
    let (shape, lanes, vectors) = (op.shape, op.lanes, packets * op.lanes);
    let mut many = |count: usize| (0..count).map(|_| numbers()).collect::<Vec<_>>();
    let a = many(3 * vectors);
    let mut b = many(shape.b_numbers * vectors);
    b.extend(record);
    let mut out = many(shape.out_numbers * vectors);
    assert_eq!(faults(|| op.call(&mut out, &a, &b)), [], "{}", op.symbol());
    let mut again = many(out.len());
    op.call(&mut again, &a, &b);
    assert!(same(&again, &out), "{}", op.symbol());
    for vector in 0..vectors {
        let of = |numbers: &[E], count: usize| -> Vec<E> {
            (0..count).map(|i| numbers[(vector / lanes * count + i) * lanes + vector % lanes]).collect()
        };
        let ray: [E; 3] = of(&a, 3).try_into().unwrap();
        let own = if record.is_empty() { of(&b, shape.b_numbers) } else { record.to_vec() };
        let (found, expected) = (of(&out, shape.out_numbers), twin(op.name, ray, &own));
        assert!(same(&found, &expected), "{}: {found:?} instead of {expected:?} of {ray:?} and {own:?}", op.symbol());
    }
}

fn all_equal_their_twins<E: PacketElement + Number + Debug>(rng: &mut Rng) {
    for isa in Isa::ALL {
        for op in packet_ops::<E>(isa).into_iter().flatten() {
            for numbers in Numbers::ALL {
                for case in 0..300 {
                    let record: Vec<E> = (0..op.shape.record).map(|_| E::from_f64(numbers.next(rng).into())).collect();
                    check(isa, op, case % 4, &record, || E::from_f64(numbers.next(rng).into()));
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
