//! The terminal at stdin: keys as they are pressed, and what was typed ahead.

#[cfg_attr(unix, path = "unix.rs")]
#[cfg_attr(windows, path = "windows.rs")]
mod system;

use std::sync::{Mutex, PoisonError};

pub(super) use system::forget_typed;

/// The mode of the terminal before keys were read one by one.
static BEFORE: Mutex<Option<system::Mode>> = Mutex::new(None);

/// The terminal, if stdin is one, gives keys as they are pressed and shows none, until this is dropped. Ctrl-C ends the work as
/// ever; keys that quit a program, stop it or its output do not: nobody would look after the servos, and the terminal would stay
/// as it is here.
pub(super) struct Unbuffered;

impl Unbuffered {
    pub fn begin() -> Self {
        // What is no terminal has no mode.
        if let Some(before) = system::mode()
            && system::give_keys(&before)
        {
            *BEFORE.lock().unwrap_or_else(PoisonError::into_inner) = Some(before);
        }
        Self
    }
}

impl Drop for Unbuffered {
    fn drop(&mut self) {
        restore();
    }
}

/// Puts the terminal into the mode that it had before keys were read, if any were.
pub(super) fn restore() {
    let before = (BEFORE.lock().unwrap_or_else(PoisonError::into_inner)).take();
    if let Some(before) = before {
        system::set_mode(&before);
    }
}
