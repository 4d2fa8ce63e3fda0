//! From command to equilibrium: Newton's method on the potential energy over SO(3)^n.
//!
//! Every solve starts from the straight pose and descends: a Newton step where the Hessian is
//! positive definite, otherwise a step with the eigenvalues' absolute values; steps are limited in
//! angle and halved until the energy falls. A solve that stalls is repeated by continuation: the
//! command is led from the module-wise mean, under which the robot stands straight, to its goal.
//! So the reported equilibrium is a function of the command alone; where a command has several,
//! it is the one that this descent from the straight pose finds.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::{Mat, Par, Side, Spec};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::chain::{Chain, Configuration};
use crate::energy::{Derivatives, Potential};
use crate::robot::{Command, Loads, Robot};

/// Largest gradient component (N m) at which a configuration counts as settled.
pub const TOLERANCE: f64 = 1e-10;
/// Newton steps before a solve counts as stalled.
const MAX_ITERATIONS: usize = 100;
/// Largest turn of a joint in one step (rad).
const MAX_TURN: f64 = 0.5;
/// Halvings of a step before it counts as failed.
const MAX_HALVINGS: usize = 30;
/// Smallest part of the way that continuation goes in one solve.
const MIN_CONTINUATION_STEP: f64 = 1e-4;

/// Where a robot comes to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Equilibrium {
    /// Rotation of each disc relative to the body below.
    pub configuration: Configuration,
    /// Origin of each disc, world frame (m).
    pub positions: Vec<Vector3<f64>>,
    /// Orientation of each disc, world frame.
    pub orientations: Vec<UnitQuaternion<f64>>,
    /// Length of each tendon (m).
    pub tendon_lengths: Vec<f64>,
    /// Tension of each tendon (N), positive when it pulls.
    pub tendon_tensions: Vec<f64>,
    /// Largest absolute component of the energy's gradient (N m).
    pub residual: f64,
    /// Newton steps taken, those of continuation included.
    pub iterations: usize,
    /// Whether the residual is within [`TOLERANCE`] and the equilibrium stable: no eigenvalue of the
    /// Hessian below zero.
    pub converged: bool,
}

impl Robot {
    /// Settles the robot under a command and loads.
    ///
    /// Never fails in silence: look at [`Equilibrium::converged`] and [`Equilibrium::residual`].
    pub fn settle(&self, command: &Command, loads: &Loads) -> Equilibrium {
        Settler::new(self).settle(command, loads)
    }

    /// Settles many commands, in parallel; the result does not depend on the number of threads.
    pub fn settle_batch(&self, commands: &[Command], loads: &Loads) -> Vec<Equilibrium> {
        let settle = |settler: &mut Settler, command| settler.settle(command, loads);
        commands
            .par_iter()
            .map_init(|| Settler::new(self), settle)
            .collect()
    }

    /// The smallest eigenvalue (N m/rad) of the energy's Hessian at `configuration`: the stiffness
    /// of the softest mode, positive at a stable equilibrium. `NaN` if it cannot be computed.
    pub fn smallest_stiffness(
        &self,
        command: &Command,
        loads: &Loads,
        configuration: &Configuration,
    ) -> f64 {
        let mut chain = Chain::new(self);
        chain.place(self, configuration);
        let mut derivatives = Derivatives::new(self);
        Potential::new(self, command, loads).differentiate(&chain, &mut derivatives);
        let eigenvalues = derivatives.hessian.self_adjoint_eigenvalues(Side::Lower);
        eigenvalues.map_or(f64::NAN, |values| values[0])
    }
}

/// Settles commands of one robot one after another, reusing its memory.
pub struct Settler<'a> {
    robot: &'a Robot,
    configuration: Configuration,
    trial: Configuration,
    chain: Chain,
    trial_chain: Chain,
    derivatives: Derivatives,
    lengths: Vec<f64>,
    factor: Mat<f64>,
    step: Mat<f64>,
    stack: MemBuffer,
}

/// How a descent ended.
enum Descent {
    Settled,
    Stalled,
}

/// Whether an equilibrium holds.
enum Rest {
    Stable,
    Unstable,
}

/// What the factorisation says of the Hessian.
enum Curvature {
    Positive,
    Indefinite,
}

impl<'a> Settler<'a> {
    /// Prepares to settle `robot`.
    pub fn new(robot: &'a Robot) -> Self {
        let dof = robot.dof();
        let scratch = llt::factor::cholesky_in_place_scratch::<f64>(dof, Par::Seq, Spec::default());
        Self {
            robot,
            configuration: Configuration::straight(robot),
            trial: Configuration::straight(robot),
            chain: Chain::new(robot),
            trial_chain: Chain::new(robot),
            derivatives: Derivatives::new(robot),
            lengths: vec![0.0; robot.tendons.len()],
            factor: Mat::zeros(dof, dof),
            step: Mat::zeros(dof, 1),
            stack: MemBuffer::new(scratch),
        }
    }

    /// Settles the robot under `command` and `loads`, as [`Robot::settle`].
    pub fn settle(&mut self, command: &Command, loads: &Loads) -> Equilibrium {
        self.start_straight();
        let (mut descent, mut iterations) =
            self.descend(&Potential::new(self.robot, command, loads));
        if let Descent::Stalled = descent {
            let steps;
            (descent, steps) = self.continue_from_mean(command, loads);
            iterations += steps;
        }
        if let Descent::Stalled = descent {
            // The last derivatives may be of another configuration or command than the reported ones.
            let potential = Potential::new(self.robot, command, loads);
            potential.differentiate(&self.chain, &mut self.derivatives);
        }
        self.report(command, iterations, matches!(descent, Descent::Settled))
    }

    fn start_straight(&mut self) {
        self.configuration.0.fill(UnitQuaternion::identity());
        self.chain.place(self.robot, &self.configuration);
    }

    /// Descends from the current configuration to an equilibrium; also returns the steps taken.
    fn descend(&mut self, potential: &Potential) -> (Descent, usize) {
        for iteration in 0..MAX_ITERATIONS {
            potential.differentiate(&self.chain, &mut self.derivatives);
            let curvature = self.newton_step();
            if self.derivatives.residual() <= TOLERANCE {
                let at_rest = match curvature {
                    Curvature::Positive => Rest::Stable,
                    Curvature::Indefinite => self.leave_saddle(),
                };
                if let Rest::Stable = at_rest {
                    return (Descent::Settled, iteration);
                }
            }
            self.limit_step();
            if !self.advance(potential) {
                return (Descent::Stalled, iteration);
            }
        }
        (Descent::Stalled, MAX_ITERATIONS)
    }

    /// Solves for the step: `-H⁻¹ g`, or `-|H|⁻¹ g` where the Hessian `H` is not positive definite.
    fn newton_step(&mut self) -> Curvature {
        self.factor.copy_from(&self.derivatives.hessian);
        for (step, gradient) in self
            .step
            .col_as_slice_mut(0)
            .iter_mut()
            .zip(&self.derivatives.gradient)
        {
            *step = -gradient;
        }
        let stack = MemStack::new(&mut self.stack);
        let factored = llt::factor::cholesky_in_place(
            self.factor.as_mut(),
            Default::default(),
            Par::Seq,
            stack,
            Spec::default(),
        );
        if factored.is_ok() {
            llt::solve::solve_in_place(self.factor.as_ref(), self.step.as_mut(), Par::Seq, stack);
            return Curvature::Positive;
        }
        // On NaN the step stays the gradient's, and the line search reports the failure.
        if let Ok(eigen) = self.derivatives.hessian.self_adjoint_eigen(Side::Lower) {
            let mut modes = eigen.U().transpose() * &self.step;
            let stiffest = eigen
                .S()
                .column_vector()
                .iter()
                .fold(0.0, |s: f64, v| s.max(v.abs()));
            for (mode, value) in modes
                .col_as_slice_mut(0)
                .iter_mut()
                .zip(eigen.S().column_vector().iter())
            {
                *mode /= value.abs().max(1e-8 * stiffest);
            }
            self.step = eigen.U() * modes;
        }
        Curvature::Indefinite
    }

    /// At an equilibrium whose Hessian has no Cholesky factor: stable if no eigenvalue is below
    /// zero by more than rounding. Otherwise sets a step along the softest mode, which has no
    /// preferred sense; the sense in which its largest component is positive is taken.
    fn leave_saddle(&mut self) -> Rest {
        let Ok(eigen) = self.derivatives.hessian.self_adjoint_eigen(Side::Lower) else {
            return Rest::Unstable;
        };
        let eigenvalues = eigen.S().column_vector();
        if eigenvalues[0] >= -1e-12 * eigenvalues[eigenvalues.nrows() - 1] {
            return Rest::Stable;
        }
        let softest = eigen.U().col(0);
        let larger = |l: f64, v: &f64| if v.abs() > l.abs() { *v } else { l };
        let largest = softest.iter().fold(0.0, larger);
        for (step, mode) in self.step.col_as_slice_mut(0).iter_mut().zip(softest.iter()) {
            *step = 0.1 * mode * largest.signum();
        }
        Rest::Unstable
    }

    fn limit_step(&mut self) {
        let step = self.step.col_as_slice_mut(0);
        let turn = |xi: &[f64]| xi.iter().map(|x| x * x).sum::<f64>().sqrt();
        let largest = step.chunks_exact(3).map(turn).fold(0.0, f64::max);
        if largest > MAX_TURN {
            step.iter_mut().for_each(|x| *x *= MAX_TURN / largest);
        }
    }

    /// Takes the step, halved until the energy falls; `false` if it never does.
    fn advance(&mut self, potential: &Potential) -> bool {
        let energy = potential.energy(&self.chain, &mut self.lengths);
        let step = self.step.col_as_slice_mut(0);
        let slope: f64 = step
            .iter()
            .zip(&self.derivatives.gradient)
            .map(|(s, g)| s * g)
            .sum();
        // Energy differences below this are rounding; there a Newton step is right as it is.
        let rounding = 1e-13 * energy.abs().max(1e-3);
        for _ in 0..MAX_HALVINGS {
            self.configuration.retract(step, &mut self.trial);
            self.trial_chain.place(self.robot, &self.trial);
            let trial_energy = potential.energy(&self.trial_chain, &mut self.lengths);
            if trial_energy <= energy + 1e-4 * slope.min(0.0) + rounding {
                std::mem::swap(&mut self.configuration, &mut self.trial);
                std::mem::swap(&mut self.chain, &mut self.trial_chain);
                return true;
            }
            step.iter_mut().for_each(|x| *x *= 0.5);
        }
        false
    }

    /// Leads the command from the mean over each module's tendons to its goal.
    fn continue_from_mean(&mut self, command: &Command, loads: &Loads) -> (Descent, usize) {
        let goal = command.as_slice();
        let mut start = Vec::with_capacity(goal.len());
        for module in &self.robot.spec().modules {
            let own = &goal[start.len()..][..module.holes.count()];
            let mean = own.iter().sum::<f64>() / own.len() as f64;
            start.extend(std::iter::repeat_n(mean, own.len()));
        }
        self.start_straight();
        let (mut done, mut stride, mut iterations) = (0.0, 0.25, 0);
        let mut settled = self.configuration.clone();
        while done < 1.0 {
            let part = f64::min(done + stride, 1.0);
            let between: Vec<f64> = start
                .iter()
                .zip(goal)
                .map(|(from, to)| from + part * (to - from))
                .collect();
            let (descent, steps) = self.descend(&Potential::along(self.robot, &between, loads));
            iterations += steps;
            match descent {
                Descent::Settled => {
                    done = part;
                    stride *= 2.0;
                    settled.clone_from(&self.configuration);
                }
                Descent::Stalled if stride < MIN_CONTINUATION_STEP => {
                    return (Descent::Stalled, iterations);
                }
                Descent::Stalled => {
                    stride /= 4.0;
                    self.configuration.clone_from(&settled);
                    self.chain.place(self.robot, &self.configuration);
                }
            }
        }
        (Descent::Settled, iterations)
    }

    fn report(&self, command: &Command, iterations: usize, converged: bool) -> Equilibrium {
        let mut lengths = vec![0.0; self.robot.tendons.len()];
        crate::tendon::tendon_lengths(self.robot, &self.chain, &mut lengths);
        let tensions = (self.robot.tendons.iter())
            .zip(lengths.iter().zip(command.as_slice()))
            .map(|(tendon, (length, rest))| tendon.stiffness * (length - rest))
            .collect();
        let quaternion = |rotation: &_| {
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation))
        };
        Equilibrium {
            configuration: self.configuration.clone(),
            positions: self.chain.positions.clone(),
            orientations: self.chain.orientations.iter().map(quaternion).collect(),
            tendon_lengths: lengths,
            tendon_tensions: tensions,
            residual: self.derivatives.residual(),
            iterations,
            converged,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// No standard robot needs continuation, so it is asked for here.
    #[test]
    fn continuation_settles_too_and_comes_to_the_same_place() {
        let robot = Robot::load("3m").expect("a standard robot");
        let mut settler = Settler::new(&robot);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut elsewhere = 0;
        for _ in 0..200 {
            let command = robot.random_command(&mut rng);
            let direct = settler.settle(&command, &Loads::default());
            let (descent, _) = settler.continue_from_mean(&command, &Loads::default());
            assert!(matches!(descent, Descent::Settled));
            assert!(settler.derivatives.residual() <= TOLERANCE);
            let apart = (settler.chain.positions[14] - direct.positions[14]).norm();
            elsewhere += usize::from(apart > 1e-7);
        }
        // Some commands have two equilibria, and another way may lead to the other one.
        assert!(elsewhere <= 10, "{elsewhere} of 200 came to rest elsewhere");
    }

    #[test]
    fn a_descent_that_cannot_settle_says_so() {
        let robot = Robot::load("2m").expect("a standard robot");
        let command = robot.mean_command();
        let mut settler = Settler::new(&robot);
        settler.start_straight();
        settler.chain.positions[3].x = f64::NAN;
        let (descent, _) = settler.descend(&Potential::new(&robot, &command, &Loads::default()));
        assert!(matches!(descent, Descent::Stalled));
    }
}
