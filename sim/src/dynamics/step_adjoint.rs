//! The adjoint of a step, without its matrices.
//!
//! The step is `v+ = v + h a`, `q+ = q exp(h v+)`, with `M a = f` (`h D` in `M`). With the multipliers `w = M^-1 a'` of a
//! cotangent `a'` of the accelerations, the derivative of the cost by anything is `w . (df - dM a)`: that by the state takes
//! one sum over the composite bodies from the tip down and one from the base up, that by all numbers of the model besides the
//! same for the energy's terms. All of it is O(n). What the surroundings push with depends on the velocities at the end of the step,
//! so that their inertances are in `M` ([`super::pushes`]).

use nalgebra::{Vector3, Vector6};

use super::expansion::StepExpansion;
use super::inertia_cotangent::pull_back_inertia;
use super::jacobians::step_jacobians;
use super::obstacles::ObstacleGradient;
use super::pushes::{Push, PushedMatrix, pull_back_pushes, symmetric_forms};
use super::reaction::Reaction;
use super::rollout::StepLoads;
use super::rubbing::{RubbedStep, Rubbing, first_rubbing};
use super::servos::Acting;
use super::spatial::cross_force;
use super::surroundings::Surroundings;
use super::{DynamicsError, Integrator, Rollout, State, Stepper};
use crate::chain::Configuration;
use crate::energy::DeadForces;
use crate::energy::following::add_transposed_product;
use crate::model_tangent::{Expanded, ModelTangent};
use crate::pose::PoseTangent;
use crate::robot::{Command, Loads, Robot};

/// The adjoint of steps of one robot; reuses most of its memory.
#[derive(Clone, Debug)]
pub(crate) struct StepAdjoint {
    pub(super) step: StepExpansion,
    surroundings: Option<Box<dyn Surroundings>>,
    /// What these do in the step that is expanded, and the step's matrix with it.
    pushes: Vec<Push>,
    pushed: PushedMatrix,
    /// What is in the step's matrix besides the robot, where it is symmetric.
    forms: Option<Vec<Reaction>>,
    /// Sums of what steps that were pulled back add, by each obstacle, and by a rotation of the base; empty where nobody has asked.
    obstacles: Vec<ObstacleGradient>,
    base_rotation: Option<Vector3<f64>>,
    /// Cotangents of the accelerations, then products; world axes.
    scratch: Vec<Vector3<f64>>,
    /// The `w`, world axes.
    multipliers: Vec<Vector3<f64>>,
    gradient: Vec<Vector3<f64>>,
}

impl StepAdjoint {
    /// Of [`SemiImplicitEuler`](super::Integrator) steps of `robot` by `timestep` (s).
    pub fn new(robot: &Robot, timestep: f64) -> Result<Self, DynamicsError> {
        let alone = robot.spec().fluid.is_none() && first_rubbing(robot).is_none();
        let surroundings: Option<Box<dyn Surroundings>> = match alone {
            false => Some(Box::new(Stepper::new(
                robot,
                timestep,
                Integrator::SemiImplicitEuler,
            )?)),
            true => None,
        };
        Self::among(robot, timestep, surroundings)
    }

    /// The same of a robot that moves among `surroundings`.
    pub(crate) fn among(
        robot: &Robot,
        timestep: f64,
        mut surroundings: Option<Box<dyn Surroundings>>,
    ) -> Result<Self, DynamicsError> {
        let zeros = vec![Vector3::zeros(); robot.discs().len()];
        let mut step = StepExpansion::new(robot, timestep)?;
        if let Some(around) = &mut surroundings
            && let Some(rubbing) = &around.stepper().rubbing
        {
            step.rubbed = Some(Box::new(RubbedStep::new(robot, rubbing, timestep)));
        }
        Ok(Self {
            surroundings,
            pushes: Vec::new(),
            pushed: PushedMatrix::new(&step),
            forms: Some(Vec::new()),
            obstacles: Vec::new(),
            base_rotation: None,
            step,
            scratch: zeros.clone(),
            multipliers: zeros.clone(),
            gradient: zeros,
        })
    }

    /// Takes the step from `before`, to be pulled back through.
    ///
    /// # Errors
    /// [`DynamicsError`] when state, command or loads are not of this robot, or it cannot be taken.
    pub fn expand(
        &mut self,
        before: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        self.pushes.clear();
        let Some(surroundings) = &mut self.surroundings else {
            return self.step.expand(before, command, loads);
        };
        let accelerations = surroundings
            .step(before, command, loads, &mut self.pushes)?
            .to_vec();
        let rubbing = surroundings.stepper().rubbing.as_deref();
        (self.step).expand_at((before, command), loads, &accelerations, rubbing)?;
        let centres = &self.step.equations.posture.chain.centres;
        self.forms = match rubbing {
            None => symmetric_forms(&self.pushes, centres),
            Some(_) => None,
        };
        let inflows = rubbing.map(Rubbing::inflows);
        match self.forms.is_some() || (self.pushed).factorise(&self.step, &self.pushes, inflows) {
            true => Ok(()),
            false => Err(DynamicsError::NotDifferentiable),
        }
    }

    /// Where the steps of a motion begin that has gone through these states, what the tendons' contacts in their holes are deflected by
    /// (m), none being loaded at the start: nothing of a robot without friction.
    ///
    /// # Errors
    /// [`DynamicsError`] of the first step that fails.
    pub(super) fn deflections(
        &mut self,
        (rollout, states): (&Rollout, &[State]),
        acting: &Acting,
        loads: &mut StepLoads,
    ) -> Result<Vec<Vec<Vec<f64>>>, DynamicsError> {
        let Some(surroundings) = &mut self.surroundings else {
            return Ok(Vec::new());
        };
        if self.step.rubbed.is_none() || states.is_empty() {
            return Ok(Vec::new());
        }
        let (start, first) = (&rollout.start, acting.command(0));
        (surroundings.stepper()).set_deflections(&start.configuration, first, &[])?;
        let before = std::iter::once(start).chain(states);
        let mut all = Vec::with_capacity(states.len());
        for (step, before) in before.enumerate().take(states.len()) {
            let profiles = surroundings.stepper().tendon_profiles();
            all.push(profiles.iter().map(|own| own.deflections.clone()).collect());
            self.pushes.clear();
            let (command, loads) = (acting.command(step), loads.at(step)?);
            surroundings.step(before, command, loads, &mut self.pushes)?;
        }
        Ok(all)
    }

    /// Sets what the contacts are deflected by in the step from a configuration to which a `command` has led.
    ///
    /// # Errors
    /// As [`Stepper::set_deflections`].
    pub fn set_deflections(
        &mut self,
        configuration: &Configuration,
        command: &Command,
        deflections: &[Vec<f64>],
    ) -> Result<(), DynamicsError> {
        if let (Some(around), Some(rubbed)) = (&mut self.surroundings, &mut self.step.rubbed) {
            rubbed.set_deflections(deflections);
            (around.stepper()).set_deflections(configuration, command, deflections)?;
        }
        Ok(())
    }

    /// How many contacts of tendons in their holes there are.
    pub fn contacts(&self) -> usize {
        self.step.rubbed.as_ref().map_or(0, |rubbed| rubbed.count())
    }

    /// The derivatives of the cost by the contacts' deflections after the step that is pulled back next; then before that step.
    pub fn by_deflections(&mut self) -> impl Iterator<Item = &mut f64> {
        let rubbed = self.step.rubbed.iter_mut();
        rubbed.flat_map(|rubbed| rubbed.cotangents.iter_mut().flatten())
    }

    /// Where the origin of each obstacle among the surroundings is (m).
    pub fn obstacles(&self) -> Vec<Vector3<f64>> {
        (self.surroundings.as_ref()).map_or(Vec::new(), |around| around.obstacles())
    }

    /// Sums from now on what steps that are pulled back add to the derivatives by obstacles and by the base.
    pub fn begin_surroundings(&mut self) {
        let count = self.obstacles().len();
        self.obstacles.clear();
        self.obstacles.resize(count, ObstacleGradient::default());
        self.base_rotation = Some(Vector3::zeros());
    }

    /// Those sums: of each obstacle, and of the base by what it does to the forces on the robot, not by the poses that it carries along.
    pub fn take_surroundings(&mut self) -> (Vec<ObstacleGradient>, PoseTangent) {
        // Seen from the base, obstacles move the other way, and dead loads turn.
        let mut base = PoseTangent {
            position: Vector3::zeros(),
            rotation: self.base_rotation.take().unwrap_or_default(),
        };
        let from = self.robot().base();
        for (obstacle, origin) in self.obstacles.iter().zip(self.obstacles()) {
            let PoseTangent { position, rotation } = obstacle.pose;
            base.position -= position;
            base.rotation -= rotation + (origin - from).cross(&position);
        }
        (std::mem::take(&mut self.obstacles), base)
    }

    /// Adds the derivatives by a rotation of the base, which turns gravity and other dead loads the other way.
    fn add_base(&mut self, loads: &Loads) {
        let Some(rotation) = &mut self.base_rotation else {
            return;
        };
        let equations = &self.step.equations;
        let chain = &equations.posture.chain;
        // The virtual motions of the discs along the multipliers: what forces on them do work along.
        let (mut turn, mut centre) = (Vector3::zeros(), Vector3::zeros());
        let mut below = equations.robot.base();
        let motions = self.multipliers.iter().enumerate().map(|(k, multiplier)| {
            centre += turn.cross(&(chain.centres[k] - below));
            below = chain.centres[k];
            turn += multiplier;
            [centre + turn.cross(&(chain.positions[k] - below)), turn]
        });
        let discs = self.multipliers.len();
        let dead = (0..discs).map(|disc| equations.forces.dead.wrench(disc, chain));
        *rotation += DeadForces::pull_back_base(dead, &loads.world_moments(discs), motions);
    }

    /// Whether it is of a robot among surroundings.
    pub fn has_surroundings(&self) -> bool {
        self.surroundings.is_some()
    }

    /// The time step (s).
    pub fn timestep(&self) -> f64 {
        self.step.timestep
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.step.equations.robot
    }

    /// Turns the `cotangent` of the state after the step from `before`, which is expanded, into that of `before`, in the
    /// coordinates of [`Linearisation`](super::Linearisation); adds the derivatives by the model to `model`, and returns the
    /// multipliers' part of it by the command alone.
    ///
    /// # Errors
    /// [`DynamicsError::NotDifferentiable`] when a derivative is not a finite number.
    pub fn pull_back(
        &mut self,
        before: &State,
        command: &Command,
        loads: &Loads,
        cotangent: &mut [f64],
        model: &mut ModelTangent,
    ) -> Result<Vec<f64>, DynamicsError> {
        let commands = std::mem::replace(&mut model.command, vec![0.0; command.as_slice().len()]);
        let (turns, rates) = cotangent.split_at_mut(before.velocity.len());
        let mut early = Vec::new();
        if let (Some(around), Some(rubbed)) = (&mut self.surroundings, &mut self.step.rubbed)
            && let Some(rubbing) = &around.stepper().rubbing
        {
            early.resize(turns.len(), 0.0);
            let (ends, command) = ([&mut *turns, &mut early[..]], command.as_slice());
            rubbed.pull_back_end(&self.step.equations, rubbing, command, ends, model);
        }
        self.through_step(&before.velocity, turns, rates);
        turns
            .iter_mut()
            .zip(&early)
            .for_each(|(turn, own)| *turn += own);
        let Self {
            step,
            scratch,
            multipliers,
            ..
        } = self;
        match &self.forms {
            Some(forms) => {
                (step.equations).solve_among(&step.armatures, scratch, forms, multipliers);
            }
            None => self.pushed.solve_transposed(scratch, multipliers),
        }
        self.add_base(loads);
        self.add_loads(loads, turns);
        self.add_inertia(turns, rates);
        if !self.pushes.is_empty() {
            let (pushes, out) = ((&self.step, &self.pushes[..]), [&mut *turns, &mut *rates]);
            let by = (&mut *model, &mut self.obstacles[..]);
            pull_back_pushes(pushes, &before.velocity, &self.multipliers, out, by);
        }
        // By the model: a load's force is minus the potential's gradient.
        let opposite: Vec<_> = self.multipliers.iter().map(|w| -w).collect();
        let step = &mut self.step;
        let expanded = Expanded {
            robot: &step.equations.robot,
            q: &before.configuration,
            posture: &step.equations.posture,
            expansion: &step.expansion,
            dead: &step.dead,
            command: command.as_slice(),
        };
        match &mut step.rubbed {
            None => expanded.pull_back(&opposite, &[], model),
            Some(rubbed) => {
                let piece = |tendon: usize, place: usize| [0.0, rubbed.tensions[tendon][place]];
                expanded.pull_back_pulled(&opposite, piece, model);
                rubbed.pull_back(
                    &expanded,
                    &self.multipliers,
                    [&mut *turns, &mut *rates],
                    model,
                );
            }
        }
        pull_back_inertia(
            &step.equations,
            &step.accelerations,
            step.timestep,
            &self.multipliers,
            model,
        );
        let by_command = std::mem::replace(&mut model.command, commands);
        for (sum, own) in model.command.iter_mut().zip(&by_command) {
            *sum += own;
        }
        let finite = |values: &[f64]| values.iter().all(|x| x.is_finite());
        if finite(turns) && finite(rates) && finite(&by_command) {
            Ok(by_command)
        } else {
            Err(DynamicsError::NotDifferentiable)
        }
    }

    /// Through `q+ = q exp(h v+)` and `v+ = v + h a`; leaves the cotangents of the accelerations, world axes, in `scratch`.
    fn through_step(&mut self, velocity: &[f64], turns: &mut [f64], rates: &mut [f64]) {
        let h = self.step.timestep;
        let joints = turns.as_chunks_mut::<3>().0.iter_mut();
        let joints = joints.zip(rates.as_chunks_mut::<3>().0);
        let motions =
            (velocity.as_chunks::<3>().0.iter()).zip(self.step.accelerations.as_chunks::<3>().0);
        let chain = &self.step.equations.posture.chain;
        let joints = joints.zip(motions).zip(&mut self.scratch);
        for (joint, (((turn, rate), (v, a)), out)) in joints.enumerate() {
            let next = Vector3::from(*v) + Vector3::from(*a) * h;
            let after = Vector3::from(*turn);
            let hinges = self.step.equations.links[joint].hinges.as_deref();
            let (back, jacobian) = step_jacobians(hinges, &(next * h));
            let by_rate = Vector3::from(*rate) + jacobian.tr_mul(&after) * h;
            *turn = back.tr_mul(&after).into();
            *rate = by_rate.into();
            *out = chain.dual(joint) * by_rate * h;
        }
    }

    /// Minus the transposed derivative of the residual moments `g` times the multipliers: their Jacobian by turns, and since
    /// turns do not commute, `1/2 [g]x`.
    fn add_loads(&mut self, loads: &Loads, turns: &mut [f64]) {
        let StepExpansion {
            equations,
            expansion,
            ..
        } = &self.step;
        expansion.product(&self.multipliers, &mut self.scratch);
        add_transposed_product(
            loads,
            &equations.posture,
            &self.multipliers,
            &mut self.scratch,
        );
        expansion.gradient(&mut self.gradient);
        for (joint, turn) in turns.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let chain = &equations.posture.chain;
            let twist = match chain.hinges(joint) {
                None => self.gradient[joint].cross(&self.multipliers[joint]) * 0.5,
                Some(_) => Vector3::zeros(),
            };
            let by_turn = chain.axes(joint).tr_mul(&(twist - self.scratch[joint]));
            *turn = (Vector3::from(*turn) + by_turn).into();
        }
    }

    /// Minus the transposed derivatives of the inverse dynamics, at the step's accelerations, and of damping, times the
    /// multipliers.
    fn add_inertia(&self, turns: &mut [f64], rates: &mut [f64]) {
        let StepExpansion {
            equations,
            composites,
            ..
        } = &self.step;
        // Motions S w along the multipliers: sums over the joints below each joint.
        let chain = &equations.posture.chain;
        let own: Vec<Vector3<f64>> = (self.multipliers.iter().enumerate())
            .map(|(joint, multiplier)| chain.dual(joint).tr_mul(multiplier))
            .collect();
        let mut sum = Vector6::zeros();
        let below: Vec<Vector6<f64>> = (composites.iter())
            .map(|joint| {
                let below = sum;
                sum += joint.axes * own[joint.joint];
                below
            })
            .collect();
        // From the tip down: what a moved joint does to the forces on those above it, I S w and B' S w, and below it; transposed, as
        // [`Moved`](super::composite::Moved) has it. The transpose of `v x` is minus `v x*`.
        let (mut inertia, mut coriolis) = (Vector6::zeros(), Vector6::zeros());
        for (joint, below) in composites.iter().zip(&below).rev() {
            let own = own[joint.joint];
            let along = joint.axes * own;
            inertia += joint.inertia.times(&along);
            coriolis += joint.coriolis.transpose_times(&along);
            let rest = inertia + joint.inertia.times(below);
            let velocity = coriolis + joint.coriolis.transpose_times(below);
            let moved = cross_force(&joint.velocity_below, &rest) - velocity;
            let by_turn = cross_force(&joint.velocity_below, &moved)
                - cross_force(&joint.acceleration_below, &rest)
                - cross_force(below, &joint.force);
            let by_rate = velocity - cross_force(&(joint.velocity_below + joint.velocity), &rest);
            let damping = joint.own(equations.links[joint.joint].damping());
            let by_turn = joint.axes.tr_mul(&by_turn);
            let by_rate = joint.axes.tr_mul(&by_rate) + own.component_mul(&damping);
            for axis in 0..3 {
                turns[3 * joint.joint + axis] -= by_turn[axis];
                rates[3 * joint.joint + axis] -= by_rate[axis];
            }
        }
    }
}
