//! How exactly a robot of some size is settled.
//!
//! A moment of 1e-10 N m turns the joints of a robot a hand high by less than 1e-7 rad, and bends one
//! a tenth of a millimetre high out of shape. So the residual allowed scales with the moments
//! that the robot has of its own: those of its weight, which alone holds some bends of a robot without
//! a backbone, but not below what is resolved beside the moments of its tendons and backbone.

use nalgebra::Vector3;

use super::{LENGTH_TOLERANCE, TOLERANCE};
use crate::chain::Configuration;
use crate::robot::{Disc, Drive, Loads, Robot, Tendon};
use crate::tendon::Posture;

/// Tolerance as a share of the moment of the robot's weight.
const OF_WEIGHT: f64 = 3e-8;
/// Smallest tolerance as a share of the tendons' and backbone's moments.
const OF_STRENGTH: f64 = 2.5e-12;
/// Share of the largest moments that is rounding.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Length of a robot (m) from which on [`LENGTH_TOLERANCE`] is not scaled down.
const USUAL_LENGTH: f64 = 0.05;

impl Robot {
    /// Largest residual (N m) at which the robot counts as settled: [`TOLERANCE`], and
    /// less for a robot whose own moments are small, in proportion to them. More only where rounding of
    /// its moments is more, or of its loads'.
    pub fn moment_tolerance(&self) -> f64 {
        let mut posture = Posture::new(self);
        posture.place(self, &Configuration::straight(self));
        moment_tolerance(self, &posture.lengths)
    }

    /// Largest error (m) of a tendon whose length is commanded: [`LENGTH_TOLERANCE`], and less for a
    /// small robot, in proportion to its length.
    pub fn length_tolerance(&self) -> f64 {
        LENGTH_TOLERANCE * f64::min(1.0, self.reach() / USUAL_LENGTH)
    }

    /// Length of the straight robot from its lowest joint to its last disc's origin (m).
    pub(crate) fn reach(&self) -> f64 {
        let above = self
            .discs()
            .iter()
            .skip(1)
            .map(|disc| disc.joint_offset.norm());
        above.sum::<f64>() + self.discs().last().map_or(0.0, |disc| disc.origin.norm())
    }

    /// What rounding leaves of the moments (N m) that loads put on the joints.
    pub(crate) fn load_rounding(&self, loads: &Loads) -> f64 {
        let reach = self.reach();
        let payload = loads.tip_payload();
        let arm = Vector3::from(payload.offset).norm();
        let mut moment = payload.mass * self.gravity().norm() * (reach + arm);
        moment += loads.line_load().norm() * reach * reach;
        for wrench in loads.wrenches() {
            let arm = Vector3::from(wrench.point).norm();
            moment += Vector3::from(wrench.force).norm() * (reach + arm);
            moment += Vector3::from(wrench.moment).norm();
        }
        ROUNDING * moment
    }
}

/// [`Robot::moment_tolerance`], given the lengths of the tendons in the straight pose (m).
pub(super) fn moment_tolerance(robot: &Robot, straight: &[f64]) -> f64 {
    let weight = weight_moment(robot);
    let strength = strength(robot, straight);
    if weight == 0.0 && strength == 0.0 {
        return TOLERANCE;
    }
    let scaled = f64::max(OF_WEIGHT * weight, OF_STRENGTH * strength);
    scaled.min(TOLERANCE).max(ROUNDING * (weight + strength))
}

/// Moment (N m) of the weight of the straight robot about its lowest joint, were it horizontal.
fn weight_moment(robot: &Robot) -> f64 {
    let mut arm = 0.0;
    let mut moment = 0.0;
    for (index, disc) in robot.discs().iter().enumerate() {
        if index > 0 {
            arm += disc.joint_offset.norm();
        }
        moment += disc.mass * (arm + disc.origin.norm());
    }
    moment * robot.gravity().norm()
}

/// Largest moment (N m) of a tendon about a joint, and of a backbone or a hinge bent by a radian.
fn strength(robot: &Robot, straight: &[f64]) -> f64 {
    let pull = |tendon: usize| largest_tension(&robot.tendons()[tendon], straight[tendon]);
    let segments = robot.segments().iter();
    let spans = robot.spans().iter();
    let levers =
        (segments.map(|s| (s.tendon, s.to.norm()))).chain(spans.map(|s| (s.tendon, s.to.norm())));
    let tendons = levers.map(|(tendon, lever)| pull(tendon) * lever);
    let backbone = |disc: &Disc| match (&disc.backbone, &disc.hinges) {
        (Some(backbone), _) => backbone.stiffness().amax(),
        (None, Some(hinges)) => hinges.stiffness.amax(),
        (None, None) => 0.0,
    };
    let backbones = robot.discs().iter().map(backbone);
    tendons.fold(0.0, f64::max) + backbones.fold(0.0, f64::max)
}

/// Largest tension (N) of a tendon of this length (m) under a command in its range.
fn largest_tension(tendon: &Tendon, length: f64) -> f64 {
    let [low, high] = tendon.range;
    match tendon.drive {
        Drive::Tension => high,
        Drive::Gain(_) | Drive::Length => {
            let tension = |command: f64| tendon.state(length, command).tension.abs();
            let slack = tendon.spring() * (length - high).abs();
            f64::max(tension(low), slack)
        }
    }
}
