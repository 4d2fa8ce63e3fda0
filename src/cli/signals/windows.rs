//! What the console of Windows tells its programs.
#![allow(
    unsafe_code,
    reason = "the operating system calls back a function of no context"
)]

use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::Duration;

use anyhow::Context;
use windows_sys::Win32::System::Console::{CTRL_BREAK_EVENT, CTRL_C_EVENT, SetConsoleCtrlHandler};
use windows_sys::core::BOOL;

use super::{Farewell, Signals, leave};

/// Where a window is closed, a session or the machine ends, the system ends a program that has not done so itself after 5 s.
const LAST_MOMENT: Duration = Duration::from_secs(3);

static SIGNALS: OnceLock<Arc<Signals>> = OnceLock::new();

/// Hands on every event from now on, in a thread that the system makes for it.
pub(super) fn listen(signals: &Arc<Signals>) -> anyhow::Result<()> {
    let _ = SIGNALS.set(signals.clone());
    // SAFETY: a function of the signature asked for, which stays.
    let listens = unsafe { SetConsoleCtrlHandler(Some(hear), 1) } != 0;
    let done = listens
        .then_some(())
        .ok_or_else(std::io::Error::last_os_error);
    done.context("cannot listen for signals")
}

/// Returns that the event is dealt with; the program would end at once otherwise.
unsafe extern "system" fn hear(event: u32) -> BOOL {
    if let Some(signals) = SIGNALS.get() {
        signals.end(None);
    }
    if !matches!(event, CTRL_C_EVENT | CTRL_BREAK_EVENT) {
        // The program ends here, or where the work comes to its safe point before. There is nobody to say it to.
        thread::sleep(LAST_MOMENT);
        leave(Farewell::Unsaid);
    }
    1
}
