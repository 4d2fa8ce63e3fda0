//! The blocks of the matrix of implicit steps, `M + d D + k K`: what each joint and each disc adds.

use nalgebra::{Matrix3, Matrix6, Vector3};

use super::acceleration::EquationsOfMotion;
use super::reaction::Reaction;
use crate::chain::Configuration;
use crate::energy::following::{add_bodies, add_forces, add_moments, add_product, follows};
use crate::energy::{DeadForces, Expansion, Potential};
use crate::robot::{Loads, Robot};

/// What mass, damping and stiffness matrix are multiplied by in a sum, and what is added to every joint besides.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weights {
    pub mass: f64,
    pub damping: f64,
    pub stiffness: f64,
    pub joints: f64,
    pub part: Part,
}

/// Which part of the stiffness matrix is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Whole,
    Symmetric,
}

impl Weights {
    /// `M + d D + k K`.
    pub fn of_step(damping: f64, stiffness: f64) -> Self {
        Self {
            mass: 1.0,
            damping,
            stiffness,
            joints: 0.0,
            part: Part::Whole,
        }
    }
}

/// Mass matrix with armatures, damping, and the Jacobian of the residual moments under all loads, in the posture that equations of
/// motion are in; world axes.
#[derive(Clone, Debug)]
pub(super) struct StepBlocks {
    pub expansion: Expansion,
    /// Dead forces, and the following ones as they are in this posture.
    dead: DeadForces,
    pub joints: Vec<Matrix3<f64>>,
    pub bodies: Vec<Matrix6<f64>>,
}

impl StepBlocks {
    pub fn new(robot: &Robot) -> Self {
        let n = robot.discs().len();
        Self {
            expansion: Expansion::new(robot),
            dead: DeadForces::new(robot),
            joints: vec![Matrix3::zeros(); n],
            bodies: vec![Matrix6::zeros(); n],
        }
    }

    /// Expands `K` at `q`, where `equations` are: the potential's derivatives, following loads as the dead forces that they are
    /// here.
    pub fn expand(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        q: &Configuration,
        command: &[f64],
    ) {
        self.expand_by(equations, loads, command, |potential, out| {
            potential.expand(q, &equations.posture, out);
        });
    }

    /// The same where the tension (N) of each segment of each tendon is given, without what changes of tensions add.
    pub fn expand_pulled(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        q: &Configuration,
        tension: impl Fn(usize, usize) -> f64,
    ) {
        self.expand_by(equations, loads, &[], |potential, out| {
            potential.expand_pulled(q, &equations.posture, tension, out);
        });
    }

    fn expand_by(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        command: &[f64],
        expand: impl FnOnce(&Potential, &mut Expansion),
    ) {
        let posture = &equations.posture;
        let mut dead = &equations.forces.dead;
        if loads.wrenches().iter().any(follows) {
            self.dead.clone_from(dead);
            add_forces(loads, 1.0, posture, &mut self.dead);
            dead = &self.dead;
        }
        let potential = Potential {
            robot: &equations.robot,
            command,
            dead,
        };
        expand(&potential, &mut self.expansion);
        add_moments(loads, 1.0, posture, &mut self.expansion);
    }

    /// Sets the blocks of a sum but for those of the expansion, with the forms of what the surroundings do to each disc; an empty list is
    /// nothing.
    pub fn set(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        weights: Weights,
        reactions: &[Reaction],
    ) {
        let posture = &equations.posture;
        // M and D: each disc's inertia about its joint's centre, and what resists the joint.
        let places = equations.links.iter().zip(equations.orientations());
        let blocks = self.bodies.iter_mut().zip(&mut self.joints);
        for (index, ((body, joint), (link, orientation))) in blocks.zip(places).enumerate() {
            *body = link.body(orientation).spatial() * weights.mass;
            let axes = posture.chain.hinges(index);
            let damping = link.damping_matrix(orientation, axes) * weights.damping;
            *joint = damping
                + match axes {
                    None => Matrix3::identity() * (link.armature * weights.mass + weights.joints),
                    Some(_) => {
                        link.armature_matrix(axes) * weights.mass
                            + Matrix3::identity() * weights.joints
                    }
                };
        }
        if let Some((tip, orientation)) =
            (self.bodies.last_mut()).zip(equations.orientations().last())
        {
            *tip += equations.payload.body(orientation).spatial() * weights.mass;
        }
        add_bodies(loads, weights.stiffness, posture, &mut self.bodies);
        for (body, reaction) in self.bodies.iter_mut().zip(reactions) {
            *body += reaction.spatial();
        }
        if weights.part == Part::Symmetric {
            for body in &mut self.bodies {
                *body = (*body + body.transpose()) * 0.5;
            }
        }
    }

    /// Writes `K turns`, as it was last expanded.
    pub fn stiffness_product(
        &self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        turns: &[Vector3<f64>],
        out: &mut [Vector3<f64>],
    ) {
        self.expansion.product(turns, out);
        add_product(loads, 1.0, &equations.posture, turns, out);
    }
}
