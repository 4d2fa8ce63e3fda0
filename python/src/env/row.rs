//! One robot of a batch.

use tdcr::control::plan::Insertion;
use tdcr::sim::chain::Configuration;
use tdcr::sim::contact::{ContactSettler, ContactStepper};
use tdcr::sim::dynamics::{Integrator, State, Stepper};
use tdcr::sim::robot::{Command, Frame, Loads, Payload, Robot, Wrench};
use tdcr::sim::scene::Scene;
use tdcr::sim::simulation::{MovingRobot, SimulationError};
use tdcr::sim::statics::Settler;

use super::shown::{Driven, Shown, Touch};
use crate::arrays::{Tape, flat_points, flat_quaternions};
use crate::errors::{Failure, Outcome};
use crate::objects;
use crate::statics::{read_memory, write_memory};

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

/// Motion in time: by `steps` time steps (s) at each advance.
#[derive(Clone, Copy)]
pub struct Motion {
    pub timestep: f64,
    pub steps: usize,
}

/// A robot of a batch.
pub struct Row {
    /// With its base where it is.
    pub robot: Robot,
    pub scene: Scene,
    /// With its base where its file has it.
    pub(super) own: Robot,
    driven: Driven,
    /// How far its base may be inserted, for one that moves.
    pub(super) carriage: Option<Insertion>,
    /// How far its base is inserted, and is to be (m).
    inserted: f64,
    pub(super) insertion: f64,
    /// Duration of an advance (s).
    pub(super) duration: f64,
    pub command: Command,
    pub loads: Loads,
    /// Whether it failed since its last reset: it then stands still.
    pub failed: bool,
    pub shown: Shown,
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
                (Driven::AtRest(Box::new(Settler::new(robot))), 0.0)
            }
            None => {
                let settler = ContactSettler::new(robot, scene);
                (Driven::InContact(Box::new(settler)), 0.0)
            }
            Some(Motion { timestep, steps }) => {
                let stepper = Stepper::new(robot, timestep, integrator)?;
                let stepper = ContactStepper::new(stepper, scene)?;
                let moving = MovingRobot::among(stepper, steps);
                (Driven::InMotion(Box::new(moving)), timestep * steps as f64)
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
            self.driven =
                Driven::InContact(Box::new(ContactSettler::new(&self.robot, &self.scene)));
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
            Driven::InContact(_) => !self.settle_on_the_way(),
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
    fn settle_on_the_way(&mut self) -> bool {
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
        let Driven::InContact(settler) = &mut self.driven else {
            return false;
        };
        let from = &self.shown.configuration;
        let found = settler.settle_from(from, &self.command, &self.loads);
        found.is_ok_and(|found| found.equilibrium.converged)
    }

    /// The obstacles around it, objects where they are now.
    pub fn scene_now(&self) -> &Scene {
        (self.driven.moving()).map_or(&self.scene, MovingRobot::scene)
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
        out.extend(&shown.objects);
        match &self.driven {
            Driven::AtRest(settler) => write_memory(&settler.memory(), &mut out),
            Driven::InContact(_) => {}
            Driven::InMotion(moving) => {
                // Before the first start there is no time.
                out.push(moving.taken().map_or(-1.0, |taken| taken as f64));
                out.extend(flat_quaternions(&moving.state().configuration.0));
                out.extend(&moving.state().velocity);
                out.extend(moving.acting().as_slice());
                let tendons = moving.tendon_profiles().iter();
                let deflections: Vec<f64> = tendons
                    .flat_map(|tendon| tendon.deflections.iter().copied())
                    .collect();
                // Robots whose coefficients all came to 0 have as many numbers.
                let holes = rubbed_holes(&self.robot).iter().sum();
                out.extend(
                    deflections
                        .iter()
                        .chain(std::iter::repeat(&0.0))
                        .take(holes),
                );
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
            objects: tape.take(self.shown.objects.len()).to_vec(),
        };
        match &mut self.driven {
            Driven::AtRest(settler) => {
                settler.resume(read_memory(&self.robot, &mut tape), &self.loads);
            }
            Driven::InContact(_) => {}
            Driven::InMotion(moving) => {
                moving.place_objects(&objects::written(&self.shown.objects))?;
                let taken = tape.number();
                let state = State {
                    configuration: Configuration(tape.quaternions(n)),
                    velocity: tape.take(3 * n).to_vec(),
                };
                // Servos that follow late are not where the command is.
                let acting = self.robot.command(tape.take(t))?;
                moving.resume_at(&state, &acting, (taken >= 0.0).then_some(taken as u64))?;
                let holes = rubbed_holes(&self.robot);
                let deflections = holes.iter().map(|&count| tape.take(count).to_vec());
                moving.set_deflections(&deflections.collect::<Vec<_>>())?;
            }
        }
        Ok(())
    }
}

/// Interior holes of each tendon of a robot whose file has friction; none of another.
fn rubbed_holes(robot: &Robot) -> Vec<usize> {
    let tendons = robot.tendons();
    match tendons.iter().any(|tendon| tendon.friction.is_some()) {
        true => tendons
            .iter()
            .map(|tendon| tendon.route.len() - 2)
            .collect(),
        false => Vec::new(),
    }
}
