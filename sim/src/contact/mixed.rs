//! Newton's method on the configuration and the contacts' forces at once: the way along a path.
//!
//! Which contacts bear, and which of those that rub slip, is an active set ([`ActiveStep`]), so that a step against stiff contacts is not
//! cut where beads begin or cease to touch, as one down the energy is, and friction is bounded by the forces that are solved for. It may
//! lead to an equilibrium of any stability, or nowhere. A step takes O(n) where nothing rubs; friction makes the matrix unsymmetric, and
//! it is dense.

use nalgebra::Vector3;

use super::active::ActiveStep;
use super::dense;
use super::equations::{Equations, MAX_TURN};
use super::friction::Bristle;
use super::law::Hardness;
use super::rubbing::Grip;
use crate::energy::Potential;
use crate::factor::{DenseLu, Side};
use crate::solve::{Correction, Iterate, System, largest_turn};

/// The balance under one potential, with contacts that have no barrier.
pub(super) struct Mixed<'a> {
    equations: &'a mut Equations,
    potential: &'a Potential<'a>,
    active: &'a mut ActiveStep,
    /// What resists sliding from where the way begins.
    bristles: &'a [Bristle],
    /// Factors where something rubs.
    rubbing: Option<DenseLu>,
    none: Vec<Vector3<f64>>,
    correction: Vec<Vector3<f64>>,
}

impl<'a> Mixed<'a> {
    /// Begins where the equations stand and nothing rubs: what overlaps bears, with the forces of contacts as hard as they are there.
    pub fn new(
        equations: &'a mut Equations,
        potential: &'a Potential<'a>,
        active: &'a mut ActiveStep,
    ) -> Self {
        equations.find();
        active.assume_lawful(equations);
        Self::begin(equations, potential, active, &[])
    }

    /// Begins at the last equilibrium of a path, which has this `grip`.
    pub fn along(
        equations: &'a mut Equations,
        potential: &'a Potential<'a>,
        active: &'a mut ActiveStep,
        grip: &'a Grip,
    ) -> Self {
        active.assume(&grip.active);
        Self::begin(equations, potential, active, &grip.bristles)
    }

    fn begin(
        equations: &'a mut Equations,
        potential: &'a Potential<'a>,
        active: &'a mut ActiveStep,
        bristles: &'a [Bristle],
    ) -> Self {
        equations.set_hardness(Hardness::of_barrier(0.0), equations.tolerance);
        let none = vec![Vector3::zeros(); equations.joints.len()];
        Self {
            equations,
            potential,
            active,
            bristles,
            rubbing: None,
            correction: none.clone(),
            none,
        }
    }

    /// Takes the forces of the multipliers for those of the contacts.
    fn take_forces(&mut self) {
        let pressing = &mut self.equations.pressing;
        pressing.clone_from(&self.active.pressing);
    }

    /// Turns the gradient under the forces of the multipliers into the moments (N m) that are unbalanced with what those lack.
    fn balance(&mut self) {
        let moments = &mut self.equations.gradient;
        moments.iter_mut().for_each(|moment| *moment = -*moment);
        self.active.add_besides(moments);
    }

    /// Factorises the matrix of a step; whether it has factors.
    fn factorise(&mut self) -> bool {
        let equations = &mut *self.equations;
        if self.bristles.is_empty() {
            return equations.factorise(0.0).is_some();
        }
        let Equations {
            expansion,
            pressing,
            iterate,
            ..
        } = equations;
        let mut matrix = expansion.dense();
        dense::add_stiffness(pressing, &iterate.posture.chain, &mut matrix);
        expansion.confine(&mut matrix);
        self.rubbing = Some(DenseLu::new(&matrix, &expansion.hinges));
        true
    }

    /// The turns by these factors that lead the present moments to 0.
    fn solve(&mut self) {
        let (moments, out) = (&self.equations.gradient, &mut self.correction);
        match &self.rubbing {
            None => self.equations.lu.solve(moments, &self.none, out),
            Some(lu) => lu.solve(moments, Side::Matrix, out),
        }
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
        self.equations.press_from(self.bristles);
        self.equations.grade_pressed(self.potential);
        // The largest of vectors, whatever they are.
        largest_turn(&self.equations.gradient) <= self.equations.tolerance
    }

    fn newton_step(&mut self) -> Correction {
        self.active.begin(self.equations, self.bristles);
        self.take_forces();
        self.equations.expand_pressed(self.potential);
        let equations = &mut *self.equations;
        equations.expansion.gradient(&mut equations.gradient);
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
        self.active.predict(equations, step);
        Correction::new(size, largest_turn(step))
    }

    /// Where the simplified correction, by the Jacobian at the start of the step, is smaller than the step.
    fn accepts(&mut self, model: &Correction, share: f64) -> bool {
        if self.equations.has_crossed() {
            return false;
        }
        self.equations.find();
        self.active.press(self.equations, self.bristles, share);
        self.take_forces();
        self.equations.grade_pressed(self.potential);
        self.balance();
        self.solve();
        let accepted = model.improves(share, largest_turn(&self.correction));
        match accepted {
            true => self.active.revise(self.equations, self.bristles, share),
            false => self.equations.is_found = false,
        }
        accepted
    }
}
