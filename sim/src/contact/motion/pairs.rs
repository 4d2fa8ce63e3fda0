//! Discs of the robot that touch each other, in the velocity problem.
//!
//! Such a contact acts on two discs, so that its form is in no disc's own: it adds `k G G'` to the matrix `A + J'HJ`, where `G' w` is how
//! fast its points part by changes `w` of the joints' rates. With the impulses `l` as unknowns, `l = p - k G' w`, and `Y = (A + J'HJ)^-1 G`,
//! the solution without them, `w0`, becomes `w0 + Y l`, where `(1/k + G' Y) l = p/k - G' w0` (Woodbury's formula): a dense matrix of
//! the pairs that touch, whose columns take one solve with the robot's factorised matrix each.

use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, DVector, Dyn, Matrix3, Vector3};

use super::coupled::Responds;
use super::touch::{DiscVelocities, Response, Side, Touch};
use crate::dynamics::Reaction;

/// A point at which two discs touch, as the linearised problem has it.
#[derive(Clone, Copy, Debug)]
struct Pair {
    /// The discs, and the points from the centres of their joints (m).
    ends: [(usize, Vector3<f64>); 2],
    normal: Vector3<f64>,
    /// `k` (kg), and `p` (N s).
    inertance: f64,
    impulse: f64,
}

/// The pairs that act in an iteration, and workspace.
#[derive(Clone, Debug, Default)]
pub(super) struct Pairs {
    all: Vec<Pair>,
    /// `Y`.
    columns: Vec<Vec<Vector3<f64>>>,
    factor: Option<Cholesky<f64, Dyn>>,
    /// A unit impulse on one pair.
    unit: Vec<Reaction>,
    spatial: DiscVelocities,
}

impl Pairs {
    /// Takes those of the contacts that are between discs and act by their laws.
    pub fn take(&mut self, touches: &[Touch], laws: &[Response]) {
        self.all.clear();
        let acting = touches.iter().zip(laws).filter(|(_, law)| law.acts());
        self.all.extend(acting.filter_map(|(touch, law)| {
            let (Side::Disc(disc), Some(other)) = (touch.on, touch.other) else {
                return None;
            };
            let at_rest = law.impulse + law.inertance * (touch.velocity - touch.free);
            Some(Pair {
                ends: [(disc, touch.arm), other],
                normal: touch.normal,
                inertance: touch.push.inertance,
                impulse: touch.normal.dot(&at_rest),
            })
        }));
    }

    pub fn are_none(&self) -> bool {
        self.all.is_empty()
    }

    /// Sets the columns and the dense matrix, with what `robot` has kept.
    fn factorise(&mut self, centres: &[Vector3<f64>], robot: &mut impl Responds) {
        let count = self.all.len();
        self.columns.resize(count, Vec::new());
        for (pair, column) in self.all.iter().zip(&mut self.columns) {
            self.unit.clear();
            self.unit.resize(centres.len(), Reaction::default());
            let [(disc, arm), (other, back)] = &pair.ends;
            self.unit[*disc].push(arm, &pair.normal, &Matrix3::zeros());
            self.unit[*other].push(back, &-pair.normal, &Matrix3::zeros());
            column.clear();
            column.resize(centres.len(), Vector3::zeros());
            robot.respond_again(&self.unit, column);
        }
        let mut matrix = DMatrix::zeros(count, count);
        for j in 0..count {
            self.spatial.set(centres, &self.columns[j]);
            for (i, pair) in self.all.iter().enumerate() {
                matrix[(i, j)] = parting(pair, &self.spatial);
            }
            matrix[(j, j)] += 1.0 / self.all[j].inertance;
        }
        self.factor = matrix.cholesky();
    }

    /// Adds what the pairs change of `rates` to these, with their impulses at rest or without. Not finite where there is no solution.
    fn correct(&mut self, centres: &[Vector3<f64>], rates: &mut [Vector3<f64>], pressed: bool) {
        self.spatial.set(centres, rates);
        let right = DVector::from_iterator(
            self.all.len(),
            self.all.iter().map(|pair| {
                let own = if pressed { pair.impulse } else { 0.0 };
                own / pair.inertance - parting(pair, &self.spatial)
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

/// How fast the points of a pair part (m/s).
fn parting(pair: &Pair, velocities: &DiscVelocities) -> f64 {
    let [one, other] = pair.ends.map(|(disc, arm)| velocities.of(disc, &arm));
    pair.normal.dot(&(one - other))
}

/// What the robot's rates change by under reactions, discs that touch each other included.
pub(super) struct WithPairs<'a, R> {
    pub robot: &'a mut R,
    pub pairs: &'a mut Pairs,
    pub centres: &'a [Vector3<f64>],
}

impl<R: Responds> Responds for WithPairs<'_, R> {
    fn respond(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        self.respond_keeping(reactions, out);
    }

    fn respond_keeping(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        self.robot.respond_keeping(reactions, out);
        self.pairs.factorise(self.centres, self.robot);
        self.pairs.correct(self.centres, out, true);
    }

    fn respond_again(&mut self, reactions: &[Reaction], out: &mut [Vector3<f64>]) {
        self.robot.respond_again(reactions, out);
        self.pairs.correct(self.centres, out, false);
    }
}
