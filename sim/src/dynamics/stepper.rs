//! Stepping a state through time.

use nalgebra::Vector3;

use super::acceleration::EquationsOfMotion;
use super::drag::Drag;
use super::held::HeldLengths;
use super::hinge_reach::HingeReach;
use super::implicit::ImplicitEuler;
use super::integrator::{Integrator, LARGEST_TURN};
use super::links::Link;
use super::midpoint::ImplicitMidpoint;
use super::rubbing::{MAX_REVISIONS, Rubbing, first_rubbing};
use super::runge_kutta::RungeKutta;
use super::{DynamicsError, Energy, State};
use crate::robot::{Command, Loads, Robot};

/// Moves states of one robot through time, reusing its memory.
#[derive(Clone, Debug)]
pub struct Stepper {
    pub(super) timestep: f64,
    pub(super) equations: EquationsOfMotion,
    /// Per joint, what resists its acceleration besides the discs (kg m²): [`Link::armatures`].
    pub(super) armatures: Vec<Vector3<f64>>,
    /// The same without what is implicit.
    pub(super) bare: Vec<Vector3<f64>>,
    pub(super) scheme: Scheme,
    /// Inextensible tendons whose lengths are commanded; the equations have tensions in their place.
    pub(super) held: Option<Box<HeldLengths>>,
    /// The fluid around the robot.
    pub(super) drag: Option<Box<Drag>>,
    /// Tendons that have friction in their holes.
    pub(super) rubbing: Option<Box<Rubbing>>,
    /// Whether the step that was begun is implicit in the stiffness.
    pub(super) implicit: bool,
    /// Accelerations of the joints' coordinates (rad/s²).
    pub(super) accelerations: Vec<f64>,
    /// The same of the inertias alone, where it is asked for.
    pub(super) inertial: Vec<f64>,
    pub(super) hinges: HingeReach,
    pub(super) fallbacks: usize,
}

/// An integrator and its workspace.
#[derive(Clone, Debug)]
pub(super) enum Scheme {
    SemiImplicitEuler,
    RungeKutta4(Box<RungeKutta>),
    ImplicitEuler(Box<ImplicitEuler>),
    ImplicitMidpoint(Box<ImplicitMidpoint>),
}

impl Scheme {
    fn integrator(&self) -> Integrator {
        match self {
            Self::SemiImplicitEuler => Integrator::SemiImplicitEuler,
            Self::RungeKutta4(_) => Integrator::RungeKutta4,
            Self::ImplicitEuler(_) => Integrator::ImplicitEuler,
            Self::ImplicitMidpoint(_) => Integrator::ImplicitMidpoint,
        }
    }
}

impl Stepper {
    /// A stepper of `robot` by `timestep` (s).
    ///
    /// # Errors
    /// [`DynamicsError`] for a time step that is not positive, a joint without inertia, or an
    /// inextensible tendon whose length is commanded, a fluid or friction of tendons, and an integrator that is not of first order;
    /// for friction besides such a tendon; for friction and a tendon that does not pass all discs on its way.
    pub fn new(
        robot: &Robot,
        timestep: f64,
        integrator: Integrator,
    ) -> Result<Self, DynamicsError> {
        if !(timestep.is_finite() && timestep > 0.0) {
            return Err(DynamicsError::Timestep(timestep));
        }
        let (held, drag) = match integrator {
            Integrator::SemiImplicitEuler | Integrator::ImplicitEuler => {
                (HeldLengths::new(robot), Drag::new(robot))
            }
            _ if robot.spec().fluid.is_some() => return Err(DynamicsError::InFluid),
            _ => (None, None),
        };
        let first_order = matches!(
            integrator,
            Integrator::SemiImplicitEuler | Integrator::ImplicitEuler
        );
        let rubbing = match first_rubbing(robot) {
            Some(tendon) if !first_order || held.is_some() => {
                return Err(DynamicsError::TendonFriction { tendon });
            }
            _ => Rubbing::new(robot)?,
        };
        let by_tension = held
            .as_ref()
            .map(|held| HeldLengths::by_tension(&held.robot));
        let robot = by_tension.as_ref().unwrap_or(robot);
        let (scheme, implicit) = match integrator {
            Integrator::SemiImplicitEuler => (Scheme::SemiImplicitEuler, timestep),
            Integrator::RungeKutta4 => (Scheme::RungeKutta4(RungeKutta::new(robot)), 0.0),
            Integrator::ImplicitEuler => {
                (Scheme::ImplicitEuler(ImplicitEuler::new(robot)), timestep)
            }
            Integrator::ImplicitMidpoint => {
                let scheme = ImplicitMidpoint::new(robot);
                (Scheme::ImplicitMidpoint(scheme), 0.5 * timestep)
            }
        };
        let armatures = Link::armatures(robot, implicit);
        let equations = EquationsOfMotion::new(robot, &armatures)?;
        Ok(Self {
            timestep,
            equations,
            armatures,
            bare: Link::armatures(robot, 0.0),
            scheme,
            held,
            drag,
            rubbing,
            implicit: false,
            accelerations: vec![0.0; robot.dof()],
            inertial: vec![0.0; robot.dof()],
            hinges: HingeReach::new(robot),
            fallbacks: 0,
        })
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        match &self.held {
            Some(held) => &held.robot,
            None => &self.equations.robot,
        }
    }

    /// The time step (s).
    pub fn timestep(&self) -> f64 {
        self.timestep
    }

    /// How a step is taken.
    pub fn integrator(&self) -> Integrator {
        self.scheme.integrator()
    }

    /// Number of steps, since this stepper was made, that were not taken as the [`Integrator`] says: of
    /// [`Integrator::ImplicitEuler`] those where its matrix is not positive definite, of [`Integrator::ImplicitMidpoint`]
    /// those taken in halves; with friction of tendons, those where it was not found what all holes do. The others always are.
    pub fn fallbacks(&self) -> usize {
        self.fallbacks
    }

    /// Moves `state` by one time step under `command` and `loads`, both constant meanwhile. Takes
    /// O(n) time and allocates nothing, but for [`Integrator::ImplicitEuler`], commanded lengths of inextensible tendons, and friction of
    /// tendons in their holes. The command is what acts on the tendons: [`Servos`](super::Servos) follow one that is given.
    ///
    /// # Errors
    /// [`DynamicsError`] when state, command or loads are not of this robot, or an implicit step has no solution that can be
    /// found (the state is left as it was), or the motion diverged: a joint turns by more than [`LARGEST_TURN`] in the step, or a
    /// hinge beyond what it has angles for.
    pub fn step(
        &mut self,
        state: &mut State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        if self.held.is_some() || self.drag.is_some() || self.rubbing.is_some() {
            self.begin(state, command, loads)?;
            for _ in 0..MAX_REVISIONS {
                if !self.rub_again(state, loads, &[]) {
                    return self.finish(state, command, &[]);
                }
            }
            self.fallbacks += 1;
            return self.finish(state, command, &[]);
        }
        self.equations.accept(state, command, loads)?;
        let (h, command) = (self.timestep, command.as_slice());
        self.hinges.remember(state);
        let equations = &mut self.equations;
        match &mut self.scheme {
            Scheme::SemiImplicitEuler => {
                let (q, v) = (&state.configuration, &state.velocity);
                equations.accelerate(q, v, command, &self.armatures, &mut self.accelerations);
                advance(&equations.robot, state, &self.accelerations, h);
            }
            Scheme::RungeKutta4(scheme) => {
                scheme.step(equations, state, command, &self.armatures, h);
            }
            Scheme::ImplicitEuler(scheme) => {
                let (q, v) = (&state.configuration, &state.velocity);
                let accelerations = &mut self.accelerations;
                if !scheme.accelerate(equations, loads, state, command, h, accelerations) {
                    self.fallbacks += 1;
                    equations.accelerate(q, v, command, &self.armatures, accelerations);
                }
                advance(&equations.robot, state, accelerations, h);
            }
            Scheme::ImplicitMidpoint(scheme) => {
                let halved = scheme.step(equations, loads, state, command, h)?;
                self.fallbacks += usize::from(halved);
            }
        }
        // A step that turns a joint too far does not resolve the motion.
        let rates = largest_turn(&state.velocity, h);
        let turn = match &self.scheme {
            // Its turns are of rates at all stages.
            Scheme::RungeKutta4(scheme) if rates.1 <= LARGEST_TURN => {
                largest_turn(scheme.turns(), 1.0)
            }
            _ => rates,
        };
        self.check_turn(turn, state)
    }

    /// Refuses the `state` after a step in which the joint that turned most turned so far (rad).
    pub(super) fn check_turn(
        &self,
        turn: (usize, f64),
        state: &State,
    ) -> Result<(), DynamicsError> {
        match turn {
            (_, turn) if turn <= LARGEST_TURN => self.hinges.check(state),
            (joint, turn) => Err(DynamicsError::Diverged {
                joint,
                turn,
                timestep: self.timestep,
                integrator: self.integrator(),
            }),
        }
    }

    /// Energy of `state` under `command` and `loads`; inextensible tendons whose lengths are commanded have none. That
    /// of contacts that deflect in the tendons' holes is not in it: half their stiffness times the squares of
    /// [`tendon_profiles`](Self::tendon_profiles)' deflections.
    ///
    /// # Errors
    /// [`DynamicsError`] when they are not of this robot.
    pub fn energy(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<Energy, DynamicsError> {
        self.equations.accept(state, command, loads)?;
        let command = match &mut self.held {
            Some(held) => held.without_tensions(command),
            None => command,
        };
        Ok(self.equations.energy(state, command.as_slice()))
    }
}

/// The joint that turns most at these `rates` in `h`, and by how much (rad); not a number before any
/// other.
pub(super) fn largest_turn(rates: &[f64], h: f64) -> (usize, f64) {
    let rates = rates.as_chunks::<3>().0.iter();
    let turns = rates
        .map(|rate| Vector3::from(*rate).norm() * h)
        .enumerate();
    turns.fold((0, 0.0), |most, next| match next.1 <= most.1 {
        true => most,
        false if most.1.is_nan() => most,
        false => next,
    })
}

/// `v+ = v + h a`, then `q+ = q exp(h v+)`, or of hinges the angles `t+ = t + h v+`.
pub(super) fn advance(robot: &Robot, state: &mut State, accelerations: &[f64], h: f64) {
    let joints = state
        .configuration
        .0
        .iter_mut()
        .zip(state.velocity.as_chunks_mut::<3>().0);
    let joints = joints.zip(accelerations.as_chunks::<3>().0);
    for (((q, velocity), acceleration), disc) in joints.zip(robot.discs()) {
        let next = Vector3::from(*velocity) + Vector3::from(*acceleration) * h;
        *velocity = next.into();
        *q = disc.moved(q, &(next * h));
    }
}
