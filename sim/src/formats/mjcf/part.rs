//! A robot as a part of another model: a body with its tendons and actuators, to be mounted on an arm.

use nalgebra::UnitQuaternion;

use super::check::representable;
use super::export::{Base, IN_SERIES, write_chain, write_tendons};
use super::keyframe::Start;
use super::obstacles::Touching;
use super::options::{ExportOptions, Integrator};
use super::write::{XmlWriter, is_xml_char, number};
use super::written_joint::WrittenJoint;
use crate::formats::ExportError;
use crate::robot::{Payload, Robot, RobotSpec};

/// Class of the part's defaults, so that those of the model around it do not act on it, nor its own on that.
const CLASS: &str = "robot";

/// How a robot stands in another model.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// What the names of all that the part consists of begin with, such as `tdcr/`; empty for none.
    pub prefix: String,
    /// What hangs from the distal disc.
    pub payload: Payload,
    /// How the whole model is to take its steps: whether there is a stable one is checked, and how long it may be is said.
    pub integrator: Integrator,
}

impl Part {
    /// A part whose names begin with `prefix`, without a payload.
    pub fn named(prefix: impl Into<String>) -> Self {
        Self {
            prefix: prefix.into(),
            payload: Payload::default(),
            integrator: Integrator::default(),
        }
    }
}

/// The robot as a model (MJCF text) that MuJoCo's `mjs_attach` (`MjSpec.attach` in Python, `<attach>` in MJCF) mounts in another: its
/// base is the body `PREFIXbase`, which stands at the origin and is turned by nothing, as its pose is that of the frame or site that it
/// is attached to. Names are those of [`export`](super::export) behind the prefix.
///
/// Cameras, gravity, time step and keyframe are those of the model around it. The longest of the usual time steps at which the robot,
/// standing as its own file says, is stable by a margin is said in a comment; on an arm it may hang otherwise.
///
/// # Errors
/// [`ExportError`] as [`export`](super::export); for a prefix with characters that XML cannot hold, or with spaces.
pub fn export_part(spec: &RobotSpec, part: &Part) -> Result<String, ExportError> {
    if let Some(character) = part
        .prefix
        .chars()
        .find(|&c| c.is_whitespace() || !is_xml_char(c))
    {
        return Err(ExportError::Prefix {
            prefix: part.prefix.clone(),
            character,
        });
    }
    let robot = Robot::new(spec.clone())?;
    representable(&robot, &part.payload)?;
    let joints: Vec<WrittenJoint> = robot.discs().iter().map(WrittenJoint::of).collect();
    let options = ExportOptions {
        payload: part.payload,
        integrator: part.integrator,
        ..ExportOptions::default()
    };
    let timestep = Start::of(&robot, &options)?.timestep(&robot, &joints, &options)?;

    let mut xml = XmlWriter::with_prefix(&part.prefix);
    xml.open("mujoco", &[("model", spec.name.clone())]);
    xml.leaf("compiler", &[("angle", "radian".to_owned())]);
    xml.comment(&format!(
        "stable by itself with {} at time steps of {} s",
        part.integrator.name(),
        number(timestep)
    ));
    write_defaults(&mut xml);
    xml.open("worldbody", &[]);
    if !joints.iter().all(WrittenJoint::is_as_here) {
        xml.comment(IN_SERIES);
    }
    let base = Base {
        position: [0.0; 3],
        orientation: UnitQuaternion::identity(),
        class: Some(CLASS),
    };
    let touching = Touching::new(&robot, &options.scene);
    write_chain(&mut xml, &robot, &joints, &part.payload, &touching, &base);
    xml.close();
    if !robot.tendons().is_empty() {
        write_tendons(&mut xml, &robot, Some(CLASS));
    }
    Ok(xml.finish())
}

fn write_defaults(xml: &mut XmlWriter) {
    xml.open("default", &[]);
    xml.open("default", &[("class", CLASS.to_owned())]);
    xml.leaf(
        "geom",
        &[("contype", "0".to_owned()), ("conaffinity", "0".to_owned())],
    );
    xml.leaf("site", &[("size", "0.001".to_owned())]);
    xml.leaf(
        "tendon",
        &[
            ("width", "0.0005".to_owned()),
            ("rgba", "0.2 0.2 0.2 1".to_owned()),
        ],
    );
    xml.close();
    xml.close();
}
