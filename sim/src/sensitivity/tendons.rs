//! Derivatives of the tendons' lengths and tensions.

use nalgebra::DMatrix;

use super::{Sensitivity, SensitivityError, dot};
use crate::factor::Side;
use crate::model_tangent::ModelTangent;
use crate::robot::Parameter;

/// How an equilibrium's tendons change: [`Sensitivity::tendon_jacobians`]. One row per tendon, one column per parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct TendonJacobians {
    /// Of the lengths (m).
    pub lengths: DMatrix<f64>,
    /// Of the tensions (N); 0 for a slack tendon.
    pub tensions: DMatrix<f64>,
}

impl Sensitivity {
    /// Jacobians of the tendons' lengths (m) and tensions (N) by `parameters`.
    ///
    /// With the joints' turns `dq`, a length changes by `dL = (dL)_model + a . dq`, `a` its gradient; a tension by the law of
    /// its tendon, or where the length is commanded by the multiplier of that constraint.
    ///
    /// # Errors
    /// [`SensitivityError::Parameter`] for one that the robot does not have, and for two that overlap
    /// ([`RobotSpec::check_parameters`](crate::robot::RobotSpec::check_parameters)).
    pub fn tendon_jacobians(
        &self,
        parameters: &[Parameter],
    ) -> Result<TendonJacobians, SensitivityError> {
        self.robot.spec().check_parameters(parameters)?;
        let tendons = self.robot.tendons().len();
        let columns = self.expansion.dense_columns();
        let mut jacobians = TendonJacobians {
            lengths: DMatrix::zeros(tendons, parameters.len()),
            tensions: DMatrix::zeros(tendons, parameters.len()),
        };
        for (column, &parameter) in parameters.iter().enumerate() {
            let tangent = ModelTangent::new(&self.robot, &self.loads, parameter)?;
            let mut change = self.expanded().gradient_tangent(&tangent);
            self.press(&tangent, &mut change.disc);
            let growth: Vec<f64> = (self.held.tendons.iter())
                .map(|&t| change.lengths[t] - tangent.command[t])
                .collect();
            let (turns, multipliers) =
                self.solve(&change.joint, &change.disc, &growth, Side::Matrix);
            // The joints make the opposite of the turns that balance the change.
            let lengths: Vec<f64> = (change.lengths.iter().zip(&columns))
                .map(|(explicit, (_, slope))| explicit - dot(slope, &turns))
                .collect();
            let mut tensions = self.expanded().pull(&tangent, &lengths);
            for (&t, multiplier) in self.held.tendons.iter().zip(multipliers) {
                tensions[t] -= multiplier;
            }
            jacobians.lengths.set_column(column, &lengths.into());
            jacobians.tensions.set_column(column, &tensions.into());
        }
        Ok(jacobians)
    }
}
