//! The state of a moving robot.

use nalgebra::{UnitQuaternion, Vector3};

use crate::chain::{Chain, Configuration};
use crate::robot::Robot;

/// A configuration and how fast it changes.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Rotation of each disc relative to the body below.
    pub configuration: Configuration,
    /// Rates of the joints' coordinates (rad/s), three entries per joint: the angular velocity in its disc's own frame, or of hinges the
    /// rates of their angles in order, then 0.
    pub velocity: Vec<f64>,
}

/// Energy of a moving robot (J).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Energy {
    /// Of the discs, armatures and payload in motion.
    pub kinetic: f64,
    /// Of tendons, backbones, limits, weight, payload and forces that keep their direction.
    pub potential: f64,
}

impl Energy {
    /// The sum (J), constant under a fixed command without damping.
    pub fn total(&self) -> f64 {
        self.kinetic + self.potential
    }
}

impl State {
    /// The straight pose, at rest.
    pub fn straight(robot: &Robot) -> Self {
        Self::at_rest(Configuration::straight(robot))
    }

    /// A configuration at rest.
    pub fn at_rest(configuration: Configuration) -> Self {
        let velocity = vec![0.0; 3 * configuration.0.len()];
        Self {
            configuration,
            velocity,
        }
    }

    /// Origins of the discs, world frame (m).
    ///
    /// # Panics
    /// If the state is of a robot with another number of discs.
    pub fn positions(&self, robot: &Robot) -> Vec<Vector3<f64>> {
        assert_eq!(
            self.configuration.0.len(),
            robot.discs().len(),
            "a state of this robot"
        );
        let mut chain = Chain::new(robot);
        chain.place(robot, &self.configuration);
        chain.positions
    }

    /// Whether all entries are finite numbers.
    pub fn is_finite(&self) -> bool {
        let turns = self
            .configuration
            .0
            .iter()
            .flat_map(|q: &UnitQuaternion<f64>| q.coords.iter());
        self.velocity.iter().chain(turns).all(|x| x.is_finite())
    }
}
