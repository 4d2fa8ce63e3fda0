//! Objects: obstacles of a scene that have a mass, and so move.
//!
//! Rapier owns them (feature `rapier`): their motion, and their contacts with what is fixed and with each other. What a robot does to
//! them is found by the robot's own step ([`ContactStepper`](crate::contact::ContactStepper)), which asks a `World` for the bodies as
//! they stand, and gives it the motions of those that the robot touches.
//!
//! ```
//! use tdcr_sim::objects::ObjectState;
//! use tdcr_sim::scene::Obstacle;
//!
//! let ball = Obstacle::sphere("ball", 0.02)?.at([0.0, 0.0, 0.4]).with_mass(0.05)?;
//! let state = ObjectState::at_rest(&ball);
//! assert_eq!(state.pose.translation.vector.z, 0.4);
//! # Ok::<(), tdcr_sim::scene::SceneError>(())
//! ```

mod state;
#[cfg_attr(
    not(feature = "rapier"),
    allow(
        dead_code,
        reason = "what joints leave is asked for by rapier's world alone"
    )
)]
mod twist;

#[cfg(not(feature = "rapier"))]
mod absent;
#[cfg(feature = "rapier")]
mod joints;
#[cfg(feature = "rapier")]
mod shapes;
#[cfg(feature = "rapier")]
mod world;

#[cfg(not(feature = "rapier"))]
pub(crate) use absent::World;
pub use state::{ObjectError, ObjectState};
pub(crate) use twist::{Body, Meeting, Twist};
#[cfg(feature = "rapier")]
pub(crate) use world::World;
