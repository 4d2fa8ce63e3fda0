//! The table of parameters: of each kind its name, unit and values, how it is written, and what a robot has one for.

use std::mem::discriminant;

use super::{Axis, Body, Parameter, Quantity, RobotSpec, Values};

/// A kind of [`Parameter`]: for example the gain of a tendon.
#[derive(Debug)]
pub struct ParameterKind {
    /// What keys begin with, the unit, and the values that a robot can have.
    pub quantity: Quantity,
    /// In words, with `{tendon}` and the like where a parameter's own numbers stand.
    pub(super) title: &'static str,
    /// A key, or two.
    pub(super) example: &'static str,
    pub(super) each: Each,
}

/// What there is a parameter of, and how it is made of that.
#[derive(Debug)]
pub(super) enum Each {
    Once(Parameter),
    Tendon(fn(usize) -> Parameter),
    DiscAxis(fn(usize, Axis) -> Parameter),
    Module(fn(usize) -> Parameter),
    ModuleAxis(fn(usize, Axis) -> Parameter),
    Hinge(fn(usize, usize) -> Parameter),
    Body(fn(Body) -> Parameter),
    Hole(fn(Body, usize, Axis) -> Parameter),
}

/// Which one of its kind a parameter is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Which {
    Once,
    Tendon(usize),
    DiscAxis(usize, Axis),
    Module(usize),
    ModuleAxis(usize, Axis),
    Hinge(usize, usize),
    Body(Body),
    Hole(Body, usize, Axis),
}

const fn kind(
    [name, example]: [&'static str; 2],
    unit: &'static str,
    values: Values,
    each: Each,
    title: &'static str,
) -> ParameterKind {
    ParameterKind {
        quantity: Quantity { name, unit, values },
        title,
        example,
        each,
    }
}

/// All kinds; those of commands and loads first.
#[rustfmt::skip]
static KINDS: [ParameterKind; 17] = {
    use Parameter as P;
    use Values::{Any, NotNegative, Positive};
    [
        kind(["command", "command[0]"], "m or N", Any, Each::Tendon(P::Command), "command of tendon {tendon}"),
        kind(["payload", "payload"], "kg", NotNegative, Each::Once(P::Payload), "payload"),
        kind(["force", "force[9].x"], "N", Any, Each::DiscAxis(P::Force), "force on disc {disc} along {axis}"),
        kind(["moment", "moment[9].z"], "N m", Any, Each::DiscAxis(P::Moment), "moment on disc {disc} about {axis}"),
        kind(["gain", "gain[2]"], "N/m", Positive, Each::Tendon(P::Gain), "gain of tendon {tendon}"),
        kind(["axial_stiffness", "axial_stiffness[0]"], "N/m", Positive, Each::Tendon(P::AxialStiffness),
            "axial stiffness of tendon {tendon}"),
        kind(["friction", "friction[0]"], "", NotNegative, Each::Tendon(P::Friction), "friction of tendon {tendon}"),
        // A backbone may be limp, a hinge loose and a disc weightless.
        kind(["bending", "bending[0].x"], "N m/rad", NotNegative, Each::ModuleAxis(P::Bending),
            "bending stiffness of module {module} about {axis}"),
        kind(["torsion", "torsion[0]"], "N m/rad", NotNegative, Each::Module(P::Torsion), "torsion stiffness of module {module}"),
        kind(["hinge_stiffness", "hinge_stiffness[0][1]"], "N m/rad", NotNegative, Each::Hinge(P::HingeStiffness),
            "stiffness of hinge {hinge} of module {module}"),
        kind(["youngs", "youngs[0]"], "Pa", Positive, Each::Module(P::Youngs), "Young's modulus of the rod of module {module}"),
        kind(["density", "density[1]"], "kg/m\u{b3}", NotNegative, Each::Module(P::Density), "density of module {module}"),
        kind(["pitch", "pitch[1]"], "m", Positive, Each::Module(P::Pitch), "pitch of module {module}"),
        kind(["damping", "damping[0]"], "N m s/rad", NotNegative, Each::Module(P::Damping), "joint damping of module {module}"),
        kind(["armature", "armature[0]"], "kg m\u{b2}", NotNegative, Each::Module(P::Armature), "joint armature of module {module}"),
        kind(["hole_radius", "hole_radius[base] or hole_radius[3]"], "m", Positive, Each::Body(P::HoleRadius),
            "hole radius of {body}"),
        kind(["hole", "hole[base][2].x or hole[3][0].y"], "m", Any, Each::Hole(P::Hole), "{axis} of hole {hole} of {body}"),
    ]
};

impl ParameterKind {
    /// All kinds.
    pub fn all() -> &'static [Self] {
        &KINDS
    }

    /// The kind whose keys begin with a name.
    pub fn named(name: &str) -> Option<&'static Self> {
        KINDS.iter().find(|kind| kind.quantity.name == name)
    }

    /// Whether it is one number of each tendon, module or body of the robot, which all can have in common.
    pub fn is_shared(&self) -> bool {
        let each = matches!(self.each, Each::Tendon(_) | Each::Module(_) | Each::Body(_));
        each && self.is_of_robot()
    }

    /// Whether it is of a robot, not of its command or its loads.
    pub fn is_of_robot(&self) -> bool {
        !matches!(
            self.any(),
            Parameter::Command(_)
                | Parameter::Payload
                | Parameter::Force(..)
                | Parameter::Moment(..)
        )
    }

    /// Its parameters by what a robot consists of, those of the holes of a module by its lowest disc: whether the robot has each is
    /// for [`RobotSpec::value`] to say.
    pub fn parameters(&self, spec: &RobotSpec) -> Vec<Parameter> {
        let (tendons, modules) = (0..spec.tendon_count(), 0..spec.modules.len());
        let plane = [Axis::X, Axis::Y];
        let bodies = || {
            let lowest = modules.clone().map(|m| Body::Disc(spec.discs_of(m).start));
            std::iter::once(Body::Base).chain(lowest)
        };
        match self.each {
            Each::Once(parameter) => vec![parameter],
            Each::Tendon(of) => tendons.map(of).collect(),
            Each::DiscAxis(of) => (0..spec.disc_count())
                .flat_map(|disc| Axis::ALL.map(|axis| of(disc, axis)))
                .collect(),
            Each::Module(of) => modules.map(of).collect(),
            Each::ModuleAxis(of) => modules
                .flat_map(|m| plane.map(|axis| of(m, axis)))
                .collect(),
            Each::Hinge(of) => modules
                .flat_map(|m| [0, 1, 2].map(|hinge| of(m, hinge)))
                .collect(),
            Each::Body(of) => bodies().map(of).collect(),
            Each::Hole(of) => bodies()
                .flat_map(|body| {
                    let holes = 0..spec.holes(body).map_or(0, |holes| holes.count());
                    holes.flat_map(move |hole| plane.map(|axis| of(body, hole, axis)))
                })
                .collect(),
        }
    }

    /// Any parameter of the kind.
    fn any(&self) -> Parameter {
        match self.each {
            Each::Once(parameter) => parameter,
            Each::Tendon(of) | Each::Module(of) => of(0),
            Each::DiscAxis(of) | Each::ModuleAxis(of) => of(0, Axis::X),
            Each::Hinge(of) => of(0, 0),
            Each::Body(of) => of(Body::Base),
            Each::Hole(of) => of(Body::Base, 0, Axis::X),
        }
    }
}

/// Kinds are told apart by their names.
impl PartialEq for ParameterKind {
    fn eq(&self, other: &Self) -> bool {
        self.quantity.name == other.quantity.name
    }
}

impl Eq for ParameterKind {}

impl Parameter {
    /// What is known of all parameters of its kind.
    pub fn kind(self) -> &'static ParameterKind {
        let own = |kind: &&ParameterKind| discriminant(&kind.any()) == discriminant(&self);
        KINDS.iter().find(own).expect("every kind is in the table")
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        self.kind().quantity.unit
    }

    /// Which one of its kind it is.
    pub(super) fn which(self) -> Which {
        match self {
            Self::Payload => Which::Once,
            Self::Command(t) | Self::Gain(t) | Self::AxialStiffness(t) | Self::Friction(t) => {
                Which::Tendon(t)
            }
            Self::Force(disc, axis) | Self::Moment(disc, axis) => Which::DiscAxis(disc, axis),
            Self::Bending(m, axis) => Which::ModuleAxis(m, axis),
            Self::HingeStiffness(m, hinge) => Which::Hinge(m, hinge),
            Self::Torsion(m)
            | Self::Density(m)
            | Self::Youngs(m)
            | Self::Pitch(m)
            | Self::Damping(m)
            | Self::Armature(m) => Which::Module(m),
            Self::HoleRadius(body) => Which::Body(body),
            Self::Hole(body, hole, axis) => Which::Hole(body, hole, axis),
        }
    }
}
