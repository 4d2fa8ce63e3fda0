//! What kind of equilibrium a robot is in.
//!
//! A descent decides by the inertia of the Hessian ([`Factor::definiteness`]), and the smallest stiffness is its smallest
//! eigenvalue ([`smallest_eigenvalue`]): both take O(n). Where lengths are commanded, what counts is
//! the Hessian on the turns that keep them: the second-order conditions of constrained minimisation
//! (Nocedal and Wright, Numerical Optimization, ch. 12.5), with the tensions as multipliers. The
//! descent asks more: its Hessian is that of the augmented Lagrangian, the same on these turns.
//!
//! [`Factor::definiteness`]: crate::factor::Factor::definiteness

use faer::{Mat, Side};
use serde::Serialize;
use thiserror::Error;

use super::Equilibrium;
use super::descent::Descent;
use crate::energy::following::{add_forces, add_moments, follows, jacobian};
use crate::energy::{DeadForces, Expansion, Potential};
use crate::factor::{Definiteness, MARGIN, has_positive_part, smallest_eigenvalue};
use crate::robot::{Command, Drive, Loads, Pull, Robot, Tendon};
use crate::tendon::Posture;

/// Stretch, as a share of a tendon's length, that is not told from none.
const SLACK_ROUNDING: f64 = 1e-12;
/// Gradients of commanded lengths below this share of the largest are dependent on the others.
const DEPENDENT: f64 = 1e-10;

/// What kind of equilibrium a robot is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stability {
    /// The energy rises in every direction: its Hessian is positive definite. With moments or forces
    /// that turn with their disc: the real parts of the Jacobian's eigenvalues are positive.
    Stable,
    /// The energy falls in no direction to second order, but does not rise in every one: slack tendons
    /// leave discs without weight where they are put, and joints without torsion turn freely. Also
    /// where a tendon is just about to go slack and would have to stay taut for the robot to be stable.
    Neutral,
    /// The energy falls in some direction: a saddle, which the least push makes the robot leave.
    Unstable,
}

/// Why an equilibrium counts as not converged.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum NotSettled {
    /// An equilibrium, but one that no robot stays in.
    #[error(
        "the robot did not settle: it balances in an unstable equilibrium, which the least push makes it leave"
    )]
    Unstable,
    /// A commanded length that the tendon does not reach.
    #[error(
        "the robot did not settle: tendon {tendon} is {length} m long where {commanded} m are commanded"
    )]
    Length {
        /// The tendon, from 0.
        tendon: usize,
        /// Its length (m).
        length: f64,
        /// The length commanded (m).
        commanded: f64,
    },
    /// The residual is above the tolerance.
    #[error(
        "the robot did not settle: residual {residual:e} N m; expected {tolerance:e} N m at most"
    )]
    Moments {
        /// [`Equilibrium::residual`] (N m).
        residual: f64,
        /// [`Robot::moment_tolerance`] (N m).
        tolerance: f64,
    },
}

impl Equilibrium {
    /// Why the robot did not settle; `None` where it did.
    ///
    /// # Panics
    /// If the command or the equilibrium are of another robot, with fewer tendons.
    pub fn failure(&self, robot: &Robot, command: &Command) -> Option<NotSettled> {
        if self.converged {
            return None;
        }
        if self.stability == Some(Stability::Unstable) {
            return Some(NotSettled::Unstable);
        }
        let tolerance = robot.moment_tolerance();
        let off = |t: &usize| {
            let error = self.tendon_lengths[*t] - command.as_slice()[*t];
            let slack = self.is_slack(*t, &robot.tendons()[*t]);
            robot.tendons()[*t].holds_length() && !slack && error.abs() > robot.length_tolerance()
        };
        let missed = (0..robot.tendons().len()).find(off);
        Some(match missed.filter(|_| self.residual <= tolerance) {
            Some(tendon) => NotSettled::Length {
                tendon,
                length: self.tendon_lengths[tendon],
                commanded: command.as_slice()[tendon],
            },
            None => NotSettled::Moments {
                residual: self.residual,
                tolerance,
            },
        })
    }

    /// Whether a tendon hangs slack.
    fn is_slack(&self, tendon: usize, model: &Tendon) -> bool {
        model.pull == Pull::TensionOnly && self.tendon_tensions[tendon] <= 0.0
    }
}

impl Descent {
    /// What kind of equilibrium the robot is in, given the factor of its Hessian. The stiffness of a joint
    /// whose moment the tolerance lets pass is not told from zero. If unstable, the factor has a direction
    /// of negative curvature.
    pub fn stability(&mut self, potential: &Potential) -> Stability {
        let mut on_edge = false;
        for (t, tendon) in potential.robot.tendons().iter().enumerate() {
            on_edge |= self.is_on_edge(potential, t, tendon);
        }
        if on_edge {
            return self.stability_on_edge(potential);
        }
        match self.definiteness() {
            Definiteness::Positive => Stability::Stable,
            Definiteness::Semidefinite => Stability::Neutral,
            Definiteness::Indefinite => Stability::Unstable,
        }
    }

    fn definiteness(&mut self) -> Definiteness {
        self.factor.definiteness(&self.expansion, self.tolerance)
    }

    /// Whether a tendon is just about to go slack: it has stiffness on one side only.
    fn is_on_edge(&self, potential: &Potential, t: usize, tendon: &Tendon) -> bool {
        let length = self.iterate.posture.lengths[t];
        tendon.pull == Pull::TensionOnly
            && tendon.drive != Drive::Tension
            && (length - potential.command[t]).abs() <= SLACK_ROUNDING * length
    }

    /// The same where tendons are about to go slack: the energy's second derivative along a direction
    /// lies between that with all of them slack and that with all of them taut.
    fn stability_on_edge(&mut self, potential: &Potential) -> Stability {
        let bounds = [false, true].map(|taut| {
            for (t, tendon) in potential.robot.tendons().iter().enumerate() {
                if self.is_on_edge(potential, t, tendon) {
                    self.expansion.weights[t] = if taut { tendon.spring() } else { 0.0 };
                }
            }
            self.factor.factorise(&self.expansion, 0.0);
            self.definiteness()
        });
        for (t, tendon) in potential.robot.tendons().iter().enumerate() {
            let state = tendon.state(self.iterate.posture.lengths[t], potential.command[t]);
            self.expansion.weights[t] = state.stiffness;
        }
        match bounds {
            [Definiteness::Positive, _] => Stability::Stable,
            [_, Definiteness::Indefinite] => Stability::Unstable,
            _ => Stability::Neutral,
        }
    }
}

/// What kind of equilibrium one under loads without a potential is; a stiffness up to `resolution` (N m/rad) is not told
/// from zero. Takes O(n) where the symmetric part of the Jacobian is positive definite, otherwise O(n³) for its eigenvalues.
pub(super) fn under_loads(
    loads: &Loads,
    posture: &Posture,
    expansion: &Expansion,
    resolution: f64,
) -> Stability {
    let margin = resolution.max(MARGIN * expansion.scale());
    if has_positive_part(loads, posture, expansion, margin) {
        return Stability::Stable;
    }
    let smallest = smallest_real_part(&jacobian(loads, 1.0, posture, expansion));
    if smallest > margin {
        Stability::Stable
    } else if smallest >= -margin {
        Stability::Neutral
    } else {
        Stability::Unstable
    }
}

/// Smallest real part of an eigenvalue; `NaN` if it cannot be computed.
fn smallest_real_part(matrix: &Mat<f64>) -> f64 {
    let Ok(values) = matrix.eigenvalues() else {
        return f64::NAN;
    };
    let real = values.iter().map(|value| value.re);
    real.fold(f64::INFINITY, |smallest, value| {
        // Not `min`: a NaN must not get lost.
        if smallest <= value { smallest } else { value }
    })
}

impl Robot {
    /// The smallest stiffness (N m/rad) of the robot in an equilibrium of `command` and `loads`, that
    /// of its softest mode: the smallest eigenvalue of the energy's Hessian by the joints' turns, on
    /// those turns that keep the commanded lengths of taut inextensible tendons. With moments or forces
    /// that turn with their disc, the smallest real part of the Jacobian's eigenvalues. Positive at a
    /// stable equilibrium, infinite where commanded lengths leave the joints no freedom, `NaN` if it
    /// cannot be computed.
    ///
    /// The tensions of the tendons whose length is commanded are those of the equilibrium. Takes O(n) but for commanded lengths
    /// and for moments or forces that turn with their disc, which take O(n³).
    ///
    /// # Panics
    /// As [`Robot::settle`], or if the equilibrium is of a robot with other numbers of discs or tendons.
    pub fn smallest_stiffness(
        &self,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
    ) -> f64 {
        let (posture, expansion) = self.expanded(command, loads, equilibrium);
        let held = |t: &usize| {
            self.tendons()[*t].holds_length() && !equilibrium.is_slack(*t, &self.tendons()[*t])
        };
        let held: Vec<usize> = (0..self.tendons().len()).filter(held).collect();
        let symmetric = !loads.wrenches().iter().any(follows);
        if symmetric && held.is_empty() {
            return smallest_eigenvalue(&expansion).unwrap_or(f64::NAN);
        }
        let stiffness = jacobian(loads, 1.0, &posture, &expansion);
        let Some(reduced) = reduce(stiffness, &expansion, &held) else {
            return f64::NAN;
        };
        if reduced.nrows() == 0 {
            return f64::INFINITY;
        }
        match symmetric {
            true => smallest_of_dense(&reduced),
            false => smallest_real_part(&reduced),
        }
    }

    /// The potential's expansion in an equilibrium, with the tensions of held tendons.
    fn expanded(
        &self,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
    ) -> (Posture, Expansion) {
        let mut posture = Posture::new(self);
        posture.place(self, &equilibrium.configuration);
        let mut dead = DeadForces::new(self);
        dead.set(self, loads);
        add_forces(loads, 1.0, &posture, &mut dead);
        let potential = Potential {
            robot: self,
            command: command.as_slice(),
            dead: &dead,
        };
        let mut expansion = Expansion::new(self);
        let mut tensions = vec![0.0; self.tendons().len()];
        for (t, tendon) in self.tendons().iter().enumerate() {
            if tendon.holds_length() {
                tensions[t] = equilibrium.tendon_tensions[t];
            } else {
                let state = tendon.state(posture.lengths[t], command.as_slice()[t]);
                (tensions[t], expansion.weights[t]) = (state.tension, state.stiffness);
            }
        }
        let tension = |tendon: usize, _| tensions[tendon];
        potential.expand_pulled(
            &equilibrium.configuration,
            &posture,
            tension,
            &mut expansion,
        );
        add_moments(loads, 1.0, &posture, &mut expansion);
        (posture, expansion)
    }
}

/// Smallest eigenvalue of a symmetric matrix; `NaN` if it cannot be computed.
fn smallest_of_dense(matrix: &Mat<f64>) -> f64 {
    let eigenvalues = matrix.self_adjoint_eigenvalues(Side::Lower);
    eigenvalues.map_or(f64::NAN, |values| values[0])
}

/// A matrix `3 n x 3 n` by the joints' turns on those turns that keep the lengths of the tendons
/// `held`, in an orthonormal basis of them; `None` if there is no such basis for numbers that are not
/// finite.
fn reduce(matrix: Mat<f64>, expansion: &Expansion, held: &[usize]) -> Option<Mat<f64>> {
    if held.is_empty() {
        return Some(matrix);
    }
    let columns = expansion.dense_columns();
    let gradients = Mat::from_fn(matrix.nrows(), held.len(), |row, column| {
        columns[held[column]].1[row / 3][row % 3]
    });
    let svd = gradients.svd().ok()?;
    let sizes = svd.S().column_vector();
    let count = gradients.ncols().min(gradients.nrows());
    let rank = (0..count)
        .filter(|&i| sizes[i] > DEPENDENT * sizes[0])
        .count();
    let free = svd.U().subcols(rank, matrix.nrows() - rank);
    Some(free.transpose() * &matrix * free)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::chain::Configuration;
    use crate::robot::RobotSpec;

    /// Poses from straight to strongly bent, in equilibrium or not: the Hessian is positive definite in some and not in others.
    #[test]
    fn the_smallest_stiffness_in_o_n_is_that_of_the_dense_hessian() {
        let mut signs = [0; 2];
        for (name, modules) in [("2m", 1), ("2m", 2), ("5m", 5), ("5m", 12)] {
            let mut spec = RobotSpec::standard(name).unwrap();
            let last = spec.modules[spec.modules.len() - 1].clone();
            spec.modules.resize(modules, last);
            let robot = Robot::new(spec).unwrap();
            for (place, payload) in [0.0, 0.03, 0.5, 20.0].into_iter().enumerate() {
                let share = 0.2 * place as f64;
                let values: Vec<f64> = (robot.tendons().iter().enumerate())
                    .map(|(t, tendon)| {
                        let [low, high] = tendon.range;
                        let part = 0.5 + share * (1.7 * t as f64 + share).sin();
                        low + (high - low) * part.clamp(0.0, 1.0)
                    })
                    .collect();
                let command = robot.command(&values).unwrap();
                let loads = Loads::payload(payload).unwrap();
                let settled = robot.settle(&command, &loads);
                let bent = (0..robot.discs().len()).map(|disc| {
                    let turn = Vector3::new(0.3, -0.2, 0.1) * (share * (disc as f64).cos());
                    UnitQuaternion::from_scaled_axis(turn)
                });
                let thrown = Equilibrium {
                    configuration: Configuration(bent.collect()),
                    ..settled.clone()
                };
                for pose in [&settled, &thrown] {
                    let (posture, expansion) = robot.expanded(&command, &loads, pose);
                    let dense = jacobian(&loads, 1.0, &posture, &expansion);
                    let expected = smallest_of_dense(&dense);
                    let found = robot.smallest_stiffness(&command, &loads, pose);
                    let rounding = 1e-12 * expansion.scale();
                    assert!(
                        (found - expected).abs() <= 1e-9 * expected.abs() + rounding,
                        "{name}, {modules} modules, {payload} kg: {found:e}, not {expected:e}"
                    );
                    signs[usize::from(expected > 0.0)] += 1;
                }
            }
        }
        assert!(signs.iter().all(|count| *count > 3), "{signs:?}");
    }
}
