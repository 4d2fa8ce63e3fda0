//! Motion in time: stepping, rollouts, and their derivatives.
//!
//! A [`State`] is a configuration and the rates of its joints, in MuJoCo's coordinates for ball
//! joints and hinges. A [`Stepper`] moves a state by one time step under a command and loads; the command may
//! change at every step. Steps take O(n) time for `n` discs and allocate nothing.
//!
//! ```
//! use tdcr_sim::dynamics::{Integrator, State, Stepper};
//! use tdcr_sim::robot::{Loads, Robot};
//!
//! let robot = Robot::load("2m")?;
//! let mut stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler)?;
//! let mut state = State::straight(&robot);
//! for step in 0..1_000 {
//!     let pull = 0.03 * f64::from(step) / 1_000.0;
//!     let command = robot.command(&[0.02, 0.02, pull, 0.01, 0.01, pull])?;
//!     stepper.step(&mut state, &command, &Loads::default())?;
//! }
//! println!("tip at {:?} m", state.positions(&robot)[9]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Model
//!
//! Discs are rigid bodies with their centres of mass at their origins; joints have armature and
//! viscous damping; tendons are massless and take the tension that their drives and stiffnesses give
//! at each instant. A payload is a point mass on the distal disc: it has inertia as well as weight.
//! Friction of the tendons in their holes is that of [`crate::tendon_friction`] (`rubbing`), in steps of first order. What the contacts bear
//! is not in the state: a stepper remembers it where it last led the robot ([`Stepper::tendon_profiles`]), and begins from any other
//! state with none loaded. Commanded lengths of inextensible tendons are constraints
//! (`held`), which steps of first order hold. A command is what acts on the tendons:
//! where servos have a lag or a largest rate, [`Servos`] say what acts. A fluid around the robot holds its discs back (`drag`), in
//! steps of first order.
//!
//! # Steps
//!
//! [`Integrator::SemiImplicitEuler`] is MuJoCo's step with implicit joint damping, so trajectories agree to rounding. All
//! vectors of a joint are in world axes about its own centre: armature and damping keep their form there, nothing changes
//! frames along the chain, and no inertia is a difference of large numbers, although armatures are much larger than the
//! discs' own inertias. Derivatives come from composite bodies about the base's origin.
//!
//! Implicit integrators solve with `M + d D + k K` in O(n) (the room `factor`). They count the steps that they
//! could not take as they should ([`Stepper::fallbacks`]).

mod acceleration;
mod adjoint;
mod articulated;
mod blocks;
mod composite;
mod drag;
mod equations;
mod error;
mod expansion;
mod forces;
mod growth;
mod held;
mod hinge_reach;
mod holding;
mod implicit;
mod inertia_cotangent;
mod integrator;
mod jacobians;
mod linearise;
mod links;
mod midpoint;
mod obstacles;
mod pushes;
mod reacting;
mod reaction;
mod rollout;
mod rubbing;
mod runge_kutta;
mod servos;
mod small_motions;
mod spatial;
mod state;
mod step_adjoint;
mod stepper;
mod surroundings;
mod symmetric;
mod tangent;

pub(crate) use adjoint::gradient_by;
pub use adjoint::{RolloutGradient, StateCotangent, rollout_gradient};
pub use equations::MotionTerms;
pub use error::DynamicsError;
pub use growth::Growth;
pub(crate) use growth::{SmallMotion, SmallMotionRates};
pub(crate) use held::HeldLength;
pub use integrator::{Integrator, LARGEST_TURN};
pub use linearise::{Linearisation, Lineariser};
pub use obstacles::{ObstacleGradient, ObstacleTangent};
pub(crate) use pushes::{OppositePush, Push, PushingObstacle};
pub(crate) use reacting::Resistance;
pub(crate) use reaction::Reaction;
pub use rollout::{Rollout, rollout_batch};
pub(crate) use rubbing::MAX_REVISIONS;
pub use servos::Servos;
pub(crate) use small_motions::SmallMotions;
pub use state::{Energy, State};
pub(crate) use step_adjoint::StepAdjoint;
pub use stepper::Stepper;
pub(crate) use surroundings::Surroundings;
pub(crate) use tangent::tangent_by;
pub use tangent::{RolloutDirection, StateTangent, rollout_tangent};
