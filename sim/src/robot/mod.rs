//! The robot: what the user writes ([`RobotSpec`]) and what it is compiled into ([`Robot`]).

mod angle;
mod cameras;
mod checks;
mod clocking;
mod command;
mod compile;
mod hinge_axes;
mod hinges;
mod holes;
mod joint;
mod loads;
mod mass;
mod on_hinges;
mod parameter;
mod parameter_key;
mod parameter_kind;
mod parameters;
mod per_disc;
mod quantity;
mod spec;
mod spec_error;
mod tendon_spec;
mod units;
mod validate;
mod value;

pub use cameras::{Aim, CameraSpec, Cameras, Lens, PinholeSpec, RingSpec};
pub use command::{Command, CommandError};
pub(crate) use hinge_axes::HingeAxes;
pub use hinges::{Hinge, HingeJoint, Hinges};
pub use holes::{HoleCircle, Holes};
pub use joint::{Backbone, Limit, RodDamping, RodSpec};
pub use loads::{Frame, Loads, LoadsError, Payload, Wrench};
pub use mass::{MassSpec, RigidMass, SolidMass};
pub use on_hinges::HingeRow;
pub(crate) use parameter::check;
pub use parameter::{Axis, Parameter, ParameterError};
pub use parameter_key::ParameterKeyError;
pub use parameter_kind::ParameterKind;
pub use parameters::ActsOn;
pub use per_disc::PerDisc;
pub use quantity::{Quantity, Values};
pub use spec::{BaseSpec, Fluid, ModuleSpec, RobotSpec, Routing};
pub use spec_error::SpecError;
pub(crate) use tendon_spec::joints_along;
pub use tendon_spec::{Body, Drive, Friction, Pull, RouteSpec, ServoSpec, TendonSpec, Waypoint};
pub use units::{CommandUnit, DisplayUnit, TendonGroup};
pub(crate) use value::shift;

use std::sync::Arc;

use compile::Model;
use nalgebra::{UnitQuaternion, Vector3};

/// Length, as a share of the backbone's, that is not told from none: sums of pitches are rounded.
const ARC_ROUNDING: f64 = 1e-9;

/// A validated robot, laid out for computation. Cheap to clone: clones share what it consists of.
///
/// Bodies are numbered along the chain: disc `i` turns on joint `i`, carried by disc `i - 1`, or by
/// the base for `i = 0`. A configuration of `n` discs is one rotation per joint, `SO(3)^n`.
#[derive(Clone, Debug)]
pub struct Robot(Arc<Model>);

/// One disc of the chain.
#[derive(Clone, Debug)]
pub struct Disc {
    /// Origin in the frame of the body below, in the straight pose (m).
    pub offset: Vector3<f64>,
    /// Centre of the joint seen from that of the joint below (joint 0: from the base origin),
    /// in the frame of the body below (m).
    pub joint_offset: Vector3<f64>,
    /// Origin seen from the centre of the disc's joint, in the disc's frame (m).
    pub origin: Vector3<f64>,
    /// Mass of the disc and of the rod it carries (kg).
    pub mass: f64,
    /// Centre of mass seen from the disc's origin, in the disc's frame (m).
    pub centre_of_mass: Vector3<f64>,
    /// Moments of inertia about the centre of mass, along the disc's axes (kg m²).
    pub inertia: Vector3<f64>,
    /// Radius (m).
    pub radius: f64,
    /// Half of the height (m).
    pub half_height: f64,
    /// Viscous damping of the disc's joint that is alike about all axes (N m s/rad): its own, and the least of its rod's.
    pub damping: f64,
    /// What its rod's damping is about the disc's axes beyond that (N m s/rad).
    pub extra_damping: Vector3<f64>,
    /// Armature inertia of the disc's joint (kg m²).
    pub armature: f64,
    /// Elastic backbone, or piece of a rod, at the disc's joint.
    pub backbone: Option<Backbone>,
    /// Soft limit of the disc's joint.
    pub limit: Option<Limit>,
    /// The hinges that the disc's joint consists of; a ball joint where there are none.
    pub hinges: Option<Box<Hinges>>,
}

/// One tendon.
#[derive(Clone, Debug)]
pub struct Tendon {
    /// What a command means to it.
    pub drive: Drive,
    /// Smallest and largest command (m, or N for a tension drive).
    pub range: [f64; 2],
    /// Whether it can push.
    pub pull: Pull,
    /// Stiffness of drive and tendon in series (N/m); infinite for a length drive on an
    /// inextensible tendon, 0 for a tension drive.
    pub stiffness: f64,
    /// Growth of that stiffness per stretch (1/m): see [`TendonSpec::stiffening`].
    pub stiffening: f64,
    /// Friction in its holes.
    pub friction: Option<Friction>,
    /// What its servo cannot do at once, or at all; without a lag and limits where the file does not give it.
    pub servo: ServoSpec,
    /// The holes it goes through, from the servo to where it is fastened.
    pub route: Vec<Waypoint>,
    /// Length of the pieces between holes of one and the same body (m).
    pub(crate) fixed_length: f64,
}

/// The straight piece of a tendon between a hole of the body below joint `joint` and a hole of the
/// disc that the joint carries. Its length depends on that joint's rotation alone.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    pub joint: usize,
    pub tendon: usize,
    /// The piece's number on the tendon's route, from the servo.
    pub place: usize,
    /// The lower hole as seen from the joint's centre, in the lower body's frame (m).
    pub from: Vector3<f64>,
    /// The upper hole as seen from the joint's centre, in the disc's frame (m).
    pub to: Vector3<f64>,
}

/// The straight piece of a tendon between bodies that are not neighbours. Its length depends on the
/// joints above `lower` up to `upper`.
#[derive(Clone, Debug)]
pub(crate) struct Span {
    pub tendon: usize,
    /// The piece's number on the tendon's route, from the servo.
    pub place: usize,
    /// The lower disc; `None` for the base.
    pub lower: Option<usize>,
    /// The upper disc.
    pub upper: usize,
    /// The lower hole as seen from the joint centre of its disc (or the base origin), in its body's
    /// frame (m).
    pub from: Vector3<f64>,
    /// The upper hole as seen from the joint centre of its disc, in its frame (m).
    pub to: Vector3<f64>,
}

impl Robot {
    /// Whether the other one is a clone of this.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// The specification that this robot was compiled from.
    pub fn spec(&self) -> &RobotSpec {
        &self.0.spec
    }

    /// The discs, from the base to the tip.
    pub fn discs(&self) -> &[Disc] {
        &self.0.discs
    }

    /// The tendons: those of the modules, from the base up, then those with routes of their own. A
    /// command has one entry for each.
    pub fn tendons(&self) -> &[Tendon] {
        &self.0.tendons
    }

    /// Distance of each disc's origin from the base along the backbone (m).
    pub fn arc_lengths(&self) -> Vec<f64> {
        let mut sum = 0.0;
        let add = |disc: &Disc| {
            sum += disc.offset.norm();
            sum
        };
        self.discs().iter().map(add).collect()
    }

    /// `arc_length` (m) as a place on the backbone: that itself between 0 and the backbone's length, an end where only
    /// rounding is between, `None` beyond.
    pub(crate) fn on_backbone(&self, arc_length: f64) -> Option<f64> {
        let length: f64 = self.discs().iter().map(|disc| disc.offset.norm()).sum();
        let rounding = ARC_ROUNDING * length;
        let on = (-rounding..=length + rounding).contains(&arc_length);
        on.then(|| arc_length.clamp(0.0, length))
    }

    /// Number of joint coordinates: three for each joint. Those of a ball joint are a rotation vector in its disc's frame, those of
    /// [`Hinges`] their angles in order, and 0 for what is missing to three.
    pub fn dof(&self) -> usize {
        3 * self.0.discs.len()
    }

    /// Whether any joint consists of hinges.
    pub(crate) fn has_hinges(&self) -> bool {
        self.discs().iter().any(|disc| disc.hinges.is_some())
    }

    /// Tendon segments between neighbouring bodies, ordered by joint.
    pub(crate) fn segments(&self) -> &[Segment] {
        &self.0.segments
    }

    /// Tendon segments that pass discs by.
    pub(crate) fn spans(&self) -> &[Span] {
        &self.0.spans
    }

    /// Gravitational acceleration, world frame (m/s²).
    pub(crate) fn gravity(&self) -> Vector3<f64> {
        self.0.gravity
    }

    /// Base origin, world frame (m).
    pub(crate) fn base(&self) -> Vector3<f64> {
        self.0.base
    }

    /// Base orientation in the world frame.
    pub(crate) fn base_orientation(&self) -> UnitQuaternion<f64> {
        self.0.base_orientation
    }
}
