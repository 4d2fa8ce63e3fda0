//! The other way: from the derivatives of a cost by the potential's gradient to those by the model.
//!
//! With weights `w_j` on the gradient by each joint's turn, the cost is `sum_j w_j . g_j`: the work of the residual along
//! the turns `w`. Each term of [`gradient`](super::gradient), read from right to left, gives the derivative by one number
//! of the model; `W_k = sum_(j <= k) w_j` is the turn of disc `k`.

use nalgebra::Vector3;

use super::{Expanded, ModelTangent};
use crate::chain::Chain;
use crate::robot::{Drive, Tendon};

/// Derivatives of a cost by the ends of a straight piece of tendon (N, if the cost is a work).
struct PieceCotangent {
    upper: Vector3<f64>,
    lower: Vector3<f64>,
}

impl PieceCotangent {
    /// Of a cost with the derivative `by_length` by the length of a piece, and `by_turn` by `T u'`, its tension `T` times
    /// the turning of its direction `u`.
    fn new(
        u: &Vector3<f64>,
        length: f64,
        by_length: f64,
        by_turn: &Vector3<f64>,
        tension: f64,
    ) -> Self {
        let mut apart = u * by_length;
        // u' = (I - u u') apart' / l.
        if length > 0.0 {
            apart += (by_turn - u * u.dot(by_turn)) * (tension / length);
        }
        Self {
            upper: apart,
            lower: -apart,
        }
    }
}

impl Expanded<'_> {
    /// Adds to `out` the derivatives by the model, in a fixed configuration, of the cost `sum_j turns_j . g_j`, `g_j` the
    /// potential's gradient by the turn of joint `j` (world axes), and of `sum weight L_t` over the pairs of a tendon `t`
    /// and a weight in `lengths`. O(n) time.
    pub fn pull_back(
        &self,
        turns: &[Vector3<f64>],
        lengths: &[(usize, f64)],
        out: &mut ModelTangent,
    ) {
        // What the turns do to each tendon's length is the derivative by its tension.
        let mut pulls = vec![0.0; self.expansion.weights.len()];
        self.expansion.elongate(turns, &mut pulls);
        let mut by_length = self.pull_back_tensions(&pulls, out);
        for &(tendon, weight) in lengths {
            by_length[tendon] += weight;
        }
        for (out, by_length) in out.fixed_lengths.iter_mut().zip(&by_length) {
            *out += by_length;
        }
        let tensions = &self.expansion.tensions;
        let piece = |tendon: usize, _| [by_length[tendon], tensions[tendon]];
        self.pull_back_pulled(turns, piece, out);
    }

    /// The same where of each piece of each tendon the derivative of the cost by its length, and its tension (N), are given, by the
    /// tendon's number and the piece's place on its route; without the derivatives by what the tensions are made of.
    pub fn pull_back_pulled(
        &self,
        turns: &[Vector3<f64>],
        piece: impl Fn(usize, usize) -> [f64; 2],
        out: &mut ModelTangent,
    ) {
        self.pull_back_segments(turns, &piece, out);
        self.pull_back_spans(turns, &piece, out);
        self.pull_back_dead(turns, out);
        for (i, disc) in self.robot.discs().iter().enumerate() {
            if disc.backbone.is_some() || disc.hinges.is_some() {
                let turn = self.posture.chain.disc(i).tr_mul(&turns[i]);
                out.backbone[i] += disc.work_by_stiffness(&self.q.0[i], &turn);
            }
        }
    }

    /// From the derivatives by the tensions to those by commands, stiffnesses and (returned) lengths.
    fn pull_back_tensions(&self, pulls: &[f64], out: &mut ModelTangent) -> Vec<f64> {
        let tendons = self.robot.tendons().iter().enumerate();
        tendons
            .map(|(t, tendon)| {
                let stretch = self.posture.lengths[t] - self.command[t];
                let weight = self.expansion.weights[t];
                pull_back_tension((t, tendon), (weight, stretch), pulls[t], out)
            })
            .collect()
    }

    /// The part of [`Expanded::pull_back_pulled`] that segments have.
    pub fn pull_back_segments(
        &self,
        turns: &[Vector3<f64>],
        piece: impl Fn(usize, usize) -> [f64; 2],
        out: &mut ModelTangent,
    ) {
        let orientations = &self.posture.chain.orientations;
        for (i, segment) in self.robot.segments().iter().enumerate() {
            let stretch = &self.posture.stretches[i];
            let (turn, u) = (&turns[segment.joint], &stretch.direction);
            let [own, tension] = piece(segment.tendon, segment.place);
            // T w . (a' x u + a x u').
            let by_turn = turn.cross(&stretch.hole);
            let mut piece = PieceCotangent::new(u, stretch.length, own, &by_turn, tension);
            piece.upper += u.cross(turn) * tension;
            let [from, to] = &mut out.segments[i];
            *from += orientations[segment.joint].tr_mul(&piece.lower);
            *to += orientations[segment.joint + 1].tr_mul(&piece.upper);
        }
    }

    fn pull_back_spans(
        &self,
        turns: &[Vector3<f64>],
        piece: impl Fn(usize, usize) -> [f64; 2],
        out: &mut ModelTangent,
    ) {
        if self.robot.spans().is_empty() {
            return;
        }
        let chain = &self.posture.chain;
        let mut centres = vec![Vector3::zeros(); turns.len()];
        for (i, span) in self.robot.spans().iter().enumerate() {
            let (_, upper, stretch) = span.stretch(self.robot, chain);
            let [own, tension] = piece(span.tendon, span.place);
            let u = &stretch.direction;
            // T sum_j w_j . (a_j' x u + a_j x u'), a_j' = upper' - c_j'.
            let (mut by_turn, mut turn) = (Vector3::zeros(), Vector3::zeros());
            for joint in span.lower.map_or(0, |disc| disc + 1)..=span.upper {
                let arm = upper - chain.centres[joint];
                by_turn += turns[joint].cross(&arm);
                turn += turns[joint];
                centres[joint] -= u.cross(&turns[joint]) * tension;
            }
            let mut piece = PieceCotangent::new(u, stretch.length, own, &by_turn, tension);
            piece.upper += u.cross(&turn) * tension;
            // Each end moves with the joint of its disc, and on the disc.
            let [from, to] = &mut out.spans[i];
            centres[span.upper] += piece.upper;
            *to += chain.disc(span.upper).tr_mul(&piece.upper);
            *from += match span.lower {
                None => chain.orientations[0].tr_mul(&piece.lower),
                Some(disc) => {
                    centres[disc] += piece.lower;
                    chain.disc(disc).tr_mul(&piece.lower)
                }
            };
        }
        pull_back_centres(chain, &centres, out);
    }

    fn pull_back_dead(&self, turns: &[Vector3<f64>], out: &mut ModelTangent) {
        let (chain, dead) = (&self.posture.chain, self.dead);
        let n = turns.len();
        // The forces from above each disc.
        let mut above = vec![Vector3::zeros(); n];
        let mut force = dead.payload;
        for (above, own) in above.iter_mut().zip(&dead.at_origin).rev() {
            *above = force;
            force += own;
        }
        // `lift`: sum over the discs below of arm x W, the derivative by a force further up.
        let (mut turn, mut lift) = (Vector3::zeros(), Vector3::zeros());
        for k in 0..n {
            turn += turns[k];
            let arm = chain.positions[k] - chain.centres[k];
            out.at_origin[k] += lift + arm.cross(&turn);
            out.moments[k] -= turn;
            out.off_origin[k] += chain.disc(k).tr_mul(&turn.cross(&dead.gravity));
            if k + 1 == n {
                let hung = chain.disc(k) * dead.payload_arm;
                out.payload += lift + hung.cross(&turn);
            } else {
                lift += (chain.centres[k + 1] - chain.centres[k]).cross(&turn);
                out.joint_offsets[k + 1] += chain.disc(k).tr_mul(&turn.cross(&above[k]));
            }
        }
    }
}

/// Adds to `out` the derivatives by the command and the stiffness of a tendon of a cost with the derivative `pull` by its tension, which
/// has the slope `weight` (N/m) at this `stretch` (m); returns that by its length.
pub(crate) fn pull_back_tension(
    (number, tendon): (usize, &Tendon),
    (weight, stretch): (f64, f64),
    pull: f64,
    out: &mut ModelTangent,
) -> f64 {
    match tendon.drive {
        Drive::Tension => {
            out.command[number] += pull;
            0.0
        }
        // The rest length that stands for a commanded length is an unknown of the solve.
        _ if tendon.holds_length() => weight * pull,
        _ if weight == 0.0 => 0.0,
        _ => {
            out.command[number] -= weight * pull;
            out.stiffness[number] += tendon.per_stiffness(stretch) * pull;
            weight * pull
        }
    }
}

/// Adds to `out` the derivatives by the model of `sum_i centres_i . c_i`, `c_i` the centre of joint `i` in the world: how the
/// model moves the origin of disc `i`, too, in a fixed configuration.
pub(crate) fn pull_back_centres(chain: &Chain, centres: &[Vector3<f64>], out: &mut ModelTangent) {
    let mut above = Vector3::zeros();
    for (i, centre) in centres.iter().enumerate().rev() {
        above += centre;
        out.joint_offsets[i] += chain.orientations[i].tr_mul(&above);
    }
}
