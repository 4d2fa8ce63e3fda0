//! From groups to unknowns: their names, and what was known of them before.

use nalgebra::Vector3;

use super::explicit::Explicit;
use super::unknowns::{Scale, Target, Unknown};
use super::{Group, Order, Recording, RecordingError, Transmission};
use crate::robot::{Axis, Drive, ModuleSpec, RobotSpec};

/// Widths of the priors. Those of lengths are shares of the holes' distance from the axis or of the robot's length.
const GAIN: f64 = 0.03;
/// Of all gains alike: spools of one kind differ less from each other than from what a file says of them.
const COMMON_GAIN: f64 = 0.2;
const OFFSET: f64 = 0.03;
const BACKLASH: f64 = 0.02;
const LAG_STEPS: f64 = 0.2;
/// Least spread of a lag (s): that of servos and motion capture does not shrink with the time between rows.
const LAG: f64 = 0.05;
const HOLE_ANGLE: f64 = 0.17;
const HOLE_RADIUS: f64 = 0.05;
const REST: f64 = 0.15;
const BENDING: f64 = 0.2;
const TORSION: f64 = 0.3;
const TENDON_STIFFNESS: f64 = 0.5;
const TENDON_STIFFENING: f64 = 1.0;
const FRICTION: f64 = 0.1;
const MASS: f64 = 0.5;
const TURN: f64 = 0.2;
const PLACE: f64 = 0.1;

/// The unknowns of `groups`.
///
/// # Errors
/// [`RecordingError::Group`] for a group that the robot has not.
pub(super) fn unknowns(
    groups: &[Group],
    explicit: &Explicit,
    transmission: &Transmission,
    recording: &Recording,
) -> Result<Vec<Unknown>, RecordingError> {
    let mut all = Vec::new();
    for (place, &group) in groups.iter().enumerate() {
        if !groups[..place].contains(&group) {
            Maker {
                group,
                groups,
                explicit,
                transmission,
                recording,
                made: &mut all,
            }
            .make()?;
        }
    }
    Ok(all)
}

struct Maker<'a> {
    group: Group,
    groups: &'a [Group],
    explicit: &'a Explicit,
    transmission: &'a Transmission,
    recording: &'a Recording,
    made: &'a mut Vec<Unknown>,
}

impl Maker<'_> {
    fn add(
        &mut self,
        name: String,
        unit: &'static str,
        target: Target,
        scale: Scale,
        [first, spread]: [f64; 2],
    ) {
        let least = match target {
            Target::Backlash(_)
            | Target::Lag
            | Target::TendonStiffening(_)
            | Target::Friction(_) => 0.0,
            _ => f64::NEG_INFINITY,
        };
        self.made.push(Unknown {
            name,
            unit,
            group: self.group,
            target,
            scale,
            first,
            spread,
            least,
        });
    }

    fn make(&mut self) -> Result<(), RecordingError> {
        use Scale::{Linear, Logarithmic};
        let spec = &self.explicit.spec;
        let group = self.group;
        let (tendons, modules) = (spec.routes.len(), spec.modules.len());
        let refuse = |reason: &'static str| Err(RecordingError::Group { group, reason });
        let length = length(spec);
        let radius = self.hole_radius();
        let elastic = |m: &usize| spec.modules[*m].backbone.is_some();
        let elastic: Vec<usize> = (0..modules).filter(elastic).collect();
        if matches!(
            group,
            Group::Twist | Group::Stiffness | Group::Torsion | Group::RestBend
        ) && elastic.is_empty()
        {
            return refuse("no module has a backbone or a rod");
        }
        if matches!(group, Group::Backlash | Group::Lag | Group::Friction)
            && self.recording.order == Order::AtRest
        {
            return refuse("each row is the robot at rest, which does not tell how it came there");
        }
        match group {
            Group::SpoolRadius => {
                for t in 0..tendons {
                    let first = self.transmission.servos[t].gain;
                    self.add(
                        format!("gain of servo {}", t + 1),
                        "",
                        Target::Gain(t),
                        Logarithmic,
                        [first, GAIN],
                    );
                }
                self.add(
                    "gain of all servos".into(),
                    "",
                    Target::CommonGain,
                    Logarithmic,
                    [1.0, COMMON_GAIN],
                );
            }
            Group::Pretension => {
                for t in 0..tendons {
                    let first = self.transmission.servos[t].offset;
                    let (unit, spread) = self.pull_unit(t, OFFSET * radius);
                    self.add(
                        format!("offset of servo {}", t + 1),
                        unit,
                        Target::Offset(t),
                        Linear,
                        [first, spread],
                    );
                }
            }
            Group::Backlash => {
                for t in 0..tendons {
                    let (unit, spread) = self.pull_unit(t, BACKLASH * radius);
                    let first = self.transmission.servos[t].backlash.max(0.5 * spread);
                    self.add(
                        format!("backlash of servo {}", t + 1),
                        unit,
                        Target::Backlash(t),
                        Linear,
                        [first, spread],
                    );
                }
            }
            Group::Lag => {
                let spread = (LAG_STEPS * self.recording.median_step()).max(LAG);
                self.add(
                    "lag".into(),
                    "s",
                    Target::Lag,
                    Linear,
                    [self.transmission.lag.max(0.5 * spread), spread],
                );
            }
            Group::HoleAngles => {
                for t in 0..tendons {
                    self.add(
                        format!("turn of the holes of tendon {}", t + 1),
                        "rad",
                        Target::HoleAngle(t),
                        Linear,
                        [0.0, HOLE_ANGLE],
                    );
                }
            }
            Group::HoleRadius => {
                for m in 0..modules {
                    self.add(
                        format!("hole radius factor of module {m}"),
                        "",
                        Target::HoleRadius(m),
                        Logarithmic,
                        [1.0, HOLE_RADIUS],
                    );
                }
            }
            Group::Twist => {
                for m in elastic {
                    self.add(
                        format!("twist of module {m}"),
                        "rad",
                        Target::Rest(m, Axis::Z),
                        Linear,
                        [0.0, REST],
                    );
                }
            }
            Group::Stiffness => {
                for m in elastic {
                    self.add(
                        format!("bending stiffness factor of module {m}"),
                        "",
                        Target::Bending(m),
                        Logarithmic,
                        [1.0, BENDING],
                    );
                }
            }
            Group::Torsion => {
                for m in elastic {
                    self.add(
                        format!("torsion stiffness factor of module {m}"),
                        "",
                        Target::Torsion(m),
                        Logarithmic,
                        [1.0, TORSION],
                    );
                }
            }
            Group::RestBend => {
                for m in elastic {
                    for axis in [Axis::X, Axis::Y] {
                        self.add(
                            format!("rest bend of module {m} about {axis}"),
                            "rad",
                            Target::Rest(m, axis),
                            Linear,
                            [0.0, REST],
                        );
                    }
                }
            }
            Group::TendonStiffness | Group::TendonStiffening => {
                let stretches = |t: &usize| spec.routes[*t].tendon.stretches();
                let soft: Vec<usize> = (0..tendons).filter(stretches).collect();
                if soft.is_empty() {
                    return refuse(
                        "no tendon has a stiffness: expected a drive with a gain, or an axial_stiffness",
                    );
                }
                for m in 0..modules {
                    let Some(&t) = soft.iter().find(|&&t| self.explicit.ends[t] == m) else {
                        continue;
                    };
                    if group == Group::TendonStiffness {
                        self.add(
                            format!("stiffness factor of the tendons of module {m}"),
                            "",
                            Target::TendonStiffness(m),
                            Logarithmic,
                            [1.0, TENDON_STIFFNESS],
                        );
                    } else {
                        let spread = TENDON_STIFFENING / radius;
                        let first = spec.routes[t].tendon.stiffening.max(0.5 * spread);
                        self.add(
                            format!("stiffening of the tendons of module {m}"),
                            "1/m",
                            Target::TendonStiffening(m),
                            Linear,
                            [first, spread],
                        );
                    }
                }
            }
            Group::Friction => {
                for m in 0..modules {
                    let Some(t) = (0..tendons).find(|&t| self.explicit.ends[t] == m) else {
                        continue;
                    };
                    let given = spec.routes[t]
                        .tendon
                        .friction
                        .map_or(0.0, |f| f.coefficient);
                    self.add(
                        format!("friction of the tendons of module {m}"),
                        "",
                        Target::Friction(m),
                        Linear,
                        [given.max(0.5 * FRICTION), FRICTION],
                    );
                }
            }
            Group::BasePose => {
                // A turn about the axis of the robot is one of all holes.
                let axes = if self.groups.contains(&Group::HoleAngles) {
                    2
                } else {
                    3
                };
                for axis in &Axis::ALL[..axes] {
                    self.add(
                        format!("turn of the base about {axis}"),
                        "rad",
                        Target::BaseRotation(*axis),
                        Linear,
                        [0.0, TURN],
                    );
                }
                for axis in Axis::ALL {
                    let first = spec.base.position[axis.index()];
                    self.add(
                        format!("{axis} of the base"),
                        "m",
                        Target::BasePosition(axis),
                        Linear,
                        [first, PLACE * length],
                    );
                }
            }
            Group::MarkerOffset => {
                for (marker, at) in self.transmission.markers.iter().enumerate() {
                    for axis in Axis::ALL {
                        let first = at.place[axis.index()];
                        let name = format!("{axis} of marker {marker}");
                        self.made.push(Unknown {
                            name,
                            unit: "m",
                            group,
                            target: Target::MarkerPosition(marker, axis),
                            scale: Linear,
                            first,
                            spread: PLACE * length,
                            least: f64::NEG_INFINITY,
                        });
                    }
                }
            }
            Group::Gravity | Group::Mass if spec.gravity == [0.0; 3] => {
                return refuse(
                    "the robot's gravity is zero, which has no direction, and pulls on no mass",
                );
            }
            Group::Mass => {
                for m in 0..modules {
                    self.add(
                        format!("mass factor of module {m}"),
                        "",
                        Target::Mass(m),
                        Logarithmic,
                        [1.0, MASS],
                    );
                }
            }
            Group::Gravity => {
                let gravity = Vector3::from(spec.gravity);
                // A turn about gravity itself changes nothing.
                let along = gravity.iamax();
                for axis in Axis::ALL.into_iter().filter(|axis| axis.index() != along) {
                    self.add(
                        format!("turn of gravity about {axis}"),
                        "rad",
                        Target::GravityDirection(axis),
                        Linear,
                        [0.0, TURN],
                    );
                }
            }
        }
        Ok(())
    }

    /// Mean distance of the holes from the axis (m), or a share of the robot's length where all lie on it.
    fn hole_radius(&self) -> f64 {
        let holes: Vec<f64> = (self.explicit.spec.modules.iter())
            .flat_map(|module| module.holes.positions())
            .map(|[x, y]| x.hypot(y))
            .collect();
        let mean = holes.iter().sum::<f64>() / holes.len().max(1) as f64;
        if mean > 0.0 {
            mean
        } else {
            0.02 * length(&self.explicit.spec)
        }
    }

    /// Unit of what a servo reports, and a spread of it: `length` (m), or of a tension drive a share of the largest tension.
    fn pull_unit(&self, t: usize, length: f64) -> (&'static str, f64) {
        let tendon = &self.explicit.spec.routes[t].tendon;
        match tendon.drive {
            Drive::Tension => ("N", 0.02 * tendon.range[1]),
            Drive::Gain(_) | Drive::Length => ("m", length),
        }
    }
}

/// Length of the backbone (m).
pub(super) fn length(spec: &RobotSpec) -> f64 {
    let module = |m: &ModuleSpec| m.first_offset + m.pitch * (m.discs as f64 - 1.0);
    spec.modules.iter().map(module).sum()
}
