//! How hard tendons pull, by the currents of their servos.

use super::{Rig, RigError};
use crate::servo::Ticks;

/// How far servos swing to either side (ticks): as far as takes a motor beyond what its gear's friction holds.
const SWING: i32 = 30;

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
            self.step_to(&goals)?;
            for _ in 0..SETTLE {
                self.poll()?;
            }
            for _ in 0..LOOKS {
                for (sum, state) in pulls.iter_mut().zip(self.poll()?) {
                    *sum += state.pull / (2 * LOOKS) as f64;
                }
            }
        }
        self.step_to(&held)?;
        Ok(pulls)
    }
}
