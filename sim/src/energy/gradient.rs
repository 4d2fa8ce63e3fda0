//! The potential's gradient alone, for motion: a step needs no Hessian.

use nalgebra::Vector3;

use super::{Potential, twist};
use crate::chain::Configuration;
use crate::tendon::Posture;

impl Potential<'_> {
    /// Writes the gradient by each joint's turn, world axes (N m), at `q`, whose posture is
    /// `posture`, of hinges also along turns that they do not allow; `tensions` is scratch, one entry per tendon. Allocates nothing.
    pub fn gradient(
        &self,
        q: &Configuration,
        posture: &Posture,
        tensions: &mut [f64],
        out: &mut [Vector3<f64>],
    ) {
        let pulled = self
            .robot
            .tendons()
            .iter()
            .zip(&posture.lengths)
            .zip(self.command);
        for (tension, ((tendon, length), command)) in tensions.iter_mut().zip(pulled) {
            *tension = tendon.state(*length, *command).tension;
        }
        self.gradient_pulled(q, posture, |tendon, _| tensions[tendon], out);
    }

    /// The same where the tension (N) of each piece of each tendon is given, as in [`Potential::expand_pulled`].
    pub fn gradient_pulled(
        &self,
        q: &Configuration,
        posture: &Posture,
        tension: impl Fn(usize, usize) -> f64,
        out: &mut [Vector3<f64>],
    ) {
        // Dead forces.
        self.dead_gradient(posture, out);
        // Tensions, on segments and spans.
        for (segment, stretch) in self.robot.segments().iter().zip(&posture.stretches) {
            out[segment.joint] += stretch.gradient() * tension(segment.tendon, segment.place);
        }
        for span in self.robot.spans() {
            let (_, upper, stretch) = span.stretch(self.robot, &posture.chain);
            let pull = stretch.direction * tension(span.tendon, span.place);
            let joints = span.lower.map_or(0, |disc| disc + 1)..=span.upper;
            let centres = &posture.chain.centres[joints.clone()];
            for (out, centre) in out[joints].iter_mut().zip(centres) {
                *out += (upper - centre).cross(&pull);
            }
        }
        // Elastic joints.
        for ((out, disc), (q, orientation)) in (out.iter_mut().zip(self.robot.discs()))
            .zip(q.0.iter().zip(&posture.chain.orientations[1..]))
        {
            if let Some(joint) = disc.elasticity(q) {
                *out += orientation * joint.gradient;
            }
        }
    }

    /// `-d x f` summed over the dead forces `f` that a joint carries, at `d` from its centre.
    fn dead_gradient(&self, posture: &Posture, out: &mut [Vector3<f64>]) {
        let chain = &posture.chain;
        let Some((tip, above_tip)) = chain.orientations.last().zip(chain.centres.last()) else {
            return;
        };
        let mut force = self.dead.payload;
        let mut moment = force.cross(&(tip * self.dead.payload_arm));
        let mut above = above_tip;
        let discs = (chain.centres.iter().zip(&chain.positions)).zip(&self.dead.at_origin);
        for (disc, (out, ((centre, position), own))) in out.iter_mut().zip(discs).enumerate().rev()
        {
            moment += force.cross(&(above - centre)) + own.cross(&(position - centre));
            if let Some(couple) = self.dead.couple(disc, chain.disc(disc)) {
                moment += twist(&couple);
            }
            force += own;
            above = centre;
            *out = moment;
        }
    }
}
