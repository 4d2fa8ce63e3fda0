//! Solving under loads without a potential: in O(n) where the elimination without exchange of rows is accurate, dense where
//! it is not.

use faer::Mat;
use faer::linalg::solvers::{PartialPivLu, Solve};
use nalgebra::{Matrix3, Matrix6, Vector3};

use super::Curvature;
use super::unsymmetric::{ChainLu, ChainMatrix, Side};
use crate::energy::{Expansion, following};
use crate::robot::Loads;
use crate::tendon::Posture;

/// Error of a solution, as a share of the right-hand side, from which the elimination does not count as accurate.
const INACCURATE: f64 = 1e-9;

/// Factors of the Jacobian of the moments on the joints: that of [`following::jacobian`].
#[derive(Clone, Debug)]
pub(crate) enum LoadedFactor {
    /// By elimination along the chain.
    Chain(Box<ChainLu>),
    /// Of the dense matrix, rows exchanged.
    Dense(Box<PartialPivLu<f64>>),
}

impl LoadedFactor {
    /// Factorises the Jacobian under `share` of the loads, whose moments are in the gradient of `expansion`.
    pub fn new(loads: &Loads, share: f64, posture: &Posture, expansion: &Expansion) -> Self {
        let n = expansion.joint_blocks.len();
        let mut bodies = vec![Matrix6::zeros(); n];
        following::add_bodies(loads, share, posture, &mut bodies);
        let matrix = ChainMatrix {
            expansion,
            scale: 1.0,
            centres: &posture.chain.centres,
            joints: &vec![Matrix3::zeros(); n],
            bodies: &bodies,
        };
        let mut lu = Box::new(ChainLu::new(expansion));
        if lu.factorise(&matrix).is_some() && is_accurate(&lu, loads, share, posture, expansion) {
            return Self::Chain(lu);
        }
        let dense = following::jacobian(loads, share, posture, expansion);
        Self::Dense(Box::new(dense.partial_piv_lu()))
    }

    /// Writes the solution for a right-hand side of `joint` terms and `disc` terms as in [`Expansion`].
    pub fn solve(
        &self,
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        side: Side,
        solution: &mut [Vector3<f64>],
    ) {
        match self {
            Self::Chain(lu) => lu.solve(joint, disc, side, solution),
            Self::Dense(lu) => {
                // What acts on a disc turns all joints below it.
                let mut total = joint.to_vec();
                let mut above = Vector3::zeros();
                for (total, disc) in total.iter_mut().zip(disc).rev() {
                    above += disc;
                    *total += above;
                }
                let rhs = Mat::from_fn(3 * joint.len(), 1, |i, _| total[i / 3][i % 3]);
                let found = match side {
                    Side::Matrix => lu.solve(&rhs),
                    Side::Transpose => lu.solve_transpose(&rhs),
                };
                for (joint, turn) in solution.iter_mut().enumerate() {
                    *turn = Vector3::from_fn(|axis, _| found[(3 * joint + axis, 0)]);
                }
            }
        }
    }
}

/// Whether a solution with the factors, multiplied by the matrix, gives its right-hand side.
fn is_accurate(
    lu: &ChainLu,
    loads: &Loads,
    share: f64,
    posture: &Posture,
    expansion: &Expansion,
) -> bool {
    let n = expansion.joint_blocks.len();
    // A right-hand side without symmetries.
    let probe = |joint: usize| Vector3::new(1.0, -0.6, 0.3) * (1.0 + (joint as f64).sin());
    let rhs: Vec<_> = (0..n).map(probe).collect();
    let none = vec![Vector3::zeros(); n];
    let (mut solution, mut product) = (none.clone(), none.clone());
    lu.solve(&rhs, &none, Side::Matrix, &mut solution);
    expansion.product(&solution, &mut product);
    following::add_product(loads, share, posture, &solution, &mut product);
    // Not a number is not below.
    (product.iter().zip(&rhs)).all(|(found, wanted)| (found - wanted).norm() < INACCURATE)
}

/// Whether the symmetric part of the Jacobian has no eigenvalue below `margin` (N m/rad): then the real parts of the
/// Jacobian's own are above it, too (Bendixson; Horn and Johnson, Topics in Matrix Analysis, 1991, ch. 1.2). Takes O(n).
pub(crate) fn has_positive_part(
    loads: &Loads,
    posture: &Posture,
    expansion: &Expansion,
    margin: f64,
) -> bool {
    let n = expansion.joint_blocks.len();
    let mut bodies = vec![Matrix6::zeros(); n];
    following::add_bodies(loads, 1.0, posture, &mut bodies);
    for body in &mut bodies {
        *body = (*body + body.transpose()) * 0.5;
    }
    let matrix = ChainMatrix {
        expansion,
        scale: 1.0,
        centres: &posture.chain.centres,
        joints: &vec![Matrix3::identity() * -margin; n],
        bodies: &bodies,
    };
    ChainLu::new(expansion).factorise(&matrix) == Some(Curvature::Positive)
}
