//! How the robot's rates respond to impulses.

use nalgebra::{Matrix3, Vector3};

use super::coupled::Responds;
use super::touch::DiscVelocities;
use crate::dynamics::{DynamicsError, Reaction, Resistance, State, Stepper};
use crate::robot::Loads;

/// How the rates at the end of a step that was begun respond to impulses.
pub(super) struct StepResponse<'a> {
    pub stepper: &'a mut Stepper,
    pub loads: &'a Loads,
    pub resistance: Resistance,
}

impl Responds for StepResponse<'_> {
    fn respond(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        (self.stepper).respond::<false>(self.loads, self.resistance, reactions, out);
    }

    fn respond_keeping(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        (self.stepper).respond::<true>(self.loads, self.resistance, reactions, out);
    }

    fn respond_again(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        self.stepper.respond_again(self.resistance, reactions, out);
    }
}

/// Of each disc, a third of the trace of the matrix by which an impulse on its centre of mass changes the velocity there, in the
/// straight pose (1/kg): MuJoCo's `body_invweight0`.
pub(super) fn mobilities_of(stepper: &mut Stepper) -> Result<Vec<f64>, DynamicsError> {
    let robot = stepper.robot().clone();
    let loads = Loads::default();
    stepper.begin(&State::straight(&robot), &robot.mean_command(), &loads)?;
    let chain = stepper.posture().chain.clone();
    let n = robot.discs().len();
    let mut change = vec![Vector3::zeros(); n];
    let mut velocities = DiscVelocities::default();
    let mobility = |disc: usize| {
        let own = &robot.discs()[disc];
        let arm = chain.disc(disc) * (own.origin + own.centre_of_mass);
        let along = (0..3).map(|axis| {
            let mut reactions = vec![Reaction::default(); n];
            let impulse = Vector3::ith(axis, 1.0);
            reactions[disc].push(&arm, &impulse, &Matrix3::zeros());
            stepper.respond::<false>(&loads, Resistance::Inertia, &reactions, &mut change);
            velocities.set(&chain.centres, &change);
            velocities.of(disc, &arm)[axis]
        });
        along.sum::<f64>() / 3.0
    };
    Ok((0..n).map(mobility).collect())
}
