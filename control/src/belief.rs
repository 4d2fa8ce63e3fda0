//! What a controller believes of a robot: its model, and what of it is not known.

use std::fmt;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Matrix3xX, Vector3};
use tdcr_sim::chain::Configuration;
use tdcr_sim::contact::{ContactError, ContactSettler};
use tdcr_sim::inverse::recording::{Marker, Servo, Touch};
use tdcr_sim::robot::{
    Axis, CommandError, Drive, Frame, Loads, LoadsError, Parameter, Robot, SpecError, Wrench,
};
use tdcr_sim::scene::{Scene, SceneError};
use tdcr_sim::sensitivity::{Sensitivity, SensitivityError};
use tdcr_sim::statics::{Equilibrium, NotSettled, Settler};
use thiserror::Error;

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

/// The model about one command: where it rests, and how that changes with the command and the unknowns.
#[derive(Clone, Debug)]
pub struct Linear {
    /// Where it rests.
    pub equilibrium: Equilibrium,
    sensitivity: Sensitivity,
    parameters: Vec<Parameter>,
    /// From changes of the command to those of the parameters, and from those of the unknowns.
    by_command: DMatrix<f64>,
    by_unknowns: DMatrix<f64>,
}

/// The longest rest length (m) and the largest tension (N) that a model may be asked for.
const REACH: [f64; 2] = [100.0, 1e6];

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
        self.settling = match scene.is_empty() {
            true => Settling::Alone(Box::new(Settler::new(&self.robot))),
            false => {
                let mut obstacles = scene.obstacles().to_vec();
                for obstacle in &mut obstacles {
                    obstacle.friction = 0.0;
                }
                let smooth = (scene.with_obstacles(obstacles))
                    .map_err(|error| BeliefError::Scene(Arc::new(error)))?;
                Settling::Among(Box::new(ContactSettler::new(&self.robot, &smooth)))
            }
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

    /// Where the robot rests under `command` (m or N).
    ///
    /// # Errors
    /// [`BeliefError`] where it does not settle.
    pub fn settle(&mut self, command: &[f64]) -> Result<&Equilibrium, BeliefError> {
        let (got, loads) = (self.pulled(command)?, self.all_loads()?);
        let found = match &mut self.settling {
            Settling::Alone(settler) => settler.follow(&got, &loads),
            Settling::Among(settler) => match &self.resting {
                Some(start) => &settler.settle_from(start, &got, &loads)?.equilibrium,
                None => &settler.follow(&got, &loads)?.equilibrium,
            },
        };
        match found.failure(&self.robot, &got) {
            None => Ok(found),
            Some(failure) => Err(failure.into()),
        }
    }

    /// Whether there are obstacles in it.
    pub fn is_among_obstacles(&self) -> bool {
        matches!(self.settling, Settling::Among(_))
    }

    /// Takes the robot to rest under `command` (m or N) now, from where it rested before. Beside an obstacle there are several equilibria
    /// of a command, of which a robot comes to one near where it was: those of other commands are sought from here on from this one.
    ///
    /// # Errors
    /// As [`settle`](Self::settle); it then counts as resting where it did.
    pub fn rest(&mut self, command: &[f64]) -> Result<(), BeliefError> {
        let found = self.settle(command)?.configuration.clone();
        self.resting = matches!(self.settling, Settling::Among(_)).then_some(found);
        Ok(())
    }

    /// Where the tip rests under `command` (m, world frame).
    ///
    /// # Errors
    /// As [`settle`](Self::settle).
    pub fn tip(&mut self, command: &[f64]) -> Result<Vector3<f64>, BeliefError> {
        Ok(self.settle(command)?.pose().tip().translation.vector)
    }

    /// The same with derivatives, by the implicit function theorem ([`Robot::sensitivity`]), contacts with obstacles in them.
    ///
    /// # Errors
    /// [`BeliefError`] where it does not settle, or has no derivatives.
    pub fn linearise(&mut self, command: &[f64]) -> Result<Linear, BeliefError> {
        let equilibrium = self.settle(command)?.clone();
        let (got, loads) = (self.pulled(command)?, self.all_loads()?);
        let sensitivity = match &self.settling {
            Settling::Alone(_) => self.robot.sensitivity(&got, &loads, &equilibrium)?,
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
    fn pulled(&self, command: &[f64]) -> Result<tdcr_sim::robot::Command, CommandError> {
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

impl Linear {
    /// Where a marker is (m, world frame).
    pub fn position(&self, marker: &Marker) -> Vector3<f64> {
        let disc = self.equilibrium.disc_pose(marker.disc);
        (disc * nalgebra::Point3::from(marker.place)).coords
    }

    /// Jacobians of markers' positions, three rows each (m), by the command and by the unknowns.
    ///
    /// # Errors
    /// [`BeliefError`] for a parameter that the robot does not have.
    pub fn marker_jacobians(&self, markers: &[Marker]) -> Result<[DMatrix<f64>; 2], BeliefError> {
        let discs = self.sensitivity.jacobian(&self.parameters)?;
        let mut rows = DMatrix::zeros(3 * markers.len(), self.parameters.len());
        for (place, marker) in markers.iter().enumerate() {
            let arm = self.equilibrium.orientations[marker.disc] * marker.place;
            let of_disc = discs.rows(6 * marker.disc, 6);
            for (column, change) in of_disc.column_iter().enumerate() {
                let position = Vector3::new(change[0], change[1], change[2]);
                let rotation = Vector3::new(change[3], change[4], change[5]);
                let moved = position + rotation.cross(&arm);
                rows.fixed_view_mut::<3, 1>(3 * place, column)
                    .copy_from(&moved);
            }
        }
        Ok([&rows * &self.by_command, &rows * &self.by_unknowns])
    }

    /// By how much the distances of points from the robot's surface, above 0 outside, shrink with the unknowns (m per unit): a row for
    /// each of the places nearest to them. It is exact, as the nearest place is a minimum of the distance (point to plane: Chen and
    /// Medioni, Image and Vision Computing 10, 1992).
    ///
    /// # Errors
    /// [`BeliefError`] for a parameter that the robot does not have.
    pub fn approaches(&self, touches: &[Touch]) -> Result<DMatrix<f64>, BeliefError> {
        let discs = self.sensitivity.jacobian(&self.parameters)? * &self.by_unknowns;
        let mut rows = DMatrix::zeros(touches.len(), self.by_unknowns.ncols());
        for (row, touch) in touches.iter().enumerate() {
            // What is fixed to the base does not move.
            let Some(disc) = touch.body else { continue };
            let arm = self.equilibrium.orientations[disc] * touch.in_body;
            let moment = arm.cross(&touch.normal);
            let along = discs.fixed_rows::<3>(6 * disc).tr_mul(&touch.normal);
            let about = discs.fixed_rows::<3>(6 * disc + 3).tr_mul(&moment);
            rows.set_row(row, &(along + about).transpose());
        }
        Ok(rows)
    }

    /// Where the tip is (m), and its Jacobian by the command (m per m or N).
    pub fn tip(&self) -> (Vector3<f64>, Matrix3xX<f64>) {
        let tip = self.equilibrium.positions.len() - 1;
        let discs = self.sensitivity.command_jacobian();
        let tendons = discs.ncols();
        let scaled = discs.fixed_rows::<3>(6 * tip) * self.by_command.rows(0, tendons);
        (self.equilibrium.positions[tip], scaled)
    }

    /// Jacobians of the tensions (N) by the command and by the unknowns, and the same of the lengths (m).
    ///
    /// # Errors
    /// [`BeliefError`] for a parameter that the robot does not have.
    pub fn tendon_jacobians(&self) -> Result<[[DMatrix<f64>; 2]; 2], BeliefError> {
        let found = self.sensitivity.tendon_jacobians(&self.parameters)?;
        Ok([found.tensions, found.lengths]
            .map(|rows| [&rows * &self.by_command, &rows * &self.by_unknowns]))
    }
}
