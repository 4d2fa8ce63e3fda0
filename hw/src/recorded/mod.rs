//! Logs played back: a bus of servos and cameras that say again what was logged.
//!
//! Times are the log's own, counted from its first message, on whatever clock is given: a
//! [`VirtualClock`](crate::clock::VirtualClock) plays as fast as the log is read, a
//! [`SystemClock`](crate::clock::SystemClock) in real time. A call returns when the call that was logged did, so a program that
//! asks what the logged one asked gets what that one got. Each device reads the file for itself, one chunk at a time.
//!
//! [`Samples`] finds the pictures of a capture's samples, for programs that mask them, [`LoggedClouds`] its clouds with their commands.

mod bus;
mod camera;
mod clouds;
mod order;
mod samples;
mod stream;

pub use bus::{Orders, RecordedBus, homes};
pub use camera::RecordedCamera;
pub use clouds::{LoggedCloud, LoggedClouds};
pub use order::Order;
pub use samples::{SamplePictures, Samples};
pub use stream::RecordedError;
