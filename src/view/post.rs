//! What goes to sessions and comes from them.

use std::sync::Arc;

use tdcr_sim::chain::Configuration;
use tdcr_sim::robot::{Command, Loads, RobotSpec};
use tdcr_sim::scene::Scene;

use super::desk::{PageId, Seen};
use super::message::{Letter, Reply};

/// What comes to a session.
pub(super) enum Input {
    /// A page's letter.
    Letter(Letter),
    /// A page's letter that could not be read, and why.
    Unread(String),
    /// The file of the robot changed: what is in it now, or why it is refused.
    File(Arc<Result<RobotSpec, String>>),
    /// What is seen of the rig, for this page.
    Rig(PageId, Arc<Seen>),
    /// What the program behind the server shows.
    Given(Arc<Given>),
}

/// What the program behind a server shows on all its pages.
#[derive(Clone, Debug)]
pub enum Given {
    /// The robot under a command (m, or N for a tension drive), followed from where it is.
    Command(Command),
    /// The robot in a pose: of an environment, a controller, another simulator.
    Pose {
        /// Rotation of each disc relative to the body below.
        configuration: Configuration,
        /// The command that its tendons are under (m, or N for a tension drive).
        command: Command,
        /// The robot, where it may be another one than the page was opened with.
        subject: Option<Arc<Subject>>,
        /// What is marked beside it.
        marks: Marks,
    },
}

/// A robot that a program shows, and what is around it. Pages take the same one for another only if it is another allocation.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The robot.
    pub robot: RobotSpec,
    /// What is around it.
    pub scene: Scene,
    /// What pulls at it.
    pub loads: Loads,
}

/// Balls that mark places.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Marks {
    /// Their centres, world frame (m).
    pub places: Vec<[f32; 3]>,
    /// Their radius (m).
    pub radius: f64,
}

/// What goes to a page.
pub(super) enum Output {
    /// JSON.
    Words(Reply),
    /// A frame.
    Numbers(Vec<u8>),
}
