//! All parameters of a robot: what each acts on, and which of them stand for the same numbers.

use std::collections::HashMap;
use std::fmt;
use std::ops::Range;

use super::parameter::check;
use super::parameter_kind::Which;
use super::{Body, Parameter, ParameterError, ParameterKind, RobotSpec};

/// What a parameter acts on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ActsOn {
    /// The base.
    Base,
    /// One tendon.
    Tendon(usize),
    /// One disc, from 0 at the base.
    Disc(usize),
    /// All discs of a module.
    Module {
        /// The module, from 0 at the base.
        module: usize,
        /// Its discs, from 0 at the base.
        discs: Range<usize>,
    },
}

impl fmt::Display for ActsOn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Base => f.write_str("base"),
            Self::Tendon(tendon) => write!(f, "tendon {tendon}"),
            Self::Disc(disc) => write!(f, "disc {disc}"),
            Self::Module { module, discs } if discs.len() == 1 => {
                write!(f, "module {module} (disc {})", discs.start)
            }
            Self::Module { module, discs } => {
                let last = discs.end.saturating_sub(1);
                write!(f, "module {module} (discs {} to {last})", discs.start)
            }
        }
    }
}

impl RobotSpec {
    /// The parameters that have a value in the specification ([`RobotSpec::value`]), each by one name: of holes, that of the
    /// lowest disc of their module. Some of them overlap: the radius of a body's holes, and the places of each.
    ///
    /// ```
    /// use tdcr_sim::robot::RobotSpec;
    ///
    /// let spec = RobotSpec::load("2m")?;
    /// let keys: Vec<String> = spec.parameters().iter().map(|p| p.key()).collect();
    /// let radii: Vec<_> = keys.iter().filter(|key| key.starts_with("hole_radius")).collect();
    /// // The second module begins with disc 5.
    /// assert_eq!(radii, ["hole_radius[base]", "hole_radius[0]", "hole_radius[5]"]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn parameters(&self) -> Vec<Parameter> {
        (ParameterKind::all()
            .iter()
            .filter(|kind| kind.is_of_robot()))
        .flat_map(|kind| kind.parameters(self))
        .filter(|&parameter| check(self, parameter).is_ok())
        .collect()
    }

    /// What a parameter acts on.
    ///
    /// # Errors
    /// [`ParameterError`] for one that the robot does not have.
    pub fn acts_on(&self, parameter: Parameter) -> Result<ActsOn, ParameterError> {
        check(self, parameter)?;
        let of_module = |module| ActsOn::Module {
            module,
            discs: self.discs_of(module),
        };
        Ok(match parameter.which() {
            Which::Once => ActsOn::Disc(self.disc_count() - 1),
            Which::Tendon(tendon) => ActsOn::Tendon(tendon),
            Which::DiscAxis(disc, _) => ActsOn::Disc(disc),
            Which::Module(module) | Which::ModuleAxis(module, _) | Which::Hinge(module, _) => {
                of_module(module)
            }
            Which::Body(body) | Which::Hole(body, ..) => {
                self.module_at(body).map_or(ActsOn::Base, of_module)
            }
        })
    }

    /// Checks parameters that are to be changed, or differentiated by, together: the robot has each, and no two stand for the
    /// same numbers.
    ///
    /// ```
    /// use tdcr_sim::robot::{Body, Parameter, RobotSpec};
    ///
    /// let spec = RobotSpec::load("2m")?;
    /// // Discs 0 and 3 are of one module, whose holes are alike.
    /// let holes = [0, 3].map(|disc| Parameter::HoleRadius(Body::Disc(disc)));
    /// let refused = spec.check_parameters(&holes).unwrap_err().to_string();
    /// assert!(refused.contains("`hole_radius[0]` and `hole_radius[3]` of robot `2m` overlap"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`ParameterError`] for the first that does not fit.
    pub fn check_parameters(&self, parameters: &[Parameter]) -> Result<(), ParameterError> {
        // One name for all that stand for the same; and for the holes of a body, the first parameter of either kind.
        let mut named: HashMap<Parameter, Parameter> = HashMap::with_capacity(parameters.len());
        let mut radii: HashMap<Option<usize>, Parameter> = HashMap::new();
        let mut places: HashMap<Option<usize>, Parameter> = HashMap::new();
        for &parameter in parameters {
            check(self, parameter)?;
            let mut clash = named.insert(self.canonical(parameter), parameter);
            match parameter {
                Parameter::HoleRadius(body) => {
                    let module = self.module_at(body);
                    radii.entry(module).or_insert(parameter);
                    clash = clash.or(places.get(&module).copied());
                }
                Parameter::Hole(body, ..) => {
                    let module = self.module_at(body);
                    places.entry(module).or_insert(parameter);
                    clash = clash.or(radii.get(&module).copied());
                }
                _ => {}
            }
            if let Some(first) = clash {
                return Err(ParameterError::Overlap {
                    robot: self.name.clone(),
                    first,
                    second: parameter,
                    both: self.in_common(first, parameter),
                });
            }
        }
        Ok(())
    }

    /// Whether two parameters that the robot has stand for the same numbers.
    pub fn parameters_overlap(&self, a: Parameter, b: Parameter) -> bool {
        match (a, b) {
            (Parameter::HoleRadius(a), Parameter::Hole(b, ..))
            | (Parameter::Hole(a, ..), Parameter::HoleRadius(b)) => {
                self.module_at(a) == self.module_at(b)
            }
            _ => self.canonical(a) == self.canonical(b),
        }
    }

    /// What two parameters that overlap have in common.
    fn in_common(&self, first: Parameter, second: Parameter) -> String {
        match (first, second) {
            _ if first == second => "it is named twice".to_owned(),
            (Parameter::HoleRadius(body) | Parameter::Hole(body, ..), _) => {
                match self.module_at(body) {
                    None => "both move holes of the base".to_owned(),
                    Some(module) => format!(
                        "both move holes of all discs of module {module}, {} to {}",
                        self.discs_of(module).start,
                        self.discs_of(module).end - 1
                    ),
                }
            }
            _ => "both set the same number".to_owned(),
        }
    }

    /// The parameter itself, or of holes the one named by the lowest disc of their module.
    fn canonical(&self, parameter: Parameter) -> Parameter {
        let lowest = |body| match self.module_at(body) {
            None => body,
            Some(module) => Body::Disc(self.discs_of(module).start),
        };
        match parameter {
            Parameter::HoleRadius(body) => Parameter::HoleRadius(lowest(body)),
            Parameter::Hole(body, hole, axis) => Parameter::Hole(lowest(body), hole, axis),
            other => other,
        }
    }

    /// The discs of a module, from 0 at the base.
    pub(super) fn discs_of(&self, module: usize) -> Range<usize> {
        let start = self.modules[..module].iter().map(|m| m.discs).sum();
        start..start + self.modules[module].discs
    }
}
