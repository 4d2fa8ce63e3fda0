//! Gradients of a cost by everything that led to it.

use nalgebra::DVector;

use super::{DynamicsError, Lineariser, Rollout, State};
use crate::robot::Robot;

/// Gradient of a cost of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutGradient {
    /// By each step's command.
    pub commands: Vec<Vec<f64>>,
    /// By the start, in the coordinates of [`Linearisation`](super::Linearisation).
    pub start: Vec<f64>,
}

/// The gradient of a cost of the states of a motion, by its commands and its start: the adjoint of
/// the linearised steps, from the last to the first. The steps are
/// [`Integrator::SemiImplicitEuler`](super::Integrator) steps of `timestep` (s), and `states` those
/// after each, as [`Stepper::rollout`](super::Stepper::rollout) gives them.
///
/// `cost(k, state, gradient)` adds to `gradient` that of the cost by the state after `k` steps (the
/// start for 0), in the coordinates of [`Linearisation`](super::Linearisation): `6 n` entries.
///
/// # Errors
/// [`DynamicsError`] when the motion is not of this robot, or there is not one state per command.
pub fn rollout_gradient(
    robot: &Robot,
    timestep: f64,
    rollout: &Rollout,
    states: &[State],
    mut cost: impl FnMut(usize, &State, &mut [f64]),
) -> Result<RolloutGradient, DynamicsError> {
    let steps = rollout.commands.len();
    if states.len() != steps {
        return Err(DynamicsError::Size {
            what: "list of states",
            robot: robot.spec().name.clone(),
            expected: steps,
            found: states.len(),
        });
    }
    let mut lineariser = Lineariser::new(robot, timestep)?;
    let mut adjoint = DVector::zeros(2 * robot.dof());
    let mut commands = vec![Vec::new(); steps];
    for step in (0..steps).rev() {
        cost(step + 1, &states[step], adjoint.as_mut_slice());
        let before = match step.checked_sub(1) {
            None => &rollout.start,
            Some(last) => &states[last],
        };
        let linear = lineariser.linearise(before, &rollout.commands[step], &rollout.loads)?;
        commands[step] = linear.b.tr_mul(&adjoint).as_slice().to_vec();
        adjoint = linear.a.tr_mul(&adjoint);
    }
    cost(0, &rollout.start, adjoint.as_mut_slice());
    Ok(RolloutGradient {
        commands,
        start: adjoint.as_slice().to_vec(),
    })
}
