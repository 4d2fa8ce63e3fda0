//! What a robot touches as it follows a path by a solver of its own: one whose tendons have friction in their holes.
//!
//! Contacts bear `-g / C` of their gap `g` and compliance `C` where surfaces overlap, and nothing elsewhere: the limit of the law of
//! [`ContactSettler`] without a barrier. Within a Newton step they are as [`ActiveStep`] assumes.

use faer::Mat;
use nalgebra::Vector3;

use super::active::ActiveStep;
use super::dense;
use super::law::Hardness;
use super::report::report_contacts;
use super::rubbing::Grip;
use super::{Contact, ContactEquilibrium, ContactError, ContactSettler};
use crate::chain::Configuration;
use crate::energy::Pressing;
use crate::robot::{Command, Loads, Robot};
use crate::scene::Scene;

/// What a robot touches along its path.
#[derive(Clone, Debug)]
pub(crate) struct Touching {
    settler: ContactSettler,
    at: Touched,
    step: ActiveStep,
    /// Whether the step that was tried last touches nothing.
    is_step_clear: bool,
}

/// What it touches at the last equilibrium.
#[derive(Clone, Debug)]
pub(crate) struct Touched {
    grip: Grip,
    report: ContactEquilibrium,
}

impl Touching {
    pub fn new(robot: &Robot, scene: &Scene) -> Self {
        Self {
            settler: ContactSettler::new(robot, scene),
            at: Touched {
                grip: Grip::default(),
                report: ContactEquilibrium::unsettled(robot),
            },
            step: ActiveStep::new(robot),
            is_step_clear: false,
        }
    }

    /// Settles without any friction, from the straight pose.
    pub fn settle(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&ContactEquilibrium, ContactError> {
        self.settler.settle(command, loads)?;
        self.at.report.clone_from(self.settler.found());
        self.harden();
        self.at.grip = Grip::at(&mut self.settler.equations);
        Ok(&self.at.report)
    }

    /// Whether a contact bears at the last equilibrium.
    pub fn is_pressed(&self) -> bool {
        !self.at.report.contacts.is_empty()
    }

    /// What rounding of the positions leaves of the moments of contacts (N m).
    pub fn rounding(&self) -> f64 {
        self.settler.equations.rounding()
    }

    /// What is touched at the last equilibrium.
    pub fn contacts(&self) -> &[Contact] {
        &self.at.report.contacts
    }

    /// The same, with how well it is solved: its equilibrium is that of the start.
    pub fn report(&self) -> &ContactEquilibrium {
        &self.at.report
    }

    /// The last equilibrium, to come back to.
    pub fn state(&self) -> &Touched {
        &self.at
    }

    /// Goes back to an equilibrium.
    pub fn set_state(&mut self, at: Touched) {
        self.at = at;
    }

    /// Whether a robot that presses nothing can go from the last equilibrium, `from`, to another configuration without touching anything.
    pub fn is_clear(&mut self, from: &Configuration, to: &Configuration) -> bool {
        self.is_step_clear = self.leads_past(from, to);
        self.is_step_clear
    }

    fn leads_past(&mut self, from: &Configuration, to: &Configuration) -> bool {
        let equations = &mut self.settler.equations;
        equations.bristles.clear();
        equations.neighbourhood.clear();
        equations.iterate.set(from);
        equations.find();
        equations.neighbourhood.begin_step();
        equations.iterate.set(to);
        if equations.has_crossed() {
            return false;
        }
        equations.find();
        let near = equations.neighbourhood.near.iter().map(|near| near.gap);
        let own = equations.near_pairs().iter().map(|near| near.gap);
        near.chain(own).all(|gap| gap > 0.0)
    }

    /// Lets contacts bear without a barrier, where they were found last.
    fn harden(&mut self) {
        let equations = &mut self.settler.equations;
        equations.set_hardness(Hardness::of_barrier(0.0), equations.tolerance);
        equations.find();
    }

    /// Begins a solve from the last equilibrium.
    pub fn begin(&mut self) {
        self.is_step_clear = false;
        self.settler.equations.neighbourhood.clear();
        self.harden();
        self.step.assume(&self.at.grip.active);
    }

    /// Forces of the contacts in a configuration.
    pub fn press(&mut self, q: &Configuration) -> &Pressing {
        let equations = &mut self.settler.equations;
        equations.iterate.set(q);
        equations.find();
        equations.press_from(&self.at.grip.bristles);
        &equations.pressing
    }

    /// Begins a Newton step where contacts were pressed last: their forces as they are assumed, but for [`add_besides`](Self::add_besides).
    pub fn begin_step(&mut self) -> &Pressing {
        self.settler.equations.neighbourhood.begin_step();
        self.step
            .begin(&self.settler.equations, &self.at.grip.bristles);
        &self.step.pressing
    }

    /// The same in the configuration to which a share of the step has led; none where a bead may have passed through an obstacle.
    pub fn press_step(&mut self, q: &Configuration, share: f64) -> Option<&Pressing> {
        let equations = &mut self.settler.equations;
        equations.iterate.set(q);
        if equations.has_crossed() {
            return None;
        }
        equations.find();
        self.step.press(equations, &self.at.grip.bristles, share);
        Some(&self.step.pressing)
    }

    /// Adds the moments (N m) about the joints that forces have besides.
    pub fn add_besides(&self, moments: &mut [Vector3<f64>]) {
        self.step.add_besides(moments);
    }

    /// Revises what is assumed after a share of the step.
    pub fn revise(&mut self, share: f64) {
        self.step
            .revise(&self.settler.equations, &self.at.grip.bristles, share);
    }

    /// Adds to the derivatives of the moments by the joints' turns what the assumed forces change by.
    pub fn add_stiffness(&self, jacobian: &mut Mat<f64>) {
        let chain = &self.settler.equations.iterate.posture.chain;
        dense::add_stiffness(&self.step.pressing, chain, jacobian);
    }

    /// Shortens a Newton step (rad) such that no bead passes through an obstacle.
    pub fn keep_clear(&mut self, step: &mut [Vector3<f64>]) {
        let equations = &mut self.settler.equations;
        equations.iterate.step.copy_from_slice(step);
        equations.keep_clear();
        step.copy_from_slice(&equations.iterate.step);
    }

    /// Takes note of the whole step (rad).
    pub fn predict(&mut self, step: &[Vector3<f64>]) {
        self.step.predict(&self.settler.equations, step);
    }

    /// Takes the last step over as an equilibrium.
    pub fn accept(&mut self) {
        let Self { settler, at, .. } = self;
        if self.is_step_clear {
            at.grip = Grip::default();
            at.report.contacts.clear();
            (at.report.complementarity, at.report.penetration) = (0.0, 0.0);
            return;
        }
        let equations = &mut settler.equations;
        report_contacts(equations, &mut at.report);
        at.grip = Grip::at(equations);
    }
}
