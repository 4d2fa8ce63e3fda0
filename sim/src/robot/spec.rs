//! What the user writes: the robot's specification, its files and its validation.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A disc-and-ball-joint tendon-driven continuum robot.
///
/// A chain of cylindrical discs stands on a base; each disc turns about its own origin on a ball
/// joint carried by the body below. Lengths are in metres, in the frame of the body they belong to;
/// every body's z axis points along the backbone, towards the tip, in the straight pose.
///
/// Read from TOML or JSON with [`RobotSpec::load`]; the paper's robots are
/// [`RobotSpec::standard`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotSpec {
    /// Name, used in reports and files.
    pub name: String,
    /// Gravitational acceleration in the world frame (m/s²).
    pub gravity: [f64; 3],
    /// Where the tendons of a module come from.
    pub routing: Routing,
    /// The fixed base.
    pub base: BaseSpec,
    /// The modules, from the base to the tip.
    pub modules: Vec<ModuleSpec>,
    /// The cameras that watch the robot.
    pub cameras: RingSpec,
}

/// Where the tendons of a module start. Every tendon ends at the last disc of its own module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Routing {
    /// At the last disc of the module below (module 1: at the base). The paper's simulated robots.
    ModuleBelow,
    /// At the base, through the guide holes of every lower module. The paper's real robot.
    Base,
}

/// The fixed base body, upright: its frame has the axes of the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseSpec {
    /// Origin in the world frame (m).
    pub position: [f64; 3],
    /// Tendon holes, x and y in the base frame (m).
    pub holes: Vec<[f64; 2]>,
    /// Height of the holes in the base frame (m).
    pub hole_height: f64,
}

/// Equal discs in a row, with the tendons that end at the last of them: one per hole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModuleSpec {
    /// Number of discs, at least 1; at most 1000 in all modules together.
    pub discs: usize,
    /// Distance of the first disc's origin from the origin of the body below, along z (m).
    pub first_offset: f64,
    /// Distance of each next disc's origin from the one before, along z (m).
    pub pitch: f64,
    /// Disc radius (m).
    pub radius: f64,
    /// Half of the disc's height (m).
    pub half_height: f64,
    /// Disc density (kg/m³).
    pub density: Density,
    /// Tendon holes, x and y in the disc frame, at z = 0 (m).
    pub holes: Vec<[f64; 2]>,
    /// Viscous damping of each ball joint (N m s/rad). Has no effect on an equilibrium.
    pub damping: f64,
    /// Armature inertia of each ball joint (kg m²). Has no effect on an equilibrium.
    pub armature: f64,
    /// Actuator gain kp (N/m): a tendon of length `L` under command `c` is pulled with
    /// `kp (L - c)`.
    pub tendon_gain: f64,
    /// Smallest and largest command of the module's tendons (m).
    pub command_range: [f64; 2],
}

/// Density of a module's discs (kg/m³).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Density {
    /// The same for every disc.
    Uniform(f64),
    /// One value per disc, from the lowest to the highest.
    PerDisc(Vec<f64>),
}

impl Density {
    /// Density of the module's disc `index` (kg/m³); `None` when the list is too short.
    pub fn of_disc(&self, index: usize) -> Option<f64> {
        match self {
            Density::Uniform(density) => Some(*density),
            Density::PerDisc(densities) => densities.get(index).copied(),
        }
    }
}

/// Equal pinhole cameras on a circle around the z axis, pitched down, the first at `(0, -radius)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RingSpec {
    /// Number of cameras, evenly spaced.
    pub count: usize,
    /// Radius of the circle (m).
    pub radius: f64,
    /// Height of the circle in the world frame (m).
    pub height: f64,
    /// Angle of the optical axes below horizontal (rad).
    pub pitch: f64,
    /// Vertical field of view (degrees).
    pub fovy: f64,
    /// Image width and height (pixels).
    pub resolution: [u32; 2],
}

/// Why a robot specification was refused.
#[derive(Debug, Error)]
pub enum SpecError {
    /// The name is neither a standard robot nor a file.
    #[error("unknown robot `{0}`: expected 2m, 3m, 5m or the path of a .toml or .json robot file")]
    Unknown(String),
    /// The file could not be read.
    #[error("cannot read robot file {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not a robot specification.
    #[error("robot file {} is not a robot specification: {reason}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Where in the file, and what was expected there.
        reason: String,
    },
    /// A field has a value that no robot can have.
    #[error("robot field `{field}` is {value}; expected {expected}")]
    Field {
        /// The field's path, e.g. `modules[1].radius`.
        field: String,
        /// The value found.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
}

const TWO_MODULES: &str = include_str!("../../robots/2m.toml");
const THREE_MODULES: &str = include_str!("../../robots/3m.toml");
const FIVE_MODULES: &str = include_str!("../../robots/5m.toml");

impl RobotSpec {
    /// Names of the paper's simulated robots.
    pub const STANDARD: [&str; 3] = ["2m", "3m", "5m"];

    /// One of the paper's simulated robots, by its name; `None` for any other name.
    pub fn standard(name: &str) -> Option<Self> {
        let text = match name {
            "2m" => TWO_MODULES,
            "3m" => THREE_MODULES,
            "5m" => FIVE_MODULES,
            _ => return None,
        };
        Some(toml::from_str(text).expect("the standard robots parse: a test loads each"))
    }

    /// A standard robot by name, or a robot file (TOML, or JSON by its extension), validated.
    ///
    /// # Errors
    /// [`SpecError`] when there is no such robot, or the file cannot be read, parsed or accepted.
    pub fn load(name_or_path: &str) -> Result<Self, SpecError> {
        if let Some(spec) = Self::standard(name_or_path) {
            return Ok(spec);
        }
        let path = Path::new(name_or_path);
        let is_json = path.extension().is_some_and(|e| e == "json");
        if !is_json && path.extension().is_none_or(|e| e != "toml") {
            return Err(SpecError::Unknown(name_or_path.to_owned()));
        }
        let text = std::fs::read_to_string(path).map_err(|source| SpecError::Read {
            path: path.to_owned(),
            source,
        })?;
        let parsed: Result<Self, String> = if is_json {
            serde_json::from_str(&text).map_err(|e| e.to_string())
        } else {
            toml::from_str(&text).map_err(|e| e.to_string())
        };
        let spec = parsed.map_err(|reason| SpecError::Parse {
            path: path.to_owned(),
            reason,
        })?;
        spec.validate()?;
        Ok(spec)
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`SpecError::Field`] for the first field that no robot can have.
    pub fn validate(&self) -> Result<(), SpecError> {
        check_finite("gravity", &self.gravity)?;
        check_finite("base.position", &self.base.position)?;
        check_finite("base.hole_height", &[self.base.hole_height])?;
        check_finite("base.holes", self.base.holes.as_flattened())?;
        if self.modules.is_empty() {
            return Err(refuse("modules", "empty", "at least one module"));
        }
        for (index, module) in self.modules.iter().enumerate() {
            self.validate_module(index, module)?;
        }
        let discs: usize = self.modules.iter().map(|module| module.discs).sum();
        if discs > MAX_DISCS {
            return Err(refuse(
                "modules",
                format!("{discs} discs"),
                "1000 discs in all at most",
            ));
        }
        self.cameras.validate()
    }

    fn validate_module(&self, index: usize, module: &ModuleSpec) -> Result<(), SpecError> {
        let at = |field: &str| format!("modules[{index}].{field}");
        if !(1..=MAX_DISCS).contains(&module.discs) {
            return Err(refuse(&at("discs"), module.discs, "1 to 1000"));
        }
        check_positive(&at("first_offset"), module.first_offset)?;
        check_positive(&at("pitch"), module.pitch)?;
        check_positive(&at("radius"), module.radius)?;
        check_positive(&at("half_height"), module.half_height)?;
        check_positive(&at("tendon_gain"), module.tendon_gain)?;
        check_not_negative(&at("damping"), module.damping)?;
        check_not_negative(&at("armature"), module.armature)?;
        check_finite(&at("holes"), module.holes.as_flattened())?;
        match &module.density {
            Density::Uniform(density) => check_not_negative(&at("density"), *density)?,
            Density::PerDisc(densities) => {
                if densities.len() != module.discs {
                    let expected = "one density per disc, or a single number for all";
                    let found = format!("a list of {}", densities.len());
                    return Err(refuse(&at("density"), found, expected));
                }
                for (disc, density) in densities.iter().enumerate() {
                    check_not_negative(&at(&format!("density[{disc}]")), *density)?;
                }
            }
        }
        let [low, high] = module.command_range;
        if !(low.is_finite() && high.is_finite() && 0.0 <= low && low < high) {
            let expected = "[smallest, largest] in metres with 0 <= smallest < largest";
            return Err(refuse(
                &at("command_range"),
                format!("[{low}, {high}]"),
                expected,
            ));
        }
        let lower_bodies = std::iter::once(("base.holes".to_owned(), self.base.holes.len())).chain(
            self.modules[..index]
                .iter()
                .enumerate()
                .map(|(below, module)| (format!("modules[{below}].holes"), module.holes.len())),
        );
        let passed = match self.routing {
            Routing::Base => lower_bodies.collect::<Vec<_>>(),
            Routing::ModuleBelow => lower_bodies.last().into_iter().collect(),
        };
        for (field, holes) in passed {
            if holes < module.holes.len() {
                let expected = "at least as many holes as each module whose tendons pass here";
                return Err(refuse(&field, format!("a list of {holes}"), expected));
            }
        }
        Ok(())
    }
}

impl RingSpec {
    fn validate(&self) -> Result<(), SpecError> {
        if !(1..=MAX_CAMERAS).contains(&self.count) {
            return Err(refuse("cameras.count", self.count, "1 to 1000"));
        }
        check_positive("cameras.radius", self.radius)?;
        check_finite("cameras.height", &[self.height])?;
        check_finite("cameras.pitch", &[self.pitch])?;
        if !(self.fovy > 0.0 && self.fovy < 180.0) {
            return Err(refuse(
                "cameras.fovy",
                self.fovy,
                "degrees between 0 and 180",
            ));
        }
        if self
            .resolution
            .iter()
            .any(|&side| side == 0 || side > MAX_IMAGE_SIDE)
        {
            let found = format!("{:?}", self.resolution);
            return Err(refuse(
                "cameras.resolution",
                found,
                "[width, height], 1 to 16384 pixels each",
            ));
        }
        Ok(())
    }
}

/// Far above any robot built, and small enough that every product of sizes fits in memory.
const MAX_DISCS: usize = 1000;
const MAX_CAMERAS: usize = 1000;
const MAX_IMAGE_SIDE: u32 = 16_384;

fn refuse(field: &str, value: impl ToString, expected: &'static str) -> SpecError {
    SpecError::Field {
        field: field.to_owned(),
        value: value.to_string(),
        expected,
    }
}

fn check_finite(field: &str, values: &[f64]) -> Result<(), SpecError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(refuse(field, value, "finite numbers")),
        None => Ok(()),
    }
}

fn check_positive(field: &str, value: f64) -> Result<(), SpecError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(refuse(field, value, "a finite number above 0"))
    }
}

fn check_not_negative(field: &str, value: f64) -> Result<(), SpecError> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(refuse(field, value, "a finite number, 0 or above"))
    }
}
