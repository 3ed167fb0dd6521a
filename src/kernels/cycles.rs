//! Cycles of the time-stamp counter, on machines that have one, and its frequency.

#[cfg(target_arch = "x86_64")]
use super::sys;

/// A moment on the time-stamp counter.
#[derive(Clone, Copy, Debug)]
pub struct Cycles(u64);

#[cfg(target_arch = "x86_64")]
impl Cycles {
    /// Whether the machine has a counter that can be read.
    pub const fn available() -> bool {
        true
    }

    /// Reads the counter before timed work.
    #[inline]
    pub fn start() -> Self {
        Cycles(sys::tsc_start())
    }

    /// Cycles since [`Cycles::start`], after the timed work.
    #[inline]
    pub fn stop(self) -> u64 {
        sys::tsc_stop().saturating_sub(self.0)
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl Cycles {
    /// Whether the machine has a counter that can be read.
    pub const fn available() -> bool {
        false
    }

    /// Does nothing, since there is no counter.
    pub fn start() -> Self {
        Cycles(0)
    }

    /// Returns 0, since there is no counter.
    pub fn stop(self) -> u64 {
        self.0
    }
}

/// The counter's ticks per second, measured against the operating system's clock for a twentieth of
/// a second.
pub fn tsc_hz() -> Option<f64> {
    use std::time::{Duration, Instant};
    if !Cycles::available() {
        return None;
    }
    let (clock, cycles) = (Instant::now(), Cycles::start());
    while clock.elapsed() < Duration::from_millis(50) {
        std::hint::spin_loop();
    }
    let (elapsed, cycles) = (clock.elapsed(), cycles.stop());
    Some(cycles as f64 / elapsed.as_secs_f64())
}
