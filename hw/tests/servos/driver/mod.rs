//! The driver against published conversations, servos that only remember, and nonsense.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod conversations;
mod decorators;
mod devices;
mod noise;
mod nonsense;
mod operation;
mod script;

use tdcr_hw as hw;
