//! Scenes: obstacles around a robot, which is not one of them.
//!
//! A [`SceneSpec`] is what the user writes, a TOML file beside that of the robot (`docs/scene-files.md`). A [`Scene`] is what
//! it is compiled into: [`Obstacle`]s with a shape, a pose in the world, and what their surface is like. Cameras see it by
//! [`Visuals::add_scene`](crate::render::Visuals::add_scene).
//!
//! ```
//! use std::path::Path;
//! use tdcr_sim::scene::Scene;
//!
//! let text = "
//!     [[obstacle]]
//!     name = 'post'
//!     cylinder = { radius = 0.01, length = 0.4 }
//!     position = [0.05, 0.0, 0.2]
//! ";
//! let scene = Scene::from_toml(text, Path::new("."))?;
//! assert_eq!(scene.find("post"), Some(0));
//! # Ok::<(), tdcr_sim::scene::SceneError>(())
//! ```

mod checks;
mod compile;
mod contact_law;
mod distance;
mod error;
mod joint_spec;
mod nearest;
mod obstacle;
mod read;
mod shape_spec;
mod spec;
mod whole;

#[cfg(feature = "rapier")]
pub(crate) use checks::{LARGEST_LENGTH, LARGEST_SPEED};
pub use compile::ObstacleShape;
pub use contact_law::{ContactLaw, Impedance};
pub use error::SceneError;
pub use joint_spec::{HingeSpec, JointSpec, SliderSpec};
pub use nearest::Nearest;
pub use obstacle::Obstacle;
pub use shape_spec::ShapeSpec;
pub use spec::{ObstacleSpec, SceneSpec, SelfContact};

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use compile::Sources;
use error::called;

/// Most obstacles of a scene: pictures label each by a number of its own.
const MOST_OBSTACLES: usize = 10_000;
/// Largest smoothing of contacts (J).
const LARGEST_SMOOTHING: f64 = 1.0;

/// Obstacles around a robot, valid and with names of their own, whether the robot touches itself, how contacts push in motion, and how
/// smoothly they do at rest.
/// Clones share the obstacles.
/// The default is the scene in which nothing is touched.
#[derive(Clone, Debug)]
pub struct Scene {
    obstacles: Arc<[Obstacle]>,
    self_contact: SelfContact,
    contact_law: ContactLaw,
    smoothing: f64,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            obstacles: Arc::default(),
            self_contact: SelfContact::Ignored,
            contact_law: ContactLaw::default(),
            smoothing: 0.0,
        }
    }
}

impl Scene {
    /// A scene of obstacles, whose numbers are their places in the list, from 0.
    ///
    /// # Errors
    /// [`SceneError::Count`] for more than 10,000 obstacles, [`SceneError::Name`] for two of one name, [`SceneError::Field`]
    /// for a value that no obstacle can have.
    pub fn new(obstacles: Vec<Obstacle>) -> Result<Self, SceneError> {
        check_count(obstacles.len())?;
        for (index, obstacle) in obstacles.iter().enumerate() {
            obstacle.check(&called(Some(index), Some(&obstacle.name)))?;
        }
        check_names(obstacles.iter().map(|obstacle| obstacle.name.as_str()))?;
        Ok(Self {
            obstacles: obstacles.into(),
            self_contact: SelfContact::default(),
            ..Self::default()
        })
    }

    /// The same scene with other obstacles.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_obstacles(&self, obstacles: Vec<Obstacle>) -> Result<Self, SceneError> {
        Ok(Self {
            obstacles: Self::new(obstacles)?.obstacles,
            ..self.clone()
        })
    }

    /// The obstacles with these numbers alone, in this order.
    pub(crate) fn part(&self, numbers: &[usize]) -> Self {
        let obstacles = numbers.iter().map(|&number| self.obstacles[number].clone());
        Self {
            obstacles: obstacles.collect(),
            ..self.clone()
        }
    }

    /// The same scene for robots that touch themselves so.
    ///
    /// # Errors
    /// [`SceneError::SelfContact`] for a compliance, [`SceneError::SelfFriction`] for a friction below 0 or not finite.
    pub fn with_self_contact(self, self_contact: SelfContact) -> Result<Self, SceneError> {
        self_contact.check()?;
        Ok(Self {
            self_contact,
            ..self
        })
    }

    /// The same scene without friction between discs.
    pub(crate) fn without_own_friction(mut self) -> Self {
        if let SelfContact::Touching { friction, .. } = &mut self.self_contact {
            *friction = 0.0;
        }
        self
    }

    /// The same scene with contacts that push so in motion.
    ///
    /// # Errors
    /// [`SceneError::ContactLaw`] for a relaxation time outside of 0 to 1 s, and parameters that MuJoCo's contacts cannot have.
    pub fn with_contact_law(self, contact_law: ContactLaw) -> Result<Self, SceneError> {
        contact_law.check()?;
        Ok(Self {
            contact_law,
            ..self
        })
    }

    /// The same scene with surfaces that push each other at rest already from afar: the product of a contact's force and of the distance
    /// of its surfaces, which is 0 in exact contact, is `smoothing` (J). So equilibria are smooth functions of obstacles that are not yet
    /// touched. Motions, and paths with friction ([`ContactPath`](crate::tendon_friction::ContactPath)), have exact contact.
    ///
    /// # Errors
    /// [`SceneError::Smoothing`] for one outside of 0 to 1 J.
    pub fn with_smoothing(self, smoothing: f64) -> Result<Self, SceneError> {
        match (0.0..=LARGEST_SMOOTHING).contains(&smoothing) {
            true => Ok(Self { smoothing, ..self }),
            false => Err(SceneError::Smoothing(smoothing)),
        }
    }

    /// The scene that is written as `spec`; meshes with relative paths are in `folder`.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`SceneError::Mesh`] for an STL file that cannot be read, [`SceneError::Shape`] for a shape that
    /// there is not.
    pub fn compile(spec: SceneSpec, folder: &Path) -> Result<Self, SceneError> {
        check_count(spec.obstacles.len())?;
        check_names(spec.obstacles.iter().map(|obstacle| obstacle.name.as_str()))?;
        let mut sources = Sources::new(folder);
        let obstacles = spec.obstacles.into_iter().enumerate();
        let obstacles = obstacles.map(|(index, spec)| {
            let obstacle = called(Some(index), Some(&spec.name));
            Obstacle::compile(spec, &obstacle, &mut sources)
        });
        let scene = Self {
            obstacles: obstacles.collect::<Result<_, _>>()?,
            ..Self::default()
        };
        (scene.with_self_contact(spec.self_contact)?)
            .with_contact_law(spec.contact_law)?
            .with_smoothing(spec.smoothing)
    }

    /// The obstacles, by their numbers.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// The same, to be moved in place. Clones that share them keep theirs.
    pub(crate) fn obstacles_mut(&mut self) -> &mut [Obstacle] {
        Arc::make_mut(&mut self.obstacles)
    }

    /// The obstacles that have a mass, so that they move, with their numbers: the scene's objects, in this order.
    pub fn objects(&self) -> impl Iterator<Item = (usize, &Obstacle)> {
        let obstacles = self.obstacles.iter().enumerate();
        obstacles.filter(|(_, obstacle)| obstacle.mass.is_some())
    }

    /// Whether robots touch themselves.
    pub fn self_contact(&self) -> SelfContact {
        self.self_contact
    }

    /// How contacts push in motion.
    pub fn contact_law(&self) -> ContactLaw {
        self.contact_law
    }

    /// What the product of a contact's force and of its surfaces' distance is at rest (J); 0 for exact contact.
    pub fn smoothing(&self) -> f64 {
        self.smoothing
    }

    /// The number of the obstacle with a name; `None` if there is none.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.obstacles
            .iter()
            .position(|obstacle| obstacle.name == name)
    }

    /// What a file says to give this scene. Orientations are normalised; meshes have the names by which they were read.
    ///
    /// # Errors
    /// [`SceneError::Unwritten`] for a mesh or a pipe that was made in memory.
    pub fn spec(&self) -> Result<SceneSpec, SceneError> {
        let obstacles = self.obstacles.iter().enumerate();
        let obstacles = obstacles
            .map(|(index, obstacle)| obstacle.spec(&called(Some(index), Some(&obstacle.name))));
        Ok(SceneSpec {
            obstacles: obstacles.collect::<Result<_, _>>()?,
            self_contact: self.self_contact,
            contact_law: self.contact_law,
            smoothing: self.smoothing,
        })
    }
}

fn check_count(found: usize) -> Result<(), SceneError> {
    let most = MOST_OBSTACLES;
    match found <= most {
        true => Ok(()),
        false => Err(SceneError::Count { found, most }),
    }
}

fn check_names<'a>(names: impl Iterator<Item = &'a str>) -> Result<(), SceneError> {
    let mut first = HashMap::new();
    for (index, name) in names.enumerate() {
        if let Some(before) = first.insert(name, index) {
            return Err(SceneError::Name {
                name: name.to_owned(),
                obstacles: [before, index],
            });
        }
    }
    Ok(())
}
