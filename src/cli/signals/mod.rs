//! Signals: asking the work to stop at a safe point, and leaving robots safe however the process ends.

#[cfg_attr(unix, path = "unix.rs")]
#[cfg_attr(windows, path = "windows.rs")]
mod system;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tdcr::hw::rig::leave as leave_rigs;

use super::console::say;
use super::{INTERRUPTED, terminal};

/// What signals asked for.
#[derive(Default)]
pub(super) struct Signals {
    /// One came, and the work is to stop at its next safe point.
    came: AtomicBool,
    /// The work has safe points: it asks whether a signal came, and will ask again.
    awaited: AtomicBool,
}

impl Signals {
    /// Listens from now on, in a thread of its own.
    ///
    /// # Errors
    /// Where the operating system refuses.
    pub fn listen() -> anyhow::Result<Arc<Self>> {
        let signals = Arc::new(Self::default());
        system::listen(&signals)?;
        Ok(signals)
    }

    /// Whether a signal came; from now on the work is known to ask.
    pub fn came(&self) -> bool {
        self.awaited.store(true, Ordering::Relaxed);
        self.came.load(Ordering::Relaxed)
    }

    /// The work does not ask any more.
    pub fn forget_safe_points(&self) {
        self.awaited.store(false, Ordering::Relaxed);
    }

    /// Asks the work to end at its next safe point, or ends the process where it was asked before or has none; says `why` first.
    fn end(&self, why: Option<&str>) {
        let awaited = self.awaited.load(Ordering::Relaxed);
        let again = self.came.swap(true, Ordering::Relaxed);
        if let Some(why) = why {
            say(&format!("\n{why}"));
        }
        if again || !awaited {
            leave(Farewell::Said);
        }
        say("\nstopping at the next safe point; press Ctrl-C again to stop at once");
    }
}

/// Whether there is a terminal to say to what became of the motors.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Farewell {
    Said,
    Unsaid,
}

/// Ends the process at once: motors that any command has on go off, logs end whole, the terminal is as it was.
fn leave(farewell: Farewell) -> ! {
    let released = leave_rigs();
    if farewell == Farewell::Said {
        terminal::restore();
        if !released.off.is_empty() || !released.is_complete() {
            say(&released.to_string());
        }
    }
    std::process::exit(INTERRUPTED.into())
}
