//! The person at the rig, who is asked to do something with their hands.

use std::io::{BufRead, IsTerminal};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

use super::console::say;
use super::terminal::forget_typed;

/// How often one looks whether the work is to end.
const POLL: Duration = Duration::from_millis(50);

/// Asks for something, and waits for a line on stdin that says that it is done; `false` where `ends` says so, or no line can come.
/// What was typed on a terminal before one asks is no answer; lines of a pipe are answers in their order.
pub(super) fn does(request: &str, ends: impl Fn() -> bool) -> bool {
    let lines = lines().lock().unwrap_or_else(PoisonError::into_inner);
    if std::io::stdin().is_terminal() {
        forget_typed();
        while lines.try_recv().is_ok() {}
    }
    say(&format!("{request}, then press Enter (Ctrl-C ends)"));
    loop {
        if ends() {
            return false;
        }
        match lines.recv_timeout(POLL) {
            Ok(()) => return true,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return false,
        }
    }
}

/// The lines of stdin, from the first time that one asks. The thread that reads them ends with stdin, or with the process.
fn lines() -> &'static Mutex<Receiver<()>> {
    static LINES: OnceLock<Mutex<Receiver<()>>> = OnceLock::new();
    LINES.get_or_init(|| {
        let (sender, lines) = channel();
        thread::spawn(move || {
            for line in std::io::stdin().lock().lines() {
                if line.is_err() || sender.send(()).is_err() {
                    break;
                }
            }
        });
        Mutex::new(lines)
    })
}
