//! Solving where discs press each other: a chain's factors, and columns for the pairs.
//!
//! The force between two points acts along the line between them, so a pair adds three columns of rank one to the Hessian: one
//! along that line, two across it, each with the joints' turns in the displacement of one point from the other. With the chain's
//! part `A`, the columns `B` and their stiffnesses `D`, `(A + B D B')⁻¹ = A⁻¹ - A⁻¹ B (D⁻¹ + B' A⁻¹ B)⁻¹ B' A⁻¹` (Golub and Van
//! Loan, Matrix Computations, ch. 2.1.4), in O(n) for each pair. The matrix in the middle also tells how many eigenvalues are
//! negative (Haynsworth, Determination of the inertia of a partitioned Hermitian matrix, 1968).

use faer::Mat;
use faer::linalg::solvers::{PartialPivLu, Solve};
use nalgebra::{DMatrix, Vector3};

use super::krylov::dot;
use super::unsymmetric::{ChainLu, ChainMatrix, Side};
use super::Curvature;
use crate::energy::{Expansion, Pair};

/// Factors of a symmetric matrix.
#[derive(Clone, Debug)]
pub(crate) struct PairedLu {
    chain: ChainLu,
    columns: Vec<Vec<Vector3<f64>>>,
    /// `A⁻¹ B`.
    responses: Vec<Vec<Vector3<f64>>>,
    /// `D⁻¹ + B' A⁻¹ B`.
    middle: Option<PartialPivLu<f64>>,
}

impl PairedLu {
    /// Storage for factors of matrices with Hessians like that of `expansion`.
    pub fn new(expansion: &Expansion) -> Self {
        Self {
            chain: ChainLu::new(expansion),
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
        for pair in pairs {
            self.add_columns(pair, matrix.centres, &mut stiffnesses);
        }
        let none = vec![Vector3::zeros(); matrix.centres.len()];
        for column in &self.columns {
            let mut response = none.clone();
            (self.chain).solve(column, &none, Side::Matrix, &mut response);
            self.responses.push(response);
        }
        let (count, columns, responses) = (stiffnesses.len(), &self.columns, &self.responses);
        let middle = DMatrix::from_fn(count, count, |i, j| {
            let own = if i == j { stiffnesses[i].recip() } else { 0.0 };
            own + dot(&columns[i], &responses[j])
        });
        self.middle = Some(Mat::from_fn(count, count, |i, j| middle[(i, j)]).partial_piv_lu());
        let eigenvalues = middle.symmetric_eigenvalues();
        let above = eigenvalues.iter().filter(|&&value| value > 0.0).count();
        let stiffening = stiffnesses.iter().filter(|&&value| value > 0.0).count();
        // Of the matrix as many eigenvalues are negative as of the chain's part, and as of the middle more are positive than of `D`.
        Some(match self.chain.negative_eigenvalues() + above == stiffening {
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
        self.chain.solve(joint, disc, Side::Matrix, solution);
        let Some(middle) = &self.middle else {
            return;
        };
        let along = Mat::from_fn(self.columns.len(), 1, |i, _| dot(&self.columns[i], solution));
        let shares = middle.solve(&along);
        for (i, response) in self.responses.iter().enumerate() {
            for (turn, response) in solution.iter_mut().zip(response) {
                *turn -= response * shares[(i, 0)];
            }
        }
    }

    /// The columns of a pair: how a joint's turn displaces its first point from the second, along each of three directions.
    fn add_columns(&mut self, pair: &Pair, centres: &[Vector3<f64>], stiffnesses: &mut Vec<f64>) {
        let [along, across] = pair.stiffness;
        let normal = pair.normal;
        let other = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
        let directions = [
            (normal, along),
            (other, across),
            (normal.cross(&other), across),
        ];
        let [first, second] = &pair.points;
        for (direction, stiffness) in directions {
            if stiffness == 0.0 {
                continue;
            }
            let lever = |disc: usize, point: Vector3<f64>, joint: usize| match joint <= disc {
                true => (point - centres[joint]).cross(&direction),
                false => Vector3::zeros(),
            };
            let column = (0..centres.len()).map(|joint| {
                lever(first.disc, first.position, joint) - lever(second.disc, second.position, joint)
            });
            self.columns.push(column.collect());
            stiffnesses.push(stiffness);
        }
    }
}
