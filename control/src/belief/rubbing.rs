//! A model whose tendons have friction: where it rests depends on its way.

use nalgebra::{DMatrix, DVector, Vector3};
use tdcr_sim::contact::ContactError;
use tdcr_sim::robot::{Command, Loads, Robot, Tendon};
use tdcr_sim::scene::Scene;
use tdcr_sim::statics::Equilibrium;
use tdcr_sim::tendon_friction::ContactPath;

/// The way of a robot with friction of tendons.
#[derive(Clone, Debug)]
pub(super) struct Rubbing {
    /// The way to where the robot rests now, and to where it rested before.
    ways: [ContactPath; 2],
    /// Values of the unknowns under which it was led.
    pub values: DVector<f64>,
    /// The last equilibrium that was asked for.
    found: Equilibrium,
}

impl Rubbing {
    /// Of `robot` in `scene`, with so many unknowns; `None` where no tendon has friction.
    pub fn new(robot: &Robot, scene: &Scene, unknowns: usize) -> Option<Box<Self>> {
        let rubs = |tendon: &Tendon| tendon.friction.is_some_and(|own| own.coefficient > 0.0);
        robot.tendons().iter().any(rubs).then(|| {
            let path = ContactPath::new(robot, scene);
            Box::new(Self {
                found: path.state().equilibrium.clone(),
                values: DVector::zeros(unknowns),
                ways: [path.clone(), path],
            })
        })
    }

    /// Where the robot would come to rest on the way from where it rests to `command`; it stays where it is.
    pub fn settle(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&Equilibrium, ContactError> {
        let mut way = self.ways[0].clone();
        let state = way.advance(command, loads)?;
        self.found.clone_from(&state.equilibrium);
        Ok(&self.found)
    }

    /// How the discs would move with the command on that way; `None` where the path has no derivatives.
    pub fn by_tendons(
        &self,
        command: &Command,
        loads: &Loads,
    ) -> Result<Option<DMatrix<f64>>, ContactError> {
        self.ways[0].clone().advance_differentiated(command, loads)
    }

    /// Leads the robot to `command`, where it rests from now on.
    pub fn rest(&mut self, command: &Command, loads: &Loads) -> Result<&Equilibrium, ContactError> {
        let [now, before] = &mut self.ways;
        before.clone_from(now);
        Ok(&now.advance(command, loads)?.equilibrium)
    }

    /// Where its tip came from and came to (m) on the last way, which led from one command to another, under these loads.
    pub fn last_step(
        &self,
        commands: [&Command; 2],
        loads: &Loads,
    ) -> Result<[Vector3<f64>; 2], ContactError> {
        let mut way = self.ways[1].clone();
        let mut tip = |command| -> Result<Vector3<f64>, ContactError> {
            let found = &way.advance(command, loads)?.equilibrium;
            Ok(found.pose().tip().translation.vector)
        };
        Ok([tip(commands[0])?, tip(commands[1])?])
    }
}
