//! What an exported model has besides the robot.

use crate::render::BaseVisibility;
use crate::robot::Payload;
use crate::scene::Scene;

/// What a model has besides the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportOptions {
    /// Whether the base below the robot is seen.
    pub base: BaseVisibility,
    /// What hangs from the distal disc: a point mass in a body of its own, named `payload`.
    pub payload: Payload,
    /// Time step (s), which must be stable about the keyframe's pose; by default the longest of 2 ms,
    /// 1 ms, 0.5 ms, 0.2 ms, .. that is, and by a margin.
    pub timestep: Option<f64>,
    /// How MuJoCo takes a step.
    pub integrator: Integrator,
    /// The command of the keyframe, in which the robot must settle (m, or N for a tension drive). By
    /// default the middle of every tendon's range, with a little more pull by the first tendon of each
    /// module; if the robot does not settle there, the model has no keyframe.
    pub command: Option<Vec<f64>>,
    /// What the robot can touch. In an empty scene the model has no contacts.
    pub scene: Scene,
}

/// MuJoCo's integrators.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Integrator {
    /// First order, joint damping implicit.
    #[default]
    Euler,
    /// First order, implicit in the velocities but for Coriolis forces. Newer than MuJoCo 2.2.2.
    ImplicitFast,
    /// First order, implicit in the velocities.
    Implicit,
    /// Fourth order, explicit.
    RungeKutta4,
}

impl Integrator {
    /// MuJoCo's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Euler => "Euler",
            Self::ImplicitFast => "implicitfast",
            Self::Implicit => "implicit",
            Self::RungeKutta4 => "RK4",
        }
    }
}

impl Default for ExportOptions {
    /// No base and no payload, a stable step of MuJoCo's Euler integrator, at rest in the middle of
    /// all ranges.
    fn default() -> Self {
        Self {
            base: BaseVisibility::Hidden,
            payload: Payload::default(),
            timestep: None,
            integrator: Integrator::default(),
            command: None,
            scene: Scene::default(),
        }
    }
}
