//! Times in cycles of the core's own clock, which is measured with a chain of operations of known
//! latency.

use super::ThreadWatch;
use rayo::internals::kernels::Cycles;
use rayo::internals::kernels::sys;

/// The number of rounds of the chain, which take about 20 microseconds.
const CHAIN_ROUNDS: u32 = 1000;
/// The largest relative change of the core's clock during a measurement that counts as steady.
const DRIFT: f64 = 0.01;
/// If fewer measurements than this are plausible, more are made: in all up to [`MORE`] times the
/// requested number.
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

/// The core's current cycles per tick of the time-stamp counter: above 1 where the core runs faster
/// than its nominal clock. Of seven measurements the one that no interrupt has made longer counts.
pub fn core_cycles_per_tick() -> f64 {
    chain_cycles() / (0..7).map(|_| chain_ticks()).fold(f64::INFINITY, f64::min)
}

/// The core cycles of one operation of those that `action` does and counts: the fewest of `repeats`
/// measurements. Each is made between two chains of known length, since a core changes its clock
/// with load and temperature. Measurements during which the clock changed do not count, unless it
/// changed in all.
///
/// A measurement does not count if it was preempted, or if an operation seems to take fewer cycles
/// than `least`, which is impossible; more are made if too few are left. None if none is left.
pub fn core_cycles(repeats: u32, least: f64, mut action: impl FnMut() -> u64) -> Option<f64> {
    let measured = std::iter::repeat_with(|| {
        let watch = ThreadWatch::start();
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

/// The fewest cycles among the plausible measurements, which have at least `least`; among the
/// steady ones, if there are any.
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
