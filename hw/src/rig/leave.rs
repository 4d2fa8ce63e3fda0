//! Leaving all rigs at once, for a process that ends without unwinding.

use std::time::Duration;

use super::Released;
use super::background::discard_partial;
use crate::log::finish_all;
use crate::servo::{switch_off_all, while_all_off};

/// How long one waits for whoever speaks with servos just then.
const PATIENCE: Duration = Duration::from_secs(2);

/// How long one waits, the motors off, for pictures that are still to be written to logs.
const PATIENCE_WITH_LOGS: Duration = Duration::from_secs(5);

/// Switches off all motors that any rig of this process has on, from whatever thread, ends all logs, and removes those of an empty
/// scene that are not whole; says what became of the motors. It is for handlers of signals that end the process: nothing drives a
/// servo afterwards, and a thread that tries to waits for ever.
pub fn leave() -> Released {
    let mut released = Released::default();
    for (id, result) in switch_off_all(PATIENCE) {
        match result {
            Ok(()) => released.off.push(id),
            Err(error) => released.unknown.push((id, error)),
        }
    }
    finish_all(PATIENCE_WITH_LOGS);
    discard_partial();
    released
}

/// Does `work` where no rig of this process has a motor on, and lets none switch one on meanwhile; says whether it was done. It is for
/// handlers of signals that stop the process for a while: a stopped process cannot look after servos.
pub fn while_released(work: impl FnOnce()) -> bool {
    while_all_off(PATIENCE, work)
}
