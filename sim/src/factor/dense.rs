//! Factors of dense matrices of the joints' turns: where elimination along the chain is not accurate, or not made for the matrix.

use faer::Mat;
use faer::linalg::solvers::{PartialPivLu, Solve};
use nalgebra::Vector3;

use super::Side;
use crate::robot::HingeAxes;

/// LU factors, rows exchanged, of a matrix that is [confined](crate::energy::Expansion::confine).
#[derive(Clone, Debug)]
pub(crate) struct DenseLu {
    lu: PartialPivLu<f64>,
    /// The axes of hinges where the matrix is of.
    hinges: Vec<Option<HingeAxes>>,
}

impl DenseLu {
    /// Factorises a matrix of robots with these hinges.
    pub fn new(matrix: &Mat<f64>, hinges: &[Option<HingeAxes>]) -> Self {
        Self {
            lu: matrix.partial_piv_lu(),
            hinges: hinges.to_vec(),
        }
    }

    /// Writes the joints' turns (rad) for a moment on each (N m).
    pub fn solve(&self, moments: &[Vector3<f64>], side: Side, turns: &mut [Vector3<f64>]) {
        let rhs = Mat::from_fn(3 * moments.len(), 1, |i, _| moments[i / 3][i % 3]);
        let found = match side {
            Side::Matrix => self.lu.solve(&rhs),
            Side::Transpose => self.lu.solve_transpose(&rhs),
        };
        for (joint, turn) in turns.iter_mut().enumerate() {
            *turn = Vector3::from_fn(|axis, _| found[(3 * joint + axis, 0)]);
        }
        project(&self.hinges, turns);
    }
}

/// Leaves of turns or moments of the joints what is along turns that hinges allow.
pub(crate) fn project(hinges: &[Option<HingeAxes>], vectors: &mut [Vector3<f64>]) {
    for (vector, hinges) in vectors.iter_mut().zip(hinges) {
        if let Some(hinges) = hinges {
            *vector = hinges.project(vector);
        }
    }
}
