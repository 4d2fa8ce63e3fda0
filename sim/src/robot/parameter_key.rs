//! Parameters as text: by key, as files, command lines and other languages say them, and in words.
//!
//! | key | parameter |
//! |---|---|
//! | `command[T]` | the command of tendon `T` |
//! | `payload` | the mass of the tip payload |
//! | `force[D].x`, `moment[D].x` | a force or moment on disc `D`, along a world axis (`x`, `y` or `z`) |
//! | `gain[T]`, `axial_stiffness[T]`, `friction[T]` | of tendon `T` |
//! | `bending[M].x`, `torsion[M]` | stiffness of the joints of module `M` (bending: `x` or `y`) |
//! | `hinge_stiffness[M][H]` | stiffness of hinge `H` of the joints of module `M` |
//! | `density[M]`, `youngs[M]`, `pitch[M]`, `damping[M]`, `armature[M]` | of module `M` |
//! | `hole_radius[B]`, `hole[B][H].x` | the holes, or hole `H`, of body `B`: `base`, or a disc for its module |
//!
//! Numbers count from 0 and are written without leading zeros, so that every parameter has one key.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

use super::parameter_kind::{Each, Which};
use super::{Axis, Body, Parameter, ParameterKind};

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
        let name = self.kind().quantity.name;
        match self.which() {
            Which::Once => name.to_owned(),
            Which::Tendon(number) | Which::Module(number) => format!("{name}[{number}]"),
            Which::DiscAxis(number, axis) | Which::ModuleAxis(number, axis) => {
                format!("{name}[{number}].{axis}")
            }
            Which::Hinge(module, hinge) => format!("{name}[{module}][{hinge}]"),
            Which::Body(at) => format!("{name}[{}]", body(at)),
            Which::Hole(at, hole, axis) => format!("{name}[{}][{hole}].{axis}", body(at)),
        }
    }
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let body = |body: Body| match body {
            Body::Base => "the base".to_owned(),
            Body::Disc(disc) => format!("the module of disc {disc}"),
        };
        let fill = |text: &str, what: &str, with: String| text.replace(what, &with);
        let number = |what: &str, number: usize| fill(self.kind().title, what, number.to_string());
        let title = match self.which() {
            Which::Once => self.kind().title.to_owned(),
            Which::Tendon(tendon) => number("{tendon}", tendon),
            Which::DiscAxis(disc, axis) => {
                fill(&number("{disc}", disc), "{axis}", axis.to_string())
            }
            Which::Module(module) => number("{module}", module),
            Which::ModuleAxis(module, axis) => {
                fill(&number("{module}", module), "{axis}", axis.to_string())
            }
            Which::Hinge(module, hinge) => {
                fill(&number("{module}", module), "{hinge}", hinge.to_string())
            }
            Which::Body(at) => fill(self.kind().title, "{body}", body(at)),
            Which::Hole(at, hole, axis) => {
                let title = fill(&number("{hole}", hole), "{axis}", axis.to_string());
                fill(&title, "{body}", body(at))
            }
        };
        f.write_str(&title)
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
        let Some(kind) = ParameterKind::named(name) else {
            let all = ParameterKind::all().iter().map(|kind| kind.example);
            let all = all.collect::<Vec<_>>().join(", ");
            return Err(refuse(
                format!("there is no parameter {name:?}"),
                format!("a key like one of {all}"),
            ));
        };
        let mut rest = Rest(rest);
        let parameter = rest
            .parameter(kind)
            .and_then(|parameter| rest.end().map(|()| parameter));
        parameter.map_err(|reason| refuse(reason, format!("a key like {}", kind.example)))
    }
}

/// What follows a parameter's name.
struct Rest<'a>(&'a str);

impl<'a> Rest<'a> {
    fn parameter(&mut self, kind: &ParameterKind) -> Result<Parameter, String> {
        Ok(match kind.each {
            Each::Once(parameter) => parameter,
            Each::Tendon(of) => of(self.number("tendon")?),
            Each::DiscAxis(of) => of(self.number("disc")?, self.axis()?),
            Each::Module(of) => of(self.number("module")?),
            Each::ModuleAxis(of) => of(self.number("module")?, self.axis()?),
            Each::Hinge(of) => of(self.number("module")?, self.number("hinge")?),
            Each::Body(of) => of(self.body()?),
            Each::Hole(of) => of(self.body()?, self.number("hole")?, self.axis()?),
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
