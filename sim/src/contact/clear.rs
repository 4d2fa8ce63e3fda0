//! Steps that take no bead through an obstacle, nor through another disc.

use nalgebra::Vector3;

use super::equations::Equations;
use crate::pose::motions;

/// Share of the way from where a bead touches to where its centre does that it may go in one step.
const CLEARANCE: f64 = 0.7;
/// Clearance that a step may always use, as a share of the reach: of beads without a radius, and of those that start inside.
const THIN: f64 = 1e-3;

/// The most that points of a disc within `arm` (m) of its joint's centre are displaced (m) by its turn (rad) and the displacement of that
/// centre (m): or their speed, by its angular velocity and the centre's velocity.
pub(super) fn most_displaced((turn, shift): &(Vector3<f64>, Vector3<f64>), arm: f64) -> f64 {
    shift.norm() + turn.norm() * arm
}

/// The most that points of the second disc within `arm` (m) of its joint's centre are displaced as the first disc sees it (m), by the motions
/// and the joints' centres (m) of all discs.
pub(super) fn most_apart(
    motions: &[(Vector3<f64>, Vector3<f64>)],
    centres: &[Vector3<f64>],
    [first, second]: [usize; 2],
    arm: f64,
) -> f64 {
    let [(turn, shift), (other_turn, other_shift)] = [motions[first], motions[second]];
    let carried = shift + turn.cross(&(centres[second] - centres[first]));
    most_displaced(&(other_turn - turn, other_shift - carried), arm)
}

impl Equations {
    /// Shortens the step such that to first order no bead's centre passes a surface: those in the list come into an obstacle by a share
    /// of their radius at most, others stay on their side of the planes that bound it. What a step that bends adds to that is noticed
    /// after it, of convex obstacles ([`has_crossed`](Self::has_crossed)); near others steps are shorter than the way to them.
    pub fn keep_clear(&mut self) {
        let chain = &self.iterate.posture.chain;
        let motions = motions(&chain.centres, &self.iterate.step);
        let mut factor: f64 = 1.0;
        let mut limit = |most: f64, allowed: f64| {
            if most * factor > allowed {
                factor = allowed / most;
            }
        };
        for (index, bound) in self.neighbourhood.bounds.iter().enumerate() {
            let disc = index % motions.len();
            let (turn, shift) = &motions[disc];
            let shift = shift + turn.cross(&(chain.positions[disc] - chain.centres[disc]));
            let approach = bound.approach(&shift, turn, self.beads.enclosing(disc));
            limit(approach, bound.clearance);
        }
        for near in &self.neighbourhood.near {
            let (turn, shift) = motions[near.bead.disc];
            let approach = -near.normal.dot(&(shift + turn.cross(&near.arm)));
            let (apart, radius) = (near.gap.max(0.0), near.bead.radius);
            let allowed = apart + CLEARANCE * (radius + near.gap.min(0.0));
            limit(approach, allowed.max(CLEARANCE * THIN * self.reach));
        }
        let (centres, discs) = (&chain.centres, self.robot.discs().iter().enumerate());
        let arms: Vec<f64> = discs
            .map(|(disc, own)| self.beads.enclosing(disc) + own.origin.norm())
            .collect();
        let farthest: Vec<f64> = (motions.iter().zip(&arms))
            .map(|(motion, arm)| most_displaced(motion, *arm))
            .collect();
        for apart in self.pairs.iter().flat_map(|pairs| &pairs.apart) {
            let [below, above] = apart.discs;
            if farthest[below] + farthest[above] > apart.distance {
                let most = most_apart(&motions, centres, apart.discs, arms[above]);
                limit(most, apart.distance);
            }
        }
        for near in self.near_pairs() {
            let [first, second] = [0, 1].map(|i| {
                let disc = near.beads[i].disc;
                let (turn, shift) = motions[disc];
                shift + turn.cross(&(near.centres[i] - self.iterate.posture.chain.centres[disc]))
            });
            let approach = near.normal.dot(&(second - first));
            let within = 0.5 * (near.beads[0].radius + near.beads[1].radius);
            let allowed = near.gap.max(0.0) + CLEARANCE * (within + near.gap.min(0.0));
            limit(approach, allowed.max(CLEARANCE * THIN * self.own_reach));
        }
        if factor < 1.0 {
            self.iterate
                .step
                .iter_mut()
                .for_each(|turn| *turn *= factor);
        }
    }

    /// Whether a bead's centre may have passed through an obstacle since the step began.
    pub fn has_crossed(&self) -> bool {
        let chain = &self.iterate.posture.chain;
        self.neighbourhood
            .has_crossed(&self.beads, chain, THIN * self.reach)
    }
}
