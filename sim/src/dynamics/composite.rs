//! Composite bodies: everything from a disc up taken as one, for the mass matrix, the bias and the
//! derivatives of the inverse dynamics.
//!
//! Turning joint `j` by `X` moves everything above like a rigid body, so in the moved axes only the
//! motion of what is below has changed: the velocities by the constant `U = V_(j-1) x X`, and the
//! forces of body `k` by `I_k (A_(j-1) x X + V_(j-1) x U) + B_k U` ([`Coriolis`]). Sums over the bodies above give the
//! derivatives of the inverse dynamics in O(n²) (in the spirit of Singh, Russell and Wensing, IEEE
//! Robotics and Automation Letters 7, 2022).

use nalgebra::{Matrix3, Matrix6x3, SMatrix, Vector3, Vector6};

use super::acceleration::EquationsOfMotion;
use super::spatial::{Coriolis, SpatialInertia, cross_force, cross_motion, cross_motions, stack};

/// A joint, and the bodies from its disc up; or one hinge of a joint, and all that it carries: of several hinges the lower ones
/// carry bodies without mass, so that the axis of each is fixed to what it carries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Composite {
    /// The joint's number, and that of its hinge.
    pub joint: usize,
    pub hinge: Option<usize>,
    /// Motion of the disc per rate of the joint's coordinates; zero but for the hinge's own.
    pub axes: Matrix6x3<f64>,
    /// Velocity of the disc, and of the body below.
    pub velocity: Vector6<f64>,
    pub velocity_below: Vector6<f64>,
    /// Acceleration of the body below.
    pub acceleration_below: Vector6<f64>,
    /// Sums over the bodies above: inertia, `B`, and the force that accelerates them.
    pub inertia: SpatialInertia,
    pub coriolis: Coriolis,
    pub force: Vector6<f64>,
}

/// How the motion of all bodies above a joint changes with it: in axes that move along, velocities
/// by a constant `velocity`, accelerations by `rest` and what follows from `velocity`.
pub(super) struct Moved {
    pub velocity: Matrix6x3<f64>,
    pub rest: Matrix6x3<f64>,
}

impl Moved {
    pub fn by_turn(joint: &Composite) -> Self {
        let velocity = cross_motions(&joint.velocity_below, &joint.axes);
        Self {
            velocity,
            rest: cross_motions(&joint.acceleration_below, &joint.axes)
                + cross_motions(&joint.velocity_below, &velocity),
        }
    }

    pub fn by_rate(joint: &Composite) -> Self {
        Self {
            velocity: joint.axes,
            rest: cross_motions(&(joint.velocity_below + joint.velocity), &joint.axes),
        }
    }

    /// `rest` above `velocity`: what [`Composite::force_along`] multiplies.
    pub fn stacked(&self) -> SMatrix<f64, 12, 3> {
        one_above_other(&self.rest, &self.velocity)
    }
}

fn one_above_other(above: &Matrix6x3<f64>, below: &Matrix6x3<f64>) -> SMatrix<f64, 12, 3> {
    let mut both = SMatrix::<f64, 12, 3>::zeros();
    both.fixed_rows_mut::<6>(0).copy_from(above);
    both.fixed_rows_mut::<6>(6).copy_from(below);
    both
}

impl Composite {
    /// A hinge that carries another one at the same place, the motion below it, and its velocity.
    fn without_mass(
        joint: usize,
        hinge: usize,
        axes: Matrix6x3<f64>,
        [velocity_below, acceleration_below]: [Vector6<f64>; 2],
        velocity: Vector6<f64>,
    ) -> Self {
        Self {
            joint,
            hinge: Some(hinge),
            axes,
            velocity,
            velocity_below,
            acceleration_below,
            inertia: SpatialInertia::default(),
            coriolis: Coriolis::default(),
            force: Vector6::zeros(),
        }
    }

    /// What of a vector by the joint's coordinates is along this one's.
    pub fn own(&self, vector: Vector3<f64>) -> Vector3<f64> {
        match self.hinge {
            None => vector,
            Some(hinge) => Vector3::ith(hinge, vector[hinge]),
        }
    }

    pub fn force_change(&self, moved: &Moved) -> Matrix6x3<f64> {
        self.inertia.times_columns(&moved.rest) + self.coriolis.times_columns(&moved.velocity)
    }

    /// The part of [`force_change`](Self::force_change) along the joint's axes is the transpose of this times [`Moved::stacked`].
    pub fn force_along(&self) -> SMatrix<f64, 12, 3> {
        one_above_other(
            &self.inertia.times_columns(&self.axes),
            &self.coriolis.transpose_times_columns(&self.axes),
        )
    }
}

/// Fills `out` for the posture that `equations` are in, rates and accelerations of the joints' coordinates. The base is at rest.
pub(super) fn compose(
    equations: &EquationsOfMotion,
    velocity: &[f64],
    acceleration: &[f64],
    out: &mut Vec<Composite>,
) {
    compose_on(equations, &Vector3::zeros(), velocity, acceleration, out);
}

/// The same on a base that accelerates by `base` (m/s², world axes), as against gravity.
pub(super) fn compose_on(
    equations: &EquationsOfMotion,
    base: &Vector3<f64>,
    velocity: &[f64],
    acceleration: &[f64],
    out: &mut Vec<Composite>,
) {
    out.clear();
    let mut v = Vector6::zeros();
    let mut a = Vector6::new(0.0, 0.0, 0.0, base.x, base.y, base.z);
    let chain = &equations.posture.chain;
    let rates = velocity
        .as_chunks::<3>()
        .0
        .iter()
        .zip(acceleration.as_chunks::<3>().0);
    let last = equations.links.len() - 1;
    for (i, (velocity, acceleration)) in rates.enumerate() {
        // Axes of the joint, and the motion of its disc: v_i = v_(i-1) + S_i u_i, and its derivative.
        let orientation = chain.disc(i);
        let centre = chain.centres[i] - equations.robot.base();
        let rates = [velocity, acceleration].map(|rates| Vector3::from(*rates));
        let hinges = equations.links[i].hinges.as_ref();
        let upper = hinges.map(|hinges| hinges.count - 1);
        if let Some(upper) = upper {
            for hinge in 0..upper {
                let axes = one_axis(chain.axes(i), hinge, &centre);
                let below = [v, a];
                go_above(&axes, &rates, &mut v, &mut a);
                out.push(Composite::without_mass(i, hinge, axes, below, v));
            }
        }
        let axes = match upper {
            None => stack(orientation, &(centre.cross_matrix() * orientation)),
            Some(upper) => one_axis(chain.axes(i), upper, &centre),
        };
        let (velocity_below, acceleration_below) = (v, a);
        go_above(&axes, &rates, &mut v, &mut a);
        // Inertia, B and force of the body alone (Newton and Euler).
        let mut body = equations.links[i].body(orientation);
        if i == last {
            body = body.with(&equations.payload.body(orientation));
        }
        let inertia = SpatialInertia::new(&body, &centre);
        let momentum = inertia.times(&v);
        out.push(Composite {
            joint: i,
            hinge: upper,
            axes,
            velocity: v,
            velocity_below,
            acceleration_below,
            inertia,
            coriolis: Coriolis::new(&inertia, &v, &momentum),
            force: inertia.times(&a) + cross_force(&v, &momentum),
        });
    }
    // Sums over the bodies above.
    for i in (0..out.len() - 1).rev() {
        let Composite {
            inertia,
            coriolis,
            force,
            ..
        } = out[i + 1];
        out[i].inertia += inertia;
        out[i].coriolis += coriolis;
        out[i].force += force;
    }
}

/// The motion of one hinge, about its axis through a joint's `centre`.
fn one_axis(axes: &Matrix3<f64>, hinge: usize, centre: &Vector3<f64>) -> Matrix6x3<f64> {
    let mut own = Matrix3::zeros();
    own.set_column(hinge, &axes.column(hinge));
    stack(&own, &(centre.cross_matrix() * own))
}

/// From the motion of the body below a joint to that of its disc: `v_i = v_(i-1) + S_i u_i`, and its derivative.
fn go_above(
    axes: &Matrix6x3<f64>,
    [velocity, acceleration]: &[Vector3<f64>; 2],
    v: &mut Vector6<f64>,
    a: &mut Vector6<f64>,
) {
    let rate = axes * velocity;
    *v += rate;
    *a += axes * acceleration + cross_motion(v, &rate);
}
