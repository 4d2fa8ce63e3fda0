//! Forward dynamics in O(n): Featherstone's articulated-body algorithm (Rigid Body Dynamics
//! Algorithms, ch. 7), with every quantity about the joints' centres in world axes.
//!
//! Above joint `i`, the moment `n` and the force `f` that the joint passes on depend on the angular
//! acceleration `alpha` of its disc and the acceleration `a` of its centre as
//! `n = J alpha + H a + n0`, `f = H' alpha + M a + f0`. A ball joint's armature `k` (with implicit
//! damping: `k + h d`) has the same form in every frame, so with `alpha = alpha_below + c + u`
//! its equation of motion `n + k u = tau` gives `u = G (tau - n0 - J (alpha_below + c) - H a)`,
//! `G = (J + k I)^-1`, and without it the chain above has the inertia `k G J`, `k G H`,
//! `M - H' G H`. `c` and the linear bias acceleration are those of [`Motion`]. No inertia is a difference of large numbers, however small `J` is beside `k`.
//!
//! Hinges along the columns of `A`, with armatures `K`, turn by `u = A q` alone: `G = A (A' J A + K)^-1 A'`, and what the chain above
//! has without the joint is `J - J G J`, `H - J G H`, `M - H' G H`.

use nalgebra::{Matrix3, Vector3};

use super::links::{Link, Motion, MovingChain, PointMass};
use super::reaction::Reaction;
use super::symmetric::{
    Symmetric, cross_symmetric, symmetric, times, times_cross, transpose_times,
    twice_symmetric_part,
};
use crate::robot::HingeAxes;

/// Acceleration of one joint as an affine function of the accelerations below it.
#[derive(Clone, Copy, Debug)]
struct Response {
    /// `G (tau - n0)`.
    own: Vector3<f64>,
    /// `G J`.
    to_angular: Matrix3<f64>,
    /// `G H`.
    to_linear: Matrix3<f64>,
}

/// The forward dynamics of a chain; reuses its memory.
#[derive(Clone, Debug)]
pub(super) struct ArticulatedBodies {
    responses: Vec<Response>,
    /// `G` of each joint, where reactions are to be followed by others.
    inverses: Vec<Matrix3<f64>>,
    /// `G (tau - n0)` of each joint, of those that followed.
    own: Vec<Vector3<f64>>,
}

/// What a joint passes on of the chain above it to the body below, about its own centre: inertia, and moment at no acceleration.
struct Passed {
    inertia: Symmetric,
    coupling: Matrix3<f64>,
    moment: Vector3<f64>,
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
        let none = Response {
            own: Vector3::zeros(),
            to_angular: Matrix3::zeros(),
            to_linear: Matrix3::zeros(),
        };
        Self {
            responses: vec![none; joints],
            inverses: vec![Matrix3::zeros(); joints],
            own: vec![Vector3::zeros(); joints],
        }
    }

    /// Accelerations of the joints (rad/s²) under the torques `tau` (N m), both in world axes;
    /// `armatures` is each joint's `k`.
    pub fn accelerate(
        &mut self,
        chain: &MovingChain,
        armatures: &[Vector3<f64>],
        torques: &[Vector3<f64>],
        out: &mut [Vector3<f64>],
    ) {
        self.react::<false>(chain, armatures, torques, &[], out);
    }

    /// The same with what the surroundings do to each disc, a linear law of its acceleration; an empty list is nothing. What is kept
    /// (`KEEPS`) serves [`react_again`](Self::react_again).
    pub fn react<const KEEPS: bool>(
        &mut self,
        chain: &MovingChain,
        armatures: &[Vector3<f64>],
        torques: &[Vector3<f64>],
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        self.gather::<KEEPS>(chain, armatures, torques, reactions);
        self.spread(chain.motions, out);
    }

    /// What other impulses do to the chain at rest whose reactions were kept last, with the same forms: of these `reactions` only the
    /// impulses count. Since `G` and `J` commute, or `G = A (A' J A + K)^-1 A'`, a joint passes on the moment `n0 + J G b` and the force
    /// `f0 + H' G b`, `b = -n0`.
    pub fn react_again(
        &mut self,
        motions: &[Motion],
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        let (mut moment, mut force) = (Vector3::zeros(), Vector3::zeros());
        for joint in (0..self.responses.len()).rev() {
            let response = &self.responses[joint];
            moment -= reactions[joint].moment;
            force -= reactions[joint].force;
            let right = -moment;
            self.own[joint] = times(&self.inverses[joint], &right);
            force += transpose_times(&response.to_linear, &right);
            moment += transpose_times(&response.to_angular, &right);
            moment += motions[joint].arm.cross(&force);
        }
        let (mut alpha, mut shift) = (Vector3::zeros(), Vector3::zeros());
        let joints = self.responses.iter().zip(&self.own).zip(motions);
        for (((response, own), motion), out) in joints.zip(out) {
            shift += alpha.cross(&motion.arm);
            *out = own - times(&response.to_angular, &alpha) - times(&response.to_linear, &shift);
            alpha += *out;
        }
    }

    /// From the tip to the base: articulated inertias, and the response of each joint.
    fn gather<const KEEP: bool>(
        &mut self,
        chain: &MovingChain,
        armatures: &[Vector3<f64>],
        torques: &[Vector3<f64>],
        reactions: &[Reaction],
    ) {
        let (Some(tip), Some(motion)) = (chain.orientations.last(), chain.motions.last()) else {
            return;
        };
        let mut above = Above::payload(chain.payload, tip, motion);
        let poses = chain.orientations.iter().zip(chain.motions);
        let joints = (chain.links.iter().zip(armatures)).zip(poses);
        let responses = self.responses.iter_mut().zip(torques);
        let steps = joints.zip(responses).enumerate().rev();
        for (joint, (((link, armature), (orientation, motion)), (response, torque))) in steps {
            above.add_disc(link, orientation, motion);
            if let Some(reaction) = reactions.get(joint) {
                above.add_reaction(reaction);
            }
            let hinges = chain.hinges.get(joint).and_then(Option::as_ref);
            let inverse = match hinges {
                None => above.pass_ball(armature.x, torque, motion, response),
                Some(hinges) => above.pass_hinges(hinges, armature, torque, motion, response),
            };
            if KEEP {
                self.inverses[joint] = inverse.matrix();
            }
        }
    }

    /// From the base to the tip: the accelerations.
    fn spread(&self, motions: &[Motion], out: &mut [Vector3<f64>]) {
        let (mut alpha, mut shift) = (Vector3::zeros(), Vector3::zeros());
        for ((response, motion), out) in self.responses.iter().zip(motions).zip(out) {
            // Acceleration of the joint's centre, and the disc's angular acceleration but for the joint's.
            shift += alpha.cross(&motion.arm) + motion.linear_bias;
            alpha += motion.angular_bias;
            // u = G (tau - n0) - G J (alpha_below + c) - G H a.
            *out = response.own
                - times(&response.to_angular, &alpha)
                - times(&response.to_linear, &shift);
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

    /// Adds what the surroundings do to that disc.
    fn add_reaction(&mut self, reaction: &Reaction) {
        self.inertia = self.inertia.add(&reaction.inertia);
        self.coupling += reaction.coupling;
        self.mass = self.mass.add(&reaction.mass);
        self.moment -= reaction.moment;
        self.force -= reaction.force;
    }

    /// Goes below a ball joint, to the centre of the next. Writes its response; returns `G`.
    #[inline(always)]
    fn pass_ball(
        &mut self,
        armature: f64,
        torque: &Vector3<f64>,
        motion: &Motion,
        response: &mut Response,
    ) -> Symmetric {
        // G = (J + k I)^-1, and the joint's response with it.
        let mut joint = self.inertia;
        joint.xx += armature;
        joint.yy += armature;
        joint.zz += armature;
        let inverse = joint.inverse();
        let to_angular = inverse.times_commuting(&self.inertia);
        let to_linear = inverse.times_matrix(&self.coupling);
        let own = inverse.times(&(torque - self.moment));

        // What the chain above does to the body below through the joint: k G J, k G H, M - H' G H.
        let passed = Passed {
            inertia: to_angular.scaled(armature),
            coupling: to_linear * armature,
            moment: torque - own * armature,
        };
        response.own = own;
        response.to_angular = to_angular.matrix();
        response.to_linear = to_linear;
        self.go_below(response, &passed, motion);
        inverse
    }

    /// The same below a joint of hinges.
    #[inline(never)]
    fn pass_hinges(
        &mut self,
        hinges: &HingeAxes,
        armature: &Vector3<f64>,
        torque: &Vector3<f64>,
        motion: &Motion,
        response: &mut Response,
    ) -> Symmetric {
        let inertia = self.inertia.matrix();
        let axes = &hinges.axes;
        let joint = axes.tr_mul(&(inertia * axes)) + Matrix3::from_diagonal(armature);
        let inverse = axes * symmetric(&joint).inverse().matrix() * axes.transpose();
        let kept = symmetric(&inverse);
        response.own = inverse * (torque - self.moment);
        response.to_angular = inverse * inertia;
        response.to_linear = inverse * self.coupling;
        let passed = Passed {
            inertia: symmetric(&(inertia - inertia * response.to_angular)),
            coupling: self.coupling - inertia * response.to_linear,
            moment: self.moment + inertia * response.own,
        };
        self.go_below(response, &passed, motion);
        kept
    }

    /// Goes below a joint to the centre of the next, given what the joint passes on and how it responds.
    #[inline(always)]
    fn go_below(&mut self, response: &Response, passed: &Passed, motion: &Motion) {
        let Response { own, to_linear, .. } = response;
        let Passed {
            inertia,
            coupling,
            moment,
        } = passed;
        let mass = self
            .mass
            .sub(&Symmetric::product(&self.coupling, to_linear));
        // The force and the moment at no acceleration of the body below, about the centre of the next joint.
        let r = &motion.arm;
        let force = self.force
            + transpose_times(&self.coupling, own)
            + transpose_times(coupling, &motion.angular_bias)
            + mass.times(&motion.linear_bias);
        self.moment = moment
            + inertia.times(&motion.angular_bias)
            + times(coupling, &motion.linear_bias)
            + r.cross(&force);
        self.force = force;
        // The inertias about that centre (parallel axes).
        let lever = cross_symmetric(r, &mass);
        self.inertia = inertia
            .sub(&twice_symmetric_part(&times_cross(coupling, r)))
            .sub(&symmetric(&times_cross(&lever, r)));
        self.coupling = coupling + lever;
        self.mass = mass;
    }
}
