//! What a controller needs of a robot.

mod cloud;
mod simulated;

pub use cloud::{CloudSensor, thinned};
pub use simulated::{Sensors, SimulatedPlant, Truth, TruthError};

use nalgebra::Vector3;
use tdcr_sim::inverse::recording::Marker;
use tdcr_sim::robot::Command;
use tdcr_sim::simulation::SimulationError;
use thiserror::Error;

/// A robot that can be measured and commanded: simulated, on the desk, or of one's own.
///
/// Time goes on by commands: [`command`](Self::command) gives what the tendons are commanded for the next
/// [`period`](Self::period), at whose end it returns.
pub trait Plant {
    /// Time from one command to the next (s).
    fn period(&self) -> f64;

    /// What the sensors say now.
    ///
    /// # Errors
    /// [`PlantError`] where the robot cannot be measured any more. A sensor that says nothing for a while is no error: its entry
    /// is missing, or not a number.
    fn measure(&mut self) -> Result<Measurement, PlantError>;

    /// Commands the tendons for the next period.
    ///
    /// # Errors
    /// [`PlantError`] where the robot cannot go on.
    fn command(&mut self, command: &Command) -> Result<(), PlantError>;

    /// Brings the robot back to where it was before its first command, at rest, where that can be done at once. Whether it was done:
    /// robots on the desk stay where they are.
    ///
    /// # Errors
    /// [`PlantError`] where the robot cannot go on.
    fn restart(&mut self) -> Result<bool, PlantError> {
        Ok(false)
    }

    /// Where the tip is in truth (m, world frame), where a plant knows it: errors are counted from there, and from what is
    /// measured elsewhere.
    fn true_tip(&self) -> Option<Vector3<f64>> {
        None
    }
}

/// What sensors say at one moment; each may be missing. Numbers that are not finite count as missing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurement {
    /// Points fixed to discs that were seen, and where (m, world frame).
    pub sightings: Vec<Sighting>,
    /// Points of the robot's surface that were seen (m, world frame).
    pub cloud: Option<Vec<Vector3<f64>>>,
    /// Tension of each tendon at its servo (N).
    pub tensions: Option<Vec<f64>>,
    /// Length of each tendon (m).
    pub lengths: Option<Vec<f64>>,
}

/// A point of a disc that was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// The point.
    pub marker: Marker,
    /// Where it was (m, world frame).
    pub position: Vector3<f64>,
}

/// Why a robot cannot be measured or commanded any more.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PlantError {
    /// The simulated robot cannot go on.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// Another one cannot.
    #[error(transparent)]
    Other(Box<dyn std::error::Error + Send + Sync>),
}

impl Measurement {
    /// The same without numbers that are not finite: a sensor that says none says nothing.
    pub fn finite(mut self) -> Self {
        let all = |values: &Vec<f64>| values.iter().all(|x| x.is_finite());
        self.sightings
            .retain(|seen| seen.position.iter().all(|x| x.is_finite()));
        if let Some(cloud) = &mut self.cloud {
            cloud.retain(|point| point.iter().all(|x| x.is_finite()));
        }
        self.cloud = self.cloud.filter(|cloud| !cloud.is_empty());
        self.tensions = self.tensions.filter(all);
        self.lengths = self.lengths.filter(all);
        self
    }

    /// Whether it says where the robot is.
    pub fn shows_robot(&self) -> bool {
        !self.sightings.is_empty() || self.cloud.is_some()
    }

    /// Where the origin of disc `disc` was seen (m).
    pub fn origin_of(&self, disc: usize) -> Option<Vector3<f64>> {
        let is_origin =
            |seen: &&Sighting| seen.marker.disc == disc && seen.marker.place == Vector3::zeros();
        self.sightings
            .iter()
            .find(is_origin)
            .map(|seen| seen.position)
    }
}
