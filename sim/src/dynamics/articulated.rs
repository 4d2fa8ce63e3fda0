//! Forward dynamics in O(n): Featherstone's articulated-body algorithm (Rigid Body Dynamics
//! Algorithms, ch. 7), with every quantity about the joints' centres in world axes.
//!
//! Above joint `i`, the moment `n` and the force `f` that the joint passes on depend on the angular
//! acceleration `alpha` of its disc and the acceleration `a` of its centre as
//! `n = J alpha + H a + n0`, `f = H' alpha + M a + f0`. A ball joint's armature `k` (with implicit
//! damping: `k + h d`) has the same form in every frame, so with `alpha = alpha_below + c + u`
//! its equation of motion `n + k u = tau` gives `u = G (tau - n0 - J (alpha_below + c) - H a)`,
//! `G = (J + k I)^-1`, and without it the chain above has the inertia `k G J`, `k G H`,
//! `M - H' G H`. No inertia is a difference of large numbers, however small `J` is beside `k`.

use nalgebra::{Matrix3, Vector3};

use super::links::{Link, Motion, MovingChain, PointMass};
use super::symmetric::{
    Symmetric, cross_symmetric, symmetric, times, times_cross, transpose_times,
    twice_symmetric_part,
};

/// How one joint answers the acceleration of what is below it.
#[derive(Clone, Copy, Debug)]
struct Answer {
    /// `G (tau - n0)`.
    own: Vector3<f64>,
    /// `G J`.
    to_turning: Symmetric,
    /// `G H`.
    to_shifting: Matrix3<f64>,
}

/// The forward dynamics of a chain; reuses its memory.
#[derive(Clone, Debug)]
pub(super) struct ArticulatedBodies {
    answers: Vec<Answer>,
}

/// The chain above a joint.
struct Above {
    inertia: Symmetric,
    coupling: Matrix3<f64>,
    mass: Symmetric,
    moment: Vector3<f64>,
    force: Vector3<f64>,
}

impl ArticulatedBodies {
    pub fn new(joints: usize) -> Self {
        let none = Answer {
            own: Vector3::zeros(),
            to_turning: Symmetric::default(),
            to_shifting: Matrix3::zeros(),
        };
        Self {
            answers: vec![none; joints],
        }
    }

    /// Accelerations of the joints (rad/s²) under the torques `tau` (N m), both in world axes;
    /// `armatures` is each joint's `k`.
    pub fn accelerate(
        &mut self,
        chain: &MovingChain,
        armatures: &[f64],
        torques: &[Vector3<f64>],
        out: &mut [Vector3<f64>],
    ) {
        self.gather(chain, armatures, torques);
        self.spread(chain.motions, out);
    }

    /// From the tip to the base: how each joint answers.
    fn gather(&mut self, chain: &MovingChain, armatures: &[f64], torques: &[Vector3<f64>]) {
        let (Some(tip), Some(motion)) = (chain.orientations.last(), chain.motions.last()) else {
            return;
        };
        let mut above = Above::payload(chain.payload, tip, motion);
        let poses = chain.orientations.iter().zip(chain.motions);
        let joints = (chain.links.iter().zip(armatures)).zip(poses);
        let answers = self.answers.iter_mut().zip(torques);
        for (((link, armature), (orientation, motion)), (answer, torque)) in
            joints.zip(answers).rev()
        {
            above.add_disc(link, orientation, motion);
            *answer = above.pass_joint(*armature, torque, motion);
        }
    }

    /// From the base to the tip: the accelerations.
    fn spread(&self, motions: &[Motion], out: &mut [Vector3<f64>]) {
        let (mut alpha, mut shift) = (Vector3::zeros(), Vector3::zeros());
        for ((answer, motion), out) in self.answers.iter().zip(motions).zip(out) {
            shift += alpha.cross(&motion.arm) + motion.swinging;
            alpha += motion.turning;
            *out =
                answer.own - answer.to_turning.times(&alpha) - times(&answer.to_shifting, &shift);
            alpha += *out;
        }
    }
}

impl Above {
    fn payload(payload: &PointMass, orientation: &Matrix3<f64>, motion: &Motion) -> Self {
        let body = payload.body(orientation);
        Self {
            inertia: body.inertia,
            coupling: body.moment.cross_matrix(),
            mass: Symmetric::isotropic(body.mass),
            moment: motion.spin.cross(&body.inertia.times(&motion.spin)),
            force: motion.spin.cross(&motion.spin.cross(&body.moment)),
        }
    }

    /// Adds a disc on the joint that the quantities are about.
    #[inline(always)]
    fn add_disc(&mut self, link: &Link, orientation: &Matrix3<f64>, motion: &Motion) {
        let body = link.body(orientation);
        let spin = &motion.spin;
        self.moment += spin.cross(&body.inertia.times(spin));
        self.force += spin.cross(&spin.cross(&body.moment));
        self.inertia = self.inertia.add(&body.inertia);
        self.coupling += body.moment.cross_matrix();
        self.mass.xx += body.mass;
        self.mass.yy += body.mass;
        self.mass.zz += body.mass;
    }

    /// Goes below the joint, to the centre of the next.
    #[inline(always)]
    fn pass_joint(&mut self, armature: f64, torque: &Vector3<f64>, motion: &Motion) -> Answer {
        let mut joint = self.inertia;
        joint.xx += armature;
        joint.yy += armature;
        joint.zz += armature;
        let inverse = joint.inverse();
        let to_turning = inverse.times_commuting(&self.inertia);
        let to_shifting = inverse.times_matrix(&self.coupling);
        let own = inverse.times(&(torque - self.moment));

        let inertia = to_turning.scaled(armature);
        let coupling = to_shifting * armature;
        let mass = self
            .mass
            .sub(&Symmetric::product(&self.coupling, &to_shifting));
        let r = &motion.arm;
        let force = self.force
            + transpose_times(&self.coupling, &own)
            + transpose_times(&coupling, &motion.turning)
            + mass.times(&motion.swinging);
        self.moment = torque - own * armature
            + inertia.times(&motion.turning)
            + times(&coupling, &motion.swinging)
            + r.cross(&force);
        self.force = force;
        let lever = cross_symmetric(r, &mass);
        self.inertia = inertia
            .sub(&twice_symmetric_part(&times_cross(&coupling, r)))
            .sub(&symmetric(&times_cross(&lever, r)));
        self.coupling = coupling + lever;
        self.mass = mass;
        Answer {
            own,
            to_turning,
            to_shifting,
        }
    }
}
