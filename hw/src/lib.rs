//! Servos and RGB-D cameras of tendon-driven continuum robots (TDCRs): the same calls on a desk and in memory.
//!
//! Programs talk to traits: a [`servo`] bus reads and moves many servos, a [`camera`] gives time-stamped
//! [`RgbdFrame`](tdcr_sim::render::RgbdFrame)s. Whatever waits does so on a [`Clock`](clock::Clock), so that a simulated rig
//! runs as fast as it computes.
//!
//! ```
//! use std::time::Duration;
//! use tdcr_hw::clock::{Clock, VirtualClock};
//!
//! let clock = VirtualClock::new();
//! clock.wait_until(Duration::from_secs(3600));
//! assert_eq!(clock.now(), Duration::from_secs(3600)); // An hour, at once.
//! ```
//!
//! # Conventions
//!
//! SI units; positions of servos in ticks ([`Ticks`](servo::Ticks)), temperatures in degrees Celsius.

pub mod camera;
pub mod capture;
pub mod clock;
pub mod dynamixel;
pub mod extrinsics;
pub mod log;
pub mod plan;
pub mod realsense;
pub mod recorded;
pub mod rig;
pub mod serial;
pub mod servo;
pub mod simulated;
pub mod transport;
