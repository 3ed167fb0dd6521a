//! Times in cycles of the core's own clock, which a chain of operations of known latency tells.

use super::Cycles;
use crate::kernels::sys;

/// Rounds of the chain: some 20 microseconds.
const CHAIN_ROUNDS: u32 = 1000;
/// How much the clock may drift during a measurement that counts as steady.
const DRIFT: f64 = 0.01;

fn chain_cycles() -> f64 {
    f64::from(CHAIN_ROUNDS * sys::CHAIN_LINKS * sys::CHAIN_LATENCY)
}

fn chain_ticks() -> f64 {
    let start = Cycles::start();
    sys::multiply_in_chain(CHAIN_ROUNDS);
    start.stop() as f64
}

/// Cycles of the core for each tick of the time-stamp counter, now: above 1 where it runs faster than its nominal clock.
/// The best of seven, which no interrupt hit.
pub fn core_cycles_per_tick() -> f64 {
    chain_cycles() / (0..7).map(|_| chain_ticks()).fold(f64::INFINITY, f64::min)
}

/// The core cycles that `action` takes: the fewest of `repeats`, each measured between two chains of known length, since a
/// core changes its clock with load and temperature. Repeats during which it changed are left out, if not all of them.
pub fn core_cycles(repeats: u32, mut action: impl FnMut()) -> f64 {
    let (mut steady, mut any) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..repeats {
        let before = chain_ticks();
        let start = Cycles::start();
        action();
        let ticks = start.stop() as f64;
        let after = chain_ticks();
        let cycles = ticks * 2.0 * chain_cycles() / (before + after);
        any = any.min(cycles);
        if (before - after).abs() < DRIFT * before {
            steady = steady.min(cycles);
        }
    }
    if steady.is_finite() { steady } else { any }
}
