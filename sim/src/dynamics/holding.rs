//! Steps in which inextensible tendons have their commanded lengths (`held`).

use super::held::HeldLengths;
use super::rubbing::first_rubbing;
use super::{DynamicsError, Resistance, State, Stepper};
use crate::robot::{Command, Loads};

impl Stepper {
    /// Moves `state` by one time step in which `held` tendons have their lengths.
    pub(super) fn step_holding(
        &mut self,
        held: &mut HeldLengths,
        state: &mut State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        self.equations.accept(state, command, loads)?;
        self.begin(state, held.without_tensions(command), loads)?;
        self.find_tensions(held, state, command);
        if self.implicit && held.tensions.iter().all(|tension| tension.is_finite()) {
            // The stiffness that the tensions themselves give the joints.
            held.begun.copy_from(&held.tensions);
            self.begin(state, held.acting(command), loads)?;
            self.find_tensions(held, state, command);
        }
        self.finish(state, command, &held.change)
    }

    /// Finds the tensions of the step that was begun from `state`.
    fn find_tensions(&mut self, held: &mut HeldLengths, state: &State, command: &Command) {
        held.set_slopes(self.posture());
        for (slopes, response) in held.slopes.iter().zip(&mut held.responses) {
            self.solve_joints(slopes, response);
        }
        let (free, start) = (&mut held.free, &mut held.start);
        self.free_rates((state, command), Resistance::Step, free, start);
        held.solve(self.timestep, &self.posture().lengths, command);
    }

    /// The first tendon that is inextensible and whose length is commanded.
    pub(crate) fn first_held(&self) -> Option<usize> {
        let tendons = self.robot().tendons();
        tendons.iter().position(|tendon| tendon.holds_length())
    }

    /// The first tendon that has friction in its holes.
    pub(crate) fn first_rubbing(&self) -> Option<usize> {
        first_rubbing(self.robot())
    }

    /// Tendons whose lengths are commanded, without a stretch, and their tensions in the last step (N).
    pub fn held_tensions(&self) -> impl Iterator<Item = (usize, f64)> {
        self.held.iter().flat_map(|held| held.tensions())
    }
}
