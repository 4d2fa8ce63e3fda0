//! What a controller believes of a robot: its model, and what of it is not known.

mod linear;
mod rubbing;

use std::fmt;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Vector3};
use tdcr_sim::chain::Configuration;
use tdcr_sim::contact::{ContactError, ContactSettler};
use tdcr_sim::inverse::recording::Servo;
use tdcr_sim::robot::{
    Axis, Command, CommandError, Drive, Frame, Loads, LoadsError, Parameter, Robot, SpecError,
    Wrench,
};
use tdcr_sim::scene::{Scene, SceneError};
use tdcr_sim::sensitivity::SensitivityError;
use tdcr_sim::statics::{Equilibrium, NotSettled, Settler};
use thiserror::Error;

pub use linear::Linear;
use rubbing::Rubbing;

/// A number that the model does not have, and that measurements may tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Unknown {
    /// Mass hung from the distal disc's origin beside the known loads (kg); below 0 where the robot bears less.
    Payload,
    /// A force on the distal disc's origin along an axis of the world (N).
    TipForce(Axis),
    /// [`Servo::offset`] of a tendon: pretension, where home is off (m, or N for a tension drive).
    Offset(usize),
    /// How much [`Servo::gain`] of a tendon is above 1: the error of its spool.
    Gain(usize),
}

/// Its name, tendons counted from 1 as people read them.
impl fmt::Display for Unknown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Payload => f.write_str("payload"),
            Self::TipForce(axis) => write!(f, "tip force {axis}"),
            Self::Offset(tendon) => write!(f, "offset of tendon {}", tendon + 1),
            Self::Gain(tendon) => write!(f, "gain of tendon {}", tendon + 1),
        }
    }
}

/// Why a model says nothing.
#[derive(Clone, Debug, Error)]
#[non_exhaustive]
pub enum BeliefError {
    /// The robot is not valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// An unknown of a tendon that the robot does not have, or one that is named twice.
    #[error("the {unknown} cannot be estimated: {reason}")]
    Unknown {
        /// The unknown.
        unknown: Unknown,
        /// Why.
        reason: &'static str,
    },
    /// Loads of another robot.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// A command of another robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// The model does not settle.
    #[error("the model does not settle: {0}")]
    NotSettled(#[from] NotSettled),
    /// It cannot be settled among its obstacles.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// Its obstacles are none.
    #[error(transparent)]
    Scene(Arc<SceneError>),
    /// The model has no derivatives there.
    #[error(transparent)]
    Sensitivity(#[from] SensitivityError),
}

/// A robot's model with values of what is unknown. Equilibria are followed from one to the next.
#[derive(Clone, Debug)]
pub struct Belief {
    robot: Robot,
    settling: Settling,
    /// The way that the robot took, where its tendons have friction.
    rubbing: Option<Box<Rubbing>>,
    /// Where the robot rests among obstacles now; `None` before that is known.
    resting: Option<Configuration>,
    loads: Loads,
    /// Length of each tendon in the straight pose (m).
    straight: Vec<f64>,
    unknowns: Vec<Unknown>,
    values: DVector<f64>,
}

/// What finds the model's equilibria.
#[derive(Clone, Debug)]
enum Settling {
    Alone(Box<Settler>),
    Among(Box<ContactSettler>),
}

/// The longest rest length (m) and the largest tension (N) that a model may be asked for.
const REACH: [f64; 2] = [100.0, 1e6];

/// Share of the change of estimates that the way of a model with friction takes over each time.
const FOLLOWED: f64 = 0.05;

impl Belief {
    /// The robot under known loads, every one of `unknowns` 0.
    ///
    /// # Errors
    /// [`BeliefError`] for loads and unknowns that the robot does not have.
    pub fn new(robot: &Robot, loads: &Loads, unknowns: &[Unknown]) -> Result<Self, BeliefError> {
        loads.check(robot)?;
        for (place, &unknown) in unknowns.iter().enumerate() {
            let reason = match unknown {
                Unknown::Offset(t) | Unknown::Gain(t) if t >= robot.tendons().len() => {
                    "the robot has no such tendon"
                }
                _ if unknowns[..place].contains(&unknown) => "it is named twice",
                _ => continue,
            };
            return Err(BeliefError::Unknown { unknown, reason });
        }
        // Offsets and gains lead past the ranges of commands.
        let mut spec = robot.spec().clone();
        for tendon in spec.tendon_specs_mut() {
            tendon.range = match tendon.drive {
                Drive::Gain(_) | Drive::Length => [0.0, REACH[0]],
                Drive::Tension => [0.0, REACH[1]],
            };
        }
        let robot = Robot::new(spec)?;
        Ok(Self {
            straight: robot.tendon_kinematics(&Configuration::straight(&robot)).0,
            settling: Settling::Alone(Box::new(Settler::new(&robot))),
            rubbing: Rubbing::new(&robot, &Scene::default(), unknowns.len()),
            resting: None,
            values: DVector::zeros(unknowns.len()),
            unknowns: unknowns.to_vec(),
            loads: loads.clone(),
            robot,
        })
    }

    /// The same among the obstacles of `scene`, on which the model slides without friction: a controller asks for equilibria beside the path
    /// that the robot takes, and friction would depend on which were asked for.
    ///
    /// # Errors
    /// [`BeliefError::Scene`] for obstacles that are none without friction.
    pub fn among(mut self, scene: &Scene) -> Result<Self, BeliefError> {
        let mut obstacles = scene.obstacles().to_vec();
        for obstacle in &mut obstacles {
            obstacle.friction = 0.0;
        }
        let smooth = (scene.with_obstacles(obstacles))
            .map_err(|error| BeliefError::Scene(Arc::new(error)))?;
        self.rubbing = Rubbing::new(&self.robot, &smooth, self.unknowns.len());
        self.settling = match scene.is_empty() {
            true => Settling::Alone(Box::new(Settler::new(&self.robot))),
            false => Settling::Among(Box::new(ContactSettler::new(&self.robot, &smooth))),
        };
        Ok(self)
    }

    /// The robot; its tendons' ranges are wider than those of commands.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The loads that are known of.
    pub fn loads(&self) -> &Loads {
        &self.loads
    }

    /// What is unknown.
    pub fn unknowns(&self) -> &[Unknown] {
        &self.unknowns
    }

    /// Their values, in units of [`Unknown`].
    pub fn values(&self) -> &DVector<f64> {
        &self.values
    }

    /// Gives them other values.
    ///
    /// # Panics
    /// If there is not one for each.
    pub fn set_values(&mut self, values: &DVector<f64>) {
        self.values.copy_from(values);
    }

    /// The value of one of them; 0 where it is not among them.
    pub fn value(&self, unknown: Unknown) -> f64 {
        let place = self.unknowns.iter().position(|&other| other == unknown);
        place.map_or(0.0, |place| self.values[place])
    }

    /// Where the robot rests under `command` (m or N): with friction of tendons, where it comes to rest on the way from where it rests now.
    ///
    /// # Errors
    /// [`BeliefError`] where it does not settle.
    pub fn settle(&mut self, command: &[f64]) -> Result<&Equilibrium, BeliefError> {
        let (got, loads) = (self.pulled(command)?, self.all_loads()?);
        match &mut self.rubbing {
            Some(rubbing) => settled(rubbing.settle(&got, &loads)?, &self.robot, &got),
            None => without_friction(
                &mut self.settling,
                self.resting.as_ref(),
                &self.robot,
                &got,
                &loads,
            ),
        }
    }

    /// Whether there are obstacles in it.
    pub fn is_among_obstacles(&self) -> bool {
        matches!(self.settling, Settling::Among(_))
    }

    /// Takes the robot to rest under `command` (m or N) now, from where it rested before. Beside an obstacle there are several equilibria
    /// of a command, of which a robot comes to one near where it was, and with friction of tendons it depends on the way: those of other commands are
    /// sought from here on from this one.
    ///
    /// # Errors
    /// As [`settle`](Self::settle); it then counts as resting where it did.
    pub fn rest(&mut self, command: &[f64]) -> Result<(), BeliefError> {
        let (got, loads) = (self.pulled(command)?, self.all_loads()?);
        let found = without_friction(
            &mut self.settling,
            self.resting.as_ref(),
            &self.robot,
            &got,
            &loads,
        )?;
        let found = found.configuration.clone();
        self.resting = self.is_among_obstacles().then_some(found);
        let Some(rubbing) = &mut self.rubbing else {
            return Ok(());
        };
        // What noise does to estimates moves no tendon through its holes.
        rubbing.values += (&self.values - &rubbing.values) * FOLLOWED;
        let now = std::mem::replace(&mut self.values, rubbing.values.clone());
        let led = (self.pulled(command), self.all_loads());
        self.values = now;
        let (got, loads) = (led.0?, led.1?);
        if let Some(rubbing) = &mut self.rubbing {
            settled(rubbing.rest(&got, &loads)?, &self.robot, &got)?;
        }
        Ok(())
    }

    /// By what the tip moved (m) when the robot came to rest under the command `to`, having rested under `from`.
    ///
    /// # Errors
    /// As [`settle`](Self::settle).
    pub fn moved(&mut self, from: &[f64], to: &[f64]) -> Result<Vector3<f64>, BeliefError> {
        if let Some(rubbing) = &self.rubbing {
            let commands = [self.pulled(from)?, self.pulled(to)?];
            let [there, here] = rubbing.last_step(commands.each_ref(), &self.all_loads()?)?;
            return Ok(here - there);
        }
        Ok(self.tip(to)? - self.tip(from)?)
    }

    /// Where the tip rests under `command` (m, world frame).
    ///
    /// # Errors
    /// As [`settle`](Self::settle).
    pub fn tip(&mut self, command: &[f64]) -> Result<Vector3<f64>, BeliefError> {
        Ok(self.settle(command)?.pose().tip().translation.vector)
    }

    /// The same with derivatives, by the implicit function theorem ([`Robot::sensitivity`]), contacts with obstacles in them. With friction of
    /// tendons those by the command are of the way there ([`ContactPath::advance_differentiated`](tdcr_sim::tendon_friction::ContactPath::advance_differentiated)), where that has any, and the others as without.
    ///
    /// # Errors
    /// [`BeliefError`] where it does not settle, or has no derivatives.
    pub fn linearise(&mut self, command: &[f64]) -> Result<Linear, BeliefError> {
        let equilibrium = self.settle(command)?.clone();
        let (got, loads) = (self.pulled(command)?, self.all_loads()?);
        let by_tendons = match &self.rubbing {
            Some(rubbing) => rubbing.by_tendons(&got, &loads)?,
            None => None,
        };
        let without = match self.rubbing {
            Some(_) => without_friction(
                &mut self.settling,
                self.resting.as_ref(),
                &self.robot,
                &got,
                &loads,
            )?
            .clone(),
            None => equilibrium.clone(),
        };
        let sensitivity = match &self.settling {
            Settling::Alone(_) => self.robot.sensitivity(&got, &loads, &without)?,
            Settling::Among(settler) => settler.sensitivity(&got, &loads)?.parameters().clone(),
        };
        let tendons = self.robot.tendons().len();
        let mut parameters: Vec<Parameter> = (0..tendons).map(Parameter::Command).collect();
        let tip = self.tip_disc();
        parameters.extend(Axis::ALL.map(|axis| Parameter::Force(tip, axis)));
        let mut by_command = DMatrix::zeros(parameters.len(), tendons);
        for t in 0..tendons {
            by_command[(t, t)] = 1.0 + self.value(Unknown::Gain(t));
        }
        let mut by_unknowns = DMatrix::zeros(parameters.len(), self.unknowns.len());
        for (column, &unknown) in self.unknowns.iter().enumerate() {
            match unknown {
                Unknown::Payload => {
                    for axis in 0..3 {
                        by_unknowns[(tendons + axis, column)] = self.robot.spec().gravity[axis];
                    }
                }
                Unknown::TipForce(axis) => by_unknowns[(tendons + axis.index(), column)] = 1.0,
                Unknown::Offset(t) => by_unknowns[(t, column)] = self.sign(t),
                Unknown::Gain(t) => {
                    by_unknowns[(t, column)] = self.sign(t) * self.pull(t, command[t]);
                }
            }
        }
        Ok(Linear {
            equilibrium,
            sensitivity,
            by_tendons,
            parameters,
            by_command,
            by_unknowns,
        })
    }

    fn tip_disc(&self) -> usize {
        self.robot.discs().len() - 1
    }

    /// Whether a tendon's command grows with what its servo pulls, or falls.
    fn sign(&self, tendon: usize) -> f64 {
        match self.robot.tendons()[tendon].drive {
            Drive::Tension => 1.0,
            Drive::Gain(_) | Drive::Length => -1.0,
        }
    }

    /// How far a servo pulls by a command, from the straight pose (m or N).
    fn pull(&self, tendon: usize, command: f64) -> f64 {
        match self.robot.tendons()[tendon].drive {
            Drive::Tension => command,
            Drive::Gain(_) | Drive::Length => self.straight[tendon] - command,
        }
    }

    /// What the tendons get by a command.
    fn pulled(&self, command: &[f64]) -> Result<Command, CommandError> {
        let got = command.iter().enumerate().map(|(t, &value)| {
            let Some(tendon) = self.robot.tendons().get(t) else {
                return value;
            };
            let servo = Servo {
                gain: 1.0 + self.value(Unknown::Gain(t)),
                offset: self.value(Unknown::Offset(t)),
                backlash: 0.0,
            };
            servo.command(tendon.drive, self.straight[t], self.pull(t, value))
        });
        let got: Vec<f64> = got.collect();
        self.robot.command(&got)
    }

    /// The known loads and the unknown ones.
    fn all_loads(&self) -> Result<Loads, LoadsError> {
        let payload = self.value(Unknown::Payload);
        let gravity = self.robot.spec().gravity;
        let force = Axis::ALL
            .map(|axis| payload * gravity[axis.index()] + self.value(Unknown::TipForce(axis)));
        if force == [0.0; 3] {
            return Ok(self.loads.clone());
        }
        self.loads.clone().with_wrench(Wrench {
            force,
            ..Wrench::none(self.tip_disc(), Frame::World)
        })
    }
}

/// Where a robot rests whose tendons have no friction, near where it rests now.
fn without_friction<'s>(
    settling: &'s mut Settling,
    resting: Option<&Configuration>,
    robot: &Robot,
    got: &Command,
    loads: &Loads,
) -> Result<&'s Equilibrium, BeliefError> {
    let found = match (settling, resting) {
        (Settling::Alone(settler), _) => settler.follow(got, loads),
        (Settling::Among(settler), Some(start)) => {
            &settler.settle_from(start, got, loads)?.equilibrium
        }
        (Settling::Among(settler), None) => &settler.follow(got, loads)?.equilibrium,
    };
    settled(found, robot, got)
}

/// An equilibrium that is one.
fn settled<'e>(
    found: &'e Equilibrium,
    robot: &Robot,
    got: &Command,
) -> Result<&'e Equilibrium, BeliefError> {
    match found.failure(robot, got) {
        None => Ok(found),
        Some(failure) => Err(failure.into()),
    }
}
