//! Time: real, or as fast as a simulation computes.

use std::fmt::Debug;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// What everything that waits waits on. Times count from the clock's start.
pub trait Clock: Debug + Send + Sync {
    /// Time since the clock's start.
    fn now(&self) -> Duration;

    /// Returns at `time`, or at once where it has passed.
    fn wait_until(&self, time: Duration);

    /// The clock's start since the Unix epoch, for the time stamps of logs.
    fn start(&self) -> Duration;

    /// Whether its time passes while a program computes, and not only where somebody waits.
    fn runs(&self) -> bool;

    /// Waits for `duration`.
    fn wait(&self, duration: Duration) {
        self.wait_until(self.now() + duration);
    }
}

/// The computer's own clock, monotonic.
#[derive(Clone, Copy, Debug)]
pub struct SystemClock {
    instant: Instant,
    since_epoch: Duration,
}

impl SystemClock {
    /// A clock that starts now.
    pub fn new() -> Self {
        Self {
            instant: Instant::now(),
            // A clock set before 1970 gives logs that start there.
            since_epoch: SystemTime::now()
                .duration_since(UNIX_EPOCH)
                .unwrap_or_default(),
        }
    }
}

impl Default for SystemClock {
    fn default() -> Self {
        Self::new()
    }
}

impl Clock for SystemClock {
    fn now(&self) -> Duration {
        self.instant.elapsed()
    }

    fn wait_until(&self, time: Duration) {
        sleep(time.saturating_sub(self.now()));
    }

    fn start(&self) -> Duration {
        self.since_epoch
    }

    fn runs(&self) -> bool {
        true
    }
}

/// A clock that stands still until somebody waits, and then is at the end of that wait.
///
/// One thread drives what shares it: the simulated devices compute what happened up to its time when they are asked.
#[derive(Debug, Default)]
pub struct VirtualClock {
    nanoseconds: AtomicU64,
}

impl VirtualClock {
    /// A clock at zero.
    pub fn new() -> Self {
        Self::default()
    }
}

impl Clock for VirtualClock {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.nanoseconds.load(Ordering::Acquire))
    }

    fn wait_until(&self, time: Duration) {
        // 584 years fit.
        let nanoseconds = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.nanoseconds.fetch_max(nanoseconds, Ordering::AcqRel);
    }

    fn start(&self) -> Duration {
        Duration::ZERO
    }

    fn runs(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn virtual_time_passes_only_where_somebody_waits_and_never_backwards() {
        let clock = VirtualClock::new();
        clock.wait(Duration::from_millis(5));
        clock.wait_until(Duration::from_millis(3));
        assert_eq!(clock.now(), Duration::from_millis(5));
    }

    #[test]
    fn a_wait_on_the_system_clock_takes_at_least_that_long() {
        let clock = SystemClock::new();
        clock.wait(Duration::from_millis(2));
        assert!(clock.now() >= Duration::from_millis(2));
    }
}
