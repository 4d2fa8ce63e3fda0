//! What contacts add where a change of the model displaces the discs and no joint turns.

use nalgebra::Vector3;

use super::{Sensitivity, System};
use crate::energy::Pressing;
use crate::factor::Side;
use crate::model_tangent::ModelTangent;
use crate::pose::{PoseTangent, levers, motions};

impl Sensitivity {
    fn pressing(&self) -> Option<&Pressing> {
        match &self.system {
            System::Touching(_, pressing) => Some(pressing),
            System::Chain(_) | System::Loaded(_) => None,
        }
    }

    /// Adds the change of the gradient, as terms of discs, by how the forces change with the displacement of the discs.
    pub(super) fn press(&self, tangent: &ModelTangent, disc: &mut [Vector3<f64>]) {
        let Some(pressing) = self.pressing() else {
            return;
        };
        let chain = &self.posture.chain;
        let mut moved = Vector3::zeros();
        let moved: Vec<Vector3<f64>> = (tangent.joint_offsets.iter().zip(&chain.orientations))
            .map(|(offset, orientation)| {
                moved += orientation * offset;
                moved
            })
            .collect();
        let mut terms: Vec<PoseTangent> = (pressing.forms.iter().zip(&moved).enumerate())
            .map(|(k, (form, moved))| {
                let (moment, force) = (
                    form.fixed_view::<3, 3>(0, 3) * moved,
                    form.fixed_view::<3, 3>(3, 3) * moved,
                );
                self.about_origin(k, force, moment)
            })
            .collect();
        for pair in &pressing.pairs {
            let [first, second] = pair.points.map(|point| point.disc);
            let force = pair.form() * (moved[first] - moved[second]);
            for (point, force) in pair.points.iter().zip([force, -force]) {
                let arm = point.position - chain.positions[point.disc];
                terms[point.disc].position += force;
                terms[point.disc].rotation += arm.cross(&force);
            }
        }
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
        let Some(pressing) = self.pressing() else {
            return;
        };
        let motions = motions(&chain.centres, turns);
        for (k, form) in pressing.forms.iter().enumerate() {
            let (turn, shift) = motions[k];
            centres[k] += form.fixed_view::<3, 3>(3, 0) * turn;
            centres[k] += form.fixed_view::<3, 3>(3, 3) * shift;
        }
        for pair in &pressing.pairs {
            let [first, second] = pair.points.map(|point| {
                let (turn, shift) = motions[point.disc];
                shift + turn.cross(&(point.position - chain.centres[point.disc]))
            });
            let force = pair.form() * (first - second);
            centres[pair.points[0].disc] += force;
            centres[pair.points[1].disc] -= force;
        }
    }
}
