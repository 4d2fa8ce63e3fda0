//! From a command to a cloud: move, wait until all is still, take pictures, keep what is the robot, fuse.
//!
//! A [`Session`] engages a [`Rig`] and makes one [`Captured`] sample after another, each with all servos at their
//! goals, whose tendons pull as they should; its command is where they stood. Now and then it looks at the robot in its
//! home pose, which should not change ([`Sentinel`]), and waits there while servos are too hot. Whatever goes wrong ends with
//! the tension released: see [`rig`](crate::rig).

mod error;
mod fuse;
mod program;
mod restart;
mod session;
mod still;
mod tendons;
mod wait;

pub use error::CaptureError;
pub use fuse::Fuser;
pub use program::Program;
pub use session::{Captured, Sentinel, SessionSettings};
pub use still::{StillDepth, Stillness};

use std::ops::ControlFlow;

use crate::mask::MaskFolder;
use crate::plan::Place;
use crate::rig::Rig;
use tendons::Scale;

/// A capture in progress: a rig that is engaged until the session ends.
pub struct Session<'a> {
    rig: &'a mut Rig,
    program: Program,
    fuser: Fuser,
    masks: Option<MaskFolder>,
    /// Where the robot is.
    at: Place,
    reference: Option<Sentinel>,
    /// What each servo takes, as of the last look whether tendons pull; none before.
    scales: Vec<Scale>,
    /// Servos that restarted since that was last asked.
    restarted: Vec<u8>,
    go_on: &'a mut dyn FnMut() -> ControlFlow<()>,
}
