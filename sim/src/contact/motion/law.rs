//! How hard a contact pushes as its surfaces approach each other.
//!
//! Over one step both laws come to the same: an impulse `p = k max(0, s - u)` along the normal, `u` the speed at which the surfaces
//! part at the end of the step (m/s). The inertance `k` (kg) and the speed `s` are the law's.

use super::super::law::STIFFEST;
use crate::scene::{ContactLaw, Impedance};

/// Smallest and largest impedance (MuJoCo's `mjMINIMP`, `mjMAXIMP`), and what counts as 0 there (`mjMINVAL`).
const IMPEDANCES: [f64; 2] = [1e-4, 0.9999];
const SMALLEST: f64 = 1e-15;

impl ContactLaw {
    /// Time ahead of touching in which a contact pushes already (s).
    pub(super) fn relaxation(&self) -> f64 {
        match self {
            Self::Compliant { relaxation } => *relaxation,
            Self::Impedance(_) => 0.0,
        }
    }
}

/// The law of one contact over one step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Push {
    /// `k` (kg).
    pub inertance: f64,
    /// `s` (m/s).
    pub speed: f64,
}

impl Push {
    /// Of a spring of a `compliance` (m/N) that is pressed in where the `gap` (m) is below 0, over `timestep` (s).
    pub fn compliant(gap: f64, compliance: f64, relaxation: f64, timestep: f64) -> Self {
        let time = timestep + relaxation;
        Self {
            inertance: timestep * time / compliance.max(STIFFEST),
            speed: -gap / time,
        }
    }
}

impl Impedance {
    /// The law at a `gap` (m) below 0, the surfaces parting at `speed` (m/s), of a body whose inverse inertance is about `mobility`
    /// (1/kg), over `timestep` (s).
    pub(super) fn push(&self, gap: f64, speed: f64, mobility: f64, timestep: f64) -> Push {
        let impedance = self.at(gap);
        let regularisation = ((1.0 - impedance) / impedance * mobility).max(SMALLEST);
        // The reference acceleration is that of a damped spring.
        let highest = self.solimp[1].clamp(IMPEDANCES[0], IMPEDANCES[1]);
        let time = self.solref[0].max(2.0 * timestep);
        let ratio = self.solref[1];
        let stiffness = 1.0 / (highest * time * ratio).powi(2).max(SMALLEST);
        let damping = 2.0 / (highest * time).max(SMALLEST);
        let acceleration = -damping * speed - stiffness * impedance * gap;
        Push {
            inertance: 1.0 / regularisation,
            speed: speed + timestep * acceleration,
        }
    }

    /// The impedance at a gap.
    fn at(&self, gap: f64) -> f64 {
        let [first, last, width, middle, power] = self.solimp;
        let clamp = |value: f64| value.clamp(IMPEDANCES[0], IMPEDANCES[1]);
        let (first, last, middle) = (clamp(first), clamp(last), clamp(middle));
        let (width, power) = (width.max(0.0), power.max(1.0));
        if first == last || width <= SMALLEST {
            return 0.5 * (first + last);
        }
        let x = gap.abs() / width;
        if x >= 1.0 {
            return last;
        }
        if x == 0.0 {
            return first;
        }
        // Two powers that meet at the middle with one slope.
        let y = if power == 1.0 {
            x
        } else if x <= middle {
            x.powf(power) / middle.powf(power - 1.0)
        } else {
            1.0 - (1.0 - x).powf(power) / (1.0 - middle).powf(power - 1.0)
        };
        first + y * (last - first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_impedance_rises_from_the_first_to_the_last_without_a_jump() {
        let law = Impedance::default();
        assert_eq!(
            (law.at(0.0), law.at(-0.001), law.at(-1.0)),
            (0.9, 0.95, 0.95)
        );
        // At the midpoint the powers meet: half-way.
        assert!((law.at(-0.0005) - 0.925).abs() < 1e-15);
        let (below, above) = (law.at(-0.0005 + 1e-12), law.at(-0.0005 - 1e-12));
        assert!((below - above).abs() < 1e-9);
    }

    #[test]
    fn a_spring_at_rest_pushes_by_its_compliance() {
        let (timestep, compliance) = (2e-3, 1e-6);
        let push = Push::compliant(-1e-5, compliance, 1e-3, timestep);
        let force = push.inertance * push.speed / timestep;
        assert!((force - 10.0).abs() < 1e-12);
    }
}
