//! Friction of the tendons in derivatives of semi-implicit steps, for the contacts as they stick and slip in the step that was taken.
//!
//! In the step the tension of the segment beyond a hole is `T - F`: where the contact sticks `F = k (z - h B')`, `B'` the rate at the end of
//! the step of the tendon's length beyond the hole; where it slips `F = e T`, `e = 1 - exp(-m a)` towards the servo and `1 - exp(m a)` to
//! the end, for a coefficient `m` and a wrap angle `a` at the begin of the step. At its end the deflections `z` follow by the same law from
//! the lengths and the angles there. Both are read backwards here, from the tendon's fastened end to its servo, down to lengths,
//! angles, tensions at the servo, coefficients and the deflections before the step; their derivatives by the joints and the model
//! are those of lines through holes ([`Line`]).

use nalgebra::Vector3;

use super::{Rubbing, lay, rubs};
use crate::capstan::{Line, SlipState, TendonProfile};
use crate::chain::Chain;
use crate::dynamics::acceleration::EquationsOfMotion;
use crate::factor::Inflow;
use crate::model_tangent::{Expanded, ModelTangent, pull_back_tension};
use crate::robot::Robot;
use crate::tendon::TendonState;

/// The tendons in a step, as derivatives of it take them.
#[derive(Clone, Debug)]
pub(in crate::dynamics) struct RubbedStep {
    timestep: f64,
    /// Segments of the robot, by tendon and place on its route.
    segments: Vec<Vec<usize>>,
    joints: Vec<Vec<usize>>,
    /// The tendons at the begin of the step, and what their servos do there.
    lines: Vec<Line>,
    servos: Vec<TendonState>,
    /// What the contacts are deflected by then (m), and how they go on.
    deflections: Vec<Vec<f64>>,
    contacts: Vec<Vec<Contact>>,
    /// Tensions at the end of the step, to first order.
    pub tensions: Vec<Vec<f64>>,
    /// Rates of the joints then (rad/s, world axes).
    rates: Vec<Vector3<f64>>,
    /// Derivatives of the cost by the deflections after the step, and then by those before it (N, if the cost is an energy).
    pub cotangents: Vec<Vec<f64>>,
}

/// What a tendon does at a hole.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Contact {
    /// It sticks: the force is the stiffness times the deflection.
    Sticks,
    /// It slips: the force is this share of the tension on the servo's side; with the share's derivative by coefficient times angle.
    Slips { share: f64, steepness: f64 },
    /// It slips under no tension or without friction: there is no force.
    Free,
}

impl Contact {
    fn new(line: &Line, hole: usize, state: SlipState, tension: f64) -> Self {
        let turned = line.friction.coefficient * line.wrap_angles[hole];
        let [sign, slips] = match state {
            _ if !rubs(line) => return Self::Free,
            SlipState::Sticks => return Self::Sticks,
            SlipState::SlipsToServo => [-1.0, 1.0],
            SlipState::SlipsToEnd => [1.0, -1.0],
        };
        match tension > 0.0 {
            true => Self::Slips {
                share: -(sign * turned).exp_m1(),
                steepness: slips * (sign * turned).exp(),
            },
            false => Self::Free,
        }
    }
}

/// Derivatives of a cost by what a tendon is at one end of a step.
struct TendonCotangent {
    /// By the length of each segment.
    lengths: Vec<f64>,
    /// By the angle at each hole.
    angles: Vec<f64>,
    /// By the tension at the servo.
    servo: f64,
    /// By the coefficient of friction.
    coefficient: f64,
}

impl TendonCotangent {
    fn of(line: &Line) -> Self {
        Self {
            lengths: vec![0.0; line.lengths.len()],
            angles: vec![0.0; line.wrap_angles.len()],
            servo: 0.0,
            coefficient: 0.0,
        }
    }

    /// Takes the derivative `by_share` by the share of the tension that a hole takes where it slips.
    fn share(&mut self, line: &Line, hole: usize, by_share: f64, steepness: f64) {
        self.angles[hole] += by_share * steepness * line.friction.coefficient;
        self.coefficient += by_share * steepness * line.wrap_angles[hole];
    }
}

impl RubbedStep {
    /// Of a robot whose tendons have friction.
    pub fn new(robot: &Robot, rubbing: &Rubbing, timestep: f64) -> Self {
        let mut segments: Vec<Vec<usize>> = vec![Vec::new(); rubbing.lines.len()];
        let mut joints = segments.clone();
        for (index, segment) in robot.segments().iter().enumerate() {
            segments[segment.tendon].push(index);
            joints[segment.tendon].push(segment.joint);
        }
        let holes = |profile: &TendonProfile| vec![0.0; profile.deflections.len()];
        let deflections: Vec<Vec<f64>> = rubbing.before.iter().map(holes).collect();
        let lines = rubbing.lines.clone();
        Self {
            timestep,
            segments,
            joints,
            servos: rubbing.servos.clone(),
            contacts: (deflections.iter())
                .map(|holes| vec![Contact::Free; holes.len()])
                .collect(),
            tensions: (lines.iter())
                .map(|line| vec![0.0; line.lengths.len()])
                .collect(),
            rates: vec![Vector3::zeros(); robot.discs().len()],
            cotangents: deflections.clone(),
            deflections,
            lines,
        }
    }

    /// Sets the deflections before the step that is taken next.
    pub fn set_deflections(&mut self, deflections: &[Vec<f64>]) {
        self.deflections.clone_from_slice(deflections);
    }

    /// How many deflections there are.
    pub fn count(&self) -> usize {
        self.cotangents.iter().map(Vec::len).sum()
    }

    /// Takes the step that `rubbing` has taken under `command` with these rates at its begin, and accelerations (rad/s²).
    pub fn take(
        &mut self,
        equations: &EquationsOfMotion,
        rubbing: &Rubbing,
        command: &[f64],
        accelerations: &[f64],
    ) {
        let (robot, chain) = (&equations.robot, &equations.posture.chain);
        lay((&mut self.lines, &mut self.servos), robot, chain, command);
        let h = self.timestep;
        let accelerations = accelerations.as_chunks::<3>().0;
        for (joint, rate) in self.rates.iter_mut().enumerate() {
            let change = chain.axes(joint) * Vector3::from(accelerations[joint]) * h;
            *rate = equations.motions[joint].rate + change;
        }
        for (t, line) in self.lines.iter().enumerate() {
            let stiffness = line.friction.contact_stiffness;
            let mut begin = self.servos[t].tension;
            let mut tension = begin;
            let shortening = |place: usize| {
                let slope = line.length_slope(chain, place);
                -h * slope.dot(&self.rates[self.joints[t][place]])
            };
            let mut moved: f64 = (1..line.lengths.len()).map(shortening).sum();
            self.tensions[t][0] = tension;
            for hole in 0..line.wrap_angles.len() {
                let deflection = self.deflections[t][hole];
                let contact = Contact::new(line, hole, rubbing.assumed[t][hole], begin);
                let [at_begin, force] = match contact {
                    Contact::Sticks => [deflection, deflection + moved].map(|z| stiffness * z),
                    Contact::Slips { share, .. } => [begin, tension].map(|own| share * own),
                    Contact::Free => [0.0; 2],
                };
                self.contacts[t][hole] = contact;
                begin -= at_begin;
                tension -= force;
                self.tensions[t][hole + 1] = tension;
                moved -= shortening(hole + 1);
            }
        }
    }

    /// From the derivatives by the deflections after the step to those before it, through the law at its end: adds to those by the joints'
    /// `turns` after it and before it (in coordinates), and by the model.
    pub fn pull_back_end(
        &mut self,
        equations: &EquationsOfMotion,
        rubbing: &Rubbing,
        command: &[f64],
        [after, before]: [&mut [f64]; 2],
        model: &mut ModelTangent,
    ) {
        for (t, &command) in command.iter().enumerate() {
            let (line, profile) = (&rubbing.lines[t], &rubbing.before[t]);
            let stiffness = line.friction.contact_stiffness;
            let mut by = TendonCotangent::of(line);
            let mut begin = TendonCotangent::of(line);
            let mut by_tension = 0.0;
            for hole in (0..line.wrap_angles.len()).rev() {
                let by_deflection = &mut self.cotangents[t][hole];
                let tension = profile.tensions[hole];
                match Contact::new(line, hole, profile.slip_states[hole], tension) {
                    Contact::Sticks => {
                        *by_deflection -= stiffness * by_tension;
                        for beyond in hole + 1..line.lengths.len() {
                            begin.lengths[beyond] += *by_deflection;
                            by.lengths[beyond] -= *by_deflection;
                        }
                    }
                    Contact::Slips { share, steepness } => {
                        let by_force = *by_deflection / stiffness - by_tension;
                        by.share(line, hole, by_force * tension, steepness);
                        by_tension += share * by_force;
                        *by_deflection = 0.0;
                    }
                    Contact::Free => *by_deflection = 0.0,
                }
            }
            by.servo = by_tension;
            let ends = [
                (&rubbing.chain, line, &rubbing.servos[t], by, &mut *after),
                (
                    &equations.posture.chain,
                    &self.lines[t],
                    &self.servos[t],
                    begin,
                    &mut *before,
                ),
            ];
            for (chain, line, servo, by, turns) in ends {
                let tendon = Tendon {
                    number: t,
                    line,
                    servo,
                    chain,
                };
                self.pull_back_tendon(tendon, (&equations.robot, command), by, turns, model);
            }
        }
    }

    /// Adds the derivatives of the cost that has these `multipliers` on the residual moments, but for what the matrix of the step has:
    /// by the joints' `turns` and their rates before the step, by the deflections before it, and by the model.
    pub fn pull_back(
        &mut self,
        expanded: &Expanded,
        multipliers: &[Vector3<f64>],
        [turns, rates]: [&mut [f64]; 2],
        model: &mut ModelTangent,
    ) {
        let chain = &expanded.posture.chain;
        let mut strains: Vec<Vec<f64>> = Vec::with_capacity(self.lines.len());
        for t in 0..self.lines.len() {
            let (line, joints) = (&self.lines[t], &self.joints[t]);
            let stiffness = line.friction.contact_stiffness;
            let pull = |place: usize| {
                -line
                    .length_slope(chain, place)
                    .dot(&multipliers[joints[place]])
            };
            let mut by = TendonCotangent::of(line);
            let mut strain = vec![0.0; line.lengths.len()];
            let mut by_tension = 0.0;
            for hole in (0..line.wrap_angles.len()).rev() {
                by_tension += pull(hole + 1);
                match self.contacts[t][hole] {
                    Contact::Sticks => {
                        self.cotangents[t][hole] -= stiffness * by_tension;
                        for beyond in &mut strain[hole + 1..] {
                            *beyond += self.timestep * stiffness * by_tension;
                        }
                    }
                    Contact::Slips { share, steepness } => {
                        let by_share = -by_tension * self.tensions[t][hole];
                        by.share(line, hole, by_share, steepness);
                        by_tension -= share * by_tension;
                    }
                    Contact::Free => {}
                }
            }
            by.servo = by_tension + pull(0);
            let tendon = Tendon {
                number: t,
                line,
                servo: &self.servos[t],
                chain,
            };
            let command = expanded.command[t];
            self.pull_back_tendon(tendon, (expanded.robot, command), by, turns, model);
            strains.push(strain);
        }
        self.pull_back_strains(expanded, &strains, [turns, rates], model);
    }

    /// The derivatives of `sum strain_j c_j . v+`, `c_j` the slope of a segment's length and `v+` the rates at the end of the step.
    fn pull_back_strains(
        &self,
        expanded: &Expanded,
        strains: &[Vec<f64>],
        [turns, rates]: [&mut [f64]; 2],
        model: &mut ModelTangent,
    ) {
        let chain = &expanded.posture.chain;
        let mut sums = vec![Vector3::zeros(); self.rates.len()];
        let mut turned = sums.clone();
        let pieces = (expanded.robot.segments().iter()).zip(&expanded.posture.stretches);
        for (segment, stretch) in pieces {
            let strain = strains[segment.tendon][segment.place];
            let slope = stretch.gradient();
            sums[segment.joint] += slope * strain;
            turned[segment.joint] += stretch.hessian(&slope) * self.rates[segment.joint] * strain;
        }
        for (joint, (sum, rate)) in sums.iter().zip(&self.rates).enumerate() {
            // Turns of a ball joint do not commute; those of hinges turn the axes of those above.
            let by_turn = turned[joint]
                + match chain.hinges(joint) {
                    None => rate.cross(sum) * 0.5,
                    Some(hinges) => hinges.curving(sum) * rate,
                };
            add(
                &mut turns[3 * joint..][..3],
                &chain.axes(joint).tr_mul(&by_turn),
            );
            add(&mut rates[3 * joint..][..3], &chain.axes(joint).tr_mul(sum));
        }
        let strain = |tendon: usize, place: usize| [0.0, strains[tendon][place]];
        expanded.pull_back_segments(&self.rates, strain, model);
    }

    /// Adds the derivatives by what a tendon's lengths, angles and tension at the servo are made of.
    fn pull_back_tendon(
        &self,
        Tendon {
            number,
            line,
            servo,
            chain,
        }: Tendon,
        (robot, command): (&Robot, f64),
        mut by: TendonCotangent,
        turns: &mut [f64],
        model: &mut ModelTangent,
    ) {
        let tendon = (number, &robot.tendons()[number]);
        let stretch = (servo.stiffness, line.length() - command);
        let by_length = pull_back_tension(tendon, stretch, by.servo, model);
        by.lengths
            .iter_mut()
            .for_each(|length| *length += by_length);
        model.friction[number] += by.coefficient;
        model.fixed_lengths[number] += by_length;
        // By the span of each segment.
        let mut spans: Vec<Vector3<f64>> = (by.lengths.iter().enumerate())
            .map(|(place, by)| line.direction(place) * *by)
            .collect();
        let joints = &self.joints[number];
        let mut turn = |joint: usize, slope: &Vector3<f64>, by: f64| {
            let own = chain.axes(joint).tr_mul(slope) * by;
            add(&mut turns[3 * joint..][..3], &own);
        };
        for (place, by) in by.lengths.iter().enumerate() {
            turn(joints[place], &line.length_slope(chain, place), *by);
        }
        for (hole, &by) in by.angles.iter().enumerate() {
            if let (true, Some([first, second])) = (by != 0.0, line.wrap_by_ends(hole)) {
                let slopes = line.wrap_slopes(chain, hole);
                for (&joint, slope) in joints[hole..].iter().zip(&slopes) {
                    turn(joint, slope, by);
                }
                spans[hole] += first * by;
                spans[hole + 1] += second * by;
            }
        }
        for (place, span) in spans.iter().enumerate() {
            let joint = joints[place];
            let [from, to] = &mut model.segments[self.segments[number][place]];
            *from -= chain.orientations[joint].tr_mul(span);
            *to += chain.orientations[joint + 1].tr_mul(span);
        }
    }
}

/// A tendon in a posture.
struct Tendon<'a> {
    number: usize,
    line: &'a Line,
    servo: &'a TendonState,
    chain: &'a Chain,
}

fn add(out: &mut [f64], vector: &Vector3<f64>) {
    out.iter_mut()
        .zip(vector)
        .for_each(|(out, own)| *out += own);
}

impl Rubbing {
    /// How tensions follow from what is before them in the step that was taken.
    pub fn inflows(&self) -> &[Inflow] {
        &self.lu.inflows
    }
}
