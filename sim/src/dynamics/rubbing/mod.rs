//! Friction of the tendons in their holes, in motion: the law of [`crate::tendon_friction`], taken implicitly.
//!
//! In a step by `h` the tension of segment `j` is that at the end of the step to first order, `T_j + h dT_j v+`, where each contact is
//! assumed to stick, or to slip in one sense; with the slopes `c_j` of the segments' lengths by the joints the rates so are
//! `v+ = v + h a`,
//!
//! `(M + h D + h² sum_j c_j dT_j') a = tau - D v - bias + sum_j c_j (T_0 - T_j) - h sum_j c_j dT_j v`,
//!
//! `tau` with the tensions `T_0` at the servos all along. Whoever solves that looks at what the law says of the motion that comes of it,
//! assumes that, and solves again until it is the same (a primal-dual active set, as in the statics). In implicit steps `K`, the bends of the
//! tendons under these tensions and the wrap angles at the end of the step are in it as well; in semi-implicit ones only what
//! sticks is, which is far too stiff to be explicit. What the contacts bear then is computed by the law at the lengths that the
//! tendons have come to. So, however long the steps, no contact is beyond its cone, and none gives energy that it has not taken.

mod adjoint;

pub(super) use adjoint::RubbedStep;

use nalgebra::Vector3;

use super::acceleration::{EquationsOfMotion, to_coordinates};
use super::blocks::{StepBlocks, Weights};
use super::reaction::{Reaction, torques_of};
use super::{DynamicsError, State};
use crate::capstan::{Line, SlipState, TendonProfile};
use crate::chain::{Chain, Configuration};
use crate::factor::{ContactLu, Inflow, RubbedMatrix};
use crate::robot::{Command, Loads, Robot, Tendon};
use crate::tendon::TendonState;

/// How often what contacts do is assumed anew in a step, at most.
pub(crate) const MAX_REVISIONS: usize = 40;

/// The tendons of one robot in their holes.
#[derive(Clone, Debug)]
pub(super) struct Rubbing {
    blocks: StepBlocks,
    lu: ContactLu<6>,
    /// Where in the factors each segment is, by tendon and place on its route.
    places: Vec<Vec<usize>>,
    /// The tendons at the begin of the step, and at its end as far as it is known.
    lines: Vec<Line>,
    ends: Vec<Line>,
    /// What the servos do at the begin of the step.
    servos: Vec<TendonState>,
    /// The contacts at the begin of the step, as they are assumed to go on, and as they do.
    pub before: Vec<TendonProfile>,
    assumed: Vec<Vec<SlipState>>,
    after: Vec<TendonProfile>,
    /// Where `before` is.
    at: Option<Configuration>,
    /// Storage for a chain there.
    chain: Chain,
    /// Turned to heat since the contacts were last relaxed (J).
    pub dissipated: f64,
    tensions: Vec<f64>,
    rates: Vec<Vector3<f64>>,
    forces: Vec<Vector3<f64>>,
    solution: Vec<Vector3<f64>>,
}

/// What a step is solved with.
#[derive(Clone, Copy)]
pub(super) struct Implicitness {
    pub timestep: f64,
    /// Whether the stiffness is implicit.
    pub stiffness: bool,
}

impl Implicitness {
    fn weights(self) -> Weights {
        let h = self.timestep;
        Weights::of_step(h, if self.stiffness { h * h } else { 0.0 })
    }
}

impl Rubbing {
    /// Of a robot whose tendons have friction; none for others.
    ///
    /// # Errors
    /// [`DynamicsError::FrictionRoute`] where a tendon does not pass each joint on its way once, by a segment of its own.
    pub fn new(robot: &Robot) -> Result<Option<Box<Self>>, DynamicsError> {
        let Some(tendon) = first_rubbing(robot) else {
            return Ok(None);
        };
        let blocks = StepBlocks::new(robot);
        let lu = ContactLu::new(robot, &blocks.expansion);
        let lu = lu.ok_or(DynamicsError::FrictionRoute { tendon })?;
        let lines: Vec<Line> = (robot.tendons().iter())
            .map(|tendon| Line::new(robot, tendon))
            .collect();
        let profiles: Vec<TendonProfile> = lines.iter().map(TendonProfile::new).collect();
        let mut places: Vec<Vec<usize>> = vec![Vec::new(); lines.len()];
        for segment in robot.segments() {
            places[segment.tendon].push(lu.place(segment.joint, segment.tendon));
        }
        let still = vec![Vector3::zeros(); robot.discs().len()];
        Ok(Some(Box::new(Self {
            tensions: vec![0.0; lu.inflows.len()],
            places,
            ends: lines.clone(),
            servos: vec![TendonState::default(); lines.len()],
            assumed: profiles.iter().map(|p| p.slip_states.clone()).collect(),
            after: profiles.clone(),
            before: profiles,
            at: None,
            chain: Chain::new(robot),
            dissipated: 0.0,
            rates: still.clone(),
            forces: still.clone(),
            solution: still,
            lines,
            lu,
            blocks,
        })))
    }

    /// Begins a step from `state`, in which `equations` are. Contacts go on as they were left there; in any other state none is loaded.
    pub fn begin(&mut self, equations: &EquationsOfMotion, state: &State, command: &[f64]) {
        let (robot, chain) = (&equations.robot, &equations.posture.chain);
        lay((&mut self.lines, &mut self.servos), robot, chain, command);
        if self.at.as_ref() != Some(&state.configuration) {
            self.relax(&state.configuration);
        }
        for (t, assumed) in self.assumed.iter_mut().enumerate() {
            match rubs(&self.lines[t]) {
                true => assumed.copy_from_slice(&self.before[t].slip_states),
                // It slips either way, without a force.
                false => assumed.fill(SlipState::SlipsToServo),
            }
        }
        for (rate, motion) in self.rates.iter_mut().zip(&equations.motions) {
            *rate = motion.rate;
        }
    }

    /// Unloads all contacts, in a configuration where the tendons have been laid.
    fn relax(&mut self, q: &Configuration) {
        let tendons = self.lines.iter().zip(&self.servos);
        for (profile, (line, servo)) in self.before.iter_mut().zip(tendons) {
            profile.relax(line, servo.tension);
        }
        self.dissipated = 0.0;
        self.at.get_or_insert_with(|| q.clone()).clone_from(q);
    }

    /// Loads the contacts in `q` with these deflections (m), one for each interior hole of each tendon, as a motion has left them;
    /// with none where there are none.
    pub fn load(
        &mut self,
        robot: &Robot,
        q: &Configuration,
        command: &Command,
        deflections: &[Vec<f64>],
    ) -> Result<(), DynamicsError> {
        let own = self.before.iter().map(|profile| &profile.deflections);
        let alike =
            own.len() == deflections.len() && own.zip(deflections).all(|(a, b)| a.len() == b.len());
        let finite = deflections.iter().flatten().all(|z| z.is_finite());
        let fits = deflections.is_empty() || (alike && finite);
        if !fits {
            return Err(DynamicsError::Deflections);
        }
        self.chain.place(robot, q);
        lay(
            (&mut self.lines, &mut self.servos),
            robot,
            &self.chain,
            command.as_slice(),
        );
        self.relax(q);
        for (profile, loaded) in self.before.iter_mut().zip(deflections) {
            profile.deflections.copy_from_slice(loaded);
        }
        self.settle();
        Ok(())
    }

    /// Writes the accelerations of the joints' coordinates in the step that was begun (rad/s²) under what the contacts are assumed to do;
    /// `false` if there are none.
    pub fn accelerate(
        &mut self,
        equations: &mut EquationsOfMotion,
        loads: &Loads,
        q: &Configuration,
        step: Implicitness,
        out: &mut [f64],
    ) -> bool {
        self.assume();
        let profiles = &self.after;
        let tension = |tendon: usize, place: usize| profiles[tendon].tensions[place];
        (self.blocks).expand_pulled(equations, loads, q, tension);
        self.set_inflows(equations, step);
        if !self.factorise(equations, loads, step, &[]) {
            return false;
        }
        // tau - D v - bias at tensions T_0: the residual at rest rates is minus that.
        self.solution.fill(Vector3::zeros());
        equations.residual(&self.solution, &mut self.forces);
        let expansion = &self.blocks.expansion;
        let (lu, tensions) = (&self.lu, &mut self.tensions);
        // What friction takes from the tensions, and what they change by over the step at the present rates.
        lu.tension_changes(expansion, &self.rates, tensions);
        let h = step.timestep;
        tensions.iter_mut().for_each(|tension| *tension *= h);
        for (places, (profile, servo)) in
            (self.places.iter()).zip(self.after.iter().zip(&self.servos))
        {
            for (&place, tension) in places.iter().zip(&profile.tensions) {
                tensions[place] += tension - servo.tension;
            }
        }
        lu.pull(expansion, tensions, &mut self.forces);
        if step.stiffness {
            let (blocks, rates) = (&self.blocks, &self.rates);
            blocks.stiffness_product(equations, loads, rates, &mut self.solution);
            let forces = self.forces.iter_mut().zip(&self.solution);
            forces.for_each(|(force, stiff)| *force += stiff * h);
        }
        self.forces.iter_mut().for_each(|force| *force = -*force);
        self.lu.solve(&self.forces, &mut self.solution);
        to_coordinates(&equations.posture.chain, &self.solution, out);
        true
    }

    /// Tensions at the begin of the step, the contacts as they are assumed to be.
    fn assume(&mut self) {
        let tendons = self.lines.iter().zip(&self.before).zip(&self.servos);
        let assumed = self.after.iter_mut().zip(&self.assumed);
        for ((after, assumed), ((line, before), servo)) in assumed.zip(tendons) {
            after.assume(line, before, servo.tension, assumed);
        }
    }

    /// How the tension of each segment follows from what is before it, as far as the step takes it implicitly.
    fn set_inflows(&mut self, equations: &EquationsOfMotion, step: Implicitness) {
        let chain = &equations.posture.chain;
        for (t, places) in self.places.iter().enumerate() {
            let (line, profile) = (&self.lines[t], &self.after[t]);
            let servo = Inflow {
                beyond: if step.stiffness {
                    -self.servos[t].stiffness
                } else {
                    0.0
                },
                ..Inflow::NONE
            };
            self.lu.inflows[places[0]] = servo;
            for (hole, &place) in places[1..].iter().enumerate() {
                let slopes = profile.slopes(line, hole, self.assumed[t][hole]);
                let [by_tension, by_angle, beyond] = slopes;
                let [below, own] = match step.stiffness && by_angle != 0.0 {
                    true => line.wrap_slopes(chain, hole).map(|turn| turn * by_angle),
                    false => [Vector3::zeros(); 2],
                };
                self.lu.inflows[place] = Inflow {
                    before: 1.0 - by_tension,
                    below,
                    own,
                    beyond,
                };
            }
        }
    }

    fn factorise(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        step: Implicitness,
        reactions: &[Reaction],
    ) -> bool {
        let weights = step.weights();
        self.blocks.set(equations, loads, weights, reactions);
        self.lu.factorise(&RubbedMatrix {
            expansion: &self.blocks.expansion,
            hessian: weights.stiffness,
            tensions: step.timestep * step.timestep,
            centres: &equations.posture.chain.centres,
            joints: &self.blocks.joints,
            bodies: &self.blocks.bodies,
        })
    }

    /// Writes the change of the joints' rates (rad/s, world axes) by `reactions` after [`Rubbing::accelerate`]; `false` if there is none.
    pub fn respond(
        &mut self,
        equations: &EquationsOfMotion,
        loads: &Loads,
        step: Implicitness,
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) -> bool {
        let factorised = self.factorise(equations, loads, step, reactions);
        if factorised {
            self.respond_again(equations, reactions, out);
        }
        factorised
    }

    /// The same of the impulses of other `reactions`, with the forms of those before.
    pub fn respond_again(
        &mut self,
        equations: &EquationsOfMotion,
        reactions: &[Reaction],
        out: &mut [Vector3<f64>],
    ) {
        let centres = &equations.posture.chain.centres;
        torques_of(reactions, centres, &mut self.forces);
        self.lu.solve(&self.forces, out);
    }

    /// Assumes what the law says of contacts in a step at whose end the joints have these `rates` (rad/s, world axes). Returns whether
    /// that is something else than was assumed.
    pub fn revise(
        &mut self,
        equations: &EquationsOfMotion,
        step: Implicitness,
        rates: &[Vector3<f64>],
    ) -> bool {
        let h = step.timestep;
        for segment in equations.robot.segments() {
            let (t, place) = (segment.tendon, segment.place);
            let slope = &self.blocks.expansion.slopes[self.places[t][place]];
            let stretch = h * slope.dot(&rates[segment.joint]);
            self.ends[t].lengths[place] = self.lines[t].lengths[place] + stretch;
            if let Some(hole) = place.checked_sub(1) {
                self.ends[t].wrap_angles[hole] = self.lines[t].wrap_angles[hole];
                if step.stiffness {
                    let chain = &equations.posture.chain;
                    let [below, own] = self.lines[t].wrap_slopes(chain, hole);
                    let turned =
                        below.dot(&rates[segment.joint - 1]) + own.dot(&rates[segment.joint]);
                    let angle = &mut self.ends[t].wrap_angles[hole];
                    *angle = (*angle + h * turned).max(0.0);
                }
            }
        }
        let mut changed = false;
        for t in (0..self.ends.len()).filter(|&t| rubs(&self.ends[t])) {
            let (servo, end) = (&self.servos[t], &self.ends[t]);
            let mut tension = servo.tension;
            if step.stiffness {
                tension += servo.stiffness * (end.length() - self.lines[t].length());
            }
            let after = &mut self.after[t];
            after.assume(end, &self.before[t], tension, &self.assumed[t]);
            changed |= after.slip_states != self.assumed[t];
            self.assumed[t].copy_from_slice(&after.slip_states);
        }
        changed
    }

    /// Ends the step in the configuration `q` under the same command: contacts are as the law says at the lengths that the tendons have.
    pub fn finish(&mut self, robot: &Robot, q: &Configuration, command: &[f64]) {
        self.chain.place(robot, q);
        lay(
            (&mut self.lines, &mut self.servos),
            robot,
            &self.chain,
            command,
        );
        self.settle();
        self.at.get_or_insert_with(|| q.clone()).clone_from(q);
    }

    /// Contacts as the law has them at the lengths where the tendons have been laid.
    fn settle(&mut self) {
        let tendons = self.lines.iter().zip(&self.servos);
        let contacts = self.after.iter_mut().zip(&mut self.before);
        for ((after, before), (line, servo)) in contacts.zip(tendons) {
            after.follow(line, before, servo.tension);
            self.dissipated += after.work(line, before).dissipated;
            before.clone_from(after);
        }
    }
}

/// Lays the tendons through their holes, and asks what their servos do at these lengths.
fn lay(
    (lines, servos): (&mut [Line], &mut [TendonState]),
    robot: &Robot,
    chain: &Chain,
    command: &[f64],
) {
    let tendons = robot.tendons().iter().zip(command);
    for ((line, servo), (tendon, &command)) in lines.iter_mut().zip(servos).zip(tendons) {
        line.lay(robot, chain);
        *servo = tendon.state(line.length(), command);
    }
}

/// Whether a tendon has friction.
fn rubs(line: &Line) -> bool {
    line.friction.coefficient > 0.0
}

/// The first tendon that has friction.
pub(super) fn first_rubbing(robot: &Robot) -> Option<usize> {
    let rubs = |tendon: &Tendon| tendon.friction.is_some_and(|own| own.coefficient > 0.0);
    robot.tendons().iter().position(rubs)
}

#[cfg(test)]
mod tests;
