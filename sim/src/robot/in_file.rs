//! What robot files may leave out or say in other words: length for pitch, degrees for radians, no
//! cameras.

use serde::Deserialize;

use super::angle;
use super::{
    Backbone, BaseSpec, Cameras, HingeJoint, Holes, Limit, MassSpec, ModuleSpec, PerDisc,
    RobotSpec, RodSpec, RouteSpec, Routing, TendonSpec,
};

/// Image size of the cameras around a robot whose file gives none (pixels).
const RESOLUTION: [u32; 2] = [1280, 720];

/// A [`RobotSpec`] as files have it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RobotInFile {
    name: String,
    gravity: [f64; 3],
    routing: Routing,
    base: BaseSpec,
    modules: Vec<ModuleSpec>,
    #[serde(default)]
    routes: Vec<RouteSpec>,
    cameras: Option<Cameras>,
}

impl From<RobotInFile> for RobotSpec {
    fn from(file: RobotInFile) -> Self {
        let length = |module: &ModuleSpec| {
            module.first_offset + module.pitch * module.discs.saturating_sub(1) as f64
        };
        let around = || {
            let length = file.modules.iter().map(length).sum();
            Cameras::around(file.base.position, length, RESOLUTION)
        };
        Self {
            cameras: file.cameras.unwrap_or_else(around),
            name: file.name,
            gravity: file.gravity,
            routing: file.routing,
            base: file.base,
            modules: file.modules,
            routes: file.routes,
        }
    }
}

/// A [`ModuleSpec`] as files have it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModuleInFile {
    discs: usize,
    first_offset: Option<f64>,
    pitch: Option<f64>,
    length: Option<f64>,
    clocking: Option<f64>,
    clocking_degrees: Option<f64>,
    #[serde(default)]
    joint_below: f64,
    radius: f64,
    half_height: f64,
    mass: MassSpec,
    holes: Holes,
    damping: PerDisc<f64>,
    armature: PerDisc<f64>,
    joint: Option<PerDisc<HingeJoint>>,
    backbone: Option<PerDisc<Backbone>>,
    rod: Option<RodSpec>,
    limit: Option<PerDisc<Limit>>,
    tendons: Option<TendonSpec>,
}

impl ModuleInFile {
    /// Offset of the first disc, and pitch (m).
    fn steps(&self) -> Result<[f64; 2], String> {
        match (self.length, self.first_offset, self.pitch) {
            (Some(length), None, None) => Ok([length / self.discs as f64; 2]),
            (Some(_), _, _) => Err(
                "`length` is given beside `first_offset` or `pitch`; expected it in their place"
                    .to_owned(),
            ),
            (None, first, Some(pitch)) => Ok([first.unwrap_or(pitch), pitch]),
            (None, _, None) => Err("missing field `pitch` or `length`".to_owned()),
        }
    }
}

impl TryFrom<ModuleInFile> for ModuleSpec {
    type Error = String;

    fn try_from(file: ModuleInFile) -> Result<Self, String> {
        let [first_offset, pitch] = file.steps()?;
        let (radians, degrees) = (file.clocking, file.clocking_degrees);
        let names = ["clocking", "clocking_degrees"];
        let clocking = angle::one_of(radians, degrees, names, f64::to_radians)?;
        Ok(Self {
            discs: file.discs,
            first_offset,
            pitch,
            clocking: clocking.unwrap_or_default(),
            joint_below: file.joint_below,
            radius: file.radius,
            half_height: file.half_height,
            mass: file.mass,
            holes: file.holes,
            damping: file.damping,
            armature: file.armature,
            joint: file.joint,
            backbone: file.backbone,
            rod: file.rod,
            limit: file.limit,
            tendons: file.tendons,
        })
    }
}
