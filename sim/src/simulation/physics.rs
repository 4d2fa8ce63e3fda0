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
    },
}
