//! Steps in which inextensible tendons have their commanded lengths (`held`).

use super::held::{HeldLength, HeldLengths};
use super::rubbing::first_rubbing;
use super::{DynamicsError, Resistance, State, Stepper};
use crate::robot::{Command, Loads};

impl Stepper {
    /// Begins a step from `state` in which `held` tendons have their lengths.
    pub(super) fn begin_holding(
        &mut self,
        held: &mut HeldLengths,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        self.equations.accept(state, command, loads)?;
        self.begin_alone(state, held.without_tensions(command), loads)?;
        self.find_tensions(held, state, command);
        if self.implicit && held.tensions.iter().all(|tension| tension.is_finite()) {
            self.begin_under_tensions(held, state, command, loads)?;
        }
        self.accelerate_by(&held.change);
        Ok(())
    }

    /// Begins it with the stiffness that the tensions found themselves give the joints.
    fn begin_under_tensions(
        &mut self,
        held: &mut HeldLengths,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        held.begun.copy_from(&held.tensions);
        self.begin_alone(state, held.acting(command), loads)?;
        self.find_tensions(held, state, command);
        Ok(())
    }

    /// Begins an implicit step anew where what was touched has changed the tensions that hold lengths. Returns whether it did.
    pub(crate) fn hold_again(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<bool, DynamicsError> {
        let Some(mut held) = self.held.take() else {
            return Ok(false);
        };
        let again = self.implicit && held.tensions.iter().all(|tension| tension.is_finite());
        let mut begun = Ok(());
        if again {
            begun = self.begin_under_tensions(&mut held, state, command, loads);
            self.accelerate_by(&held.change);
        }
        self.held = Some(held);
        begun.map(|()| again)
    }

    /// The tendons of commanded length in the step that was begun.
    pub(crate) fn held_lengths(&self) -> impl Iterator<Item = HeldLength<'_>> {
        self.held.iter().flat_map(|held| held.all())
    }

    /// Takes the tensions that these tendons have among all that acts in the step (N).
    pub(crate) fn set_held_tensions(&mut self, tensions: impl Iterator<Item = f64>) {
        if let Some(held) = &mut self.held {
            for (own, tension) in held.tensions.iter_mut().zip(tensions) {
                *own = tension;
            }
        }
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
