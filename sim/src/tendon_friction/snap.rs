//! Snapping: where a path has no equilibrium nearby, the robot slides on, held back, until it rests.
//!
//! Each joint is held back by a moment against its turn, `drag` times as large, so that the balance has
//! a solution near the last one whatever the stiffness: implicit Euler's steps of a motion whose only
//! resistance is a damping in the joints (viscous stabilisation, as finite-element codes use it at
//! limit points). The drag is set by the turn that a step may make, and vanishes as the robot comes to
//! rest.

use nalgebra::{Matrix3, Vector3};

use super::FrictionPath;
use crate::chain::Configuration;
use crate::energy::Expansion;
use crate::robot::Loads;
use crate::tendon::Posture;

/// Steps before a slide counts as endless.
const MAX_STEPS: usize = 2000;
/// How many times a step may be tried again with more drag.
const MAX_TRIES: usize = 30;

/// A moment on each joint against its turn since `from`.
#[derive(Clone, Debug)]
pub(super) struct Drag {
    /// Moment per turn (N m/rad).
    pub coefficient: f64,
    pub from: Configuration,
}

impl Drag {
    /// Adds the moments in the configuration `q` to the balance. That its derivative is
    /// `coefficient` holds to first order in the turn.
    pub fn add_moments(&self, q: &Configuration, posture: &Posture, expansion: &mut Expansion) {
        for (joint, turn) in self.turns(q).enumerate() {
            let moment = posture.chain.disc(joint) * turn * self.coefficient;
            expansion.joint_gradient[joint] += moment;
            expansion.joint_blocks[joint] += Matrix3::identity() * self.coefficient;
        }
    }

    /// Energy (J) that the drag takes in a step to `q`.
    fn taken(&self, q: &Configuration) -> f64 {
        let squares: f64 = self.turns(q).map(|turn| turn.norm_squared()).sum();
        self.coefficient * squares
    }

    /// The turn of each joint, its disc's own axes (rad).
    fn turns(&self, q: &Configuration) -> impl Iterator<Item = Vector3<f64>> {
        let pairs = self.from.0.iter().zip(&q.0);
        pairs.map(|(from, to)| (from.inverse() * to).scaled_axis())
    }
}

impl FrictionPath {
    /// Slides from the last equilibrium until the robot rests under this command (m or N) and these
    /// loads. Returns whether it comes to rest; where it does not, it is left where it was.
    pub(super) fn snap(&mut self, command: &[f64], loads: &Loads) -> bool {
        let start = self.state.clone();
        let touched = self
            .touching
            .as_deref()
            .map(|touching| touching.state().clone());
        // The drag under which what is unbalanced would turn a joint by what one step may.
        self.retreat();
        self.balance.load(command, loads, &self.state.tendons);
        self.balance.follow(&self.state.tendons);
        let mut drag = self.balance.residual().max(self.balance.tolerance) / self.resolution;
        for _ in 0..MAX_STEPS {
            let Some((turn, taken)) = self.slide(command, loads, &mut drag) else {
                break;
            };
            self.accept();
            self.state.snapped += taken;
            self.balance.drag = None;
            self.balance.follow(&self.state.tendons);
            self.state.equilibrium.residual = self.balance.residual();
            if self.state.equilibrium.residual <= self.balance.tolerance {
                self.state.snaps += 1;
                return true;
            }
            drag *= f64::clamp(turn / (0.8 * self.resolution), 0.1, 1.0);
        }
        self.balance.drag = None;
        let (iterations, substeps) = (self.state.equilibrium.iterations, self.state.substeps);
        self.state = start;
        if let Some((touching, touched)) = self.touching.as_deref_mut().zip(touched) {
            touching.set_state(touched);
        }
        self.state.equilibrium.iterations = iterations;
        self.state.substeps = substeps;
        self.retreat();
        false
    }

    /// One step, with as much more drag as it takes; returns the largest turn of a joint (rad) and the
    /// energy that the drag took (J).
    fn slide(&mut self, command: &[f64], loads: &Loads, drag: &mut f64) -> Option<(f64, f64)> {
        for _ in 0..MAX_TRIES {
            let held = Drag {
                coefficient: *drag,
                from: self.state.equilibrium.configuration.clone(),
            };
            self.balance.drag = Some(held.clone());
            match self.substep(command, loads) {
                Some(turn) if turn <= self.resolution => {
                    return Some((turn, held.taken(&self.balance.iterate.configuration)));
                }
                _ => *drag *= 4.0,
            }
            self.retreat();
        }
        None
    }
}
