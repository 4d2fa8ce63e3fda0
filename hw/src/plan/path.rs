//! From one shape to another, past slack and overload.

use tdcr_sim::robot::{Command, CommandError, Loads, Robot};
use tdcr_sim::statics::Settler;
use thiserror::Error;

use super::shape::{Place, Shape, ShapeError, Shaper};

/// Distance along a path (m, of the tendon that moves the most) at which tensions are asked of the simulator.
const CHECK_EVERY: f64 = 5e-4;

/// Most steps of a way: hours of motion, and some tens of megabytes.
const LONGEST: usize = 500_000;

/// Why there is no way.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PlanError {
    /// The robot has no shapes.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// A command lies beyond the robot's ranges.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// A command lies beyond the limits of its servo.
    #[error(
        "tendon {} would have the command {command:.4} m; its servo allows {low:.4} to {high:.4} m",
        tendon + 1
    )]
    Limit {
        /// Which tendon, from 0; people read it from 1.
        tendon: usize,
        /// Its command (m).
        command: f64,
        /// Smallest command (m).
        low: f64,
        /// Largest command (m).
        high: f64,
    },
    /// A tendon would go slack, or be overloaded.
    #[error("tendon {} would have a tension of {tension:.2} N, {} of the way; expected {low} to {high} N", tendon + 1, percent(*.part))]
    Tension {
        /// Which tendon, from 0; people read it from 1.
        tendon: usize,
        /// Its tension (N).
        tension: f64,
        /// Where on the way, from 0 to 1.
        part: f64,
        /// Smallest tension (N).
        low: f64,
        /// Largest tension (N).
        high: f64,
    },
    /// The simulator finds no equilibrium.
    #[error("the simulated robot does not settle, {} of the way", percent(*.part))]
    NotSettled {
        /// Where on the way, from 0 to 1.
        part: f64,
    },
    /// The way has more steps than anybody waits for.
    #[error(
        "the way has {steps:.1e} steps of {step:.1e} m, more than {LONGEST}: allow a larger motion.slew, or a longer motion.period"
    )]
    TooLong {
        /// Its steps.
        steps: f64,
        /// A step (m).
        step: f64,
    },
    /// Chance has found no command.
    #[error(
        "none of {draws} draws is a command that the robot survives: {last}; allow less bend or other tensions"
    )]
    NoCommand {
        /// How many were drawn.
        draws: usize,
        /// What was wrong with the last.
        last: Box<PlanError>,
    },
}

fn percent(part: f64) -> String {
    format!("{:.0} %", 100.0 * part)
}

/// Leads from shape to shape.
#[derive(Clone, Debug)]
pub struct Planner {
    shaper: Shaper,
    settler: Settler,
    /// Smallest and largest command of each tendon (m).
    limits: Vec<[f64; 2]>,
    /// Smallest and largest tension (N).
    tension: [f64; 2],
    /// Largest step of a tendon (m).
    step: f64,
    /// What the robot carries.
    loads: Loads,
}

impl Planner {
    /// For `robot`, whose tendons have commands within `limits` (m), one for each, and tensions within `tension` (N), and
    /// move by no more than `step` (m) at once.
    ///
    /// # Errors
    /// [`PlanError::Shape`].
    ///
    /// # Panics
    /// If `limits` are not one for each tendon, or `step` is not positive.
    pub fn new(
        robot: &Robot,
        limits: Vec<[f64; 2]>,
        tension: [f64; 2],
        step: f64,
    ) -> Result<Self, PlanError> {
        assert_eq!(limits.len(), robot.tendons().len(), "one for each tendon");
        assert!(step > 0.0, "a step above 0");
        Ok(Self {
            shaper: Shaper::new(robot)?,
            settler: Settler::new(robot),
            limits,
            tension,
            step,
            loads: Loads::default(),
        })
    }

    /// The same for a robot that carries these loads.
    pub fn carrying(self, loads: Loads) -> Self {
        Self { loads, ..self }
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        self.shaper.robot()
    }

    /// What turns shapes into commands.
    pub fn shaper(&mut self) -> &mut Shaper {
        &mut self.shaper
    }

    /// The command of a shape, within limits.
    ///
    /// # Errors
    /// [`PlanError::Command`], [`PlanError::Limit`].
    pub fn command(&mut self, shape: &Shape) -> Result<Command, PlanError> {
        let values = self.shaper.commands(shape);
        self.within_limits(&values)
    }

    /// The command of a place, within limits.
    ///
    /// # Errors
    /// As [`command`](Self::command).
    pub fn command_at(&mut self, place: &Place) -> Result<Command, PlanError> {
        match place {
            Place::Shape(shape) => self.command(shape),
            Place::Command(command) => self.within_limits(command.as_slice()),
        }
    }

    fn within_limits(&self, values: &[f64]) -> Result<Command, PlanError> {
        for (tendon, (&command, &[low, high])) in values.iter().zip(&self.limits).enumerate() {
            if !(low..=high).contains(&command) {
                return Err(PlanError::Limit {
                    tendon,
                    command,
                    low,
                    high,
                });
            }
        }
        Ok(self.robot().command(values)?)
    }

    /// The tensions (N) that the simulator finds under the command of a place, followed from where it was last asked for.
    ///
    /// # Errors
    /// As [`command`](Self::command); [`PlanError::NotSettled`].
    pub fn tensions(&mut self, place: &Place) -> Result<Vec<f64>, PlanError> {
        let command = self.command_at(place)?;
        let settled = self.settler.follow(&command, &self.loads);
        match settled.converged {
            true => Ok(settled.tendon_tensions.to_vec()),
            false => Err(PlanError::NotSettled { part: 1.0 }),
        }
    }

    /// Commands from `from` (not included) to `to`, on the straight line of bends and tensions, no tendon moving by more than
    /// a step between two, each with tensions within their bounds.
    ///
    /// # Errors
    /// [`PlanError`]: the first thing that is wrong on the way.
    pub fn straight(&mut self, from: &Shape, to: &Shape) -> Result<Vec<Command>, PlanError> {
        let ends = [self.command(from)?, self.command(to)?];
        self.line(ends, |planner, part| {
            planner.command(&from.toward(to, part))
        })
    }

    /// The same between places of which one at least is no shape, on the straight line of commands.
    fn straight_commands(&mut self, from: &Place, to: &Place) -> Result<Vec<Command>, PlanError> {
        let ends = [self.command_at(from)?, self.command_at(to)?];
        let [start, end] = [&ends[0], &ends[1]].map(|command| command.as_slice().to_vec());
        self.line(ends, |planner, part| {
            let values = start.iter().zip(&end);
            let values: Vec<f64> = values.map(|(a, b)| a + part * (b - a)).collect();
            Ok(planner.robot().command(&values)?)
        })
    }

    /// The steps of a line between two commands, of which `between` says those on the way by their part of it.
    fn line(
        &mut self,
        ends: [Command; 2],
        mut between: impl FnMut(&mut Self, f64) -> Result<Command, PlanError>,
    ) -> Result<Vec<Command>, PlanError> {
        let [start, end] = [&ends[0], &ends[1]].map(Command::as_slice);
        let length = start
            .iter()
            .zip(end)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        // Lengths are all but straight in the bends; a tenth is kept for what they are not.
        let steps = (1.1 * length / self.step).ceil().max(1.0);
        if steps > LONGEST as f64 {
            let step = self.step;
            return Err(PlanError::TooLong { steps, step });
        }
        let steps = steps as usize;
        let checked = (CHECK_EVERY / self.step).floor().max(1.0) as usize;
        self.settler.settle(&ends[0], &self.loads);
        (1..=steps)
            .map(|k| {
                let part = k as f64 / steps as f64;
                let command = match k == steps {
                    // As it was drawn, to the last bit.
                    true => ends[1].clone(),
                    false => between(self, part)?,
                };
                if k % checked == 0 || k == steps {
                    self.check(&command, part)?;
                }
                Ok(command)
            })
            .collect()
    }

    /// The same between places: on the straight line of commands where one of them is no shape.
    ///
    /// # Errors
    /// As [`straight`](Self::straight).
    pub fn straight_between(
        &mut self,
        from: &Place,
        to: &Place,
    ) -> Result<Vec<Command>, PlanError> {
        match (from, to) {
            (Place::Shape(from), Place::Shape(to)) => self.straight(from, to),
            _ => self.straight_commands(from, to),
        }
    }

    /// The same by way of `rest` where the straight line leads past a bound; the way from `rest` to `to` has to be one.
    ///
    /// # Errors
    /// As [`straight`](Self::straight), of the way by `rest`.
    pub fn path(
        &mut self,
        from: impl Into<Place>,
        to: impl Into<Place>,
        rest: &Shape,
    ) -> Result<Vec<Command>, PlanError> {
        let (from, to) = (from.into(), to.into());
        if let Ok(path) = self.straight_between(&from, &to) {
            return Ok(path);
        }
        let rest = rest.into();
        let mut path = self.straight_between(&from, &rest)?;
        path.extend(self.straight_between(&rest, &to)?);
        Ok(path)
    }

    /// Refuses a command under which the simulator finds a tendon slack or overloaded. The robot is followed from where it was
    /// last asked for.
    fn check(&mut self, command: &Command, part: f64) -> Result<(), PlanError> {
        let settled = self.settler.follow(command, &self.loads);
        if !settled.converged {
            return Err(PlanError::NotSettled { part });
        }
        let [low, high] = self.tension;
        for (tendon, &tension) in settled.tendon_tensions.iter().enumerate() {
            if !(low..=high).contains(&tension) {
                return Err(PlanError::Tension {
                    tendon,
                    tension,
                    part,
                    low,
                    high,
                });
            }
        }
        Ok(())
    }
}
