//! Derivatives of an equilibrium by anything that it depends on.
//!
//! At an equilibrium the gradient `g(q, p)` of the potential vanishes, so `dq/dp = -H⁻¹ dg/dp` with the Hessian `H`
//! (implicit function theorem; Griewank and Walther, Evaluating Derivatives, 2008, ch. 15). The factor of `H` takes O(n)
//! to build and to solve with, so a Jacobian by the command costs less than settling, and a vector-Jacobian product by
//! any number of parameters one solve.
//!
//! ```
//! use tdcr_sim::robot::{Loads, Parameter, Robot};
//!
//! let robot = Robot::load("2m")?;
//! let (command, loads) = (robot.mean_command(), Loads::payload(0.02)?);
//! let settled = robot.settle(&command, &loads);
//! let sensitivity = robot.sensitivity(&command, &loads, &settled)?;
//! let jacobian = sensitivity.jacobian(&[Parameter::Command(0), Parameter::Payload])?;
//! // Six rows a disc: how far the tip (disc 9) sinks per kg.
//! assert!(jacobian[(6 * 9 + 2, 1)] < 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Where a tendon is just about to go slack, or a joint just touches its limit, derivatives differ
//! from one side to the other; those of the side where the equilibrium lies are given. Friction of
//! tendons is left out.

mod changed;
mod pressed;
mod tangent;
mod tendons;
mod tool;

use faer::Mat;
use faer::linalg::solvers::{PartialPivLu, Solve};
use nalgebra::{DMatrix, Matrix3, Vector3};
use thiserror::Error;

use crate::energy::{DeadForces, Expansion, Potential, Pressing, following};
use crate::factor::{ChainMatrix, Curvature, Factor, LoadedFactor, LoadedMatrix, PairedLu, Side};
use crate::model_tangent::{Expanded, ModelTangent, pull_back_centres};
pub use crate::pose::PoseTangent;
use crate::pose::levers;
use crate::robot::{Command, Drive, Loads, Parameter, ParameterError, Robot, joints_along};
use crate::statics::{Equilibrium, Stability};
use crate::tendon::{LENGTH_PENALTY, Posture};
pub(crate) use changed::{Changed, DiscPoint};
pub(crate) use pressed::{OnRod, PressedPoint};
pub use tendons::TendonJacobians;

/// Why an equilibrium has no such derivative.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SensitivityError {
    /// Not settled: there is no equilibrium to differentiate.
    #[error(
        "the robot has not settled: residual {0:e} N m; expected an equilibrium to differentiate"
    )]
    NotSettled(f64),
    /// The equilibrium is on the brink of instability, where derivatives are infinite.
    #[error(
        "the equilibrium has no derivatives: its Hessian is not positive definite; expected a stable one"
    )]
    Unstable,
    /// A contact slides: the force of friction follows the normal force, which has no potential.
    #[error(
        "the contact of disc {disc} with obstacle {obstacle} slips; expected contacts without friction, or that stick, to differentiate"
    )]
    Slipping {
        /// The disc, from 0.
        disc: usize,
        /// The obstacle, by its number in the scene.
        obstacle: usize,
    },
    /// Discs that touch have friction: they roll on each other, and forces that follow that have no potential.
    #[error(
        "the contact of disc {disc} with disc {other} has friction, of which there are no derivatives; expected contacts between discs \
         without it to differentiate"
    )]
    SelfFriction {
        /// The disc, from 0.
        disc: usize,
        /// The disc that it touches, from 0.
        other: usize,
    },
    /// The robot has no such parameter.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
}

/// The factorised system of an equilibrium, with which it is differentiated: [`Robot::sensitivity`].
#[derive(Clone, Debug)]
pub struct Sensitivity {
    robot: Robot,
    loads: Loads,
    q: crate::chain::Configuration,
    posture: Posture,
    expansion: Expansion,
    dead: DeadForces,
    /// The command, or where a length is commanded the rest length that gives the tension.
    command: Vec<f64>,
    system: System,
    /// Contacts of beads that move along their discs as rods grow.
    on_rods: Vec<OnRod>,
    /// Tendons whose length is commanded and which are taut.
    held: LengthConstraints,
}

/// The linear system of the equilibrium.
#[derive(Clone, Debug)]
enum System {
    /// With a potential.
    Chain(Box<Factor>),
    /// With moments or following forces.
    Loaded(Box<LoadedFactor>),
    /// With contacts.
    Touching(Box<PairedLu>, Pressing),
}

/// Constraints that tendons keep their commanded lengths.
#[derive(Clone, Debug)]
struct LengthConstraints {
    tendons: Vec<usize>,
    /// Gradients of their lengths, by joint.
    slopes: Vec<Vec<Vector3<f64>>>,
    /// `J⁻¹` of these, and `J⁻ᵀ`.
    responses: [Vec<Vec<Vector3<f64>>>; 2],
    /// Slopes times responses.
    compliance: Option<[PartialPivLu<f64>; 2]>,
}

impl Robot {
    /// Prepares to differentiate the equilibrium of `command` and `loads`.
    ///
    /// # Errors
    /// [`SensitivityError`] if the robot has not settled there, or not stably.
    pub fn sensitivity(
        &self,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
    ) -> Result<Sensitivity, SensitivityError> {
        let mut sensitivity = Sensitivity::expand(self, command, loads, equilibrium, None)?;
        sensitivity.factorise()?;
        sensitivity.hold_lengths();
        Ok(sensitivity)
    }
}

impl Sensitivity {
    /// The same where the robot is pressed by contacts.
    pub(crate) fn pressed(
        robot: &Robot,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
        (pressing, on_rods): (&Pressing, Vec<OnRod>),
    ) -> Result<Self, SensitivityError> {
        let mut sensitivity = Self::expand(robot, command, loads, equilibrium, Some(pressing))?;
        // Loads without a potential are those of robots that nothing presses.
        if loads.wrenches().iter().any(following::follows) {
            sensitivity.factorise()?;
            sensitivity.hold_lengths();
            return Ok(sensitivity);
        }
        let mut lu = PairedLu::new(&sensitivity.expansion);
        let matrix = ChainMatrix {
            expansion: &sensitivity.expansion,
            scale: 1.0,
            centres: &sensitivity.posture.chain.centres,
            joints: &vec![Matrix3::zeros(); robot.discs().len()],
            bodies: &pressing.forms,
        };
        if lu.factorise(&matrix, &pressing.pairs) != Some(Curvature::Positive) {
            return Err(SensitivityError::Unstable);
        }
        sensitivity.system = System::Touching(Box::new(lu), pressing.clone());
        sensitivity.on_rods = on_rods;
        sensitivity.hold_lengths();
        Ok(sensitivity)
    }

    fn expand(
        robot: &Robot,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
        pressing: Option<&Pressing>,
    ) -> Result<Self, SensitivityError> {
        if !equilibrium.converged {
            if let Some(Stability::Unstable | Stability::Flutter) = equilibrium.stability {
                return Err(SensitivityError::Unstable);
            }
            return Err(SensitivityError::NotSettled(equilibrium.residual));
        }
        let mut posture = Posture::new(robot);
        posture.place(robot, &equilibrium.configuration);
        let mut dead = DeadForces::new(robot);
        dead.set(robot, loads);
        following::add_forces(loads, 1.0, &posture, &mut dead);
        if let Some(pressing) = pressing {
            pressing.add_to(&mut dead);
        }
        // A commanded length is the spring that gives its tension.
        let mut effective = command.as_slice().to_vec();
        for (t, tendon) in robot.tendons().iter().enumerate() {
            if tendon.holds_length() {
                effective[t] = posture.lengths[t] - equilibrium.tendon_tensions[t] / LENGTH_PENALTY;
            }
        }
        let mut expansion = Expansion::new(robot);
        let potential = Potential {
            robot,
            command: &effective,
            dead: &dead,
        };
        potential.expand(&equilibrium.configuration, &posture, &mut expansion);
        following::add_moments(loads, 1.0, &posture, &mut expansion);
        Ok(Self {
            robot: robot.clone(),
            loads: loads.clone(),
            q: equilibrium.configuration.clone(),
            system: System::Chain(Box::new(Factor::new(&expansion))),
            on_rods: Vec::new(),
            held: LengthConstraints {
                tendons: Vec::new(),
                slopes: Vec::new(),
                responses: [Vec::new(), Vec::new()],
                compliance: None,
            },
            posture,
            expansion,
            dead,
            command: effective,
        })
    }

    fn factorise(&mut self) -> Result<(), SensitivityError> {
        if self.loads.wrenches().iter().any(following::follows) {
            let factor = LoadedFactor::new(&LoadedMatrix {
                loads: &self.loads,
                share: 1.0,
                posture: &self.posture,
                expansion: &self.expansion,
            });
            self.system = System::Loaded(Box::new(factor));
            return Ok(());
        }
        let mut factor = Factor::new(&self.expansion);
        if factor.factorise(&self.expansion, 0.0) == Curvature::Modified {
            return Err(SensitivityError::Unstable);
        }
        self.system = System::Chain(Box::new(factor));
        Ok(())
    }

    fn hold_lengths(&mut self) {
        let taut =
            |t: &usize| self.robot.tendons()[*t].holds_length() && self.expansion.weights[*t] > 0.0;
        let tendons: Vec<usize> = (0..self.robot.tendons().len()).filter(taut).collect();
        if tendons.is_empty() {
            return;
        }
        // Gradients A of the held lengths, J⁻¹ A, and A' J⁻¹ A, of which the multipliers follow (Schur complement).
        let columns = self.expansion.dense_columns();
        let slopes: Vec<_> = tendons.iter().map(|&t| columns[t].1.clone()).collect();
        let none = vec![Vector3::zeros(); self.robot.discs().len()];
        let responses = [Side::Matrix, Side::Transpose].map(|side| {
            let solve = |slope: &Vec<Vector3<f64>>| self.solve_free(slope, &none, side);
            slopes.iter().map(solve).collect::<Vec<_>>()
        });
        let compliance = |responses: &Vec<Vec<Vector3<f64>>>| {
            let entry = |i: usize, j: usize| dot(&slopes[i], &responses[j]);
            Mat::from_fn(tendons.len(), tendons.len(), entry).partial_piv_lu()
        };
        self.held = LengthConstraints {
            compliance: Some([compliance(&responses[0]), compliance(&responses[1])]),
            tendons,
            slopes,
            responses,
        };
    }

    /// Solves with the Jacobian (or its transpose), lengths free.
    fn solve_free(
        &self,
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        side: Side,
    ) -> Vec<Vector3<f64>> {
        let mut solution = vec![Vector3::zeros(); joint.len()];
        match &self.system {
            System::Chain(factor) => factor.solve(joint, disc, &mut solution),
            System::Loaded(factor) => factor.solve(joint, disc, side, &mut solution),
            System::Touching(factor, pressing) => {
                self.solve_pressed((factor, pressing), joint, disc, &mut solution);
            }
        }
        solution
    }

    /// Solves with the Jacobian, the held tendons' lengths growing by `growth`; also returns the
    /// multipliers of those constraints: the KKT system by its Schur complement (Nocedal and Wright, Numerical
    /// Optimization, ch. 16.2).
    fn solve(
        &self,
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        growth: &[f64],
        side: Side,
    ) -> (Vec<Vector3<f64>>, Vec<f64>) {
        let mut solution = self.solve_free(joint, disc, side);
        let Some(compliance) = &self.held.compliance else {
            return (solution, Vec::new());
        };
        // Multipliers of the constraints, and the solution that keeps them.
        let excess = |i: usize| dot(&self.held.slopes[i], &solution) - growth[i];
        let excess = Mat::from_fn(growth.len(), 1, |i, _| excess(i));
        let multipliers = compliance[side as usize].solve(&excess);
        for (i, response) in self.held.responses[side as usize].iter().enumerate() {
            for (turn, response) in solution.iter_mut().zip(response) {
                *turn -= response * multipliers[(i, 0)];
            }
        }
        let multipliers = (0..growth.len()).map(|i| multipliers[(i, 0)]).collect();
        (solution, multipliers)
    }

    /// Jacobian of all disc poses by `parameters`: `6 n` rows, for each disc its origin (m, world
    /// frame) and its rotation (rad, a rotation vector in the world frame); one column per parameter.
    ///
    /// # Errors
    /// [`SensitivityError::Parameter`] for one that the robot does not have, and for two that overlap
    /// ([`RobotSpec::check_parameters`](crate::robot::RobotSpec::check_parameters)).
    pub fn jacobian(&self, parameters: &[Parameter]) -> Result<DMatrix<f64>, SensitivityError> {
        self.robot.spec().check_parameters(parameters)?;
        let mut jacobian = DMatrix::zeros(6 * self.robot.discs().len(), parameters.len());
        for (column, &parameter) in parameters.iter().enumerate() {
            let tangent = ModelTangent::new(&self.robot, &self.loads, parameter)?;
            for (disc, pose) in self.poses(&tangent).iter().enumerate() {
                for axis in 0..3 {
                    jacobian[(6 * disc + axis, column)] = pose.position[axis];
                    jacobian[(6 * disc + 3 + axis, column)] = pose.rotation[axis];
                }
            }
        }
        Ok(jacobian)
    }

    /// The Jacobian by the command, one column per tendon: rows as in [`Sensitivity::jacobian`].
    pub fn command_jacobian(&self) -> DMatrix<f64> {
        let n = self.robot.discs().len();
        let mut jacobian = DMatrix::zeros(6 * n, self.robot.tendons().len());
        let mut pull = vec![Vector3::zeros(); n];
        let none = vec![Vector3::zeros(); n];
        let mut turns = vec![Vector3::zeros(); n];
        for tendon in 0..self.robot.tendons().len() {
            self.pull_by_command(tendon, &mut pull);
            match (&self.system, &self.held.compliance) {
                (System::Chain(factor), None) => factor.solve(&pull, &none, &mut turns),
                _ => {
                    turns = self
                        .solve(&pull, &none, &self.growth_by_command(tendon), Side::Matrix)
                        .0
                }
            }
            self.write_poses(&turns, jacobian.column_mut(tendon).as_mut_slice());
        }
        jacobian
    }

    /// Change of the gradient by a tendon's command: its length's gradient times the change of its
    /// tension. The rest length that stands for a commanded length is an unknown of the solve.
    fn pull_by_command(&self, tendon: usize, pull: &mut [Vector3<f64>]) {
        let columns = &self.expansion.columns;
        let change = match self.robot.tendons()[tendon].drive {
            Drive::Tension => 1.0,
            _ if self.robot.tendons()[tendon].holds_length() => 0.0,
            _ => -self.expansion.weights[tendon],
        };
        pull.fill(Vector3::zeros());
        for joint in joints_along(&self.robot.tendons()[tendon].route) {
            let slope = self.expansion.slopes[joint * columns.slots + columns.slot[tendon]];
            pull[joint] = slope * change;
        }
    }

    fn growth_by_command(&self, tendon: usize) -> Vec<f64> {
        let grows = |&held: &usize| if held == tendon { -1.0 } else { 0.0 };
        self.held.tendons.iter().map(grows).collect()
    }

    /// Writes the change of the discs' poses when the joints turn by `-turns`, six numbers a disc.
    fn write_poses(&self, turns: &[Vector3<f64>], rows: &mut [f64]) {
        let chain = &self.posture.chain;
        let (mut rotation, mut centre) = (Vector3::zeros(), Vector3::zeros());
        let mut below = self.robot.base();
        for (i, row) in rows.chunks_exact_mut(6).enumerate() {
            centre += rotation.cross(&(chain.centres[i] - below));
            below = chain.centres[i];
            rotation -= turns[i];
            let position = centre + rotation.cross(&(chain.positions[i] - below));
            row[..3].copy_from_slice(position.as_slice());
            row[3..].copy_from_slice(rotation.as_slice());
        }
    }

    /// Change of all disc poses when the parameters change together at the given rates.
    ///
    /// # Errors
    /// [`SensitivityError::Parameter`] for one that the robot does not have, and for two that overlap
    /// ([`RobotSpec::check_parameters`](crate::robot::RobotSpec::check_parameters)).
    pub fn jvp(
        &self,
        direction: &[(Parameter, f64)],
    ) -> Result<Vec<PoseTangent>, SensitivityError> {
        let parameters: Vec<Parameter> =
            direction.iter().map(|(parameter, _)| *parameter).collect();
        self.robot.spec().check_parameters(&parameters)?;
        let mut total = vec![PoseTangent::default(); self.robot.discs().len()];
        for &(parameter, rate) in direction {
            let tangent = ModelTangent::new(&self.robot, &self.loads, parameter)?;
            for (total, pose) in total.iter_mut().zip(self.poses(&tangent)) {
                total.position += pose.position * rate;
                total.rotation += pose.rotation * rate;
            }
        }
        Ok(total)
    }

    /// Change of a cost by each of the parameters, given its change by each disc's pose: one solve,
    /// whatever the number of parameters.
    ///
    /// # Errors
    /// [`SensitivityError::Parameter`] for one that the robot does not have, and for two that overlap
    /// ([`RobotSpec::check_parameters`](crate::robot::RobotSpec::check_parameters)).
    ///
    /// # Panics
    /// If there is not one cotangent for each disc.
    pub fn vjp(
        &self,
        cotangents: &[PoseTangent],
        parameters: &[Parameter],
    ) -> Result<Vec<f64>, SensitivityError> {
        let n = self.robot.discs().len();
        assert_eq!(cotangents.len(), n, "one cotangent for each disc");
        self.robot.spec().check_parameters(parameters)?;
        let none = vec![Vector3::zeros(); n];
        let levers = levers(&self.posture.chain, cotangents);
        let growth = vec![0.0; self.held.tendons.len()];
        let (adjoint, multipliers) = self.solve(&none, &levers, &growth, Side::Transpose);
        // The cost's derivatives by the model: what it does to the balance of moments, to the lengths that are held, and
        // to the poses where no joint turns.
        let turns: Vec<_> = adjoint.iter().map(|turn| -turn).collect();
        let held: Vec<_> = (self.held.tendons.iter().copied())
            .zip(multipliers.iter().map(|multiplier| -multiplier))
            .collect();
        let mut model = ModelTangent::zero(&self.robot);
        self.expanded().pull_back(&turns, &held, &mut model);
        let mut centres: Vec<_> = cotangents.iter().map(|pose| pose.position).collect();
        self.press_back(&turns, &mut centres, &mut model);
        pull_back_centres(&self.posture.chain, &centres, &mut model);
        for (tendon, weight) in held {
            model.command[tendon] -= weight;
        }
        let cost = |&parameter: &Parameter| Ok(model.by(&self.robot, &self.loads, parameter)?);
        parameters.iter().map(cost).collect()
    }

    /// The potential at the equilibrium, as its derivatives by the model take it.
    fn expanded(&self) -> Expanded<'_> {
        Expanded {
            robot: &self.robot,
            q: &self.q,
            posture: &self.posture,
            expansion: &self.expansion,
            dead: &self.dead,
            command: &self.command,
        }
    }

    /// Change of all disc poses for a change of the model.
    fn poses(&self, tangent: &ModelTangent) -> Vec<PoseTangent> {
        let mut change = self.expanded().gradient_tangent(tangent);
        self.press(tangent, &mut change.disc);
        let growth: Vec<f64> = (self.held.tendons.iter())
            .map(|&t| change.lengths[t] - tangent.command[t])
            .collect();
        let (turns, _) = self.solve(&change.joint, &change.disc, &growth, Side::Matrix);
        // That solved for the turns that balance the change; the robot makes the opposite ones.
        self.move_discs(tangent, &turns)
    }
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
