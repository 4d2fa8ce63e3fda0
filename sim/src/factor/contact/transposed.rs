//! The transposed system, by the same factors: each line of [`ContactLu::solve`] read from its end to its begin, as all of them are linear.

use nalgebra::{SVector, Vector3};

use super::super::motions::{carried_to, shifted_back, turn_of};
use super::ContactLu;

impl<const D: usize> ContactLu<D> {
    /// Writes the turns `w` of the joints (world axes) for which the transposed matrix times `w` is `rhs`.
    pub fn solve_transposed(&mut self, rhs: &[Vector3<f64>], solution: &mut [Vector3<f64>]) {
        with_slots!(self.substitute_transposed(rhs, solution));
    }

    fn substitute_transposed<const A: usize>(
        &mut self,
        rhs: &[Vector3<f64>],
        solution: &mut [Vector3<f64>],
    ) {
        let (slots, n) = (self.columns.slots, self.joints.len());
        // From the tip to the base: what the sum `rhs . turns` changes by with the motion and the tensions that come to each joint.
        let mut motion = SVector::<f64, D>::zeros();
        let mut tensions = [0.0; A];
        for joint in (0..n).rev() {
            let (factor, at) = (&self.joints[joint], joint * slots);
            let own = &self.slots[at..][..slots];
            let mut step = rhs[joint] + turn_of(&motion);
            let mut comes = [0.0; A];
            self.lost[at..][..slots].fill(0.0);
            for s in 0..slots {
                let row = &self.onward[(at + s) * slots..][..slots];
                for (r, x) in row.iter().enumerate() {
                    comes[r] += x * tensions[s];
                    self.lost[at + r] -= x * tensions[s];
                }
                step -= own[s].by_turn * tensions[s];
                motion -= own[s].by_below * tensions[s];
            }
            let right = factor.inverse.tr_mul(&step);
            motion -= factor.row.tr_mul(&right);
            for s in 0..slots {
                comes[s] -= own[s].row.dot(&right);
            }
            motion = shifted_back(&motion, &self.arms[joint]);
            tensions = comes;
            solution[joint] = right;
        }
        // From the base to the tip: with the moment and the lengths that go on from each joint.
        let mut moment = SVector::<f64, D>::zeros();
        let mut lengths = [0.0; A];
        for joint in 0..n {
            let (factor, at) = (&self.joints[joint], joint * slots);
            let own = &self.slots[at..][..slots];
            for &column in &self.columns.bottom[joint] {
                lengths[self.columns.slot[column]] = 0.0;
            }
            moment = carried_to(&moment, &self.arms[joint]);
            let mut eased = factor.col.tr_mul(&moment);
            for s in 0..slots {
                eased += own[s].col * lengths[s];
                let row = &self.shortening[(at + s) * slots..][..slots];
                for (r, x) in row.iter().enumerate() {
                    self.lost[at + r] -= x * lengths[s];
                }
            }
            let right = solution[joint] + factor.inverse.tr_mul(&eased);
            for s in 0..slots {
                let lost = self.lost[at + s] - own[s].moment.dot(&moment) + own[s].row.dot(&right);
                lengths[s] += self.inflows[at + s].beyond * lost;
            }
            let mut turned = moment.fixed_rows_mut::<3>(0);
            turned -= right;
            solution[joint] = right;
        }
    }
}
