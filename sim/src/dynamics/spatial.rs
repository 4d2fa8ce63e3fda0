//! Spatial vectors (Featherstone, Rigid Body Dynamics Algorithms, ch. 2), in world axes about the base's origin: motions
//! `[angular; linear]`, forces `[moment; force]`.

use std::ops::AddAssign;

use nalgebra::{Matrix3, Matrix6x3, Vector3, Vector6};

use super::links::RigidBody;

/// `v x u`: how a motion `u` changes that is carried along by `v`.
#[inline]
pub(super) fn cross_motion(v: &Vector6<f64>, u: &Vector6<f64>) -> Vector6<f64> {
    let ((spin, linear), (turn, shift)) = (halves(v), halves(u));
    spatial(
        &spin.cross(&turn),
        &(linear.cross(&turn) + spin.cross(&shift)),
    )
}

/// The same of each column.
#[inline]
pub(super) fn cross_motions(v: &Vector6<f64>, columns: &Matrix6x3<f64>) -> Matrix6x3<f64> {
    let (spin, linear) = halves(v);
    let (turns, shifts) = blocks(columns);
    let (spin, linear) = (spin.cross_matrix(), linear.cross_matrix());
    stack(&(spin * turns), &(linear * turns + spin * shifts))
}

/// `v x* f`: how a force `f` changes that is carried along by `v`.
#[inline]
pub(super) fn cross_force(v: &Vector6<f64>, f: &Vector6<f64>) -> Vector6<f64> {
    let ((spin, linear), (moment, force)) = (halves(v), halves(f));
    spatial(
        &(spin.cross(&moment) + linear.cross(&force)),
        &spin.cross(&force),
    )
}

/// `u x* f` for each column `u`.
#[inline]
pub(super) fn cross_forces(columns: &Matrix6x3<f64>, f: &Vector6<f64>) -> Matrix6x3<f64> {
    let (moment, force) = halves(f);
    let (turns, shifts) = blocks(columns);
    let (moment, force) = (-moment.cross_matrix(), -force.cross_matrix());
    stack(&(moment * turns + force * shifts), &(force * turns))
}

/// Inertia of bodies: takes a motion `[w; u]` to the momentum `[J w + h x u; m u - h x w]`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SpatialInertia {
    rotational: Matrix3<f64>,
    moment: Vector3<f64>,
    mass: f64,
}

impl SpatialInertia {
    /// Of a body given about a joint's `centre`.
    #[inline]
    pub fn new(body: &RigidBody, centre: &Vector3<f64>) -> Self {
        let shift = centre * (centre * body.mass + body.moment).transpose()
            + body.moment * centre.transpose();
        Self {
            rotational: body.inertia.matrix() + Matrix3::identity() * shift.trace() - shift,
            moment: body.moment + centre * body.mass,
            mass: body.mass,
        }
    }

    #[inline]
    pub fn times(&self, motion: &Vector6<f64>) -> Vector6<f64> {
        let (turn, shift) = halves(motion);
        spatial(
            &(self.rotational * turn + self.moment.cross(&shift)),
            &(shift * self.mass - self.moment.cross(&turn)),
        )
    }

    #[inline]
    pub fn times_columns(&self, motions: &Matrix6x3<f64>) -> Matrix6x3<f64> {
        let (turns, shifts) = blocks(motions);
        let moment = self.moment.cross_matrix();
        stack(
            &(self.rotational * turns + moment * shifts),
            &(shifts * self.mass - moment * turns),
        )
    }
}

impl AddAssign for SpatialInertia {
    fn add_assign(&mut self, other: Self) {
        self.rotational += other.rotational;
        self.moment += other.moment;
        self.mass += other.mass;
    }
}

/// The map `B u = u x* I v + v x* I u - I (v x u)` of bodies that move with `v`. With the momentum `[n; p] = I v`, and `I` by its
/// parts, it is `[[K, 0], [-2 [p]x, 0]]`, `K = [w]x J - J [w]x - [u]x [h]x - [h]x [u]x - [n]x`: only turns change forces so.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Coriolis {
    rotational: Matrix3<f64>,
    momentum: Vector3<f64>,
}

impl Coriolis {
    /// Of bodies with this `inertia`, motion and momentum.
    #[inline]
    pub fn new(inertia: &SpatialInertia, motion: &Vector6<f64>, momentum: &Vector6<f64>) -> Self {
        let ((spin, linear), (angular, momentum)) = (halves(motion), halves(momentum));
        let half = spin.cross_matrix() * inertia.rotational - linear * inertia.moment.transpose();
        let alike = Matrix3::identity() * (2.0 * linear.dot(&inertia.moment));
        Self {
            rotational: half + half.transpose() + alike - angular.cross_matrix(),
            momentum,
        }
    }

    #[inline]
    pub fn times_columns(&self, motions: &Matrix6x3<f64>) -> Matrix6x3<f64> {
        let (turns, _) = blocks(motions);
        stack(
            &(self.rotational * turns),
            &(self.momentum.cross_matrix() * turns * -2.0),
        )
    }

    /// The transpose, on vectors dual to forces: motions.
    #[inline]
    pub fn transpose_times(&self, motion: &Vector6<f64>) -> Vector6<f64> {
        let (turn, shift) = halves(motion);
        let by_turn = self.rotational.tr_mul(&turn) + self.momentum.cross(&shift) * 2.0;
        spatial(&by_turn, &Vector3::zeros())
    }

    #[inline]
    pub fn transpose_times_columns(&self, motions: &Matrix6x3<f64>) -> Matrix6x3<f64> {
        let (turns, shifts) = blocks(motions);
        let by_turn = self.rotational.tr_mul(&turns) + self.momentum.cross_matrix() * shifts * 2.0;
        stack(&by_turn, &Matrix3::zeros())
    }
}

impl AddAssign for Coriolis {
    fn add_assign(&mut self, other: Self) {
        self.rotational += other.rotational;
        self.momentum += other.momentum;
    }
}

#[inline]
pub(super) fn spatial(upper: &Vector3<f64>, lower: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(upper.x, upper.y, upper.z, lower.x, lower.y, lower.z)
}

#[inline]
pub(super) fn halves(v: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (
        Vector3::new(v[0], v[1], v[2]),
        Vector3::new(v[3], v[4], v[5]),
    )
}

#[inline]
pub(super) fn stack(upper: &Matrix3<f64>, lower: &Matrix3<f64>) -> Matrix6x3<f64> {
    Matrix6x3::from_fn(|row, column| match row {
        0..3 => upper[(row, column)],
        _ => lower[(row - 3, column)],
    })
}

#[inline]
fn blocks(columns: &Matrix6x3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    (
        columns.fixed_rows::<3>(0).into(),
        columns.fixed_rows::<3>(3).into(),
    )
}
