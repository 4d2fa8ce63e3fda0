//! Signals of POSIX.
//!
//! A program that is stopped ([`SIGTSTP`], Ctrl-Z) cannot look after servos, so while a motor is on this signal ends the work as
//! Ctrl-C does. That is simpler than releasing the tension and stopping: the work could not go on from there, and one that waits
//! for `fg` only to end would keep its folder locked meanwhile. Where no motor is on, Ctrl-Z works as everywhere.
//!
//! Who starts the command under `nohup` wants it to outlive the terminal: [`SIGHUP`], which is ignored then, stays ignored.

use std::sync::Arc;
use std::thread;

use anyhow::Context;
use signal_hook::consts::signal::{
    SIGALRM, SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGTSTP, SIGTTIN, SIGTTOU, SIGUSR1, SIGUSR2,
    SIGXCPU, SIGXFSZ,
};
use signal_hook::iterator::Signals as Incoming;
use signal_hook::low_level::emulate_default_handler;
use tdcr::hw::rig::while_released;

use super::{Farewell, Signals, leave};

/// Signals that end a process unless it handles them.
const ENDING: [i32; 8] = [
    SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGALRM, SIGUSR1, SIGUSR2, SIGXCPU,
];

/// Signals that stop a process until it is told to go on: from the keyboard, and for a background process that uses its terminal.
const STOPPING: [i32; 3] = [SIGTSTP, SIGTTIN, SIGTTOU];

/// Hands on every signal from now on, in a thread of its own.
pub(super) fn listen(signals: &Arc<Signals>) -> anyhow::Result<()> {
    let outlives_terminal = is_ignored(SIGHUP);
    let listened = ENDING.iter().chain(&STOPPING).chain(&[SIGXFSZ]);
    let listened = listened.filter(|&&signal| !(signal == SIGHUP && outlives_terminal));
    let mut incoming = Incoming::new(listened).context("cannot listen for signals")?;
    let signals = signals.clone();
    thread::spawn(move || {
        for signal in incoming.forever() {
            hear(&signals, signal);
        }
    });
    Ok(())
}

fn hear(signals: &Signals, signal: i32) {
    match signal {
        // The write beyond the limit fails, and that error says more.
        SIGXFSZ => {}
        SIGTSTP | SIGTTIN | SIGTTOU => stop(signals, signal),
        _ => signals.end(None),
    }
}

/// Stops the process as the signal does by default, where no motor is on meanwhile.
fn stop(signals: &Signals, signal: i32) {
    if while_released(|| drop(emulate_default_handler(signal))) {
        return;
    }
    match signal {
        SIGTSTP => signals.end(Some(
            "motors are on, which nobody would look after while this program is stopped, so it ends",
        )),
        // Whoever uses the terminal waits for it, and so would a last word.
        _ => leave(Farewell::Unsaid),
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
