//! What the user writes: the robot's specification.

use serde::{Deserialize, Serialize};

use super::cameras::Cameras;

/// A disc-and-ball-joint tendon-driven continuum robot.
///
/// A chain of cylindrical discs stands on a base; each disc turns on a ball joint carried by the
/// body below. Lengths are in metres, in the frame of the body they belong to; every body's z axis
/// points along the backbone, towards the tip, in the straight pose.
///
/// Read from TOML or JSON with [`RobotSpec::load`]; the paper's robots are
/// [`RobotSpec::standard`]. In Rust, change a standard robot, or build one field by field:
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
#[serde(deny_unknown_fields)]
pub struct RobotSpec {
    /// Name, used in reports and files.
    pub name: String,
    /// Gravitational acceleration in the world frame (m/s²), in any direction.
    pub gravity: [f64; 3],
    /// Where the tendons that modules bring along come from.
    pub routing: Routing,
    /// The fixed base.
    pub base: BaseSpec,
    /// The modules, from the base to the tip: 1 to 1000 discs in all.
    pub modules: Vec<ModuleSpec>,
    /// Tendons with routes of their own; in a command they follow the modules' tendons.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub routes: Vec<RouteSpec>,
    /// The cameras that watch the robot.
    pub cameras: Cameras,
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModuleSpec {
    /// Number of discs, at least 1; at most 1000 in all modules together.
    pub discs: usize,
    /// Distance of the first disc's origin from the origin of the body below, along z (m).
    pub first_offset: f64,
    /// Distance of each next disc's origin from the one before, along z (m).
    pub pitch: f64,
    /// Distance of each disc's ball joint below the disc's origin, along the disc's z axis (m).
    /// 0, as in the paper, where the file does not give it; half the pitch makes a chain of discs
    /// converge to a continuous rod fastest.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub joint_below: f64,
    /// Disc radius (m).
    pub radius: f64,
    /// Half of the disc's height (m).
    pub half_height: f64,
    /// Mass of the discs, centred at the disc's origin.
    pub mass: MassSpec,
    /// Tendon holes in the disc frame, at z = 0.
    pub holes: Holes,
    /// Viscous damping of each ball joint (N m s/rad). Has no effect on an equilibrium.
    pub damping: PerDisc<f64>,
    /// Armature inertia of each ball joint (kg m²). Has no effect on an equilibrium.
    pub armature: PerDisc<f64>,
    /// Elastic backbone; joints without one turn freely.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backbone: Option<PerDisc<Backbone>>,
    /// Soft limit of each joint's turn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<PerDisc<Limit>>,
    /// The tendons that the module brings along, one for each of its holes; none where the file
    /// does not give them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tendons: Option<TendonSpec>,
}

/// One value for all discs of a module, or one for each, from the lowest to the highest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected one value, or a list with one per disc"
)]
pub enum PerDisc<T> {
    /// The same for every disc.
    Uniform(T),
    /// One value per disc.
    Each(Vec<T>),
}

impl<T> PerDisc<T> {
    /// The value of the module's disc `index`; `None` when the list is too short.
    pub fn of_disc(&self, index: usize) -> Option<&T> {
        match self {
            Self::Uniform(value) => Some(value),
            Self::Each(values) => values.get(index),
        }
    }
}

/// Tendon holes of a body, x and y in its frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a list of [x, y] in metres, or { radius = metres, angles = [radians] }"
)]
pub enum Holes {
    /// Each hole's x and y (m).
    At(Vec<[f64; 2]>),
    /// Holes on a circle around the z axis.
    Circle(HoleCircle),
}

/// Holes on a circle around the z axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HoleCircle {
    /// Radius of the circle (m).
    pub radius: f64,
    /// Angle of each hole from the x axis, about z (rad).
    pub angles: Vec<f64>,
}

impl Holes {
    /// Number of holes.
    pub fn count(&self) -> usize {
        match self {
            Self::At(holes) => holes.len(),
            Self::Circle(circle) => circle.angles.len(),
        }
    }

    /// The holes' x and y in the body's frame (m).
    pub fn positions(&self) -> Vec<[f64; 2]> {
        match self {
            Self::At(holes) => holes.clone(),
            Self::Circle(HoleCircle { radius, angles }) => (angles.iter())
                .map(|angle| [radius * angle.cos(), radius * angle.sin()])
                .collect(),
        }
    }
}

/// Mass of a module's discs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MassSpec {
    /// Density of the solid cylinder that the disc is (kg/m³).
    Density(PerDisc<f64>),
    /// Mass and moments of inertia of each disc.
    Rigid(PerDisc<RigidMass>),
}

/// Mass and moments of inertia of a disc about its origin, where its centre of mass is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigidMass {
    /// Mass (kg).
    pub mass: f64,
    /// Moments of inertia about the disc's x, y and z axes (kg m²).
    pub inertia: [f64; 3],
}

/// Elastic backbone of one joint. With `R` the joint's rotation and `R0` that of its rest bend, the
/// energy is `1/2 phi' K phi`, `phi = log(R0' R)`, `K` diagonal in the disc's axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backbone {
    /// Bending stiffness about the disc's x and y axes (N m/rad).
    pub bending: [f64; 2],
    /// Torsion stiffness about the disc's z axis (N m/rad).
    pub torsion: f64,
    /// Rotation vector of the joint at rest (rad); straight where the file does not give it.
    #[serde(default, skip_serializing_if = "is_straight")]
    pub rest: [f64; 3],
}

impl Backbone {
    /// The same stiffness (N m/rad) about every axis, straight at rest.
    pub fn isotropic(stiffness: f64) -> Self {
        Self {
            bending: [stiffness; 2],
            torsion: stiffness,
            rest: [0.0; 3],
        }
    }

    /// A piece of a round rod, straight at rest: bending stiffness `E I / h` and torsion stiffness
    /// `G J / h` of length `h` (m), for Young's and shear moduli `E`, `G` (Pa) and the rod's radius
    /// (m).
    pub fn round_rod(youngs_modulus: f64, shear_modulus: f64, radius: f64, length: f64) -> Self {
        let second_moment = std::f64::consts::FRAC_PI_4 * radius.powi(4);
        Self {
            bending: [youngs_modulus * second_moment / length; 2],
            torsion: shear_modulus * 2.0 * second_moment / length,
            rest: [0.0; 3],
        }
    }
}

/// Soft limit of a joint: beyond the angle it is pushed back like a spring.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limit {
    /// Largest free angle between the disc and the body below, bending and torsion together (rad).
    pub angle: f64,
    /// Stiffness beyond it (N m/rad).
    pub stiffness: f64,
}

/// A tendon and its drive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TendonSpec {
    /// What a command means to the tendon.
    pub drive: Drive,
    /// Smallest and largest command (m, or N for a tension drive).
    pub range: [f64; 2],
    /// Whether the tendon can push.
    #[serde(default, skip_serializing_if = "is_bilateral")]
    pub pull: Pull,
    /// Axial stiffness of the tendon itself (N/m), in series with the servo's; inextensible where
    /// the file does not give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axial_stiffness: Option<f64>,
    /// Friction in the holes; none where the file does not give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<Friction>,
}

/// What a command means to a tendon of length `L`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// A rest length `c` (m), through the servo's gain kp (N/m): the tension is `kp (L - c)`.
    Gain(f64),
    /// The length itself (m): `L = c`, by whatever tension it takes.
    Length,
    /// The tension (N), whatever the length.
    Tension,
}

/// Whether a tendon can push.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pull {
    /// It pulls and pushes, as MuJoCo's position actuator does.
    #[default]
    Bilateral,
    /// It only pulls, and is slack when shorter than commanded.
    TensionOnly,
}

/// Friction of a tendon in its holes (capstan law): over a hole at which it turns by the angle
/// `theta`, its tension may change by a factor up to `exp(mu theta)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// Coefficient of friction `mu`.
    pub coefficient: f64,
    /// Stiffness of a sticking contact (N/m): before it slips, the tendon gives way by the friction
    /// force divided by this.
    #[serde(default = "contact_stiffness")]
    pub contact_stiffness: f64,
}

/// A tendon with a route of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RouteSpec {
    /// The holes it goes through, from the servo to where it is fastened; at least two.
    pub through: Vec<Waypoint>,
    /// The tendon.
    pub tendon: TendonSpec,
}

/// A hole on a tendon's route, in files `[body, hole]`: the hole's number in its body's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Waypoint(pub Body, pub usize);

/// A body of the robot; in files `"base"`, or the disc's number counted from the base.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "BodyName", into = "BodyName")]
pub enum Body {
    /// The fixed base.
    Base,
    /// Disc `i`, from 0 at the base.
    Disc(usize),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "expected \"base\" or a disc's number")]
enum BodyName {
    Disc(usize),
    Name(String),
}

impl TryFrom<BodyName> for Body {
    type Error = String;

    fn try_from(name: BodyName) -> Result<Self, String> {
        match name {
            BodyName::Disc(index) => Ok(Self::Disc(index)),
            BodyName::Name(name) if name == "base" => Ok(Self::Base),
            BodyName::Name(name) => Err(format!(
                "unknown body `{name}`: expected \"base\" or a disc's number"
            )),
        }
    }
}

impl From<Body> for BodyName {
    fn from(body: Body) -> Self {
        match body {
            Body::Base => Self::Name("base".to_owned()),
            Body::Disc(index) => Self::Disc(index),
        }
    }
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

    /// What each tendon is specified as, in a command's order: modules share one among their tendons.
    pub fn tendons(&self) -> Vec<&TendonSpec> {
        let of_modules =
            (self.modules.iter()).filter_map(|m| Some((m.tendons.as_ref()?, m.holes.count())));
        let of_modules = of_modules.flat_map(|(tendon, count)| std::iter::repeat_n(tendon, count));
        (of_modules.chain(self.routes.iter().map(|route| &route.tendon))).collect()
    }

    /// Holes of a body (m); `None` for a disc that the robot does not have.
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

fn is_straight(rest: &[f64; 3]) -> bool {
    *rest == [0.0; 3]
}

fn is_bilateral(pull: &Pull) -> bool {
    *pull == Pull::Bilateral
}

fn contact_stiffness() -> f64 {
    1e5
}
