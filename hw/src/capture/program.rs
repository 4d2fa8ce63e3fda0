//! What a capture is going to do: a function of the rig's file and a seed, so that it can be told without a rig.

use tdcr_sim::robot::{Command, Loads, Robot};

use super::CaptureError;
use crate::plan::{Bend, Drawn, Draws, Place, PlanError, Planner, Shape};
use crate::rig::{RigFile, Winch};
use crate::servo::Ticks;

/// The commands of a capture and the ways to them.
#[derive(Clone, Debug)]
pub struct Program {
    winches: Vec<Winch>,
    planner: Planner,
    /// Those of the same robot under other loads.
    others: Vec<Planner>,
    draws: Draws,
}

impl Program {
    /// The commands that `seed` draws for the rig of a file, within the limits of its robot, servos and settings. A step of a
    /// path takes a period at the largest speed.
    ///
    /// # Errors
    /// [`CaptureError`] for a rig that makes no sense.
    pub fn new(file: &RigFile, seed: u64) -> Result<Self, CaptureError> {
        let robot = file.compile()?;
        let winches = file.winches(&robot)?;
        let motion = &file.spec.motion;
        let tendons = winches.iter().zip(robot.tendons());
        let limits = tendons.map(|(winch, tendon)| {
            let ends = winch.limits.map(|ticks| winch.spool.command(Ticks(ticks)));
            // Where a servo then stands is a command too, and may lie off the goal.
            let off = f64::from(motion.arrived) * winch.spool.metres_per_tick();
            let [low, high] = [tendon.range[0] + off, tendon.range[1] - off];
            [
                ends[0].min(ends[1]).max(low),
                ends[0].max(ends[1]).min(high),
            ]
        });
        let tension = file.spec.commands.tension;
        let step = motion.slew * motion.period;
        let mut planner = Planner::new(&robot, limits.collect(), tension, step)?;
        if let (Some(scene), Some(around)) = (&file.scene, &file.spec.scene) {
            planner = planner.clear_of(scene.clone(), around.clearance);
        }
        let draws = Draws {
            settings: file.spec.commands.clone(),
            rest: rest(&robot, &winches, planner.shaper().modules()),
            seed,
        };
        // Home is where every way begins and ends.
        planner.require_clear(&(&draws.rest).into())?;
        Ok(Self {
            winches,
            planner,
            others: Vec::new(),
            draws,
        })
    }

    /// The same for a robot that carries these loads. Commands that chance draws are such that it could take them under each of
    /// the `others`, too.
    ///
    /// # Errors
    /// [`PlanError::Near`] for a home that is then too near to an obstacle.
    pub fn carrying(self, loads: Loads, others: &[Loads]) -> Result<Self, PlanError> {
        let others = others.iter();
        let others = others.map(|loads| self.planner.clone().carrying(loads.clone()));
        let mut loaded = Self {
            others: others.collect(),
            planner: self.planner.carrying(loads),
            ..self
        };
        (loaded.planner).require_clear(&(&loaded.draws.rest).into())?;
        Ok(loaded)
    }

    /// The home pose: straight, the tendons of each module with the tension at home of its first one.
    pub fn rest(&self) -> &Shape {
        &self.draws.rest
    }

    /// Command `index`.
    ///
    /// # Errors
    /// As [`Draws::draw`].
    pub fn draw(&mut self, index: u64) -> Result<Drawn, PlanError> {
        self.draws
            .draw_for_all(index, &mut self.planner, &mut self.others)
    }

    /// A command (m, one for each tendon) that somebody gives, once it is known that no tendon goes slack and none is overloaded
    /// under it and on the straight way to it from home.
    ///
    /// # Errors
    /// As [`Planner::straight_between`]; [`PlanError::Command`] for what is no command of the robot.
    pub fn given(&mut self, values: &[f64]) -> Result<Command, PlanError> {
        let command = self.command(values)?;
        let (rest, place) = (&self.draws.rest, command.clone());
        self.planner.straight_between(&rest.into(), &place.into())?;
        Ok(command)
    }

    /// The command of these values (m, one for each tendon).
    ///
    /// # Errors
    /// [`PlanError::Command`] for what is no command of the robot.
    pub fn command(&self, values: &[f64]) -> Result<Command, PlanError> {
        Ok(self.planner.robot().command(values)?)
    }

    /// The command of a place.
    ///
    /// # Errors
    /// As [`Planner::command_at`].
    pub fn command_at(&mut self, place: &Place) -> Result<Command, PlanError> {
        self.planner.command_at(place)
    }

    /// The way from one place to another that can be reached from home.
    ///
    /// # Errors
    /// As [`Planner::path`].
    pub fn path(
        &mut self,
        from: impl Into<Place>,
        to: impl Into<Place>,
    ) -> Result<Vec<Command>, PlanError> {
        self.planner.path(from, to, &self.draws.rest)
    }

    /// The tensions (N) that the simulator finds in the tendons of a place.
    ///
    /// # Errors
    /// As [`Planner::tensions`].
    pub fn tensions(&mut self, place: &Place) -> Result<Vec<f64>, PlanError> {
        self.planner.tensions(place)
    }

    /// The positions of a command, from home.
    ///
    /// # Errors
    /// [`CaptureError::Rig`] beyond the limits of a servo.
    pub fn goals(&self, command: &Command) -> Result<Vec<Ticks>, CaptureError> {
        let winches = self.winches.iter().zip(command.as_slice());
        Ok(winches
            .map(|(winch, &command)| winch.goal(command))
            .collect::<Result<_, _>>()?)
    }
}

fn rest(robot: &Robot, winches: &[Winch], modules: &[usize]) -> Shape {
    let tension = |module: usize| {
        let first = modules.iter().position(|&of| of == module);
        first.map_or(0.0, |tendon| winches[tendon].home_tension)
    };
    let count = robot.spec().modules.len();
    Shape(
        (0..count)
            .map(|module| Bend::new(0.0, 0.0, tension(module)))
            .collect(),
    )
}
