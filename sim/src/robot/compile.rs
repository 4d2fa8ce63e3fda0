//! From the specification to the robot laid out for computation.

use std::sync::Arc;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::mass::Part;
use super::spec_error::refuse;
use super::{
    Body, Disc, Drive, Hinges, ModuleSpec, PerDisc, Robot, RobotSpec, Routing, Segment, Span,
    SpecError, Tendon, TendonSpec, Waypoint,
};

/// What a robot consists of.
#[derive(Debug)]
pub(super) struct Model {
    pub spec: RobotSpec,
    /// Gravitational acceleration, world frame (m/s²).
    pub gravity: Vector3<f64>,
    /// Base origin, world frame (m).
    pub base: Vector3<f64>,
    /// Base orientation in the world frame.
    pub base_orientation: UnitQuaternion<f64>,
    pub discs: Vec<Disc>,
    pub tendons: Vec<Tendon>,
    /// Tendon segments between neighbouring bodies, ordered by joint.
    pub segments: Vec<Segment>,
    /// Tendon segments that pass discs by.
    pub spans: Vec<Span>,
}

impl Robot {
    /// Compiles a specification.
    ///
    /// # Errors
    /// [`SpecError`] when the specification is not valid, or a tendon has a segment of no length in
    /// the straight pose (its direction would be undefined) that does not lie in a joint's centre.
    pub fn new(spec: RobotSpec) -> Result<Self, SpecError> {
        spec.validate()?;
        let model = Model::lay_out(spec);
        model.check_segments()?;
        Ok(Self(Arc::new(model)))
    }

    /// The same robot with its base elsewhere: `position` of its origin in the world (m), `orientation` a quaternion (w, x, y, z),
    /// normalised on use. Cameras stay.
    ///
    /// # Errors
    /// As [`new`](Self::new): for numbers that are not finite, a position farther away than 1e6 m, a quaternion of zeros.
    pub fn with_base(&self, position: [f64; 3], orientation: [f64; 4]) -> Result<Self, SpecError> {
        let mut spec = self.spec().clone();
        (spec.base.position, spec.base.orientation) = (position, orientation);
        Self::new(spec)
    }

    /// The layout of a specification whose lists have been validated; numbers may be anything.
    pub(crate) fn lay_out(spec: RobotSpec) -> Self {
        Self(Arc::new(Model::lay_out(spec)))
    }

    /// A hole as seen from the centre of its body's joint (or the base origin), in its frame (m).
    pub(crate) fn hole(&self, waypoint: Waypoint) -> Vector3<f64> {
        self.0.hole(waypoint)
    }
}

impl Model {
    fn lay_out(spec: RobotSpec) -> Self {
        let [w, x, y, z] = spec.base.orientation;
        let mut model = Self {
            gravity: spec.gravity.into(),
            base: spec.base.position.into(),
            base_orientation: UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
            discs: discs(&spec),
            tendons: tendons(&spec),
            segments: Vec::new(),
            spans: Vec::new(),
            spec,
        };
        model.lay_tendons();
        model
    }

    /// Cuts every tendon's route into segments.
    fn lay_tendons(&mut self) {
        for tendon in 0..self.tendons.len() {
            let route = self.tendons[tendon].route.clone();
            for (place, ends) in route.windows(2).enumerate() {
                let (lower, upper) = match (ends[0].0, ends[1].0) {
                    (Body::Disc(a), Body::Disc(b)) if a > b => (ends[1], ends[0]),
                    (Body::Disc(_), Body::Base) => (ends[1], ends[0]),
                    _ => (ends[0], ends[1]),
                };
                self.lay_segment(tendon, place, lower, upper);
            }
        }
        self.segments.sort_by_key(|segment| segment.joint);
    }

    fn lay_segment(&mut self, tendon: usize, place: usize, lower: Waypoint, upper: Waypoint) {
        let (from, to) = (self.hole(lower), self.hole(upper));
        let lower_disc = match lower.0 {
            Body::Base => None,
            Body::Disc(disc) => Some(disc),
        };
        let upper = match upper.0 {
            Body::Disc(disc) if Some(disc) != lower_disc => disc,
            _ => {
                self.tendons[tendon].fixed_length += (to - from).norm();
                return;
            }
        };
        if lower_disc.map_or(0, |disc| disc + 1) == upper {
            self.segments.push(Segment {
                joint: upper,
                tendon,
                place,
                from: from - self.discs[upper].joint_offset,
                to,
            });
        } else {
            self.spans.push(Span {
                tendon,
                place,
                lower: lower_disc,
                upper,
                from,
                to,
            });
        }
    }

    /// A segment of no length in the straight pose has no direction, unless it lies in the joint's
    /// centre and stays of no length.
    fn check_segments(&self) -> Result<(), SpecError> {
        let refuse = |tendon: usize, disc: usize| {
            let found = format!("of no length below disc {disc}");
            let expected = "successive holes at least 1e-6 m apart in the straight pose";
            Err(refuse(&format!("tendon {}", tendon + 1), found, expected))
        };
        for segment in &self.segments {
            let in_joint = segment.from.norm() < 1e-12 && segment.to.norm() < 1e-12;
            if (segment.to - segment.from).norm() < 1e-6 && !in_joint {
                return refuse(segment.tendon, segment.joint);
            }
        }
        for span in &self.spans {
            let first = span.lower.map_or(0, |disc| disc + 1);
            let joints = first..=span.upper;
            let between: Vector3<f64> = joints.map(|j| self.discs[j].joint_offset).sum();
            if (between + span.to - span.from).norm() < 1e-6 {
                return refuse(span.tendon, span.upper);
            }
        }
        Ok(())
    }

    fn hole(&self, waypoint: Waypoint) -> Vector3<f64> {
        let Waypoint(body, hole) = waypoint;
        let [x, y] = (self.spec.hole_position(body, hole)).expect("validated: a hole of a body");
        match waypoint.0 {
            Body::Base => Vector3::new(x, y, self.spec.base.hole_height),
            Body::Disc(disc) => self.discs[disc].origin + Vector3::new(x, y, 0.0),
        }
    }
}

fn of<T: Clone>(values: &PerDisc<T>, index: usize) -> T {
    values
        .of_disc(index)
        .expect("validated: one per disc")
        .clone()
}

fn discs(spec: &RobotSpec) -> Vec<Disc> {
    let mut discs: Vec<Disc> = Vec::with_capacity(spec.disc_count());
    let of_discs = (spec.modules.iter()).flat_map(|m| (0..m.discs).map(move |index| (m, index)));
    let mut of_discs = of_discs.peekable();
    while let Some((module, index)) = of_discs.next() {
        // What lies between the joint below and the origin of the body below.
        let origin_below = discs.last().map_or(Vector3::zeros(), |disc| disc.origin);
        let mut disc = disc(module, index, origin_below);
        let mut part = Part::of_disc(&module.mass, index, module.radius, module.half_height);
        // The rod from the disc's joint to its origin, and on to the next disc's joint.
        if let Some(rod) = &module.rod {
            part = part.with(Part::of_rod(rod, [-module.joint_below, 0.0]));
        }
        if let Some(&(next, index)) = of_discs.peek()
            && let Some(rod) = &next.rod
        {
            let joint = step(next, index) - next.joint_below;
            part = part.with(Part::of_rod(rod, [0.0, joint]));
        }
        (disc.mass, disc.centre_of_mass, disc.inertia) = (part.mass, part.centre, part.inertia);
        discs.push(disc);
    }
    discs
}

/// Height of a disc's origin above that of the body below (m).
fn step(module: &ModuleSpec, index: usize) -> f64 {
    match index {
        0 => module.first_offset,
        _ => module.pitch,
    }
}

/// A disc, its mass apart.
fn disc(module: &ModuleSpec, index: usize, origin_below: Vector3<f64>) -> Disc {
    let step = step(module, index);
    let (offset, origin) = (
        Vector3::new(0.0, 0.0, step),
        Vector3::new(0.0, 0.0, module.joint_below),
    );
    let rod = module.rod.map(|rod| rod.backbone(step));
    let rod_damping = (module.rod.zip(rod)).map_or(Vector3::zeros(), |(rod, joint)| {
        rod.damping.of_joint(&joint)
    });
    let alike = rod_damping.min();
    Disc {
        offset,
        joint_offset: origin_below + offset - origin,
        origin,
        mass: 0.0,
        centre_of_mass: Vector3::zeros(),
        inertia: Vector3::zeros(),
        radius: module.radius,
        half_height: module.half_height,
        damping: of(&module.damping, index) + alike,
        extra_damping: rod_damping.add_scalar(-alike),
        armature: of(&module.armature, index),
        backbone: rod.or(module.backbone.as_ref().map(|b| of(b, index))),
        limit: module.limit.as_ref().map(|l| of(l, index)),
        hinges: module.joint.as_ref().map(|joint| {
            let (damping, armature) = (of(&module.damping, index), of(&module.armature, index));
            Box::new(Hinges::of_joint(&of(joint, index), damping, armature))
        }),
    }
}

fn tendons(spec: &RobotSpec) -> Vec<Tendon> {
    let mut tendons = Vec::new();
    let mut first_disc = 0;
    for (index, module) in spec.modules.iter().enumerate() {
        let end = first_disc + module.discs;
        let start = match spec.routing {
            Routing::ModuleBelow => first_disc,
            Routing::Base => 0,
        };
        if let Some(tendon) = &module.tendons {
            let lowest = start.checked_sub(1).map_or(Body::Base, Body::Disc);
            let bodies = std::iter::once(lowest).chain((start..end).map(Body::Disc));
            // Of each body, the number of the first hole in the copy turned as this module is.
            let guides: Vec<(Body, usize)> = bodies
                .filter_map(|body| Some((body, spec.clocked_hole(body, index, 0)?)))
                .collect();
            for hole in 0..module.holes.count() {
                let through = |&(body, first): &(Body, usize)| Waypoint(body, first + hole);
                tendons.push(self::tendon(tendon, guides.iter().map(through).collect()));
            }
        }
        first_disc = end;
    }
    let own = spec.routes.iter();
    tendons.extend(own.map(|route| tendon(&route.tendon, route.through.clone())));
    tendons
}

fn tendon(spec: &TendonSpec, route: Vec<Waypoint>) -> Tendon {
    let stiffness = match (spec.drive, spec.axial_stiffness) {
        (Drive::Tension, _) => 0.0,
        (Drive::Length, None) => f64::INFINITY,
        (Drive::Length, Some(axial)) => axial,
        (Drive::Gain(gain), None) => gain,
        (Drive::Gain(gain), Some(axial)) => gain * axial / (gain + axial),
    };
    Tendon {
        drive: spec.drive,
        range: spec.range,
        pull: spec.pull,
        stiffness,
        stiffening: spec.stiffening,
        friction: spec.friction,
        servo: spec.servo.unwrap_or_default(),
        route,
        fixed_length: 0.0,
    }
}
