//! What a settler remembers from one solve to the next, so that another one goes on to the last bit.

use super::descent::Prediction;
use super::{Equilibrium, Settler};
use crate::chain::Configuration;
use crate::robot::Loads;

/// What a [`Settler`] remembers of its last solve, on which the next [`Settler::follow`] depends.
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    /// Where the robot last settled.
    pub equilibrium: Equilibrium,
    /// The command (m or N), with the rest lengths of tendons whose length is commanded corrected.
    pub command: Vec<f64>,
    /// How the command last changed (m or N).
    pub change: Vec<f64>,
    /// The configuration that was predicted for that change.
    pub predicted: Configuration,
}

impl Settler {
    /// What this settler remembers.
    pub fn memory(&self) -> Memory {
        let Prediction {
            change,
            configuration,
        } = self.descent.prediction.clone();
        Memory {
            equilibrium: self.equilibrium.clone(),
            command: self.command.clone(),
            change,
            predicted: configuration,
        }
    }

    /// Goes on from what another settler of the robot remembers, which last settled under `loads`: what follows is the
    /// same to the last bit, where these loads are a payload and forces in the world.
    ///
    /// # Panics
    /// If the memory or the loads are of a robot of another size.
    pub fn resume(&mut self, memory: Memory, loads: &Loads) {
        self.dead.set(&self.robot, loads);
        self.command.copy_from_slice(&memory.command);
        self.descent.start_at(&memory.equilibrium.configuration);
        self.expand();
        let descent = &mut self.descent;
        descent.factor.factorise(&descent.expansion, 0.0);
        descent.prediction.change.copy_from_slice(&memory.change);
        let predicted = &mut descent.prediction.configuration.0;
        predicted.copy_from_slice(&memory.predicted.0);
        self.equilibrium = memory.equilibrium;
    }
}
