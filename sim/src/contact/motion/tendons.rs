//! Inextensible tendons of commanded length in the velocity problem: one-sided springs, as contacts are.
//!
//! Without contacts such a tendon has the impulse `p0 = h t0` in the step (`dynamics::held`), and is too long by `e` at its end. Where
//! contacts change how fast it shortens by `d`, its impulse is `p = max(0, k (e / h - d))`, `k = h² K`, or without the bound for one
//! that pushes as well. The problem has what contacts change of it, `p - p0`.

use nalgebra::Vector3;

use super::touch::DiscVelocities;
use crate::dynamics::{HeldLength, Stepper};

/// Error of the rate at which a tendon shortens (m/s): rounding.
const SAME_RATE: f64 = 1e-13;

/// A tendon of commanded length in a step.
#[derive(Clone, Debug)]
pub(super) struct HeldTendon {
    /// Moments of a unit impulse on the discs (m).
    pub moments: Vec<Vector3<f64>>,
    /// `k` (kg), and `e / h` (m/s).
    inertance: f64,
    speed: f64,
    only_pulls: bool,
    /// `p0` (N s).
    free: f64,
    /// `d` (m/s), and the change of the impulse that the rates are of (N s).
    pub velocity: f64,
    pub impulse: f64,
}

/// The change of a tendon's impulse (N s), and by what a change of its velocity diminishes it (kg).
#[derive(Clone, Copy, Debug)]
pub(super) struct TendonLaw {
    pub impulse: f64,
    pub inertance: f64,
}

impl HeldTendon {
    /// Those of the step that `stepper` has begun.
    pub fn all(stepper: &Stepper) -> impl Iterator<Item = Self> {
        let h = stepper.timestep();
        stepper.held_lengths().map(move |held| {
            let HeldLength {
                slopes,
                stiffness,
                tension,
                excess,
                only_pulls,
            } = held;
            let above = slopes.iter().skip(1).copied();
            let above = above.chain([Vector3::zeros()]);
            Self {
                moments: (slopes.iter().zip(above))
                    .map(|(own, above)| above - own)
                    .collect(),
                inertance: h * h * stiffness,
                speed: excess / h,
                only_pulls,
                free: h * tension,
                velocity: 0.0,
                impulse: 0.0,
            }
        })
    }

    /// Forgets what contacts changed.
    pub fn reset(&mut self) {
        (self.velocity, self.impulse) = (0.0, 0.0);
    }

    /// The impulse in the step (N s).
    pub fn whole(&self) -> f64 {
        match self.law().inertance == 0.0 {
            true => 0.0,
            false => self.free + self.impulse,
        }
    }

    /// What the tendon does at its velocity.
    pub fn law(&self) -> TendonLaw {
        self.law_at(self.velocity)
    }

    pub fn law_at(&self, velocity: f64) -> TendonLaw {
        let pulled = self.inertance * (self.speed - velocity);
        let (pulled, inertance) = match self.only_pulls && pulled <= 0.0 {
            true => (0.0, 0.0),
            false => (pulled, self.inertance),
        };
        TendonLaw {
            impulse: pulled - self.free,
            inertance,
        }
    }

    /// How fast it shortens as discs move so (m/s).
    pub fn shortening(&self, velocities: &DiscVelocities) -> f64 {
        let moved = self.moments.iter().zip(&velocities.0);
        moved.map(|(moment, (turn, _))| moment.dot(turn)).sum()
    }

    /// Whether its impulse is that of its velocity, to a tolerance (N s) or rounding.
    pub fn is_solved(&self, tolerance: f64) -> bool {
        let error = self.law().impulse - self.impulse;
        error.abs() <= tolerance + self.inertance * SAME_RATE
    }
}
