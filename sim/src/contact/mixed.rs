//! Newton's method on the configuration and the contacts' forces at once, in O(n) a step: the way along a path.
//!
//! Which contacts bear, and which of those that rub slip, is an active set ([`ActiveStep`]), so that a step against stiff contacts is not
//! cut where beads begin or cease to touch, as one down the energy is, and bounds of friction are none of the solve before. It may lead
//! to an equilibrium of any stability, or nowhere.

use nalgebra::Vector3;

use super::active::ActiveStep;
use super::equations::{Equations, MAX_TURN};
use super::friction::Bristle;
use super::law::Hardness;
use crate::energy::Potential;
use crate::factor::{ChainLu, Side};
use crate::solve::{Correction, Iterate, System, largest_turn};

/// The balance under one potential, with contacts that have no barrier.
pub(super) struct Mixed<'a> {
    equations: &'a mut Equations,
    potential: &'a Potential<'a>,
    active: &'a mut ActiveStep,
    /// What resists sliding from the start on, and the factors of matrices that are not symmetric for it.
    bristles: Vec<Bristle>,
    rubbing: Option<ChainLu>,
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
        let rubs = !equations.bristles.is_empty();
        Self {
            rubbing: rubs.then(|| ChainLu::new(&equations.expansion)),
            bristles: equations.bristles.clone(),
            equations,
            potential,
            active,
            correction: none.clone(),
            none,
        }
    }

    /// Takes the forces of the multipliers for those of the contacts.
    fn take_forces(&mut self) {
        let pressing = &mut self.equations.pressing;
        pressing.clone_from(&self.active.pressing);
    }

    /// Factorises the matrix of a step; whether there is one.
    fn factorise(&mut self) -> bool {
        let equations = &mut *self.equations;
        match &mut self.rubbing {
            None => equations.factorise(0.0).is_some(),
            // Not where discs of the robot press each other.
            Some(_) if !equations.pressing.pairs.is_empty() => false,
            Some(lu) => lu.factorise(&equations.matrix()).is_some(),
        }
    }

    /// The step by these factors that leads the present moments to 0.
    fn solve(&mut self) {
        let (moments, out) = (&self.equations.gradient, &mut self.correction);
        match &self.rubbing {
            None => self.equations.lu.solve(moments, &self.none, out),
            Some(lu) => lu.solve(moments, &self.none, Side::Matrix, out),
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
        if !equations.is_found {
            equations.find();
        }
        if self.rubbing.is_some() {
            equations.bristles.clone_from(&self.bristles);
            equations.press_bristles();
        }
        equations.press();
        equations.grade_pressed(self.potential);
        // The largest of vectors, whatever they are.
        largest_turn(&equations.gradient) <= equations.tolerance
    }

    fn newton_step(&mut self) -> Correction {
        self.active.begin(self.equations, &self.bristles);
        self.take_forces();
        self.equations.expand_pressed(self.potential);
        let Equations {
            expansion,
            gradient,
            ..
        } = &mut *self.equations;
        expansion.gradient(gradient);
        self.balance();
        let factorised = self.factorise();
        self.solve();
        let size = match factorised {
            true => largest_turn(&self.correction),
            false => f64::NAN,
        };
        let equations = &mut *self.equations;
        equations.neighbourhood.begin_step();
        equations.iterate.step.copy_from_slice(&self.correction);
        equations.keep_clear();
        equations.iterate.limit_step(MAX_TURN);
        let step = &equations.iterate.step;
        self.active.predict(equations, &self.bristles, step);
        Correction::new(size, largest_turn(step))
    }

    /// Where the simplified correction, by the Jacobian at the start of the step, is smaller than the step.
    fn accepts(&mut self, model: &Correction, share: f64) -> bool {
        if self.equations.has_crossed() {
            return false;
        }
        self.equations.find();
        self.active.press(self.equations, &self.bristles, share);
        self.take_forces();
        self.equations.grade_pressed(self.potential);
        self.balance();
        self.solve();
        let accepted = model.improves(share, largest_turn(&self.correction));
        match accepted {
            true => self.active.revise(self.equations, &self.bristles, share),
            false => self.equations.is_found = false,
        }
        accepted
    }
}
