//! Robots from files, text and other tools' formats.

use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr::base::files::without_mark;
use tdcr::sim::chain::Configuration;
use tdcr::sim::formats::mjcf::Integrator;
use tdcr::sim::formats::{mjcf, urdf, with_table};
use tdcr::sim::render::BaseVisibility;
use tdcr::sim::robot::{ActsOn, HingeRow, Parameter, Payload, RobotSpec};

use crate::arrays::array;
use crate::errors::{Failure, Outcome, choice};
use crate::scene::Scene;

/// A validated robot. Immutable, and cheap to hand around.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct Robot(pub tdcr::sim::robot::Robot);

impl Robot {
    /// A robot from what its file says.
    pub fn new(spec: RobotSpec) -> Outcome<Self> {
        Ok(Self(tdcr::sim::robot::Robot::new(spec)?))
    }
}

/// A parameter: name, value, unit, what it acts on in words, module, discs, tendons, names of those that overlap with it, bounds.
type Described = (
    String,
    f64,
    &'static str,
    String,
    Option<usize>,
    Vec<usize>,
    Vec<usize>,
    Vec<String>,
    (f64, f64),
);

/// What a model for MuJoCo shows and how it moves, as `tdcr export` asks for it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct MjcfOptions {
    base: bool,
    payload: f64,
    dt: Option<f64>,
    integrator: String,
    command: Option<Vec<f64>>,
    attach: Option<String>,
    joints: String,
}

#[pymethods]
impl Robot {
    /// A standard robot by name, or a robot file; with notes on what was passed over in a file of another tool.
    #[staticmethod]
    fn load(name_or_path: &str) -> Outcome<(Self, Vec<String>)> {
        let (spec, notes) = RobotSpec::load_with_notes(name_or_path)?;
        let notes = notes.iter().map(ToString::to_string).collect();
        Ok((Self::new(spec)?, notes))
    }

    /// A robot from the JSON text of a robot file.
    #[staticmethod]
    fn from_json(text: &str) -> Outcome<Self> {
        let spec: RobotSpec = serde_json::from_str(without_mark(text)).map_err(|error| {
            let message = with_table(&error.to_string());
            Failure::Of("RobotError", format!("not a robot: {message}"))
        })?;
        spec.validate()?;
        Self::new(spec)
    }

    /// The robot file as JSON text, from which the same robot is made.
    fn to_json(&self) -> Outcome<String> {
        serde_json::to_string(self.0.spec())
            .map_err(|error| Failure::Of("RobotError", error.to_string()))
    }

    /// The robot file as TOML text.
    fn to_toml(&self) -> Outcome<String> {
        (self.0.spec().to_toml()).map_err(|error| Failure::Of("RobotError", error.to_string()))
    }

    /// The robot, in a scene if one is given, as a model in MuJoCo's format; with notes on what this has otherwise.
    #[pyo3(signature = (options, scene=None))]
    fn to_mjcf(
        &self,
        options: MjcfOptions,
        scene: Option<PyRef<'_, Scene>>,
    ) -> Outcome<(String, Vec<String>)> {
        let integrators = [
            ("euler", Integrator::Euler),
            ("implicitfast", Integrator::ImplicitFast),
            ("implicit", Integrator::Implicit),
            ("rk4", Integrator::RungeKutta4),
        ];
        let payload = Payload {
            mass: options.payload,
            ..Payload::default()
        };
        let integrator = choice("integrator", &options.integrator, &integrators)?;
        let rows = [
            ("ball", None),
            ("hinges", Some(HingeRow::Three)),
            ("universal", Some(HingeRow::Universal)),
        ];
        let mut spec = self.0.spec().clone();
        let mut notes = Vec::new();
        if let Some(row) = choice("joints", &options.joints, &rows)? {
            notes = mjcf::hinge_notes(&spec, row)?;
            spec = spec.on_hinges(row)?;
        }
        if let Some(prefix) = options.attach {
            let part = mjcf::Part {
                prefix,
                payload,
                integrator,
            };
            return Ok((mjcf::export_part(&spec, &part)?, notes));
        }
        let options = mjcf::ExportOptions {
            base: match options.base {
                true => BaseVisibility::Shown,
                false => BaseVisibility::Hidden,
            },
            payload,
            timestep: options.dt,
            integrator,
            command: options.command,
            scene: scene.map(|scene| scene.0.clone()).unwrap_or_default(),
        };
        let text = mjcf::export(&spec, &options)?;
        notes.extend(mjcf::scene_notes(&options.scene));
        Ok((text, notes))
    }

    /// The robot as URDF.
    fn to_urdf(&self) -> Outcome<String> {
        Ok(urdf::export(self.0.spec())?)
    }

    /// Name.
    #[getter]
    fn name(&self) -> &str {
        &self.0.spec().name
    }

    /// Number of discs.
    #[getter]
    fn discs(&self) -> usize {
        self.0.discs().len()
    }

    /// Number of tendons.
    #[getter]
    fn tendons(&self) -> usize {
        self.0.tendons().len()
    }

    /// Unit of each tendon's command.
    #[getter]
    fn units(&self) -> Vec<String> {
        self.0
            .tendons()
            .iter()
            .map(|tendon| tendon.unit().to_string())
            .collect()
    }

    /// Smallest and largest command of each tendon, shape (tendons, 2).
    fn ranges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let ranges = self
            .0
            .tendons()
            .iter()
            .flat_map(|tendon| tendon.range)
            .collect();
        array(py, ranges, [self.0.tendons().len(), 2])
    }

    /// The command in the middle of every tendon's range.
    fn mean_command<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.mean_command().as_slice())
    }

    /// Commands drawn uniformly from the box of the tendons' ranges, shape (count, tendons).
    fn random_commands<'py>(
        &self,
        py: Python<'py>,
        count: usize,
        seed: u64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let commands = (0..count).flat_map(|_| self.0.random_command(&mut rng).as_slice().to_vec());
        array(py, commands.collect(), [count, self.0.tendons().len()])
    }

    /// Origins of the discs in the straight pose, shape (discs, 3) (m).
    fn straight_positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let straight = Configuration::straight(&self.0).place(&self.0).0;
        let places = straight.iter().flat_map(|p: &Vector3<f64>| [p.x, p.y, p.z]);
        array(py, places.collect(), [self.0.discs().len(), 3])
    }

    /// Value of a parameter, by its name.
    fn value(&self, parameter: &str) -> Outcome<f64> {
        Ok(self.0.spec().value(named(parameter)?)?)
    }

    /// The parameters that have values.
    fn parameters(&self) -> Outcome<Vec<Described>> {
        let spec = self.0.spec();
        let all = spec.parameters();
        let describe = |&parameter: &Parameter| {
            let acts_on = spec.acts_on(parameter)?;
            let overlapping = (all.iter().copied())
                .filter(|&other| other != parameter && spec.parameters_overlap(parameter, other));
            let (module, discs, tendons) = match &acts_on {
                ActsOn::Base => (None, Vec::new(), Vec::new()),
                ActsOn::Tendon(tendon) => (None, Vec::new(), vec![*tendon]),
                ActsOn::Disc(disc) => (None, vec![*disc], Vec::new()),
                ActsOn::Module { module, discs } => {
                    (Some(*module), discs.clone().collect(), Vec::new())
                }
            };
            Ok((
                parameter.key(),
                spec.value(parameter)?,
                parameter.unit(),
                acts_on.to_string(),
                module,
                discs,
                tendons,
                overlapping.map(Parameter::key).collect(),
                bounds(parameter),
            ))
        };
        all.iter().map(describe).collect()
    }

    /// Refuses parameters that the robot does not have, and those that overlap.
    fn check_parameters(&self, names: Vec<String>) -> Outcome<()> {
        parameters_of(&self.0, &names).map(drop)
    }

    /// This robot with its base elsewhere: position (m) and quaternion (w, x, y, z), not all 0.
    fn with_base(&self, position: [f64; 3], quaternion: [f64; 4]) -> Outcome<Self> {
        Ok(Self(self.0.with_base(position, quaternion)?))
    }

    /// Position (m) and quaternion (w, x, y, z) of the base, as the robot file has them.
    fn base(&self) -> ([f64; 3], [f64; 4]) {
        let base = &self.0.spec().base;
        (base.position, base.orientation)
    }

    /// This robot with other values of some parameters.
    fn with_values(&self, names: Vec<String>, values: Vec<f64>) -> Outcome<Self> {
        let names = parameters(&names)?;
        let values: Vec<_> = names.into_iter().zip(values).collect();
        Self::new(self.0.spec().with(&values)?)
    }
}

/// Smallest and largest value of a parameter of any robot, by its name; of sizes that cannot be 0, 0 is just below the smallest.
#[pyfunction]
pub fn parameter_bounds(name: &str) -> Outcome<(f64, f64)> {
    named(name).map(bounds)
}

fn bounds(parameter: Parameter) -> (f64, f64) {
    (parameter.kind().quantity.values.least(), f64::INFINITY)
}

/// A parameter by its name.
pub fn named(name: &str) -> Outcome<Parameter> {
    name.parse()
        .map_err(|error: tdcr::sim::robot::ParameterKeyError| {
            Failure::Of("ParameterError", error.to_string())
        })
}

/// Parameters by their names.
pub fn parameters(names: &[String]) -> Outcome<Vec<Parameter>> {
    names.iter().map(|name| named(name)).collect()
}

/// Parameters of a robot by their names, which may be changed together.
pub fn parameters_of(robot: &tdcr::sim::robot::Robot, names: &[String]) -> Outcome<Vec<Parameter>> {
    let parameters = parameters(names)?;
    robot.spec().check_parameters(&parameters)?;
    Ok(parameters)
}

/// The robots of the rows of a batch, one for all or one a row, all of as many discs and tendons; at least one.
pub fn of_rows(robots: &[PyRef<'_, Robot>], rows: usize) -> Outcome<Vec<tdcr::sim::robot::Robot>> {
    let robots: Vec<_> = robots.iter().map(|robot| robot.0.clone()).collect();
    let Some(first) = (robots.first()).filter(|_| robots.len() == 1 || robots.len() == rows) else {
        let message = format!("{} robots, expected 1 or {rows}, one a row", robots.len());
        return Err(Failure::input(message));
    };
    let size = |robot: &tdcr::sim::robot::Robot| (robot.discs().len(), robot.tendons().len());
    let (discs, tendons) = size(first);
    if let Some(other) = robots
        .iter()
        .position(|robot| size(robot) != (discs, tendons))
    {
        let found = size(&robots[other]);
        return Err(Failure::input(format!(
            "robot {other} has {} discs and {} tendons, robot 0 has {discs} and {tendons}: expected robots of one size",
            found.0, found.1
        )));
    }
    Ok(robots)
}
