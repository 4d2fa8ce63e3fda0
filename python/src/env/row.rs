//! One robot of a batch.

use nalgebra::{UnitQuaternion, Vector3};
use tdcr::control::plan::Insertion;
use tdcr::sim::chain::Configuration;
use tdcr::sim::contact::{Contact, ContactLaw, ContactSettler, ContactStepper};
use tdcr::sim::dynamics::{Integrator, State, Stepper};
use tdcr::sim::pose::Pose;
use tdcr::sim::robot::{Command, Frame, Loads, Payload, Robot, Wrench};
use tdcr::sim::scene::Scene;
use tdcr::sim::simulation::{MovingRobot, Simulation, SimulationError};
use tdcr::sim::statics::Settler;

use crate::arrays::{Tape, flat_points, flat_quaternions};
use crate::errors::{Failure, Outcome};
use crate::statics::{read_memory, write_memory};

/// Largest entries of an observation: places (lengths of the robot), joint rates (rad/s), the tip's velocity (lengths/s), tensions (N).
const LARGEST_PLACE: f64 = 2.0;
const LARGEST_RATE: f64 = 50.0;
const LARGEST_VELOCITY: f64 = 20.0;
const LARGEST_TENSION: f64 = 1000.0;

/// How far a base moves between two equilibria at most, as a share of the widest disc's radius.
const THRUST: f64 = 0.1;

/// What a robot is to do next.
pub struct Asked<'a> {
    /// Of each tendon (m or N), and of a base that moves how far it is inserted (m).
    pub command: &'a [f64],
    /// Payload (kg); that of before where there is none.
    pub payload: Option<f64>,
    /// Force on the tip disc, world axes (N).
    pub force: [f64; 3],
}

/// What is observed of a robot besides its command.
#[derive(Clone, Copy)]
pub struct Observed {
    /// All discs, or the tip alone.
    pub whole: bool,
    /// Also the tendons' tensions.
    pub tensions: bool,
}

/// Motion in time: by `steps` time steps (s) at each advance.
#[derive(Clone, Copy)]
pub struct Motion {
    pub timestep: f64,
    pub steps: usize,
}

/// What observations of places are measured by: an origin (m), and the length (m) that counts as 1.
#[derive(Clone, Copy)]
pub struct Scale {
    pub origin: Vector3<f64>,
    pub length: f64,
}

/// How a robot is driven.
enum Driven {
    Still(Box<Settler>),
    /// Among obstacles.
    Leaning(Box<ContactSettler>),
    Moving(Box<MovingRobot>),
}

impl Driven {
    fn simulation(&mut self) -> &mut dyn Simulation {
        match self {
            Self::Still(settler) => settler.as_mut(),
            Self::Leaning(settler) => settler.as_mut(),
            Self::Moving(moving) => moving.as_mut(),
        }
    }

    /// What it touches.
    fn contacts(&self) -> &[Contact] {
        match self {
            Self::Still(_) => &[],
            Self::Leaning(settler) => &settler.found().contacts,
            Self::Moving(moving) => moving.contacts(),
        }
    }
}

/// What a robot touches.
#[derive(Clone)]
pub struct Touch {
    /// Number of contacts.
    pub count: usize,
    /// Largest of their forces, and the sum of these (N).
    pub largest: f64,
    pub sum: f64,
    /// Force on each disc, world axes (N).
    pub on_discs: Vec<Vector3<f64>>,
}

impl Touch {
    fn nothing(discs: usize) -> Self {
        Self {
            count: 0,
            largest: 0.0,
            sum: 0.0,
            on_discs: vec![Vector3::zeros(); discs],
        }
    }

    fn take(&mut self, contacts: &[Contact]) {
        self.on_discs.fill(Vector3::zeros());
        (self.count, self.largest, self.sum) = (contacts.len(), 0.0, 0.0);
        for contact in contacts {
            self.on_discs[contact.disc] += contact.force;
            if let Some(other) = contact.partner.disc() {
                self.on_discs[other] -= contact.force;
            }
            let force = contact.force.norm();
            self.largest = self.largest.max(force);
            self.sum += force;
        }
    }
}

/// Where a robot was last seen: after its last advance that did not fail.
pub struct Shown {
    configuration: Configuration,
    pub positions: Vec<Vector3<f64>>,
    pub orientations: Vec<UnitQuaternion<f64>>,
    pub lengths: Vec<f64>,
    pub tensions: Vec<f64>,
    /// Of the joints (rad/s), three entries each; 0 where the robot does not move in time.
    pub rates: Vec<f64>,
    /// Of the tip, the mean over the last advance (m/s); 0 where the robot does not move in time.
    velocity: Vector3<f64>,
    pub touch: Touch,
}

/// A robot of a batch.
pub struct Row {
    /// With its base where it is.
    pub robot: Robot,
    pub scene: Scene,
    /// With its base where its file has it.
    own: Robot,
    driven: Driven,
    /// How far its base may be inserted, for one that moves.
    carriage: Option<Insertion>,
    /// How far its base is inserted, and is to be (m).
    inserted: f64,
    insertion: f64,
    /// Duration of an advance (s).
    duration: f64,
    pub command: Command,
    pub loads: Loads,
    /// Whether it failed since its last reset: it then stands still.
    pub failed: bool,
    pub shown: Shown,
}

impl Shown {
    fn new(robot: &Robot) -> Self {
        let (discs, tendons) = (robot.discs().len(), robot.tendons().len());
        Self {
            configuration: Configuration::straight(robot),
            positions: vec![Vector3::zeros(); discs],
            orientations: vec![UnitQuaternion::identity(); discs],
            lengths: vec![0.0; tendons],
            tensions: vec![0.0; tendons],
            rates: vec![0.0; 3 * discs],
            velocity: Vector3::zeros(),
            touch: Touch::nothing(discs),
        }
    }

    pub fn pose(&self) -> Pose<'_> {
        Pose {
            configuration: &self.configuration,
            positions: &self.positions,
            orientations: &self.orientations,
            tendon_lengths: &self.lengths,
            tendon_tensions: &self.tensions,
        }
    }

    fn tip(&self) -> Vector3<f64> {
        self.positions.last().copied().unwrap_or_default()
    }

    fn take(&mut self, driven: &Driven) {
        let pose = match driven {
            Driven::Still(settler) => settler.pose(),
            Driven::Leaning(settler) => settler.pose(),
            Driven::Moving(moving) => {
                self.rates.copy_from_slice(&moving.state().velocity);
                moving.pose()
            }
        };
        (self.configuration.0).copy_from_slice(&pose.configuration.0);
        self.positions.copy_from_slice(pose.positions);
        self.orientations.copy_from_slice(pose.orientations);
        self.lengths.copy_from_slice(pose.tendon_lengths);
        self.tensions.copy_from_slice(pose.tendon_tensions);
        self.touch.take(driven.contacts());
    }
}

impl Row {
    /// A robot that rests, or that moves in time, in a scene; its base stands, or is inserted.
    pub fn new(
        robot: &Robot,
        scene: &Scene,
        motion: Option<Motion>,
        carriage: Option<Insertion>,
    ) -> Outcome<Self> {
        let integrator = Integrator::default();
        let (driven, duration) = match motion {
            None if scene.is_empty() && carriage.is_none() => {
                (Driven::Still(Box::new(Settler::new(robot))), 0.0)
            }
            None => {
                let settler = ContactSettler::new(robot, scene);
                (Driven::Leaning(Box::new(settler)), 0.0)
            }
            Some(Motion { timestep, steps }) => {
                let stepper = Stepper::new(robot, timestep, integrator)?;
                let stepper = ContactStepper::new(stepper, scene, ContactLaw::default())?;
                let moving = MovingRobot::among(stepper, steps);
                (Driven::Moving(Box::new(moving)), timestep * steps as f64)
            }
        };
        let mut shown = Shown::new(robot);
        shown.take(&driven);
        Ok(Self {
            driven,
            duration,
            command: robot.mean_command(),
            loads: Loads::default(),
            failed: false,
            shown,
            robot: robot.clone(),
            own: robot.clone(),
            scene: scene.clone(),
            carriage,
            inserted: 0.0,
            insertion: 0.0,
        })
    }

    /// The same row with another robot, and in another scene, of which `None` is the one of before. It must then be reset.
    pub fn anew(
        &self,
        robot: Option<&Robot>,
        scene: Option<&Scene>,
        motion: Option<Motion>,
    ) -> Outcome<Self> {
        let (robot, scene) = (robot.unwrap_or(&self.own), scene.unwrap_or(&self.scene));
        Self::new(robot, scene, motion, self.carriage)
    }

    /// Sets what it is driven by next.
    pub fn ask(&mut self, asked: &Asked) -> Outcome<()> {
        let (command, insertion) = asked.command.split_at(self.own.tendons().len());
        self.command = self.own.command(command)?;
        if let (Some(carriage), &[insertion]) = (self.carriage, insertion) {
            let [low, high] = carriage.range;
            if !(low..=high).contains(&insertion) {
                let message = format!("an insertion of {insertion} m; expected {low} to {high} m");
                return Err(Failure::input(message));
            }
            self.insertion = insertion;
        }
        let payload = Payload {
            mass: (asked.payload).unwrap_or_else(|| self.loads.tip_payload().mass),
            ..self.loads.tip_payload()
        };
        self.loads = Loads::default().with_payload(payload)?;
        if asked.force != [0.0; 3] {
            let tip = Wrench::none(self.own.discs().len() - 1, Frame::World);
            let force = asked.force;
            self.loads = std::mem::take(&mut self.loads).with_wrench(Wrench { force, ..tip })?;
        }
        Ok(())
    }

    /// The force that is asked for on the tip disc (N).
    fn force(&self) -> [f64; 3] {
        self.loads.wrenches().first().map_or([0.0; 3], |w| w.force)
    }

    /// Moves the base to where it is inserted so far (m). The robot's configuration is kept in `shown`.
    fn carry(&mut self, insertion: f64) -> Outcome<()> {
        if insertion != self.inserted {
            let robot = Insertion::moved(&self.own, insertion);
            self.robot = robot.map_err(|error| Failure::input(error.to_string()))?;
            self.driven = Driven::Leaning(Box::new(ContactSettler::new(&self.robot, &self.scene)));
            self.inserted = insertion;
        }
        Ok(())
    }

    /// Starts anew, at rest, with nothing left of what was before. Fails where it does not settle, which is flagged, and
    /// where the time step is too long for the robot or this starts inside an obstacle, which is returned.
    pub fn reset(&mut self) -> Outcome<()> {
        self.carry(self.insertion)?;
        let (command, loads) = (&self.command, &self.loads);
        let reset = self.driven.simulation().reset(command, loads);
        self.failed = reset.is_err();
        if !self.failed {
            self.shown.take(&self.driven);
        }
        self.shown.velocity.fill(0.0);
        match reset {
            Err(SimulationError::Dynamics(error)) => Err(error.into()),
            Err(SimulationError::Contact(error)) => Err(error.into()),
            _ => Ok(()),
        }
    }

    /// Advances, unless it failed before.
    pub fn advance(&mut self) {
        if self.failed {
            return;
        }
        let before = self.shown.tip();
        self.failed = match &mut self.driven {
            Driven::Leaning(_) => !self.lean(),
            driven => (driven.simulation())
                .advance(&self.command, &self.loads)
                .is_err(),
        };
        if !self.failed {
            self.shown.take(&self.driven);
            if self.duration > 0.0 {
                self.shown.velocity = (self.shown.tip() - before) / self.duration;
            }
        }
    }

    /// Settles where it is asked to from where it was last seen, the base moved in small steps. Whether it settles.
    ///
    /// Without friction, so that the last configuration is all that its future depends on.
    fn lean(&mut self) -> bool {
        let (start, way) = (self.inserted, self.insertion - self.inserted);
        let widest = (self.own.discs().iter()).fold(0.0, |most: f64, disc| most.max(disc.radius));
        let steps = (way.abs() / (THRUST * widest)).ceil().max(1.0) as u32;
        let asked = self.insertion;
        for step in 1..=steps {
            let before = self.inserted;
            let insertion = match step == steps {
                true => asked,
                false => start + way * f64::from(step) / f64::from(steps),
            };
            if self.carry(insertion).is_err() || !self.settle_here() {
                // It stands where it was last seen.
                let _ = self.carry(before);
                self.insertion = before;
                return false;
            }
            self.shown.take(&self.driven);
        }
        true
    }

    /// Settles among obstacles from where it was last seen; whether it does.
    fn settle_here(&mut self) -> bool {
        let Driven::Leaning(settler) = &mut self.driven else {
            return false;
        };
        let from = &self.shown.configuration;
        let found = settler.settle_from(from, &self.command, &self.loads);
        found.is_ok_and(|found| found.equilibrium.converged)
    }

    /// All that its future depends on, and where it was last seen, as numbers for [`Self::restore`].
    pub fn state(&self) -> Vec<f64> {
        let mut out = vec![f64::from(self.failed), self.loads.tip_payload().mass];
        out.extend(self.command.as_slice());
        out.extend(self.carriage.map(|_| self.inserted));
        out.extend(self.force());
        let shown = &self.shown;
        out.extend(flat_quaternions(&shown.configuration.0));
        out.extend(flat_points(&shown.positions));
        out.extend(flat_quaternions(&shown.orientations));
        out.extend(
            shown
                .lengths
                .iter()
                .chain(&shown.tensions)
                .chain(&shown.rates),
        );
        out.extend(flat_points(&[shown.velocity]));
        let touch = &shown.touch;
        out.extend([touch.count as f64, touch.largest, touch.sum]);
        out.extend(flat_points(&touch.on_discs));
        match &self.driven {
            Driven::Still(settler) => write_memory(&settler.memory(), &mut out),
            Driven::Leaning(_) => {}
            Driven::Moving(moving) => {
                // Before the first start there is no time.
                out.push(moving.taken().map_or(-1.0, |taken| taken as f64));
                out.extend(flat_quaternions(&moving.state().configuration.0));
                out.extend(&moving.state().velocity);
            }
        }
        out
    }

    /// Goes on, to the last bit, from the state of a row of the same robot.
    pub fn restore(&mut self, numbers: &[f64]) -> Outcome<()> {
        let (n, t) = (self.robot.discs().len(), self.robot.tendons().len());
        let mut tape = Tape(numbers);
        let (failed, payload) = (tape.number() == 1.0, tape.number());
        let command = tape.take(t + usize::from(self.carriage.is_some()));
        let force = [tape.number(), tape.number(), tape.number()];
        self.ask(&Asked {
            command,
            payload: Some(payload),
            force,
        })?;
        self.carry(self.insertion)?;
        self.failed = failed;
        self.shown = Shown {
            configuration: Configuration(tape.quaternions(n)),
            positions: tape.points(n),
            orientations: tape.quaternions(n),
            lengths: tape.take(t).to_vec(),
            tensions: tape.take(t).to_vec(),
            rates: tape.take(3 * n).to_vec(),
            velocity: tape.points(1)[0],
            touch: Touch {
                count: tape.number() as usize,
                largest: tape.number(),
                sum: tape.number(),
                on_discs: tape.points(n),
            },
        };
        match &mut self.driven {
            Driven::Still(settler) => {
                settler.resume(read_memory(&self.robot, &mut tape), &self.loads);
            }
            Driven::Leaning(_) => {}
            Driven::Moving(moving) => {
                let taken = tape.number();
                let state = State {
                    configuration: Configuration(tape.quaternions(n)),
                    velocity: tape.take(3 * n).to_vec(),
                };
                moving.resume_at(
                    &state,
                    &self.command,
                    (taken >= 0.0).then_some(taken as u64),
                )?;
            }
        }
        Ok(())
    }

    /// Number of entries that [`Self::observe`] writes.
    pub fn width(&self, observed: Observed) -> usize {
        let (discs, tendons) = (self.own.discs().len(), self.own.tendons().len());
        let (at_rest, in_motion) = if observed.whole { (7, 3) } else { (6, 3) };
        let bodies = if observed.whole { discs } else { 1 };
        let moves = if self.duration > 0.0 { in_motion } else { 0 };
        let pulls = if observed.tensions { tendons } else { 0 };
        tendons + usize::from(self.carriage.is_some()) + bodies * (at_rest + moves) + pulls
    }

    /// Writes an observation: the command of each tendon (-1 to 1 over its range), that of a base that moves, then
    ///
    /// - of the `whole` robot the discs' places, their quaternions (w, x, y, z), and in motion the joints' rates (rad/s);
    /// - of the tip alone its place, its axis, and in motion its velocity (lengths/s);
    /// - where they are asked for, the tendons' tensions (N).
    pub fn observe(&self, scale: Scale, observed: Observed, out: &mut [f32]) {
        let (shown, moves, whole) = (&self.shown, self.duration > 0.0, observed.whole);
        let mut out = out.iter_mut();
        let mut put = |value: f64, largest: f64| {
            if let Some(out) = out.next() {
                *out = value.clamp(-largest, largest) as f32;
            }
        };
        let ranges = self.own.tendons().iter().map(|tendon| tendon.range);
        let ranges = ranges.chain(self.carriage.map(|carriage| carriage.range));
        let commands = self.command.as_slice().iter().chain([&self.insertion]);
        for ([low, high], command) in ranges.zip(commands) {
            let width = high - low;
            let share = (command - low) / if width > 0.0 { width } else { 1.0 };
            put(2.0 * share - 1.0, 1.0);
        }
        let place = |position: &Vector3<f64>| (position - scale.origin) / scale.length;
        let bodies = if whole { 0 } else { shown.positions.len() - 1 };
        for position in &shown.positions[bodies..] {
            place(position).iter().for_each(|&x| put(x, LARGEST_PLACE));
        }
        if whole {
            for q in &shown.orientations {
                [q.w, q.i, q.j, q.k].iter().for_each(|&x| put(x, 1.0));
            }
        } else if let Some(tip) = shown.orientations.last() {
            let axis = tip * Vector3::z();
            axis.iter().for_each(|&x| put(x, 1.0));
        }
        if moves && whole {
            shown.rates.iter().for_each(|&x| put(x, LARGEST_RATE));
        } else if moves {
            let velocity = shown.velocity / scale.length;
            velocity.iter().for_each(|&x| put(x, LARGEST_VELOCITY));
        }
        if observed.tensions {
            shown.tensions.iter().for_each(|&x| put(x, LARGEST_TENSION));
        }
    }
}
