//! The interleaved runner: contestants take turns, so that whatever changes over time affects all
//! of them.

use std::ops::Range;
use std::sync::OnceLock;
use std::time::Instant;

use super::statistics;
use super::watch::{Interruption, ThreadWatch};
use rayo::internals::kernels::sys;
use rayo::internals::kernels::{Cycles, tsc_hz};

/// The distance from the median, in MAD (median absolute deviations), beyond which a run is
/// reported as off.
pub const OFF_BY_MAD: f64 = 3.0;

/// How often a preempted run is repeated at most, so that a busy core cannot prolong a measurement
/// without end.
const AGAIN: usize = 3;

/// The clock of a measurement. Tests use an artificial one, by which every statistic can be
/// checked.
pub trait Clock {
    /// The ticks that `work` takes.
    fn time(&mut self, work: &mut dyn FnMut()) -> u64;

    /// The core that runs this thread, if known.
    fn core(&mut self) -> Option<usize> {
        sys::current_core()
    }

    /// Whether the last timed work was preempted: whether another thread had the core meanwhile.
    fn taken(&mut self) -> bool {
        false
    }
}

/// A clock that takes its ticks from a given sequence.
pub struct Scripted<I>(pub I);

impl<I: Iterator<Item = u64>> Clock for Scripted<I> {
    fn time(&mut self, _: &mut dyn FnMut()) -> u64 {
        self.0.next().expect("the script is long enough")
    }

    fn core(&mut self) -> Option<usize> {
        Some(0)
    }
}

/// A clock of this machine that notices preemption. If preemptions were few enough, the thread's
/// own CPU time tells how long the work took; it is then used, and the work does not count as
/// preempted.
#[derive(Clone, Copy, Debug)]
pub struct MachineClock {
    of_counter: bool,
    taken: bool,
    /// The ticks of all work timed so far.
    pub total: u64,
}

impl MachineClock {
    /// Ticks per second of [`MachineClock::wall`].
    pub const WALL_HZ: f64 = 1e9;

    /// The time-stamp counter; None if the machine has none that can be read.
    pub fn counter() -> Option<Self> {
        Cycles::available().then_some(MachineClock { of_counter: true, ..MachineClock::wall() })
    }

    /// The operating system's clock, which every machine has: its ticks are nanoseconds.
    pub fn wall() -> Self {
        MachineClock { of_counter: false, taken: false, total: 0 }
    }
}

/// The rate of the time-stamp counter, measured once by [`tsc_hz`].
fn counter_hz() -> Option<f64> {
    static HZ: OnceLock<Option<f64>> = OnceLock::new();
    *HZ.get_or_init(tsc_hz)
}

impl Clock for MachineClock {
    fn time(&mut self, work: &mut dyn FnMut()) -> u64 {
        let watch = ThreadWatch::start();
        let ticks = if self.of_counter {
            let start = Cycles::start();
            work();
            start.stop()
        } else {
            let start = Instant::now();
            work();
            start.elapsed().as_nanos() as u64
        };
        let Interruption { taken, own } = watch.read();
        self.total += ticks;
        let hz = || if self.of_counter { counter_hz() } else { Some(Self::WALL_HZ) };
        let by_own = own.and_then(|own| Some((own.as_secs_f64() * hz()?) as u64));
        self.taken = taken && by_own.is_none();
        by_own.map_or(ticks, |own| own.min(ticks))
    }

    fn taken(&mut self) -> bool {
        self.taken
    }
}

/// Something to time.
pub type Work<'a> = Box<dyn FnMut() + 'a>;

/// The runs of one contestant, in the order of the rounds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Runs {
    pub ticks: Vec<f64>,
    /// The number of runs that ended on another core than the one they began on.
    pub migrations: usize,
    /// For each run whether it was preempted, however often it was repeated.
    pub taken: Vec<bool>,
}

/// Whether `clean` undisturbed runs out of `all` are enough for a verdict: at least half.
pub fn enough(clean: usize, all: usize) -> bool {
    2 * clean >= all
}

impl Runs {
    /// The number of runs further from the median than [`OFF_BY_MAD`] MAD.
    pub fn off(&self) -> usize {
        statistics::outliers(&self.ticks, OFF_BY_MAD)
    }
}

/// Times each of `contestants` once in each of `rounds`, and keeps every run. Odd rounds go
/// backwards, so that each contestant follows its neighbour as often as it precedes it. A preempted
/// run is repeated up to `AGAIN` times.
///
/// `proceed` is called after each round; if it returns false, the result is None.
pub fn interleave(
    clock: &mut dyn Clock,
    contestants: &mut [Work<'_>],
    rounds: Range<usize>,
    proceed: &mut dyn FnMut() -> bool,
) -> Option<Vec<Runs>> {
    let count = contestants.len();
    let mut runs = vec![Runs::default(); count];
    for round in rounds {
        let mut turn = |index: usize| {
            let core = clock.core();
            let (mut ticks, mut taken) = (clock.time(&mut contestants[index]), clock.taken());
            for _ in 0..AGAIN {
                if taken {
                    let again = clock.time(&mut contestants[index]);
                    taken = clock.taken();
                    // If all attempts were preempted, the one with the fewest ticks is kept.
                    ticks = if taken { ticks.min(again) } else { again };
                }
            }
            runs[index].ticks.push(ticks as f64);
            runs[index].taken.push(taken);
            runs[index].migrations += usize::from(clock.core() != core);
        };
        if round % 2 == 0 {
            (0..count).for_each(&mut turn)
        } else {
            (0..count).rev().for_each(&mut turn)
        }
        if !proceed() {
            return None;
        }
    }
    Some(runs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::{Cell, RefCell};

    /// Ticks from a script, taken by others if they are above 10, on a core that the work may
    /// change.
    struct Fake<'a>(Vec<u64>, u64, &'a Cell<usize>);

    impl Clock for Fake<'_> {
        fn time(&mut self, work: &mut dyn FnMut()) -> u64 {
            work();
            self.1 = self.0.remove(0);
            self.1
        }

        fn core(&mut self) -> Option<usize> {
            Some(self.2.get())
        }

        fn taken(&mut self) -> bool {
            self.1 > 10
        }
    }

    #[test]
    fn contestants_take_turns_there_and_back() {
        let (core, order) = (Cell::new(0), RefCell::new(String::new()));
        let contestant = |name: char| -> Work<'_> {
            let order = &order;
            Box::new(move || order.borrow_mut().push(name))
        };
        let mut contestants = ['a', 'b', 'c'].map(contestant);
        let mut clock = Fake(vec![5, 7, 9, 9, 7, 5, 5, 7, 9], 0, &core);
        let runs = interleave(&mut clock, &mut contestants, 0..3, &mut || true).unwrap();
        drop(contestants);
        assert_eq!(order.into_inner(), "abccbaabc", "odd rounds backwards");
        for (runs, ticks) in runs.iter().zip([5.0, 7.0, 9.0]) {
            assert_eq!(*runs, Runs { ticks: vec![ticks; 3], migrations: 0, taken: vec![false; 3] });
        }
    }

    #[test]
    fn a_migration_is_counted_against_the_run_in_which_it_happened() {
        let core = Cell::new(3);
        let mut contestants: [Work<'_>; 2] = [Box::new(|| ()), Box::new(|| core.set(core.get() + 1))];
        let runs = interleave(&mut Fake(vec![1; 8], 0, &core), &mut contestants, 0..4, &mut || true).unwrap();
        assert_eq!((runs[0].migrations, runs[1].migrations), (0, 4));
    }

    #[test]
    fn runs_that_are_stopped_early_are_no_result() {
        let (core, rounds) = (Cell::new(0), Cell::new(0));
        let mut contestants: [Work<'_>; 1] = [Box::new(|| rounds.set(rounds.get() + 1))];
        let stop_after_two = &mut || rounds.get() < 2;
        assert_eq!(interleave(&mut Fake(vec![1; 9], 0, &core), &mut contestants, 0..9, stop_after_two), None);
        assert_eq!(rounds.get(), 2);
    }

    #[test]
    fn disturbed_run_is_repeated_once_and_then_marked() {
        let (core, calls) = (Cell::new(0), Cell::new(0));
        let mut clock = Fake(vec![5, 50, 12, 7, 90, 30, 40, 60, 6], 0, &core);
        let mut contestants: [Work<'_>; 1] = [Box::new(|| calls.set(calls.get() + 1))];
        let runs = interleave(&mut clock, &mut contestants, 0..4, &mut || true).unwrap();
        assert_eq!(
            (&runs[0].ticks[..], &runs[0].taken[..]),
            (&[5.0, 7.0, 30.0, 6.0][..], &[false, false, true, false][..])
        );
        assert_eq!(calls.get(), 1 + 3 + 4 + 1);
    }

    #[test]
    fn a_run_that_is_off_is_reported_and_kept() {
        let runs = Runs { ticks: vec![10.0, 11.0, 12.0, 11.0, 10.0, 40.0], ..Runs::default() };
        assert_eq!((runs.off(), runs.ticks.len()), (1, 6));
    }
}
