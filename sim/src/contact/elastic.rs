//! Equilibria among obstacles of robots that resist by more than their own potential: tendons with friction in their holes.
//!
//! As friction of contacts ([`super::friction`]) that of tendons has a potential where its bounds are those of the solve before. So the
//! robot minimises its energy, that of the contacts with obstacles and itself, and that of the contacts in its holes; the solve is
//! repeated until all bounds are its own. The Hessian couples all joints that a tendon passes, and is factorised as a dense matrix.

use faer::Mat;
use faer::linalg::solvers::{Llt, Solve};
use nalgebra::{Matrix3, Matrix3xX, Vector3};

use super::descent::{CANCELLING, ENERGY_ROUNDING, ENOUGH};
use super::equations::{Equations, MAX_STIFFENINGS, MAX_TURN, STIFFENING};
use super::friction::Bristle;
use super::law::Hardness;
use super::report::report_contacts;
use super::settler::{LAST_BARRIER, LOOSE_BARRIER, NEAR_BARRIER, NEXT};
use super::{Contact, ContactEquilibrium, ContactError, ContactSettler};
use crate::chain::Configuration;
use crate::energy::{Pressing, add_block};
use crate::factor::project;
use crate::robot::{Command, HingeAxes, Loads, Robot};
use crate::scene::Scene;
use crate::solve::{Iterate, System, newton, turn_between};

/// How often bounds of friction are taken over.
const MAX_LAGS: usize = 60;
/// How often they are without halving what they leave unbalanced.
const PATIENCE: usize = 12;
/// How often all of their change is, and which share of it from then on.
const EAGER: usize = 5;
const SHARE: f64 = 0.6;
/// Steps of Newton's method with the bounds in it.
const MAX_POLISH: usize = 10;
/// The share of the tolerance to which the energy is minimised for given bounds: what is left moves them.
const TIGHT: f64 = 0.1;

/// A robot whose energy is minimised among obstacles, bounds of its friction given.
pub(crate) trait Elastic {
    /// Moves to a configuration.
    fn place(&mut self, q: &Configuration);

    /// Takes over a share of the change of the bounds of friction to those that hold where it stands.
    fn renew(&mut self, share: f64);

    /// The residual (N m) under the forces of contacts with obstacles and itself, with the bounds that hold there.
    fn residual(&mut self, pressing: &Pressing) -> f64;

    /// Energy there (J), without contacts with obstacles and itself.
    fn energy(&self) -> f64;

    /// Evaluates gradient and Hessian under the forces of such contacts; returns the residual (N m).
    fn expand(&mut self, pressing: &Pressing) -> f64;

    /// Writes the gradient by the joints' turns (N m), the forces in it.
    fn gradient(&self, out: &mut [Vector3<f64>]);

    /// The Hessian by the joints' turns, world axes, without what the contacts' forces change by.
    fn hessian(&self) -> Mat<f64>;

    /// The Jacobian of the gradient with the bounds that hold where it stands, where the residual was evaluated last.
    fn jacobian(&mut self) -> Mat<f64>;

    /// Leaves of such a matrix what hinges allow.
    fn confine(&self, hessian: &mut Mat<f64>);

    fn hinges(&self) -> &[Option<HingeAxes>];
}

/// What a robot whose tendons have friction touches along its path.
#[derive(Clone, Debug)]
pub(crate) struct Touching {
    settler: ContactSettler,
    at: Touched,
    /// Whether the step that was tried last touches nothing.
    is_step_clear: bool,
}

/// What it touches at the last equilibrium.
#[derive(Clone, Debug)]
pub(crate) struct Touched {
    /// Friction of contacts.
    bristles: Vec<Bristle>,
    report: ContactEquilibrium,
    /// Whether a contact bears.
    is_pressed: bool,
}

impl Touching {
    pub fn new(robot: &Robot, scene: &Scene) -> Self {
        Self {
            settler: ContactSettler::new(robot, scene),
            at: Touched {
                bristles: Vec::new(),
                report: ContactEquilibrium::unsettled(robot),
                is_pressed: false,
            },
            is_step_clear: false,
        }
    }

    /// Settles without any friction, from the straight pose.
    pub fn settle(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&ContactEquilibrium, ContactError> {
        self.at.bristles.clear();
        self.settler.settle(command, loads)?;
        self.at.report.clone_from(self.settler.found());
        self.at.is_pressed = !self.at.report.contacts.is_empty();
        Ok(&self.at.report)
    }

    /// Whether a contact bears at the last equilibrium.
    pub fn is_pressed(&self) -> bool {
        self.at.is_pressed
    }

    /// What rounding of the positions leaves of the moments of contacts (N m).
    pub fn rounding(&self) -> f64 {
        self.settler.equations.rounding()
    }

    /// What is touched at the last equilibrium.
    pub fn contacts(&self) -> &[Contact] {
        &self.at.report.contacts
    }

    /// The last equilibrium, to come back to.
    pub fn state(&self) -> &Touched {
        &self.at
    }

    /// Goes back to an equilibrium.
    pub fn set_state(&mut self, at: Touched) {
        self.at = at;
    }

    /// Whether a robot that presses nothing can go from the last equilibrium, `from`, to another configuration without touching anything.
    pub fn is_clear(&mut self, from: &Configuration, to: &Configuration) -> bool {
        self.is_step_clear = self.leads_past(from, to);
        self.is_step_clear
    }

    fn leads_past(&mut self, from: &Configuration, to: &Configuration) -> bool {
        let equations = &mut self.settler.equations;
        equations.bristles.clear();
        equations.neighbourhood.clear();
        equations.iterate.set(from);
        equations.find();
        equations.neighbourhood.begin_step();
        equations.iterate.set(to);
        if equations.has_crossed() {
            return false;
        }
        equations.find();
        let near = equations.neighbourhood.near.iter().map(|near| near.gap);
        let own = equations.near_pairs().iter().map(|near| near.gap);
        near.chain(own).all(|gap| gap > 0.0)
    }

    /// Forces of the contacts in a configuration, friction as of the last equilibrium.
    pub fn pressing_at(&mut self, q: &Configuration) -> &Pressing {
        let last = self.last_barrier();
        let equations = &mut self.settler.equations;
        equations.bristles.clone_from(&self.at.bristles);
        equations.neighbourhood.clear();
        equations.iterate.set(q);
        equations.set_hardness(Hardness::of_barrier(last), equations.tolerance);
        equations.press();
        &equations.pressing
    }

    /// Minimises the energy from the last equilibrium, `from`, until the residual is within a tolerance (N m), or a joint has turned by
    /// more than `most` (rad). Whether that is solved, and the number of Newton steps.
    pub fn solve(
        &mut self,
        elastic: &mut impl Elastic,
        from: &Configuration,
        (tolerance, most): (f64, f64),
    ) -> (bool, usize) {
        self.is_step_clear = false;
        self.pressing_at(from);
        elastic.place(from);
        let mut iterations = 0;
        let mut least = (f64::INFINITY, 0);
        for lag in 0..MAX_LAGS {
            // All at once until bounds may turn out to alternate.
            elastic.renew(if lag < EAGER { 1.0 } else { SHARE });
            let equations = &mut self.settler.equations;
            equations.press_bristles();
            equations.press();
            let residual = elastic.residual(&equations.pressing);
            if residual <= tolerance {
                return (true, iterations);
            }
            if residual < 0.5 * least.0 {
                least = (residual, lag);
            }
            let turn = turn_between(from, &equations.iterate.configuration);
            if turn > most || lag > least.1 + PATIENCE {
                break;
            }
            if lag > 0 {
                let (solved, steps) = self.polish(elastic, (residual, tolerance));
                iterations += steps;
                if solved {
                    return (true, iterations);
                }
            }
            let (solved, steps) = self.descend_near(elastic, TIGHT * tolerance);
            iterations += steps;
            let equations = &self.settler.equations;
            if !solved && elastic.expand(&equations.pressing) > tolerance {
                break;
            }
        }
        (false, iterations)
    }

    /// Newton's method on the balance with the bounds of tendons' friction that hold where the robot stands, as long as it halves the
    /// residual (N m): where such bounds follow the tensions by much, taking them over leads nowhere. Whether that is solved, and the
    /// number of steps.
    fn polish(
        &mut self,
        elastic: &mut impl Elastic,
        (mut residual, tolerance): (f64, f64),
    ) -> (bool, usize) {
        let equations = &mut self.settler.equations;
        for step in 1..=MAX_POLISH {
            elastic.gradient(&mut equations.gradient);
            let mut jacobian = elastic.jacobian();
            add_contacts(equations, &mut jacobian);
            elastic.confine(&mut jacobian);
            let rhs = rhs(&equations.gradient);
            let found = jacobian.partial_piv_lu().solve(&rhs);
            write_turns(&found, &mut equations.iterate.step);
            project(elastic.hinges(), &mut equations.iterate.step);
            equations.iterate.limit_step(MAX_TURN);
            equations.keep_clear();
            equations.neighbourhood.begin_step();
            equations.iterate.start_step();
            equations.iterate.move_by(1.0);
            let bristles = equations.bristles.clone();
            let crossed = equations.has_crossed();
            equations.is_found = false;
            elastic.place(&equations.iterate.configuration);
            equations.press();
            equations.press_bristles();
            equations.press();
            let next = elastic.residual(&equations.pressing);
            if !crossed && next <= tolerance {
                return (true, step);
            }
            if crossed || next.is_nan() || next >= 0.5 * residual {
                equations.bristles = bristles;
                equations.iterate.move_back();
                equations.is_found = false;
                elastic.place(&equations.iterate.configuration);
                equations.press();
                return (false, step);
            }
            residual = next;
        }
        (false, MAX_POLISH)
    }

    /// Where the last solve has led.
    pub fn configuration(&self) -> &Configuration {
        &self.settler.equations.iterate.configuration
    }

    /// Forces of the contacts there.
    pub fn pressing(&self) -> &Pressing {
        &self.settler.equations.pressing
    }

    /// Takes the last step over as an equilibrium.
    pub fn accept(&mut self) {
        if self.is_step_clear {
            self.at.bristles.clear();
            self.at.report.contacts.clear();
            (self.at.report.complementarity, self.at.report.penetration) = (0.0, 0.0);
            return;
        }
        let equations = &mut self.settler.equations;
        report_contacts(equations, &mut self.at.report);
        equations.stick_bristles();
        self.at.bristles.clone_from(&equations.bristles);
        self.at.is_pressed = !self.at.report.contacts.is_empty();
    }

    /// The barrier of a solution (J).
    fn last_barrier(&self) -> f64 {
        LAST_BARRIER * self.settler.equations.own_tolerance
    }

    /// As [`ContactSettler`] descends from near the solution.
    fn descend_near(&mut self, elastic: &mut impl Elastic, tolerance: f64) -> (bool, usize) {
        let last = self.last_barrier();
        let start = self.settler.equations.iterate.configuration.clone();
        let (solved, mut iterations) = self.descend(elastic, last, tolerance);
        if solved {
            return (solved, iterations);
        }
        self.settler.equations.iterate.set(&start);
        let mut barrier = NEAR_BARRIER * tolerance;
        while barrier > last * (1.0 + 1e-9) {
            let loose = tolerance.max(LOOSE_BARRIER * barrier);
            iterations += self.descend(elastic, barrier, loose).1;
            barrier = last.max(NEXT * barrier);
        }
        let (solved, steps) = self.descend(elastic, last, tolerance);
        (solved, iterations + steps)
    }

    fn descend(
        &mut self,
        elastic: &mut impl Elastic,
        barrier: f64,
        tolerance: f64,
    ) -> (bool, usize) {
        let equations = &mut self.settler.equations;
        equations.set_hardness(Hardness::of_barrier(barrier), tolerance);
        newton(&mut Minimisation {
            equations,
            elastic,
            energy: None,
        })
    }
}

/// The minimisation with given bounds of friction.
struct Minimisation<'a, E> {
    equations: &'a mut Equations,
    elastic: &'a mut E,
    /// Energy (J) at the start of the step, where it is known.
    energy: Option<f64>,
}

/// The energy to first order along a step, and what of it is rounding (J).
struct Slope {
    slope: f64,
    rounding: f64,
}

impl<E: Elastic> Minimisation<'_, E> {
    fn energy(&self) -> f64 {
        self.elastic.energy() + self.equations.touching_energy()
    }

    /// Newton's step, of a Hessian that is not positive definite with the joints stiffened alike.
    fn step(&mut self, residual: f64) {
        let equations = &mut *self.equations;
        let mut hessian = self.elastic.hessian();
        add_contacts(equations, &mut hessian);
        self.elastic.confine(&mut hessian);
        let n = hessian.nrows();
        let mut stiffness = 0.0;
        let rhs = rhs(&equations.gradient);
        for _ in 0..MAX_STIFFENINGS {
            if let Ok(llt) = Llt::new(hessian.as_ref(), faer::Side::Lower) {
                let found = llt.solve(&rhs);
                write_turns(&found, &mut equations.iterate.step);
                break;
            }
            let more = match stiffness {
                0.0 => STIFFENING * residual.max(equations.tolerance),
                before => 3.0 * before,
            };
            (0..n).for_each(|i| hessian[(i, i)] += more);
            stiffness += more;
        }
        project(self.elastic.hinges(), &mut equations.iterate.step);
    }
}

impl<E: Elastic> System for Minimisation<'_, E> {
    type Model = Slope;
    const MAX_STEPS: usize = 200;
    const MAX_TRIALS: usize = 30;

    fn iterate(&mut self) -> &mut Iterate {
        &mut self.equations.iterate
    }

    fn is_solved(&mut self) -> bool {
        self.equations.press();
        self.elastic.place(&self.equations.iterate.configuration);
        self.elastic.expand(&self.equations.pressing) <= self.equations.tolerance
    }

    fn newton_step(&mut self) -> Slope {
        let energy = self.energy.unwrap_or_else(|| self.energy());
        self.energy = Some(energy);
        self.elastic.gradient(&mut self.equations.gradient);
        let largest = self.equations.gradient.iter().map(Vector3::norm);
        self.step(largest.fold(0.0, f64::max));
        let equations = &mut *self.equations;
        equations.is_found = false;
        equations.iterate.limit_step(MAX_TURN);
        equations.keep_clear();
        equations.neighbourhood.begin_step();
        let turns = equations.iterate.step.iter().zip(&equations.gradient);
        let cancelling = CANCELLING * equations.tolerance.max(equations.own_tolerance);
        Slope {
            slope: turns.map(|(step, gradient)| step.dot(gradient)).sum(),
            rounding: ENERGY_ROUNDING * energy.abs().max(cancelling),
        }
    }

    fn accepts(&mut self, model: &Slope, share: f64) -> bool {
        if self.equations.has_crossed() {
            return false;
        }
        self.equations.find();
        self.elastic.place(&self.equations.iterate.configuration);
        let energy = self.energy();
        let before = self.energy.unwrap_or(energy);
        let accepted = energy <= before + ENOUGH * share * model.slope.min(0.0) + model.rounding;
        match accepted {
            true => self.energy = Some(energy),
            false => self.equations.is_found = false,
        }
        accepted
    }
}

/// The opposite of a gradient by the joints' turns, as a column.
fn rhs(gradient: &[Vector3<f64>]) -> Mat<f64> {
    Mat::from_fn(3 * gradient.len(), 1, |i, _| -gradient[i / 3][i % 3])
}

fn write_turns(column: &Mat<f64>, turns: &mut [Vector3<f64>]) {
    for (joint, turn) in turns.iter_mut().enumerate() {
        *turn = Vector3::from_fn(|axis, _| column[(3 * joint + axis, 0)]);
    }
}

/// Adds what the contacts' forces change by as the joints turn.
fn add_contacts(equations: &Equations, hessian: &mut Mat<f64>) {
    let chain = &equations.iterate.posture.chain;
    let centres = &chain.centres;
    for (disc, form) in equations.pressing.forms.iter().enumerate() {
        if form.iter().all(|number| *number == 0.0) {
            continue;
        }
        // A turn `t` of joint `j` turns the disc by `t`, and displaces its joint's centre by `t x (c_disc - c_j)`.
        let lever = |joint: usize| (centres[disc] - centres[joint]).cross_matrix().transpose();
        let [turns, mixed, shifts] = [(0, 0), (0, 3), (3, 3)]
            .map(|(row, column)| form.fixed_view::<3, 3>(row, column).into_owned());
        for i in 0..=disc {
            let (left, mixed_left) = (lever(i).transpose(), mixed.transpose());
            for j in 0..=disc {
                let right = lever(j);
                let block: Matrix3<f64> =
                    turns + mixed * right + left * mixed_left + left * shifts * right;
                add_block(hessian, i, j, &block);
            }
        }
    }
    for pair in &equations.pressing.pairs {
        // Displacement of the first point from the second by a turn of each joint.
        let n = centres.len();
        let mut apart = Matrix3xX::zeros(3 * n);
        for (point, sign) in pair.points.iter().zip([1.0, -1.0]) {
            for (joint, centre) in centres.iter().enumerate().take(point.disc + 1) {
                let arm = (point.position - centre).cross_matrix().transpose();
                let mut block = apart.fixed_view_mut::<3, 3>(0, 3 * joint);
                block += arm * sign;
            }
        }
        let forced = pair.form() * &apart;
        for i in 0..n {
            for j in 0..n {
                let [row, column] = [i, j].map(|joint| 3 * joint);
                let block: Matrix3<f64> =
                    apart.fixed_columns::<3>(row).transpose() * forced.fixed_columns::<3>(column);
                add_block(hessian, i, j, &block);
            }
        }
    }
}
