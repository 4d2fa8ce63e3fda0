//! Products with the Hessian in O(n), without forming it.

use nalgebra::{Matrix3, Vector3};

use super::Expansion;

impl Expansion {
    /// Writes what the joints' `turns` (world axes) do to first order to each column, `a_c . turns`: for the first columns,
    /// to the length of each tendon (m).
    pub fn elongate(&self, turns: &[Vector3<f64>], out: &mut [f64]) {
        let slots = self.columns.slots;
        out.fill(0.0);
        let mut sums = vec![0.0; slots];
        for (joint, turn) in turns.iter().enumerate() {
            for (sum, slope) in sums.iter_mut().zip(&self.slopes[joint * slots..]) {
                *sum += slope.dot(turn);
            }
            for &column in &self.columns.top[joint] {
                out[column] = std::mem::take(&mut sums[self.columns.slot[column]]);
            }
        }
    }

    /// Writes the product of the Hessian and the joints' `turns`, world axes: [`Expansion::dense`] times them.
    pub fn product(&self, turns: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        let slots = self.columns.slots;
        let mut pulls = vec![0.0; self.weights.len()];
        self.elongate(turns, &mut pulls);
        // From the base to the tip: for now, the turn of the disc below each joint.
        let mut below = Vector3::zeros();
        for (out, turn) in out.iter_mut().zip(turns) {
            *out = below;
            below += turn;
        }
        // From the tip to the base: what is above a joint turns with it, by the blocks of `dense`.
        let (mut blocks, mut moment) = (Matrix3::zeros(), Vector3::zeros());
        let (mut above, mut active) = (Vector3::zeros(), vec![0.0; slots]);
        for (joint, turn) in turns.iter().enumerate().rev() {
            blocks += self.disc_blocks[joint];
            moment += self.disc_gradient[joint];
            let below = out[joint];
            for &column in &self.columns.top[joint] {
                active[self.columns.slot[column]] = self.weights[column] * pulls[column];
            }
            let mut product = self.joint_blocks[joint] * turn
                + blocks * (turn + below)
                + moment.cross(&below) * 0.5
                + above;
            if let Some(curving) = self.curving(joint, &moment) {
                product += curving * turn;
            }
            for (pull, slope) in active.iter().zip(&self.slopes[joint * slots..]) {
                product += slope * *pull;
            }
            for &column in &self.columns.bottom[joint] {
                active[self.columns.slot[column]] = 0.0;
            }
            above += blocks * turn + turn.cross(&moment) * 0.5;
            out[joint] = product;
        }
    }
}
