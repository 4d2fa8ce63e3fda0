//! Variables that set the same numbers of a robot, its command or its loads.

use tdcr_sim::robot::{Axis, Body, Parameter, RobotSpec};

use super::Study;
use super::field::Field;
use super::variable::{Place, Setting, Target, Variable};

/// Refuses two variables of one configuration that set the same numbers, but for a value in `[set]` with an exception to it: one for
/// all tendons, say, beside that of one of them. A variable that is varied sets all that its name says.
///
/// # Errors
/// Which two, as text.
pub(in crate::study) fn check(
    study: &Study,
    spec: &RobotSpec,
    settings: &[Setting],
) -> Result<(), String> {
    let mut seen: Vec<(&Variable, Numbers)> = Vec::new();
    let is_set = |what: &Variable| study.set.iter().any(|(name, _)| name == what);
    // A sampled command is no setting.
    let commands = study
        .sampled
        .iter()
        .filter(|sampled| sampled.range.is_none());
    let mut ranked: Vec<&Variable> = (settings.iter().map(|(what, _)| *what))
        .chain(commands.map(|sampled| &sampled.what))
        .collect();
    ranked.sort_by_key(|what| what.rank());
    for what in ranked {
        let numbers = Numbers::of(&what.target, spec);
        let clash = seen.iter().find(|(other, own)| {
            let exception = is_set(other) && other.rank() < what.rank();
            !exception && own.overlap(&numbers, spec)
        });
        if let Some((other, _)) = clash {
            return Err(format!(
                "the variables `{other}` and `{what}` set the same numbers of robot `{}`; expected one of them",
                spec.name
            ));
        }
        seen.push((what, numbers));
    }
    Ok(())
}

/// What a variable sets: parameters, and where they are in a robot's file; or fields of it alone.
struct Numbers {
    parameters: Vec<Parameter>,
    fields: Vec<Field>,
}

impl Numbers {
    fn of(target: &Target, spec: &RobotSpec) -> Self {
        let disc = |place: &Place| match place {
            Place::Tip => spec.disc_count().saturating_sub(1),
            Place::Disc(disc) => *disc,
        };
        let parameters = match target {
            Target::Every(kind) => kind.parameters(spec),
            Target::Parameter(parameter) => vec![*parameter],
            Target::Command => (0..spec.tendon_count()).map(Parameter::Command).collect(),
            Target::Tendon(tendon) => vec![Parameter::Command(*tendon)],
            Target::Payload => vec![Parameter::Payload],
            Target::Force(place, axis) => vec![Parameter::Force(disc(place), *axis)],
            Target::Moment(place, axis) => vec![Parameter::Moment(disc(place), *axis)],
            Target::Model
            | Target::Robot
            | Target::Scene
            | Target::Modules
            | Target::Discs
            | Target::Stiffness
            | Target::Friction
            | Target::Field(_)
            | Target::Seed => Vec::new(),
        };
        let paths: Vec<String> = match target {
            Target::Stiffness => vec!["modules[*].backbone".to_owned()],
            Target::Friction => ["modules[*].tendons.friction", "routes[*].tendon.friction"]
                .map(str::to_owned)
                .to_vec(),
            _ => parameters.iter().filter_map(|p| path(*p, spec)).collect(),
        };
        let fields = match target {
            Target::Field(field) => vec![field.clone()],
            _ => paths.iter().filter_map(|path| Field::parse(path)).collect(),
        };
        Self { parameters, fields }
    }

    fn overlap(&self, other: &Self, spec: &RobotSpec) -> bool {
        if self.parameters.is_empty() || other.parameters.is_empty() {
            let mut fields = self.fields.iter();
            return fields.any(|field| other.fields.iter().any(|own| field.overlaps(own)));
        }
        let has = |parameter: &&Parameter| spec.acts_on(**parameter).is_ok();
        let mut own = self.parameters.iter().filter(has);
        own.any(|a| {
            let mut others = other.parameters.iter().filter(has);
            others.any(|b| spec.parameters_overlap(*a, *b))
        })
    }
}

/// Where a parameter is in a robot's file; `None` for those of commands and loads.
fn path(parameter: Parameter, spec: &RobotSpec) -> Option<String> {
    let holes = |body: Body| match body {
        Body::Base => Some("base.holes".to_owned()),
        Body::Disc(disc) => Some(format!("modules[{}].holes", spec.module_of(disc)?)),
    };
    Some(match parameter {
        Parameter::Gain(t) => format!("{}.drive", tendon(t, spec)?),
        Parameter::AxialStiffness(t) => format!("{}.axial_stiffness", tendon(t, spec)?),
        Parameter::Friction(t) => format!("{}.friction.coefficient", tendon(t, spec)?),
        Parameter::Bending(m, Axis::X) => format!("modules[{m}].backbone.bending[0]"),
        Parameter::Bending(m, _) => format!("modules[{m}].backbone.bending[1]"),
        Parameter::Torsion(m) => format!("modules[{m}].backbone.torsion"),
        Parameter::HingeStiffness(m, hinge) => {
            format!("modules[{m}].joint.hinges[{hinge}].stiffness")
        }
        Parameter::Density(m) => format!("modules[{m}].mass"),
        Parameter::Youngs(m) => format!("modules[{m}].rod.youngs"),
        Parameter::HoleRadius(body) | Parameter::Hole(body, ..) => holes(body)?,
        Parameter::Pitch(m) => format!("modules[{m}].pitch"),
        Parameter::Damping(m) => format!("modules[{m}].damping"),
        Parameter::Armature(m) => format!("modules[{m}].armature"),
        _ => return None,
    })
}

/// Where a tendon is in a robot's file: those of modules come first.
fn tendon(tendon: usize, spec: &RobotSpec) -> Option<String> {
    let mut first = 0;
    for (m, module) in spec.modules.iter().enumerate() {
        first += module.tendons.as_ref().map_or(0, |_| module.holes.count());
        if tendon < first {
            return Some(format!("modules[{m}].tendons"));
        }
    }
    let route = tendon - first;
    (route < spec.routes.len()).then(|| format!("routes[{route}].tendon"))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::path::Path;

    use super::super::Study;

    fn refused(file: &str) -> Option<String> {
        let file = format!("want = [\"tip\"]\n{file}");
        let read = Study::parse(&file, Path::new(""), Path::new("study.toml"));
        read.err().map(|error| error.to_string())
    }

    fn varied(names: &[&str]) -> String {
        let vary = |name: &&str| format!("[[vary]]\nwhat = \"{name}\"\nvalues = [0.0125, 0.013]\n");
        names.iter().map(vary).collect()
    }

    #[test]
    fn variables_that_set_the_same_numbers_are_refused_by_name() {
        for [a, b] in [
            ["hole_radius[0]", "hole_radius[3]"],
            ["hole_radius", "hole_radius[5]"],
            ["hole_radius[base]", "hole[base][1].x"],
            ["hole[1][0].x", "hole[2][0].x"],
            ["modules[*].pitch", "pitch[1]"],
            ["modules[0].pitch", "modules[*].pitch"],
            ["command", "command[2]"],
            ["force[tip].x", "force[9].x"],
        ] {
            let why = refused(&varied(&[a, b])).unwrap();
            assert!(
                why.contains(&format!("`{a}`")) && why.contains(&format!("`{b}`")),
                "{why}"
            );
            assert!(why.contains("set the same numbers"), "{why}");
        }
        // Whatever else differs.
        for [a, b] in [
            ["hole_radius[0]", "hole_radius[5]"],
            ["hole[1][0].x", "hole[2][0].y"],
            ["pitch[0]", "pitch[1]"],
            ["command[1]", "command[2]"],
            ["force[tip].x", "force[9].y"],
        ] {
            assert_eq!(refused(&varied(&[a, b])), None, "{a}, {b}");
        }
    }

    #[test]
    fn a_value_for_all_may_have_an_exception_that_is_varied() {
        let set = |name: &str| format!("[set]\n\"{name}\" = 0.012\n");
        assert_eq!(refused(&(set("pitch") + &varied(&["pitch[1]"]))), None);
        assert!(refused(&(set("pitch[1]") + &varied(&["pitch"]))).is_some());
    }
}
