//! Signals: asking the work to stop at a safe point, and leaving robots safe however the process ends.
//!
//! A program that is stopped ([`SIGTSTP`], Ctrl-Z) cannot look after servos, so while a motor is on this signal ends the work as
//! Ctrl-C does. That is simpler than releasing the tension and stopping: the work could not go on from there, and one that waits
//! for `fg` only to end would keep its folder locked meanwhile. Where no motor is on, Ctrl-Z works as everywhere.
//!
//! Who starts the command under `nohup` wants it to outlive the terminal: [`SIGHUP`], which is ignored then, stays ignored.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::Context;
use signal_hook::consts::signal::{
    SIGALRM, SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGTSTP, SIGTTIN, SIGTTOU, SIGUSR1, SIGUSR2,
    SIGXCPU, SIGXFSZ,
};
use signal_hook::iterator::Signals as Incoming;
use signal_hook::low_level::emulate_default_handler;
use tdcr::hw::rig::{leave as leave_rigs, while_released};

use super::INTERRUPTED;
use super::console::say;
use super::keys::restore_terminal;

/// Signals that end a process unless it handles them.
const ENDING: [i32; 8] = [
    SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGALRM, SIGUSR1, SIGUSR2, SIGXCPU,
];

/// Signals that stop a process until it is told to go on: from the keyboard, and for a background process that uses its terminal.
const STOPPING: [i32; 3] = [SIGTSTP, SIGTTIN, SIGTTOU];

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
        let outlives_terminal = is_ignored(SIGHUP);
        let listened = ENDING.iter().chain(&STOPPING).chain(&[SIGXFSZ]);
        let listened = listened.filter(|&&signal| !(signal == SIGHUP && outlives_terminal));
        let mut incoming = Incoming::new(listened).context("cannot listen for signals")?;
        let heard = signals.clone();
        thread::spawn(move || {
            for signal in incoming.forever() {
                heard.hear(signal);
            }
        });
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

    fn hear(&self, signal: i32) {
        match signal {
            // The write beyond the limit fails, and that error says more.
            SIGXFSZ => {}
            SIGTSTP | SIGTTIN | SIGTTOU => self.stop(signal),
            _ => self.end(None),
        }
    }

    /// Stops the process as the signal does by default, where no motor is on meanwhile.
    fn stop(&self, signal: i32) {
        if while_released(|| drop(emulate_default_handler(signal))) {
            return;
        }
        match signal {
            SIGTSTP => self.end(Some(
                "motors are on, which nobody would look after while this program is stopped, so it ends",
            )),
            // Whoever uses the terminal waits for it, and so would a last word.
            _ => leave(Farewell::Unsaid),
        }
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

/// Whether whoever started this process has it ignore a signal, where Linux says so.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    // Signals count from 1, and bits from 0.
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
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
        restore_terminal();
        if !released.off.is_empty() || !released.is_complete() {
            say(&released.to_string());
        }
    }
    std::process::exit(INTERRUPTED.into())
}
