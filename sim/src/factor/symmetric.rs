//! Solving in O(n) with symmetric matrices in which discs' displacements count beside their turns: block `L D L'`.
//!
//! The matrix is that of [`super::unsymmetric`], with symmetric `S_k`: a potential's Hessian with contacts or inertias. What lies above
//! a joint enters as a quadratic of the motion of the disc below, `[A B; B' D]` of its turn and its displacement, and of the partial sums
//! of the columns, as in [`super::Factor`]. Half of what the general elimination computes is known from the other half, so it takes less
//! than half of the time.
#![allow(
    clippy::needless_range_loop,
    reason = "an index names one slot in several arrays"
)]

use nalgebra::{Matrix3, Vector3};

use super::Curvature;
use super::unsymmetric::{ChainMatrix, is_positive};
use crate::energy::{Columns, Expansion, noncommuting};

/// The factors.
#[derive(Clone, Debug)]
pub(crate) struct ChainLdl {
    columns: Columns,
    slopes: Vec<Vector3<f64>>,
    joints: Vec<JointFactor>,
    /// How each joint's equation depends on each slot's partial sum.
    sums: Vec<Vector3<f64>>,
    negative: usize,
}

/// What the elimination leaves of a joint.
#[derive(Clone, Copy, Debug)]
struct JointFactor {
    /// Centre of the joint from that of the joint below (m).
    arm: Vector3<f64>,
    /// Inverse of the pivot.
    inverse: Matrix3<f64>,
    /// How the joint's equation depends on the turn and the displacement of the disc below.
    turn: Matrix3<f64>,
    shift: Matrix3<f64>,
}

macro_rules! with_slots {
    ($self:ident . $method:ident ( $($argument:expr),* )) => {
        match $self.columns.slots {
            0..=3 => $self.$method::<3>($($argument),*),
            4..=6 => $self.$method::<6>($($argument),*),
            7..=9 => $self.$method::<9>($($argument),*),
            10..=15 => $self.$method::<15>($($argument),*),
            16..=32 => $self.$method::<32>($($argument),*),
            _ => $self.$method::<64>($($argument),*),
        }
    };
}

impl ChainLdl {
    /// Storage for factors of matrices with Hessians like that of `expansion`.
    pub fn new(expansion: &Expansion) -> Self {
        let n = expansion.joint_blocks.len();
        let columns = expansion.columns.clone();
        let none = JointFactor {
            arm: Vector3::zeros(),
            inverse: Matrix3::zeros(),
            turn: Matrix3::zeros(),
            shift: Matrix3::zeros(),
        };
        Self {
            slopes: vec![Vector3::zeros(); n * columns.slots],
            joints: vec![none; n],
            sums: vec![Vector3::zeros(); n * columns.slots],
            negative: 0,
            columns,
        }
    }

    /// Factorises the matrix, whose `S_k` are symmetric. [`Curvature::Positive`] if it is positive definite; `None` if a pivot has no
    /// inverse.
    pub fn factorise(&mut self, matrix: &ChainMatrix) -> Option<Curvature> {
        self.slopes.copy_from_slice(&matrix.expansion.slopes);
        for (joint, factor) in self.joints.iter_mut().enumerate() {
            let below = joint.checked_sub(1).map(|below| matrix.centres[below]);
            factor.arm = matrix.centres[joint] - below.unwrap_or(matrix.centres[joint]);
        }
        with_slots!(self.eliminate(matrix))
    }

    /// Length of the chain of joints (m).
    pub fn reach(&self) -> f64 {
        self.joints.iter().map(|factor| factor.arm.norm()).sum()
    }

    /// How many eigenvalues of the matrix are negative: as many as of the pivots (Sylvester's law of inertia).
    pub fn negative_eigenvalues(&self) -> usize {
        self.negative
    }

    fn eliminate<const A: usize>(&mut self, matrix: &ChainMatrix) -> Option<Curvature> {
        let slots = self.columns.slots;
        let (expansion, scale) = (matrix.expansion, matrix.scale);
        self.negative = 0;
        // The quadratic of what lies above: turn and turn, turn and displacement, displacement and displacement, then each of these
        // and sum, sum and sum.
        let (mut turns, mut mixed) = (Matrix3::zeros(), Matrix3::<f64>::zeros());
        let mut shifts = Matrix3::<f64>::zeros();
        let (mut moment, mut above) = (Vector3::zeros(), Vector3::zeros());
        let (mut by_turn, mut by_shift) = ([Vector3::zeros(); A], [Vector3::zeros(); A]);
        let mut sums = [[0.0; A]; A];
        for joint in (0..self.joints.len()).rev() {
            // This disc's own terms, and the columns that start here.
            let body = &matrix.bodies[joint];
            turns += expansion.disc_blocks[joint] * scale + body.fixed_view::<3, 3>(0, 0);
            mixed += body.fixed_view::<3, 3>(0, 3);
            shifts += body.fixed_view::<3, 3>(3, 3);
            moment += expansion.disc_gradient[joint] * scale;
            above += expansion.disc_gradient[joint];
            for &column in &self.columns.top[joint] {
                let slot = self.columns.slot[column];
                sums[slot][slot] = expansion.weights[column] * scale;
            }
            let mut slopes = [Vector3::zeros(); A];
            slopes[..slots].copy_from_slice(&self.slopes[joint * slots..][..slots]);
            // How the joint's turn couples to the motion below and to the partial sums.
            let (mut turn, mut shift) = (turns, mixed);
            let mut partial = by_turn;
            for s in 0..A {
                turn += slopes[s] * by_turn[s].transpose();
                shift += slopes[s] * by_shift[s].transpose();
                for r in 0..A {
                    partial[s] += slopes[r] * sums[s][r];
                }
            }
            // The pivot: the joint's own block, and the quadratic along its turn.
            let mut pivot = expansion.joint_blocks[joint] * scale + matrix.joints[joint] + turn;
            for s in 0..A {
                pivot += partial[s] * slopes[s].transpose();
            }
            // Hinges turn about their axes alone.
            let hinges = expansion.hinges(joint);
            if let (Some(hinges), Some(curving)) = (hinges, expansion.curving(joint, &above)) {
                pivot = hinges.confine(&(pivot + curving * scale));
            }
            let inverse = pivot.try_inverse()?;
            let inverse = hinges.map_or(inverse, |hinges| hinges.release(&inverse));
            if !is_positive(&pivot) {
                self.negative += negative_eigenvalues(&pivot);
            }
            turn += noncommuting(&moment).transpose();
            // Schur complement.
            let (eased_turn, eased_shift) = (inverse * turn, inverse * shift);
            turns -= turn.tr_mul(&eased_turn);
            mixed -= turn.tr_mul(&eased_shift);
            shifts -= shift.tr_mul(&eased_shift);
            // About the centre of the joint below: a displacement there by `v` and a turn by `w` is one by `v + w x arm` here.
            let factor = &mut self.joints[joint];
            let arm = factor.arm;
            let lever = crossed(&arm, &shifts);
            let levered = crossed(&arm, &mixed.transpose());
            turns += levered + levered.transpose() + crossed(&arm, &lever.transpose());
            mixed += lever;
            for s in 0..A {
                let eased = inverse * partial[s];
                by_shift[s] -= shift.tr_mul(&eased);
                by_turn[s] += arm.cross(&by_shift[s]) - turn.tr_mul(&eased);
                for r in 0..=s {
                    sums[s][r] -= eased.dot(&partial[r]);
                    sums[r][s] = sums[s][r];
                }
            }
            // Columns that end here: their slots are free.
            for &column in &self.columns.bottom[joint] {
                let slot = self.columns.slot[column];
                (by_turn[slot], by_shift[slot]) = (Vector3::zeros(), Vector3::zeros());
                for r in 0..A {
                    (sums[slot][r], sums[r][slot]) = (0.0, 0.0);
                }
            }
            (factor.inverse, factor.turn, factor.shift) = (inverse, turn, shift);
            self.sums[joint * slots..][..slots].copy_from_slice(&partial[..slots]);
        }
        Some(match self.negative {
            0 => Curvature::Positive,
            _ => Curvature::Modified,
        })
    }

    /// Writes the solution for a right-hand side of `joint` terms and terms of the `disc`s' turns, as in [`Expansion`].
    pub fn solve(
        &self,
        joint: &[Vector3<f64>],
        disc: &[Vector3<f64>],
        solution: &mut [Vector3<f64>],
    ) {
        with_slots!(self.substitute(joint, disc, solution));
    }

    fn substitute<const A: usize>(
        &self,
        joint_terms: &[Vector3<f64>],
        disc_terms: &[Vector3<f64>],
        solution: &mut [Vector3<f64>],
    ) {
        let (slots, n) = (self.columns.slots, self.joints.len());
        // From the tip to the base: the right-hand side with the joints above eliminated.
        let (mut by_turn, mut by_shift) = (Vector3::zeros(), Vector3::<f64>::zeros());
        let mut by_sum = [0.0; A];
        for joint in (0..n).rev() {
            let factor = &self.joints[joint];
            by_turn += disc_terms[joint];
            let mut moment = joint_terms[joint] + by_turn;
            for (slope, sum) in self.slopes[joint * slots..][..slots].iter().zip(&by_sum) {
                moment += slope * *sum;
            }
            let eased = factor.inverse * moment;
            by_shift -= factor.shift.tr_mul(&eased);
            by_turn += factor.arm.cross(&by_shift) - factor.turn.tr_mul(&eased);
            let partial = self.sums[joint * slots..][..slots].iter().zip(&mut by_sum);
            partial.for_each(|(partial, sum)| *sum -= partial.dot(&eased));
            for &column in &self.columns.bottom[joint] {
                by_sum[self.columns.slot[column]] = 0.0;
            }
            solution[joint] = moment;
        }
        // From the base to the tip: each turn, given the motion below.
        let (mut turn, mut shift) = (Vector3::<f64>::zeros(), Vector3::<f64>::zeros());
        let mut sums = [0.0; A];
        for joint in 0..n {
            let factor = &self.joints[joint];
            shift += turn.cross(&factor.arm);
            let mut moment = solution[joint] - factor.turn * turn - factor.shift * shift;
            let partial = self.sums[joint * slots..][..slots].iter().zip(&sums);
            partial.for_each(|(partial, sum)| moment -= partial * *sum);
            let own: Vector3<f64> = factor.inverse * moment;
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

/// `[arm]x m`.
fn crossed(arm: &Vector3<f64>, m: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[
        arm.cross(&m.column(0)),
        arm.cross(&m.column(1)),
        arm.cross(&m.column(2)),
    ])
}

/// How many eigenvalues of a symmetric matrix are negative, by its leading minors (Jacobi's signature rule).
fn negative_eigenvalues(m: &Matrix3<f64>) -> usize {
    let minors = [
        m[(0, 0)],
        m.fixed_view::<2, 2>(0, 0).determinant(),
        m.determinant(),
    ];
    let mut above = true;
    let changes = minors.iter().filter(|&&minor| {
        let changed = (minor > 0.0) != above;
        above = minor > 0.0;
        changed
    });
    changes.count()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use nalgebra::Matrix6;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::chain::Configuration;
    use crate::energy::{DeadForces, Potential};
    use crate::factor::{ChainLu, Side};
    use crate::robot::{Loads, Robot};
    use crate::solve::Iterate;

    /// Hessians of robots in bent poses, with random forms of their discs' motions: the general elimination, which does not know of
    /// the symmetry, has the same solutions, and the same of positive and indefinite matrices.
    #[test]
    fn solutions_are_those_of_the_elimination_without_symmetry() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for name in ["2m", "3m", "5m"] {
            let robot = Robot::load(name).unwrap();
            let n = robot.discs().len();
            let command = robot.random_command(&mut rng);
            let bent = robot.settle(&robot.random_command(&mut rng), &Loads::default());
            let mut dead = DeadForces::new(&robot);
            dead.set(&robot, &Loads::default());
            let potential = Potential {
                robot: &robot,
                command: command.as_slice(),
                dead: &dead,
            };
            let mut iterate = Iterate::new(&robot);
            iterate.set(&Configuration(bent.configuration.0.clone()));
            let mut expansion = Expansion::new(&robot);
            potential.expand(&iterate.configuration, &iterate.posture, &mut expansion);
            let (mut symmetric, mut general) =
                (ChainLdl::new(&expansion), ChainLu::new(&expansion));
            for stiffness in [0.0, 10.0, -0.01] {
                let joints = vec![Matrix3::identity() * stiffness; n];
                let mut form = || {
                    let m = Matrix6::<f64>::from_fn(|_, _| rng.random_range(-1.0..1.0));
                    m * m.transpose()
                };
                let bodies: Vec<_> = (0..n).map(|_| form()).collect();
                let matrix = ChainMatrix {
                    expansion: &expansion,
                    scale: 1.0,
                    centres: &iterate.posture.chain.centres,
                    joints: &joints,
                    bodies: &bodies,
                };
                assert_eq!(symmetric.factorise(&matrix), general.factorise(&matrix));
                let mut terms = || -> Vec<Vector3<f64>> {
                    let term = |_| Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
                    (0..n).map(term).collect()
                };
                let (joint, disc) = (terms(), terms());
                let mut solutions = [vec![Vector3::zeros(); n], vec![Vector3::zeros(); n]];
                symmetric.solve(&joint, &disc, &mut solutions[0]);
                general.solve(&joint, &disc, Side::Matrix, &mut solutions[1]);
                let largest = solutions[1].iter().map(Vector3::norm).fold(0.0, f64::max);
                for (one, other) in solutions[0].iter().zip(&solutions[1]) {
                    assert!((one - other).norm() < 1e-9 * largest, "{name} {stiffness}");
                }
            }
        }
    }
}
