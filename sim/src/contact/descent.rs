//! Newton's method on the potential of a robot with that of its contacts.

use super::equations::{Equations, MAX_TURN};
use crate::energy::Potential;
use crate::solve::{Iterate, System};

/// Share of the decrease by the linear model that a step must bring (Armijo's condition).
const ENOUGH: f64 = 1e-4;
/// Share of the energy that is rounding.
const ENERGY_ROUNDING: f64 = 1e-13;
/// Energy (J) that terms of both signs may have before they cancel, for each N m of the tolerance.
const CANCELLING: f64 = 1e7;

/// A minimisation under one potential and hardness.
pub(super) struct Minimisation<'a> {
    equations: &'a mut Equations,
    potential: &'a Potential<'a>,
    /// Energy (J) at the start of the step, where it is known.
    energy: Option<f64>,
}

/// The energy to first order along a step.
pub(super) struct Slope {
    /// Derivative of the energy (J) by the share of the step.
    slope: f64,
    /// Differences of the energy (J) below this are rounding.
    rounding: f64,
}

impl<'a> Minimisation<'a> {
    pub fn new(equations: &'a mut Equations, potential: &'a Potential<'a>) -> Self {
        Self {
            equations,
            potential,
            energy: None,
        }
    }
}

impl System for Minimisation<'_> {
    type Model = Slope;
    const MAX_STEPS: usize = 200;
    const MAX_TRIALS: usize = 30;

    fn iterate(&mut self) -> &mut Iterate {
        &mut self.equations.iterate
    }

    fn is_solved(&mut self) -> bool {
        self.equations.expand(self.potential);
        self.equations.expansion.residual() <= self.equations.tolerance
    }

    fn newton_step(&mut self) -> Slope {
        let equations = &mut *self.equations;
        let energy = *self
            .energy
            .get_or_insert_with(|| equations.energy(self.potential));
        equations.is_found = false;
        equations.factorise_positive();
        let expansion = &equations.expansion;
        let step = &mut equations.iterate.step;
        let (joint, disc) = (&expansion.joint_gradient, &expansion.disc_gradient);
        equations.lu.solve(joint, disc, step);
        step.iter_mut().for_each(|turn| *turn = -*turn);
        equations.iterate.limit_step(MAX_TURN);
        equations.keep_clear();
        equations.neighbourhood.begin_step();
        equations.expansion.gradient(&mut equations.gradient);
        let turns = equations.iterate.step.iter().zip(&equations.gradient);
        let cancelling = CANCELLING * equations.tolerance.max(equations.own_tolerance);
        Slope {
            slope: turns.map(|(step, gradient)| step.dot(gradient)).sum(),
            rounding: ENERGY_ROUNDING * energy.abs().max(cancelling),
        }
    }

    fn accepts(&mut self, model: &Slope, share: f64) -> bool {
        if self.equations.has_crossed() {
            return false;
        }
        self.equations.find();
        let energy = self.equations.energy(self.potential);
        let before = self.energy.unwrap_or(energy);
        let accepted = energy <= before + ENOUGH * share * model.slope.min(0.0) + model.rounding;
        match accepted {
            true => self.energy = Some(energy),
            false => self.equations.is_found = false,
        }
        accepted
    }
}
