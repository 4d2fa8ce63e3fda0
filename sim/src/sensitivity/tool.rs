//! Derivatives of frames fixed to discs.

use nalgebra::{DMatrix, Matrix6, MatrixXx6};

use super::{Sensitivity, SensitivityError};
use crate::pose::ToolFrame;
use crate::robot::{Axis, Parameter};

impl Sensitivity {
    /// Jacobian of a tool frame by `parameters`: six rows, its origin (m) and its rotation (rad) in the world.
    ///
    /// # Errors
    /// [`SensitivityError::Parameter`] for one that the robot does not have.
    ///
    /// # Panics
    /// For a frame on a disc that the robot does not have.
    pub fn tool_jacobian(
        &self,
        tool: &ToolFrame,
        parameters: &[Parameter],
    ) -> Result<DMatrix<f64>, SensitivityError> {
        let discs = self.jacobian(parameters)?;
        let of_disc: MatrixXx6<f64> = discs.fixed_rows::<6>(6 * tool.disc).transpose();
        let moved = of_disc * self.shift(tool).transpose();
        Ok(DMatrix::from_fn(6, parameters.len(), |row, column| {
            moved[(column, row)]
        }))
    }

    /// Compliance of a tool frame: how its origin (m) and rotation (rad) move with a force (N) and a moment (N m) on its
    /// origin that keep their direction; all in world axes. Of the tip's frame, the tip's compliance. It is symmetric where
    /// the loads have a potential.
    ///
    /// # Errors
    /// [`SensitivityError::Parameter`] for a frame on a disc that the robot does not have.
    pub fn compliance(&self, tool: &ToolFrame) -> Result<Matrix6<f64>, SensitivityError> {
        let axes = Axis::ALL;
        let forces = axes.map(|axis| Parameter::Force(tool.disc, axis));
        let moments = axes.map(|axis| Parameter::Moment(tool.disc, axis));
        let jacobian = self.jacobian(&[forces, moments].concat())?;
        let of_disc: Matrix6<f64> = jacobian
            .fixed_rows::<6>(6 * tool.disc)
            .fixed_columns::<6>(0)
            .into();
        // A force on the frame's origin is that on the disc's, and its moment about it.
        let shift = self.shift(tool);
        Ok(shift * of_disc * shift.transpose())
    }

    /// What takes a disc's motion to that of a frame on it.
    fn shift(&self, tool: &ToolFrame) -> Matrix6<f64> {
        let arm = self.posture.chain.disc(tool.disc) * tool.in_disc.translation.vector;
        let mut shift = Matrix6::identity();
        let mut levers = shift.fixed_view_mut::<3, 3>(0, 3);
        levers.copy_from(&-arm.cross_matrix());
        shift
    }
}
