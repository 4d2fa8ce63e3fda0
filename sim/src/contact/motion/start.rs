//! Where a motion among obstacles may start.

use super::ContactStepper;
use crate::contact::ContactError;
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
        // A bead without a radius is where it presses.
        let beads = self.beads.as_slice().iter();
        for bead in beads.filter(|bead| bead.radius > 0.0) {
            let centre = positions[bead.disc] + orientations[bead.disc] * bead.centre;
            let mut obstacles = self.scene.obstacles().iter();
            if let Some(obstacle) = obstacles.find(|obstacle| obstacle.contains(&centre)) {
                return Err(ContactError::StartsInside {
                    disc: bead.disc,
                    obstacle: obstacle.name.clone(),
                    position: centre.into(),
                });
            }
        }
        Ok(())
    }
}
