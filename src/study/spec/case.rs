//! From values of variables to a robot, its command and its loads.

use serde_json::Value;
use tdcr_sim::robot::{Backbone, Command, Frame, Loads, PerDisc, Robot, RobotSpec, Wrench};

use tdcr_sim::scene::Scene;

use super::Study;
use super::variable::{Place, Setting, Target, Variable};

/// Most modules of a study: as many discs as a robot may have.
const MOST: usize = 1000;

/// The robot of some settings, those that are not of the robot left aside.
///
/// # Errors
/// What is wrong, as text.
pub(in crate::study) fn robot(study: &Study, settings: &[Setting]) -> Result<Robot, String> {
    let mut spec = match &study.models {
        Some(models) => models.of(settings)?.subject.robot.clone(),
        None => study.robot.clone(),
    };
    let mut of_robot: Vec<&Setting> = settings.iter().filter(|s| s.0.is_of_robot()).collect();
    of_robot.sort_by_key(|setting| setting.0.rank());
    for (variable, value) in of_robot {
        spec = change(study, spec, variable, value)
            .map_err(|reason| format!("{variable}: {reason}"))?;
    }
    Robot::new(spec).map_err(|error| error.to_string())
}

/// What is around the robot of some settings: obstacles of the study, or those that a model was trained among.
///
/// # Errors
/// That there is no such scene, as text.
pub(in crate::study) fn scene(study: &Study, settings: &[Setting]) -> Result<Scene, String> {
    if let Some(models) = &study.models {
        return Ok(models.of(settings)?.subject.scene.clone());
    }
    let named = settings
        .iter()
        .rev()
        .find(|setting| setting.0.target == Target::Scene);
    let Some((_, value)) = named else {
        return Ok(study.scene.clone());
    };
    let name = value.as_str().unwrap_or_default();
    let found = study.scenes.get(name);
    found
        .cloned()
        .ok_or_else(|| format!("there is no scene `{name}`"))
}

fn change(
    study: &Study,
    mut spec: RobotSpec,
    variable: &Variable,
    value: &Value,
) -> Result<RobotSpec, String> {
    match &variable.target {
        Target::Robot => {
            let name = value.as_str().unwrap_or_default();
            let found = study.robots.get(name);
            return found
                .cloned()
                .ok_or_else(|| format!("there is no robot `{name}`"));
        }
        Target::Modules => set_modules(&mut spec, whole(value, MOST)?),
        Target::Discs => set_discs(&mut spec, whole(value, MOST)?),
        Target::Stiffness => {
            let backbone = Backbone::isotropic(number(value)?);
            for module in &mut spec.modules {
                module.backbone = Some(PerDisc::Uniform(backbone));
            }
        }
        Target::Friction => {
            let coefficient = number(value)?;
            (spec.tendon_specs_mut()).for_each(|tendon| tendon.set_friction(coefficient));
        }
        Target::Field(field) => spec = field.set(&spec, value)?,
        Target::Every(kind) => {
            let value = number(value)?;
            let all: Vec<_> = kind
                .parameters(&spec)
                .into_iter()
                .map(|p| (p, value))
                .collect();
            spec = spec.with(&all).map_err(|error| error.to_string())?;
        }
        Target::Parameter(parameter) => {
            let all = [(*parameter, number(value)?)];
            spec = spec.with(&all).map_err(|error| error.to_string())?;
        }
        Target::Model
        | Target::Scene
        | Target::Seed
        | Target::Command
        | Target::Tendon(_)
        | Target::Payload
        | Target::Force(..)
        | Target::Moment(..) => {}
    }
    Ok(spec)
}

/// The lowest modules of the robot, or all of them and copies of the highest.
fn set_modules(spec: &mut RobotSpec, count: usize) {
    spec.modules.truncate(count);
    if let Some(last) = spec.modules.last().cloned() {
        spec.modules.resize(count, last);
    }
    spec.name = format!("{} with {count} modules", spec.name);
}

/// Other numbers of discs at the same lengths and masses of modules.
fn set_discs(spec: &mut RobotSpec, count: usize) {
    for module in &mut spec.modules {
        let share = module.discs as f64 / count as f64;
        module.discs = count;
        for length in [
            &mut module.first_offset,
            &mut module.pitch,
            &mut module.half_height,
            &mut module.joint_below,
        ] {
            *length *= share;
        }
    }
}

/// The command of some settings: where there is none, every tendon's is in the middle of its range.
///
/// `point` is a place in the box of the tendons' ranges, each number from 0 to 1, of a command that is sampled.
///
/// # Errors
/// What is wrong, as text.
pub(in crate::study) fn command(
    robot: &Robot,
    settings: &[Setting],
    point: Option<&[f64]>,
) -> Result<Command, String> {
    let mut values = robot.mean_command().as_slice().to_vec();
    if let Some(point) = point {
        for ((value, tendon), share) in values.iter_mut().zip(robot.tendons()).zip(point) {
            let [low, high] = tendon.range;
            *value = low + (high - low) * share;
        }
    }
    let mut of_command: Vec<&Setting> = settings.iter().collect();
    of_command.sort_by_key(|setting| setting.0.rank());
    for (variable, value) in of_command {
        match variable.target {
            Target::Command => match value {
                Value::Array(list) => {
                    values = list.iter().map(number).collect::<Result<_, _>>()?;
                }
                one => values.fill(number(one)?),
            },
            Target::Tendon(tendon) => {
                let count = values.len();
                let entry = values.get_mut(tendon);
                *entry.ok_or_else(|| format!("{variable}: the robot has {count} tendons"))? =
                    number(value)?;
            }
            _ => {}
        }
    }
    robot.command(&values).map_err(|error| error.to_string())
}

/// The loads of some settings.
///
/// # Errors
/// What is wrong, as text.
pub(in crate::study) fn loads(robot: &Robot, settings: &[Setting]) -> Result<Loads, String> {
    let mut payload = 0.0;
    let mut wrenches: Vec<Wrench> = Vec::new();
    let mut on = |place: Place, change: &dyn Fn(&mut Wrench)| {
        let disc = match place {
            Place::Tip => robot.discs().len() - 1,
            Place::Disc(disc) => disc,
        };
        let found = wrenches.iter().position(|wrench| wrench.disc == disc);
        let index = found.unwrap_or_else(|| {
            wrenches.push(Wrench::none(disc, Frame::World));
            wrenches.len() - 1
        });
        change(&mut wrenches[index]);
    };
    for (variable, value) in settings {
        match variable.target {
            Target::Payload => payload = number(value)?,
            Target::Force(place, axis) => {
                let force = number(value)?;
                on(place, &|wrench| wrench.force[axis.index()] = force);
            }
            Target::Moment(place, axis) => {
                let moment = number(value)?;
                on(place, &|wrench| wrench.moment[axis.index()] = moment);
            }
            _ => {}
        }
    }
    let mut loads = Loads::payload(payload).map_err(|error| error.to_string())?;
    for wrench in wrenches
        .into_iter()
        .filter(|w| w.force != [0.0; 3] || w.moment != [0.0; 3])
    {
        loads = loads
            .with_wrench(wrench)
            .map_err(|error| error.to_string())?;
    }
    loads.check(robot).map_err(|error| error.to_string())?;
    Ok(loads)
}

/// The number in a value.
///
/// # Errors
/// That it is none, as text.
pub(in crate::study) fn number(value: &Value) -> Result<f64, String> {
    (value.as_f64()).ok_or_else(|| format!("{value} is not a number"))
}

/// A whole number from 1 to `most`.
fn whole(value: &Value, most: usize) -> Result<usize, String> {
    let found = value
        .as_f64()
        .filter(|x| x.fract() == 0.0 && (1.0..=most as f64).contains(x));
    found
        .map(|x| x as usize)
        .ok_or_else(|| format!("{value} is not a whole number, 1 to {most}"))
}
