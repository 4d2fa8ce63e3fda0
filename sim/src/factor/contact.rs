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

use nalgebra::{Matrix3, Vector3};

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

/// The factors.
#[derive(Clone, Debug)]
pub(crate) struct ContactLu {
    columns: Columns,
    /// One for each joint and slot, entry `joint * slots + slot`.
    pub inflows: Vec<Inflow>,
    joints: Vec<JointFactor>,
    slots: Vec<SlotFactor>,
    /// By slot and slot: what the tensions that come in do to those that go on, and to the lengths.
    onward: Vec<f64>,
    shortening: Vec<f64>,
    /// Tensions lost at each joint and slot to the lengths beyond, in a solve.
    lost: Vec<f64>,
}

#[derive(Clone, Copy, Debug, Default)]
struct JointFactor {
    /// Inverse of the pivot.
    inverse: Matrix3<f64>,
    /// How the joint's equation depends on the turn below.
    row: Matrix3<f64>,
    /// How the moment on the disc below depends on the joint's turn.
    col: Matrix3<f64>,
}

#[derive(Clone, Copy, Debug, Default)]
struct SlotFactor {
    /// How the joint's equation depends on the tension that comes in.
    row: Vector3<f64>,
    /// How the length from here on depends on the joint's turn.
    col: Vector3<f64>,
    /// How the moment on the disc below depends on the tension that comes in.
    moment: Vector3<f64>,
    /// Decrease of the tension that goes on by the joint's turn, and by the turn of the disc below.
    by_turn: Vector3<f64>,
    by_below: Vector3<f64>,
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

impl ContactLu {
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
            joints: vec![JointFactor::default(); n],
            slots: vec![SlotFactor::default(); n * slots],
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

    /// Factorises the second derivatives in `expansion`, whose tendons' weights are zero, with the tensions' slopes by the
    /// inflows. Returns whether every pivot has an inverse.
    pub fn factorise(&mut self, expansion: &Expansion) -> bool {
        with_slots!(self.eliminate(expansion))
    }

    fn eliminate<const A: usize>(&mut self, expansion: &Expansion) -> bool {
        let (slots, n) = (self.columns.slots, self.joints.len());
        let zero = Vector3::zeros();
        // The law of what lies above: `P`, columns of `Q`, rows of `R`, and `S`; the moment carried.
        let (mut turns, mut carried) = (Matrix3::zeros(), zero);
        let (mut moments, mut lengths) = ([zero; A], [zero; A]);
        let mut sums = [[0.0; A]; A];
        for joint in (0..n).rev() {
            turns += expansion.disc_blocks[joint];
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
                stretch[s] = slopes[s] + lengths[s];
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
            let (mut moment, mut row) = ([zero; A], [zero; A]);
            for q in 0..slots {
                for r in 0..slots {
                    let goes_on = next[q].before * answer[q][r];
                    self.onward[(joint * slots + q) * slots + r] = goes_on;
                    moment[r] += moments[q] * goes_on;
                    row[r] += slopes[q] * answer[q][r];
                    for s in 0..slots {
                        shortening[s][r] += sums[s][q] * goes_on;
                    }
                }
            }
            // The pivot, and what couples the joint to the turn below.
            let twisted = noncommuting(&carried);
            let mut pivot = expansion.joint_blocks[joint] + turns;
            let (mut row_turn, mut col_turn) = (turns + twisted.transpose(), turns + twisted);
            let mut reduced = turns;
            for s in 0..slots {
                row[s] += moment[s];
                let wrapped = moments[s] * next[s].below.transpose();
                pivot -= wrapped + row[s] * drop[s].transpose();
                col_turn -= wrapped + moment[s] * drop[s].transpose();
                let held = lengths[s].transpose() * own[s].beyond;
                row_turn -= row[s] * held;
                reduced -= moment[s] * held;
            }
            // Hinges turn about their axes alone.
            let hinges = expansion.hinges(joint);
            if let (Some(hinges), Some(curving)) = (hinges, expansion.curving(joint, &carried)) {
                pivot = hinges.confine(&(pivot + curving));
            }
            let Some(inverse) = pivot.try_inverse() else {
                return false;
            };
            let inverse = hinges.map_or(inverse, |hinges| hinges.release(&inverse));
            // The law of what lies above the joint below.
            turns = reduced - col_turn * (inverse * row_turn);
            let mut eased = [zero; A];
            for r in 0..slots {
                eased[r] = inverse * row[r];
                moments[r] = moment[r] - col_turn * eased[r];
            }
            let mut col = [zero; A];
            let mut by_below = [zero; A];
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
            lengths = law;
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
                (moments[slot], lengths[slot]) = (zero, zero);
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
        let mut moment = Vector3::zeros();
        let mut lengths = [0.0; A];
        for joint in (0..n).rev() {
            let (factor, at) = (&self.joints[joint], joint * slots);
            let own = &self.slots[at..][..slots];
            let mut right = rhs[joint] - moment;
            for s in 0..slots {
                let lost = self.inflows[at + s].beyond * lengths[s];
                self.lost[at + s] = lost;
                right += own[s].row * lost;
                moment -= own[s].moment * lost;
            }
            let eased = factor.inverse * right;
            moment += factor.col * eased;
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
        let mut turn = Vector3::zeros();
        let mut tensions = [0.0; A];
        for joint in 0..n {
            let (factor, at) = (&self.joints[joint], joint * slots);
            let own = &self.slots[at..][..slots];
            let mut right = solution[joint] - factor.row * turn;
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
                onward[s] = goes - own[s].by_turn.dot(&step) - own[s].by_below.dot(&turn);
            }
            tensions = onward;
            turn += step;
            solution[joint] = step;
        }
    }

    /// Writes the matrix that the inflows and `expansion` make, times the joints' `turns`.
    pub fn product(&self, expansion: &Expansion, turns: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        let (slots, n) = (self.columns.slots, turns.len());
        expansion.product(turns, out);
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
        let mut tensions = vec![0.0; n * slots];
        for at in 0..n * slots {
            let (joint, inflow) = (at / slots, &self.inflows[at]);
            let mut tension = -inflow.own.dot(&turns[joint]) - inflow.beyond * beyond[at];
            if joint > 0 {
                tension +=
                    inflow.before * tensions[at - slots] - inflow.below.dot(&turns[joint - 1]);
            }
            tensions[at] = tension;
            out[joint] += expansion.slopes[at] * tension;
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
