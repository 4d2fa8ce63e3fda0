//! How the forces that accelerate a robot change with its inertias and dimensions.
//!
//! A body of mass `m`, with `s = m c` of its centre and inertia `I` about its joint's centre, which accelerates by `a`, the body
//! turning by `w` and `dw/dt = alpha`, needs the force `f = m a + alpha x s + w x (w x s)` and the moment
//! `I alpha + w x I w + s x a` about there (Newton and Euler; Featherstone, Rigid Body Dynamics Algorithms, ch. 5.3). Along
//! virtual turns `W` of the bodies and displacements `d` of the centres they do work, of which each term, taken by one number,
//! is the derivative by it.

use nalgebra::Vector3;

use super::acceleration::EquationsOfMotion;
use crate::model_tangent::ModelTangent;

/// Motion of the body below a joint, real and virtual.
#[derive(Clone, Copy, Default)]
struct Below {
    spin: Vector3<f64>,
    angular: Vector3<f64>,
    turn: Vector3<f64>,
}

/// Adds to `out` the derivatives by inertias, armatures, dampings and joint offsets of minus the work of `(M + h D) a + D v +
/// bias` along the virtual turns `turns` of the joints (world axes), weight apart: `equations` as they were left by
/// [`EquationsOfMotion::accelerate`], with the `accelerations` that gave. O(n) time.
pub(super) fn pull_back_inertia(
    equations: &EquationsOfMotion,
    accelerations: &[f64],
    timestep: f64,
    turns: &[Vector3<f64>],
    out: &mut ModelTangent,
) {
    let n = turns.len();
    let orientations = equations.orientations();
    let mut below = vec![Below::default(); n];
    // Of each body: its force, and the derivative by the acceleration of its joint's centre.
    let mut forces = vec![[Vector3::zeros(); 2]; n];
    let (mut centre, mut moved) = (Vector3::zeros(), Vector3::zeros());
    let mut body_below = Below::default();
    for k in 0..n {
        let (link, motion, orientation) =
            (&equations.links[k], &equations.motions[k], &orientations[k]);
        below[k] = body_below;
        // The centre's acceleration `a` and virtual displacement `d`; the body's `alpha`, `w` and `W`.
        centre += body_below.angular.cross(&motion.arm) + motion.linear_bias;
        moved += body_below.turn.cross(&motion.arm);
        let chain = &equations.posture.chain;
        let own = Vector3::from_column_slice(&accelerations[3 * k..3 * k + 3]);
        let acceleration = chain.axes(k) * own;
        let spin = motion.spin;
        let angular = body_below.angular + motion.angular_bias + acceleration;
        let turn = body_below.turn + turns[k];
        body_below = Below {
            spin,
            angular,
            turn,
        };
        // Derivatives by mass, s and I: d . f + W . (I alpha + w x I w + s x a).
        let inertia = &mut out.inertias[k];
        inertia.mass -= moved.dot(&centre);
        let by_moment =
            moved.cross(&angular) + spin.cross(&spin.cross(&moved)) + centre.cross(&turn);
        inertia.moment -= orientation.tr_mul(&by_moment);
        let [turn_own, angular_own, spin_own] =
            [turn, angular, spin].map(|vector| orientation.tr_mul(&vector));
        let by_inertia =
            turn_own * angular_own.transpose() + turn_own.cross(&spin_own) * spin_own.transpose();
        inertia.rotational -= (by_inertia + by_inertia.transpose()) * 0.5;
        match chain.hinges(k) {
            None => {
                out.armature[k] -= turns[k].dot(&acceleration);
                out.damping[k] -= turns[k].dot(&(motion.rate + acceleration * timestep));
                let [turned, rate] =
                    [&turns[k], &motion.rate].map(|vector| orientation.tr_mul(vector));
                out.extra_damping[k] -= turned.component_mul(&rate);
            }
            // Of every hinge alike, along its angle.
            Some(hinges) => {
                let [turned, rate] = [&turns[k], &motion.rate].map(|v| hinges.dual.tr_mul(v));
                out.armature[k] -= turned.dot(&own);
                out.damping[k] -= turned.dot(&(rate + own * timestep));
            }
        }
        // What moving the centre costs.
        let mut body = link.body(orientation);
        if k + 1 == n {
            body = body.with(&equations.payload.body(orientation));
        }
        let s = &body.moment;
        forces[k] = [
            centre * body.mass + angular.cross(s) + spin.cross(&spin.cross(s)),
            moved * body.mass + turn.cross(s),
        ];
    }
    // A longer arm displaces everything above by W x arm', and accelerates it by alpha x arm' + w x (w x arm').
    let (mut force, mut lever) = (Vector3::zeros(), Vector3::zeros());
    for k in (1..n).rev() {
        force += forces[k][0];
        lever += forces[k][1];
        let Below {
            spin,
            angular,
            turn,
        } = below[k];
        let by_arm = force.cross(&turn) + lever.cross(&angular) + spin.cross(&spin.cross(&lever));
        out.joint_offsets[k] -= orientations[k - 1].tr_mul(&by_arm);
    }
}
