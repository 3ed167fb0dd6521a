//! One kernel called on vectors: the dot product as the paper's C, as the paper's macro, and in
//! packets of each width.
//!
//! `cargo run --release -p rayo --example one_kernel` runs it. Calls are safe: a table of kernels
//! exists only if the CPU supports them, and a kernel compares lengths before it starts. It needs
//! the library with the features `asm` and `c`; a build without one of them, or for another CPU
//! than x86-64, has fewer tables. Unlike the other examples it reaches into the crate:
//! `rayo::internals` is no part of what its documentation lists, and may change with any version.

use rayo::glam::Vec3;
use rayo::internals::kernels::{Isa, Vec4, c, packet_ops, paper};

/// The products of each pair, by the name of the kernel.
type Products = Vec<(&'static str, Vec<f32>)>;

/// a . b of every pair, by every kernel that this CPU supports.
fn products(pairs: &[(Vec3, Vec3)]) -> Products {
    let mut all = Vec::new();
    // One vector in one register, as in the paper: x, y, z and 0.
    let register = |Vec3 { x, y, z }: Vec3| Vec4 { x, y, z, w: 0.0 };
    for (name, kernels) in [("c", c()), ("paper", paper())] {
        let Some(kernels) = kernels else { continue };
        let product = |(a, b): &(Vec3, Vec3)| kernels.dot.call(&register(*a), &register(*b));
        all.push((name, pairs.iter().map(product).collect()));
    }
    // One vector in each lane: of 4, 8 or 16 vectors all x, then all y, then all z.
    for isa in Isa::ALL {
        let Some(ops) = packet_ops::<f32>(isa) else { continue };
        let dot = ops.iter().find(|op| op.name == "dot").expect("packets have every operation");
        let packets = pairs.len().div_ceil(dot.lanes);
        let turned = |side: fn(&(Vec3, Vec3)) -> Vec3| {
            let mut numbers = vec![0.0; 3 * dot.lanes * packets];
            for (packet, pairs) in numbers.chunks_mut(3 * dot.lanes).zip(pairs.chunks(dot.lanes)) {
                for (lane, pair) in pairs.iter().enumerate() {
                    let Vec3 { x, y, z } = side(pair);
                    [packet[lane], packet[dot.lanes + lane], packet[2 * dot.lanes + lane]] = [x, y, z];
                }
            }
            numbers
        };
        let mut out = vec![0.0; dot.lanes * packets];
        dot.call(&mut out, &turned(|pair| pair.0), &turned(|pair| pair.1));
        // The lanes beyond the last pair held zeros.
        out.truncate(pairs.len());
        all.push((isa.name(), out));
    }
    all
}

/// This many pairs of integer vectors, whose products are exact however they are rounded and
/// summed.
fn pairs(count: u8) -> Vec<(Vec3, Vec3)> {
    let vector = |n: u8| Vec3::new(f32::from(n), 2.0, -1.0);
    (0..count).map(|n| (vector(n), vector(n / 2))).collect()
}

fn main() {
    for (name, products) in products(&pairs(6)) {
        println!("{name:8} {products:?}");
    }
}

#[test]
fn all_of_them_give_the_product() {
    let pairs = pairs(21);
    let expected: Vec<_> = pairs.iter().map(|(a, b)| a.dot(*b)).collect();
    let all = products(&pairs);
    assert!(!all.is_empty());
    for (name, products) in all {
        assert_eq!(products, expected, "{name}");
    }
}
