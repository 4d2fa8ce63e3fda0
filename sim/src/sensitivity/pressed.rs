//! What contacts add where a change of the model displaces the discs and no joint turns.

use nalgebra::{Matrix6, Vector3};

use super::{Sensitivity, System};
use crate::factor::Side;
use crate::model_tangent::ModelTangent;
use crate::pose::{PoseTangent, levers};

impl Sensitivity {
    fn forms(&self) -> &[Matrix6<f64>] {
        match &self.system {
            System::Touching(_, forms) => forms,
            System::Chain(_) | System::Loaded(_) => &[],
        }
    }

    /// Adds the change of the gradient, as terms of discs, by how the forces change with the displacement of the discs.
    pub(super) fn press(&self, tangent: &ModelTangent, disc: &mut [Vector3<f64>]) {
        if self.forms().is_empty() {
            return;
        }
        let chain = &self.posture.chain;
        let mut moved = Vector3::zeros();
        let terms: Vec<PoseTangent> = (self.forms().iter().enumerate())
            .map(|(k, form)| {
                moved += chain.orientations[k] * tangent.joint_offsets[k];
                let (moment, force) = (
                    form.fixed_view::<3, 3>(0, 3) * moved,
                    form.fixed_view::<3, 3>(3, 3) * moved,
                );
                self.about_origin(k, force, moment)
            })
            .collect();
        for (disc, lever) in disc.iter_mut().zip(levers(chain, &terms)) {
            *disc += lever;
        }
    }

    /// Change of the disc poses by forces and moments that do to the gradient the opposite of these terms of discs.
    pub(crate) fn yielding(&self, disc: &[Vector3<f64>]) -> Vec<PoseTangent> {
        let none = vec![Vector3::zeros(); disc.len()];
        let growth = vec![0.0; self.held.tendons.len()];
        let (mut turns, _) = self.solve(&none, disc, &growth, Side::Matrix);
        turns.iter_mut().for_each(|turn| *turn = -*turn);
        self.move_discs(&ModelTangent::zero(&self.robot), &turns)
    }

    /// Of a cost with these derivatives by the discs' poses: its derivatives by a force and by a moment on each disc's origin.
    pub(crate) fn adjoint_motions(&self, cotangents: &[PoseTangent]) -> Vec<PoseTangent> {
        self.yielding(&levers(&self.posture.chain, cotangents))
    }

    /// A force on the centre of a joint and a moment, on the origin of its disc.
    fn about_origin(&self, disc: usize, force: Vector3<f64>, moment: Vector3<f64>) -> PoseTangent {
        let chain = &self.posture.chain;
        let arm = chain.positions[disc] - chain.centres[disc];
        PoseTangent {
            position: force,
            rotation: moment - arm.cross(&force),
        }
    }

    /// Its transpose: adds to a cost's derivatives by the displacement of each disc what those of its gradient, `turns`, give.
    pub(super) fn press_back(&self, turns: &[Vector3<f64>], centres: &mut [Vector3<f64>]) {
        let chain = &self.posture.chain;
        let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
        let mut below = chain.centres.first().copied().unwrap_or_default();
        for (k, form) in self.forms().iter().enumerate() {
            shift += turn.cross(&(chain.centres[k] - below));
            below = chain.centres[k];
            turn += turns[k];
            centres[k] += form.fixed_view::<3, 3>(3, 0) * turn;
            centres[k] += form.fixed_view::<3, 3>(3, 3) * shift;
        }
    }
}
