//! The model about one command, to first order.

use nalgebra::{DMatrix, Matrix3xX, Vector3};
use tdcr_sim::inverse::recording::{Marker, Touch};
use tdcr_sim::robot::Parameter;
use tdcr_sim::sensitivity::Sensitivity;
use tdcr_sim::statics::Equilibrium;

use super::BeliefError;

/// The model about one command: where it rests, and how that changes with the command and the unknowns.
#[derive(Clone, Debug)]
pub struct Linear {
    /// Where it rests.
    pub equilibrium: Equilibrium,
    pub(super) sensitivity: Sensitivity,
    /// How the discs move with what the tendons get, where that is not the sensitivity's.
    pub(super) by_tendons: Option<DMatrix<f64>>,
    pub(super) parameters: Vec<Parameter>,
    /// From changes of the command to those of the parameters, and from those of the unknowns.
    pub(super) by_command: DMatrix<f64>,
    pub(super) by_unknowns: DMatrix<f64>,
}

impl Linear {
    /// Where a marker is (m, world frame).
    pub fn position(&self, marker: &Marker) -> Vector3<f64> {
        let disc = self.equilibrium.disc_pose(marker.disc);
        (disc * nalgebra::Point3::from(marker.place)).coords
    }

    /// Jacobians of markers' positions, three rows each (m), by the command and by the unknowns.
    ///
    /// # Errors
    /// [`BeliefError`] for a parameter that the robot does not have.
    pub fn marker_jacobians(&self, markers: &[Marker]) -> Result<[DMatrix<f64>; 2], BeliefError> {
        let discs = self.disc_jacobian()?;
        let mut rows = DMatrix::zeros(3 * markers.len(), self.parameters.len());
        for (place, marker) in markers.iter().enumerate() {
            let arm = self.equilibrium.orientations[marker.disc] * marker.place;
            let of_disc = discs.rows(6 * marker.disc, 6);
            for (column, change) in of_disc.column_iter().enumerate() {
                let position = Vector3::new(change[0], change[1], change[2]);
                let rotation = Vector3::new(change[3], change[4], change[5]);
                let moved = position + rotation.cross(&arm);
                rows.fixed_view_mut::<3, 1>(3 * place, column)
                    .copy_from(&moved);
            }
        }
        Ok([&rows * &self.by_command, &rows * &self.by_unknowns])
    }

    /// By how much the distances of points from the robot's surface, above 0 outside, shrink with the unknowns (m per unit): a row for
    /// each of the places nearest to them. It is exact, as the nearest place is a minimum of the distance (point to plane: Chen and
    /// Medioni, Image and Vision Computing 10, 1992).
    ///
    /// # Errors
    /// [`BeliefError`] for a parameter that the robot does not have.
    pub fn approaches(&self, touches: &[Touch]) -> Result<DMatrix<f64>, BeliefError> {
        let discs = self.disc_jacobian()? * &self.by_unknowns;
        let mut rows = DMatrix::zeros(touches.len(), self.by_unknowns.ncols());
        for (row, touch) in touches.iter().enumerate() {
            // What is fixed to the base does not move.
            let Some(disc) = touch.body else { continue };
            let arm = self.equilibrium.orientations[disc] * touch.in_body;
            let moment = arm.cross(&touch.normal);
            let along = discs.fixed_rows::<3>(6 * disc).tr_mul(&touch.normal);
            let about = discs.fixed_rows::<3>(6 * disc + 3).tr_mul(&moment);
            rows.set_row(row, &(along + about).transpose());
        }
        Ok(rows)
    }

    /// How the discs move with the parameters.
    fn disc_jacobian(&self) -> Result<DMatrix<f64>, BeliefError> {
        let mut discs = self.sensitivity.jacobian(&self.parameters)?;
        if let Some(by_tendons) = &self.by_tendons {
            discs
                .columns_mut(0, by_tendons.ncols())
                .copy_from(by_tendons);
        }
        Ok(discs)
    }

    /// Where the tip is (m), and its Jacobian by the command (m per m or N).
    pub fn tip(&self) -> (Vector3<f64>, Matrix3xX<f64>) {
        let tip = self.equilibrium.positions.len() - 1;
        let discs = match &self.by_tendons {
            Some(by_tendons) => by_tendons.clone(),
            None => self.sensitivity.command_jacobian(),
        };
        let tendons = discs.ncols();
        let scaled = discs.fixed_rows::<3>(6 * tip) * self.by_command.rows(0, tendons);
        (self.equilibrium.positions[tip], scaled)
    }

    /// Jacobians of the tensions (N) by the command and by the unknowns, and the same of the lengths (m).
    ///
    /// # Errors
    /// [`BeliefError`] for a parameter that the robot does not have.
    pub fn tendon_jacobians(&self) -> Result<[[DMatrix<f64>; 2]; 2], BeliefError> {
        let found = self.sensitivity.tendon_jacobians(&self.parameters)?;
        Ok([found.tensions, found.lengths]
            .map(|rows| [&rows * &self.by_command, &rows * &self.by_unknowns]))
    }
}
