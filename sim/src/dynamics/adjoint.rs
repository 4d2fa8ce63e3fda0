//! Gradients of a cost by everything that led to it.

use nalgebra::Vector3;

use super::obstacles::ObstacleGradient;
use super::rollout::StepLoads;
use super::servos::Acting;
use super::step_adjoint::StepAdjoint;
use super::{DynamicsError, Rollout, State};
use crate::chain::Chain;
use crate::model_tangent::{ModelTangent, pull_back_centres};
use crate::pose::{PoseTangent, add_joint_cotangent};
use crate::robot::{Parameter, Robot};

/// Derivatives of a cost by a state: whichever of the two ways is handier, or both, to be summed.
#[derive(Clone, Debug, PartialEq)]
pub struct StateCotangent {
    /// By the joints' turns, then by their rates, in the coordinates of [`Linearisation`](super::Linearisation): `6 n`
    /// numbers.
    pub coordinates: Vec<f64>,
    /// By the pose of each disc in the world.
    pub poses: Vec<PoseTangent>,
}

impl StateCotangent {
    fn zero(robot: &Robot) -> Self {
        Self {
            coordinates: vec![0.0; 2 * robot.dof()],
            poses: vec![PoseTangent::default(); robot.discs().len()],
        }
    }
}

/// Gradient of a cost of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutGradient {
    /// By each step's command.
    pub commands: Vec<Vec<f64>>,
    /// By the start, in the coordinates of [`Linearisation`](super::Linearisation).
    pub start: Vec<f64>,
    /// By a force on the origin of each disc, world frame, the same at every step (1/N).
    pub forces: Vec<Vector3<f64>>,
    /// By a moment on each disc, world frame, the same at every step (1/(N m)).
    pub moments: Vec<Vector3<f64>>,
    /// The same of each step alone: by force and moment on each disc.
    pub wrenches: Vec<Vec<[Vector3<f64>; 2]>>,
    /// By each of the parameters asked for, the same at every step.
    pub parameters: Vec<f64>,
    /// By each obstacle of the scene, which stands still meanwhile; none of a motion in empty space.
    pub obstacles: Vec<ObstacleGradient>,
    /// By a displacement of the base (m) and a rotation of it (rad, world axes) before the motion begins; the start keeps its
    /// coordinates, and tendons move with the base.
    pub base: PoseTangent,
}

/// The gradient of a cost of the states of a motion, by its commands, its start, its loads and the robot's `parameters`: the
/// adjoint of the steps, from the last to the first (Griewank and Walther, Evaluating Derivatives, 2008, ch. 3). The steps are
/// [`Integrator::SemiImplicitEuler`](super::Integrator) steps of `timestep` (s), and `states` those after each, as
/// [`Stepper::rollout`](super::Stepper::rollout) gives them. A step takes O(n) time for `n` discs, whatever the number of
/// parameters.
///
/// `cost(k, state, cotangent)` adds to `cotangent`, which is zero, the derivatives of the cost by the state after `k` steps (the
/// start for 0). A cost of poses by itself needs no more: it is carried through the kinematics here, and where a parameter
/// ([`Parameter::Pitch`]) moves the discs in a given configuration, its gradient has that too. Where servos follow late, the gradient is
/// by the commands that are given. [`Parameter::Command`] stands for a change of the command of a tendon at all steps alike.
///
/// The start is given: where it is the equilibrium of something, the gradient does not have what changes with it. Tendons with friction go on in
/// their holes as they do, no contact being loaded at the start.
///
/// # Errors
/// [`DynamicsError`] when the motion is not of this robot, there is not one state per command, the robot does not have one of
/// the parameters or two of them overlap, or a derivative is not a finite number.
pub fn rollout_gradient(
    robot: &Robot,
    timestep: f64,
    rollout: &Rollout,
    states: &[State],
    parameters: &[Parameter],
    cost: impl FnMut(usize, &State, &mut StateCotangent),
) -> Result<RolloutGradient, DynamicsError> {
    gradient_by(
        &mut StepAdjoint::new(robot, timestep)?,
        (rollout, states),
        parameters,
        cost,
    )
}

/// The same by the `adjoint` of the steps of a motion and the states after them.
pub(crate) fn gradient_by(
    adjoint: &mut StepAdjoint,
    (rollout, states): (&Rollout, &[State]),
    parameters: &[Parameter],
    mut cost: impl FnMut(usize, &State, &mut StateCotangent),
) -> Result<RolloutGradient, DynamicsError> {
    let robot = &adjoint.robot().clone();
    let steps = rollout.commands.len();
    let size = |what, expected, found| DynamicsError::check_size(robot, what, [expected, found]);
    size("list of states", steps, states.len())?;
    let joints = robot.discs().len();
    for state in states.iter().chain([&rollout.start]) {
        size("configuration", joints, state.configuration.0.len())?;
    }
    robot.spec().check_parameters(parameters)?;
    let tangents = (parameters.iter())
        .map(|&parameter| ModelTangent::new(robot, &rollout.loads, parameter))
        .collect::<Result<Vec<_>, _>>()?;
    let acting = Acting::new(robot, &rollout.commands, adjoint.timestep());
    let mut seen = Seen::new(robot);
    let mut cotangent = vec![0.0; 2 * robot.dof()];
    let mut commands = vec![Vec::new(); steps];
    let mut wrenches = vec![Vec::new(); steps];
    let mut loads = StepLoads::new(robot, rollout)?;
    adjoint.begin_surroundings();
    let deflections = adjoint.deflections((rollout, states), &acting, &mut loads)?;
    adjoint.by_deflections().for_each(|by| *by = 0.0);
    for step in (0..steps).rev() {
        seen.add(step + 1, &states[step], &mut cost, &mut cotangent);
        let before = match step.checked_sub(1) {
            None => &rollout.start,
            Some(last) => &states[last],
        };
        let command = acting.command(step);
        let loads = loads.at(step)?;
        if let Some(deflections) = deflections.get(step) {
            let last = acting.command(step.saturating_sub(1));
            adjoint.set_deflections(&before.configuration, last, deflections)?;
        }
        adjoint.expand(before, command, loads)?;
        let model = &mut seen.model;
        let later = model.take_wrenches();
        commands[step] = adjoint.pull_back(before, command, loads, &mut cotangent, model)?;
        let own = model.at_origin.iter().zip(&model.moments);
        wrenches[step] = own.map(|(force, moment)| [*force, *moment]).collect();
        model.add_wrenches(&later);
    }
    seen.add(0, &rollout.start, &mut cost, &mut cotangent);
    acting.pull_back(&mut commands);
    let (obstacles, mut base) = adjoint.take_surroundings();
    base.position += seen.base.position;
    base.rotation += seen.base.rotation;
    let model = seen.model;
    Ok(RolloutGradient {
        commands,
        start: cotangent,
        parameters: tangents.iter().map(|tangent| tangent.dot(&model)).collect(),
        forces: model.at_origin,
        moments: model.moments,
        wrenches,
        obstacles,
        base,
    })
}

/// What the cost sees of the states.
struct Seen<'a> {
    robot: &'a Robot,
    chain: Chain,
    cotangent: StateCotangent,
    /// The cost's derivatives by the model, and by the base, which carries all poses along.
    model: ModelTangent,
    base: PoseTangent,
}

impl<'a> Seen<'a> {
    fn new(robot: &'a Robot) -> Self {
        Self {
            robot,
            chain: Chain::new(robot),
            cotangent: StateCotangent::zero(robot),
            model: ModelTangent::zero(robot),
            base: PoseTangent::default(),
        }
    }

    /// Adds the cost's derivatives by the state after `step` steps to `cotangent`, and those by the model to it.
    fn add(
        &mut self,
        step: usize,
        state: &State,
        cost: &mut impl FnMut(usize, &State, &mut StateCotangent),
        cotangent: &mut [f64],
    ) {
        let seen = &mut self.cotangent;
        seen.coordinates.fill(0.0);
        seen.poses.fill(PoseTangent::default());
        cost(step, state, seen);
        for (sum, own) in cotangent.iter_mut().zip(&seen.coordinates) {
            *sum += own;
        }
        if seen
            .poses
            .iter()
            .all(|pose| *pose == PoseTangent::default())
        {
            return;
        }
        self.chain.place(self.robot, &state.configuration);
        add_joint_cotangent(&self.chain, &seen.poses, cotangent);
        for (by, place) in seen.poses.iter().zip(&self.chain.positions) {
            let arm = place - self.robot.base();
            self.base.position += by.position;
            self.base.rotation += by.rotation + arm.cross(&by.position);
        }
        let centres: Vec<_> = seen.poses.iter().map(|pose| pose.position).collect();
        pull_back_centres(&self.chain, &centres, &mut self.model);
    }
}
