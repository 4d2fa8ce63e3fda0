//! From one shape to another, past slack and overload.

use nalgebra::Vector3;
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;
use tdcr_sim::statics::Settler;

use super::clear::{KeptClear, LOOK_EVERY};
use super::error::{LONGEST, PlanError};
use super::shape::{Place, Shape, Shaper};

/// Distance along a path (m, of the tendon that moves the most) at which tensions are asked of the simulator.
const CHECK_EVERY: f64 = 5e-4;

/// Most halvings of a step in search of how a disc moves past obstacles: what is a millimetre of tendon is then a micrometre.
const HALVINGS: usize = 10;

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
    /// What it keeps clear of.
    clear: Option<KeptClear>,
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
            clear: None,
        })
    }

    /// The same for a robot whose discs keep a distance (m) from the obstacles of a scene, wherever they are on a way.
    pub fn clear_of(self, scene: Scene, clearance: f64) -> Self {
        let clear = KeptClear::new(self.robot(), scene, clearance);
        Self {
            clear: Some(clear),
            ..self
        }
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

    /// Refuses a place that is too near to an obstacle.
    ///
    /// # Errors
    /// [`PlanError::Near`]; as [`tensions`](Self::tensions).
    pub fn require_clear(&mut self, place: &Place) -> Result<(), PlanError> {
        let command = self.command_at(place)?;
        let Some(clear) = &self.clear else {
            return Ok(());
        };
        let settled = self.settler.settle(&command, &self.loads);
        match settled.converged {
            true => clear.check(settled.pose(), 0.0),
            false => Err(PlanError::NotSettled { part: 0.0 }),
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
        let mut last = ends[0].clone();
        (1..=steps)
            .map(|k| {
                let part = k as f64 / steps as f64;
                let command = match k == steps {
                    // As it was drawn, to the last bit.
                    true => ends[1].clone(),
                    false => between(self, part)?,
                };
                if k % checked == 0 || k == steps {
                    self.check_way(&last, &command, part)?;
                    last.clone_from(&command);
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

    /// Refuses a command as [`check`](Self::check), and a way to it from the last one, where the robot is, on which a disc comes too
    /// near to an obstacle.
    fn check_way(&mut self, last: &Command, command: &Command, part: f64) -> Result<(), PlanError> {
        let from = self.settler.equilibrium().positions.to_vec();
        self.check(command, part)?;
        if self.clear.is_some() {
            let to = self.settler.equilibrium().positions.to_vec();
            self.look_between([(last, &from), (command, &to)], part, HALVINGS)?;
            self.settler.follow(command, &self.loads);
        }
        Ok(())
    }

    /// Looks at the commands between two, whose discs' origins are known (m), until none of the discs moves farther than
    /// [`LOOK_EVERY`] from one to the next.
    fn look_between(
        &mut self,
        ends: [(&Command, &[Vector3<f64>]); 2],
        part: f64,
        halvings: usize,
    ) -> Result<(), PlanError> {
        let [(from, here), (to, there)] = ends;
        let moved = here.iter().zip(there).map(|(a, b)| (a - b).norm());
        if moved.fold(0.0, f64::max) <= LOOK_EVERY {
            return Ok(());
        }
        let Some(halvings) = halvings.checked_sub(1) else {
            return Err(PlanError::Jump { part });
        };
        let values = from.as_slice().iter().zip(to.as_slice());
        let values: Vec<f64> = values.map(|(a, b)| 0.5 * (a + b)).collect();
        let middle = self.robot().command(&values)?;
        self.check(&middle, part)?;
        let between = self.settler.equilibrium().positions.to_vec();
        self.look_between([ends[0], (&middle, &between)], part, halvings)?;
        self.look_between([(&middle, &between), ends[1]], part, halvings)
    }

    /// Refuses a command under which the simulator finds a tendon slack or overloaded, or a disc too near to an obstacle. The robot
    /// is followed from where it was last asked for.
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
        match &self.clear {
            Some(clear) => clear.check(settled.pose(), part),
            None => Ok(()),
        }
    }
}
