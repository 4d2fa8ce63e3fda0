//! How the robot of a page follows its tendons: at rest, with friction in their holes, or in motion.
//!
//! At rest the session's settler is the robot. With friction, and in motion, a simulation of its own follows the session's commands,
//! and the settler goes on to say by which command a disc comes to a place.

use std::time::{Duration, Instant};

use tdcr_sim::chain::Configuration;
use tdcr_sim::contact::{Contact, ContactSettler, ContactStepper};
use tdcr_sim::dynamics::{DynamicsError, Integrator, State, Stepper};
use tdcr_sim::pose::Pose;
use tdcr_sim::robot::{Command, Loads, Robot, RobotSpec};
use tdcr_sim::scene::Scene;
use tdcr_sim::simulation::{MovingRobot, Physics, Simulation, SimulationError};
use tdcr_sim::statics::Equilibrium;
use tdcr_sim::tendon_friction::ContactPath;

use super::error::RequestError;

/// Time between two frames in motion: 60 in a second.
pub(super) const BEAT: Duration = Duration::from_nanos(16_666_667);
/// Time step of a motion (s).
pub(super) const TIMESTEP: f64 = 1e-3;
/// The longest time that one frame goes on by (s): after a pause the motion goes on where it was.
const LONGEST: f64 = 0.05;
/// Time steps between two commands on the way to the one that is asked for.
const CHUNK: u64 = 4;
/// Time (s) in which a tendon is wound from one end of its range to the other.
const WINDING: f64 = 0.4;

/// How a robot follows its tendons.
pub(super) enum Body {
    /// From equilibrium to equilibrium.
    AtRest,
    /// The same, with friction in the holes.
    WithFriction {
        path: Box<ContactPath>,
        coefficient: f64,
    },
    /// With inertia and damping.
    InMotion(Box<Motion>),
    /// It stays in a pose that was given.
    Posed(Box<MovingRobot>),
}

/// A robot in motion, whose tendons are wound towards what is asked for.
pub(super) struct Motion {
    moving: MovingRobot,
    /// Where the tendons are wound to by now (m, or N for a tension drive).
    at: Vec<f64>,
    /// When it was last moved.
    moved: Instant,
    /// Time that the last frame took to compute, as a share of the time that it covers.
    load: f64,
}

/// What a body says of itself, besides where it is.
pub(super) struct Shown<'a> {
    pub pose: Pose<'a>,
    pub contacts: &'a [Contact],
    /// Where it rests; none in motion.
    pub equilibrium: Option<&'a Equilibrium>,
}

impl Body {
    /// A body that begins at rest under a command.
    pub fn new(
        physics: Physics,
        robot: &Robot,
        scene: &Scene,
        (command, loads): (&Command, &Loads),
    ) -> Result<Self, RequestError> {
        Ok(match physics {
            Physics::AtRest => Self::AtRest,
            Physics::WithFriction { coefficient } => {
                let rubbing = Robot::new(rubbed(robot.spec(), coefficient))?;
                let mut path = Box::new(ContactPath::new(&rubbing, scene));
                path.start(command, loads)?;
                Self::WithFriction { path, coefficient }
            }
            Physics::InMotion { timestep, .. } => Self::InMotion(Box::new(Motion::new(
                robot,
                scene,
                timestep,
                (command, loads),
            )?)),
        })
    }

    /// A robot in a pose that was given.
    pub fn posed(
        robot: &Robot,
        configuration: &Configuration,
        command: &Command,
    ) -> Result<Self, RequestError> {
        // Placed, never stepped: any time step will do.
        let mut placed = MovingRobot::new(robot, TIMESTEP, Integrator::default(), 1)
            .map_err(SimulationError::from)?;
        placed.start_at(&State::at_rest(configuration.clone()), command)?;
        Ok(Self::Posed(Box::new(placed)))
    }

    /// By what physics it follows; one that was placed, from rest.
    pub fn physics(&self) -> Physics {
        match self {
            Self::AtRest | Self::Posed(_) => Physics::AtRest,
            Self::WithFriction { coefficient, .. } => Physics::WithFriction {
                coefficient: *coefficient,
            },
            Self::InMotion(motion) => Physics::InMotion {
                timestep: motion.moving.stepper().timestep(),
                friction: None,
            },
        }
    }

    /// Takes over another command or other loads; a robot at rest has done so already, and one in motion does with time.
    pub fn advance(&mut self, command: &Command, loads: &Loads) -> Result<(), RequestError> {
        if let Self::WithFriction { path, .. } = self {
            path.advance(command, loads)?;
        }
        Ok(())
    }

    /// Begins anew at rest under a command.
    pub fn reset(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        match self {
            Self::AtRest | Self::Posed(_) => Ok(()),
            Self::WithFriction { path, .. } => {
                path.start(command, loads)?;
                Ok(())
            }
            Self::InMotion(motion) => motion.reset(command, loads),
        }
    }

    /// Goes on in time by what has passed, where it is in motion.
    pub fn go_on(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        match self {
            Self::InMotion(motion) => motion.go_on(command, loads),
            _ => Ok(()),
        }
    }

    /// Time since the start (s), and the share of the time that computing takes, where it is in motion.
    pub fn time(&self) -> Option<(f64, f64)> {
        match self {
            Self::InMotion(motion) => Some((motion.moving.time(), motion.load)),
            _ => None,
        }
    }

    /// Where it is; at rest that is where `settler` has it.
    pub fn show<'a>(&'a self, settler: &'a ContactSettler) -> Shown<'a> {
        match self {
            Self::AtRest => {
                let found = settler.found();
                Shown {
                    pose: found.equilibrium.pose(),
                    contacts: &found.contacts,
                    equilibrium: Some(&found.equilibrium),
                }
            }
            Self::WithFriction { path, .. } => {
                let equilibrium = &path.state().equilibrium;
                Shown {
                    pose: equilibrium.pose(),
                    contacts: path.contacts(),
                    equilibrium: Some(equilibrium),
                }
            }
            Self::InMotion(motion) => Shown {
                pose: motion.moving.pose(),
                contacts: motion.moving.contacts(),
                equilibrium: None,
            },
            Self::Posed(placed) => Shown {
                pose: placed.pose(),
                contacts: &[],
                equilibrium: None,
            },
        }
    }
}

impl Motion {
    fn new(
        robot: &Robot,
        scene: &Scene,
        timestep: f64,
        (command, loads): (&Command, &Loads),
    ) -> Result<Self, SimulationError> {
        let begin = |integrator| {
            let stepper = Stepper::new(robot, timestep, integrator)?;
            let stepper = ContactStepper::new(stepper, scene)?;
            let mut moving = MovingRobot::among(stepper, 1);
            moving.reset(command, loads)?;
            Ok(moving)
        };
        // A robot that is too stiff for explicit steps of this length moves by implicit ones.
        let moving = match begin(Integrator::SemiImplicitEuler) {
            Err(SimulationError::Dynamics(DynamicsError::Unstable { .. })) => {
                begin(Integrator::ImplicitEuler)?
            }
            other => other?,
        };
        Ok(Self {
            moving,
            at: command.as_slice().to_vec(),
            moved: Instant::now(),
            load: 0.0,
        })
    }

    fn reset(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        self.moving.reset(command, loads)?;
        self.at = command.as_slice().to_vec();
        self.moved = Instant::now();
        Ok(())
    }

    fn go_on(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        let begun = Instant::now();
        let passed = begun.duration_since(self.moved).as_secs_f64();
        self.moved = begun;
        let timestep = self.moving.stepper().timestep();
        let steps = (passed.min(LONGEST) / timestep).round() as u64;
        let mut left = steps;
        while left > 0 {
            let chunk = left.min(CHUNK);
            left -= chunk;
            let wound = self.wind(command, chunk as f64 * timestep)?;
            self.moving.advance_by(&wound, loads, chunk as usize)?;
        }
        if steps > 0 {
            self.load = begun.elapsed().as_secs_f64() / (steps as f64 * timestep);
        }
        Ok(())
    }

    /// Winds the tendons towards a command for a time (s).
    fn wind(&mut self, to: &Command, time: f64) -> Result<Command, SimulationError> {
        let robot = self.moving.robot().clone();
        let tendons = robot.tendons().iter().zip(to.as_slice());
        for (at, (tendon, &to)) in self.at.iter_mut().zip(tendons) {
            let most = (tendon.range[1] - tendon.range[0]) * time / WINDING;
            *at += (to - *at).clamp(-most, most);
        }
        Ok(robot.command(&self.at)?)
    }
}

/// The robot with this coefficient of friction in the holes of all tendons.
fn rubbed(spec: &RobotSpec, coefficient: f64) -> RobotSpec {
    let mut spec = spec.clone();
    (spec.tendon_specs_mut()).for_each(|tendon| tendon.set_friction(coefficient));
    spec
}
