//! Solving under loads without a potential: in O(n) where the elimination without exchange of rows is accurate, dense where
//! it is not.

use nalgebra::{Matrix3, Matrix6, Vector3};

use super::Curvature;
use super::dense::{DenseLu, project};
use super::unsymmetric::{ChainLu, ChainMatrix, Side};
use crate::energy::{Expansion, following};
use crate::robot::Loads;
use crate::tendon::Posture;

/// Error of a solution, as a share of the right-hand side, from which the elimination does not count as accurate.
const INACCURATE: f64 = 1e-9;

/// The Jacobian of the moments on the joints under `share` of the loads, whose moments are in the gradient of `expansion`: that
/// of [`following::jacobian`].
#[derive(Clone, Copy)]
pub(crate) struct LoadedMatrix<'a> {
    pub loads: &'a Loads,
    pub share: f64,
    pub posture: &'a Posture,
    pub expansion: &'a Expansion,
}

/// Factors of a [`LoadedMatrix`].
#[derive(Clone, Debug)]
pub(crate) enum LoadedFactor {
    /// By elimination along the chain.
    Chain(Box<ChainLu>),
    /// Of the dense matrix.
    Dense(Box<DenseLu>),
}

impl LoadedMatrix<'_> {
    pub fn joints(&self) -> usize {
        self.expansion.joint_blocks.len()
    }

    /// Size of the Hessian's blocks and of those that the loads add (N m/rad), from above.
    pub fn scale(&self) -> f64 {
        let centres = &self.posture.chain.centres;
        let bodies = self.bodies();
        let sizes = bodies.iter().zip(centres).map(|(body, centre)| {
            let (turn, force) = (body.fixed_view::<3, 3>(0, 0), body.fixed_view::<3, 3>(3, 0));
            turn.norm() + force.norm() * (centre - centres[0]).norm()
        });
        self.expansion.scale() + sizes.sum::<f64>()
    }

    fn bodies(&self) -> Vec<Matrix6<f64>> {
        let mut bodies = vec![Matrix6::zeros(); self.joints()];
        following::add_bodies(self.loads, self.share, self.posture, &mut bodies);
        bodies
    }

    fn factorise(
        &self,
        bodies: &[Matrix6<f64>],
        stiffness: f64,
        lu: &mut ChainLu,
    ) -> Option<Curvature> {
        lu.factorise(&ChainMatrix {
            expansion: self.expansion,
            scale: 1.0,
            centres: &self.posture.chain.centres,
            joints: &vec![Matrix3::identity() * stiffness; self.joints()],
            bodies,
        })
    }

    /// Its factors with `stiffness` (N m/rad) added to every joint, in O(n); `None` where the elimination without exchange of
    /// rows is not accurate.
    pub fn chain_lu(&self, stiffness: f64) -> Option<ChainLu> {
        let mut lu = ChainLu::new(self.expansion);
        self.factorise(&self.bodies(), stiffness, &mut lu)?;
        self.is_accurate(stiffness, &lu).then_some(lu)
    }

    /// Whether a solution with the factors, multiplied by the matrix, gives its right-hand side.
    fn is_accurate(&self, stiffness: f64, lu: &ChainLu) -> bool {
        // A right-hand side without symmetries.
        let probe = |joint: usize| Vector3::new(1.0, -0.6, 0.3) * (1.0 + (joint as f64).sin());
        let mut rhs: Vec<_> = (0..self.joints()).map(probe).collect();
        project(&self.expansion.hinges, &mut rhs);
        let none = vec![Vector3::zeros(); self.joints()];
        let (mut solution, mut product) = (none.clone(), none.clone());
        lu.solve(&rhs, &none, Side::Matrix, &mut solution);
        self.expansion.product(&solution, &mut product);
        following::add_product(
            self.loads,
            self.share,
            self.posture,
            &solution,
            &mut product,
        );
        project(&self.expansion.hinges, &mut product);
        let found = product
            .iter()
            .zip(&solution)
            .map(|(p, s)| p + s * stiffness);
        // Not a number is not below.
        (found.zip(&rhs)).all(|(found, wanted)| (found - wanted).norm() < INACCURATE)
    }

    /// Whether the symmetric part has no eigenvalue below `margin` (N m/rad): then the real parts of the matrix's own are above
    /// it, too (Bendixson; Horn and Johnson, Topics in Matrix Analysis, 1991, ch. 1.2). Takes O(n).
    pub fn has_positive_part(&self, margin: f64) -> bool {
        let mut bodies = self.bodies();
        for body in &mut bodies {
            *body = (*body + body.transpose()) * 0.5;
        }
        let mut lu = ChainLu::new(self.expansion);
        self.factorise(&bodies, -margin, &mut lu) == Some(Curvature::Positive)
    }
}

impl LoadedFactor {
    pub fn new(matrix: &LoadedMatrix) -> Self {
        if let Some(lu) = matrix.chain_lu(0.0) {
            return Self::Chain(Box::new(lu));
        }
        let LoadedMatrix {
            loads,
            share,
            posture,
            expansion,
        } = *matrix;
        let dense = following::jacobian(loads, share, posture, expansion);
        Self::Dense(Box::new(DenseLu::new(&dense, &expansion.hinges)))
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
                lu.solve(&total, side, solution);
            }
        }
    }
}
