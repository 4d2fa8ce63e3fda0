//! Logs: written, read, damaged, repaired, read by the format's own library.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod compressed;
mod damage;
mod playback;
mod round_trip;
mod sample;
