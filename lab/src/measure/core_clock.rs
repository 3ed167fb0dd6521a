//! Times in cycles of the core's own clock, which is measured with a chain of operations of known
//! latency.

use super::Watch;
use rayo::internals::kernels::Cycles;
use rayo::internals::kernels::sys;

/// Rounds of the chain: some 20 microseconds.
const CHAIN_ROUNDS: u32 = 1000;
/// How much the clock may drift during a measurement that counts as steady.
const DRIFT: f64 = 0.01;
/// If fewer measurements than this are plausible, more are made, up to [`MORE`] times the number
/// requested.
const ENOUGH: u32 = 3;
const MORE: u32 = 3;

fn chain_cycles() -> f64 {
    f64::from(CHAIN_ROUNDS * sys::CHAIN_LINKS * sys::CHAIN_LATENCY)
}

fn chain_ticks() -> f64 {
    let start = Cycles::start();
    sys::multiply_in_chain(CHAIN_ROUNDS);
    start.stop() as f64
}

/// Cycles of the core for each tick of the time-stamp counter, now: above 1 where it runs faster
/// than its nominal clock. The best of seven, which no interrupt hit.
pub fn core_cycles_per_tick() -> f64 {
    chain_cycles() / (0..7).map(|_| chain_ticks()).fold(f64::INFINITY, f64::min)
}

/// The core cycles of one of the operations that `action` does and counts: the fewest of `repeats`,
/// each measured between two chains of known length, since a core changes its clock with load and
/// temperature. Repeats during which it changed are dropped, unless all are.
///
/// A repeat in which others had the core, or in which an operation seems to take fewer than the
/// `least` cycles possible, does not count, and more are made if too few are left. None if none is.
pub fn core_cycles(repeats: u32, least: f64, mut action: impl FnMut() -> u64) -> Option<f64> {
    let measured = std::iter::repeat_with(|| {
        let watch = Watch::start();
        let before = chain_ticks();
        let start = Cycles::start();
        let operations = action();
        let ticks = start.stop() as f64;
        let after = chain_ticks();
        let cycles = ticks * 2.0 * chain_cycles() / (before + after) / operations as f64;
        (!watch.taken()).then_some((cycles, (before - after).abs() < DRIFT * before))
    });
    fewest(measured, repeats, least)
}

/// The fewest plausible cycles, which are those from `least` up; of steady measurements if there
/// are any.
fn fewest(measured: impl Iterator<Item = Option<(f64, bool)>>, repeats: u32, least: f64) -> Option<f64> {
    let (mut steady, mut any) = (None, None);
    let mut right = 0;
    for (made, measured) in (0..MORE * repeats).zip(measured) {
        if made >= repeats && right >= ENOUGH {
            break;
        }
        let Some((cycles, is_steady)) = measured.filter(|(cycles, _)| *cycles >= least) else { continue };
        right += 1;
        let fewer = |fewest: Option<f64>| Some(fewest.map_or(cycles, |fewest| fewest.min(cycles)));
        any = fewer(any);
        if is_steady {
            steady = fewer(steady);
        }
    }
    steady.or(any)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_cycles_are_measured_again_or_withheld() {
        let of = |measured: &[Option<(f64, bool)>]| fewest(measured.iter().copied(), 2, 1.0);
        for (measured, expected) in [
            // The fourth is not needed, or the others would not be enough.
            (&[Some((3.0, true)), Some((4.0, true)), Some((5.0, true)), Some((2.0, true))][..], Some(3.0)),
            (&[Some((3.0, true)), None, None, Some((2.0, true))], Some(2.0)),
            (&[Some((0.2, true)), None, Some((4.0, true)), Some((5.0, true))], Some(4.0)),
            (&[Some((3.0, false)), Some((4.0, true))], Some(4.0)),
            (&[Some((4.0, false)), Some((3.0, false))], Some(3.0)),
            (&[Some((0.9, true)), None, Some((0.0, false))], None),
            (&[Some((f64::NAN, true)), Some((1.0, true))], Some(1.0)),
        ] {
            assert_eq!(of(measured), expected, "{measured:?}");
        }
    }
}
