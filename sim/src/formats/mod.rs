//! Robots in files: their own (TOML, JSON), and those of other tools ([`mjcf`], [`urdf`]).
//!
//! [`RobotSpec::load`](crate::robot::RobotSpec::load) and [`Robot::load`](crate::robot::Robot::load) read
//! any of them, by the name of a standard robot or by a path, and refuse with a [`RobotFileError`]. What a
//! file of another tool says besides becomes a [`Note`].
//!
//! Exchange keeps meanings: a file that says something that a robot cannot have is refused with its line. What changes neither
//! motion nor equilibria becomes a note, as do contacts, mocap bodies and cameras that move. What a MuJoCo model lets touch is read as a
//! scene of its own ([`load_scene`]). An exported
//! model's time step is stable about its keyframe, by the exact criterion for MuJoCo's Euler integrator. URDF has no tendons:
//! an element `<tdcr>` holds the robot's own file, and is believed only where links and joints say the same.
//!
//! | | reads | writes |
//! |---|---|---|
//! | TOML, JSON | [`RobotSpec::load`](crate::robot::RobotSpec::load) | serde, as [`RobotSpec`](crate::robot::RobotSpec) is `Serialize` |
//! | MJCF | [`mjcf::import`] | [`mjcf::export`] |
//! | URDF | [`urdf::import`] | [`urdf::export`] |
//!
//! ```
//! use tdcr_sim::formats::mjcf;
//! use tdcr_sim::robot::{Payload, RobotSpec};
//!
//! let spec = RobotSpec::load("2m")?;
//! let xml = mjcf::export(&spec, &mjcf::ExportOptions::default())?;
//! let imported = mjcf::import_text(&xml)?;
//! assert_eq!(imported.spec.disc_count(), spec.disc_count());
//! assert_eq!(imported.payload, Payload::default());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod exchange;
mod layout;
mod load;
mod load_scene;
mod missing;
pub mod mjcf;
mod sketch;
pub mod urdf;
mod xml;

pub use exchange::{ExportError, ImportError, Imported, Note, Place};
pub(crate) use exchange::{is_inertia, negative};
pub(crate) use layout::{DiscLayout, DiscMass, Layout, ring_around};
pub use load::{RobotFileError, with_table};
pub use load_scene::{SceneFileError, load_scene};
pub use missing::MissingFields;
pub use sketch::{Sketch, SketchError, SketchedBackbone, SketchedServos};
