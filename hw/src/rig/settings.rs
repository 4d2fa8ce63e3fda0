//! How a rig moves its robot, and what it does not let it do.

use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::RigError;
use crate::servo::Ticks;

/// Smallest watchdog, in periods of motion: so the bus is silent for half of the watchdog's time at the most, where the computer
/// keeps its times.
const PERIODS_OF_WATCHDOG: f64 = 2.0;

/// Largest current that a servo of the X330 series can be limited to (A): the XC330-M288's.
pub(super) const LARGEST_CURRENT: f64 = 2.352;

/// How the robot moves, and when it counts as still.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionSettings {
    /// Time between goals (s).
    pub period: f64,
    /// Largest speed of a tendon (m/s).
    pub slew: f64,
    /// The servos count as still below this speed (rad/s).
    pub still_speed: f64,
    /// The robot counts as still where the mean change of its depth between pictures, over the pixels that show it in both, is
    /// below this (m).
    pub still_depth: f64,
    /// Longest time that one waits for stillness (s).
    pub patience: f64,
    /// Longest time that one waits for a picture (s).
    pub picture: f64,
    /// Farthest (ticks) that a servo may stand from its goal before and after the pictures of a sample.
    pub arrived: i32,
}

/// How tension is taken from the tendons.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Release {
    /// The motors are switched off at once.
    TorqueOff,
    /// The tendons are let out to home at the speed of a motion, then the motors are switched off. After a fault they are
    /// switched off at once.
    Home,
}

/// What ends a motion: the tension is released, and an error says why.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SafetySettings {
    /// The servos stop by themselves where they hear nothing for this long (s).
    pub watchdog: f64,
    /// Largest current (A) that a servo may draw for longer than `overload_time`; where there is none, 0.95 of its own current
    /// limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub current: Option<f64>,
    /// How long (s).
    pub overload_time: f64,
    /// Largest temperature (degrees Celsius).
    pub temperature: f64,
    /// A capture pauses at home above this temperature (degrees Celsius).
    pub pause_above: f64,
    /// And goes on below this one (degrees Celsius).
    pub resume_below: f64,
    /// Largest distance between goal and position (ticks) that may last for longer than `overload_time`.
    pub lag: i32,
    /// Reads in a row without an answer of a servo after which it counts as lost.
    pub lost_after: usize,
    /// How far (m) the mean of what is seen of the robot at home may move in a capture: farther, a tendon has slipped or
    /// snapped.
    pub drift: f64,
    /// How tension is released at the end of a motion.
    pub release: Release,
    /// What a capture does where a servo lost its power, and with it its turns.
    pub lost_turns: LostTurns,
}

/// What a capture does where a servo lost its power for a moment, and with it its turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LostTurns {
    /// It ends.
    #[default]
    Stop,
    /// It finds home again from where the servos were left, looks whether the robot is there, and goes on.
    Recall,
}

/// What there is besides the robot where parts are simulated.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimulationSettings {
    /// Seed of noise and faults.
    pub seed: u64,
    /// What cameras see around the robot, and it does not touch.
    pub surroundings: Surroundings,
    /// The file of the obstacles that there are, from the rig file's folder; those of `[scene]` where none is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<PathBuf>,
}

/// What simulated cameras see around the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surroundings {
    /// Nothing.
    #[default]
    Nothing,
    /// A table with things on it, and walls.
    Table,
}

impl Default for MotionSettings {
    fn default() -> Self {
        Self {
            period: 0.05,
            slew: 0.02,
            still_speed: 0.05,
            still_depth: 5e-4,
            patience: 5.0,
            picture: 2.0,
            // The weakest of the three models, at the factory's gains, stands 96 ticks off under 30 N on a spool of 5 mm: 400 / 128
            // units of duty cycle for a tick, 885 for 0.52 N m, of which the gear's friction takes 5 %.
            arrived: 100,
        }
    }
}

impl Default for SafetySettings {
    fn default() -> Self {
        Self {
            watchdog: 0.5,
            current: None,
            overload_time: 0.5,
            temperature: 70.0,
            pause_above: 60.0,
            resume_below: 50.0,
            lag: 300,
            lost_after: 3,
            drift: 0.005,
            release: Release::Home,
            lost_turns: LostTurns::default(),
        }
    }
}

impl MotionSettings {
    /// Time between goals.
    pub fn period(&self) -> Duration {
        Duration::from_secs_f64(self.period)
    }

    pub(super) fn check(&self) -> Result<(), RigError> {
        within("motion.period", self.period, [0.005, 0.2])?;
        // Slower, and a path is of millions of steps; faster than servos turn is in `check`, which knows the spools.
        within("motion.slew", self.slew, [1e-4, 1.0])?;
        within("motion.still_speed", self.still_speed, [1e-3, 1.0])?;
        within("motion.still_depth", self.still_depth, [1e-6, 0.05])?;
        within("motion.patience", self.patience, [0.1, 600.0])?;
        within("motion.picture", self.picture, [0.05, 60.0])?;
        if self.picture > self.patience {
            let expected = format!(
                "no more than motion.patience, {}: that a robot is still is seen in two pictures",
                self.patience
            );
            return Err(RigError::field("motion.picture", self.picture, expected));
        }
        let turn = f64::from(Ticks::PER_TURN);
        within("motion.arrived", self.arrived.into(), [1.0, turn / 8.0])
    }
}

impl SafetySettings {
    /// How long servos may hear nothing.
    pub fn watchdog(&self) -> Duration {
        Duration::from_secs_f64(self.watchdog)
    }

    pub(super) fn check(&self, motion: &MotionSettings) -> Result<(), RigError> {
        // What DYNAMIXELs can be told: 1 to 127 times 20 ms.
        within("safety.watchdog", self.watchdog, [0.02, 2.54])?;
        if self.watchdog < PERIODS_OF_WATCHDOG * motion.period {
            let expected = format!(
                "at least {PERIODS_OF_WATCHDOG} times motion.period, {}: servos hear something once a period",
                motion.period
            );
            return Err(RigError::field("safety.watchdog", self.watchdog, expected));
        }
        within(
            "safety.current",
            self.current.unwrap_or(1.0),
            [1e-3, LARGEST_CURRENT],
        )?;
        within("safety.overload_time", self.overload_time, [0.0, 10.0])?;
        within("safety.temperature", self.temperature, [20.0, 100.0])?;
        within("safety.resume_below", self.resume_below, [10.0, 100.0])?;
        if !(self.resume_below..=100.0).contains(&self.pause_above) {
            let expected = format!("safety.resume_below, {}, to 100", self.resume_below);
            return Err(RigError::field(
                "safety.pause_above",
                self.pause_above,
                expected,
            ));
        }
        if self.pause_above >= self.temperature {
            let expected = "below safety.temperature, where the motion ends";
            return Err(RigError::field(
                "safety.pause_above",
                self.pause_above,
                expected,
            ));
        }
        within("safety.drift", self.drift, [1e-5, 0.1])?;
        // Half a turn: farther than a servo moves between two looks.
        let turn = f64::from(Ticks::PER_TURN);
        within("safety.lag", self.lag.into(), [1.0, turn / 2.0])?;
        if motion.arrived > self.lag {
            let expected = format!(
                "no more than safety.lag, {}, where the motion ends",
                self.lag
            );
            return Err(RigError::field("motion.arrived", motion.arrived, expected));
        }
        within("safety.lost_after", self.lost_after as f64, [1.0, 100.0])
    }
}

pub(super) fn within(field: &str, value: f64, [low, high]: [f64; 2]) -> Result<(), RigError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(RigError::field(field, value, format!("{low} to {high}")))
}
