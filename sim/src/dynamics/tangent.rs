//! The tangent of a motion: how its states change with everything that led to them.
//!
//! A row of the Jacobian of a step is the gradient of one rate after it, which [`StepAdjoint`] gives in O(n). A step takes one of
//! them for each rate, O(n²) time for `n` discs: where a cost is one number, [`rollout_gradient`](super::rollout_gradient) is
//! cheaper.

use nalgebra::Vector3;

use super::jacobians::step_jacobians;
use super::obstacles::ObstacleTangent;
use super::rollout::StepLoads;
use super::servos::Acting;
use super::step_adjoint::StepAdjoint;
use super::{DynamicsError, Rollout, State};
use crate::chain::Chain;
use crate::model_tangent::ModelTangent;
use crate::pose::PoseTangent;
use crate::robot::{Parameter, Robot};

/// A change of all that a motion depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutDirection {
    /// Of each step's command.
    pub commands: Vec<Vec<f64>>,
    /// Of the start, in the coordinates of [`Linearisation`](super::Linearisation).
    pub start: Vec<f64>,
    /// Of a force on the origin of each disc, world frame, the same at every step (N).
    pub forces: Vec<Vector3<f64>>,
    /// Of a moment on each disc, world frame, the same at every step (N m).
    pub moments: Vec<Vector3<f64>>,
    /// The same of each step alone: of force and moment on each disc; empty where there is none.
    pub wrenches: Vec<Vec<[Vector3<f64>; 2]>>,
    /// Of parameters, the same at every step.
    pub parameters: Vec<(Parameter, f64)>,
    /// Of each obstacle of the scene, before the motion begins; empty where none changes.
    pub obstacles: Vec<ObstacleTangent>,
    /// Of the base: its displacement (m) and rotation (rad), world axes, before the motion begins.
    pub base: PoseTangent,
}

/// Change of a state.
#[derive(Clone, Debug, PartialEq)]
pub struct StateTangent {
    /// Of the joints' turns, then of their rates, in the coordinates of [`Linearisation`](super::Linearisation).
    pub coordinates: Vec<f64>,
    /// Of the pose of each disc in the world.
    pub poses: Vec<PoseTangent>,
}

/// Change of the states after each step of a motion along a direction: what
/// [`rollout_gradient`](super::rollout_gradient) is the adjoint of, with the same arguments.
///
/// # Errors
/// As of [`rollout_gradient`](super::rollout_gradient); [`DynamicsError::Size`] for a direction of another motion.
pub fn rollout_tangent(
    robot: &Robot,
    timestep: f64,
    rollout: &Rollout,
    states: &[State],
    direction: &RolloutDirection,
) -> Result<Vec<StateTangent>, DynamicsError> {
    tangent_by(
        &mut StepAdjoint::new(robot, timestep)?,
        (rollout, states),
        direction,
    )
}

/// The same by the `adjoint` of the steps of a motion and the states after them.
pub(crate) fn tangent_by(
    adjoint: &mut StepAdjoint,
    (rollout, states): (&Rollout, &[State]),
    direction: &RolloutDirection,
) -> Result<Vec<StateTangent>, DynamicsError> {
    let (robot, timestep) = (&adjoint.robot().clone(), adjoint.timestep());
    let (steps, dof, discs) = (rollout.commands.len(), robot.dof(), robot.discs().len());
    let RolloutDirection {
        wrenches,
        obstacles,
        base,
        ..
    } = direction;
    let around = !obstacles.is_empty() || *base != PoseTangent::default();
    let of_step = wrenches.iter().find(|step| step.len() != discs);
    let where_given = |found: usize, expected: usize| if found == 0 { 0 } else { expected };
    for (what, expected, found) in [
        (
            "direction of wrenches",
            where_given(wrenches.len(), steps),
            wrenches.len(),
        ),
        (
            "direction of the wrenches of a step",
            discs,
            of_step.map_or(discs, Vec::len),
        ),
        ("list of states", steps, states.len()),
        ("direction of commands", steps, direction.commands.len()),
        ("direction of the start", 2 * dof, direction.start.len()),
        ("direction of forces", discs, direction.forces.len()),
        ("direction of moments", discs, direction.moments.len()),
        (
            "direction of obstacles",
            where_given(obstacles.len(), adjoint.obstacles().len()),
            obstacles.len(),
        ),
    ] {
        DynamicsError::check_size(robot, what, [expected, found])?;
    }
    let model = Model::new(robot, rollout, direction)?;
    let acting = Acting::new(robot, &rollout.commands, timestep);
    let by_acting = acting.push_forward(&direction.commands);
    let mut loads = StepLoads::new(robot, rollout)?;
    let mut chain = Chain::new(robot);
    let mut coordinates = direction.start.clone();
    let mut before = &rollout.start;
    let mut tangents = Vec::with_capacity(steps);
    let deflections = adjoint.deflections((rollout, states), &acting, &mut loads)?;
    // Changes of what tendons are deflected by in their holes.
    let mut deflected = vec![0.0; adjoint.contacts()];
    for (step, after) in states.iter().enumerate() {
        let (command, loads) = (acting.command(step), loads.at(step)?);
        if let Some(deflections) = deflections.get(step) {
            let last = acting.command(step.saturating_sub(1));
            adjoint.set_deflections(&before.configuration, last, deflections)?;
        }
        adjoint.expand(before, command, loads)?;
        // Change of each rate, and of each deflection: its gradient along the direction.
        let mut rates = vec![0.0; dof + deflected.len()];
        for (i, rate) in rates.iter_mut().enumerate() {
            let mut gradient = vec![0.0; 2 * dof];
            if let Some(by) = gradient[dof..].get_mut(i) {
                *by = 1.0;
            }
            for (contact, by) in adjoint.by_deflections().enumerate() {
                *by = f64::from(u8::from(dof + contact == i));
            }
            let mut by_model = ModelTangent::zero(robot);
            if around {
                adjoint.begin_surroundings();
            }
            let by_command =
                adjoint.pull_back(before, command, loads, &mut gradient, &mut by_model)?;
            let (by_obstacles, by_base) = adjoint.take_surroundings();
            let by_obstacles = obstacles.iter().zip(by_obstacles);
            let by_deflections = adjoint.by_deflections().zip(&deflected);
            *rate = dot(&gradient, &coordinates)
                + by_deflections.map(|(by, change)| *by * change).sum::<f64>()
                + dot(&by_command, &by_acting[step])
                + model.along(&by_model, step)
                + base.position.dot(&by_base.position)
                + base.rotation.dot(&by_base.rotation)
                + by_obstacles
                    .map(|(change, by)| change.dot(&by))
                    .sum::<f64>();
        }
        deflected.copy_from_slice(&rates.split_off(dof));
        // q+ = q exp(h v+).
        let (turns, old_rates) = coordinates.split_at_mut(dof);
        let joints = turns.as_chunks_mut::<3>().0.iter_mut();
        let moved = (after.velocity.as_chunks::<3>().0.iter()).zip(rates.as_chunks::<3>().0);
        for ((turn, (velocity, rate)), disc) in joints.zip(moved).zip(robot.discs()) {
            let by = Vector3::from(*velocity) * timestep;
            let (back, jacobian) = step_jacobians(disc.hinges.as_deref(), &by);
            *turn =
                (back * Vector3::from(*turn) + jacobian * Vector3::from(*rate) * timestep).into();
        }
        old_rates.copy_from_slice(&rates);
        chain.place(robot, &after.configuration);
        tangents.push(StateTangent {
            poses: model.move_discs(&chain, robot, &coordinates[..dof]),
            coordinates: coordinates.clone(),
        });
        before = after;
    }
    Ok(tangents)
}

/// Change of the model along a direction.
struct Model<'a> {
    direction: &'a RolloutDirection,
    /// For a unit of each parameter, and how much it changes.
    tangents: Vec<(ModelTangent, f64)>,
}

impl<'a> Model<'a> {
    fn new(
        robot: &Robot,
        rollout: &Rollout,
        direction: &'a RolloutDirection,
    ) -> Result<Self, DynamicsError> {
        let named: Vec<_> = direction.parameters.iter().map(|(p, _)| *p).collect();
        robot.spec().check_parameters(&named)?;
        let changing = direction.parameters.iter().filter(|(_, by)| *by != 0.0);
        let tangents = changing
            .map(|&(parameter, by)| Ok((ModelTangent::new(robot, &rollout.loads, parameter)?, by)))
            .collect::<Result<_, DynamicsError>>()?;
        Ok(Self {
            direction,
            tangents,
        })
    }

    /// Change of a number in a step with this gradient by the model.
    fn along(&self, gradient: &ModelTangent, step: usize) -> f64 {
        let vectors = |a: &[Vector3<f64>], b: &[Vector3<f64>]| -> f64 {
            a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
        };
        let parameters = self.tangents.iter().map(|(one, by)| one.dot(gradient) * by);
        let own = self.direction.wrenches.get(step).into_iter().flatten();
        let own = own.zip(gradient.at_origin.iter().zip(&gradient.moments));
        let own = own.map(|([force, moment], by)| force.dot(by.0) + moment.dot(by.1));
        parameters.sum::<f64>()
            + own.sum::<f64>()
            + vectors(&self.direction.forces, &gradient.at_origin)
            + vectors(&self.direction.moments, &gradient.moments)
    }

    /// Change of the discs' poses when the joints' coordinates change by `turns`.
    fn move_discs(&self, chain: &Chain, robot: &Robot, turns: &[f64]) -> Vec<PoseTangent> {
        let PoseTangent {
            mut rotation,
            position: mut centre,
        } = self.direction.base;
        let mut below = robot.base();
        let joints = turns.as_chunks::<3>().0.iter().enumerate();
        joints
            .map(|(i, turn)| {
                let longer = self
                    .tangents
                    .iter()
                    .map(|(one, by)| one.joint_offsets[i] * *by);
                centre += rotation.cross(&(chain.centres[i] - below))
                    + chain.orientations[i] * longer.sum::<Vector3<f64>>();
                below = chain.centres[i];
                rotation += chain.axes(i) * Vector3::from(*turn);
                PoseTangent {
                    position: centre + rotation.cross(&(chain.positions[i] - below)),
                    rotation,
                }
            })
            .collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
