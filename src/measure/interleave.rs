//! The interleaved runner: contestants take turns, so that whatever changes over time changes for all of them.

use std::ops::Range;
use std::time::Instant;

use super::cycles::Cycles;
use super::statistics;
use crate::kernels::sys;

/// How far from the median, in MAD, a run has to be to be reported as off.
pub const OFF_BY_MAD: f64 = 3.0;

/// What times are taken with. One that is made up makes every statistic checkable.
pub trait Clock {
    /// The ticks that `work` takes.
    fn time(&mut self, work: &mut dyn FnMut()) -> u64;

    /// The core that runs this thread, where that can be known.
    fn core(&mut self) -> Option<usize>;
}

/// The time-stamp counter.
#[derive(Clone, Copy, Debug)]
pub struct TscClock(());

impl TscClock {
    /// None where there is no counter to read.
    pub fn new() -> Option<Self> {
        Cycles::available().then_some(TscClock(()))
    }
}

impl Clock for TscClock {
    fn time(&mut self, work: &mut dyn FnMut()) -> u64 {
        let start = Cycles::start();
        work();
        start.stop()
    }

    fn core(&mut self) -> Option<usize> {
        sys::current_core()
    }
}

/// The operating system's clock, for machines without a counter: its ticks are nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct WallClock(());

impl WallClock {
    /// Ticks in a second.
    pub const HZ: f64 = 1e9;

    /// Any machine has one.
    pub fn new() -> Self {
        WallClock(())
    }
}

impl Clock for WallClock {
    fn time(&mut self, work: &mut dyn FnMut()) -> u64 {
        let start = Instant::now();
        work();
        start.elapsed().as_nanos() as u64
    }

    fn core(&mut self) -> Option<usize> {
        sys::current_core()
    }
}

/// A clock that adds up all that it takes.
pub struct Totalled<'a> {
    clock: &'a mut dyn Clock,
    /// Ticks of all work so far.
    pub total: u64,
}

impl<'a> Totalled<'a> {
    /// Nothing so far.
    pub fn new(clock: &'a mut dyn Clock) -> Self {
        Totalled { clock, total: 0 }
    }
}

impl Clock for Totalled<'_> {
    fn time(&mut self, work: &mut dyn FnMut()) -> u64 {
        let ticks = self.clock.time(work);
        self.total += ticks;
        ticks
    }

    fn core(&mut self) -> Option<usize> {
        self.clock.core()
    }
}

/// Something to time.
pub type Work<'a> = Box<dyn FnMut() + 'a>;

/// The runs of one contestant, in the order of the rounds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Runs {
    /// Ticks of each run.
    pub ticks: Vec<f64>,
    /// Runs that ended on another core than the one they began on.
    pub migrations: usize,
}

impl Runs {
    /// Runs further from the median than [`OFF_BY_MAD`] MAD.
    pub fn off(&self) -> usize {
        statistics::outliers(&self.ticks, OFF_BY_MAD)
    }
}

/// Times each of `contestants` once in each of `rounds`; none is dropped. Rounds of odd numbers go backwards, so that each
/// follows its neighbour as often as it precedes it.
///
/// `proceed` is asked after each round; where it says no, the result is None.
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
            runs[index].ticks.push(clock.time(&mut contestants[index]) as f64);
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

    /// A clock that the work itself moves on.
    struct Fake<'a> {
        now: &'a Cell<u64>,
        core: &'a Cell<usize>,
    }

    impl Clock for Fake<'_> {
        fn time(&mut self, work: &mut dyn FnMut()) -> u64 {
            let start = self.now.get();
            work();
            self.now.get() - start
        }

        fn core(&mut self) -> Option<usize> {
            Some(self.core.get())
        }
    }

    #[test]
    fn contestants_take_turns_there_and_back_and_each_gets_its_own_ticks() {
        let (now, core, order) = (Cell::new(1000), Cell::new(0), RefCell::new(String::new()));
        let contestant = |name: char, ticks: u64| -> Work<'_> {
            let (now, order) = (&now, &order);
            Box::new(move || {
                order.borrow_mut().push(name);
                now.set(now.get() + ticks);
            })
        };
        let mut contestants = [contestant('a', 5), contestant('b', 7), contestant('c', 11)];
        let runs = interleave(&mut Fake { now: &now, core: &core }, &mut contestants, 0..3, &mut || true).unwrap();
        drop(contestants);
        assert_eq!(order.into_inner(), "abccbaabc", "odd rounds backwards");
        for (runs, ticks) in runs.iter().zip([5.0, 7.0, 11.0]) {
            assert_eq!(*runs, Runs { ticks: vec![ticks; 3], migrations: 0 });
        }
    }

    #[test]
    fn a_migration_is_counted_against_the_run_in_which_it_happened() {
        let (now, core) = (Cell::new(0), Cell::new(3));
        let mut contestants: [Work<'_>; 2] = [Box::new(|| ()), Box::new(|| core.set(core.get() + 1))];
        let runs = interleave(&mut Fake { now: &now, core: &core }, &mut contestants, 0..4, &mut || true).unwrap();
        assert_eq!((runs[0].migrations, runs[1].migrations), (0, 4));
    }

    #[test]
    fn runs_that_are_stopped_early_are_no_result() {
        let (now, core, rounds) = (Cell::new(0), Cell::new(0), Cell::new(0));
        let mut contestants: [Work<'_>; 1] = [Box::new(|| rounds.set(rounds.get() + 1))];
        let stop_after_two = &mut || rounds.get() < 2;
        assert_eq!(interleave(&mut Fake { now: &now, core: &core }, &mut contestants, 0..9, stop_after_two), None);
        assert_eq!(rounds.get(), 2);
    }

    #[test]
    fn a_run_that_is_off_is_reported_and_kept() {
        let runs = Runs { ticks: vec![10.0, 11.0, 12.0, 11.0, 10.0, 40.0], migrations: 0 };
        assert_eq!((runs.off(), runs.ticks.len()), (1, 6));
    }
}
