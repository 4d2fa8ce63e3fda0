//! Servos: their protocol against the manufacturer's manual, the driver, and the simulated bus that drivers of others talk to.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod driver;
mod protocol2;
mod rustypot;
mod simulated;
