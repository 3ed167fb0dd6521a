//! Shared by the tests of kernels: the implementations, seeded random inputs, and scenes.

use rayo::internals::kernels::harness::portable_packets;
use rayo::internals::kernels::{self, AosKernels, Element, Isa, LitRow, LitSphere, PacketKernels};
use rayo::internals::scene::Rng;
pub use rayo_lab::experiments::check::inputs::{Input, Numbers, choose, sphere, triangle};

/// Every table of kernels that this CPU can run, with the name in its symbols.
pub fn implementations() -> Vec<(&'static str, &'static AosKernels)> {
    let all = [("c", kernels::c()), ("paper", kernels::paper()), ("aos", kernels::aos())];
    let (usable, rest): (Vec<_>, Vec<_>) = all.into_iter().partition(|(_, kernels)| kernels.is_some());
    for (name, _) in rest {
        println!("not tested, since this CPU or this build does not run them: the kernels of `{name}`");
    }
    usable.into_iter().map(|(name, kernels)| (name, kernels.unwrap())).collect()
}

/// The packet kernels of every ISA that this CPU can run.
pub fn packet_kernels() -> Vec<(Isa, &'static PacketKernels)> {
    let (usable, rest): (Vec<_>, Vec<_>) = Isa::ALL.into_iter().partition(|isa| isa.usable());
    for isa in rest {
        println!("not tested, since this CPU does not run them: the packet kernels of {isa}");
    }
    usable.into_iter().map(|isa| (isa, kernels::packets(isa).unwrap())).collect()
}

/// A sphere under one light with random numbers in every field; the weights are finite and not
/// negative.
pub fn lit_sphere<E: Element>(numbers: Numbers, rng: &mut Rng) -> LitSphere<E> {
    let [h1, least, q1, kn, ke, red, green, blue] = [0; 8].map(|_| numbers.next(rng).into());
    let [red, green, blue] = [red, green, blue].map(|weight: f64| weight.abs().min(1e30));
    LitSphere { h1, least, q1, kn, ke, red, green, blue }.round()
}

/// A row of a picture of this width with random numbers and a random span of columns; one time in
/// four the span is empty.
pub fn lit_row<E: Element>(numbers: Numbers, width: usize, rng: &mut Rng) -> LitRow<E> {
    let mut below = |n: usize| (rng.next_u64() % n as u64) as usize;
    let (start, end) = (below(width + 1), below(width + 1));
    let (start, end) = if below(4) == 0 { (end.max(start), end.min(start)) } else { (start.min(end), start.max(end)) };
    let middle = (start + end) / 2;
    let [start, end, middle] = [start, end, middle].map(|column| column as f64);
    let [m, a, h0, q0] = [0; 4].map(|_| numbers.next(rng).into());
    LitRow { start, end, j: start - middle, stop: end - middle, m, a, h0, q0 }.round()
}

/// `count` rows as [`lit_row`] makes them.
pub fn lit_rows<E: Element>(numbers: Numbers, width: usize, count: usize, rng: &mut Rng) -> Vec<LitRow<E>> {
    (0..count).map(|_| lit_row(numbers, width, rng)).collect()
}

/// The packet kernels of each ISA that runs here, and their twins: the kernels in Rust with the
/// same lanes and rounding.
pub fn twins() -> Vec<(Isa, &'static PacketKernels, &'static PacketKernels)> {
    let twin = |isa| match isa {
        Isa::Sse41 => portable_packets::<4, 2, false>(),
        Isa::Avx2 => portable_packets::<8, 4, true>(),
        Isa::Avx512 => portable_packets::<16, 8, true>(),
    };
    packet_kernels().into_iter().map(|(isa, kernels)| (isa, kernels, &*Box::leak(Box::new(twin(isa))))).collect()
}

/// The seed of this run: RAYO_SEED, or a fixed one. It is printed, so that it is shown if a test
/// fails.
pub fn seed() -> u64 {
    let seed = match std::env::var("RAYO_SEED") {
        Ok(text) => text.parse().unwrap_or_else(|_| panic!("RAYO_SEED must be a number from 0 to 2^64-1, not {text}")),
        Err(_) => 1,
    };
    println!("replay with RAYO_SEED={seed}");
    seed
}
