//! What the user writes: the scene's specification.

use serde::{Deserialize, Serialize};

use super::SceneError;
use super::checks::is_compliance;
use super::contact_law::ContactLaw;
use super::error::{called, refuse};
use super::joint_spec::JointSpec;
use super::shape_spec::{
    BoxInFile, HalfSpaceInFile, MeshInFile, PipeInFile, RoundInFile, ShapeSpec, SphereInFile,
};

/// Compliance of an obstacle whose file gives none (m/N).
const COMPLIANCE: f64 = 1e-6;
/// Its colour.
const COLOR: [u8; 3] = [150, 140, 125];
/// Fields that give a shape.
const SHAPES: &str = "half_space, box, sphere, capsule, cylinder, pipe, mesh";

/// Obstacles around a robot, as a file has them (`docs/scene-files.md` has every field). Read by [`load`](Self::load) or
/// [`from_toml`](Self::from_toml), written by [`to_toml`](Self::to_toml). A [`Scene`](super::Scene) is what it is compiled
/// into: values are checked there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SceneInFile", into = "SceneInFile")]
pub struct SceneSpec {
    /// The obstacles, in the order of their numbers.
    pub obstacles: Vec<ObstacleSpec>,
    /// Whether the robot touches itself.
    pub self_contact: SelfContact,
    /// How contacts push in motion.
    pub contact_law: ContactLaw,
    /// What the product of a contact's force and of its surfaces' distance is at rest (J).
    pub smoothing: f64,
}

/// Whether discs of a robot touch each other. Neighbours never do: those of the paper's robots overlap wherever the robot bends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SelfContact {
    /// They pass through each other.
    Ignored,
    /// They press each other.
    Touching {
        /// How far their surfaces give way for each newton (m/N).
        compliance: f64,
        /// Coefficient of friction, along paths and in motion.
        friction: f64,
    },
}

impl Default for SelfContact {
    fn default() -> Self {
        Self::Touching {
            compliance: COMPLIANCE,
            friction: 0.0,
        }
    }
}

impl SelfContact {
    pub(super) fn check(self) -> Result<(), SceneError> {
        match self {
            Self::Touching { compliance, .. } if !is_compliance(compliance) => {
                Err(SceneError::SelfContact { compliance })
            }
            Self::Touching { friction, .. } if !is_compliance(friction) => {
                Err(SceneError::SelfFriction { friction })
            }
            Self::Touching { .. } | Self::Ignored => Ok(()),
        }
    }

    /// Coefficient of friction between discs.
    pub fn friction(self) -> f64 {
        match self {
            Self::Touching { friction, .. } => friction,
            Self::Ignored => 0.0,
        }
    }
}

/// An obstacle, as a file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct ObstacleSpec {
    /// Name, no other obstacle's; `obstacle 0`, by its number, where the file gives none.
    pub name: String,
    /// Shape, in the obstacle's frame.
    pub shape: ShapeSpec,
    /// Origin of the obstacle's frame in the world (m).
    pub position: [f64; 3],
    /// Orientation of that frame: a quaternion (w, x, y, z), normalised on use.
    pub orientation: [f64; 4],
    /// How far the surface gives way for each newton (m/N).
    pub compliance: f64,
    /// Coefficient of friction.
    pub friction: f64,
    /// Colour under full light.
    pub color: [u8; 3],
    /// Mass of an obstacle that can move (kg); `None` for one that is fixed.
    pub mass: Option<f64>,
    /// Velocity of its frame's origin (m/s) and angular velocity (rad/s) with which it starts, world axes; 0 of what is fixed.
    pub velocity: [f64; 3],
    /// See `velocity`.
    pub angular_velocity: [f64; 3],
    /// The one motion that it has; `None` for one that moves freely, or is fixed.
    pub joint: Option<JointSpec>,
}

impl ObstacleSpec {
    /// An obstacle of a shape at the origin of the world, all else as where a file does not give it.
    pub fn new(name: &str, shape: ShapeSpec) -> Self {
        Self {
            name: name.to_owned(),
            shape,
            position: [0.0; 3],
            orientation: upright(),
            compliance: COMPLIANCE,
            friction: 0.0,
            color: COLOR,
            mass: None,
            velocity: [0.0; 3],
            angular_velocity: [0.0; 3],
            joint: None,
        }
    }
}

/// A [`SceneSpec`] as files have it.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneInFile {
    // A value, so that it is written before the tables.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    self_contact: Option<SelfContactInFile>,
    #[serde(default, skip_serializing_if = "is_usual")]
    contact_law: ContactLaw,
    #[serde(default, skip_serializing_if = "is_none")]
    smoothing: f64,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    obstacle: Vec<ObstacleInFile>,
}

/// `self_contact = "ignored"`, or a table with compliance and friction.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "\"ignored\", or { compliance = ..., friction = ... } (m/N)"
)]
pub(super) enum SelfContactInFile {
    Word(SelfContactWord),
    Table(SelfContactTable),
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum SelfContactWord {
    Ignored,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SelfContactTable {
    #[serde(default = "usual_compliance")]
    compliance: f64,
    #[serde(default, skip_serializing_if = "is_none")]
    friction: f64,
}

fn usual_compliance() -> f64 {
    COMPLIANCE
}

/// A table `[[obstacle]]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table [[obstacle]]")]
pub(super) struct ObstacleInFile {
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(default, skip_serializing_if = "is_origin")]
    position: [f64; 3],
    #[serde(default = "upright", skip_serializing_if = "is_upright")]
    orientation: [f64; 4],
    #[serde(default = "compliance")]
    compliance: f64,
    #[serde(default, skip_serializing_if = "is_zero")]
    friction: f64,
    #[serde(default = "color")]
    color: [u8; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    mass: Option<f64>,
    #[serde(default, skip_serializing_if = "is_origin")]
    velocity: [f64; 3],
    #[serde(default, skip_serializing_if = "is_origin")]
    angular_velocity: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    joint: Option<JointSpec>,
    #[serde(skip_serializing_if = "Option::is_none")]
    half_space: Option<HalfSpaceInFile>,
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    cuboid: Option<BoxInFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sphere: Option<SphereInFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    capsule: Option<RoundInFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cylinder: Option<RoundInFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pipe: Option<PipeInFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh: Option<MeshInFile>,
}

impl TryFrom<SceneInFile> for SceneSpec {
    type Error = SceneError;

    fn try_from(file: SceneInFile) -> Result<Self, SceneError> {
        let obstacles = file.obstacle.into_iter().enumerate();
        let obstacles = obstacles.map(|(index, obstacle)| obstacle.spec(index));
        Ok(Self {
            obstacles: obstacles.collect::<Result<_, _>>()?,
            self_contact: (file.self_contact).map_or(SelfContact::default(), Into::into),
            contact_law: file.contact_law,
            smoothing: file.smoothing,
        })
    }
}

impl From<SelfContactInFile> for SelfContact {
    fn from(file: SelfContactInFile) -> Self {
        match file {
            SelfContactInFile::Word(SelfContactWord::Ignored) => Self::Ignored,
            SelfContactInFile::Table(SelfContactTable {
                compliance,
                friction,
            }) => Self::Touching {
                compliance,
                friction,
            },
        }
    }
}

impl From<SelfContact> for SelfContactInFile {
    fn from(contact: SelfContact) -> Self {
        match contact {
            SelfContact::Ignored => Self::Word(SelfContactWord::Ignored),
            SelfContact::Touching {
                compliance,
                friction,
            } => Self::Table(SelfContactTable {
                compliance,
                friction,
            }),
        }
    }
}

impl ObstacleInFile {
    fn spec(self, index: usize) -> Result<ObstacleSpec, SceneError> {
        let obstacle = called(Some(index), self.name.as_deref());
        let shape = self.shape(&obstacle)?;
        Ok(ObstacleSpec {
            name: self.name.unwrap_or_else(|| format!("obstacle {index}")),
            shape,
            position: self.position,
            orientation: self.orientation,
            compliance: self.compliance,
            friction: self.friction,
            color: self.color,
            mass: self.mass,
            velocity: self.velocity,
            angular_velocity: self.angular_velocity,
            joint: self.joint,
        })
    }

    /// Its one shape.
    fn shape(&self, obstacle: &str) -> Result<ShapeSpec, SceneError> {
        let pipe = self.pipe.as_ref().map(|pipe| pipe.spec(obstacle));
        let found = [
            self.half_space.as_ref().map(|_| ShapeSpec::HalfSpace),
            (self.cuboid.as_ref()).map(|&BoxInFile { size }| ShapeSpec::Box { size }),
            (self.sphere.as_ref()).map(|&SphereInFile { radius }| ShapeSpec::Sphere { radius }),
            (self.capsule.as_ref())
                .map(|&RoundInFile { radius, length }| ShapeSpec::Capsule { radius, length }),
            (self.cylinder.as_ref())
                .map(|&RoundInFile { radius, length }| ShapeSpec::Cylinder { radius, length }),
            pipe.transpose()?,
            self.mesh.clone().map(ShapeSpec::from),
        ];
        let mut found: Vec<ShapeSpec> = found.into_iter().flatten().collect();
        match found.pop() {
            Some(shape) if found.is_empty() => Ok(shape),
            last => Err(SceneError::Shapes {
                obstacle: obstacle.to_owned(),
                found: found.iter().chain(&last).map(ShapeSpec::field).collect(),
                expected: SHAPES.to_owned(),
            }),
        }
    }
}

impl From<MeshInFile> for ShapeSpec {
    fn from(mesh: MeshInFile) -> Self {
        match mesh {
            MeshInFile::File { file, scale } => Self::Mesh { file, scale },
            MeshInFile::Numbers {
                vertices,
                triangles,
            } => Self::Triangles {
                vertices,
                triangles,
            },
        }
    }
}

impl PipeInFile {
    fn spec(&self, obstacle: &str) -> Result<ShapeSpec, SceneError> {
        let radius = self.radius;
        let given = match (self.length, &self.path) {
            (Some(length), None) => return Ok(ShapeSpec::Pipe { radius, length }),
            (None, Some(path)) => {
                let path = path.clone();
                return Ok(ShapeSpec::PipeAlong { radius, path });
            }
            (Some(_), Some(_)) => "given with `length` and `path`",
            (None, None) => "given without `length` and `path`",
        };
        Err(refuse(
            obstacle,
            "pipe",
            given,
            "one of `length` and `path`",
        ))
    }
}

impl From<SceneSpec> for SceneInFile {
    fn from(spec: SceneSpec) -> Self {
        let own = spec.self_contact;
        Self {
            self_contact: (own != SelfContact::default()).then(|| own.into()),
            contact_law: spec.contact_law,
            smoothing: spec.smoothing,
            obstacle: spec.obstacles.into_iter().map(Into::into).collect(),
        }
    }
}

impl From<ObstacleSpec> for ObstacleInFile {
    fn from(spec: ObstacleSpec) -> Self {
        let mut file = Self {
            name: Some(spec.name),
            position: spec.position,
            orientation: spec.orientation,
            compliance: spec.compliance,
            friction: spec.friction,
            color: spec.color,
            mass: spec.mass,
            velocity: spec.velocity,
            angular_velocity: spec.angular_velocity,
            joint: spec.joint,
            half_space: None,
            cuboid: None,
            sphere: None,
            capsule: None,
            cylinder: None,
            pipe: None,
            mesh: None,
        };
        match spec.shape {
            ShapeSpec::HalfSpace => file.half_space = Some(HalfSpaceInFile {}),
            ShapeSpec::Box { size } => file.cuboid = Some(BoxInFile { size }),
            ShapeSpec::Sphere { radius } => file.sphere = Some(SphereInFile { radius }),
            ShapeSpec::Capsule { radius, length } => {
                file.capsule = Some(RoundInFile { radius, length });
            }
            ShapeSpec::Cylinder { radius, length } => {
                file.cylinder = Some(RoundInFile { radius, length });
            }
            ShapeSpec::Pipe { radius, length } => {
                let (length, path) = (Some(length), None);
                file.pipe = Some(PipeInFile {
                    radius,
                    length,
                    path,
                });
            }
            ShapeSpec::PipeAlong { radius, path } => {
                let (length, path) = (None, Some(path));
                file.pipe = Some(PipeInFile {
                    radius,
                    length,
                    path,
                });
            }
            ShapeSpec::Mesh { file: name, scale } => {
                file.mesh = Some(MeshInFile::File { file: name, scale });
            }
            ShapeSpec::Triangles {
                vertices,
                triangles,
            } => {
                file.mesh = Some(MeshInFile::Numbers {
                    vertices,
                    triangles,
                });
            }
        }
        file
    }
}

fn upright() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

fn is_upright(orientation: &[f64; 4]) -> bool {
    *orientation == upright()
}

fn is_usual(law: &ContactLaw) -> bool {
    *law == ContactLaw::default()
}

fn is_none(smoothing: &f64) -> bool {
    *smoothing == 0.0
}

fn is_origin(position: &[f64; 3]) -> bool {
    *position == [0.0; 3]
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn compliance() -> f64 {
    COMPLIANCE
}

fn color() -> [u8; 3] {
    COLOR
}
