//! The robot: what the user writes ([`RobotSpec`]) and what it is compiled into ([`Robot`]).

mod command;
mod spec;

pub use command::{Command, CommandError, Loads, PayloadError};
pub use spec::{BaseSpec, Density, ModuleSpec, RingSpec, RobotSpec, Routing, SpecError};

use nalgebra::Vector3;

/// A validated robot, laid out for computation.
///
/// Bodies are numbered along the chain: disc `i` turns on joint `i`, carried by disc `i - 1`, or by
/// the base for `i = 0`. A configuration of `n` discs is one rotation per joint, `SO(3)^n`.
#[derive(Clone, Debug)]
pub struct Robot {
    spec: RobotSpec,
    /// Gravitational acceleration, world frame (m/s²).
    pub(crate) gravity: Vector3<f64>,
    /// Base origin, world frame (m).
    pub(crate) base: Vector3<f64>,
    pub(crate) discs: Vec<Disc>,
    pub(crate) tendons: Vec<Tendon>,
    /// Tendon segments, ordered by joint.
    pub(crate) segments: Vec<Segment>,
}

/// One disc of the chain.
#[derive(Clone, Debug)]
pub struct Disc {
    /// Origin in the frame of the body below (m).
    pub offset: Vector3<f64>,
    /// Mass (kg), the centre of mass being at the disc's origin.
    pub mass: f64,
    /// Radius (m).
    pub radius: f64,
    /// Half of the height (m).
    pub half_height: f64,
}

/// One tendon, driven by an actuator that pulls with `gain * (length - command)`.
#[derive(Clone, Debug)]
pub struct Tendon {
    /// Actuator gain kp (N/m).
    pub gain: f64,
    /// Smallest and largest command (m).
    pub command_range: [f64; 2],
}

/// The straight piece of a tendon between a hole of the body below joint `joint` and a hole of the
/// disc that the joint carries. Its length depends on that joint's rotation alone.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    pub joint: usize,
    pub tendon: usize,
    /// The lower hole as seen from the joint's centre, in the lower body's frame (m).
    pub from: Vector3<f64>,
    /// The upper hole, in the disc's frame (m).
    pub to: Vector3<f64>,
}

impl Robot {
    /// Compiles a specification.
    ///
    /// # Errors
    /// [`SpecError`] when the specification is not valid, or a tendon has a segment of no length in
    /// the straight pose (its direction would be undefined).
    pub fn new(spec: RobotSpec) -> Result<Self, SpecError> {
        spec.validate()?;
        let discs = discs(&spec);
        let tendons = tendons(&spec);
        let segments = segments(&spec, &discs);
        if let Some(segment) = segments.iter().find(|s| (s.to - s.from).norm() < 1e-6) {
            return Err(SpecError::Field {
                field: format!("tendon {}", segment.tendon),
                value: format!("of no length below disc {}", segment.joint),
                expected: "holes of neighbouring bodies at least 1e-6 m apart in the straight pose",
            });
        }
        Ok(Self {
            gravity: spec.gravity.into(),
            base: spec.base.position.into(),
            spec,
            discs,
            tendons,
            segments,
        })
    }

    /// A standard robot by name, or a robot file: [`RobotSpec::load`], compiled.
    ///
    /// # Errors
    /// [`SpecError`] as [`RobotSpec::load`] and [`Robot::new`].
    pub fn load(name_or_path: &str) -> Result<Self, SpecError> {
        Self::new(RobotSpec::load(name_or_path)?)
    }

    /// The specification that this robot was compiled from.
    pub fn spec(&self) -> &RobotSpec {
        &self.spec
    }

    /// The discs, from the base to the tip.
    pub fn discs(&self) -> &[Disc] {
        &self.discs
    }

    /// The tendons, module by module; a command has one entry for each.
    pub fn tendons(&self) -> &[Tendon] {
        &self.tendons
    }

    /// Number of joint coordinates: three for each ball joint.
    pub fn dof(&self) -> usize {
        3 * self.discs.len()
    }
}

fn discs(spec: &RobotSpec) -> Vec<Disc> {
    let module_discs = |module: &ModuleSpec| -> Vec<Disc> {
        let volume =
            std::f64::consts::PI * module.radius * module.radius * 2.0 * module.half_height;
        (0..module.discs)
            .map(|index| {
                let step = if index == 0 {
                    module.first_offset
                } else {
                    module.pitch
                };
                let density = module
                    .density
                    .of_disc(index)
                    .expect("validated: one per disc");
                Disc {
                    offset: Vector3::new(0.0, 0.0, step),
                    mass: density * volume,
                    radius: module.radius,
                    half_height: module.half_height,
                }
            })
            .collect()
    };
    spec.modules.iter().flat_map(module_discs).collect()
}

fn tendons(spec: &RobotSpec) -> Vec<Tendon> {
    let module_tendons = |module: &ModuleSpec| {
        let tendon = Tendon {
            gain: module.tendon_gain,
            command_range: module.command_range,
        };
        vec![tendon; module.holes.len()]
    };
    spec.modules.iter().flat_map(module_tendons).collect()
}

fn segments(spec: &RobotSpec, discs: &[Disc]) -> Vec<Segment> {
    let module_of_disc: Vec<usize> = (0..spec.modules.len())
        .flat_map(|m| std::iter::repeat_n(m, spec.modules[m].discs))
        .collect();
    let hole = |body: Option<usize>, hole: usize| match body {
        None => {
            let [x, y] = spec.base.holes[hole];
            Vector3::new(x, y, spec.base.hole_height)
        }
        Some(disc) => {
            let [x, y] = spec.modules[module_of_disc[disc]].holes[hole];
            Vector3::new(x, y, 0.0)
        }
    };
    let mut segments = Vec::new();
    let mut first_tendon = 0;
    let mut first_disc = 0;
    for module in &spec.modules {
        let end = first_disc + module.discs;
        let start = match spec.routing {
            Routing::ModuleBelow => first_disc,
            Routing::Base => 0,
        };
        for index in 0..module.holes.len() {
            segments.extend((start..end).map(|joint| Segment {
                joint,
                tendon: first_tendon + index,
                from: hole(joint.checked_sub(1), index) - discs[joint].offset,
                to: hole(Some(joint), index),
            }));
        }
        first_tendon += module.holes.len();
        first_disc = end;
    }
    segments.sort_by_key(|segment| segment.joint);
    segments
}
