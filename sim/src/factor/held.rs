//! Solving on the turns that keep commanded lengths.

use faer::Mat;
use faer::linalg::solvers::{PartialPivLu, Solve};
use nalgebra::Vector3;

use super::krylov::{dot, subtract};

/// Gradients of commanded lengths below this share of the largest are dependent on the others.
const DEPENDENT: f64 = 1e-10;

/// Orthonormal gradients of lengths that turns must keep, by joint.
#[derive(Clone, Debug, Default)]
pub(crate) struct HeldLengths(Vec<Vec<Vector3<f64>>>);

/// Solves with a matrix on the turns that keep the lengths: with the gradients `Q` and the matrix `J`,
/// `J⁻¹ r - J⁻¹ Q (Q' J⁻¹ Q)⁻¹ Q' J⁻¹ r` (null-space method: Nocedal and Wright, Numerical Optimization, ch. 16.2).
pub(crate) struct HeldSolver<'a, S> {
    held: &'a HeldLengths,
    solve: S,
    /// `J⁻¹ Q`.
    responses: Vec<Vec<Vector3<f64>>>,
    /// `Q' J⁻¹ Q`.
    compliance: Option<PartialPivLu<f64>>,
}

impl HeldLengths {
    /// The lengths of these `gradients`, which may depend on each other; `None` for numbers that are not finite.
    pub fn new(gradients: &[&[Vector3<f64>]]) -> Option<Self> {
        let Some(joints) = gradients.first().map(|gradient| gradient.len()) else {
            return Some(Self::default());
        };
        let matrix = Mat::from_fn(3 * joints, gradients.len(), |row, column| {
            gradients[column][row / 3][row % 3]
        });
        let svd = matrix.thin_svd().ok()?;
        let sizes = svd.S().column_vector();
        let rank = (0..sizes.nrows())
            .filter(|&i| sizes[i] > DEPENDENT * sizes[0])
            .count();
        let unit = |k: usize| {
            (0..joints)
                .map(|joint| Vector3::from_fn(|axis, _| svd.U()[(3 * joint + axis, k)]))
                .collect()
        };
        Some(Self((0..rank).map(unit).collect()))
    }

    /// By how many dimensions they are fewer.
    pub fn rank(&self) -> usize {
        self.0.len()
    }

    /// Takes away what would change the lengths.
    pub fn project(&self, turns: &mut [Vector3<f64>]) {
        for unit in &self.0 {
            let part = dot(unit, turns);
            subtract(turns, unit, part);
        }
    }

    /// The solver, given that with the matrix itself.
    pub fn solver<S: FnMut(&[Vector3<f64>], &mut [Vector3<f64>])>(
        &self,
        mut solve: S,
    ) -> HeldSolver<'_, S> {
        let responses: Vec<Vec<Vector3<f64>>> = (self.0.iter())
            .map(|unit| {
                let mut response = vec![Vector3::zeros(); unit.len()];
                solve(unit, &mut response);
                response
            })
            .collect();
        let compliance = (!self.0.is_empty()).then(|| {
            let entry = |i: usize, j: usize| dot(&self.0[i], &responses[j]);
            Mat::from_fn(self.rank(), self.rank(), entry).partial_piv_lu()
        });
        HeldSolver {
            held: self,
            solve,
            responses,
            compliance,
        }
    }
}

impl<S: FnMut(&[Vector3<f64>], &mut [Vector3<f64>])> HeldSolver<'_, S> {
    /// Writes the solution for a right-hand side.
    pub fn solve(&mut self, rhs: &[Vector3<f64>], solution: &mut [Vector3<f64>]) {
        (self.solve)(rhs, solution);
        let Some(compliance) = &self.compliance else {
            return;
        };
        let changes = Mat::from_fn(self.held.rank(), 1, |i, _| dot(&self.held.0[i], solution));
        let pulls = compliance.solve(&changes);
        for (i, response) in self.responses.iter().enumerate() {
            subtract(solution, response, pulls[(i, 0)]);
        }
        self.held.project(solution);
    }
}
