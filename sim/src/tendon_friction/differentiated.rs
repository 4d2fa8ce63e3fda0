//! Where a path comes to, by the command that it is led to.

use nalgebra::{DMatrix, Vector3};

use super::{ContactPath, FrictionPath, Tangents};
use crate::contact::ContactError;
use crate::robot::{Command, Loads};

impl ContactPath {
    /// Leads the robot as [`advance`](Self::advance) does, and says how the discs where it comes to move with the command: shape
    /// (6 discs, tendons), rows and units as of [`Sensitivity::command_jacobian`](crate::sensitivity::Sensitivity::command_jacobian). What was before is
    /// given. The derivative is that of the way that was taken, each contact sticking or slipping as it does there: on the way back it is another
    /// one, as contacts that slipped stick first.
    ///
    /// `None` among obstacles, and for a robot with tendons that pass discs by.
    ///
    /// # Errors
    /// As [`advance`](Self::advance).
    ///
    /// # Panics
    /// As [`advance`](Self::advance).
    pub fn advance_differentiated(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<Option<DMatrix<f64>>, ContactError> {
        let tendons = self.robot().tendons().len();
        let mut tangents = match self.path.touching {
            None => Tangents::new(self.robot(), vec![None; tendons]),
            Some(_) => None,
        };
        if let Some(tangents) = &mut tangents {
            let unit = |of: usize| (0..tendons).map(|t| f64::from(t == of)).collect();
            tangents.aim((0..tendons).map(unit));
        }
        self.path.tangents = tangents;
        let led = self.advance(command, loads).map(|_| ());
        let tangents = self.path.tangents.take();
        led?;
        Ok(tangents.map(|tangents| jacobian(&self.path, &tangents)))
    }
}

/// Motions of the discs by each change of `tangents`, where `path` stands.
fn jacobian(path: &FrictionPath, tangents: &Tangents) -> DMatrix<f64> {
    let chain = &path.balance.iterate.posture.chain;
    let (discs, tendons) = (path.robot().discs().len(), path.robot().tendons().len());
    let mut jacobian = DMatrix::zeros(6 * discs, tendons);
    for t in 0..tendons {
        let turns = tangents.turns(t);
        for disc in 0..discs {
            let place = chain.positions[disc];
            let (mut moved, mut turned) = (Vector3::zeros(), Vector3::zeros());
            for (turn, centre) in turns.iter().zip(&chain.centres).take(disc + 1) {
                moved += turn.cross(&(place - centre));
                turned += turn;
            }
            (jacobian.fixed_view_mut::<3, 1>(6 * disc, t)).copy_from(&moved);
            (jacobian.fixed_view_mut::<3, 1>(6 * disc + 3, t)).copy_from(&turned);
        }
    }
    jacobian
}
