//! A servo with the spool and tendon behind it.

use tdcr_sim::robot::Robot;

use super::file::{RigFile, RigSpec, ServosSpec};
use super::settings::SafetySettings;
use super::spool::Spool;
use super::{Homing, RigError};
use crate::plan::{ShapeError, Shaper};
use crate::servo::{Present, ServoId, Ticks};

/// Share of its current limit that a servo may draw for long, where the rig's file does not say.
const OVERLOAD: f64 = 0.95;

/// A servo with the spool and tendon behind it. Positions count from home.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Winch {
    /// Address of the servo.
    pub id: ServoId,
    /// What joins position and command.
    pub spool: Spool,
    /// Smallest and largest position of a goal (ticks).
    pub limits: [i32; 2],
    /// Largest current of a goal (A).
    pub current_limit: f64,
    /// Largest current that may last for longer than `safety.overload_time` (A).
    pub overload: f64,
    /// Tension at home (N).
    pub home_tension: f64,
}

/// What a winch does at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WinchState {
    /// Position, from home.
    pub position: Ticks,
    /// The command that the position stands for (m).
    pub command: f64,
    /// Angular velocity of the servo (rad/s).
    pub velocity: f64,
    /// Current (A), positive where it pulls.
    pub pull: f64,
}

impl Winch {
    /// The winches of a checked rig file.
    pub(super) fn all(
        servos: &ServosSpec,
        safety: &SafetySettings,
        robot: &Robot,
    ) -> Result<Vec<Self>, RigError> {
        let home_command = home_commands(robot, &servos.home_tension)?;
        let winch = |(k, &id): (usize, &u8)| {
            let bad = || RigError::field(format!("servos.ids[{k}]"), id, "an address of 0 to 252");
            Ok(Self {
                id: ServoId::new(id).ok_or_else(bad)?,
                spool: Spool {
                    radius: *each(&servos.spool_radius, k),
                    direction: *each(&servos.directions, k),
                    home_command: home_command[k],
                },
                limits: *each(&servos.limits, k),
                current_limit: *each(&servos.current_limit, k),
                overload: safety
                    .current
                    .unwrap_or(OVERLOAD * each(&servos.current_limit, k)),
                home_tension: *each(&servos.home_tension, k),
            })
        };
        servos.ids.iter().enumerate().map(winch).collect()
    }

    /// The position of a command (m), within the limits.
    ///
    /// # Errors
    /// [`RigError::Limit`].
    pub fn goal(&self, command: f64) -> Result<Ticks, RigError> {
        let goal = self.spool.ticks(command);
        let [low, high] = self.limits;
        match (low..=high).contains(&goal.0) {
            true => Ok(goal),
            false => Err(RigError::Limit {
                id: self.id,
                goal,
                low,
                high,
            }),
        }
    }

    /// What a reading of the servo, homed at `home` of its count, says.
    pub fn state(&self, home: Ticks, present: Present) -> WinchState {
        let position = Ticks(present.position.0.saturating_sub(home.0));
        WinchState {
            position,
            command: self.spool.command(position),
            velocity: present.velocity,
            pull: self.spool.pull(present.current),
        }
    }
}

/// The commands (m) at which a robot stands at home.
fn home_commands(robot: &Robot, tensions: &[f64]) -> Result<Vec<f64>, RigError> {
    let tendons = robot.tendons().len();
    let tensions: Vec<f64> = (0..tendons).map(|k| *each(tensions, k)).collect();
    let refused =
        |error: ShapeError| RigError::field("robot", &robot.spec().name, error.to_string());
    let commands = Shaper::new(robot).map_err(refused)?.straight(&tensions);
    for (k, (command, tendon)) in commands.iter().zip(robot.tendons()).enumerate() {
        let [low, high] = tendon.range;
        if !(low..=high).contains(command) {
            let found = format!(
                "{} N, for which tendon {} has the command {command:.4} m",
                tensions[k],
                k + 1
            );
            let expected =
                format!("a tension for which that is within the robot's {low} to {high} m");
            return Err(RigError::field("servos.home_tension", found, expected));
        }
    }
    Ok(commands)
}

/// Entry `k` of a list with one for each servo, or a single one for all.
fn each<T>(list: &[T], k: usize) -> &T {
    &list[if list.len() == 1 { 0 } else { k }]
}

impl Homing {
    /// Home in the servo's count, or what to say of a servo whose home is not known.
    pub(super) fn known(self, id: ServoId) -> Result<Ticks, String> {
        match self {
            Self::Homed(home) => Ok(home),
            Self::Never => Err(format!("servo {id} was never homed")),
            Self::Lost { off, .. } => Err(format!(
                "servo {id} lost its turns: it stands {off} ticks from where it was left, and some turns"
            )),
        }
    }
}

impl RigFile {
    /// The servos with their spools, in the order of a command of `robot`, the file's.
    ///
    /// # Errors
    /// [`RigError::Field`] where the robot cannot stand at home with the tensions that the file gives.
    pub fn winches(&self, robot: &Robot) -> Result<Vec<Winch>, RigError> {
        let RigSpec { servos, safety, .. } = &self.spec;
        Winch::all(servos, safety, robot).map_err(|error| self.located(error))
    }
}
