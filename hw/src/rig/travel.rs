//! Straight ways between commands.

use std::ops::ControlFlow;

use tdcr_sim::robot::Command;

use super::{Rig, RigError};

/// Part of a step that one may take more, so that rounding makes no step of its own.
const ROUNDING: f64 = 1e-6;

impl Rig {
    /// Moves to a command, all tendons on a straight line to it and none faster than the rig's slew. Whether tensions stay within
    /// bounds on the way, the rig's watch alone sees; [`Planner`](crate::plan::Planner) knows ways of which the simulator says so.
    /// `go_on` is asked before each step whether to.
    ///
    /// # Errors
    /// [`RigError::Limit`] and [`RigError::Command`] before anything moves; else as [`move_along`](Self::move_along).
    pub fn move_to(
        &mut self,
        command: &Command,
        go_on: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<(), RigError> {
        self.move_to_over(command, 1, go_on)
    }

    /// As [`move_to`](Self::move_to), in no fewer steps than `least`.
    ///
    /// # Errors
    /// As [`move_to`](Self::move_to).
    pub fn move_to_over(
        &mut self,
        command: &Command,
        least: usize,
        go_on: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<(), RigError> {
        self.goals(command)?;
        let from = self.commanded().ok_or(RigError::Released)?;
        let motion = &self.file.spec.motion;
        let reach = motion.slew * motion.period;
        let farthest = (from.iter().zip(command.as_slice()))
            .map(|(from, to)| (to - from).abs())
            .fold(0.0, f64::max);
        // The last step is of the command itself; a rig that is there already takes it too.
        let needed = (farthest / reach - ROUNDING).ceil();
        let steps = (needed as usize).max(least).max(1);
        let mut way = Vec::with_capacity(steps);
        for step in 1..steps {
            let part = step as f64 / steps as f64;
            let between = from.iter().zip(command.as_slice());
            let between: Vec<f64> = between
                .map(|(from, to)| from + part * (to - from))
                .collect();
            way.push(self.robot.command(&between)?);
        }
        way.push(command.clone());
        self.move_along(&way, go_on)
    }
}
