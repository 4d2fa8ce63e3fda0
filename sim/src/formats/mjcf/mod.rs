//! Robots as MuJoCo models: MJCF files written and read.
//!
//! [`export`] writes models that MuJoCo 2.2.2 and every later version load, and in which MuJoCo
//! computes what this library computes: the same masses, forces of joints and tendons, and sites.
//! [`import`] reads models of the same family: a chain of bodies on ball joints, or on hinges at one
//! place, with tendons through sites.
//!
//! | here | MuJoCo |
//! |---|---|
//! | disc | body with a ball joint, `pos` the disc's offset, joint `pos` below the origin |
//! | ball joints [on hinges](crate::robot::RobotSpec::on_hinges), if so asked | hinges about x, y and z |
//! | hinges | hinges, `springref` their rest; the body's orientation is that at the angles 0 |
//! | density, rigid mass | cylinder with `density`, `inertial` |
//! | backbone | `stiffness` of the joint; its rest bend is the body's orientation |
//! | bending unlike torsion | a hinge about each softer axis, in series with the ball joint |
//! | hole, route | site, spatial tendon |
//! | gain or elastic length drive | `position` actuator, `kp` the series stiffness |
//! | tension drive | `motor` with `gear="-1"` |
//! | tension only | `forcerange` with 0 as its upper end |
//! | cameras | cameras; the resolution is that of the offscreen buffer |
//! | equilibrium under a command | keyframe `settled` |
//! | bead that touches | sphere without mass, class `bead` |
//! | obstacle | geom of the world, class `obstacle` |
//!
//! MuJoCo's XML parser limits how deep bodies nest: 2.2.2 reads 95 discs, 4.0 reads 495.
//!
//! The time step is stable about the keyframe's pose (see [`ExportOptions::timestep`]). MuJoCo takes the
//! stiffness of joints and tendons explicitly with every integrator, so a stiff rod needs short steps.
//!
//! A joint whose rest is bent has its configuration counted from there: MuJoCo's joint quaternion
//! is `R0' R`.

mod actuator;
mod attributes;
mod body;
mod body_joint;
mod chain;
mod check;
mod collision;
mod disc;
mod document;
mod export;
mod frame;
mod import;
mod joint;
mod joint_element;
mod keyframe;
mod mass;
mod obstacles;
mod options;
mod part;
mod scene;
mod stage;
mod view;
mod write;
mod written_joint;

pub use export::{export, export_notes, hinge_notes};
pub use import::{import, import_text};
pub use obstacles::scene_notes;
pub use options::{ExportOptions, Integrator};
pub use part::{Part, export_part};
pub use scene::{ImportedScene, import_scene, import_scene_text};

pub(crate) use write::{escape, is_xml_char};
