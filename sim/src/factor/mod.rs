//! Solving with the potential's Hessian in O(n).
//!
//! A tendon segment spans one joint and a dead force acts through the discs below it, so the Hessian ([`crate::energy`]) is one
//! 3 x 3 block for each joint and each disc, and a column for each tendon.
//!
//! From the tip to the base, the joints' turns are eliminated one by one, as in dynamic programming: what
//! lies above joint `i` enters as a quadratic of the turn `Omega` of the disc below the joint and of the partial
//! sums `s_c` of the columns (tendons) that pass the joint. The articulated-body algorithm (Featherstone, Rigid
//! Body Dynamics Algorithms, 2008, ch. 7) and the Riccati recursion of optimal control are eliminations of this
//! kind. It is a block Cholesky factorisation of the Hessian, so its pivots are positive exactly where the
//! Hessian is positive definite (Sylvester's law of inertia: Golub and Van Loan, Matrix Computations, ch. 8.1).
//!
//! A pivot that is zero but for rounding says nothing by itself: where the eliminated turn couples to
//! those below, the Hessian is indefinite, otherwise it may be semidefinite. [`Factor::definiteness`]
//! decides that by factorising the Hessian with all its eigenvalues shifted by a small stiffness.
#![allow(
    clippy::needless_range_loop,
    reason = "an index names one joint or slot in several arrays"
)]

mod contact;
mod dense;
mod eigen;
mod held;
mod krylov;
mod loaded;
mod motions;
mod paired;
mod softest;
mod symmetric;
mod unsymmetric;

pub(crate) use contact::{ContactLu, Inflow, RubbedMatrix};
pub(crate) use dense::{DenseLu, project};
pub(crate) use held::HeldLengths;
pub(crate) use krylov::{Arnoldi, dot, probe};
pub(crate) use loaded::{LoadedFactor, LoadedMatrix};
pub(crate) use paired::PairedLu;
pub(crate) use softest::{smallest_by_solving, smallest_eigenvalue, smallest_real_part};
pub(crate) use unsymmetric::{ChainLu, ChainMatrix, Side};

use nalgebra::{Matrix3, Vector3};

use crate::energy::{Columns, Expansion, noncommuting};
use crate::robot::HingeAxes;
use eigen::eigen;

/// What the factorisation says of the Hessian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Curvature {
    /// Positive definite.
    Positive,
    /// Not positive definite: the factor is of a positive definite matrix near it.
    Modified,
}

/// Sign of the Hessian's smallest eigenvalue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Definiteness {
    /// Above the margin.
    Positive,
    /// Within the margin around zero.
    Semidefinite,
    /// Below minus the margin.
    Indefinite,
}

/// Eigenvalues of the Hessian below this share of its size are not told from zero: rounding disturbs
/// them by about 1e-16 of it for each joint.
pub(crate) const MARGIN: f64 = 1e-10;

/// Factorisation of a potential's Hessian.
#[derive(Clone, Debug)]
pub(crate) struct Factor {
    columns: Columns,
    /// Inverse of each joint's pivot.
    pivots: Vec<Matrix3<f64>>,
    /// Of each joint, how its turn depends on that of the disc below.
    below: Vec<Matrix3<f64>>,
    /// The same for each slot's partial sum.
    partial: Vec<Vector3<f64>>,
    /// The columns, as in [`Expansion::slopes`].
    slopes: Vec<Vector3<f64>>,
    /// The pivot that first was not positive, from the tip: its joint, and the eigenvector of its
    /// smallest eigenvalue.
    negative: Option<(usize, Vector3<f64>)>,
    /// Largest trace of a positive pivot's inverse (rad/(N m)).
    softest: f64,
    /// Largest trace of a pivot (N m/rad).
    largest: f64,
}

/// Calls a method with the smallest compiled number of slots that is large enough. Compiling has seen
/// to it that there are at most 64.
macro_rules! with_slots {
    ($self:ident . $method:ident ( $($argument:expr),* )) => {
        match $self.columns.slots {
            0..=3 => $self.$method::<3>($($argument),*),
            4..=6 => $self.$method::<6>($($argument),*),
            7..=9 => $self.$method::<9>($($argument),*),
            10..=15 => $self.$method::<15>($($argument),*),
            16..=32 => $self.$method::<32>($($argument),*),
            _ => $self.$method::<64>($($argument),*),
        }
    };
}

impl Factor {
    /// Storage for the factor of a Hessian like that of `expansion`.
    pub fn new(expansion: &Expansion) -> Self {
        let n = expansion.joint_blocks.len();
        let columns = expansion.columns.clone();
        Self {
            pivots: vec![Matrix3::zeros(); n],
            below: vec![Matrix3::zeros(); n],
            partial: vec![Vector3::zeros(); n * columns.slots],
            slopes: vec![Vector3::zeros(); n * columns.slots],
            negative: None,
            softest: 0.0,
            largest: 0.0,
            columns,
        }
    }

    /// Factorises the Hessian of `expansion`, with `stiffness` (N m/rad) added to every joint, which
    /// shifts its eigenvalues by as much. Where it is not positive definite, the pivots' negative
    /// eigenvalues change their sign (eigenvalue modification: Nocedal and Wright, Numerical Optimization,
    /// ch. 3.4), so that solving still gives a direction of descent.
    pub fn factorise(&mut self, expansion: &Expansion, stiffness: f64) -> Curvature {
        self.slopes.copy_from_slice(&expansion.slopes);
        with_slots!(self.eliminate(expansion, stiffness))
    }

    fn eliminate<const A: usize>(&mut self, expansion: &Expansion, stiffness: f64) -> Curvature {
        let slots = self.columns.slots;
        self.negative = None;
        (self.softest, self.largest) = (0.0, 0.0);
        // The quadratic of what lies above: by turn and turn, partial sum and turn, sum and sum.
        let mut turns = Matrix3::zeros();
        let mut moment = Vector3::zeros();
        let mut mixed = [Vector3::zeros(); A];
        let mut sums = [[0.0; A]; A];
        for joint in (0..self.pivots.len()).rev() {
            // This disc's own terms, and the columns that start here.
            turns += expansion.disc_blocks[joint];
            moment += expansion.disc_gradient[joint];
            for &column in &self.columns.top[joint] {
                let slot = self.columns.slot[column];
                sums[slot][slot] = expansion.weights[column];
            }
            let mut slopes = [Vector3::zeros(); A];
            slopes[..slots].copy_from_slice(&self.slopes[joint * slots..][..slots]);
            // How a turn of this joint couples to the turn below and to the partial sums: it adds itself to
            // `Omega`, and its slopes to the sums.
            let mut below = turns;
            let mut partial = mixed;
            for s in 0..A {
                below += mixed[s] * slopes[s].transpose();
                for r in 0..A {
                    partial[s] += slopes[r] * sums[s][r];
                }
            }
            // The pivot: the joint's own block, and the quadratic along its turn.
            let mut pivot = expansion.joint_blocks[joint] + below;
            for axis in 0..3 {
                pivot[(axis, axis)] += stiffness;
            }
            for s in 0..A {
                pivot += slopes[s] * partial[s].transpose();
            }
            let inverse = match expansion.hinges(joint) {
                None => self.inverse_near(joint, &pivot),
                Some(hinges) => self.inverse_of_hinges(joint, &pivot, hinges, expansion, &moment),
            };
            // The quadratic with this turn at its minimiser (Schur complement).
            below += noncommuting(&moment);
            let reduced = inverse * below.transpose();
            turns -= below * reduced;
            for s in 0..A {
                let eased = inverse * partial[s];
                mixed[s] -= below * eased;
                for r in 0..=s {
                    sums[s][r] -= eased.dot(&partial[r]);
                    sums[r][s] = sums[s][r];
                }
            }
            // Columns that end here: their slots are free.
            for &column in &self.columns.bottom[joint] {
                let slot = self.columns.slot[column];
                mixed[slot] = Vector3::zeros();
                for r in 0..A {
                    sums[slot][r] = 0.0;
                    sums[r][slot] = 0.0;
                }
            }
            self.pivots[joint] = inverse;
            self.below[joint] = below;
            self.partial[joint * slots..][..slots].copy_from_slice(&partial[..slots]);
        }
        self.curvature()
    }

    /// The inverse of a joint's pivot; of a positive definite matrix near it where it is not one itself.
    #[inline(always)]
    fn inverse_near(&mut self, joint: usize, pivot: &Matrix3<f64>) -> Matrix3<f64> {
        self.largest = self.largest.max(pivot.trace().abs());
        if let Some(inverse) = invert_positive(pivot) {
            self.softest = self.softest.max(inverse.trace());
            return inverse;
        }
        let (inverse, eigenvector) = invert_reflected(pivot);
        self.negative.get_or_insert((joint, eigenvector));
        inverse
    }

    /// The same of hinges, which turn about their axes alone, and whose second derivatives are those along the angles. Out of the loop,
    /// which is of ball joints nearly always.
    #[cold]
    #[inline(never)]
    fn inverse_of_hinges(
        &mut self,
        joint: usize,
        pivot: &Matrix3<f64>,
        hinges: &HingeAxes,
        expansion: &Expansion,
        moment: &Vector3<f64>,
    ) -> Matrix3<f64> {
        let curving = hinges.curving(&(expansion.joint_gradient[joint] + moment));
        let pivot = hinges.confine(&(pivot + curving));
        hinges.release(&self.inverse_near(joint, &pivot))
    }

    /// What [`Factor::factorise`] last found.
    pub fn curvature(&self) -> Curvature {
        match self.negative {
            None => Curvature::Positive,
            Some(_) => Curvature::Modified,
        }
    }

    /// Lower bound of the eigenvalues of the positive pivots (N m/rad): none of the inverses' is above the trace.
    fn smallest(&self) -> f64 {
        1.0 / self.softest
    }

    /// Whether the Hessian of `expansion` is positive definite beyond rounding, where
    /// [`Factor::factorise`] without stiffness has just been called for it. `resolution` (N m/rad) is a
    /// curvature that is not told from zero whatever the rounding.
    ///
    /// The factor is then that of the Hessian; where it is not positive definite, of the Hessian with
    /// all eigenvalues raised by the margin.
    pub fn definiteness(&mut self, expansion: &Expansion, resolution: f64) -> Definiteness {
        let curvature = self.curvature();
        // The smallest pivot may exceed the smallest eigenvalue by as much as there are turns, where the mode is spread evenly.
        let turns = 3.0 * self.pivots.len() as f64;
        if curvature == Curvature::Positive
            && self.smallest() > turns * resolution.max(MARGIN * self.largest)
        {
            return Definiteness::Positive;
        }
        let margin = resolution.max(MARGIN * expansion.scale());
        let positive = curvature == Curvature::Positive
            && self.factorise(expansion, -margin) == Curvature::Positive;
        if positive {
            self.factorise(expansion, 0.0);
            return Definiteness::Positive;
        }
        match self.factorise(expansion, margin) {
            Curvature::Positive => Definiteness::Semidefinite,
            Curvature::Modified => Definiteness::Indefinite,
        }
    }

    /// Writes turns of the joints to `step` (world axes) along which the quadratic form of the
    /// factorised matrix is negative, a direction of negative curvature (Nocedal and Wright, Numerical
    /// Optimization, ch. 3.4): the eigenvector of the first pivot that is not positive, with the distal
    /// joints at their minimisers. These have positive pivots, so the form's value is that of the pivot
    /// alone. Writes zeros if there is no such pivot.
    pub fn negative_curvature(&self, step: &mut [Vector3<f64>]) {
        match self.negative {
            Some((joint, eigenvector)) => with_slots!(self.follow(joint, &eigenvector, step)),
            None => step.fill(Vector3::zeros()),
        }
    }

    fn follow<const A: usize>(
        &self,
        start: usize,
        first: &Vector3<f64>,
        step: &mut [Vector3<f64>],
    ) {
        let slots = self.columns.slots;
        step.fill(Vector3::zeros());
        let mut turn = Vector3::zeros();
        let mut sums = [0.0; A];
        for joint in start..self.pivots.len() {
            let slopes = &self.slopes[joint * slots..][..slots];
            // The turn given, or the minimiser for what lies below.
            let own = if joint == start {
                *first
            } else {
                let partial = &self.partial[joint * slots..][..slots];
                let terms = partial
                    .iter()
                    .zip(&sums)
                    .map(|(partial, sum)| partial * *sum);
                -(self.pivots[joint]
                    * (self.below[joint].tr_mul(&turn) + terms.sum::<Vector3<f64>>()))
            };
            // What the joints above see of it.
            turn += own;
            for (slope, sum) in slopes.iter().zip(&mut sums) {
                *sum += slope.dot(&own);
            }
            for &column in &self.columns.top[joint] {
                sums[self.columns.slot[column]] = 0.0;
            }
            step[joint] = own;
        }
    }

    /// Writes `-H⁻¹ g` to `step`: the joints' turns in world axes (rad), for the gradient of
    /// `joint` terms and `disc` terms as in [`Expansion`].
    pub fn descend(
        &self,
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        step: &mut [Vector3<f64>],
    ) {
        self.solve(joint, disc, step);
        step.iter_mut().for_each(|turn| *turn = -*turn);
    }

    /// Writes `H⁻¹ r` to `solution`, for a right-hand side of `joint` terms and `disc` terms as in
    /// [`Expansion`].
    pub fn solve(
        &self,
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        solution: &mut [Vector3<f64>],
    ) {
        with_slots!(self.substitute(joint, disc, solution));
    }

    fn substitute<const A: usize>(
        &self,
        joint_terms: &[Vector3<f64>],
        disc_terms: &[Vector3<f64>],
        solution: &mut [Vector3<f64>],
    ) {
        let slots = self.columns.slots;
        let n = self.pivots.len();
        // From the tip to the base: the right-hand side with the joints above eliminated.
        let mut by_turn = Vector3::zeros();
        let mut by_sum = [0.0; A];
        for joint in (0..n).rev() {
            by_turn += disc_terms[joint];
            let slopes = &self.slopes[joint * slots..][..slots];
            let partial = &self.partial[joint * slots..][..slots];
            let mut moment = joint_terms[joint] + by_turn;
            for (slope, sum) in slopes.iter().zip(&by_sum) {
                moment += slope * *sum;
            }
            let eased = self.pivots[joint] * moment;
            by_turn -= self.below[joint] * eased;
            for (sum, partial) in by_sum.iter_mut().zip(partial) {
                *sum -= partial.dot(&eased);
            }
            for &column in &self.columns.bottom[joint] {
                by_sum[self.columns.slot[column]] = 0.0;
            }
            solution[joint] = moment;
        }
        // From the base to the tip: each turn, given those below.
        let mut turn = Vector3::zeros();
        let mut sums = [0.0; A];
        for joint in 0..n {
            let slopes = &self.slopes[joint * slots..][..slots];
            let partial = &self.partial[joint * slots..][..slots];
            let mut moment = solution[joint] - self.below[joint].tr_mul(&turn);
            for (partial, sum) in partial.iter().zip(&sums) {
                moment -= partial * *sum;
            }
            let own = self.pivots[joint] * moment;
            turn += own;
            for (slope, sum) in slopes.iter().zip(&mut sums) {
                *sum += slope.dot(&own);
            }
            for &column in &self.columns.top[joint] {
                sums[self.columns.slot[column]] = 0.0;
            }
            solution[joint] = own;
        }
    }
}

/// Inverse of a symmetric matrix, by its factors `L D L'` (Golub and Van Loan, Matrix Computations, ch. 4.1), if it
/// is positive definite beyond rounding.
fn invert_positive(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let (a, b, c) = (m[(0, 0)], m[(0, 1)], m[(0, 2)]);
    let (d, e, f) = (m[(1, 1)], m[(1, 2)], m[(2, 2)]);
    // Pivots below this are rounding.
    let floor = f64::EPSILON * (a.abs() + d.abs() + f.abs());
    // Entries of `L`, and `D`.
    let first = 1.0 / a;
    let (l10, l20) = (b * first, c * first);
    let second_pivot = d - l10 * b;
    let second = 1.0 / second_pivot;
    let below = e - l10 * c;
    let l21 = below * second;
    let third_pivot = f - l20 * c - l21 * below;
    if !(a > floor && second_pivot > floor && third_pivot > floor) {
        return None;
    }
    let third = 1.0 / third_pivot;
    // Rows of the inverse of `L`: (1), (-l10, 1), (r, -l21, 1).
    let r = l10 * l21 - l20;
    let (zx, zy) = (r * third, -l21 * third);
    let (yx, yy) = (zy * r - l10 * second, second - l21 * zy);
    let xx = first - l10 * (-l10 * second) + r * zx;
    Some(Matrix3::new(xx, yx, zx, yx, yy, zy, zx, zy, third))
}

/// Inverse of a symmetric matrix with its eigenvalues made positive, and the eigenvector of the
/// smallest one. The inverse of zero is zero.
fn invert_reflected(m: &Matrix3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
    let (eigenvalues, vectors) = eigen(m);
    let largest = eigenvalues.amax();
    let inverse = eigenvalues.map(|value| {
        let size = value.abs().max(1e-6 * largest);
        if size > f64::MIN_POSITIVE {
            1.0 / size
        } else {
            0.0
        }
    });
    (
        vectors * Matrix3::from_diagonal(&inverse) * vectors.transpose(),
        vectors.column(eigenvalues.imin()).into_owned(),
    )
}
