//! By what physics a simulated robot follows its tendons.

/// How a robot follows its tendons.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Physics {
    /// From equilibrium to equilibrium.
    #[default]
    AtRest,
    /// From equilibrium to equilibrium, with friction of the tendons in their holes.
    WithFriction {
        /// Coefficient of friction.
        coefficient: f64,
    },
    /// With inertia and damping.
    InMotion {
        /// Time step (s).
        timestep: f64,
        /// Coefficient of friction of the tendons in their holes; `None` for those of the robot's file.
        friction: Option<f64>,
    },
}

impl Physics {
    /// The coefficient of friction of all tendons, where it is not that of the robot's file.
    pub fn friction(self) -> Option<f64> {
        match self {
            Self::AtRest => None,
            Self::WithFriction { coefficient } => Some(coefficient),
            Self::InMotion { friction, .. } => friction,
        }
    }
}
