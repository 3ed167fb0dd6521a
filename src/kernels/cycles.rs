//! Cycles of the time-stamp counter, where there is one, and its frequency.

#[cfg(target_arch = "x86_64")]
use super::sys;

/// A moment on the time-stamp counter.
#[derive(Clone, Copy, Debug)]
pub struct Cycles(u64);

#[cfg(target_arch = "x86_64")]
impl Cycles {
    /// Whether there is a counter to read.
    pub const fn available() -> bool {
        true
    }

    /// Now, before the timed work.
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
    /// Whether there is a counter to read.
    pub const fn available() -> bool {
        false
    }

    /// Without a counter: nothing.
    pub fn start() -> Self {
        Cycles(0)
    }

    /// Without a counter: 0.
    pub fn stop(self) -> u64 {
        self.0
    }
}

/// The ticks of the counter per second, measured against the operating system's clock for a
/// twentieth of a second.
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
