//! Tendon-driven continuum robots (TDCRs): their statics and dynamics, both with derivatives, and the
//! virtual RGB-D cameras that see them.
//!
//! A [`Robot`](robot::Robot) is a chain of discs on ball joints, pulled by tendons that run through
//! holes in the discs. A [`Command`](robot::Command) gives each tendon a rest length; under it the
//! robot settles into an [`Equilibrium`](statics::Equilibrium) of tendon tensions and weight, where
//! its potential energy has a minimum, and a [`Stepper`](dynamics::Stepper) computes the motion on
//! the way. [`Camera`](camera::Camera)s see the settled robot as
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
//! - [`geometry`]: shapes and solids, and those that a robot consists of.
//! - [`scene`]: obstacles around a robot, from files.
//! - [`chain`]: configurations on SO(3)^n.
//! - [`statics`]: command to equilibrium, one at a time, along paths, in batches and sweeps.
//! - [`symmetry`]: isometries that map a robot to itself, and what they do to its commands.
//! - [`contact`]: equilibria among obstacles, with derivatives.
//! - [`tendon_friction`]: paths of equilibria with friction between tendons and holes.
//! - [`sensitivity`]: derivatives of an equilibrium by commands, loads and physical parameters.
//! - [`curve`]: the backbone between the discs; [`reactions`]: what the joints transmit.
//! - [`dynamics`]: motion in time: steps, rollouts, and their derivatives.
//! - [`simulation`]: one way to drive a robot, at rest, with friction or in motion; [`pose`]: where it is.
//! - [`inverse`]: from a target shape to the command, from measured positions to the robot.
//! - [`camera`]: pinholes and distorted lenses, in rings or placed freely.
//! - [`render`]: RGB-D images and masks by ray casting.
//! - [`cloud`]: back-projection, fusion, voxel grids, samples of fixed size, PLY files.
//! - [`formats`]: robots in files, their own and those of other tools (MJCF, URDF).
//!
//! # What it is not for
//!
//! Contact with surroundings is of robots at rest, and without friction ([`contact`]); discs do not touch each other. Friction of the tendons in
//! their holes acts along quasi-static paths ([`tendon_friction`]) only: [`statics`], [`sensitivity`] and
//! [`dynamics`] leave it out.

#[cfg(test)]
extern crate self as tdcr_sim;

mod backbone;
pub mod camera;
mod capstan;
pub mod chain;
pub mod cloud;
pub mod contact;
pub mod curve;
pub mod dynamics;
mod energy;
mod factor;
pub mod formats;
pub mod geometry;
pub mod inverse;
mod lens;
mod model_tangent;
pub mod objects;
pub mod pose;
pub mod reactions;
pub mod render;
pub mod robot;
pub mod scene;
pub mod sensitivity;
pub mod simulation;
mod solve;
pub mod statics;
pub mod symmetry;
mod tendon;
pub mod tendon_friction;

#[cfg(test)]
#[path = "../tests/common/random_robot.rs"]
mod random_robot;
