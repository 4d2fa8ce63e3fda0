//! An obstacle, built by hand or from a file.

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Translation3, Vector3};

use super::SceneError;
use super::checks::{self, LARGEST_LENGTH, not_negative, orientation, point, pose, velocity};
use super::compile::{ObstacleShape, Sources};
use super::error::{called, refuse};
use super::joint_spec::JointSpec;
use super::shape_spec::ShapeSpec;
use super::spec::ObstacleSpec;
use crate::geometry::{Cuboid, Kind, Shape, Triangles};

/// Half sides of the box that a half space is seen as (m).
const HALF_SPACE: [f64; 3] = [1.0, 1.0, 0.001];
/// Longest name (characters).
const LONGEST_NAME: usize = 100;

/// A thing in the world that a robot may touch.
///
/// ```
/// use tdcr_sim::scene::{Obstacle, Scene};
///
/// let ball = Obstacle::sphere("ball", 0.02)?.at([0.05, 0.0, 0.2]).with_friction(0.3)?;
/// let scene = Scene::new(vec![Obstacle::half_space("floor"), ball])?;
/// assert_eq!(scene.obstacles()[1].name, "ball");
/// # Ok::<(), tdcr_sim::scene::SceneError>(())
/// ```
///
/// Fields may be set to anything: [`Scene::new`](super::Scene::new) checks them all.
#[derive(Clone, Debug)]
pub struct Obstacle {
    /// Name, no other obstacle's.
    pub name: String,
    /// Shape, in the obstacle's frame (m). A mesh or a pipe is written to files as what it was made from: for another one,
    /// make another obstacle.
    pub shape: ObstacleShape,
    /// Pose of that frame in the world (m).
    pub pose: Isometry3<f64>,
    /// How far the surface gives way for each newton (m/N), 0 or above.
    pub compliance: f64,
    /// Coefficient of friction, 0 or above.
    pub friction: f64,
    /// Colour under full light.
    pub color: [u8; 3],
    /// Mass of an obstacle that can move (kg); `None` for one that is fixed.
    pub mass: Option<f64>,
    /// Velocity of its frame's origin (m/s) and angular velocity (rad/s) with which it starts, world axes; 0 of what is fixed.
    pub velocity: Vector3<f64>,
    /// See `velocity`.
    pub angular_velocity: Vector3<f64>,
    /// The one motion that it has; `None` for one that moves freely, or is fixed.
    pub joint: Option<JointSpec>,
    /// What a mesh or a pipe was made from.
    source: Option<ShapeSpec>,
}

impl Obstacle {
    /// An obstacle of a shape at the origin of the world, fixed, without friction, with a compliance of 1e-6 m/N. A mesh or a
    /// pipe given so cannot be written to a file.
    pub fn new(name: &str, shape: ObstacleShape) -> Self {
        let spec = ObstacleSpec::new(name, ShapeSpec::HalfSpace);
        Self {
            name: spec.name,
            shape,
            pose: Isometry3::identity(),
            compliance: spec.compliance,
            friction: spec.friction,
            color: spec.color,
            mass: spec.mass,
            velocity: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
            joint: None,
            source: None,
        }
    }

    /// The shape that it is seen as, and its pose in the world (m): a pipe as its mesh, a half space as a box of 2 m by 2 m by 2 mm
    /// whose top is the plane about the origin of its frame.
    pub fn seen(&self) -> (Shape, Isometry3<f64>) {
        match &self.shape {
            ObstacleShape::Solid(shape) => (shape.clone(), self.pose),
            ObstacleShape::Pipe(pipe) => (pipe.mesh(), self.pose),
            ObstacleShape::HalfSpace => {
                let half = HALF_SPACE.into();
                let middle = Translation3::new(0.0, 0.0, -HALF_SPACE[2]);
                (Shape(Kind::Cuboid(Cuboid { half })), self.pose * middle)
            }
        }
    }

    /// The surface of what it is [seen](Self::seen) as, in the world.
    pub fn surface(&self) -> Triangles {
        let (shape, pose) = self.seen();
        shape.triangles(&pose)
    }

    /// All that is below the obstacle's x-y plane.
    pub fn half_space(name: &str) -> Self {
        Self::new(name, ObstacleShape::HalfSpace)
    }

    /// A box of whole sides (m), about its middle.
    ///
    /// # Errors
    /// [`SceneError::Field`] unless all are above 0 and at most 1e6 m.
    pub fn cuboid(name: &str, size: [f64; 3]) -> Result<Self, SceneError> {
        Self::of(name, ShapeSpec::Box { size })
    }

    /// A sphere of a radius (m).
    ///
    /// # Errors
    /// [`SceneError::Field`] unless it is above 0 and at most 1e6 m.
    pub fn sphere(name: &str, radius: f64) -> Result<Self, SceneError> {
        Self::of(name, ShapeSpec::Sphere { radius })
    }

    /// A capsule about its z axis, of a radius and the distance of its balls' centres (m).
    ///
    /// # Errors
    /// [`SceneError::Field`] unless both are above 0 and at most 1e6 m.
    pub fn capsule(name: &str, radius: f64, length: f64) -> Result<Self, SceneError> {
        Self::of(name, ShapeSpec::Capsule { radius, length })
    }

    /// A cylinder about its z axis, of a radius and a length (m).
    ///
    /// # Errors
    /// [`SceneError::Field`] unless both are above 0 and at most 1e6 m.
    pub fn cylinder(name: &str, radius: f64, length: f64) -> Result<Self, SceneError> {
        Self::of(name, ShapeSpec::Cylinder { radius, length })
    }

    /// A straight pipe of a radius and a length (m).
    ///
    /// # Errors
    /// [`SceneError::Field`] unless both are above 0 and at most 1e6 m; [`SceneError::Shape`] if there is no such pipe.
    pub fn pipe(name: &str, radius: f64, length: f64) -> Result<Self, SceneError> {
        Self::of(name, ShapeSpec::Pipe { radius, length })
    }

    /// A pipe of a radius along a line through points of the obstacle's frame (m).
    ///
    /// # Errors
    /// As [`pipe`](Self::pipe); [`SceneError::Field`] for fewer than 2 points, or more than 20,000.
    pub fn pipe_along(name: &str, radius: f64, path: &[[f64; 3]]) -> Result<Self, SceneError> {
        let path = path.to_vec();
        Self::of(name, ShapeSpec::PipeAlong { radius, path })
    }

    /// A triangle mesh from an STL file, whose numbers times `scale` are metres.
    ///
    /// # Errors
    /// [`SceneError::Mesh`] when the file cannot be read; [`SceneError::Field`] for a scale that is not above 0.
    pub fn mesh(name: &str, file: &Path, scale: f64) -> Result<Self, SceneError> {
        let file = file.to_owned();
        Self::of(name, ShapeSpec::Mesh { file, scale })
    }

    fn of(name: &str, shape: ShapeSpec) -> Result<Self, SceneError> {
        let spec = ObstacleSpec::new(name, shape);
        Self::compile(
            spec,
            &called(None, Some(name)),
            &mut Sources::new(Path::new("")),
        )
    }

    /// The obstacle that is written as `spec`; errors name it `obstacle`.
    pub(super) fn compile(
        spec: ObstacleSpec,
        obstacle: &str,
        sources: &mut Sources,
    ) -> Result<Self, SceneError> {
        let compiled = Self {
            shape: sources.shape(obstacle, &spec.shape)?,
            pose: pose(obstacle, spec.position, spec.orientation)?,
            name: spec.name,
            compliance: spec.compliance,
            friction: spec.friction,
            color: spec.color,
            mass: spec.mass,
            velocity: spec.velocity.into(),
            angular_velocity: spec.angular_velocity.into(),
            joint: spec.joint,
            source: Some(spec.shape),
        };
        compiled.check(obstacle)?;
        Ok(compiled)
    }

    /// The same with its origin at a position in the world (m).
    #[must_use]
    pub fn at(mut self, position: [f64; 3]) -> Self {
        self.pose.translation = Translation3::from(position);
        self
    }

    /// The same with its frame turned to a quaternion (w, x, y, z) in the world, normalised on use.
    ///
    /// # Errors
    /// [`SceneError::Field`] for one of zeros, or not finite.
    pub fn with_orientation(mut self, quaternion: [f64; 4]) -> Result<Self, SceneError> {
        self.pose.rotation = orientation(&called(None, Some(&self.name)), quaternion)?;
        Ok(self)
    }

    /// The same at a pose in the world (m).
    #[must_use]
    pub fn with_pose(mut self, pose: Isometry3<f64>) -> Self {
        self.pose = pose;
        self
    }

    /// The same with a compliance (m/N).
    ///
    /// # Errors
    /// [`SceneError::Field`] unless it is 0 to 1e15.
    pub fn with_compliance(mut self, compliance: f64) -> Result<Self, SceneError> {
        self.compliance = compliance;
        self.checked()
    }

    /// The same with a coefficient of friction.
    ///
    /// # Errors
    /// [`SceneError::Field`] unless it is 0 to 1e15.
    pub fn with_friction(mut self, friction: f64) -> Result<Self, SceneError> {
        self.friction = friction;
        self.checked()
    }

    /// The same in another colour.
    #[must_use]
    pub fn with_color(mut self, color: [u8; 3]) -> Self {
        self.color = color;
        self
    }

    /// The same with a mass (kg), so that it can move.
    ///
    /// # Errors
    /// [`SceneError::Field`] unless it is above 0 and at most 1e9; for a half space.
    pub fn with_mass(mut self, mass: f64) -> Result<Self, SceneError> {
        self.mass = Some(mass);
        self.checked()
    }

    /// The same with the velocity of its frame's origin (m/s) and the angular velocity (rad/s) with which it starts, world axes.
    ///
    /// # Errors
    /// [`SceneError::Field`] for components above 1e4, and where it has no mass.
    pub fn with_velocity(
        mut self,
        linear: [f64; 3],
        angular: [f64; 3],
    ) -> Result<Self, SceneError> {
        (self.velocity, self.angular_velocity) = (linear.into(), angular.into());
        self.checked()
    }

    /// The same with a joint to the world.
    ///
    /// # Errors
    /// [`SceneError::Field`] for numbers that no joint has, and where it has no mass.
    pub fn with_joint(mut self, joint: JointSpec) -> Result<Self, SceneError> {
        self.joint = Some(joint);
        self.checked()
    }

    fn checked(self) -> Result<Self, SceneError> {
        self.check(&called(None, Some(&self.name)))?;
        Ok(self)
    }

    /// Checks every field; errors name it `obstacle`.
    pub(super) fn check(&self, obstacle: &str) -> Result<(), SceneError> {
        self.check_name(obstacle)?;
        self.check_pose(obstacle)?;
        not_negative(obstacle, "compliance", self.compliance)?;
        not_negative(obstacle, "friction", self.friction)?;
        if let Some(mass) = self.mass {
            checks::mass(obstacle, mass)?;
            if matches!(self.shape, ObstacleShape::HalfSpace) {
                return Err(refuse(
                    obstacle,
                    "mass",
                    mass,
                    "none of a half space, which cannot move",
                ));
            }
        }
        self.check_motion(obstacle)?;
        self.check_size(obstacle)
    }

    /// What only an obstacle with a mass has.
    fn check_motion(&self, obstacle: &str) -> Result<(), SceneError> {
        let velocities = [
            ("velocity", self.velocity),
            ("angular_velocity", self.angular_velocity),
        ];
        for (field, value) in velocities {
            velocity(obstacle, field, value.as_ref())?;
            if self.mass.is_none() && value != Vector3::zeros() {
                let found = format!("{:?}", <[f64; 3]>::from(value));
                return Err(refuse(obstacle, field, found, "none without a `mass`"));
            }
        }
        let Some(joint) = &self.joint else {
            return Ok(());
        };
        joint.check(obstacle)?;
        match self.mass {
            Some(_) => Ok(()),
            None => Err(refuse(obstacle, "joint", "given", "none without a `mass`")),
        }
    }

    fn check_name(&self, obstacle: &str) -> Result<(), SceneError> {
        let length = self.name.chars().count();
        let expected = "a name of 1 to 100 characters, none a control character";
        match (1..=LONGEST_NAME).contains(&length) && !self.name.chars().any(char::is_control) {
            true => Ok(()),
            false => Err(refuse(
                obstacle,
                "name",
                format!("{:?}", self.name),
                expected,
            )),
        }
    }

    fn check_pose(&self, obstacle: &str) -> Result<(), SceneError> {
        point(obstacle, "position", self.pose.translation.vector.as_ref())?;
        let rotation = self.pose.rotation;
        match (rotation.norm() - 1.0).abs() < 1e-6 {
            true => Ok(()),
            false => {
                let found = format!("{:?}", [rotation.w, rotation.i, rotation.j, rotation.k]);
                Err(refuse(
                    obstacle,
                    "orientation",
                    found,
                    "a unit quaternion (w, x, y, z)",
                ))
            }
        }
    }

    /// How far the shape reaches from its frame's origin.
    fn check_size(&self, obstacle: &str) -> Result<(), SceneError> {
        let shape = match &self.shape {
            ObstacleShape::HalfSpace => return Ok(()),
            ObstacleShape::Solid(shape) => shape.clone(),
            // Its numbers were checked.
            ObstacleShape::Pipe(_) if self.source.is_some() => return Ok(()),
            ObstacleShape::Pipe(pipe) => pipe.mesh(),
        };
        let reach = shape.middle().abs() + shape.extents(&Matrix3::identity());
        // Rounding of half a side.
        match reach.max() <= LARGEST_LENGTH * (1.0 + 1e-9) {
            true => Ok(()),
            false => {
                let found = format!(
                    "of a shape that reaches {:e} m from its origin",
                    reach.max()
                );
                let field = self.shape_field();
                Err(refuse(obstacle, field, found, "1e6 m at most"))
            }
        }
    }

    fn shape_field(&self) -> &'static str {
        self.shape_spec().map_or("shape", |spec| spec.field())
    }

    /// How a file says its shape; `None` for a mesh or a pipe that was made in memory.
    fn shape_spec(&self) -> Option<ShapeSpec> {
        let source = self.source.clone();
        let of_kind = |source: &ShapeSpec| {
            let pipe = matches!(source, ShapeSpec::Pipe { .. } | ShapeSpec::PipeAlong { .. });
            match &self.shape {
                ObstacleShape::Pipe(_) => pipe,
                _ => matches!(source, ShapeSpec::Mesh { .. } | ShapeSpec::Triangles { .. }),
            }
        };
        self.shape.spec().or_else(|| source.filter(of_kind))
    }

    /// How a file says it; errors name it `obstacle`.
    pub(super) fn spec(&self, obstacle: &str) -> Result<ObstacleSpec, SceneError> {
        self.spec_of(self.shape_spec(), obstacle)
    }

    /// How a file says it without another file: a mesh by its numbers. Errors name it `obstacle`.
    pub(super) fn whole_spec(&self, obstacle: &str) -> Result<ObstacleSpec, SceneError> {
        let shape = self.shape.triangles().or_else(|| self.shape_spec());
        self.spec_of(shape, obstacle)
    }

    fn spec_of(
        &self,
        shape: Option<ShapeSpec>,
        obstacle: &str,
    ) -> Result<ObstacleSpec, SceneError> {
        let shape = shape.ok_or_else(|| SceneError::Unwritten {
            obstacle: obstacle.to_owned(),
        })?;
        let rotation = self.pose.rotation;
        Ok(ObstacleSpec {
            name: self.name.clone(),
            shape,
            position: self.pose.translation.vector.into(),
            orientation: [rotation.w, rotation.i, rotation.j, rotation.k],
            compliance: self.compliance,
            friction: self.friction,
            color: self.color,
            mass: self.mass,
            velocity: self.velocity.into(),
            angular_velocity: self.angular_velocity.into(),
            joint: self.joint,
        })
    }
}
