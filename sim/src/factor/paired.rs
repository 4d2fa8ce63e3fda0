//! Solving where discs press each other: a chain's factors, and columns for the pairs.
//!
//! A pair adds up to three columns of rank one to the Hessian: one along its axis (of points that press each other apart the line between
//! them), two across it, each with the joints' turns in the displacement of one point from the other. With the chain's
//! part `A`, the columns `B` and their stiffnesses `D`, `(A + B D B')⁻¹ = A⁻¹ - A⁻¹ B (D⁻¹ + B' A⁻¹ B)⁻¹ B' A⁻¹` (Golub and Van
//! Loan, Matrix Computations, ch. 2.1.4), in O(n) for each pair. The matrix in the middle also tells how many eigenvalues are
//! negative (Haynsworth, Determination of the inertia of a partitioned Hermitian matrix, 1968).

use std::cmp::Ordering;

use faer::linalg::solvers::{Lblt, Solve};
use faer::{Mat, Side as Triangle};
use nalgebra::Vector3;

use super::Curvature;
use super::krylov::dot;
use super::symmetric::ChainLdl;
use super::unsymmetric::ChainMatrix;
use crate::energy::{Expansion, Pair};

/// A stiffness (N/m) below this share of the Hessian's size, with the chain's length as lever, changes nothing that is not rounding
/// elsewhere: beads near each other that a barrier hardly presses.
const NEGLIGIBLE: f64 = 1e-10;

/// Factors of a symmetric matrix.
#[derive(Clone, Debug)]
pub(crate) struct PairedLu {
    chain: ChainLdl,
    columns: Vec<Vec<Vector3<f64>>>,
    /// `A⁻¹ B`.
    responses: Vec<Vec<Vector3<f64>>>,
    /// `D⁻¹ + B' A⁻¹ B`.
    middle: Option<Lblt<f64>>,
}

impl PairedLu {
    /// Storage for factors of matrices with Hessians like that of `expansion`.
    pub fn new(expansion: &Expansion) -> Self {
        Self {
            chain: ChainLdl::new(expansion),
            columns: Vec::new(),
            responses: Vec::new(),
            middle: None,
        }
    }

    /// Factorises the matrix, which is symmetric, with what the pairs add. [`Curvature::Positive`] where that is positive definite;
    /// `None` if a pivot has no inverse.
    pub fn factorise(&mut self, matrix: &ChainMatrix, pairs: &[Pair]) -> Option<Curvature> {
        self.columns.clear();
        self.responses.clear();
        self.middle = None;
        let curvature = self.chain.factorise(matrix)?;
        if pairs.is_empty() {
            return Some(curvature);
        }
        let mut stiffnesses = Vec::new();
        let least = NEGLIGIBLE * matrix.expansion.scale() / self.chain.reach().powi(2);
        for pair in pairs {
            self.add_columns(pair, matrix.centres, least, &mut stiffnesses);
        }
        if stiffnesses.is_empty() {
            return Some(curvature);
        }
        let none = vec![Vector3::zeros(); matrix.centres.len()];
        for column in &self.columns {
            let mut response = none.clone();
            (self.chain).solve(column, &none, &mut response);
            self.responses.push(response);
        }
        let (count, columns, responses) = (stiffnesses.len(), &self.columns, &self.responses);
        let middle = Mat::from_fn(count, count, |i, j| match i.cmp(&j) {
            Ordering::Less => 0.0,
            Ordering::Equal => stiffnesses[i].recip() + dot(&columns[i], &responses[i]),
            Ordering::Greater => dot(&columns[i], &responses[j]),
        });
        let middle = middle.lblt(Triangle::Lower);
        let stiffening = stiffnesses.iter().filter(|&&value| value > 0.0).count();
        // Of the matrix as many eigenvalues are negative as of the chain's part, and as of the middle more are positive than of `D`.
        let negative = self.chain.negative_eigenvalues() + positive_eigenvalues(&middle);
        self.middle = Some(middle);
        Some(match negative == stiffening {
            true => Curvature::Positive,
            false => Curvature::Modified,
        })
    }

    /// Writes the solution for a right-hand side of `joint` terms and terms of the `disc`s' turns, as in [`Expansion`].
    pub fn solve(
        &self,
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        solution: &mut [Vector3<f64>],
    ) {
        self.chain.solve(joint, disc, solution);
        let Some(middle) = &self.middle else {
            return;
        };
        let along = Mat::from_fn(self.columns.len(), 1, |i, _| {
            dot(&self.columns[i], solution)
        });
        let shares = middle.solve(&along);
        for (i, response) in self.responses.iter().enumerate() {
            for (turn, response) in solution.iter_mut().zip(response) {
                *turn -= response * shares[(i, 0)];
            }
        }
    }

    /// The columns of a pair: how a joint's turn displaces its first point from the second, along each of three directions.
    /// Those with less than the `least` stiffness (N/m) are left out.
    fn add_columns(
        &mut self,
        pair: &Pair,
        centres: &[Vector3<f64>],
        least: f64,
        stiffnesses: &mut Vec<f64>,
    ) {
        let [along, across] = pair.stiffness;
        let axis = pair.axis;
        let other = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
        let directions = [(axis, along), (other, across), (axis.cross(&other), across)];
        let [first, second] = &pair.points;
        for (direction, stiffness) in directions {
            if stiffness.abs() <= least {
                continue;
            }
            let lever = |disc: usize, point: Vector3<f64>, joint: usize| match joint <= disc {
                true => (point - centres[joint]).cross(&direction),
                false => Vector3::zeros(),
            };
            let column = (0..centres.len()).map(|joint| {
                lever(first.disc, first.position, joint)
                    - lever(second.disc, second.position, joint)
            });
            self.columns.push(column.collect());
            stiffnesses.push(stiffness);
        }
    }
}

/// How many eigenvalues of a symmetric matrix are positive: as many as of the blocks of its Bunch-Kaufman factors.
fn positive_eigenvalues(factors: &Lblt<f64>) -> usize {
    let diagonal = factors.B_diag().column_vector();
    let below = factors.B_subdiag().column_vector();
    let (mut row, mut positive) = (0, 0);
    while row < diagonal.nrows() {
        let coupled = if row + 1 < diagonal.nrows() {
            below[row]
        } else {
            0.0
        };
        if coupled == 0.0 {
            positive += usize::from(diagonal[row] > 0.0);
            row += 1;
            continue;
        }
        let (first, second) = (diagonal[row], diagonal[row + 1]);
        let determinant = first * second - coupled * coupled;
        positive += match determinant < 0.0 {
            true => 1,
            false => 2 * usize::from(first + second > 0.0),
        };
        row += 2;
    }
    positive
}
