//! From soft contacts to hard ones.
//!
//! Newton's method finds an equilibrium against soft contacts nearly as fast as one without. Of what a harder contact changes, the
//! larger part is known before: with the forces `f` of the solution, `df = (d mu - f² dC) / (g + 2 C f)` at the same gap, so a step with
//! the Hessian there leads to the next solution to first order (Allgower and Georg, Numerical Continuation Methods, ch. 2).

use nalgebra::Vector3;

use super::equations::{Equations, MAX_TURN};
use super::law::Hardness;
use crate::factor::Curvature;

/// How often a prediction is halved.
const MAX_HALVINGS: i32 = 8;

impl Equations {
    /// Sets how hard contacts are, and the residual (N m) that counts as solved.
    pub fn set_hardness(&mut self, hardness: Hardness, tolerance: f64) {
        (self.hardness, self.tolerance) = (hardness, tolerance);
        self.is_found = false;
    }

    /// Moves from the solution to where that with contacts of another hardness is, to first order; whether there was a way.
    pub fn predict(&mut self, next: Hardness) -> bool {
        if self.factorise(0.0) != Some(Curvature::Positive) {
            return false;
        }
        let chain = &self.iterate.posture.chain;
        let n = self.joints.len();
        // What contacts add to the force on each disc (N), and to its moment about the joint's centre (N m).
        let mut added = vec![(Vector3::zeros(), Vector3::zeros()); n];
        let mut push = |disc: usize, arm: &Vector3<f64>, force: &Vector3<f64>| {
            let (sum, moment) = &mut added[disc];
            *sum += force;
            *moment += arm.cross(force);
        };
        for near in &self.neighbourhood.near {
            let law = self.law(near);
            let change = law.change(near.gap, &self.law_of(near, next));
            push(near.bead.disc, &near.arm, &(near.normal * change));
        }
        let own = self.own_law();
        for near in self.near_pairs() {
            let change = own.change(near.gap, &self.own_law_of(next));
            for (i, sign) in [(0, 1.0), (1, -1.0)] {
                let disc = near.beads[i].disc;
                let arm = near.centres[i] - chain.centres[disc];
                push(disc, &arm, &(near.normal * (sign * change)));
            }
        }
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::<f64>::zeros());
        self.gradient
            .copy_from_slice(&self.expansion.joint_gradient);
        for joint in (0..n).rev() {
            if joint + 1 < n {
                moment += (chain.centres[joint + 1] - chain.centres[joint]).cross(&force);
            }
            force += added[joint].0;
            moment += added[joint].1;
            self.gradient[joint] -= moment;
        }
        let (disc, step) = (&self.expansion.disc_gradient, &mut self.iterate.step);
        self.lu.solve(&self.gradient, disc, step);
        step.iter_mut().for_each(|turn| *turn = -*turn);
        self.iterate.limit_step(MAX_TURN);
        self.keep_clear();
        self.neighbourhood.begin_step();
        self.iterate.start_step();
        for halvings in 0..MAX_HALVINGS {
            self.iterate.move_by(0.5_f64.powi(halvings));
            if !self.has_crossed() {
                return true;
            }
        }
        self.iterate.move_back();
        false
    }
}
