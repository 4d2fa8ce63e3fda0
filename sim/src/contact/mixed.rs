//! Newton's method on the configuration and the contacts' forces at once, in O(n) a step: the way along a path.
//!
//! Nothing rubs. Which contacts bear is an active set ([`ActiveStep`]), so that a step against stiff contacts is not cut where beads begin
//! or cease to touch, as one down the energy is. It may lead to an equilibrium of any stability, or nowhere.

use nalgebra::Vector3;

use super::active::ActiveStep;
use super::equations::{Equations, MAX_TURN};
use super::law::Hardness;
use crate::energy::Potential;
use crate::solve::{Correction, Iterate, System, largest_turn};

/// The balance under one potential, with contacts that have no barrier.
pub(super) struct Mixed<'a> {
    equations: &'a mut Equations,
    potential: &'a Potential<'a>,
    active: &'a mut ActiveStep,
    none: Vec<Vector3<f64>>,
    correction: Vec<Vector3<f64>>,
}

impl<'a> Mixed<'a> {
    /// Begins where the equations stand: what overlaps bears, with the forces of contacts as hard as they are there.
    pub fn new(
        equations: &'a mut Equations,
        potential: &'a Potential<'a>,
        active: &'a mut ActiveStep,
    ) -> Self {
        equations.find();
        active.assume_lawful(equations);
        equations.set_hardness(Hardness::of_barrier(0.0), equations.tolerance);
        let none = vec![Vector3::zeros(); equations.joints.len()];
        Self {
            equations,
            potential,
            active,
            correction: none.clone(),
            none,
        }
    }

    /// Turns the gradient under the forces of the multipliers into the moments (N m) that are unbalanced with what those lack.
    fn balance(&mut self) {
        let moments = &mut self.equations.gradient;
        moments.iter_mut().for_each(|moment| *moment = -*moment);
        self.active.add_besides(moments);
    }
}

impl System for Mixed<'_> {
    type Model = Correction;
    const MAX_STEPS: usize = 12;
    const MAX_TRIALS: usize = 6;

    fn iterate(&mut self) -> &mut Iterate {
        &mut self.equations.iterate
    }

    fn is_solved(&mut self) -> bool {
        let equations = &mut *self.equations;
        equations.press();
        equations.grade_pressed(self.potential);
        // The largest of vectors, whatever they are.
        largest_turn(&equations.gradient) <= equations.tolerance
    }

    fn newton_step(&mut self) -> Correction {
        let equations = &mut *self.equations;
        self.active.begin(equations, &[]);
        equations.pressing.clone_from(&self.active.pressing);
        equations.expand_pressed(self.potential);
        equations.expansion.gradient(&mut equations.gradient);
        self.balance();
        let factorised = self.equations.factorise(0.0).is_some();
        let equations = &mut *self.equations;
        equations.neighbourhood.begin_step();
        let step = &mut equations.iterate.step;
        equations.lu.solve(&equations.gradient, &self.none, step);
        let size = match factorised {
            true => largest_turn(step),
            false => f64::NAN,
        };
        equations.keep_clear();
        equations.iterate.limit_step(MAX_TURN);
        let step = &equations.iterate.step;
        self.active.predict(equations, &[], step);
        Correction::new(size, largest_turn(step))
    }

    /// Where the simplified correction, by the Jacobian at the start of the step, is smaller than the step.
    fn accepts(&mut self, model: &Correction, share: f64) -> bool {
        if self.equations.has_crossed() {
            return false;
        }
        self.equations.find();
        self.active.press(self.equations, &[], share);
        let equations = &mut *self.equations;
        equations.pressing.clone_from(&self.active.pressing);
        equations.grade_pressed(self.potential);
        self.balance();
        let equations = &mut *self.equations;
        (equations.lu).solve(&equations.gradient, &self.none, &mut self.correction);
        let accepted = model.improves(share, largest_turn(&self.correction));
        match accepted {
            true => self.active.revise(equations, &[], share),
            false => equations.is_found = false,
        }
        accepted
    }
}
