//! Loads without a potential: moments, and forces that turn with their disc (Ziegler, Principles of Structural
//! Stability, 1968).
//!
//! They enter as the dead forces and moments that they are in the current configuration. The Jacobian of the
//! moments on the joints needs two terms more: loads turn with their disc, and turns do not commute. It is not
//! symmetric.

use faer::Mat;
use nalgebra::{Matrix3, Matrix6, Vector3};

use super::{DeadForces, Expansion, add_block};
use crate::robot::{Frame, Loads, Wrench};
use crate::tendon::Posture;

/// Whether a wrench has a part without a potential.
pub(crate) fn follows(wrench: &Wrench) -> bool {
    let some = |vector: [f64; 3]| vector.iter().any(|x| *x != 0.0);
    some(wrench.moment) || (wrench.frame == Frame::Disc && some(wrench.force))
}

/// Force and moment of the part of a wrench without a potential, on the disc's origin, world axes. Of a force that turns
/// with its disc, that off the origin is a moment that does, too.
pub(crate) fn follower(
    wrench: &Wrench,
    orientation: &Matrix3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let (force, moment) = (Vector3::from(wrench.force), Vector3::from(wrench.moment));
    match wrench.frame {
        Frame::World => (Vector3::zeros(), moment),
        Frame::Disc => {
            let off_origin = Vector3::from(wrench.point).cross(&force);
            (orientation * force, orientation * (moment + off_origin))
        }
    }
}

/// Adds to the expansion's gradient what `share` of the moments is in this posture. The forces must be
/// in its dead forces: see [`add_forces`].
pub(crate) fn add_moments(loads: &Loads, share: f64, posture: &Posture, expansion: &mut Expansion) {
    for wrench in loads.wrenches().iter().filter(|wrench| follows(wrench)) {
        let (_, moment) = follower(wrench, posture.chain.disc(wrench.disc));
        expansion.disc_gradient[wrench.disc] -= moment * share;
    }
}

/// Adds to `dead` what `share` of the forces without a potential is in this posture.
pub(crate) fn add_forces(loads: &Loads, share: f64, posture: &Posture, dead: &mut DeadForces) {
    for wrench in loads.wrenches().iter().filter(|wrench| follows(wrench)) {
        let (force, _) = follower(wrench, posture.chain.disc(wrench.disc));
        dead.at_origin[wrench.disc] += force * share;
    }
}

/// What one wrench without a potential adds to the Jacobian of the residual moments by the joints' turns (N m/rad).
///
/// With `M` a moment and `F` a force on disc `m`, `d_k` its origin from joint `k`, blocks `k, i <= m` get `-1/2 [M]x`
/// (world frame) or `1/2 [M]x` (disc frame): `twist`; and `[d_k]x [F]x`: turning with the disc, by `Omega`, the force
/// changes by `Omega x F`.
struct Turning {
    disc: usize,
    twist: Matrix3<f64>,
    /// `[F]x`.
    force: Matrix3<f64>,
}

/// Those of `share` of the loads.
fn turning(loads: &Loads, share: f64, posture: &Posture) -> impl Iterator<Item = Turning> {
    let chain = &posture.chain;
    let wrenches = loads.wrenches().iter().filter(|wrench| follows(wrench));
    wrenches.map(move |wrench| {
        let (force, moment) = follower(wrench, chain.disc(wrench.disc));
        let half = match wrench.frame {
            Frame::World => -0.5,
            Frame::Disc => 0.5,
        };
        Turning {
            disc: wrench.disc,
            twist: (moment * (half * share)).cross_matrix(),
            force: (force * share).cross_matrix(),
        }
    })
}

/// The Jacobian `3 n x 3 n` of the residual moments by the joints' turns, world axes (N m/rad): the
/// expansion's Hessian, and what `share` of the loads without a potential add to it, [confined](Expansion::confine).
pub(crate) fn jacobian(
    loads: &Loads,
    share: f64,
    posture: &Posture,
    expansion: &Expansion,
) -> Mat<f64> {
    let mut jacobian = expansion.dense();
    let chain = &posture.chain;
    for Turning { disc, twist, force } in turning(loads, share, posture) {
        for k in 0..=disc {
            let arm = chain.positions[disc] - chain.centres[k];
            let block = twist + arm.cross_matrix() * force;
            for i in 0..=disc {
                add_block(&mut jacobian, k, i, &block);
            }
        }
    }
    expansion.confine(&mut jacobian);
    jacobian
}

/// Adds the same to `bodies`, as forms of the discs' motions: of each the turn, and the displacement of its joint's centre.
pub(crate) fn add_bodies(
    loads: &Loads,
    share: f64,
    posture: &Posture,
    bodies: &mut [Matrix6<f64>],
) {
    let chain = &posture.chain;
    for Turning { disc, twist, force } in turning(loads, share, posture) {
        let arm = chain.positions[disc] - chain.centres[disc];
        let mut turns = bodies[disc].fixed_view_mut::<3, 3>(0, 0);
        turns += twist + arm.cross_matrix() * force;
        let mut displaced = bodies[disc].fixed_view_mut::<3, 3>(3, 0);
        displaced += force;
    }
}

/// Adds to `out` what `share` of the loads without a potential adds to the product of the Jacobian with the joints'
/// `turns`, world axes.
pub(crate) fn add_product(
    loads: &Loads,
    share: f64,
    posture: &Posture,
    turns: &[Vector3<f64>],
    out: &mut [Vector3<f64>],
) {
    let chain = &posture.chain;
    for Turning { disc, twist, force } in turning(loads, share, posture) {
        let turn: Vector3<f64> = turns[..=disc].iter().sum();
        let (moment, force) = (twist * turn, force * turn);
        for (out, centre) in out.iter_mut().zip(&chain.centres).take(disc + 1) {
            *out += moment + (chain.positions[disc] - centre).cross(&force);
        }
    }
}

/// Adds to `out` what the loads without a potential add to the product of the Jacobian's transpose with the joints' `turns`,
/// world axes: that of [`jacobian`], but for the expansion's Hessian.
pub(crate) fn add_transposed_product(
    loads: &Loads,
    posture: &Posture,
    turns: &[Vector3<f64>],
    out: &mut [Vector3<f64>],
) {
    let chain = &posture.chain;
    for Turning { disc, twist, force } in turning(loads, 1.0, posture) {
        // The blocks of one row are alike: the sum over the rows of their transposes times the turns.
        let (mut turn, mut lever) = (Vector3::zeros(), Vector3::zeros());
        for (own, centre) in turns.iter().zip(&chain.centres).take(disc + 1) {
            turn += own;
            lever += (chain.positions[disc] - centre).cross(own);
        }
        let change = twist.tr_mul(&turn) + force * lever;
        for out in out.iter_mut().take(disc + 1) {
            *out += change;
        }
    }
}
