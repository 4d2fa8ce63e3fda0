//! What the surroundings do to a disc: a linear law of its motion.

use nalgebra::{Matrix3, Matrix6, Vector3};

use super::symmetric::{Symmetric, symmetric};

/// Impulse and moment about the centre of a disc's joint, world axes, at no change of the disc's motion, and by how much they
/// diminish with that change: a symmetric form of `[turn; displacement of the joint's centre]`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reaction {
    pub(super) inertia: Symmetric,
    pub(super) coupling: Matrix3<f64>,
    pub(super) mass: Symmetric,
    pub(super) moment: Vector3<f64>,
    pub(super) force: Vector3<f64>,
}

impl Reaction {
    /// Adds an impulse (N s) on a point of the disc, at `arm` (m) from the joint's centre, that a change `u` of the point's velocity
    /// diminishes by `inertance u`, a symmetric matrix (kg).
    pub fn push(&mut self, arm: &Vector3<f64>, impulse: &Vector3<f64>, inertance: &Matrix3<f64>) {
        self.force += impulse;
        self.moment += arm.cross(impulse);
        // The point changes its velocity by `v - [arm]x Omega`.
        let cross = arm.cross_matrix();
        let coupling = cross * inertance;
        self.mass = self.mass.add(&symmetric(inertance));
        self.coupling += coupling;
        self.inertia = self.inertia.sub(&symmetric(&(coupling * cross)));
    }

    /// Adds an angular impulse on the disc (N m s).
    pub fn turn(&mut self, moment: &Vector3<f64>) {
        self.moment += moment;
    }

    /// Adds the form of another, without its impulse.
    pub(super) fn add_form(&mut self, other: &Self) {
        self.inertia = self.inertia.add(&other.inertia);
        self.coupling += other.coupling;
        self.mass = self.mass.add(&other.mass);
    }

    /// The form as a matrix.
    pub(super) fn spatial(&self) -> Matrix6<f64> {
        let mut form = Matrix6::zeros();
        (form.fixed_view_mut::<3, 3>(0, 0)).copy_from(&self.inertia.matrix());
        (form.fixed_view_mut::<3, 3>(0, 3)).copy_from(&self.coupling);
        (form.fixed_view_mut::<3, 3>(3, 0)).copy_from(&self.coupling.transpose());
        (form.fixed_view_mut::<3, 3>(3, 3)).copy_from(&self.mass.matrix());
        form
    }
}

/// Writes the impulses of `reactions` by the joints (N m s, world axes), whose `centres` are given (m).
pub(super) fn torques_of(
    reactions: &[Reaction],
    centres: &[Vector3<f64>],
    out: &mut [Vector3<f64>],
) {
    let (mut moment, mut force) = (Vector3::zeros(), Vector3::zeros());
    let mut above = centres.last().copied().unwrap_or_default();
    let joints = reactions.iter().zip(centres).zip(out).rev();
    for ((reaction, centre), out) in joints {
        moment += (above - centre).cross(&force) + reaction.moment;
        force += reaction.force;
        above = *centre;
        *out = moment;
    }
}
