//! Whether a motion stays where hinges have angles.

use nalgebra::Vector3;

use super::{DynamicsError, LARGEST_TURN, State};
use crate::robot::Robot;

/// The angles of a robot's hinges before a step.
#[derive(Clone, Debug)]
pub(super) struct HingeReach {
    robot: Robot,
    /// Joints that consist of hinges, and their angles (rad).
    angles: Vec<(usize, Vector3<f64>)>,
}

impl HingeReach {
    pub fn new(robot: &Robot) -> Self {
        let joints = robot.discs().iter().enumerate();
        Self {
            robot: robot.clone(),
            angles: joints
                .filter(|(_, disc)| disc.hinges.is_some())
                .map(|(joint, _)| (joint, Vector3::zeros()))
                .collect(),
        }
    }

    /// Notes the angles of a state.
    pub fn remember(&mut self, state: &State) {
        for (joint, angles) in &mut self.angles {
            if let Some(hinges) = &self.robot.discs()[*joint].hinges {
                *angles = hinges.angles(&state.configuration.0[*joint]);
            }
        }
    }

    /// Refuses a state that a step from there led to through a gimbal lock or beyond a half turn of a hinge: the angles jump there.
    pub fn check(&self, state: &State) -> Result<(), DynamicsError> {
        for (joint, before) in &self.angles {
            let Some(hinges) = &self.robot.discs()[*joint].hinges else {
                continue;
            };
            let angles = hinges.angles(&state.configuration.0[*joint]);
            let turned = (angles - before).amax();
            if !hinges.reaches(&angles) || turned.is_nan() || turned > 1.5 * LARGEST_TURN {
                return Err(DynamicsError::HingesOutOfReach {
                    joint: *joint,
                    angles: before.as_slice()[..hinges.count].to_vec(),
                });
            }
        }
        Ok(())
    }
}
