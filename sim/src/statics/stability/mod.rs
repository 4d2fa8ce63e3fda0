//! What kind of equilibrium a robot is in.
//!
//! A descent decides by the inertia of the Hessian ([`Factor::definiteness`]), and the smallest stiffness is its smallest
//! eigenvalue ([`smallest_eigenvalue`]): both take O(n). Where lengths are commanded, what counts is
//! the Hessian on the turns that keep them: the second-order conditions of constrained minimisation
//! (Nocedal and Wright, Numerical Optimization, ch. 12.5), with the tensions as multipliers. The
//! descent asks more: its Hessian is that of the augmented Lagrangian, the same on these turns.
//!
//! Where loads have no potential, no energy decides: a column that a force follows stands until two of its modes meet in
//! one frequency, and then swings ever wider (Beck, Zeitschrift fuer angewandte Mathematik und Physik 3, 1952). There the
//! linearised motion is examined ([`SmallMotionRates`]), with the robot's own inertia and damping; where it cannot be, the
//! Jacobian alone.
//!
//! [`Factor::definiteness`]: crate::factor::Factor::definiteness

use nalgebra::Vector3;

use super::Equilibrium;
use super::descent::Descent;
use super::verdict::{Examined, Stability, Verdict};
use crate::dynamics::{SmallMotion, SmallMotionRates};
use crate::energy::following::{add_forces, add_moments, follows};
use crate::energy::{DeadForces, Expansion, Potential};
use crate::factor::{
    Definiteness, HeldLengths, LoadedMatrix, MARGIN, smallest_eigenvalue, smallest_real_part,
};
use crate::robot::{Command, Drive, Loads, Pull, Robot, Tendon};
use crate::tendon::Posture;

/// Stretch, as a share of a tendon's length, that is not told from none.
const SLACK_ROUNDING: f64 = 1e-12;
/// Stiffness (N m/rad) that the moments left on the joints may feign, for each N m of the largest and each joint: a robot that
/// turns freely about an axis has a mode without stiffness, whose eigenvalue is what the residual makes of it.
const OF_RESIDUAL: f64 = 10.0;

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
        let resolution = self.resolution();
        self.factor.definiteness(&self.expansion, resolution)
    }

    /// A stiffness (N m/rad) that is not told from zero.
    fn resolution(&self) -> f64 {
        let joints = self.expansion.joint_blocks.len() as f64;
        (self.tolerance).max(OF_RESIDUAL * joints * self.expansion.residual())
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

impl Verdict {
    /// That where a descent stands under loads without a potential, `motion` being of a robot that can move.
    pub fn under_loads(
        descent: &Descent,
        command: &[f64],
        loads: &Loads,
        motion: Option<&mut SmallMotionRates>,
    ) -> Self {
        let expansion = &descent.expansion;
        let margin = descent.resolution().max(MARGIN * expansion.scale());
        let q = &descent.iterate.configuration;
        let undamped = (motion.as_ref()).is_some_and(|motion| motion.without_damping());
        let found = motion.and_then(|motion| motion.examine(q, command, loads, margin));
        let (stability, growth) = match found {
            None => {
                let matrix = LoadedMatrix {
                    loads,
                    share: 1.0,
                    posture: &descent.iterate.posture,
                    expansion,
                };
                return Self {
                    stability: of_jacobian(&matrix, margin),
                    examined: Examined::Statics,
                    growth: None,
                    undamped: false,
                };
            }
            Some(SmallMotion::Bounded) => (Stability::Stable, None),
            Some(SmallMotion::Drifts) => (Stability::Neutral, None),
            Some(SmallMotion::Grows(growth)) if growth.angular_frequency == 0.0 => {
                (Stability::Unstable, Some(growth))
            }
            Some(SmallMotion::Grows(growth)) => (Stability::Flutter, Some(growth)),
        };
        Self {
            stability,
            examined: Examined::Motion,
            growth,
            undamped,
        }
    }
}

/// By the real parts of the Jacobian's eigenvalues, those up to `margin` (N m/rad) not told from zero. Takes O(n).
fn of_jacobian(matrix: &LoadedMatrix, margin: f64) -> Stability {
    if matrix.has_positive_part(margin) {
        return Stability::Stable;
    }
    match smallest_real_part(matrix, &HeldLengths::default()) {
        Some(smallest) if smallest > margin => Stability::Stable,
        Some(smallest) if smallest >= -margin => Stability::Neutral,
        _ => Stability::Unstable,
    }
}

impl Robot {
    /// The smallest stiffness (N m/rad) of the robot in an equilibrium of `command` and `loads`, that
    /// of its softest mode: the smallest eigenvalue of the energy's Hessian by the joints' turns, on
    /// those turns that keep the commanded lengths of taut inextensible tendons. With moments or forces
    /// that turn with their disc, the smallest real part of the Jacobian's eigenvalues. Positive at a
    /// stable equilibrium, infinite where commanded lengths leave the joints no freedom, `NaN` if it
    /// cannot be computed.
    ///
    /// The tensions of the tendons whose length is commanded are those of the equilibrium. Takes O(n) for each step of an iteration
    /// that takes 10 to 100. With moments or forces that turn with their disc its error is 1e-9 of the Jacobian's size, and up to
    /// a percent of the figure where such loads are so large that the eigenvalues are ill-conditioned: it says how stiff the robot is,
    /// and [`Equilibrium::stability`] whether it stays.
    ///
    /// # Panics
    /// As [`Robot::settle`], or if the equilibrium is of a robot with other numbers of discs or tendons.
    pub fn smallest_stiffness(
        &self,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
    ) -> f64 {
        let held: Vec<bool> = (self.tendons().iter().enumerate())
            .map(|(t, tendon)| tendon.holds_length() && !equilibrium.is_slack(t, tendon))
            .collect();
        let (posture, mut expansion) = self.expanded(command, loads, equilibrium);
        let columns = match held.contains(&true) {
            true => expansion.dense_columns(),
            false => Vec::new(),
        };
        let gradients: Vec<&[_]> = (columns.iter().zip(&held))
            .filter_map(|((_, slopes), held)| held.then_some(slopes.as_slice()))
            .collect();
        let Some(lengths) = HeldLengths::new(&gradients) else {
            return f64::NAN;
        };
        // Springs along them, as stiff as the rest, resist no turn that keeps their lengths.
        let scale = expansion.scale();
        let columns_of = columns.iter().zip(&held).enumerate();
        for (t, ((_, slopes), _)) in columns_of.filter(|(_, (_, held))| **held) {
            let lever = slopes.iter().map(Vector3::norm_squared).fold(0.0, f64::max);
            expansion.weights[t] = if lever > 0.0 { scale / lever } else { 0.0 };
        }
        let smallest = if loads.wrenches().iter().any(follows) {
            let matrix = LoadedMatrix {
                loads,
                share: 1.0,
                posture: &posture,
                expansion: &expansion,
            };
            smallest_real_part(&matrix, &lengths)
        } else {
            smallest_eigenvalue(&expansion, &lengths)
        };
        smallest.unwrap_or(f64::NAN)
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

#[cfg(test)]
mod tests;
