//! Paths of a robot whose tendons have friction in their holes.

use tdcr_sim::contact::{Contact, ContactError};
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;
use tdcr_sim::tendon_friction::{ContactPath, FrictionPath, FrictionState};

/// The path of a robot whose tendons have friction.
pub(super) enum FrictionalPath {
    /// It touches nothing, and takes all loads.
    Free(FrictionPath),
    /// It goes among obstacles.
    Among(ContactPath),
}

impl FrictionalPath {
    /// Prepares to follow `robot` in `scene`.
    pub fn new(robot: &Robot, scene: &Scene) -> Self {
        match scene.is_empty() {
            true => Self::Free(FrictionPath::new(robot)),
            false => Self::Among(ContactPath::new(robot, scene)),
        }
    }

    /// Begins anew under a command.
    pub fn start(&mut self, command: &Command, loads: &Loads) -> Result<(), ContactError> {
        match self {
            Self::Free(path) => path.start(command, loads),
            Self::Among(path) => path.start(command, loads)?,
        };
        Ok(())
    }

    /// Goes on to a command.
    pub fn advance(&mut self, command: &Command, loads: &Loads) -> Result<(), ContactError> {
        match self {
            Self::Free(path) => path.advance(command, loads),
            Self::Among(path) => path.advance(command, loads)?,
        };
        Ok(())
    }

    /// Where it has come to.
    pub fn state(&self) -> &FrictionState {
        match self {
            Self::Free(path) => path.state(),
            Self::Among(path) => path.state(),
        }
    }

    /// What it touches there.
    pub fn contacts(&self) -> &[Contact] {
        match self {
            Self::Free(_) => &[],
            Self::Among(path) => path.contacts(),
        }
    }
}
