//! What the user writes: the robot's specification; and what robot files may leave out or say in other words: length for
//! pitch, degrees for radians, no cameras.

use serde::{Deserialize, Serialize};

use super::angle;
use super::cameras::Cameras;
use super::{
    Backbone, Body, HingeJoint, Holes, Limit, MassSpec, PerDisc, RodSpec, RouteSpec, TendonSpec,
};

/// Image size of the cameras around a robot whose file gives none (pixels).
const RESOLUTION: [u32; 2] = [1280, 720];

/// A tendon-driven continuum robot of discs and joints.
///
/// A chain of cylindrical discs stands on a base; each disc turns on a ball joint, or on hinges, carried by the
/// body below. Lengths are in metres, in the frame of the body they belong to; every body's z axis
/// points along the backbone, towards the tip, in the straight pose.
///
/// Read from TOML or JSON with [`RobotSpec::load`] (`docs/robot-files.md` has every field with its
/// default and accepted values); the paper's robots are [`RobotSpec::standard`]. In Rust, change a standard robot, or build one field by field:
///
/// ```
/// use tdcr_sim::robot::{Backbone, PerDisc, Robot, RobotSpec};
///
/// let mut spec = RobotSpec::standard("2m").expect("a standard robot");
/// spec.name = "2m on a spring".into();
/// for module in &mut spec.modules {
///     module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.05)));
/// }
/// let robot = Robot::new(spec)?;
/// # Ok::<(), tdcr_sim::robot::SpecError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "RobotInFile")]
pub struct RobotSpec {
    /// Name, used in reports and files.
    pub name: String,
    /// Gravitational acceleration in the world frame (m/s²), in any direction.
    pub gravity: [f64; 3],
    /// Where the tendons that modules bring along come from.
    pub routing: Routing,
    /// The fluid at rest that the robot moves in; none where the file does not give it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fluid: Option<Fluid>,
    /// The fixed base.
    pub base: BaseSpec,
    /// The modules, from the base to the tip: 1 to 1000 discs in all.
    pub modules: Vec<ModuleSpec>,
    /// Tendons with routes of their own; in a command they follow the modules' tendons.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub routes: Vec<RouteSpec>,
    /// The cameras that watch the robot; [`Cameras::around`] it where the file does not give them.
    pub cameras: Cameras,
}

/// A fluid at rest, whose drag holds the discs back in motion: `1/2 density drag_coefficient A |v| v` at the velocity `v` of a disc's
/// origin, `A` the area that its cylinder shows along `v`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fluid {
    /// Density (kg/m³).
    pub density: f64,
    /// Coefficient of drag.
    pub drag_coefficient: f64,
}

/// Where the tendons that a module brings along start. Each goes through the holes of its own
/// number, and ends at the last disc of its own module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Routing {
    /// At the last disc of the module below (module 1: at the base). The paper's simulated robots.
    ModuleBelow,
    /// At the base, through the guide holes of every lower module. The paper's real robot.
    Base,
}

/// The fixed base body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseSpec {
    /// Origin in the world frame (m).
    pub position: [f64; 3],
    /// Orientation in the world frame: a quaternion (w, x, y, z), normalised on use. Upright where
    /// the file does not give it.
    #[serde(default = "upright", skip_serializing_if = "is_upright")]
    pub orientation: [f64; 4],
    /// Tendon holes in the base frame.
    pub holes: Holes,
    /// Height of the holes in the base frame (m).
    pub hole_height: f64,
}

/// Discs in a row, and the tendons that end at the last of them.
///
/// Files may give the `length` of a module in place of `first_offset` and `pitch`, which are then
/// both `length / discs`; the pitch alone, which `first_offset` then equals; and `clocking_degrees`
/// in place of `clocking`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ModuleInFile")]
pub struct ModuleSpec {
    /// Number of discs, at least 1; at most 1000 in all modules together.
    pub discs: usize,
    /// Distance of the first disc's origin from the origin of the body below, along z (m).
    pub first_offset: f64,
    /// Distance of each next disc's origin from the one before, along z (m).
    pub pitch: f64,
    /// Angle (rad) about the z axis by which the module's holes are turned, and with them those of
    /// every lower body that its tendons go through. 0 where the file does not give it.
    ///
    /// Modules of different clockings go through different holes of the bodies below: see
    /// [`RobotSpec::hole_positions`]. Three modules of three holes each, clocked by 0, 40 and 80
    /// degrees and routed from the base, go through nine holes of the base, 40 degrees apart.
    #[serde(skip_serializing_if = "is_zero")]
    pub clocking: f64,
    /// Distance of each disc's joint below the disc's origin, along the disc's z axis (m).
    /// 0, as in the paper, where the file does not give it; half the pitch makes a chain of discs
    /// converge to a continuous rod fastest.
    #[serde(skip_serializing_if = "is_zero")]
    pub joint_below: f64,
    /// Disc radius (m).
    pub radius: f64,
    /// Half of the disc's height (m).
    pub half_height: f64,
    /// Mass of the discs.
    pub mass: MassSpec,
    /// Tendon holes in the disc frame, at z = 0, before they are turned by the clocking.
    pub holes: Holes,
    /// Viscous damping of each ball joint, or of every hinge (N m s/rad). Has no effect on an equilibrium.
    pub damping: PerDisc<f64>,
    /// Armature inertia of each ball joint, or of every hinge (kg m²). Has no effect on an equilibrium.
    pub armature: PerDisc<f64>,
    /// Hinges that each joint consists of, in place of a ball joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<PerDisc<HingeJoint>>,
    /// Elastic backbone; joints without one, and without a rod, turn freely.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub backbone: Option<PerDisc<Backbone>>,
    /// An elastic rod through the discs, in place of a backbone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rod: Option<RodSpec>,
    /// Soft limit of each joint's turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit: Option<PerDisc<Limit>>,
    /// The tendons that the module brings along, one for each of its holes; none where the file
    /// does not give them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tendons: Option<TendonSpec>,
}

impl RobotSpec {
    /// Number of discs of all modules.
    pub fn disc_count(&self) -> usize {
        self.modules.iter().map(|module| module.discs).sum()
    }

    /// Number of tendons: those of the modules, and those with routes of their own.
    pub fn tendon_count(&self) -> usize {
        let of_module =
            |module: &ModuleSpec| module.tendons.as_ref().map_or(0, |_| module.holes.count());
        self.modules.iter().map(of_module).sum::<usize>() + self.routes.len()
    }

    /// What tendons are specified as: those of each module that has some, then those of each route.
    pub fn tendon_specs_mut(&mut self) -> impl Iterator<Item = &mut TendonSpec> {
        let of_modules = (self.modules.iter_mut()).filter_map(|module| module.tendons.as_mut());
        of_modules.chain(self.routes.iter_mut().map(|route| &mut route.tendon))
    }

    /// What each tendon is specified as, in a command's order: modules share one among their tendons.
    pub fn tendons(&self) -> Vec<&TendonSpec> {
        let of_modules =
            (self.modules.iter()).filter_map(|m| Some((m.tendons.as_ref()?, m.holes.count())));
        let of_modules = of_modules.flat_map(|(tendon, count)| std::iter::repeat_n(tendon, count));
        (of_modules.chain(self.routes.iter().map(|route| &route.tendon))).collect()
    }

    /// Pattern of a body's holes (m), before any clocking; `None` for a disc that the robot does
    /// not have. [`hole_positions`](Self::hole_positions) are where its holes are.
    pub fn holes(&self, body: Body) -> Option<&Holes> {
        match body {
            Body::Base => Some(&self.base.holes),
            Body::Disc(disc) => self.module_of(disc).map(|m| &self.modules[m].holes),
        }
    }

    /// Index of the module that disc `disc` belongs to; `None` for a disc the robot does not have.
    pub fn module_of(&self, disc: usize) -> Option<usize> {
        let mut end = 0;
        self.modules.iter().position(|module| {
            end += module.discs;
            disc < end
        })
    }
}

fn upright() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

fn is_upright(orientation: &[f64; 4]) -> bool {
    *orientation == upright()
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A [`RobotSpec`] as files have it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotInFile {
    name: String,
    gravity: [f64; 3],
    routing: Routing,
    fluid: Option<Fluid>,
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
            fluid: file.fluid,
            base: file.base,
            modules: file.modules,
            routes: file.routes,
        }
    }
}

/// A [`ModuleSpec`] as files have it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ModuleInFile {
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
