//! Tendon-driven continuum robots (TDCRs): their statics, and the virtual RGB-D cameras that see
//! them.
//!
//! A [`Robot`](robot::Robot) is a chain of discs on ball joints, pulled by tendons that run through
//! holes in the discs. A [`Command`](robot::Command) gives each tendon a rest length; under it the
//! robot settles into an [`Equilibrium`](statics::Equilibrium) of tendon tensions and weight, where
//! its potential energy has a minimum. [`Camera`](camera::Camera)s see the settled robot as
//! [`RgbdFrame`](render::RgbdFrame)s, which fuse into a [`PointCloud`](cloud::PointCloud).
//!
//! ```
//! use tdcr_sim::cloud::{Observer, VoxelGrid};
//! use tdcr_sim::render::BaseVisibility;
//! use tdcr_sim::robot::{Loads, Robot};
//!
//! let robot = Robot::load("2m")?;
//! let command = robot.command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])?;
//! let equilibrium = robot.settle(&command, &Loads::payload(0.02)?);
//! assert!(equilibrium.converged);
//! println!("tip at {:?} m", equilibrium.positions[9]);
//!
//! let mut observer = Observer::new(&robot, BaseVisibility::Hidden, VoxelGrid::new(0.002));
//! let cloud = observer.observe(&equilibrium);
//! assert!(cloud.len() > 5_000);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! SI units: metres, kilograms, seconds, newtons, radians. The world's z axis points up. Physics is
//! in `f64`, clouds and depth images in `f32`. Results do not depend on the number of threads.
//!
//! # Modules
//!
//! - [`robot`]: what the user writes, validated and compiled; commands and loads.
//! - [`chain`]: configurations on SO(3)^n.
//! - [`statics`]: command to equilibrium.
//! - [`sensitivity`]: derivatives of equilibria.
//! - [`inverse`]: from shape to command, and from measurements to the robot.
//! - [`camera`]: the pinhole model and rings of cameras.
//! - [`render`]: RGB-D images and masks by ray casting.
//! - [`cloud`]: back-projection, fusion, voxel grids, samples of fixed size, PLY files.
//!
//! # What it is not for
//!
//! Motion in time, contact, friction of the tendons in their holes and elastic backbones are not
//! modelled: the joints are free, and what is computed is where the robot rests.

pub mod camera;
#[cfg(test)]
extern crate self as tdcr_sim;

mod backbone;
pub mod chain;
pub mod cloud;
mod energy;
pub mod inverse;
mod newton;
pub mod render;
pub mod robot;
pub mod sensitivity;
pub mod statics;
mod tendon;
