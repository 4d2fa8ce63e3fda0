//! Parameters of a robot as numbers in its specification: their values, and robots with other ones.

use super::parameter::check;
use super::{
    Axis, Backbone, Body, Drive, Holes, MassSpec, Parameter, ParameterError, PerDisc, Robot,
    RobotSpec, RouteSpec, TendonSpec,
};

impl RobotSpec {
    /// Value of a parameter, in its unit. Where the discs of a module or the holes of a body differ,
    /// the mean over them.
    ///
    /// # Errors
    /// [`ParameterError`] for one that the robot does not have, and for commands and
    /// loads, which are none of the robot's.
    pub fn value(&self, parameter: Parameter) -> Result<f64, ParameterError> {
        check(self, parameter)?;
        let bending = |module: usize, stiffness: &dyn Fn(&Backbone) -> f64| {
            let backbone = self.modules[module].backbone.as_ref();
            mean(backbone.expect("checked: has a backbone"), stiffness)
        };
        let holes = |body| self.holes(body).expect("checked: a body").positions();
        Ok(match parameter {
            Parameter::Command(_)
            | Parameter::Payload
            | Parameter::Force(..)
            | Parameter::Moment(..) => {
                return Err(ParameterError::Missing {
                    robot: self.name.clone(),
                    parameter,
                    reason: "commands and loads are not part of a robot's specification",
                });
            }
            Parameter::Gain(t) => match self.tendons()[t].drive {
                Drive::Gain(gain) => gain,
                Drive::Length | Drive::Tension => unreachable!("checked: has a gain"),
            },
            Parameter::AxialStiffness(t) => {
                (self.tendons()[t].axial_stiffness).expect("checked: has an axial stiffness")
            }
            Parameter::Friction(t) => {
                let friction = self.tendons()[t].friction;
                friction.expect("checked: has friction").coefficient
            }
            Parameter::Bending(module, axis) => bending(module, &|b| b.bending[axis.index()]),
            Parameter::Torsion(module) => bending(module, &|b| b.torsion),
            Parameter::HingeStiffness(module, hinge) => {
                let joint = self.modules[module].joint.as_ref();
                let joint = joint.expect("checked: has hinges");
                mean(joint, &|joint| joint.hinges[hinge].stiffness)
            }
            Parameter::Density(module) => match &self.modules[module].mass {
                MassSpec::Density(density) => mean(density, &|density| *density),
                MassSpec::Solid(solid) => mean(solid, &|solid| solid.density),
                MassSpec::Rigid(_) => unreachable!("checked: has a density"),
            },
            Parameter::HoleRadius(body) => {
                let holes = holes(body);
                let sum: f64 = holes.iter().map(|[x, y]| x.hypot(*y)).sum();
                sum / holes.len() as f64
            }
            Parameter::Hole(body, hole, axis) => holes(body)[hole][axis.index()],
            Parameter::Pitch(module) => self.modules[module].pitch,
            Parameter::Damping(module) => mean(&self.modules[module].damping, &|damping| *damping),
            Parameter::Armature(module) => {
                mean(&self.modules[module].armature, &|armature| *armature)
            }
            Parameter::Youngs(module) => {
                self.modules[module].rod.expect("checked: has a rod").youngs
            }
        })
    }

    /// This robot with other values of some parameters. Where the discs of a
    /// module or the holes of a body differ, all are shifted alike, to the new mean. If tendons of
    /// one module come to differ, all tendons get routes of their own, in the same order.
    ///
    /// Values that no robot can have are refused by [`Robot::new`], not here.
    ///
    /// ```
    /// use tdcr_sim::robot::{Parameter, RobotSpec};
    ///
    /// let spec = RobotSpec::load("2m")?;
    /// let heavier = spec.with(&[(Parameter::Density(0), 30.0), (Parameter::Density(1), 28.0)])?;
    /// assert_eq!(heavier.value(Parameter::Density(1))?, 28.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`RobotSpec::value`]; [`ParameterError::Overlap`] for parameters of which one value would undo another.
    pub fn with(&self, values: &[(Parameter, f64)]) -> Result<Self, ParameterError> {
        let named: Vec<Parameter> = values.iter().map(|(parameter, _)| *parameter).collect();
        self.check_parameters(&named)?;
        let mut spec = self.clone();
        let mut tendons: Vec<TendonSpec> = self.tendons().into_iter().cloned().collect();
        for &(parameter, value) in values {
            let by = value - spec.value(parameter)?;
            match parameter {
                Parameter::Gain(t) => tendons[t].drive = Drive::Gain(value),
                Parameter::AxialStiffness(t) => tendons[t].axial_stiffness = Some(value),
                Parameter::Friction(t) => {
                    if let Some(friction) = &mut tendons[t].friction {
                        friction.coefficient = value;
                    }
                }
                _ => shift(&mut spec, parameter, by),
            }
        }
        set_tendons(&mut spec, tendons);
        Ok(spec)
    }
}

/// Changes a specification's parameter, of places, masses, joints or backbones, by `by`.
pub(crate) fn shift(spec: &mut RobotSpec, parameter: Parameter, by: f64) {
    let module_of = |body: Body| match body {
        Body::Base => None,
        Body::Disc(disc) => spec.module_of(disc),
    };
    match parameter {
        Parameter::Bending(module, axis) => {
            change_backbone(spec, module, |b| b.bending[axis.index()] += by);
        }
        Parameter::Torsion(module) => change_backbone(spec, module, |b| b.torsion += by),
        Parameter::HingeStiffness(module, hinge) => {
            if let Some(joint) = &mut spec.modules[module].joint {
                joint.change(|joint| joint.hinges[hinge].stiffness += by);
            }
        }
        Parameter::Density(module) => match &mut spec.modules[module].mass {
            MassSpec::Density(density) => change(density, |density| *density += by),
            MassSpec::Solid(solid) => change(solid, |solid| solid.density += by),
            MassSpec::Rigid(_) => {}
        },
        Parameter::Pitch(module) => spec.modules[module].pitch += by,
        Parameter::Damping(module) => change(&mut spec.modules[module].damping, |d| *d += by),
        Parameter::Armature(module) => change(&mut spec.modules[module].armature, |a| *a += by),
        Parameter::Youngs(module) => {
            if let Some(rod) = &mut spec.modules[module].rod {
                rod.youngs += by;
            }
        }
        Parameter::HoleRadius(body) => {
            let module = module_of(body);
            move_holes(spec, module, |_, [x, y]| {
                let radius = x.hypot(y);
                [x + by * x / radius, y + by * y / radius]
            });
        }
        Parameter::Hole(body, hole, axis) => {
            let module = module_of(body);
            move_holes(spec, module, |index, [x, y]| match axis {
                Axis::X if index == hole => [x + by, y],
                Axis::Y if index == hole => [x, y + by],
                _ => [x, y],
            });
        }
        Parameter::Command(_)
        | Parameter::Payload
        | Parameter::Force(..)
        | Parameter::Moment(..)
        | Parameter::Gain(_)
        | Parameter::AxialStiffness(_)
        | Parameter::Friction(_) => {
            unreachable!("not of places, masses, joints or backbones")
        }
    }
}

fn change<T>(values: &mut PerDisc<T>, change: impl Fn(&mut T)) {
    match values {
        PerDisc::Uniform(value) => change(value),
        PerDisc::Each(each) => each.iter_mut().for_each(change),
    }
}

fn change_backbone(spec: &mut RobotSpec, module: usize, by: impl Fn(&mut Backbone)) {
    if let Some(backbone) = &mut spec.modules[module].backbone {
        change(backbone, by);
    }
}

fn move_holes(
    spec: &mut RobotSpec,
    module: Option<usize>,
    place: impl Fn(usize, [f64; 2]) -> [f64; 2],
) {
    let holes = match module {
        None => &mut spec.base.holes,
        Some(module) => &mut spec.modules[module].holes,
    };
    let moved = (holes.positions().into_iter().enumerate()).map(|(i, hole)| place(i, hole));
    *holes = Holes::At(moved.collect());
}

fn mean<T>(values: &PerDisc<T>, number: &dyn Fn(&T) -> f64) -> f64 {
    match values {
        PerDisc::Uniform(value) => number(value),
        PerDisc::Each(each) => each.iter().map(number).sum::<f64>() / each.len() as f64,
    }
}

/// Gives a robot's tendons the specifications `tendons`, in a command's order.
fn set_tendons(spec: &mut RobotSpec, tendons: Vec<TendonSpec>) {
    if spec.tendons().into_iter().eq(&tendons) {
        return;
    }
    let mut rest = &tendons[..];
    let mut of_modules = Vec::new();
    for module in spec.modules.iter().filter(|m| m.tendons.is_some()) {
        let (own, others) = rest.split_at(module.holes.count());
        of_modules.push(own);
        rest = others;
    }
    let alike = |own: &[TendonSpec]| own.windows(2).all(|pair| pair[0] == pair[1]);
    if of_modules.iter().all(|own| alike(own)) {
        let modules = spec.modules.iter_mut().filter_map(|m| m.tendons.as_mut());
        for (tendon, own) in modules.zip(of_modules) {
            // A module without holes has no tendon, whatever it says of them.
            if let Some(first) = own.first() {
                tendon.clone_from(first);
            }
        }
        for (route, tendon) in spec.routes.iter_mut().zip(rest) {
            route.tendon.clone_from(tendon);
        }
        return;
    }
    let laid = Robot::lay_out(spec.clone());
    spec.routes = (laid.tendons().iter().zip(tendons))
        .map(|(laid, tendon)| RouteSpec {
            through: laid.route.clone(),
            tendon,
        })
        .collect();
    spec.modules.iter_mut().for_each(|m| m.tendons = None);
}
