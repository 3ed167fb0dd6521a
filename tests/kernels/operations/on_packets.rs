//! The operations on packets: each against its scalar twin to the last bit.
//!
//! Against exact numbers over whole families of objects they are in tests/pictures/stability.rs.

use std::fmt::Debug;

use rayo::kernels::harness::faults;
use rayo::kernels::harness::lanes::{Lanes, Number, Packet, dot};
use rayo::kernels::{Isa, PacketElement, PacketOp, packet_ops};
use rayo::scene::Rng;

use crate::kernel_cases::{Numbers, seed};

/// SPHERE_HIT3: t, or infinity where the ray `d` misses, by the fields of SphereHit.
fn t_of_sphere<L: Lanes>(d: [L; 3], [x, y, z, square, k]: [L; 5]) -> L {
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
fn lambert<L: Lanes>([x, y, z, _, weights @ ..]: [L; 7], o: [L; 3], colour: [L; 3]) -> [L; 3] {
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

#[test]
#[should_panic(expected = "whole packets")]
fn parts_of_packets_are_refused() {
    let op = &packet_ops::<f32>(Isa::Sse41).expect("every CPU that runs these tests has SSE4.1")[0];
    op.call(&mut [0.0; 12], &[0.0; 12], &[0.0; 11]);
}
