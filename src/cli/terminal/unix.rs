//! Terminals by POSIX's termios.

use std::io::stdin;

use rustix::termios::{
    InputModes, LocalModes, OptionalActions, QueueSelector, SpecialCodeIndex, Termios, tcflush,
    tcgetattr, tcsetattr,
};

pub(super) type Mode = Termios;

/// What a special code is that no key sends (`_POSIX_VDISABLE`).
const DISABLED: u8 = match cfg!(target_os = "linux") {
    true => 0,
    false => 0xff,
};

/// The mode of the terminal at stdin; `None` where it is none.
pub(super) fn mode() -> Option<Mode> {
    tcgetattr(stdin()).ok()
}

/// Keys come one by one from now on; whether the terminal does that.
pub(super) fn give_keys(before: &Mode) -> bool {
    let mut mode = before.clone();
    mode.local_modes -= LocalModes::ICANON | LocalModes::ECHO;
    mode.input_modes -= InputModes::IXON;
    for code in [SpecialCodeIndex::VQUIT, SpecialCodeIndex::VSUSP] {
        mode.special_codes[code] = DISABLED;
    }
    mode.special_codes[SpecialCodeIndex::VMIN] = 1;
    mode.special_codes[SpecialCodeIndex::VTIME] = 0;
    tcsetattr(stdin(), OptionalActions::Now, &mode).is_ok()
}

/// Sets the mode; a terminal that is gone has none any more.
pub(super) fn set_mode(mode: &Mode) {
    let _ = tcsetattr(stdin(), OptionalActions::Now, mode);
}

/// Drops what was typed and not read yet; of a terminal that cannot be told to, nothing is known.
pub(in crate::cli) fn forget_typed() {
    let _ = tcflush(stdin(), QueueSelector::IFlush);
}
