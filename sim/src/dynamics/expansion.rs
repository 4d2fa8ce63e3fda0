//! A step and what its derivatives are made of.

use nalgebra::Vector3;

use super::acceleration::EquationsOfMotion;
use super::composite::{Composite, compose};
use super::links::Link;
use super::rubbing::{RubbedStep, Rubbing};
use super::{DynamicsError, State};
use crate::energy::following::{add_forces, add_moments};
use crate::energy::{DeadForces, Expansion, Potential};
use crate::robot::{Command, Loads, Robot};

/// A [`SemiImplicitEuler`](super::Integrator) step of one robot, `(M + h D) a = tau - D v - bias`, with what is needed to
/// differentiate it; reuses most of its memory.
#[derive(Clone, Debug)]
pub(super) struct StepExpansion {
    pub timestep: f64,
    pub equations: EquationsOfMotion,
    /// Armatures with the implicit damping `h D` (kg m²): it acts on the change of the rates, as an armature would.
    pub armatures: Vec<Vector3<f64>>,
    /// The accelerations `a` of the step, by the joints' coordinates (rad/s²).
    pub accelerations: Vec<f64>,
    /// Composite bodies at these accelerations.
    pub composites: Vec<Composite>,
    /// Dead forces, and the following ones as they are in this posture.
    pub dead: DeadForces,
    /// The potential's derivatives, following loads in its gradient; where tendons have friction, without what changes of their tensions add.
    pub expansion: Expansion,
    /// Tendons that have friction in their holes.
    pub rubbed: Option<Box<RubbedStep>>,
}

impl StepExpansion {
    /// Of steps by `timestep` (s).
    pub fn new(robot: &Robot, timestep: f64) -> Result<Self, DynamicsError> {
        if !(timestep.is_finite() && timestep > 0.0) {
            return Err(DynamicsError::Timestep(timestep));
        }
        let armatures = Link::armatures(robot, timestep);
        Ok(Self {
            timestep,
            equations: EquationsOfMotion::new(robot, &armatures)?,
            armatures,
            accelerations: vec![0.0; robot.dof()],
            composites: Vec::with_capacity(robot.discs().len()),
            dead: DeadForces::new(robot),
            expansion: Expansion::new(robot),
            rubbed: None,
        })
    }

    /// Takes the step from `state` and expands it, if state, command and loads are of this robot. O(n) time.
    pub fn expand(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        self.equations.accept(state, command, loads)?;
        let (q, v) = (&state.configuration, &state.velocity);
        let (armatures, accelerations) = (&self.armatures, &mut self.accelerations);
        (self.equations).accelerate(q, v, command.as_slice(), armatures, accelerations);
        self.compose(state, command, loads);
        Ok(())
    }

    /// The same of a step with these accelerations, which are of more than the robot alone, and with its tendons in their holes.
    pub fn expand_at(
        &mut self,
        (state, command): (&State, &Command),
        loads: &Loads,
        accelerations: &[f64],
        rubbing: Option<&Rubbing>,
    ) -> Result<(), DynamicsError> {
        self.equations.accept(state, command, loads)?;
        let (q, v) = (&state.configuration, &state.velocity);
        self.equations.enter(q, v, command.as_slice());
        self.accelerations.copy_from_slice(accelerations);
        if let (Some(rubbed), Some(rubbing)) = (&mut self.rubbed, rubbing) {
            rubbed.take(&self.equations, rubbing, command.as_slice(), accelerations);
        }
        self.compose(state, command, loads);
        Ok(())
    }

    fn compose(&mut self, state: &State, command: &Command, loads: &Loads) {
        let (accelerations, composites) = (&self.accelerations, &mut self.composites);
        compose(&self.equations, &state.velocity, accelerations, composites);
        // The potential, following loads as the dead forces that they are here.
        let posture = &self.equations.posture;
        self.dead = self.equations.forces.dead.clone();
        add_forces(loads, 1.0, posture, &mut self.dead);
        let potential = Potential {
            robot: &self.equations.robot,
            command: command.as_slice(),
            dead: &self.dead,
        };
        let (q, expansion) = (&state.configuration, &mut self.expansion);
        match &self.rubbed {
            None => potential.expand(q, posture, expansion),
            Some(rubbed) => {
                let tension = |tendon: usize, place: usize| rubbed.tensions[tendon][place];
                potential.expand_pulled(q, posture, tension, expansion);
            }
        }
        add_moments(loads, 1.0, posture, &mut self.expansion);
    }
}
