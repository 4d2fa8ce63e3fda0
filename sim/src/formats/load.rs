//! Robots by name or path.

use std::path::{Path, PathBuf};

use tdcr_base::files::{LARGEST_TEXT, Table, read_text, with_place};
use thiserror::Error;

use super::missing::{self, MissingFields};
use super::{ImportError, Imported, Note, mjcf, urdf};
use crate::robot::{
    Backbone, BaseSpec, CameraSpec, HoleCircle, Limit, ModuleSpec, RigidMass, RingSpec, Robot,
    RobotSpec, RodSpec, RouteSpec, SolidMass, SpecError, TendonSpec,
};

/// Why a robot was not read from a file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RobotFileError {
    /// The name is neither a standard robot nor a file.
    #[error(
        "unknown robot `{0}`: expected 2m, 3m, 5m or the path of a .toml, .json, .xml (MJCF) or \
         .urdf robot file"
    )]
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
    /// Fields are missing in the file.
    #[error(
        "robot file {} is not a robot specification: {}",
        path.display(),
        missing.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
    )]
    Missing {
        /// The file.
        path: PathBuf,
        /// All of them, by the tables that lack them.
        missing: Vec<MissingFields>,
    },
    /// The file is of another tool, and not a robot that can be represented here.
    #[error(transparent)]
    Import(Box<ImportError>),
    /// The robot is not valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// The robot has what TOML cannot say.
    #[error("the robot cannot be written as TOML: {0}")]
    Write(toml::ser::Error),
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

    /// A standard robot by name, or a robot file, validated: TOML, or by its extension JSON, MJCF
    /// (`.xml`) or URDF (`.urdf`). What a file of another tool says besides is passed over.
    ///
    /// # Errors
    /// [`RobotFileError`] when there is no such robot, or the file cannot be read, parsed or accepted.
    pub fn load(name_or_path: &str) -> Result<Self, RobotFileError> {
        Ok(Self::load_with_notes(name_or_path)?.0)
    }

    /// As [`load`](Self::load), with notes on what was passed over.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_with_notes(name_or_path: &str) -> Result<(Self, Vec<Note>), RobotFileError> {
        if let Some(spec) = Self::standard(name_or_path) {
            return Ok((spec, Vec::new()));
        }
        let path = Path::new(name_or_path);
        let extension = path.extension().and_then(|extension| extension.to_str());
        match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("toml") => parse(path, from_toml, missing::in_toml),
            Some("json") => parse(path, from_json, missing::in_json),
            Some("xml") => without_payload(mjcf::import(path)?),
            Some("urdf") => without_payload(urdf::import(path)?),
            _ => Err(RobotFileError::Unknown(name_or_path.to_owned())),
        }
    }
}

impl RobotSpec {
    /// A robot from the text of a TOML file, validated; errors call the file `path`.
    ///
    /// # Errors
    /// [`RobotFileError`] where the text is not a robot specification, or the robot is not valid.
    pub fn from_toml(text: &str, path: &Path) -> Result<Self, RobotFileError> {
        parse_text(text, path, from_toml, missing::in_toml)
    }

    /// The text of its TOML file.
    ///
    /// # Errors
    /// [`RobotFileError::Write`] for what TOML cannot say.
    pub fn to_toml(&self) -> Result<String, RobotFileError> {
        toml::to_string(self).map_err(RobotFileError::Write)
    }
}

impl Robot {
    /// A standard robot by name, or a robot file: [`RobotSpec::load`], compiled.
    ///
    /// # Errors
    /// [`RobotFileError`] as [`RobotSpec::load`]; [`RobotFileError::Robot`] as [`Robot::new`].
    pub fn load(name_or_path: &str) -> Result<Self, RobotFileError> {
        Ok(Self::new(RobotSpec::load(name_or_path)?)?)
    }
}

impl From<ImportError> for RobotFileError {
    fn from(error: ImportError) -> Self {
        match error {
            ImportError::Read { path, source } => Self::Read { path, source },
            ImportError::Robot(error) => Self::Robot(*error),
            other => Self::Import(Box::new(other)),
        }
    }
}

/// Why a text could not be read.
struct Refusal {
    /// Without the place in the file.
    message: String,
    /// With it.
    reason: String,
}

fn from_toml(text: &str) -> Result<RobotSpec, Refusal> {
    toml::from_str(text).map_err(|error| Refusal {
        message: error.message().to_owned(),
        reason: error.to_string(),
    })
}

fn from_json(text: &str) -> Result<RobotSpec, Refusal> {
    serde_json::from_str(text).map_err(|error| Refusal {
        message: error.to_string(),
        reason: error.to_string(),
    })
}

fn parse(
    path: &Path,
    read: impl Fn(&str) -> Result<RobotSpec, Refusal>,
    missing: impl Fn(&str) -> Vec<MissingFields>,
) -> Result<(RobotSpec, Vec<Note>), RobotFileError> {
    let text = read_text(path, LARGEST_TEXT).map_err(|source| RobotFileError::Read {
        path: path.to_owned(),
        source,
    })?;
    Ok((parse_text(&text, path, read, missing)?, Vec::new()))
}

fn parse_text(
    text: &str,
    path: &Path,
    read: impl Fn(&str) -> Result<RobotSpec, Refusal>,
    missing: impl Fn(&str) -> Vec<MissingFields>,
) -> Result<RobotSpec, RobotFileError> {
    let spec = read(text).map_err(|refusal| {
        let path = path.to_owned();
        // Of what is missing, reading names only the first.
        let is_first_missing = refusal.message.starts_with("missing field");
        match is_first_missing.then(|| missing(text)) {
            Some(missing) if !missing.is_empty() => RobotFileError::Missing { path, missing },
            _ => RobotFileError::Parse {
                path,
                reason: with_table(&refusal.reason),
            },
        }
    })?;
    spec.validate()?;
    Ok(spec)
}

/// The message of an error that refuses a field of a robot, with the table of a robot file that has such a field.
pub fn with_table(message: &str) -> String {
    with_place(message, &tables())
}

/// The tables of a robot file, those that users write most first.
fn tables() -> [Table; 13] {
    [
        Table::of::<RobotSpec>("the file itself, above all tables"),
        Table::of::<BaseSpec>("[base]"),
        Table::of::<ModuleSpec>("[[modules]]"),
        Table::of::<TendonSpec>("[modules.tendons]"),
        Table::of::<Backbone>("[modules.backbone]"),
        Table::of::<RodSpec>("[modules.rod]"),
        Table::of::<Limit>("[modules.limit]"),
        Table::of::<HoleCircle>("a circle of `holes`"),
        Table::of::<RigidMass>("[modules.mass.rigid]"),
        Table::of::<SolidMass>("[modules.mass.solid]"),
        Table::of::<RouteSpec>("[[routes]]"),
        Table::of::<RingSpec>("[cameras]"),
        Table::of::<CameraSpec>("[[cameras]]"),
    ]
}

/// A payload is a load on a robot, not part of it, and would be lost in silence.
fn without_payload(imported: Imported) -> Result<(RobotSpec, Vec<Note>), RobotFileError> {
    if imported.payload.mass > 0.0 {
        let value = format!("{} kg", imported.payload.mass);
        let expected = "none in a robot file: a payload is a load, given beside the robot";
        return Err(RobotFileError::Robot(SpecError::Field {
            field: "payload".to_owned(),
            value,
            expected,
        }));
    }
    Ok((imported.spec, imported.notes))
}
