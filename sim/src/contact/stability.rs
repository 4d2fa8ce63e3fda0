//! Whether an equilibrium among obstacles is stable, and the way out of one that is not.

use nalgebra::Vector3;

use super::equations::Equations;
use crate::factor::{Curvature, HeldLengths, MARGIN, dot, smallest_by_solving};
use crate::statics::Stability;

/// Turn of the joint that turns most when a saddle is left (rad).
const SADDLE_TURN: f64 = 0.05;
/// Steps of inverse iteration.
const INVERSE_STEPS: usize = 30;

impl Equations {
    /// The kind of the equilibrium at the iterate, where the Hessian is known.
    pub fn stability(&mut self) -> Stability {
        let margin = MARGIN * self.expansion.scale();
        if self.factorise(-margin) == Some(Curvature::Positive) {
            Stability::Stable
        } else if self.factorise(margin) == Some(Curvature::Positive) {
            Stability::Neutral
        } else {
            Stability::Unstable
        }
    }

    /// The smallest eigenvalue of the Hessian at the iterate, contacts included, on the turns that keep the commanded lengths of
    /// taut tendons (N m/rad); `NaN` where it is not positive definite.
    pub fn smallest_stiffness(&mut self) -> f64 {
        if self.factorise(0.0) != Some(Curvature::Positive) {
            return f64::NAN;
        }
        let tendons = self.robot.tendons().iter().enumerate();
        let columns = self.expansion.dense_columns();
        let gradients: Vec<&[_]> = tendons
            .filter(|(t, tendon)| tendon.holds_length() && self.expansion.weights[*t] > 0.0)
            .map(|(t, _)| columns[t].1.as_slice())
            .collect();
        let Some(held) = HeldLengths::new(&gradients) else {
            return f64::NAN;
        };
        let n = self.iterate.step.len();
        let none = vec![Vector3::zeros(); n];
        let solve = |rhs: &[Vector3<f64>], solution: &mut [Vector3<f64>]| {
            self.lu.solve(rhs, &none, solution);
        };
        smallest_by_solving(n, &held, solve).unwrap_or(f64::NAN)
    }

    /// Moves along the Hessian's eigenvector of the smallest eigenvalue, found by inverse iteration with a shift (Golub and Van Loan,
    /// Matrix Computations, ch. 8.2.2). Whether one was found.
    pub fn leave_saddle(&mut self) -> bool {
        let mut shift = MARGIN * self.expansion.scale();
        while self.factorise(shift) != Some(Curvature::Positive) {
            shift *= 4.0;
            if !shift.is_finite() {
                return false;
            }
        }
        let n = self.iterate.step.len();
        let none = vec![Vector3::zeros(); n];
        let mut mode: Vec<_> = (0..n)
            .map(|joint| Vector3::new(1.0, -0.6, 0.3) * (1.0 + (joint as f64).sin()))
            .collect();
        for _ in 0..INVERSE_STEPS {
            self.lu.solve(&mode, &none, &mut self.iterate.step);
            let length = dot(&self.iterate.step, &self.iterate.step).sqrt();
            for (mode, step) in mode.iter_mut().zip(&self.iterate.step) {
                *mode = step / length;
            }
        }
        self.iterate.step.copy_from_slice(&mode);
        let most = crate::solve::largest_turn(&mode);
        // Of numbers that are not finite there is no largest.
        if !most.is_finite() || most == 0.0 {
            return false;
        }
        self.iterate
            .step
            .iter_mut()
            .for_each(|turn| *turn *= SADDLE_TURN / most);
        self.keep_clear();
        self.iterate.start_step();
        self.iterate.move_by(1.0);
        true
    }
}
