//! Whether small motions about an equilibrium grow, under loads without a potential too.
//!
//! They obey `M dv/dt + D v + K q = 0` with the robot's own inertia and damping, and the Jacobian `K` of the moments on the
//! joints, which need not be symmetric. With the symmetric part `S` and the skew part `N` of `K`, an eigenvector `x` of the
//! rate `lambda` has `m lambda² + d lambda + s + i n = 0`, where `m = x* M x` and so on. Where `|n| <= nu d` for every `x`,
//! a rate with a positive real part has an imaginary part of `nu` at most, and `s <= nu² m` (in the spirit of Metelitsyn's
//! inequality: Merkin, Introduction to the Theory of Stability, 1997, ch. 6). So motions stay small where `S - nu² M` is
//! positive definite, which an elimination in O(n) decides: what is slower than `nu` does not exist, and of what is faster the
//! damping takes more than the loads bring. More generally, a rate with a positive real part needs `n² m >= s d²`; where
//! `|n| <= kappa s`, too, that cannot be where `m` is below the larger of `s / nu²` and `d / (kappa nu)`.
//!
//! Elsewhere the rates are computed, as eigenvalues of the pencil by Arnoldi's iteration with its inverse about rates `sigma`
//! above zero (Bai and Su, SIAM Journal on Matrix Analysis 26, 2005). Rates with positive real parts lie outside the circle
//! that all others lie in, and so are found first. Spaces that hold all rates of up to 20 discs are taken, of longer robots
//! those about several `sigma`; O(n) for each dimension.

use nalgebra::{Complex, Matrix3, Vector3};

use super::DynamicsError;
use super::acceleration::EquationsOfMotion;
use super::blocks::{Part, Weights};
use super::implicit::ImplicitMatrix;
use super::links::{Link, PointMass};
use crate::chain::Configuration;
use crate::energy::following::{add_product, add_transposed_product, follows};
use crate::factor::{Arnoldi, Curvature, dot, probe, project};
use crate::robot::{Loads, Robot};

mod mode;

use mode::Mode;

/// Growth of a motion, as a share of its rate's size, that is not told from none; and of a robot without damping about some axis, which
/// is less than the weakest damping of a material takes.
const STEADY: f64 = 1e-6;
const STEADY_UNDAMPED: f64 = 1e-3;
/// Residual of a rate that counts, as a share of it.
const CONVERGED: f64 = 1e-9;
/// Share of the terms of the equations of motion that a mode may leave of them.
const ERROR: f64 = 1e-6;
/// Dimensions of the spaces: at first, and while a growing motion has not converged.
const DIMENSIONS: [usize; 3] = [60, 90, 120];
/// Rates about which those of long robots are looked for, as shares of that of the joints' stiffness over the robot's inertia.
const SHIFTS: [f64; 4] = [1.0, 10.0, 0.1, 0.01];
/// Neighbours of such a rate.
const NUDGES: [f64; 3] = [1.0, 1.37, 0.71];
/// Dimensions of the space for the largest share of the skew part, and what its value may lack.
const LARGEST_SHARE: usize = 12;
const SAFETY: f64 = 1.05;
/// Most dimensions of the space for its largest share of the stiffness.
const MOST_DIMENSIONS: usize = 40;
/// Error of a solution, as a share of the right-hand side, up to which it counts as accurate; and how often it is refined at most.
const ACCURATE: f64 = 1e-10;
const REFINEMENTS: usize = 4;

/// A small motion that grows: as `exp(rate t)`, with an oscillation or without.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth {
    /// Real part of the eigenvalue (1/s), above 0.
    pub rate: f64,
    /// Imaginary part (rad/s): 0 where the robot leaves the equilibrium without swinging.
    pub angular_frequency: f64,
    /// Whether some motion would grow without the robot's damping, too. Damping can make a robot unstable that would be
    /// stable without (Ziegler's paradox).
    pub without_damping: bool,
}

/// What small motions about an equilibrium do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SmallMotion {
    /// None grows and none drifts away.
    Bounded,
    /// None grows; some meet no resistance.
    Drifts,
    /// The one that grows fastest.
    Grows(Growth),
}

/// Rates of small motions of one robot; reuses its memory.
#[derive(Clone, Debug)]
pub(crate) struct SmallMotionRates {
    equations: EquationsOfMotion,
    matrix: ImplicitMatrix,
    at_rest: Vec<f64>,
}

/// What is found among the rates.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    growth: Option<Complex<f64>>,
    drifts: bool,
    /// Whether a growing motion has not converged.
    unresolved: bool,
}

impl SmallMotionRates {
    /// Of `robot`.
    ///
    /// # Errors
    /// [`DynamicsError`] for a joint without inertia, or an inextensible tendon whose length is commanded.
    pub fn new(robot: &Robot) -> Result<Self, DynamicsError> {
        let armatures = Link::armatures(robot, 0.0);
        Ok(Self {
            equations: EquationsOfMotion::new(robot, &armatures)?,
            matrix: ImplicitMatrix::new(robot),
            at_rest: vec![0.0; robot.dof()],
        })
    }

    /// What small motions about the equilibrium `q` of `command` and `loads` do, a stiffness up to `margin` (N m/rad) not told
    /// from none; `None` if it cannot be computed.
    pub fn examine(
        &mut self,
        q: &Configuration,
        command: &[f64],
        loads: &Loads,
        margin: f64,
    ) -> Option<SmallMotion> {
        self.enter(q, command, loads);
        let fastest = self.fastest(loads)?;
        if fastest.is_finite() && self.stays_small(loads, fastest, margin) {
            return Some(SmallMotion::Bounded);
        }
        let undamped = self.without_damping();
        let found = self.search(loads, !undamped, margin)?;
        let Some(rate) = found.growth else {
            return Some(match found.drifts {
                true => SmallMotion::Drifts,
                false => SmallMotion::Bounded,
            });
        };
        let without_damping = match undamped {
            true => true,
            false => (self.search(loads, false, margin)?.growth).is_some(),
        };
        let swings = rate.im > STEADY * rate.norm();
        Some(SmallMotion::Grows(Growth {
            rate: rate.re,
            angular_frequency: if swings { rate.im } else { 0.0 },
            without_damping,
        }))
    }

    fn enter(&mut self, q: &Configuration, command: &[f64], loads: &Loads) {
        let equations = &mut self.equations;
        equations.payload = PointMass::payload(&equations.robot, loads);
        equations.forces.set_loads(loads);
        equations.enter(q, &self.at_rest, command);
        self.matrix.expand(equations, loads, q, command);
        equations.release();
    }

    fn joints(&self) -> usize {
        self.equations.links.len()
    }

    /// Whether no joint has damping.
    pub fn without_damping(&self) -> bool {
        let links = self.equations.links.iter();
        let damping = links.map(|link| link.damping().amax());
        damping.fold(0.0, f64::max) == 0.0
    }

    /// `nu`: the largest `|n| / d` (1/s); infinite for a joint without damping.
    fn fastest(&self, loads: &Loads) -> Option<f64> {
        let eased: Option<Vec<_>> = (0..self.joints())
            .map(|joint| {
                let damping = self.damping_matrix(joint);
                match self.equations.posture.chain.hinges(joint) {
                    None => inverse_root(&damping),
                    Some(hinges) => {
                        inverse_root(&hinges.confine(&damping)).map(|root| hinges.release(&root))
                    }
                }
            })
            .collect();
        let Some(eased) = eased else {
            return Some(f64::INFINITY);
        };
        let posture = &self.equations.posture;
        let mut space = Arnoldi::new(eased.len());
        space.extend(LARGEST_SHARE, |x, out| {
            let x: Vec<_> = eased.iter().zip(x).map(|(eased, x)| eased * x).collect();
            let mut back = vec![Vector3::zeros(); x.len()];
            add_product(loads, 1.0, posture, &x, out);
            add_transposed_product(loads, posture, &x, &mut back);
            for ((out, back), eased) in out.iter_mut().zip(&back).zip(&eased) {
                *out = eased * (*out - back) * 0.5;
            }
        });
        let shares = space.ritz()?.into_iter().map(|ritz| ritz.value.norm());
        Some(SAFETY * shares.fold(0.0, f64::max))
    }

    /// Whether `S` has no eigenvalue below the margin, and `S / nu²` is above `M`, or where it is not, `D / (kappa nu)` is.
    fn stays_small(&mut self, loads: &Loads, fastest: f64, margin: f64) -> bool {
        let symmetric = |mass, damping, stiffness, joints| Weights {
            mass,
            damping,
            stiffness,
            joints,
            part: Part::Symmetric,
        };
        let mut is_positive = |weights| {
            self.matrix.combine(&self.equations, loads, weights) == Some(Curvature::Positive)
        };
        if is_positive(symmetric(-fastest * fastest, 0.0, 1.0, -margin)) {
            return true;
        }
        if !is_positive(symmetric(0.0, 0.0, 1.0, -margin)) {
            return false;
        }
        let Some(stiffest) = self.stiffest(loads) else {
            return false;
        };
        // Of two that are to exceed a third the mean is enough.
        let weights = [(0.5 / (stiffest * fastest)), (0.5 / (fastest * fastest))];
        let mean = symmetric(-1.0, weights[0], weights[1], 0.0);
        self.matrix.combine(&self.equations, loads, mean) == Some(Curvature::Positive)
    }

    /// `kappa`: the largest `|n| / s`, where `S` is positive definite and has just been factorised; `None` where it takes long.
    fn stiffest(&self, loads: &Loads) -> Option<f64> {
        let following = loads
            .wrenches()
            .iter()
            .filter(|wrench| follows(wrench))
            .count();
        // Each wrench turns and moves one disc: the skew part has six dimensions for each.
        let dimension = 6 * following + 2;
        if dimension > MOST_DIMENSIONS {
            return None;
        }
        let posture = &self.equations.posture;
        let mut space = Arnoldi::new(self.joints());
        space.extend(dimension, |x, out| {
            let (mut there, mut back) = (
                vec![Vector3::zeros(); x.len()],
                vec![Vector3::zeros(); x.len()],
            );
            add_product(loads, 1.0, posture, x, &mut there);
            add_transposed_product(loads, posture, x, &mut back);
            for (there, back) in there.iter_mut().zip(&back) {
                *there = (*there - back) * 0.5;
            }
            self.matrix.solve(&there, out);
        });
        let shares = space.ritz()?.into_iter().map(|ritz| ritz.value.norm());
        Some(SAFETY * shares.fold(0.0, f64::max))
    }

    fn search(&mut self, loads: &Loads, damped: bool, margin: f64) -> Option<Found> {
        let joints = self.joints();
        let probe = probe(joints);
        let stiffness = dot(&probe, &self.stiffness(loads, &probe)).abs();
        let reference = (stiffness / dot(&probe, &self.mass(&probe))).sqrt();
        if !(reference.is_finite() && reference > 0.0) {
            return (stiffness == 0.0).then_some(Found {
                drifts: true,
                ..Found::default()
            });
        }
        // One space holds all rates of a short robot.
        let complete = 6 * joints <= DIMENSIONS[DIMENSIONS.len() - 1];
        let (mut all, mut computed) = (Found::default(), 0);
        all.unresolved = true;
        for share in SHIFTS {
            let shift = share * reference;
            // Where the elimination is not accurate, a little aside.
            let found = (NUDGES.iter())
                .find_map(|nudge| self.search_about(nudge * shift, loads, damped, margin));
            let Some(found) = found else {
                continue;
            };
            computed += 1;
            all.drifts |= found.drifts;
            all.unresolved &= found.unresolved;
            let rate = |growth: Option<Complex<f64>>| growth.map_or(0.0, |rate| rate.re);
            if rate(found.growth) > rate(all.growth) {
                all.growth = found.growth;
            }
            // A mode much slower than the shift is known less well than about another.
            if complete && !found.unresolved {
                return Some(all);
            }
        }
        let examined = computed == SHIFTS.len() && !(complete && all.unresolved);
        (examined || all.growth.is_some()).then_some(all)
    }

    /// The rates nearest to `shift` (1/s) above all.
    fn search_about(
        &mut self,
        shift: f64,
        loads: &Loads,
        damped: bool,
        margin: f64,
    ) -> Option<Found> {
        let weights = Weights::of_step(if damped { shift.recip() } else { 0.0 }, shift.powi(-2));
        self.matrix.combine(&self.equations, loads, weights)?;
        let refinements =
            (0..=REFINEMENTS).find(|&often| self.is_accurate(loads, weights, often))?;
        let mut space = Arnoldi::new(2 * self.joints());
        let mut found = Found::default();
        let dimensions = match 6 * self.joints() <= DIMENSIONS[DIMENSIONS.len() - 1] {
            true => &DIMENSIONS[DIMENSIONS.len() - 1..],
            false => &DIMENSIONS[..],
        };
        for &dimension in dimensions {
            space.extend(dimension, |state, out| {
                self.step(shift, loads, weights, refinements, state, out);
            });
            found = self.judge(&space, shift, loads, damped, margin)?;
            if !found.unresolved || space.is_closed() {
                break;
            }
        }
        Some(found)
    }

    /// Whether a solution with the factorised sum, refined so often, gives its right-hand side.
    fn is_accurate(&mut self, loads: &Loads, weights: Weights, refinements: usize) -> bool {
        let mut rhs = probe(self.joints());
        project(&self.equations.posture.chain.hinges, &mut rhs);
        let mut solution = rhs.clone();
        self.solve(loads, weights, refinements, &rhs, &mut solution);
        let left = self.left(loads, weights, &rhs, &solution);
        // Not a number is not below.
        left.iter().all(|left| left.norm() <= ACCURATE)
    }

    /// Writes the solution with the factorised sum, refined so often (Golub and Van Loan, Matrix Computations, ch. 3.5.3).
    fn solve(
        &mut self,
        loads: &Loads,
        weights: Weights,
        refinements: usize,
        rhs: &[Vector3<f64>],
        out: &mut [Vector3<f64>],
    ) {
        self.matrix.solve(rhs, out);
        let mut change = vec![Vector3::zeros(); rhs.len()];
        for _ in 0..refinements {
            let left = self.left(loads, weights, rhs, out);
            self.matrix.solve(&left, &mut change);
            for (out, change) in out.iter_mut().zip(&change) {
                *out += change;
            }
        }
    }

    /// What a solution leaves of its right-hand side.
    fn left(
        &mut self,
        loads: &Loads,
        weights: Weights,
        rhs: &[Vector3<f64>],
        solution: &[Vector3<f64>],
    ) -> Vec<Vector3<f64>> {
        let (mass, stiffness) = (self.mass(solution), self.stiffness(loads, solution));
        let damping = self.damping(solution);
        let left = |k: usize| {
            rhs[k]
                - mass[k] * weights.mass
                - damping[k] * weights.damping
                - stiffness[k] * weights.stiffness
        };
        (0..rhs.len()).map(left).collect()
    }

    /// Writes the inverse of the linearised pencil about `shift` times a `state` of turns and their rates over `shift`:
    /// of the rate `lambda` the eigenvalue is `shift / (lambda - shift)`.
    fn step(
        &mut self,
        shift: f64,
        loads: &Loads,
        weights: Weights,
        refinements: usize,
        state: &[Vector3<f64>],
        out: &mut [Vector3<f64>],
    ) {
        let (turns, rates) = state.split_at(self.joints());
        let sum: Vec<_> = turns.iter().zip(rates).map(|(x, y)| x + y).collect();
        let mut rhs = self.mass(&sum);
        if weights.damping > 0.0 {
            for (rhs, damping) in rhs.iter_mut().zip(self.damping(turns)) {
                *rhs += damping / shift;
            }
        }
        rhs.iter_mut().for_each(|moment| *moment = -*moment);
        let (first, second) = out.split_at_mut(turns.len());
        self.solve(loads, weights, refinements, &rhs, first);
        for ((second, first), turn) in second.iter_mut().zip(first).zip(turns) {
            *second = *first + turn;
        }
        // What hinges do not allow is of no mode.
        project(&self.equations.posture.chain.hinges, second);
    }

    /// What the rates of a space about `shift` say.
    fn judge(
        &mut self,
        space: &Arnoldi,
        shift: f64,
        loads: &Loads,
        damped: bool,
        margin: f64,
    ) -> Option<Found> {
        let mut found = Found::default();
        let steady = if damped { STEADY } else { STEADY_UNDAMPED };
        let ritz = space.ritz()?;
        let rate = |value: Complex<f64>| (value.inv() + 1.0) * shift;
        let upper = ritz
            .iter()
            .filter(|ritz| ritz.value.im <= 0.0 || ritz.value.im.is_nan());
        let slowest = (ritz.iter())
            .map(|ritz| rate(ritz.value).norm())
            .fold(f64::INFINITY, f64::min);
        for ritz in upper {
            let rate = rate(ritz.value);
            let grows = rate.re > steady * rate.norm();
            if !grows && rate.norm() > slowest {
                continue;
            }
            if ritz.residual > CONVERGED * ritz.value.norm() {
                found.unresolved |= grows;
                continue;
            }
            let mode = space.vector(ritz);
            let [real, imaginary] = mode.each_ref().map(|part| &part[..self.joints()]);
            let mode = Mode::new(self, loads, damped, rate, [real, imaginary]);
            if mode.resistance <= margin {
                found.drifts = true;
            } else if grows && mode.error > ERROR {
                found.unresolved = true;
            } else if grows && found.growth.is_none_or(|most| rate.re > most.re) {
                found.growth = Some(Complex::new(rate.re, rate.im.abs()));
            }
        }
        Some(found)
    }

    fn mass(&mut self, turns: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut out = vec![Vector3::zeros(); turns.len()];
        self.equations.residual(turns, &mut out);
        project(&self.equations.posture.chain.hinges, &mut out);
        out
    }

    fn damping_matrix(&self, joint: usize) -> Matrix3<f64> {
        let chain = &self.equations.posture.chain;
        self.equations.links[joint].damping_matrix(chain.disc(joint), chain.hinges(joint))
    }

    fn damping(&self, turns: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let joints = turns.iter().enumerate();
        joints
            .map(|(joint, turn)| self.damping_matrix(joint) * turn)
            .collect()
    }

    fn stiffness(&self, loads: &Loads, turns: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut out = vec![Vector3::zeros(); turns.len()];
        (self.matrix).stiffness_product(&self.equations, loads, turns, &mut out);
        project(&self.equations.posture.chain.hinges, &mut out);
        out
    }
}

/// The inverse of the square root of a symmetric matrix; `None` where it is not positive definite.
fn inverse_root(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let eigen = matrix.symmetric_eigen();
    if eigen.eigenvalues.min() <= 0.0 {
        return None;
    }
    let roots = eigen.eigenvalues.map(|value| value.sqrt().recip());
    let vectors = &eigen.eigenvectors;
    Some(vectors * Matrix3::from_diagonal(&roots) * vectors.transpose())
}

#[cfg(test)]
mod tests;
