//! What contacts add where a change of the model displaces the discs and no joint turns.

use nalgebra::{Matrix3, Vector3};

use super::{Sensitivity, System};
use crate::energy::Pressing;
use crate::factor::{PairedLu, Side, project};
use crate::model_tangent::ModelTangent;
use crate::pose::{PoseTangent, levers, motions};

/// A point of a disc at which a contact acts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PressedPoint {
    pub disc: usize,
    /// Where it is (m).
    pub position: Vector3<f64>,
}

/// A contact on a bead that moves along its disc as the rod to the joint above grows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OnRod {
    pub bead: PressedPoint,
    /// Share of the rod's growth that the bead moves by.
    pub share: f64,
    /// Force on the bead (N).
    pub force: Vector3<f64>,
    /// By what a displacement of the bead diminishes it (N/m).
    pub stiffness: Matrix3<f64>,
    /// Where the opposite force acts on the robot itself.
    pub partner: Option<PressedPoint>,
}

impl Sensitivity {
    fn pressing(&self) -> Option<&Pressing> {
        match &self.system {
            System::Touching(_, pressing) => Some(pressing),
            System::Chain(_) | System::Loaded(_) => None,
        }
    }

    /// Solves where contacts press, and once more for what rounding leaves (iterative refinement: Higham, Accuracy and Stability of
    /// Numerical Algorithms, ch. 12): contacts are stiffer than the robot by many orders of magnitude, and the factors mix both.
    pub(super) fn solve_pressed(
        &self,
        (factor, pressing): (&PairedLu, &Pressing),
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        solution: &mut [Vector3<f64>],
    ) {
        factor.solve(joint, disc, solution);
        let none = vec![Vector3::zeros(); joint.len()];
        let mut left = none.clone();
        self.expansion.product(solution, &mut left);
        self.add_pressed(pressing, solution, &mut left);
        let mut above = Vector3::zeros();
        for (left, (joint, disc)) in left.iter_mut().zip(joint.iter().zip(disc)).rev() {
            above += disc;
            *left = joint + above - *left;
        }
        project(&self.posture.chain.hinges, &mut left);
        let mut correction = none.clone();
        factor.solve(&left, &none, &mut correction);
        (solution.iter_mut().zip(&correction)).for_each(|(turn, own)| *turn += own);
    }

    /// Adds the product of what contacts add to the Hessian and the joints' `turns`.
    fn add_pressed(&self, pressing: &Pressing, turns: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        let centres = &self.posture.chain.centres;
        let motions = motions(centres, turns);
        // Of each disc the force, and the moment about the centre of its joint.
        let mut wrenches: Vec<(Vector3<f64>, Vector3<f64>)> = (pressing.forms.iter().zip(&motions))
            .map(|(form, (turn, shift))| {
                let [turns, mixed, levered, shifts] = [(0, 0), (0, 3), (3, 0), (3, 3)]
                    .map(|(row, column)| form.fixed_view::<3, 3>(row, column));
                (
                    levered * turn + shifts * shift,
                    turns * turn + mixed * shift,
                )
            })
            .collect();
        for pair in &pressing.pairs {
            let [first, second] = pair.points.map(|point| {
                let (turn, shift) = motions[point.disc];
                shift + turn.cross(&(point.position - centres[point.disc]))
            });
            let force = pair.form() * (first - second);
            for (point, force) in pair.points.iter().zip([force, -force]) {
                let wrench = &mut wrenches[point.disc];
                wrench.0 += force;
                wrench.1 += (point.position - centres[point.disc]).cross(&force);
            }
        }
        let (mut above, mut moment) = (Vector3::zeros(), Vector3::zeros());
        for joint in (0..out.len()).rev() {
            if let Some(next) = centres.get(joint + 1) {
                moment += (next - centres[joint]).cross(&above);
            }
            above += wrenches[joint].0;
            moment += wrenches[joint].1;
            out[joint] += moment;
        }
    }

    /// Adds the change of the gradient, as terms of discs, by how the forces change with the displacement of the discs,
    /// and of beads along them.
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
        for contact in &self.on_rods {
            let joint = contact.bead.disc + 1;
            let grown = chain.orientations[joint] * tangent.joint_offsets[joint];
            let slid = grown * contact.share;
            let force = contact.stiffness * slid;
            let mut push = |point: &PressedPoint, force: Vector3<f64>| {
                let arm = point.position - chain.positions[point.disc];
                terms[point.disc].position += force;
                terms[point.disc].rotation += arm.cross(&force);
            };
            push(&contact.bead, force);
            if let Some(partner) = &contact.partner {
                push(partner, -force);
            }
            terms[contact.bead.disc].rotation -= slid.cross(&contact.force);
        }
        for (disc, lever) in disc.iter_mut().zip(levers(chain, &terms)) {
            *disc += lever;
        }
    }

    /// Change of the disc poses by forces and moments that do to the gradient the opposite of these terms of discs.
    pub(crate) fn yielding(&self, disc: &[Vector3<f64>]) -> Vec<PoseTangent> {
        self.yielding_by(disc, Side::Matrix)
    }

    fn yielding_by(&self, disc: &[Vector3<f64>], side: Side) -> Vec<PoseTangent> {
        let none = vec![Vector3::zeros(); disc.len()];
        let growth = vec![0.0; self.held.tendons.len()];
        let (mut turns, _) = self.solve(&none, disc, &growth, side);
        turns.iter_mut().for_each(|turn| *turn = -*turn);
        self.move_discs(&ModelTangent::zero(&self.robot), &turns)
    }

    /// Of a cost with these derivatives by the discs' poses: its derivatives by a force and by a moment on each disc's origin.
    pub(crate) fn adjoint_motions(&self, cotangents: &[PoseTangent]) -> Vec<PoseTangent> {
        self.yielding_by(&levers(&self.posture.chain, cotangents), Side::Transpose)
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

    /// Its transpose: adds to a cost's derivatives by the displacement of each disc, and by the model, what those of its gradient,
    /// `turns`, give.
    pub(super) fn press_back(
        &self,
        turns: &[Vector3<f64>],
        centres: &mut [Vector3<f64>],
        model: &mut ModelTangent,
    ) {
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
        for contact in &self.on_rods {
            let moved = |point: &PressedPoint| {
                let (turn, shift) = motions[point.disc];
                shift + turn.cross(&(point.position - chain.centres[point.disc]))
            };
            let apart =
                moved(&contact.bead) - contact.partner.as_ref().map_or(Vector3::zeros(), moved);
            let (turn, _) = motions[contact.bead.disc];
            let slid = contact.stiffness * apart + turn.cross(&contact.force);
            let joint = contact.bead.disc + 1;
            model.joint_offsets[joint] += chain.orientations[joint].tr_mul(&slid) * contact.share;
        }
    }
}
