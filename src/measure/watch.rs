//! Whether others had the core while something was timed.

use std::time::{Duration, Instant};

use crate::kernels::sys;

/// Others had the core if they had it for more than this share of the time, and for longer than the looks at the clocks take.
const SHARE: f64 = 0.01;
const LOOKS: Duration = Duration::from_micros(20);
/// A thread that lost its core finds its caches cold: what it worked for itself, for each time that it did, has to be so long
/// that this is some hundredths of it.
const FOR_EACH_LOSS: Duration = Duration::from_millis(1);

/// A look at the calling thread's clocks, before what is timed.
///
/// What the hypervisor takes is seen where the system accounts for it, and what other threads do to the caches that they share
/// is not seen at all.
#[derive(Clone, Copy, Debug)]
pub struct Watch {
    switches: sys::Switches,
    own: Duration,
    process: Duration,
    start: Instant,
}

/// What a [`Watch`] has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Disturbance {
    /// The thread has had its core, or has only waited for others that it works with.
    #[default]
    None,
    /// Others have had the core; without them it would have been this share of the time.
    Known(f64),
    /// Others have had the core, and how long it would have been without them is not known: more threads worked at it, or it
    /// was too short.
    Unknown,
}

impl Watch {
    /// Now.
    pub fn start() -> Self {
        let (switches, process) = (sys::switches(), sys::process_cpu_time());
        Watch { switches, process, own: sys::thread_cpu_time(), start: Instant::now() }
    }

    /// What has been since.
    pub fn disturbance(self) -> Disturbance {
        let (all, own) = (self.start.elapsed(), sys::thread_cpu_time() - self.own);
        let process = sys::process_cpu_time() - self.process;
        let now = sys::switches();
        let forced = now.forced - self.switches.forced;
        let waited = now.own > self.switches.own;
        if waited && forced == 0 || !is_taken(all, own) {
            return Disturbance::None;
        }
        let alone = !waited && process.saturating_sub(own) <= LOOKS;
        let long_enough = forced > 0 && own >= FOR_EACH_LOSS * forced.try_into().unwrap_or(u32::MAX);
        if alone && long_enough {
            Disturbance::Known(own.as_secs_f64() / all.as_secs_f64())
        } else {
            Disturbance::Unknown
        }
    }
}

/// Whether who had `own` of `all` of the time lost more of it than it may. Where a thread's own time is not known, it is 0.
fn is_taken(all: Duration, own: Duration) -> bool {
    !own.is_zero() && all.saturating_sub(own) > all.mul_f64(SHARE) + LOOKS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_core_is_taken_where_a_hundredth_is_lost_and_more_than_a_look_at_the_clock() {
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

    #[cfg(target_os = "linux")]
    #[test]
    fn who_sleeps_has_not_lost_the_core() {
        let watch = Watch::start();
        std::thread::sleep(Duration::from_millis(5));
        let disturbance = watch.disturbance();
        let forced = sys::switches().forced > watch.switches.forced;
        assert!(forced || disturbance == Disturbance::None);
    }
}
