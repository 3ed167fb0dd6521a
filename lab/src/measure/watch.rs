//! Finds out whether a thread was preempted while something was timed.

use std::time::{Duration, Instant};

use rayo::internals::kernels::sys;

/// A thread counts as preempted if other threads had its core for more than this share of the time,
/// and for longer than it takes to read the clocks.
const SHARE: f64 = 0.01;
const LOOKS: Duration = Duration::from_micros(20);

/// The clocks of the calling thread before the timed work. Time that the hypervisor takes shows
/// only if the operating system accounts for it, and the use of shared caches by other threads does
/// not show at all.
#[derive(Clone, Copy, Debug)]
pub struct ThreadWatch {
    switches: sys::Usage,
    own: Duration,
    start: Instant,
}

/// What happened while a thread was watched.
#[derive(Clone, Copy, Debug)]
pub struct Interruption {
    /// Whether other threads had the core.
    pub taken: bool,
    /// The CPU time of the thread, if it was preempted and this time tells how long its work took.
    pub own: Option<Duration>,
}

impl ThreadWatch {
    /// Reads the clocks now.
    pub fn start() -> Self {
        ThreadWatch { switches: sys::Usage::of_this_thread(), own: sys::thread_cpu_time(), start: Instant::now() }
    }

    /// What happened since `start`. A thread that has only waited, for others of its team, has not
    /// been preempted.
    pub fn read(self) -> Interruption {
        let (all, own) = (self.start.elapsed(), sys::thread_cpu_time() - self.own);
        let now = sys::Usage::of_this_thread();
        let (waited, forced) = (now.own > self.switches.own, now.forced - self.switches.forced);
        let taken = !(waited && forced == 0) && is_taken(all, own);
        Interruption { taken, own: (taken && !waited && tells(own, forced)).then_some(own) }
    }

    /// Whether the thread has been preempted since `start`.
    pub fn taken(self) -> bool {
        self.read().taken
    }
}

/// How long a thread has to work between preemptions. Each costs some microseconds of the thread's
/// own time, to begin again and to reload its caches; that is then no more than a hundredth.
const BETWEEN: Duration = Duration::from_millis(1);

/// Whether a thread's own CPU time tells how long its work took although it was preempted `forced`
/// times: it does if the thread worked long enough between preemptions.
fn tells(own: Duration, forced: u64) -> bool {
    forced > 0 && own.as_secs_f64() >= forced as f64 * BETWEEN.as_secs_f64()
}

/// Whether a thread that had the core for `own` of the time `all` lost more of it than is
/// tolerated. An unknown own time is 0.
fn is_taken(all: Duration, own: Duration) -> bool {
    !own.is_zero() && all.saturating_sub(own) > all.mul_f64(SHARE) + LOOKS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn core_counts_as_taken_from_a_hundredth_on() {
        let [ms, us] = [Duration::from_millis, Duration::from_micros];
        for (all, lost, taken) in [
            (ms(100), us(900), false),
            (ms(100), us(1100), true),
            (us(100), us(20), false),
            (us(100), us(30), true),
            (ms(100), ms(0), false),
        ] {
            assert_eq!(is_taken(all, all - lost), taken, "{lost:?} of {all:?}");
        }
        assert!(!is_taken(ms(100), ms(0)), "a time of its own that nobody knows");
    }

    #[test]
    fn clock_of_the_thread_tells_of_quiet_work() {
        let us = Duration::from_micros;
        for (own, forced, expected) in
            [(us(5000), 0, false), (us(999), 1, false), (us(1000), 1, true), (us(5000), 5, true), (us(5000), 6, false)]
        {
            assert_eq!(tells(own, forced), expected, "{own:?} {forced}");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn who_sleeps_has_not_lost_the_core() {
        let watch = ThreadWatch::start();
        std::thread::sleep(Duration::from_millis(5));
        let taken = watch.taken();
        let forced = sys::Usage::of_this_thread().forced > watch.switches.forced;
        assert!(forced || !taken);
    }
}
