//! Where a motion among obstacles may start.

use super::ContactStepper;
use crate::contact::ContactError;
use crate::contact::near::check_outside;
use crate::dynamics::State;

impl ContactStepper {
    /// Refuses a start inside an obstacle: steps would push the robot out the nearest way, however far that is.
    ///
    /// # Errors
    /// [`ContactError::StartsInside`] where the centre of a bead is inside an obstacle.
    ///
    /// # Panics
    /// If the state is of a robot with another number of discs.
    pub fn check_start(&self, state: &State) -> Result<(), ContactError> {
        let (positions, orientations) = state.configuration.place(self.robot());
        check_outside(&self.beads, &self.scene, |bead| {
            positions[bead.disc] + orientations[bead.disc] * bead.centre
        })
    }
}
