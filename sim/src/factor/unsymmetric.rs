//! Solving in O(n) where following loads or inertias act: block LU of matrices that need not be symmetric.
//!
//! The matrix is the bilinear form of the joints' turns `w` and of test turns `w'` that [`crate::energy`] has, and besides
//! `sum_k z_k' S_k z_k`: `z_k` is the motion of disc `k`, its turn and the displacement of its joint's centre, `S_k` a `6 x 6`
//! matrix. A following force couples the displacement of the test motion to the turn, an inertia both to both. The
//! elimination is that of [`super::Factor`], with motions in place of turns; the pivots are `3 x 3` blocks, inverted with
//! no exchange of rows between joints.

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Matrix6x3, Vector3, Vector6};

use super::Curvature;
use super::motions::{shifted, shifted_back};
use crate::energy::{Columns, Expansion, noncommuting};

/// A matrix that is factorised: `scale` times a potential's Hessian, and more blocks on joints and discs.
#[derive(Clone, Copy)]
pub(crate) struct ChainMatrix<'a> {
    /// The potential's derivatives, the moments of following loads in its gradient.
    pub expansion: &'a Expansion,
    /// What its Hessian is multiplied by.
    pub scale: f64,
    /// Centre of each joint (m).
    pub centres: &'a [Vector3<f64>],
    /// What is added to each joint's block.
    pub joints: &'a [Matrix3<f64>],
    /// The `S_k`.
    pub bodies: &'a [Matrix6<f64>],
}

/// Which of the matrix and its transpose to solve with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Matrix,
    Transpose,
}

/// The factors.
#[derive(Clone, Debug)]
pub(crate) struct ChainLu {
    columns: Columns,
    slopes: Vec<Vector3<f64>>,
    /// Centre of each joint from that of the joint below (m).
    arms: Vec<Vector3<f64>>,
    /// Inverse of each joint's pivot.
    pivots: Vec<Matrix3<f64>>,
    /// How the joint's equation depends on the motion of the disc below, and on each slot's partial sum.
    rows: Vec<Matrix3x6<f64>>,
    row_sums: Vec<Vector3<f64>>,
    /// How the equations of those depend on the joint's turn.
    cols: Vec<Matrix6x3<f64>>,
    col_sums: Vec<Vector3<f64>>,
}

macro_rules! with_slots {
    ($self:ident . $method:ident ( $($argument:expr),* )) => {
        match $self.columns.slots {
            0..=3 => $self.$method::<3>($($argument),*),
            4..=9 => $self.$method::<9>($($argument),*),
            10..=32 => $self.$method::<32>($($argument),*),
            _ => $self.$method::<64>($($argument),*),
        }
    };
}

impl ChainLu {
    /// Storage for factors of matrices with Hessians like that of `expansion`.
    pub fn new(expansion: &Expansion) -> Self {
        let n = expansion.joint_blocks.len();
        let columns = expansion.columns.clone();
        let sums = vec![Vector3::zeros(); n * columns.slots];
        Self {
            slopes: sums.clone(),
            arms: vec![Vector3::zeros(); n],
            pivots: vec![Matrix3::zeros(); n],
            rows: vec![Matrix3x6::zeros(); n],
            row_sums: sums.clone(),
            cols: vec![Matrix6x3::zeros(); n],
            col_sums: sums,
            columns,
        }
    }

    /// Factorises the matrix. [`Curvature::Positive`] if the symmetric part of every pivot is positive definite, which is
    /// so where that of the matrix is; `None` if a pivot has no inverse.
    pub fn factorise(&mut self, matrix: &ChainMatrix) -> Option<Curvature> {
        self.slopes.copy_from_slice(&matrix.expansion.slopes);
        for (joint, arm) in self.arms.iter_mut().enumerate() {
            let below = joint.checked_sub(1).map(|below| matrix.centres[below]);
            *arm = matrix.centres[joint] - below.unwrap_or(matrix.centres[joint]);
        }
        with_slots!(self.eliminate(matrix))
    }

    fn eliminate<const A: usize>(&mut self, matrix: &ChainMatrix) -> Option<Curvature> {
        let slots = self.columns.slots;
        let (expansion, scale) = (matrix.expansion, matrix.scale);
        let mut curvature = Curvature::Positive;
        // The form of what lies above: by motion and motion, motion and sum, sum and motion, sum and sum.
        let mut bodies = Matrix6::zeros();
        let (mut moment, mut above) = (Vector3::zeros(), Vector3::zeros());
        let mut up = [Vector6::zeros(); A];
        let mut down = [Vector6::zeros(); A];
        let mut sums = [[0.0; A]; A];
        for joint in (0..self.pivots.len()).rev() {
            // This disc's own terms, and the columns that start here.
            let mut own = matrix.bodies[joint];
            let mut turns = own.fixed_view_mut::<3, 3>(0, 0);
            turns += expansion.disc_blocks[joint] * scale;
            bodies += own;
            moment += expansion.disc_gradient[joint] * scale;
            above += expansion.disc_gradient[joint];
            for &column in &self.columns.top[joint] {
                let slot = self.columns.slot[column];
                sums[slot][slot] = expansion.weights[column] * scale;
            }
            let slopes = &self.slopes[joint * slots..][..slots];
            // How the joint's turn couples to the motion below and to the partial sums, both ways.
            let mut col: Matrix6x3<f64> = bodies.fixed_columns::<3>(0).into_owned();
            let mut row: Matrix3x6<f64> = bodies.fixed_rows::<3>(0).into_owned();
            let mut col_sums = [Vector3::zeros(); A];
            let mut row_sums = [Vector3::zeros(); A];
            for (s, slope) in slopes.iter().enumerate() {
                col += up[s] * slope.transpose();
                row += slope * down[s].transpose();
            }
            for s in 0..slots {
                col_sums[s] = down[s].fixed_rows::<3>(0).into_owned();
                row_sums[s] = up[s].fixed_rows::<3>(0).into_owned();
                for (r, slope) in slopes.iter().enumerate() {
                    col_sums[s] += slope * sums[s][r];
                    row_sums[s] += slope * sums[r][s];
                }
            }
            // The pivot: the joint's own block, and the form along its turn.
            let mut pivot = expansion.joint_blocks[joint] * scale + matrix.joints[joint];
            pivot += col.fixed_rows::<3>(0);
            for (s, slope) in slopes.iter().enumerate() {
                pivot += slope * col_sums[s].transpose();
            }
            // Hinges turn about their axes alone.
            let hinges = expansion.hinges(joint);
            if let (Some(hinges), Some(curving)) = (hinges, expansion.curving(joint, &above)) {
                pivot = hinges.confine(&(pivot + curving * scale));
            }
            let inverse = pivot.try_inverse()?;
            let inverse = hinges.map_or(inverse, |hinges| hinges.release(&inverse));
            if !is_positive(&pivot) {
                curvature = Curvature::Modified;
            }
            let twisted = noncommuting(&moment);
            let mut turns = col.fixed_rows_mut::<3>(0);
            turns += twisted;
            let mut turns = row.fixed_columns_mut::<3>(0);
            turns += twisted.transpose();
            // Schur complement, about the centre of the joint below.
            let eased = inverse * row;
            bodies = shifted(&(bodies - col * eased), &self.arms[joint]);
            for s in 0..slots {
                let eased = inverse * row_sums[s];
                for r in 0..slots {
                    sums[r][s] -= col_sums[r].dot(&eased);
                }
            }
            for s in 0..slots {
                up[s] = shifted_back(&(up[s] - col * (inverse * row_sums[s])), &self.arms[joint]);
                let sum = down[s] - eased.tr_mul(&col_sums[s]);
                down[s] = shifted_back(&sum, &self.arms[joint]);
            }
            // Columns that end here: their slots are free.
            for &column in &self.columns.bottom[joint] {
                let slot = self.columns.slot[column];
                (up[slot], down[slot]) = (Vector6::zeros(), Vector6::zeros());
                for r in 0..slots {
                    (sums[slot][r], sums[r][slot]) = (0.0, 0.0);
                }
            }
            self.pivots[joint] = inverse;
            (self.rows[joint], self.cols[joint]) = (row, col);
            self.row_sums[joint * slots..][..slots].copy_from_slice(&row_sums[..slots]);
            self.col_sums[joint * slots..][..slots].copy_from_slice(&col_sums[..slots]);
        }
        Some(curvature)
    }

    /// Writes the solution for a right-hand side of `joint` terms and terms of the `disc`s' turns, as in [`Expansion`].
    pub fn solve(
        &self,
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        side: Side,
        solution: &mut [Vector3<f64>],
    ) {
        with_slots!(self.substitute(joint, disc, side, solution));
    }

    fn substitute<const A: usize>(
        &self,
        joint_terms: &[Vector3<f64>],
        disc_terms: &[Vector3<f64>],
        side: Side,
        solution: &mut [Vector3<f64>],
    ) {
        let (slots, n) = (self.columns.slots, self.pivots.len());
        let (row_sums, col_sums) = match side {
            Side::Matrix => (&self.row_sums, &self.col_sums),
            Side::Transpose => (&self.col_sums, &self.row_sums),
        };
        let pivot = |joint: usize| match side {
            Side::Matrix => self.pivots[joint],
            Side::Transpose => self.pivots[joint].transpose(),
        };
        // From the tip to the base: the right-hand side with the joints above eliminated.
        let mut by_motion = Vector6::zeros();
        let mut by_sum = [0.0; A];
        for joint in (0..n).rev() {
            let mut by_turn = by_motion.fixed_rows_mut::<3>(0);
            by_turn += disc_terms[joint];
            let mut moment = joint_terms[joint] + by_turn;
            for (slope, sum) in self.slopes[joint * slots..][..slots].iter().zip(&by_sum) {
                moment += slope * *sum;
            }
            let eased = pivot(joint) * moment;
            by_motion -= match side {
                Side::Matrix => self.cols[joint] * eased,
                Side::Transpose => self.rows[joint].tr_mul(&eased),
            };
            by_motion = shifted_back(&by_motion, &self.arms[joint]);
            let sums = col_sums[joint * slots..][..slots].iter().zip(&mut by_sum);
            sums.for_each(|(col, sum)| *sum -= col.dot(&eased));
            for &column in &self.columns.bottom[joint] {
                by_sum[self.columns.slot[column]] = 0.0;
            }
            solution[joint] = moment;
        }
        // From the base to the tip: each turn, given the motion below.
        let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
        let mut sums = [0.0; A];
        for joint in 0..n {
            shift += turn.cross(&self.arms[joint]);
            let mut motion = Vector6::zeros();
            motion.fixed_rows_mut::<3>(0).copy_from(&turn);
            motion.fixed_rows_mut::<3>(3).copy_from(&shift);
            let mut moment = solution[joint]
                - match side {
                    Side::Matrix => self.rows[joint] * motion,
                    Side::Transpose => self.cols[joint].tr_mul(&motion),
                };
            for (row, sum) in row_sums[joint * slots..][..slots].iter().zip(&sums) {
                moment -= row * *sum;
            }
            let own: Vector3<f64> = pivot(joint) * moment;
            turn += own;
            let slopes = &self.slopes[joint * slots..][..slots];
            for (slope, sum) in slopes.iter().zip(&mut sums) {
                *sum += slope.dot(&own);
            }
            for &column in &self.columns.top[joint] {
                sums[self.columns.slot[column]] = 0.0;
            }
            solution[joint] = own;
        }
    }
}

/// Whether the symmetric part is positive definite (Sylvester's criterion).
pub(super) fn is_positive(m: &Matrix3<f64>) -> bool {
    let symmetric = (m + m.transpose()) * 0.5;
    let minor = symmetric.fixed_view::<2, 2>(0, 0).determinant();
    symmetric[(0, 0)] > 0.0 && minor > 0.0 && symmetric.determinant() > 0.0
}
