//! The table of unknowns: for each kind its group and name, its unit and values, what there is one of, what is known of it before,
//! and what it sets.

use super::Group;
use super::facts::Facts;
use super::numbers::{self, Numbers};
use super::places::{At, Each, Spread};
use crate::robot::{Axis, Quantity, Values};

/// A kind of unknown.
pub(super) struct Row {
    pub group: Group,
    /// Its name has `{number}` where tendons and servos are counted, from 1, `{index}` where modules and markers are, from 0, and
    /// `{axis}`.
    pub quantity: Quantity,
    pub each: Each,
    /// The prior's mean, where the fit starts: what the robot file and the column map say. Numbers that may be 0 start at half a
    /// spread at least, as many have no derivative at 0.
    pub first: fn(&Facts, At) -> f64,
    /// The prior's standard deviation.
    pub spread: Spread,
    pub set: fn(&mut Numbers, At, f64),
}

impl Row {
    /// The name of one of the kind.
    pub fn name(&self, at: At) -> String {
        (self.quantity.name)
            .replace("{number}", &(at.number + 1).to_string())
            .replace("{index}", &at.number.to_string())
            .replace("{axis}", &at.axis.to_string())
    }

    /// Whether it changes the robot, and not only what lies between it and the recording.
    pub fn is_of_robot(&self) -> bool {
        !matches!(self.each, Each::Once | Each::Servo | Each::MarkerPosition)
    }
}

const fn factor(name: &'static str) -> Quantity {
    Quantity {
        name,
        unit: "",
        values: Values::Positive,
    }
}

const fn not_negative(name: &'static str, unit: &'static str) -> Quantity {
    Quantity {
        name,
        unit,
        values: Values::NotNegative,
    }
}

const fn any(name: &'static str, unit: &'static str) -> Quantity {
    Quantity {
        name,
        unit,
        values: Values::Any,
    }
}

/// A module, without an axis.
const ONE: &[Axis] = &[Axis::X];

/// All kinds of unknowns; those of a group in the order in which they are set.
pub(super) static TABLE: [Row; 19] = [
    Row {
        group: Group::SpoolRadius,
        quantity: factor("gain of servo {number}"),
        each: Each::Servo,
        first: |facts, at| facts.transmission.servos[at.number].gain,
        spread: Spread::Of(0.03),
        set: |numbers, at, value| numbers.transmission.servos[at.number].gain = value,
    },
    // Spools of one kind differ less from each other than from what a file says of them.
    Row {
        group: Group::SpoolRadius,
        quantity: factor("gain of all servos"),
        each: Each::Once,
        first: |_, _| 1.0,
        spread: Spread::Of(0.2),
        set: numbers::scale_gains,
    },
    Row {
        group: Group::Pretension,
        quantity: any("offset of servo {number}", "m"),
        each: Each::Servo,
        first: |facts, at| facts.transmission.servos[at.number].offset,
        spread: Spread::OfDisplacement(0.03),
        set: |numbers, at, value| numbers.transmission.servos[at.number].offset = value,
    },
    Row {
        group: Group::Backlash,
        quantity: not_negative("backlash of servo {number}", "m"),
        each: Each::Servo,
        first: |facts, at| facts.transmission.servos[at.number].backlash,
        spread: Spread::OfDisplacement(0.02),
        set: |numbers, at, value| numbers.transmission.servos[at.number].backlash = value,
    },
    Row {
        group: Group::Lag,
        quantity: not_negative("lag", "s"),
        each: Each::Once,
        first: |facts, _| facts.transmission.lag,
        spread: Spread::OfStep(0.2),
        set: |numbers, _, value| numbers.transmission.lag = value,
    },
    Row {
        group: Group::HoleAngles,
        quantity: any("rotation of the holes of tendon {number}", "rad"),
        each: Each::Tendon,
        first: |_, _| 0.0,
        spread: Spread::Of(0.17),
        set: numbers::rotate_holes,
    },
    Row {
        group: Group::HoleRadius,
        quantity: factor("hole radius factor of module {index}"),
        each: Each::Module,
        first: |_, _| 1.0,
        spread: Spread::Of(0.05),
        set: numbers::scale_holes,
    },
    Row {
        group: Group::Twist,
        quantity: any("twist of module {index}", "rad"),
        each: Each::ElasticModule(&[Axis::Z]),
        first: |_, _| 0.0,
        spread: Spread::Of(0.15),
        set: numbers::bend_at_rest,
    },
    Row {
        group: Group::Stiffness,
        quantity: factor("bending stiffness factor of module {index}"),
        each: Each::ElasticModule(ONE),
        first: |_, _| 1.0,
        spread: Spread::Of(0.2),
        set: numbers::scale_bending,
    },
    Row {
        group: Group::Torsion,
        quantity: factor("torsion stiffness factor of module {index}"),
        each: Each::ElasticModule(ONE),
        first: |_, _| 1.0,
        spread: Spread::Of(0.3),
        set: numbers::scale_torsion,
    },
    Row {
        group: Group::RestBend,
        quantity: any("rest bend of module {index} about {axis}", "rad"),
        each: Each::ElasticModule(&[Axis::X, Axis::Y]),
        first: |_, _| 0.0,
        spread: Spread::Of(0.15),
        set: numbers::bend_at_rest,
    },
    Row {
        group: Group::TendonStiffness,
        quantity: factor("stiffness factor of the tendons of module {index}"),
        each: Each::ModuleOfStretchingTendons,
        first: |_, _| 1.0,
        spread: Spread::Of(0.5),
        set: numbers::scale_tendons,
    },
    Row {
        group: Group::TendonStiffening,
        quantity: not_negative("stiffening of the tendons of module {index}", "1/m"),
        each: Each::ModuleOfStretchingTendons,
        first: |facts, at| {
            (facts.tendon_of(at.number, true)).map_or(0.0, |tendon| tendon.stiffening)
        },
        spread: Spread::PerHoleRadius(1.0),
        set: numbers::stiffen_tendons,
    },
    Row {
        group: Group::Friction,
        quantity: not_negative("friction of the tendons of module {index}", ""),
        each: Each::ModuleOfTendons,
        first: |facts, at| {
            let friction = (facts.tendon_of(at.number, false)).and_then(|tendon| tendon.friction);
            friction.map_or(0.0, |friction| friction.coefficient)
        },
        spread: Spread::Of(0.1),
        set: numbers::set_friction,
    },
    Row {
        group: Group::BasePose,
        quantity: any("rotation of the base about {axis}", "rad"),
        each: Each::BaseRotation,
        first: |_, _| 0.0,
        spread: Spread::Of(0.2),
        set: numbers::rotate_base,
    },
    Row {
        group: Group::BasePose,
        quantity: any("{axis} of the base", "m"),
        each: Each::BasePosition,
        first: |facts, at| facts.spec().base.position[at.axis.index()],
        spread: Spread::OfLength(0.1),
        set: |numbers, at, value| numbers.spec.base.position[at.axis.index()] = value,
    },
    Row {
        group: Group::MarkerOffset,
        quantity: any("{axis} of marker {index}", "m"),
        each: Each::MarkerPosition,
        first: |facts, at| facts.transmission.markers[at.number].place[at.axis.index()],
        spread: Spread::OfLength(0.1),
        set: |numbers, at, value| {
            numbers.transmission.markers[at.number].place[at.axis.index()] = value;
        },
    },
    Row {
        group: Group::Gravity,
        quantity: any("rotation of gravity about {axis}", "rad"),
        each: Each::GravityRotation,
        first: |_, _| 0.0,
        spread: Spread::Of(0.2),
        set: numbers::rotate_gravity,
    },
    Row {
        group: Group::Mass,
        quantity: factor("mass factor of module {index}"),
        each: Each::Module,
        first: |_, _| 1.0,
        spread: Spread::Of(0.5),
        set: |numbers, at, factor| numbers.spec.modules[at.number].mass.scale(factor),
    },
];
