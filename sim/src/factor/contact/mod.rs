//! Solving in O(n) where tendons rub in their holes.
//!
//! To the potential's second derivatives ([`crate::energy`]) come products `c_j dT_j` of each segment's length slope and
//! of the derivative of its tension. A tension follows from that of the segment before, from the angle at the hole between
//! the two, and where the contact sticks from the length `B_j` of the tendon from there on:
//! `dT_j = d_j dT_(j-1) - v_j . w_(i-1) - u_j . w_i - k_j dB_j`, joint `i` being the one that the segment passes. So tensions run up the
//! chain and lengths run down. From the tip to the base, what lies above joint `i` is eliminated to a linear law
//! `M = P Omega + Q t`, `B = R Omega + S t`: `Omega` is the turn of the disc below, `t` the part of each tension that comes from below,
//! `M` the moment on that disc. Each joint costs one `3 x 3` inverse and one of as many rows as contacts stick there.
//!
//! There is no exchange of rows: callers multiply the solution by the matrix ([`ContactLu::product`]) to see that it is one.
#![allow(
    clippy::needless_range_loop,
    reason = "an index names one joint or slot in several arrays"
)]

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::motions::{carried_to, shifted, shifted_back, turn_of};
use crate::energy::{Columns, Expansion, noncommuting};
use crate::robot::{Robot, Tendon};

/// How the tension of a segment follows from what is before it, to first order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inflow {
    /// By the tension of the segment before; 0 for a tendon's first.
    pub before: f64,
    /// Decrease by the turn of the joint below (N/rad).
    pub below: Vector3<f64>,
    /// Decrease by the turn of its own joint (N/rad).
    pub own: Vector3<f64>,
    /// Decrease by the length of the tendon from this segment on (N/m).
    pub beyond: f64,
}

impl Inflow {
    /// A tension that depends on nothing.
    pub const NONE: Self = Self {
        before: 0.0,
        below: Vector3::new(0.0, 0.0, 0.0),
        own: Vector3::new(0.0, 0.0, 0.0),
        beyond: 0.0,
    };
}

/// A matrix that is factorised.
#[derive(Clone, Copy)]
pub(crate) struct RubbedMatrix<'a, const D: usize> {
    /// The potential's derivatives, the tendons' weights zero.
    pub expansion: &'a Expansion,
    /// What its Hessian, and the products `c_j dT_j`, are multiplied by.
    pub hessian: f64,
    pub tensions: f64,
    /// Centre of each joint (m), what is added to each joint's block, and to each disc's; empty where only turns count.
    pub centres: &'a [Vector3<f64>],
    pub joints: &'a [Matrix3<f64>],
    pub bodies: &'a [SMatrix<f64, D, D>],
}

impl<'a> RubbedMatrix<'a, 3> {
    /// The Hessian and the products alone.
    pub fn at_rest(expansion: &'a Expansion) -> Self {
        Self {
            expansion,
            hessian: 1.0,
            tensions: 1.0,
            centres: &[],
            joints: &[],
            bodies: &[],
        }
    }
}

/// The factors.
#[derive(Clone, Debug)]
pub(crate) struct ContactLu<const D: usize = 3> {
    columns: Columns,
    /// One for each joint and slot, entry `joint * slots + slot`.
    pub inflows: Vec<Inflow>,
    /// Centre of each joint from that of the joint below (m).
    arms: Vec<Vector3<f64>>,
    joints: Vec<JointFactor<D>>,
    slots: Vec<SlotFactor<D>>,
    /// By slot and slot: what the tensions that come in do to those that go on, and to the lengths.
    onward: Vec<f64>,
    shortening: Vec<f64>,
    /// Tensions lost at each joint and slot to the lengths beyond, in a solve.
    lost: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct JointFactor<const D: usize> {
    /// Inverse of the pivot.
    inverse: Matrix3<f64>,
    /// How the joint's equation depends on the motion below.
    row: SMatrix<f64, 3, D>,
    /// How the moment on the disc below depends on the joint's turn.
    col: SMatrix<f64, D, 3>,
}

#[derive(Clone, Copy, Debug)]
struct SlotFactor<const D: usize> {
    /// How the joint's equation depends on the tension that comes in.
    row: Vector3<f64>,
    /// How the length from here on depends on the joint's turn.
    col: Vector3<f64>,
    /// How the moment on the disc below depends on the tension that comes in.
    moment: SVector<f64, D>,
    /// Decrease of the tension that goes on by the joint's turn, and by the motion of the disc below.
    by_turn: Vector3<f64>,
    by_below: SVector<f64, D>,
}

macro_rules! with_slots {
    ($self:ident . $method:ident ( $($argument:expr),* )) => {
        match $self.columns.slots {
            0..=3 => $self.$method::<3>($($argument),*),
            4..=6 => $self.$method::<6>($($argument),*),
            7..=9 => $self.$method::<9>($($argument),*),
            10..=32 => $self.$method::<32>($($argument),*),
            _ => $self.$method::<64>($($argument),*),
        }
    };
}

mod transposed;

impl<const D: usize> ContactLu<D> {
    /// Storage for a robot each of whose tendons passes each joint at most once, by a segment of its own, from the base up;
    /// none for others.
    pub fn new(robot: &Robot, expansion: &Expansion) -> Option<Self> {
        let mut next: Vec<Option<usize>> = vec![None; robot.tendons().len()];
        let mut passed = vec![0; robot.tendons().len()];
        for segment in robot.segments() {
            let next = &mut next[segment.tendon];
            if next.is_some_and(|next| next != segment.joint)
                || segment.place != passed[segment.tendon]
            {
                return None;
            }
            *next = Some(segment.joint + 1);
            passed[segment.tendon] += 1;
        }
        let whole = |(tendon, passed): (&Tendon, &usize)| tendon.route.len() == passed + 1;
        if !robot.spans().is_empty() || !robot.tendons().iter().zip(&passed).all(whole) {
            return None;
        }
        let columns = expansion.columns.clone();
        let (n, slots) = (expansion.joint_blocks.len(), columns.slots);
        Some(Self {
            inflows: vec![Inflow::NONE; n * slots],
            arms: vec![Vector3::zeros(); n],
            joints: vec![
                JointFactor {
                    inverse: Matrix3::zeros(),
                    row: SMatrix::zeros(),
                    col: SMatrix::zeros(),
                };
                n
            ],
            slots: vec![
                SlotFactor {
                    row: Vector3::zeros(),
                    col: Vector3::zeros(),
                    moment: SVector::zeros(),
                    by_turn: Vector3::zeros(),
                    by_below: SVector::zeros(),
                };
                n * slots
            ],
            onward: vec![0.0; n * slots * slots],
            shortening: vec![0.0; n * slots * slots],
            lost: vec![0.0; n * slots],
            columns,
        })
    }

    /// Where the inflow of a tendon's segment at a joint is in [`ContactLu::inflows`].
    pub fn place(&self, joint: usize, tendon: usize) -> usize {
        joint * self.columns.slots + self.columns.slot[tendon]
    }

    /// Factorises a `matrix` with the tensions' slopes by the inflows. Returns whether every pivot has an inverse.
    pub fn factorise(&mut self, matrix: &RubbedMatrix<D>) -> bool {
        for (joint, pair) in matrix.centres.windows(2).enumerate() {
            self.arms[joint + 1] = pair[1] - pair[0];
        }
        with_slots!(self.eliminate(matrix))
    }

    fn eliminate<const A: usize>(&mut self, matrix: &RubbedMatrix<D>) -> bool {
        let (slots, n) = (self.columns.slots, self.joints.len());
        let (expansion, scale) = (matrix.expansion, matrix.hessian);
        let (zero, still) = (Vector3::zeros(), SVector::<f64, D>::zeros());
        // The law of what lies above: `P`, columns of `Q`, rows of `R`, and `S`; the moment carried.
        let (mut motions, mut carried) = (SMatrix::<f64, D, D>::zeros(), zero);
        let (mut moments, mut lengths) = ([still; A], [still; A]);
        let mut sums = [[0.0; A]; A];
        for joint in (0..n).rev() {
            if let Some(body) = matrix.bodies.get(joint) {
                motions += body;
            }
            let mut turns = motions.fixed_view_mut::<3, 3>(0, 0);
            turns += expansion.disc_blocks[joint] * scale;
            carried += expansion.disc_gradient[joint];
            let slopes = &expansion.slopes[joint * slots..][..slots];
            let own = &self.inflows[joint * slots..][..slots];
            let mut next = [Inflow::NONE; A];
            if joint + 1 < n {
                next[..slots].copy_from_slice(&self.inflows[(joint + 1) * slots..][..slots]);
            }
            // Lengths by the turn, and tensions by it (decreases) as long as lengths do not answer.
            let (mut stretch, mut drop) = ([zero; A], [zero; A]);
            for s in 0..slots {
                stretch[s] = slopes[s] + turn_of(&lengths[s]);
                for r in 0..slots {
                    stretch[s] -= next[r].below * sums[s][r];
                }
                drop[s] = own[s].own + stretch[s] * own[s].beyond;
            }
            // Tensions in the segments by those that come in, lengths answering.
            let mut answer = [[0.0; A]; A];
            if !answers(own, &next, &sums, &mut answer) {
                return false;
            }
            let mut shortening = [[0.0; A]; A];
            let (mut moment, mut row) = ([still; A], [zero; A]);
            for q in 0..slots {
                for r in 0..slots {
                    let goes_on = next[q].before * answer[q][r];
                    self.onward[(joint * slots + q) * slots + r] = goes_on;
                    moment[r] += moments[q] * goes_on;
                    row[r] += slopes[q] * (matrix.tensions * answer[q][r]);
                    for s in 0..slots {
                        shortening[s][r] += sums[s][q] * goes_on;
                    }
                }
            }
            // The pivot, and what couples the joint to the turn below.
            let mut pivot = expansion.joint_blocks[joint] * scale
                + matrix.joints.get(joint).copied().unwrap_or_default()
                + motions.fixed_view::<3, 3>(0, 0);
            let mut row_turn: SMatrix<f64, 3, D> = motions.fixed_rows::<3>(0).into_owned();
            let mut col_turn: SMatrix<f64, D, 3> = motions.fixed_columns::<3>(0).into_owned();
            let twisted = noncommuting(&carried) * scale;
            let mut turns = row_turn.fixed_columns_mut::<3>(0);
            turns += twisted.transpose();
            let mut turns = col_turn.fixed_rows_mut::<3>(0);
            turns += twisted;
            let mut reduced = motions;
            for s in 0..slots {
                row[s] += turn_of(&moment[s]);
                let wrapped = moments[s] * next[s].below.transpose();
                pivot -= wrapped.fixed_rows::<3>(0) + row[s] * drop[s].transpose();
                col_turn -= wrapped + moment[s] * drop[s].transpose();
                let held = lengths[s].transpose() * own[s].beyond;
                row_turn -= row[s] * held;
                reduced -= moment[s] * held;
            }
            // Hinges turn about their axes alone.
            let hinges = expansion.hinges(joint);
            if let (Some(hinges), Some(curving)) = (hinges, expansion.curving(joint, &carried)) {
                pivot = hinges.confine(&(pivot + curving * scale));
            }
            let Some(inverse) = pivot.try_inverse() else {
                return false;
            };
            let inverse = hinges.map_or(inverse, |hinges| hinges.release(&inverse));
            // The law of what lies above the joint below, about that joint's centre.
            let arm = &self.arms[joint];
            motions = shifted(&(reduced - col_turn * (inverse * row_turn)), arm);
            let mut eased = [zero; A];
            for r in 0..slots {
                eased[r] = inverse * row[r];
                moments[r] = shifted_back(&(moment[r] - col_turn * eased[r]), arm);
            }
            let mut col = [zero; A];
            let mut by_below = [still; A];
            let mut law = lengths;
            for s in 0..slots {
                col[s] = stretch[s];
                for r in 0..slots {
                    col[s] -= drop[r] * shortening[s][r];
                    let held = lengths[r] * own[r].beyond;
                    law[s] -= held * shortening[s][r];
                    by_below[s] += held * (next[s].before * answer[s][r]);
                }
                law[s] -= row_turn.tr_mul(&(inverse.tr_mul(&col[s])));
                for r in 0..slots {
                    sums[s][r] = shortening[s][r] - col[s].dot(&eased[r]);
                    self.shortening[(joint * slots + s) * slots + r] = shortening[s][r];
                }
            }
            lengths = law.map(|law| shifted_back(&law, arm));
            for s in 0..slots {
                let mut by_turn = next[s].below;
                for r in 0..slots {
                    by_turn += drop[r] * (next[s].before * answer[s][r]);
                }
                self.slots[joint * slots + s] = SlotFactor {
                    row: row[s],
                    col: col[s],
                    moment: moment[s],
                    by_turn,
                    by_below: by_below[s],
                };
            }
            self.joints[joint] = JointFactor {
                inverse,
                row: row_turn,
                col: col_turn,
            };
            // Tendons that begin here: their slots are free.
            for &column in &self.columns.bottom[joint] {
                let slot = self.columns.slot[column];
                (moments[slot], lengths[slot]) = (still, still);
                for r in 0..slots {
                    (sums[slot][r], sums[r][slot]) = (0.0, 0.0);
                }
            }
        }
        true
    }

    /// Writes the turns `w` of the joints (world axes) for which the matrix times `w` is `rhs`, for each joint the moment on all that
    /// it carries.
    pub fn solve(&mut self, rhs: &[Vector3<f64>], solution: &mut [Vector3<f64>]) {
        with_slots!(self.substitute(rhs, solution));
    }

    fn substitute<const A: usize>(&mut self, rhs: &[Vector3<f64>], solution: &mut [Vector3<f64>]) {
        let (slots, n) = (self.columns.slots, self.joints.len());
        // From the tip to the base: moment and lengths with the joints above at rest below.
        let mut moment = SVector::<f64, D>::zeros();
        let mut lengths = [0.0; A];
        for joint in (0..n).rev() {
            let (factor, at) = (&self.joints[joint], joint * slots);
            let own = &self.slots[at..][..slots];
            let mut right = rhs[joint] - turn_of(&moment);
            for s in 0..slots {
                let lost = self.inflows[at + s].beyond * lengths[s];
                self.lost[at + s] = lost;
                right += own[s].row * lost;
                moment -= own[s].moment * lost;
            }
            let eased = factor.inverse * right;
            moment = shifted_back(&(moment + factor.col * eased), &self.arms[joint]);
            let lost = &self.lost[at..][..slots];
            for s in 0..slots {
                let row = &self.shortening[(at + s) * slots..][..slots];
                let answered: f64 = row.iter().zip(lost).map(|(x, lost)| x * lost).sum();
                lengths[s] += own[s].col.dot(&eased) - answered;
            }
            for &column in &self.columns.bottom[joint] {
                lengths[self.columns.slot[column]] = 0.0;
            }
            solution[joint] = right;
        }
        // From the base to the tip: each turn, given the turn and the tensions below.
        let mut motion = SVector::<f64, D>::zeros();
        let mut tensions = [0.0; A];
        for joint in 0..n {
            let (factor, at) = (&self.joints[joint], joint * slots);
            let own = &self.slots[at..][..slots];
            motion = carried_to(&motion, &self.arms[joint]);
            let mut right = solution[joint] - factor.row * motion;
            for s in 0..slots {
                right -= own[s].row * tensions[s];
            }
            let step = factor.inverse * right;
            let mut onward = [0.0; A];
            for s in 0..slots {
                let row = &self.onward[(at + s) * slots..][..slots];
                let comes = tensions.iter().zip(&self.lost[at..][..slots]);
                let goes: f64 = row
                    .iter()
                    .zip(comes)
                    .map(|(x, (t, lost))| x * (t - lost))
                    .sum();
                onward[s] = goes - own[s].by_turn.dot(&step) - own[s].by_below.dot(&motion);
            }
            tensions = onward;
            let mut turn = motion.fixed_rows_mut::<3>(0);
            turn += step;
            solution[joint] = step;
        }
    }

    /// Writes the matrix that the inflows and `expansion` make, times the joints' `turns`.
    pub fn product(&self, expansion: &Expansion, turns: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        expansion.product(turns, out);
        let mut tensions = vec![0.0; turns.len() * self.columns.slots];
        self.tension_changes(expansion, turns, &mut tensions);
        self.pull(expansion, &tensions, out);
    }

    /// Adds the moments of tensions in the segments, an entry for each joint and slot as in [`ContactLu::inflows`].
    pub fn pull(&self, expansion: &Expansion, tensions: &[f64], out: &mut [Vector3<f64>]) {
        for (at, (tension, slope)) in tensions.iter().zip(&expansion.slopes).enumerate() {
            out[at / self.columns.slots] += slope * *tension;
        }
    }

    /// Writes what `turns` of the joints change of the segments' tensions by the inflows, an entry for each joint and slot (N).
    pub fn tension_changes(
        &self,
        expansion: &Expansion,
        turns: &[Vector3<f64>],
        tensions: &mut [f64],
    ) {
        let (slots, n) = (self.columns.slots, turns.len());
        // Lengths from each segment on, down the chain.
        let mut beyond = vec![0.0; n * slots];
        for at in (0..n * slots).rev() {
            let goes_on = |next: usize| next < n * slots && self.inflows[next].before != 0.0;
            let above = if goes_on(at + slots) {
                beyond[at + slots]
            } else {
                0.0
            };
            beyond[at] = expansion.slopes[at].dot(&turns[at / slots]) + above;
        }
        // Tensions, up the chain.
        for at in 0..n * slots {
            let (joint, inflow) = (at / slots, &self.inflows[at]);
            let mut tension = -inflow.own.dot(&turns[joint]) - inflow.beyond * beyond[at];
            if joint > 0 {
                tension +=
                    inflow.before * tensions[at - slots] - inflow.below.dot(&turns[joint - 1]);
            }
            tensions[at] = tension;
        }
    }
}

/// Writes `(1 + K S D)⁻¹`: the tensions in the segments at a joint by those that come in, where the lengths beyond answer by `S` to
/// the tensions that go on. By elimination of the rows of contacts that stick; those of others are rows of the identity.
fn answers<const A: usize>(
    own: &[Inflow],
    next: &[Inflow; A],
    sums: &[[f64; A]; A],
    out: &mut [[f64; A]; A],
) -> bool {
    let slots = own.len();
    for s in 0..slots {
        out[s][s] = 1.0;
        if own[s].beyond != 0.0 {
            for r in 0..slots {
                let answer = own[s].beyond * sums[s][r] * next[r].before;
                // Columns of rows that are not eliminated change their sign.
                out[s][r] += if own[r].beyond == 0.0 {
                    -answer
                } else {
                    answer
                };
            }
        }
    }
    for pivot in (0..slots).filter(|&s| own[s].beyond != 0.0) {
        let inverse = 1.0 / out[pivot][pivot];
        if !inverse.is_finite() {
            return false;
        }
        out[pivot][pivot] = 1.0;
        out[pivot].iter_mut().for_each(|x| *x *= inverse);
        let eliminated = out[pivot];
        for s in 0..slots {
            let factor = out[s][pivot];
            if s != pivot && factor != 0.0 {
                out[s][pivot] = 0.0;
                for r in 0..slots {
                    out[s][r] -= factor * eliminated[r];
                }
            }
        }
    }
    true
}
