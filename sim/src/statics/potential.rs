//! The energy of an equilibrium.

use super::Equilibrium;
use crate::energy::{DeadForces, Potential};
use crate::robot::{Command, Loads, Robot};
use crate::tendon::Posture;

impl Robot {
    /// Potential energy (J) of the robot in an equilibrium of `command` and `loads`: of the joints and tendons with their
    /// drives, of all weights (0 at `z = 0` of the world for gravity along z), and of dead loads. An inextensible tendon of
    /// commanded length stores none; moments, and forces that turn with their disc, have none.
    ///
    /// # Panics
    /// As [`Robot::settle`], or if the equilibrium is of a robot with other numbers of discs or tendons.
    pub fn potential_energy(
        &self,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
    ) -> f64 {
        let mut posture = Posture::new(self);
        posture.place(self, &equilibrium.configuration);
        let mut dead = DeadForces::new(self);
        dead.set(self, loads);
        // A tendon that holds its length is a spring at rest.
        let rest: Vec<f64> = (self.tendons().iter().zip(command.as_slice()))
            .zip(&posture.lengths)
            .map(|((tendon, command), length)| match tendon.holds_length() {
                true => *length,
                false => *command,
            })
            .collect();
        let potential = Potential {
            robot: self,
            command: &rest,
            dead: &dead,
        };
        potential.energy(&equilibrium.configuration, &posture)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    /// Along a path of equilibria the energy changes by the work of what is changed: `dV/dm = -g . tip` for a payload.
    #[test]
    fn the_energy_changes_with_a_payload_by_the_height_of_the_tip() {
        let robot = Robot::load("2m").unwrap();
        let command = robot
            .command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
            .unwrap();
        let energy = |mass: f64| {
            let loads = Loads::payload(mass).unwrap();
            let settled = robot.settle(&command, &loads);
            (
                robot.potential_energy(&command, &loads, &settled),
                settled.positions[9].z,
            )
        };
        let (step, middle) = (1e-5, energy(0.01));
        let slope = (energy(0.01 + step).0 - energy(0.01 - step).0) / (2.0 * step);
        assert!(
            (slope - 9.81 * middle.1).abs() < 1e-6 * slope.abs(),
            "{slope}"
        );
    }
}
