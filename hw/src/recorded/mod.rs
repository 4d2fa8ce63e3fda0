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
mod samples;
mod servo_command;
mod stream;

pub use bus::{Commands, RecordedBus, homes};
pub use camera::RecordedCamera;
pub use clouds::{LoggedCloud, LoggedClouds};
pub use samples::{SamplePictures, Samples};
pub use servo_command::ServoCommand;
pub use stream::RecordedError;
