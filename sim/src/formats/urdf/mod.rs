//! Robots as URDF files, written and read.
//!
//! URDF has no ball joints: each becomes three revolute joints about x, y and z of the disc below,
//! in this order, so `R = Rx Ry Rz`; the two links between them have a millionth of the disc's mass
//! and inertia, as simulators refuse links without. All three joints have the ball joint's damping,
//! which is the same force while the angle of y is small.
//!
//! | link | joint to it | |
//! |---|---|---|
//! | `world` | | |
//! | `base` | `base`, fixed | the base's pose |
//! | `disc0_x`, `disc0_y`, `disc0`, .. | `disc0_x`, `disc0_y`, `disc0_z`, .. | frame in the ball joint's centre |
//!
//! Tendons, holes, drives, backbones, limits, armature, gravity and cameras have no form in URDF.
//! They stand in an element `<tdcr>` within `<robot>`, which other tools pass over: the text of the
//! robot's own file (TOML). [`import`] takes the robot from there, and insists that links and joints
//! say the same; without that element it reads a chain without tendons.

mod check;
mod export;
mod import;

pub use export::export;
pub use import::{import, import_text};

/// Tag of the element that holds what URDF cannot say.
const EXTENSION: &str = "tdcr";
/// Mass and inertia of the links within a ball joint, as a share of the disc's.
const LINK_SHARE: f64 = 1e-6;
