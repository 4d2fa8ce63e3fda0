//! How the discs' poses change with the model.

use nalgebra::Vector3;

use super::Sensitivity;
use crate::model_tangent::ModelTangent;
use crate::pose::PoseTangent;

impl Sensitivity {
    /// Change of the discs' poses when the model changes and the joints turn by `-turns`.
    pub(super) fn move_discs(
        &self,
        tangent: &ModelTangent,
        turns: &[Vector3<f64>],
    ) -> Vec<PoseTangent> {
        let chain = &self.posture.chain;
        let (mut rotation, mut centre) = (Vector3::zeros(), Vector3::zeros());
        let mut below = self.robot.base();
        (0..turns.len())
            .map(|i| {
                let explicit = chain.orientations[i] * tangent.joint_offsets[i];
                centre += rotation.cross(&(chain.centres[i] - below)) + explicit;
                below = chain.centres[i];
                rotation -= turns[i];
                let arm = chain.positions[i] - chain.centres[i];
                PoseTangent {
                    position: centre + rotation.cross(&arm),
                    rotation,
                }
            })
            .collect()
    }
}
