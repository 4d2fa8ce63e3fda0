//! What ties discs of the robot together in the velocity problem: discs that touch each other, and tendons of commanded length.
//!
//! What acts on several discs at once has its form in no disc's own: each direction of it adds `k G G'` to the matrix `A + J'HJ`, where
//! `G' w` is what it has of a velocity by changes `w` of the joints' rates. With the impulses `l` as unknowns, `l = p - k G' w`, and
//! `Y = (A + J'HJ)^-1 G`, the solution without them, `w0`, becomes `w0 + Y l`, where `(1/k + G' Y) l = p/k - G' w0` (Woodbury's formula): a
//! dense matrix of what ties, whose columns take one solve with the robot's factorised matrix each.

use std::ops::Range;

use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, DVector, Dyn, Matrix3, Vector3};

use super::coupled::Responds;
use super::tendons::HeldTendon;
use super::touch::{DiscVelocities, Response, Side, Touch};
use crate::dynamics::Reaction;

/// A direction in which several discs are tied, as the linearised problem has it.
#[derive(Clone, Debug)]
struct Tie {
    /// The parts of its unit impulse.
    parts: Range<usize>,
    /// `k` (kg), and `p` (N s).
    inertance: f64,
    impulse: f64,
}

/// What a unit impulse does to a disc: a moment about the centre of its joint (m), and a force.
#[derive(Clone, Copy, Debug)]
struct Part {
    disc: usize,
    moment: Vector3<f64>,
    force: Vector3<f64>,
}

/// The ties that act in an iteration, and workspace.
#[derive(Clone, Debug, Default)]
pub(super) struct Ties {
    all: Vec<Tie>,
    parts: Vec<Part>,
    /// `Y`.
    columns: Vec<Vec<Vector3<f64>>>,
    factor: Option<Cholesky<f64, Dyn>>,
    /// A unit impulse on one tie.
    unit: Vec<Reaction>,
    spatial: DiscVelocities,
}

impl Ties {
    /// Takes what acts by its law: contacts between discs, and tendons. What of their impulses does not change with the velocities goes to
    /// the `reactions`.
    pub fn take(
        &mut self,
        (touches, laws): (&[Touch], &[Response]),
        tendons: &[HeldTendon],
        reactions: &mut [Reaction],
    ) {
        self.all.clear();
        self.parts.clear();
        for (touch, law) in touches.iter().zip(laws).filter(|(_, law)| law.acts()) {
            let (Side::Disc(disc), Some(other)) = (touch.on, touch.other) else {
                continue;
            };
            let at_rest = law.impulse + law.inertance * (touch.velocity - touch.free);
            let ends = [(disc, touch.arm), other];
            let mut rest = at_rest;
            let axes = touch.axes().into_iter();
            for (axis, inertance) in axes.filter(|(_, inertance)| *inertance > 0.0) {
                let impulse = axis.dot(&at_rest);
                self.add(&ends, &axis, (inertance, impulse));
                rest -= axis * impulse;
            }
            if touch.bound > 0.0 {
                for ((disc, arm), sign) in ends.iter().zip([1.0, -1.0]) {
                    reactions[*disc].push(arm, &(rest * sign), &Matrix3::zeros());
                }
            }
        }
        for tendon in tendons {
            let law = tendon.law();
            if law.inertance == 0.0 {
                for (reaction, moment) in reactions.iter_mut().zip(&tendon.moments) {
                    reaction.turn(&(moment * law.impulse));
                }
                continue;
            }
            let start = self.parts.len();
            let moments = tendon.moments.iter().enumerate();
            self.parts.extend(moments.map(|(disc, moment)| Part {
                disc,
                moment: *moment,
                force: Vector3::zeros(),
            }));
            self.all.push(Tie {
                parts: start..self.parts.len(),
                inertance: law.inertance,
                impulse: law.impulse + law.inertance * tendon.velocity,
            });
        }
    }

    /// Adds a direction in which two points of discs part, at arms from the centres of their joints (m).
    fn add(
        &mut self,
        ends: &[(usize, Vector3<f64>); 2],
        direction: &Vector3<f64>,
        (inertance, impulse): (f64, f64),
    ) {
        let start = self.parts.len();
        let [one, other] = ends;
        for ((disc, arm), force) in [(one, *direction), (other, -direction)] {
            self.parts.push(Part {
                disc: *disc,
                moment: arm.cross(&force),
                force,
            });
        }
        self.all.push(Tie {
            parts: start..self.parts.len(),
            inertance,
            impulse,
        });
    }

    pub fn are_none(&self) -> bool {
        self.all.is_empty()
    }

    /// How fast the discs of a tie part along it (m/s).
    fn parting(&self, tie: &Tie, velocities: &DiscVelocities) -> f64 {
        let parts = self.parts[tie.parts.clone()].iter();
        let terms = parts.map(|part| {
            let (turn, shift) = &velocities.0[part.disc];
            part.moment.dot(turn) + part.force.dot(shift)
        });
        terms.sum()
    }

    /// Sets the columns and the dense matrix, with what `robot` has kept.
    fn factorise(&mut self, centres: &[Vector3<f64>], robot: &mut impl Responds) {
        let count = self.all.len();
        self.columns.resize(count, Vec::new());
        for (tie, column) in self.all.iter().zip(&mut self.columns) {
            self.unit.clear();
            self.unit.resize(centres.len(), Reaction::default());
            for part in &self.parts[tie.parts.clone()] {
                let reaction = &mut self.unit[part.disc];
                reaction.turn(&part.moment);
                reaction.push(&Vector3::zeros(), &part.force, &Matrix3::zeros());
            }
            column.clear();
            column.resize(centres.len(), Vector3::zeros());
            robot.respond_again(&self.unit, column);
        }
        let mut matrix = DMatrix::zeros(count, count);
        let mut spatial = std::mem::take(&mut self.spatial);
        for j in 0..count {
            spatial.set(centres, &self.columns[j]);
            for (i, tie) in self.all.iter().enumerate() {
                matrix[(i, j)] = self.parting(tie, &spatial);
            }
            matrix[(j, j)] += 1.0 / self.all[j].inertance;
        }
        self.spatial = spatial;
        self.factor = matrix.cholesky();
    }

    /// Adds what the ties change of `rates` to these, with their impulses at rest or without. Not finite where there is no solution.
    fn correct(&mut self, centres: &[Vector3<f64>], rates: &mut [Vector3<f64>], pressed: bool) {
        self.spatial.set(centres, rates);
        let right = DVector::from_iterator(
            self.all.len(),
            self.all.iter().map(|tie| {
                let own = if pressed { tie.impulse } else { 0.0 };
                own / tie.inertance - self.parting(tie, &self.spatial)
            }),
        );
        let Some(factor) = &self.factor else {
            rates.fill(Vector3::repeat(f64::NAN));
            return;
        };
        let impulses = factor.solve(&right);
        for (column, impulse) in self.columns.iter().zip(impulses.iter()) {
            for (rate, column) in rates.iter_mut().zip(column) {
                *rate += column * *impulse;
            }
        }
    }
}

/// What the robot's rates change by under reactions, ties included.
pub(super) struct WithTies<'a, R> {
    pub robot: &'a mut R,
    pub ties: &'a mut Ties,
    pub centres: &'a [Vector3<f64>],
}

impl<R: Responds> Responds for WithTies<'_, R> {
    fn respond(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        self.respond_keeping(reactions, out);
    }

    fn respond_keeping(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        self.robot.respond_keeping(reactions, out);
        self.ties.factorise(self.centres, self.robot);
        self.ties.correct(self.centres, out, true);
    }

    fn respond_again(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        self.robot.respond_again(reactions, out);
        self.ties.correct(self.centres, out, false);
    }
}
