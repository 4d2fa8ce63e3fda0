//! Terminals by the console of Windows.
#![allow(
    unsafe_code,
    reason = "calls of the operating system, on the handle of stdin"
)]

use windows_sys::Win32::Foundation::HANDLE;
use windows_sys::Win32::System::Console::{
    CONSOLE_MODE, ENABLE_ECHO_INPUT, ENABLE_LINE_INPUT, ENABLE_PROCESSED_INPUT,
    ENABLE_VIRTUAL_TERMINAL_INPUT, FlushConsoleInputBuffer, GetConsoleMode, GetStdHandle,
    STD_INPUT_HANDLE, SetConsoleMode,
};

pub(super) type Mode = CONSOLE_MODE;

fn console() -> HANDLE {
    // SAFETY: no pointers go in. What comes out may be no handle, which the calls below refuse.
    unsafe { GetStdHandle(STD_INPUT_HANDLE) }
}

/// The mode of the console at stdin; `None` where it is none.
pub(super) fn mode() -> Option<Mode> {
    let mut mode = 0;
    // SAFETY: `mode` outlives the call.
    (unsafe { GetConsoleMode(console(), &mut mode) } != 0).then_some(mode)
}

/// Keys come one by one from now on, arrows as the escape sequences of other terminals; whether the console does that. Ctrl-C is
/// no key, but comes to [`crate::cli::signals`].
pub(super) fn give_keys(before: &Mode) -> bool {
    let keys = ENABLE_PROCESSED_INPUT | ENABLE_VIRTUAL_TERMINAL_INPUT;
    set(before & !(ENABLE_LINE_INPUT | ENABLE_ECHO_INPUT) | keys)
}

/// Sets the mode; a console that is gone has none any more.
pub(super) fn set_mode(mode: &Mode) {
    set(*mode);
}

fn set(mode: Mode) -> bool {
    // SAFETY: no pointers go in.
    unsafe { SetConsoleMode(console(), mode) != 0 }
}

/// Drops what was typed and not read yet; of a console that cannot be told to, nothing is known.
pub(in crate::cli) fn forget_typed() {
    // SAFETY: no pointers go in.
    unsafe { FlushConsoleInputBuffer(console()) };
}
