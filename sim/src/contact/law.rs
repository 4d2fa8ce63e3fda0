//! The force of a contact by its gap.
//!
//! A contact of compliance `C` is pressed in by `C f` under a force `f`, so the surfaces are `w = g + C f` apart, `g` being the
//! gap between the undeformed shapes. Exact contact is `w >= 0`, `f >= 0`, `f w = 0`; with a barrier `mu` it is `f w = mu`, whose
//! solution is `f = 2 mu / (g + sqrt(g² + 4 C mu))` (an interior-point method: Nocedal and Wright, Numerical Optimization, ch. 19).
//! It has a potential, `C f² / 2 - mu log w`, which is smooth in every gap, and tends to `g² / (2 C)` of the overlap as `mu` does
//! to 0.
//!
//! Contacts farther apart than a reach do not count. Where the barrier stays, as contacts are to be smooth, the line that touches the
//! law there is taken off it, `f(g) - f(R) + k(R) (g - R)` with the stiffness `k`: force and stiffness then begin at 0 (as potentials are
//! shifted and cut off in molecular dynamics: Allen and Tildesley, Computer Simulation of Liquids, ch. 5.2).

use nalgebra::Vector3;

/// Compliances below this count as this (m/N): forces would feel how positions are rounded.
pub(super) const STIFFEST: f64 = 1e-8;

/// Change of a force by the compliance (m/N) of what bears it: none where that counts as the stiffest.
pub(super) fn by_compliance(compliance: f64, change: Vector3<f64>) -> Vector3<f64> {
    match compliance < STIFFEST {
        true => Vector3::zeros(),
        false => change,
    }
}

/// The law of one contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Law {
    /// Barrier `mu` (J).
    pub barrier: f64,
    /// Compliance `C` (m/N), above 0.
    pub compliance: f64,
    /// Gap at which the potential counts from 0 (m).
    pub reach: f64,
    /// What is taken off: the response at the reach.
    tail: Option<Response>,
}

/// How hard contacts are while the robot settles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Hardness {
    /// Barrier (J).
    pub barrier: f64,
    /// Compliance of contacts that are harder (m/N).
    pub softness: f64,
}

impl Hardness {
    /// That of the contacts that there are, with a barrier (J).
    pub fn of_barrier(barrier: f64) -> Self {
        Self {
            barrier,
            softness: 0.0,
        }
    }

    /// The law of a contact whose compliance (m/N) and reach (m) are given.
    pub fn law(self, compliance: f64, reach: f64) -> Law {
        Law::new(self.barrier, compliance.max(self.softness), reach)
    }
}

/// What a contact does at a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Response {
    /// Force (N), the derivative of its energy by the gap with the sign changed.
    pub force: f64,
    /// Second derivative of the energy by the gap (N/m).
    pub stiffness: f64,
    /// Derivative of the force by the compliance, the gap being the same (N²/m).
    pub by_compliance: f64,
}

impl Response {
    /// That of a contact that bears nothing.
    pub const NONE: Self = Self {
        force: 0.0,
        stiffness: 0.0,
        by_compliance: 0.0,
    };

    /// That of one that bears at a gap (m), of a compliance (m/N), without a barrier.
    pub fn bearing(gap: f64, compliance: f64) -> Self {
        Self {
            force: -gap / compliance,
            stiffness: compliance.recip(),
            by_compliance: gap / (compliance * compliance),
        }
    }
}

impl Law {
    pub fn new(barrier: f64, compliance: f64, reach: f64) -> Self {
        Self {
            barrier,
            compliance: compliance.max(STIFFEST),
            reach,
            tail: None,
        }
    }

    /// The same law, beginning smoothly at its reach.
    pub fn beginning_smoothly(self) -> Self {
        Self {
            tail: Some(self.at(self.reach)),
            ..self
        }
    }

    /// The response at a gap (m), within the reach.
    pub fn at(&self, gap: f64) -> Response {
        let whole = self.whole(gap);
        match &self.tail {
            None => whole,
            Some(tail) => Response {
                force: whole.force - tail.force + tail.stiffness * (gap - self.reach),
                stiffness: whole.stiffness - tail.stiffness,
                by_compliance: whole.by_compliance - tail.by_compliance
                    + self.tail_by_compliance(tail) * (gap - self.reach),
            },
        }
    }

    /// Derivative of the tail's stiffness by the compliance: of `f / r`, `r = sqrt(g² + 4 C mu)`.
    fn tail_by_compliance(&self, tail: &Response) -> f64 {
        let root = self.root(self.reach);
        (tail.by_compliance - tail.stiffness * 2.0 * self.barrier / root) / root
    }

    /// The response without the tail taken off.
    fn whole(&self, gap: f64) -> Response {
        if self.barrier == 0.0 {
            return match gap < 0.0 {
                true => Response::bearing(gap, self.compliance),
                false => Response::NONE,
            };
        }
        let root = self.root(gap);
        let force = self.force(gap, root);
        Response {
            force,
            stiffness: force / root,
            by_compliance: -force * force / root,
        }
    }

    /// Energy at a gap (J).
    pub fn energy(&self, gap: f64) -> f64 {
        let force = self.force(gap, self.root(gap));
        let apart = self.barrier / force;
        let whole =
            0.5 * self.compliance * force * force - self.barrier * (apart / self.reach).ln();
        let beyond = gap - self.reach;
        (self.tail).map_or(whole, |tail| {
            whole + (tail.force - 0.5 * tail.stiffness * beyond) * beyond
        })
    }

    /// To first order, what the law `next` adds to the force of this one at a gap (m), but for the tail (N).
    pub fn change(&self, gap: f64, next: &Self) -> f64 {
        let by_compliance = self.whole(gap).by_compliance;
        (next.barrier - self.barrier) / self.root(gap)
            + (next.compliance - self.compliance) * by_compliance
    }

    fn root(&self, gap: f64) -> f64 {
        (gap * gap + 4.0 * self.compliance * self.barrier).sqrt()
    }

    /// Of the two forms of the solution the one without cancellation.
    fn force(&self, gap: f64, root: f64) -> f64 {
        if gap > 0.0 {
            2.0 * self.barrier / (gap + root)
        } else {
            (root - gap) / (2.0 * self.compliance)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_and_stiffness_are_derivatives_of_the_energy() {
        for barrier in [1e-4, 1e-7] {
            for gap in [-3e-5, -1e-6, 0.0, 1e-6, 1e-3] {
                let law = Law::new(barrier, 1e-6, 0.05);
                let step = 1e-9;
                let [below, at, above] = [gap - step, gap, gap + step].map(|gap| law.at(gap));
                let slope = (law.energy(gap - step) - law.energy(gap + step)) / (2.0 * step);
                let bend = (below.force - above.force) / (2.0 * step);
                assert!((slope / at.force - 1.0).abs() < 1e-5, "{slope} {at:?}");
                assert!((bend / at.stiffness - 1.0).abs() < 1e-3, "{bend} {at:?}");
            }
        }
    }

    #[test]
    fn a_law_that_begins_smoothly_has_its_derivatives_and_begins_at_nothing() {
        let step = 1e-7;
        for barrier in [1e-4, 1e-6] {
            let law = Law::new(barrier, 1e-5, 0.01).beginning_smoothly();
            for gap in [-1e-4, 1e-4, 5e-3, 9e-3] {
                let [below, at, above] = [gap - step, gap, gap + step].map(|gap| law.at(gap));
                let slope = (law.energy(gap - step) - law.energy(gap + step)) / (2.0 * step);
                let bend = (below.force - above.force) / (2.0 * step);
                assert!(
                    (slope / at.force - 1.0).abs() < 1e-4,
                    "{gap} {slope} {at:?}"
                );
                assert!(
                    (bend / at.stiffness - 1.0).abs() < 1e-3,
                    "{gap} {bend} {at:?}"
                );
                let softer = |by: f64| Law::new(barrier, 1e-5 + by, 0.01).beginning_smoothly();
                let by_compliance =
                    (softer(1e-9).at(gap).force - softer(-1e-9).at(gap).force) / 2e-9;
                let off = (by_compliance - at.by_compliance).abs();
                assert!(
                    off < 1e-4 * at.by_compliance.abs() + 1e-6,
                    "{gap} {by_compliance} {at:?}"
                );
            }
            let begin = law.at(0.01);
            assert_eq!((begin.force, begin.stiffness), (0.0, 0.0));
            assert!(law.energy(0.01).abs() < 1e-4 * law.energy(1e-3));
        }
    }

    #[test]
    fn a_harder_law_changes_the_force_to_first_order() {
        let law = Law::new(1e-6, 1e-4, 0.05);
        for gap in [-1e-4, 0.0, 1e-4] {
            let response = law.at(gap);
            for (barrier, compliance) in [(1e-10, 0.0), (0.0, -1e-8), (1e-10, -1e-8)] {
                let next = Law::new(law.barrier + barrier, law.compliance + compliance, 0.05);
                let change = next.at(gap).force - response.force;
                let predicted = law.change(gap, &next);
                assert!(
                    (change - predicted).abs() < 1e-3 * change.abs(),
                    "{change} {predicted}"
                );
            }
        }
    }

    #[test]
    fn force_times_distance_of_the_surfaces_is_the_barrier() {
        let law = Law::new(1e-13, 1e-6, 0.05);
        for gap in [-1e-3, -1e-9, 1e-9, 1e-2] {
            let force = law.at(gap).force;
            let product = force * (gap + law.compliance * force);
            // What is left of a gap of 1 mm that a force closes is rounded.
            assert!(
                (product - 1e-13).abs() < 1e-15 + 4e-16 * force * gap.abs(),
                "{product:e}"
            );
        }
    }

    #[test]
    fn pressed_in_the_contact_is_a_spring_and_away_it_is_nothing() {
        let law = Law::new(1e-15, 1e-6, 0.05);
        let pressed = law.at(-1e-5);
        assert!((pressed.force - 10.0).abs() < 1e-9);
        assert!((law.energy(-1e-5) - 5e-5).abs() < 1e-12);
        assert!(law.at(1e-3).force < 1e-11);
    }
}
