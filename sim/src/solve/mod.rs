//! Newton's method with a line search, continuation, and commanded lengths: what the solves for an equilibrium share.
//!
//! A solve says what its equations are as a [`System`]: their residual, the linear solve for Newton's step, and the merit by
//! which the line search accepts a share of it. [`newton`] is the rest.
//!
//! | solve | residual | linear solve | merit |
//! |---|---|---|---|
//! | `statics::descent` | gradient of the energy | factor in O(n), the Hessian made positive definite | energy |
//! | `statics::following` | the same, and loads without a potential | LU in O(n), dense where that is inaccurate | squared residual |
//! | `contact::descent` | the same with contacts | LDL in O(n), made positive definite | energy |
//! | `contact::mixed` | the same with the contacts' forces | LDL in O(n), dense LU where contacts rub | next simplified step |
//! | `tendon_friction::balance` | moments with friction of the tendons | LU in O(n), dense where that is inaccurate | next simplified step |
//! | `tendon_friction::balance::pressed` | the same with contacts | dense LU | next simplified step |

mod continuation;
mod iterate;
mod lengths;

pub(crate) use continuation::Continuation;
pub(crate) use iterate::{Iterate, largest_turn, turn_between};
pub(crate) use lengths::{MAX_CORRECTIONS, correct_rest_lengths, length_errors};

use std::iter::successors;

/// A Newton step that turns no joint by more than this (rad) is taken as it is.
const ROUNDING: f64 = 1e-9;

/// Equations for the configuration of a robot.
pub(crate) trait System {
    /// What the merit needs to know of the linear model that gave a step.
    type Model;
    /// Newton steps at most.
    const MAX_STEPS: usize;
    /// Shares of a step that are tried at most.
    const MAX_TRIALS: usize;

    /// Where the solve stands.
    fn iterate(&mut self) -> &mut Iterate;

    /// Evaluates the equations at the iterate. Whether it solves them within the tolerance.
    fn is_solved(&mut self) -> bool;

    /// Writes Newton's step to [`Iterate::step`], limited in angle by [`Iterate::limit_step`].
    fn newton_step(&mut self) -> Self::Model;

    /// Evaluates the merit at the iterate, which was moved by `share` of the step. Whether it is low
    /// enough there to go on; not if it is no number.
    fn accepts(&mut self, model: &Self::Model, share: f64) -> bool;
}

/// A Newton step that is accepted where the next correction by the same Jacobian is smaller (natural monotonicity test: Deuflhard, Newton
/// Methods for Nonlinear Problems, ch. 3), whatever the units of the equations.
pub(crate) struct Correction {
    /// Largest turn of a joint in the whole step (rad).
    size: f64,
    /// Share of the whole step that is taken at most.
    limit: f64,
}

impl Correction {
    /// A whole step that would turn joints by `size` (rad) at most, of which what turns them by `taken` is taken.
    pub fn new(size: f64, taken: f64) -> Self {
        let limit = if taken < size { taken / size } else { 1.0 };
        Self { size, limit }
    }

    /// Whether a share of it leads to where the next correction turns joints by `next` (rad) at most: much less than it does. Not if
    /// one is no number.
    pub fn improves(&self, share: f64, next: f64) -> bool {
        let enough = next <= (1.0 - 0.25 * share * self.limit) * self.size;
        self.size.is_finite() && (enough || self.size * share < ROUNDING)
    }
}

/// Newton's method with a line search (Nocedal and Wright, Numerical Optimization, ch. 3 and 11.2), from the
/// iterate on. Returns whether the equations are solved, and the number of steps. If they are not, the iterate
/// is where no share of a step was accepted, or where the last of the steps led.
pub(crate) fn newton<S: System>(system: &mut S) -> (bool, usize) {
    let mut steps = 0;
    while !system.is_solved() {
        if steps == S::MAX_STEPS || !line_search(system) {
            return (false, steps);
        }
        steps += 1;
    }
    (true, steps)
}

/// Takes the step, halved until the merit accepts it (backtracking). If it never does, the iterate stays.
fn line_search<S: System>(system: &mut S) -> bool {
    let model = system.newton_step();
    system.iterate().start_step();
    let mut shares = successors(Some(1.0), |share| Some(0.5 * share)).take(S::MAX_TRIALS);
    let accepted = shares.any(|share| {
        system.iterate().move_by(share);
        system.accepts(&model, share)
    });
    if !accepted {
        system.iterate().move_back();
    }
    accepted
}
