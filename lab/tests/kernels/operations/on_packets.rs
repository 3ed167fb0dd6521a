//! The operations on packets, each compared with its scalar twin to the last bit.
//!
//! lab/tests/pictures/stability.rs compares them with exact numbers, over whole families of
//! objects.

use std::fmt::Debug;

use rayo::internals::kernels::harness::lanes::Number;
use rayo::internals::kernels::{Isa, PacketElement, packet_ops};
use rayo_lab::experiments::check::operation_on_packets;

use crate::kernel_cases::seed;

/// The number of calls with packets from each source of numbers.
const CASES: u32 = 300;

fn all_equal_their_twins<E: PacketElement + Number + Debug>(seed: u64) {
    for isa in Isa::ALL {
        for op in packet_ops::<E>(isa).into_iter().flatten() {
            operation_on_packets(op, isa, CASES, seed).unwrap_or_else(|failed| panic!("{failed}"));
        }
    }
}

#[test]
fn packet_operations_equal_their_twins_to_the_last_bit() {
    let seed = seed();
    all_equal_their_twins::<f32>(seed);
    all_equal_their_twins::<f64>(seed);
}

#[test]
#[should_panic(expected = "whole packets")]
fn parts_of_packets_are_refused() {
    let op = &packet_ops::<f32>(Isa::Sse41).expect("every CPU that runs these tests has SSE4.1")[0];
    op.call(&mut [0.0; 12], &[0.0; 12], &[0.0; 11]);
}
