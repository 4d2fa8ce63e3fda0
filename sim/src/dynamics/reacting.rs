//! Steps in which the surroundings react to the velocities: a step is begun without them, responds to them, and is finished.
//!
//! A first-order step makes the joints' rates `v* = v + h a`, where `A a = ...`. Impulses `p` on the discs change that by `w`,
//! `A w = J' p`. Where the impulses depend on the velocities, callers linearise them to [`Reaction`]s and ask again.

use nalgebra::Vector3;

use super::pushes::Push;
use super::rubbing::Implicitness;
use super::stepper::{Scheme, advance, largest_turn};
use super::{DynamicsError, Integrator, Reaction, State, Stepper};
use crate::capstan::TendonProfile;
use crate::chain::{Chain, Configuration};
use crate::robot::{Command, Loads};
use crate::tendon::Posture;

/// What the velocities change by under impulses: the matrix `A`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Resistance {
    /// That of the step: inertias, and what the integrator takes implicitly.
    Step,
    /// Inertias alone, given the joints' armatures.
    Inertia,
}

impl Stepper {
    /// Refuses integrators whose steps do not respond to impulses on the velocities: those that are not of first order.
    pub(crate) fn check_reacting(&self) -> Result<(), DynamicsError> {
        match self.integrator() {
            Integrator::SemiImplicitEuler | Integrator::ImplicitEuler => Ok(()),
            integrator => Err(DynamicsError::NotAmongObstacles { integrator }),
        }
    }

    /// Begins a step from `state`: the accelerations without surroundings, in which tendons have their commanded lengths.
    pub(crate) fn begin(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        let Some(mut held) = self.held.take() else {
            return self.begin_alone(state, command, loads);
        };
        let begun = self.begin_holding(&mut held, state, command, loads);
        self.held = Some(held);
        begun
    }

    /// Begins a step from `state`, under tensions in place of commanded lengths.
    pub(super) fn begin_alone(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<(), DynamicsError> {
        self.equations.accept(state, command, loads)?;
        let (h, command) = (self.timestep, command.as_slice());
        self.hinges.remember(state);
        let (equations, accelerations) = (&mut self.equations, &mut self.accelerations);
        self.implicit = false;
        if let Scheme::ImplicitEuler(scheme) = &mut self.scheme {
            self.implicit = scheme.accelerate(equations, loads, state, command, h, accelerations);
            self.fallbacks += usize::from(!self.implicit);
        }
        let (q, v) = (&state.configuration, &state.velocity);
        match (&mut self.rubbing, self.implicit) {
            (None, false) => {
                equations.accelerate(q, v, command, &self.armatures, accelerations);
            }
            (None, true) => {}
            (Some(rubbing), _) => {
                equations.enter(q, v, command);
                rubbing.begin(equations, state, command);
            }
        }
        self.rub(state, loads);
        self.hold_back(state, loads);
        Ok(())
    }

    /// Writes the accelerations of the step that was begun from `state`, contacts of the tendons as they are assumed to be.
    fn rub(&mut self, state: &State, loads: &Loads) {
        let step = self.implicitness();
        let Some(rubbing) = &mut self.rubbing else {
            return;
        };
        let (equations, out) = (&mut self.equations, &mut self.accelerations);
        if !rubbing.accelerate(equations, loads, &state.configuration, step, out) {
            out.fill(f64::NAN);
        }
    }

    /// Of the step that was begun from `state`, the rates changed by `change` (rad/s, world axes; by nothing where it is empty):
    /// assumes what the tendons do in their holes then. Returns whether that is something else than was assumed; the step is then
    /// begun anew with it.
    pub(crate) fn rub_again(
        &mut self,
        state: &State,
        loads: &Loads,
        change: &[Vector3<f64>],
    ) -> bool {
        let Some(mut rubbing) = self.rubbing.take() else {
            return false;
        };
        let ends = self.rates(state, &self.accelerations);
        let mut rates: Vec<Vector3<f64>> = ends.map(|[_, end]| end).collect();
        for (rate, change) in rates.iter_mut().zip(change) {
            *rate += change;
        }
        let changed = rubbing.revise(&self.equations, self.implicitness(), &rates);
        self.rubbing = Some(rubbing);
        if changed {
            self.rub(state, loads);
            self.hold_back(state, loads);
        }
        changed
    }

    fn implicitness(&self) -> Implicitness {
        Implicitness {
            timestep: self.timestep,
            stiffness: self.implicit,
        }
    }

    /// Each tendon along its route where the last step led the robot, with its contacts in the holes; none of a robot without friction.
    /// Steps from another configuration begin with no contact loaded.
    pub fn tendon_profiles(&self) -> &[TendonProfile] {
        self.rubbing.as_ref().map_or(&[], |rubbing| &rubbing.before)
    }

    /// Energy that tendons have turned into heat in their holes since a step that began with no contact loaded (J).
    pub fn dissipated(&self) -> f64 {
        self.rubbing
            .as_ref()
            .map_or(0.0, |rubbing| rubbing.dissipated)
    }

    /// Sets what the contacts of the tendons in their holes bear in steps from `configuration`, where `command` acts, as
    /// [`tendon_profiles`](Self::tendon_profiles) had them: `deflections` (m), one for each interior hole of each tendon, or an
    /// empty list where no contact is loaded. Does nothing for a robot without friction.
    ///
    /// # Errors
    /// [`DynamicsError::Deflections`] where they are not of this robot, or not finite; [`DynamicsError::Size`] for a configuration of another.
    pub fn set_deflections(
        &mut self,
        configuration: &Configuration,
        command: &Command,
        deflections: &[Vec<f64>],
    ) -> Result<(), DynamicsError> {
        let robot = &self.equations.robot;
        let joints = [robot.discs().len(), configuration.0.len()];
        DynamicsError::check_size(robot, "configuration", joints)?;
        match &mut self.rubbing {
            Some(rubbing) => rubbing.load(robot, configuration, command, deflections),
            None => Ok(()),
        }
    }

    /// Adds what the drag of a fluid changes of the step that was begun from `state`.
    fn hold_back(&mut self, state: &State, loads: &Loads) {
        let Some(mut drag) = self.drag.take() else {
            return;
        };
        let h = self.timestep;
        drag.set(&self.equations, &state.velocity, &self.accelerations, h);
        self.respond_to::<false>(loads, Resistance::Step, &drag.reactions, &mut drag.change);
        self.accelerate_by(&drag.change);
        self.drag = Some(drag);
    }

    /// Adds a `change` of the rates (rad/s, world axes) to the accelerations of the step that was begun.
    pub(super) fn accelerate_by(&mut self, change: &[Vector3<f64>]) {
        let chain: &Chain = &self.equations.posture.chain;
        let accelerations = self.accelerations.as_chunks_mut::<3>().0.iter_mut();
        for (joint, (acceleration, change)) in accelerations.zip(change).enumerate() {
            let own = chain.dual(joint).tr_mul(change) / self.timestep;
            *acceleration = (Vector3::from(*acceleration) + own).into();
        }
    }

    /// The posture in which the step was begun.
    pub(crate) fn posture(&self) -> &Posture {
        &self.equations.posture
    }

    /// Writes the joints' rates in world axes (rad/s) at the end of the step without surroundings, as far as the `resistance` tells, and
    /// at its begin.
    pub(crate) fn free_rates(
        &mut self,
        (state, command): (&State, &Command),
        resistance: Resistance,
        end: &mut [Vector3<f64>],
        begin: &mut [Vector3<f64>],
    ) {
        let accelerations = match resistance {
            Resistance::Step => &self.accelerations,
            Resistance::Inertia => {
                let (q, v) = (&state.configuration, &state.velocity);
                let (command, out) = (command.as_slice(), &mut self.inertial);
                (self.equations).accelerate(q, v, command, &self.bare, out);
                &self.inertial
            }
        };
        for (joint, rates) in self.rates(state, accelerations).enumerate() {
            [begin[joint], end[joint]] = rates;
        }
    }

    /// The rates of each joint in world axes (rad/s) at the begin of a step from `state` with these accelerations (rad/s²), and at its end.
    fn rates(
        &self,
        state: &State,
        accelerations: &[f64],
    ) -> impl Iterator<Item = [Vector3<f64>; 2]> {
        let chain = &self.equations.posture.chain;
        let rates = state.velocity.as_chunks::<3>().0.iter();
        let rates = rates.zip(accelerations.as_chunks::<3>().0);
        rates.enumerate().map(|(joint, (v, a))| {
            let (v, a, axes) = (Vector3::from(*v), Vector3::from(*a), chain.axes(joint));
            [axes * v, axes * (v + a * self.timestep)]
        })
    }

    /// Writes the change of the joints' rates by `reactions`, one for each disc (rad/s, world axes). Not finite where there is none. What
    /// is kept (`KEEPS`) serves [`respond_again`](Self::respond_again).
    pub(crate) fn respond<const KEEPS: bool>(
        &mut self,
        loads: &Loads,
        resistance: Resistance,
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        match (self.drag.take(), resistance) {
            (Some(mut drag), Resistance::Step) => {
                self.respond_to::<KEEPS>(loads, resistance, drag.with(reactions), out);
                self.drag = Some(drag);
            }
            (drag, _) => {
                self.drag = drag;
                self.respond_to::<KEEPS>(loads, resistance, reactions, out);
            }
        }
    }

    /// The same of all that reacts.
    fn respond_to<const KEEPS: bool>(
        &mut self,
        loads: &Loads,
        resistance: Resistance,
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        let implicit = self.implicit && resistance == Resistance::Step;
        let step = self.implicitness();
        if let (Some(rubbing), Resistance::Step) = (&mut self.rubbing, resistance) {
            if !rubbing.respond(&self.equations, loads, step, reactions, out) {
                out.fill(Vector3::repeat(f64::NAN));
            }
            return;
        }
        if let (Scheme::ImplicitEuler(scheme), true) = (&mut self.scheme, implicit) {
            let h = self.timestep;
            if !scheme.respond(&self.equations, loads, h, reactions, out) {
                out.fill(Vector3::repeat(f64::NAN));
            }
            return;
        }
        let armatures = match resistance {
            Resistance::Step => &self.armatures,
            Resistance::Inertia => &self.bare,
        };
        (self.equations).respond::<KEEPS>(armatures, reactions, out);
    }

    /// Writes the change of the joints' rates by the impulses of other `reactions`, with the forms of those that were kept last.
    pub(crate) fn respond_again(
        &mut self,
        resistance: Resistance,
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        if let (Some(rubbing), Resistance::Step) = (&mut self.rubbing, resistance) {
            rubbing.respond_again(&self.equations, reactions, out);
            return;
        }
        let implicit = self.implicit && resistance == Resistance::Step;
        match (&mut self.scheme, implicit) {
            (Scheme::ImplicitEuler(scheme), true) => {
                scheme.respond_again(&self.equations, reactions, out);
            }
            _ => self.equations.respond_again(reactions, out),
        }
    }

    /// Writes the change of the joints' rates by angular impulses on the joints (N m s), by the matrix of the step; world axes.
    pub(super) fn solve_joints(&mut self, impulses: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        match (&self.scheme, self.implicit) {
            // Drag is in the matrix that was factorised last.
            (Scheme::ImplicitEuler(scheme), true) => scheme.solve(impulses, out),
            _ => {
                let forms = match &mut self.drag {
                    Some(drag) => drag.with(&[]),
                    None => &[],
                };
                (self.equations).solve_among(&self.armatures, impulses, forms, out);
            }
        }
    }

    /// Adds what drag did in the step that was finished, which went from `before`.
    pub(crate) fn add_pushes(&self, before: &State, pushes: &mut Vec<Push>) {
        if let Some(drag) = &self.drag {
            let rates = (&before.velocity[..], &self.accelerations[..]);
            drag.add_pushes(&self.equations, rates, self.timestep, pushes);
        }
    }

    /// Accelerations of the joints' coordinates in the step that was finished (rad/s²).
    pub(crate) fn accelerations(&self) -> &[f64] {
        &self.accelerations
    }

    /// Ends the step that was begun from `state`, the rates changed by `change` (rad/s, world axes); by nothing where it is empty.
    pub(crate) fn finish(
        &mut self,
        state: &mut State,
        command: &Command,
        change: &[Vector3<f64>],
    ) -> Result<(), DynamicsError> {
        self.accelerate_by(change);
        let h = self.timestep;
        advance(&self.equations.robot, state, &self.accelerations, h);
        self.check_turn(largest_turn(&state.velocity, h), state)?;
        if let Some(rubbing) = &mut self.rubbing {
            rubbing.finish(
                &self.equations.robot,
                &state.configuration,
                command.as_slice(),
            );
        }
        Ok(())
    }
}
