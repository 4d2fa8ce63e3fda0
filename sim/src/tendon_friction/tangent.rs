//! How a path changes with what it depends on: first-order changes, carried along it.
//!
//! At an accepted substep the balance `r(q, p, a) = 0` holds with contacts that stick or slip as they do. `a` is what the path
//! remembers: of each contact the anchor `a_h = z_h + B_h`, the length `B_h` of the tendon beyond at which it would not be
//! deflected. A change of the parameters `p` and of the anchors turns the joints by `-J⁻¹ dr` (implicit function theorem, the
//! active set frozen); then the anchor of a contact that sticks stays, and that of one that slips follows from its force. It is the consistent
//! linearisation of the return mapping (Simo and Hughes, Computational Inelasticity, ch. 3). What a snap leads to keeps no
//! memory of what was before: the contacts' forces there count as given.
//!
//! A parameter is given as a robot in which it is a little different, as in [`crate::sensitivity`]; changes are differences, not
//! divided by that of the parameter.

use nalgebra::Vector3;

use super::balance::Balance;
use super::{FrictionPath, SlipState, TendonProfile};
use crate::capstan::Line;
use crate::energy::{DeadForces, Potential};
use crate::factor::Inflow;
use crate::robot::{Loads, Pull, Robot, Tendon};
use crate::tendon::Posture;

/// Stiffness (N/m) that stands for that of a tendon whose length is commanded: its length misses by the share of the robot's own
/// stiffness in it.
const HELD: f64 = 1e8;

/// What contacts do when something changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Law {
    /// They keep their forces: at the start of a path, and after a snap.
    Given,
    /// They stick and slip as they do.
    Capstan,
}

/// Changes of a path.
#[derive(Clone, Debug)]
pub(crate) struct Tangents {
    changes: Vec<Change>,
    /// Changes of the commands where the path last was, and where it is led to (m or N).
    from: Vec<Vec<f64>>,
    to: Vec<Vec<f64>>,
    storage: Storage,
}

#[derive(Clone, Debug)]
struct Change {
    /// The robot in which a parameter is different, with its tendons' lines; none where only commands are.
    robot: Option<(Robot, Vec<Line>)>,
    /// Change of each contact's anchor (m).
    anchors: Vec<Vec<f64>>,
    /// Turn of each joint, world axes (rad).
    turns: Vec<Vector3<f64>>,
}

#[derive(Clone, Debug)]
struct Storage {
    posture: Posture,
    dead: DeadForces,
    own: Vec<Vector3<f64>>,
    changed: Vec<Vector3<f64>>,
    joints: Vec<Vec<usize>>,
    slopes: Vec<Vec<Vector3<f64>>>,
    pieces: Vec<Pieces>,
}

/// What changes along one tendon at fixed joints.
#[derive(Clone, Debug, Default)]
struct Pieces {
    /// Lengths of its segments (m).
    lengths: Vec<f64>,
    /// Forces of its contacts, but for those by tensions and lengths (N).
    forces: Vec<f64>,
    /// Compliance of its contacts times their forces, negative (m).
    yields: Vec<f64>,
    /// Tension at its servo, but for that by its length (N).
    servo: f64,
}

impl Tangents {
    /// Changes of paths of `robot` towards each of `changed`; none where a change is of commands alone. `None` for a robot
    /// with tendons that pass discs by.
    pub fn new(robot: &Robot, changed: Vec<Option<Robot>>) -> Option<Self> {
        Balance::new(robot).linear.chain.as_ref()?;
        let lines = |robot: &Robot| -> Vec<Line> {
            let tendons = robot.tendons().iter();
            tendons.map(|tendon| Line::new(robot, tendon)).collect()
        };
        let own = lines(robot);
        let still = vec![Vector3::zeros(); robot.discs().len()];
        let mut joints: Vec<Vec<usize>> = vec![Vec::new(); own.len()];
        for segment in robot.segments() {
            joints[segment.tendon].push(segment.joint);
        }
        let change = |changed: Option<Robot>| Change {
            robot: changed.map(|robot| {
                let lines = lines(&robot);
                (robot, lines)
            }),
            anchors: own
                .iter()
                .map(|line| vec![0.0; line.wrap_angles.len()])
                .collect(),
            turns: still.clone(),
        };
        let commands = vec![vec![0.0; own.len()]; changed.len()];
        Some(Self {
            changes: changed.into_iter().map(change).collect(),
            from: commands.clone(),
            to: commands,
            storage: Storage {
                posture: Posture::new(robot),
                dead: DeadForces::new(robot),
                own: still.clone(),
                changed: still,
                slopes: joints
                    .iter()
                    .map(|j| vec![Vector3::zeros(); j.len()])
                    .collect(),
                pieces: (own.iter())
                    .map(|line| Pieces {
                        lengths: vec![0.0; line.lengths.len()],
                        forces: vec![0.0; line.wrap_angles.len()],
                        yields: vec![0.0; line.wrap_angles.len()],
                        servo: 0.0,
                    })
                    .collect(),
                joints,
            },
        })
    }

    /// Says by how much each change moves the command that the path is led to next (m or N).
    pub fn aim(&mut self, commands: impl Iterator<Item = Vec<f64>>) {
        for (to, command) in self.to.iter_mut().zip(commands) {
            *to = command;
        }
    }

    /// How far a change moves a point that is at `from` in the frame of `disc` (m), and with the change at `to`, where the path
    /// stands.
    pub fn displacement(
        &mut self,
        change: usize,
        path: &FrictionPath,
        disc: usize,
        [from, to]: [Vector3<f64>; 2],
    ) -> Vector3<f64> {
        let iterate = &path.balance.iterate;
        let chain = &iterate.posture.chain;
        let point = chain.positions[disc] + chain.disc(disc) * from;
        let change = &self.changes[change];
        let mut moved = match &change.robot {
            None => chain.disc(disc) * (to - from),
            Some((robot, _)) => {
                let posture = &mut self.storage.posture;
                place(posture, robot, &path.balance);
                posture.chain.positions[disc] + posture.chain.disc(disc) * to - point
            }
        };
        for (turn, centre) in change.turns.iter().zip(&chain.centres).take(disc + 1) {
            moved += turn.cross(&(point - centre));
        }
        moved
    }

    /// Turn of each joint by a change, world axes (rad).
    pub(super) fn turns(&self, change: usize) -> &[Vector3<f64>] {
        &self.changes[change].turns
    }

    /// Takes over that the path has gone `part` of the way.
    pub(super) fn arrive(&mut self, part: f64) {
        for (from, to) in self.from.iter_mut().zip(&self.to) {
            for (from, to) in from.iter_mut().zip(to) {
                *from += part * (to - *from);
            }
        }
    }

    /// Carries the changes over a substep that the path has taken, which led it to `part` of the way.
    pub(super) fn step(&mut self, balance: &mut Balance, part: f64, law: Law) {
        balance.linearise_contacts(law);
        balance.expansion.gradient(&mut self.storage.own);
        for segment in balance.robot.segments() {
            let stretch = segment.stretch(&balance.iterate.posture.chain);
            self.storage.slopes[segment.tendon][segment.place] = stretch.gradient();
        }
        let commands = self.from.iter().zip(&self.to);
        for (change, (from, to)) in self.changes.iter_mut().zip(commands) {
            balance.linear.rhs.fill(Vector3::zeros());
            if let Some((robot, lines)) = &mut change.robot {
                self.storage.reshape(balance, robot, lines);
            } else {
                self.storage.keep_shape();
            }
            for t in 0..from.len() {
                let command = from[t] + part * (to[t] - from[t]);
                let changed = change
                    .robot
                    .as_ref()
                    .map(|(robot, lines)| (robot, &lines[t]));
                self.storage.pull(balance, t, command, changed, law);
                self.storage
                    .trace(balance, t, None, &mut change.anchors[t], law);
            }
            balance.linear.solve();
            change.turns.copy_from_slice(&balance.linear.solution);
            for (t, anchors) in change.anchors.iter_mut().enumerate() {
                self.storage
                    .trace(balance, t, Some(&change.turns), anchors, law);
            }
        }
    }
}

/// Places a changed robot in the configuration of `balance`.
fn place(posture: &mut Posture, robot: &Robot, balance: &Balance) {
    posture.chain.orientations[0] = *robot.base_orientation().to_rotation_matrix().matrix();
    posture.place(robot, &balance.iterate.configuration);
}

/// Whether a tendon's length is commanded, and the tendon pulls.
fn is_held(tendon: &Tendon, tension: f64) -> bool {
    tendon.holds_length() && (tension != 0.0 || tendon.pull == Pull::Bilateral)
}

impl Balance {
    /// Prepares to solve with the Jacobian of the balance where it stands, the contacts as they are.
    fn linearise_contacts(&mut self, law: Law) {
        for (assumed, profile) in self.assumed.iter_mut().zip(&self.profiles) {
            assumed.copy_from_slice(&profile.slip_states);
        }
        self.linearise_with(|balance, t, inflow, place| match place {
            0 if is_held(&balance.robot.tendons()[t], balance.profiles[t].tensions[0]) => Inflow {
                beyond: -HELD,
                ..inflow
            },
            0 => inflow,
            _ if law == Law::Given => Inflow {
                before: 1.0,
                ..Inflow::NONE
            },
            _ => inflow,
        });
    }
}

impl Storage {
    /// What the shape of a changed robot does at fixed joints: to the moments on them, under the present tensions, and to the lengths
    /// and angles of its tendons.
    fn reshape(&mut self, balance: &mut Balance, robot: &Robot, lines: &mut [Line]) {
        place(&mut self.posture, robot, balance);
        self.dead.set(robot, &balance.loads);
        let potential = Potential {
            robot,
            command: &balance.rest,
            dead: &self.dead,
        };
        let tension = |tendon: usize, place: usize| balance.profiles[tendon].tensions[place];
        let q = &balance.iterate.configuration;
        potential.gradient_pulled(q, &self.posture, tension, &mut self.changed);
        for (rhs, (own, changed)) in
            (balance.linear.rhs.iter_mut()).zip(self.own.iter().zip(&self.changed))
        {
            *rhs = own - changed;
        }
        for (line, (own, pieces)) in lines
            .iter_mut()
            .zip(balance.lines.iter().zip(&mut self.pieces))
        {
            line.lay(robot, &self.posture.chain);
            for (change, (changed, own)) in pieces
                .lengths
                .iter_mut()
                .zip(line.lengths.iter().zip(&own.lengths))
            {
                *change = changed - own;
            }
        }
    }

    fn keep_shape(&mut self) {
        for pieces in &mut self.pieces {
            pieces.lengths.fill(0.0);
        }
    }

    /// What a change does to a tendon at fixed joints, but for what tensions and lengths do along it.
    fn pull(
        &mut self,
        balance: &Balance,
        t: usize,
        command: f64,
        changed: Option<(&Robot, &Line)>,
        law: Law,
    ) {
        let (line, profile) = (&balance.lines[t], &balance.profiles[t]);
        let own = &balance.robot.tendons()[t];
        let pieces = &mut self.pieces[t];
        let (length, rest) = (line.length(), balance.rest[t]);
        let tendon = changed.map_or(own, |(robot, _)| &robot.tendons()[t]);
        pieces.servo = match is_held(own, profile.tensions[0]) {
            true => -HELD * command,
            false => tendon.state(length, rest + command).tension - own.state(length, rest).tension,
        };
        pieces.forces.fill(0.0);
        pieces.yields.fill(0.0);
        let (Some((_, other)), Law::Capstan) = (changed, law) else {
            return;
        };
        let rubs = other.friction.coefficient - line.friction.coefficient;
        let (sigma, stiffer) = (
            line.friction.contact_stiffness,
            other.friction.contact_stiffness - line.friction.contact_stiffness,
        );
        for hole in 0..pieces.forces.len() {
            let contact = profile.slip_states[hole];
            let deflection = profile.deflections[hole];
            pieces.forces[hole] = match contact {
                SlipState::Sticks => stiffer * deflection,
                _ => {
                    let [_, by_angle, _] = profile.slopes(line, hole, contact);
                    let turned = other.wrap_angles[hole] - line.wrap_angles[hole];
                    by_angle * turned + rubs * profile.slope_by_coefficient(line, hole, contact)
                }
            };
            pieces.yields[hole] = -stiffer * deflection / sigma;
        }
    }

    /// Follows a change of tension along a tendon. Without turns it adds the moments that this makes at fixed joints to the
    /// right-hand side; with them it moves the anchors.
    fn trace(
        &self,
        balance: &mut Balance,
        t: usize,
        turns: Option<&[Vector3<f64>]>,
        anchors: &mut [f64],
        law: Law,
    ) {
        let (pieces, slopes, joints) = (&self.pieces[t], &self.slopes[t], &self.joints[t]);
        let turned =
            |place: usize| turns.map_or(0.0, |turns| slopes[place].dot(&turns[joints[place]]));
        let mut beyond: f64 = (0..joints.len())
            .map(|place| pieces.lengths[place] + turned(place))
            .sum();
        let Some(chain) = &balance.linear.chain else {
            return;
        };
        let profile: &TendonProfile = &balance.profiles[t];
        let sigma = balance.lines[t].friction.contact_stiffness;
        let mut tension = 0.0;
        for (place, &joint) in joints.iter().enumerate() {
            let inflow = &chain.inflows[chain.place(joint, t)];
            if let Some(hole) = place.checked_sub(1) {
                beyond -= pieces.lengths[hole] + turned(hole);
                // The force of the contact: by angle and coefficient, then by lengths where it sticks, by the tension where it slips.
                let mut force = pieces.forces[hole];
                match (law, profile.slip_states[hole]) {
                    (Law::Given, _) => force = 0.0,
                    (_, SlipState::Sticks) => force += sigma * (anchors[hole] - beyond),
                    _ => {
                        force += (1.0 - inflow.before) * tension;
                        if let Some(turns) = turns {
                            force +=
                                inflow.below.dot(&turns[joint - 1]) + inflow.own.dot(&turns[joint]);
                        }
                    }
                }
                let slips = law == Law::Given || profile.slip_states[hole] != SlipState::Sticks;
                if slips && turns.is_some() {
                    anchors[hole] = force / sigma + pieces.yields[hole] + beyond;
                }
                tension -= force;
            } else {
                tension = pieces.servo - inflow.beyond * beyond;
            }
            if turns.is_none() {
                balance.linear.rhs[joint] -= slopes[place] * tension;
            }
        }
    }
}

impl FrictionPath {
    /// The same that carries tangents along.
    pub(crate) fn with_tangents(mut self, tangents: Option<Tangents>) -> Self {
        self.tangents = tangents;
        self
    }

    /// Carries the tangents over a substep.
    pub(super) fn carry(&mut self, part: f64, law: Law) {
        if let Some(tangents) = &mut self.tangents {
            tangents.step(&mut self.balance, part, law);
        }
    }

    /// Begins tangents at the start of a path.
    pub(super) fn begin_tangents(&mut self, command: &[f64], loads: &Loads) {
        if self.tangents.is_some() {
            self.balance.load(command, loads, &self.state.tendons);
            self.balance.take(&self.state.tendons);
            self.carry(1.0, Law::Given);
        }
    }
}
