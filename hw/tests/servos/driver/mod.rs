//! The driver against published conversations, servos that only remember, and nonsense.

mod conversations;
mod decorators;
mod devices;
mod noise;
mod nonsense;
mod operation;
mod script;

use tdcr_hw as hw;
