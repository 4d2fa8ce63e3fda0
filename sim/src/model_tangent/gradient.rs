//! How the potential's gradient changes with the model in a fixed configuration.
//!
//! A tendon of length `L` and tension `T` adds `T dL` to the gradient. When the model changes and the configuration does not,
//! that changes by `T' dL + T (dL)'`, a dash for a change with the model; [`pull`](Expanded::pull) is `T'`. Of a straight piece
//! from hole `s` to hole `p`, with direction `u = (p - s) / |p - s|`, the slope along a turn about a joint's centre `c` is
//! `dL = a x u`, `a = p - c`.

use nalgebra::Vector3;

use super::{Expanded, ModelTangent};
use crate::robot::Drive;

/// Change of the potential's gradient in a fixed configuration.
pub(crate) struct GradientTangent {
    /// Of each joint's own terms (N m).
    pub joint: Vec<Vector3<f64>>,
    /// Of each disc's terms (N m).
    pub disc: Vec<Vector3<f64>>,
    /// Of each tendon's length (m).
    pub lengths: Vec<f64>,
}

/// Change of a piece of tendon in a fixed configuration.
struct PieceTangent {
    /// Of the upper hole's place (m).
    upper: Vector3<f64>,
    /// Of the lower hole's place (m).
    lower: Vector3<f64>,
}

impl Expanded<'_> {
    /// Change of the gradient when the model changes and the configuration does not.
    pub fn gradient_tangent(&self, tangent: &ModelTangent) -> GradientTangent {
        let robot = self.robot;
        let n = robot.discs().len();
        let mut out = GradientTangent {
            joint: vec![Vector3::zeros(); n],
            disc: vec![Vector3::zeros(); n],
            lengths: tangent.fixed_lengths.clone(),
        };
        let centres = self.moved_centres(tangent);
        let spans: Vec<_> = (0..robot.spans().len())
            .map(|i| self.moved_span(tangent, &centres, i))
            .collect();
        self.lengthen(tangent, &spans, &mut out);
        let pull = self.pull(tangent, &out.lengths);
        self.add_segments(tangent, &pull, &mut out);
        self.add_spans(&centres, &spans, &pull, &mut out);
        self.add_dead(tangent, &mut out);
        self.add_backbone(tangent, &mut out);
        out
    }

    /// Change of the joints' centres in a fixed configuration (m).
    fn moved_centres(&self, tangent: &ModelTangent) -> Vec<Vector3<f64>> {
        let mut moved = Vector3::zeros();
        let offsets = self
            .posture
            .chain
            .orientations
            .iter()
            .zip(&tangent.joint_offsets);
        offsets
            .map(|(below, offset)| {
                moved += below * offset;
                moved
            })
            .collect()
    }

    fn moved_segment(&self, tangent: &ModelTangent, index: usize) -> PieceTangent {
        let joint = self.robot.segments()[index].joint;
        let orientations = &self.posture.chain.orientations;
        let [from, to] = &tangent.segments[index];
        PieceTangent {
            upper: orientations[joint + 1] * to,
            lower: orientations[joint] * from,
        }
    }

    fn moved_span(
        &self,
        tangent: &ModelTangent,
        centres: &[Vector3<f64>],
        index: usize,
    ) -> PieceTangent {
        let span = &self.robot.spans()[index];
        let chain = &self.posture.chain;
        let [from, to] = &tangent.spans[index];
        PieceTangent {
            upper: centres[span.upper] + chain.disc(span.upper) * to,
            lower: match span.lower {
                None => chain.orientations[0] * from,
                Some(disc) => centres[disc] + chain.disc(disc) * from,
            },
        }
    }

    fn lengthen(&self, tangent: &ModelTangent, spans: &[PieceTangent], out: &mut GradientTangent) {
        for (i, segment) in self.robot.segments().iter().enumerate() {
            let moved = self.moved_segment(tangent, i);
            let direction = self.posture.stretches[i].direction;
            out.lengths[segment.tendon] += direction.dot(&(moved.upper - moved.lower));
        }
        for (span, moved) in self.robot.spans().iter().zip(spans) {
            let (_, _, stretch) = span.stretch(self.robot, &self.posture.chain);
            out.lengths[span.tendon] += stretch.direction.dot(&(moved.upper - moved.lower));
        }
    }

    /// Change of the tensions (N) where the lengths change by `lengths` (m).
    pub fn pull(&self, tangent: &ModelTangent, lengths: &[f64]) -> Vec<f64> {
        let change = |t: usize| {
            let tendon = &self.robot.tendons()[t];
            let weight = self.expansion.weights[t];
            match tendon.drive {
                Drive::Tension => tangent.command[t],
                // The rest length that stands for a commanded length is an unknown of the solve.
                _ if tendon.holds_length() => weight * lengths[t],
                _ if weight == 0.0 => 0.0,
                _ => {
                    let stretch = self.posture.lengths[t] - self.command[t];
                    weight * (lengths[t] - tangent.command[t])
                        + tangent.stiffness[t] * tendon.per_stiffness(stretch)
                }
            }
        };
        (0..lengths.len()).map(change).collect()
    }

    fn add_segments(&self, tangent: &ModelTangent, pull: &[f64], out: &mut GradientTangent) {
        for (i, segment) in self.robot.segments().iter().enumerate() {
            let stretch = &self.posture.stretches[i];
            let moved = self.moved_segment(tangent, i);
            let turned = turned_direction(&stretch.direction, stretch.length, &moved);
            // a' x u + a x u' of the arm a from the joint to the upper hole.
            let slope = moved.upper.cross(&stretch.direction) + stretch.hole.cross(&turned);
            out.joint[segment.joint] += stretch.gradient() * pull[segment.tendon]
                + slope * self.expansion.tensions[segment.tendon];
        }
    }

    fn add_spans(
        &self,
        centres: &[Vector3<f64>],
        spans: &[PieceTangent],
        pull: &[f64],
        out: &mut GradientTangent,
    ) {
        let chain = &self.posture.chain;
        for (span, moved) in self.robot.spans().iter().zip(spans) {
            let (_, upper, stretch) = span.stretch(self.robot, chain);
            let tension = self.expansion.tensions[span.tendon];
            let u = stretch.direction;
            let turned = turned_direction(&u, stretch.length, moved);
            let first = span.lower.map_or(0, |disc| disc + 1);
            for (joint, centre) in centres.iter().enumerate().take(span.upper + 1).skip(first) {
                let arm = upper - chain.centres[joint];
                let moved_arm = moved.upper - centre;
                // T' (a x u) + T (a' x u + a x u') of the arm a from the joint to the upper hole.
                out.joint[joint] += arm.cross(&u) * pull[span.tendon]
                    + (moved_arm.cross(&u) + arm.cross(&turned)) * tension;
            }
        }
    }

    fn add_dead(&self, tangent: &ModelTangent, out: &mut GradientTangent) {
        let chain = &self.posture.chain;
        let n = chain.positions.len();
        let (mut above, mut more_above) = (Vector3::zeros(), Vector3::zeros());
        for k in (0..n).rev() {
            // Change of the moment of the disc's own loads about its joint.
            let arm = chain.positions[k] - chain.centres[k];
            let more = tangent.at_origin[k];
            let mut change = more.cross(&arm) - tangent.moments[k];
            change += (self.dead.gravity).cross(&(chain.disc(k) * tangent.off_origin[k]));
            // And of the forces from above: the payload's at the tip, elsewhere those at the next joint.
            if k + 1 == n {
                let hung = chain.disc(k) * self.dead.payload_arm;
                change += tangent.payload.cross(&hung);
                above += self.dead.payload;
                more_above += tangent.payload;
            } else {
                let arm = chain.centres[k + 1] - chain.centres[k];
                let moved = chain.disc(k) * tangent.joint_offsets[k + 1];
                change += more_above.cross(&arm) + above.cross(&moved);
            }
            above += self.dead.at_origin[k];
            more_above += more;
            out.disc[k] += change;
        }
    }

    fn add_backbone(&self, tangent: &ModelTangent, out: &mut GradientTangent) {
        for (i, disc) in self.robot.discs().iter().enumerate() {
            if disc.backbone.is_some() || disc.hinges.is_some() {
                let stiffer = &tangent.backbone[i];
                let change = disc.gradient_by_stiffness(&self.q.0[i], stiffer);
                out.joint[i] += self.posture.chain.disc(i) * change;
            }
        }
    }
}

/// Change of a piece's direction when its ends move.
fn turned_direction(u: &Vector3<f64>, length: f64, moved: &PieceTangent) -> Vector3<f64> {
    if length == 0.0 {
        return Vector3::zeros();
    }
    let apart = moved.upper - moved.lower;
    (apart - u * u.dot(&apart)) / length
}
