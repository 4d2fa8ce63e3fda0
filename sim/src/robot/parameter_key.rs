//! Parameters by name, as text: what files, command lines and other languages say.
//!
//! | key | parameter |
//! |---|---|
//! | `command[T]` | the command of tendon `T` |
//! | `payload` | the mass of the tip payload |
//! | `force[D].x`, `moment[D].x` | a force or moment on disc `D`, along a world axis (`x`, `y` or `z`) |
//! | `gain[T]`, `axial_stiffness[T]` | of tendon `T` |
//! | `bending[M].x`, `torsion[M]` | stiffness of the joints of module `M` (bending: `x` or `y`) |
//! | `hinge_stiffness[M][H]` | stiffness of hinge `H` of the joints of module `M` |
//! | `density[M]`, `youngs[M]`, `pitch[M]`, `damping[M]`, `armature[M]` | of module `M` |
//! | `hole_radius[B]`, `hole[B][H].x` | the holes, or hole `H`, of body `B`: `base`, or a disc for its module |
//!
//! Numbers count from 0 and are written without leading zeros, so that every parameter has one key.

use std::str::FromStr;

use thiserror::Error;

use super::{Axis, Body, Parameter};

/// Why a text is not the key of a parameter.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{key:?} is not the key of a parameter: {reason}; expected {expected}")]
pub struct ParameterKeyError {
    /// The text.
    pub key: String,
    /// What is wrong with it.
    pub reason: String,
    /// What would be right.
    pub expected: String,
}

/// The names of parameters and what follows each, an example.
const FORMS: [(&str, &str); 16] = [
    ("command", "command[0]"),
    ("payload", "payload"),
    ("force", "force[9].x"),
    ("moment", "moment[9].z"),
    ("gain", "gain[2]"),
    ("axial_stiffness", "axial_stiffness[0]"),
    ("bending", "bending[0].x"),
    ("torsion", "torsion[0]"),
    ("hinge_stiffness", "hinge_stiffness[0][1]"),
    ("density", "density[1]"),
    ("youngs", "youngs[0]"),
    ("hole_radius", "hole_radius[base] or hole_radius[3]"),
    ("hole", "hole[base][2].x or hole[3][0].y"),
    ("pitch", "pitch[1]"),
    ("damping", "damping[0]"),
    ("armature", "armature[0]"),
];

impl Parameter {
    /// Its name as text, which [`Parameter::from_str`] reads.
    ///
    /// ```
    /// use tdcr_sim::robot::{Axis, Body, Parameter};
    ///
    /// assert_eq!(Parameter::Force(9, Axis::X).key(), "force[9].x");
    /// assert_eq!("hole_radius[base]".parse(), Ok(Parameter::HoleRadius(Body::Base)));
    /// let error = "gain".parse::<Parameter>().unwrap_err();
    /// assert!(error.to_string().ends_with("expected a key like gain[2]"));
    /// ```
    pub fn key(self) -> String {
        let body = |body: Body| match body {
            Body::Base => "base".to_owned(),
            Body::Disc(disc) => disc.to_string(),
        };
        match self {
            Self::Command(tendon) => format!("command[{tendon}]"),
            Self::Payload => "payload".to_owned(),
            Self::Force(disc, axis) => format!("force[{disc}].{axis}"),
            Self::Moment(disc, axis) => format!("moment[{disc}].{axis}"),
            Self::Gain(tendon) => format!("gain[{tendon}]"),
            Self::AxialStiffness(tendon) => format!("axial_stiffness[{tendon}]"),
            Self::Bending(module, axis) => format!("bending[{module}].{axis}"),
            Self::Torsion(module) => format!("torsion[{module}]"),
            Self::HingeStiffness(module, hinge) => format!("hinge_stiffness[{module}][{hinge}]"),
            Self::Density(module) => format!("density[{module}]"),
            Self::Youngs(module) => format!("youngs[{module}]"),
            Self::HoleRadius(at) => format!("hole_radius[{}]", body(at)),
            Self::Hole(at, hole, axis) => format!("hole[{}][{hole}].{axis}", body(at)),
            Self::Pitch(module) => format!("pitch[{module}]"),
            Self::Damping(module) => format!("damping[{module}]"),
            Self::Armature(module) => format!("armature[{module}]"),
        }
    }
}

impl FromStr for Parameter {
    type Err = ParameterKeyError;

    /// The parameter of a key: whether a robot has it shows where it is used.
    fn from_str(key: &str) -> Result<Self, ParameterKeyError> {
        let end = key.find(['[', '.']).unwrap_or(key.len());
        let (name, rest) = key.split_at(end);
        let refuse = |reason: String, expected: String| ParameterKeyError {
            key: key.to_owned(),
            reason,
            expected,
        };
        let Some((_, form)) = FORMS.iter().find(|form| form.0 == name) else {
            let all = FORMS.map(|form| form.1).join(", ");
            return Err(refuse(
                format!("there is no parameter {name:?}"),
                format!("a key like one of {all}"),
            ));
        };
        let mut rest = Rest(rest);
        let parameter = rest
            .parameter(name)
            .and_then(|parameter| rest.end().map(|()| parameter));
        parameter.map_err(|reason| refuse(reason, format!("a key like {form}")))
    }
}

/// What follows a parameter's name.
struct Rest<'a>(&'a str);

impl<'a> Rest<'a> {
    fn parameter(&mut self, name: &str) -> Result<Parameter, String> {
        Ok(match name {
            "command" => Parameter::Command(self.number("tendon")?),
            "force" => Parameter::Force(self.number("disc")?, self.axis()?),
            "moment" => Parameter::Moment(self.number("disc")?, self.axis()?),
            "gain" => Parameter::Gain(self.number("tendon")?),
            "axial_stiffness" => Parameter::AxialStiffness(self.number("tendon")?),
            "bending" => Parameter::Bending(self.number("module")?, self.axis()?),
            "torsion" => Parameter::Torsion(self.number("module")?),
            "hinge_stiffness" => {
                Parameter::HingeStiffness(self.number("module")?, self.number("hinge")?)
            }
            "density" => Parameter::Density(self.number("module")?),
            "youngs" => Parameter::Youngs(self.number("module")?),
            "hole_radius" => Parameter::HoleRadius(self.body()?),
            "hole" => Parameter::Hole(self.body()?, self.number("hole")?, self.axis()?),
            "pitch" => Parameter::Pitch(self.number("module")?),
            "damping" => Parameter::Damping(self.number("module")?),
            "armature" => Parameter::Armature(self.number("module")?),
            _ => Parameter::Payload,
        })
    }

    /// The number of a `what`, in brackets.
    fn number(&mut self, what: &str) -> Result<usize, String> {
        let text = self.bracketed(what)?;
        number(text).ok_or_else(|| format!("{text:?} is not the number of a {what}"))
    }

    fn body(&mut self) -> Result<Body, String> {
        match self.bracketed("body")? {
            "base" => Ok(Body::Base),
            text => (number(text).map(Body::Disc))
                .ok_or_else(|| format!("{text:?} is not the number of a disc, nor base")),
        }
    }

    fn bracketed(&mut self, what: &str) -> Result<&'a str, String> {
        let inside = self
            .0
            .strip_prefix('[')
            .and_then(|rest| rest.split_once(']'));
        let (inside, rest) =
            inside.ok_or_else(|| format!("the {what} in brackets is missing at {:?}", self.0))?;
        self.0 = rest;
        Ok(inside)
    }

    fn axis(&mut self) -> Result<Axis, String> {
        let text = std::mem::take(&mut self.0);
        (Axis::ALL.into_iter())
            .find(|axis| text.strip_prefix('.') == Some(&*axis.to_string()))
            .ok_or_else(|| format!("{text:?} is not an axis: .x, .y or .z"))
    }

    fn end(&self) -> Result<(), String> {
        match self.0 {
            "" => Ok(()),
            rest => Err(format!("{rest:?} is too much")),
        }
    }
}

/// A number as it is written: digits alone, without leading zeros.
fn number(text: &str) -> Option<usize> {
    let number: usize = text.parse().ok()?;
    (number.to_string() == text).then_some(number)
}
