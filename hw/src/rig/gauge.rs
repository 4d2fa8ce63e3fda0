//! How hard tendons pull, by the currents of their servos.

use super::motion::{Drive, SWING};
use super::{Rig, RigError};
use crate::servo::Ticks;

/// Looks at servos that have been told where to swing, until they stand there.
const SETTLE: usize = 4;

/// Looks whose currents are averaged.
const LOOKS: usize = 4;

impl Rig {
    /// The currents (A) that the tendons' tensions take, without what the friction of gears hides: servos wind a little, stand,
    /// let out as much, and stand. Friction adds to the current where they have wound and takes from it where they have let
    /// out, so it cancels in the mean. All swing together, which bends no robot. Takes a second.
    ///
    /// # Errors
    /// [`RigError::Released`]; as [`step`](Self::step).
    pub fn gauge(&mut self) -> Result<Vec<f64>, RigError> {
        let held = self.held_goals().ok_or(RigError::Released)?.to_vec();
        let mut pulls = vec![0.0; held.len()];
        for side in [SWING, -SWING] {
            let goals = held.iter().zip(self.winches());
            let goals: Vec<Ticks> = goals
                .map(|(goal, winch)| Ticks(goal.0 + side * i32::from(winch.spool.direction)))
                .collect();
            let found = self.pulls_at(&goals)?;
            for (sum, pull) in pulls.iter_mut().zip(found) {
                *sum += pull / 2.0;
            }
        }
        self.step_to(&held)?;
        Ok(pulls)
    }

    /// The same, and what the friction of each gear takes (A): where it has wound, the current is larger by that.
    ///
    /// # Errors
    /// As [`gauge`](Self::gauge).
    pub fn gauge_friction(&mut self) -> Result<[Vec<f64>; 2], RigError> {
        let held = self.held_goals().ok_or(RigError::Released)?.to_vec();
        let pulls = self.gauge()?;
        // The last swing ended on the side from which servos wind.
        let wound = self.pulls_at(&held)?;
        let friction = wound
            .iter()
            .zip(&pulls)
            .map(|(wound, pull)| (wound - pull).max(0.0));
        let friction = friction.collect();
        Ok([pulls, friction])
    }

    /// Mean currents (A) that pull, where the servos stand at goals.
    fn pulls_at(&mut self, goals: &[Ticks]) -> Result<Vec<f64>, RigError> {
        let mut pulls = vec![0.0; goals.len()];
        self.step_to(goals)?;
        for _ in 0..SETTLE {
            self.poll()?;
        }
        for _ in 0..LOOKS {
            for (sum, state) in pulls.iter_mut().zip(self.poll()?) {
                *sum += state.pull / LOOKS as f64;
            }
        }
        Ok(pulls)
    }

    /// How far each servo has last turned one way (ticks), positive where that wound its tendon up; 0 where that may not have
    /// taken it through its gear's friction.
    pub fn last_turned(&self) -> Vec<i32> {
        let engaged = match &self.drive {
            Drive::Engaged(engaged) => engaged,
            Drive::Released => return vec![0; self.winches().len()],
        };
        let turned = engaged.wound.iter();
        turned
            .map(|&wound| if wound.abs() < SWING { 0 } else { wound })
            .collect()
    }
}
