//! A servo with the spool and tendon behind it.

use tdcr_sim::dynamics::Integrator;
use tdcr_sim::robot::{CommandUnit, Robot};
use tdcr_sim::simulation::{MovingRobot, Simulation};

use super::file::ServosSpec;
use super::spool::Spool;
use super::{Homing, RigError};
use crate::servo::{Present, ServoId, Ticks};

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
    pub(super) fn all(servos: &ServosSpec, robot: &Robot) -> Result<Vec<Self>, RigError> {
        let home_command = match &servos.home_command {
            Some(commands) => commands.clone(),
            None => home_commands(robot, &servos.home_tension)?,
        };
        let winch = |(k, &id): (usize, &u8)| {
            let bad = || RigError::field(format!("servos.ids[{k}]"), id, "an address of 0 to 252");
            Ok(Self {
                id: ServoId::new(id).ok_or_else(bad)?,
                spool: Spool {
                    radius: *each(&servos.spool_radius, k),
                    direction: *each(&servos.directions, k),
                    home_command: *each(&home_command, k),
                },
                limits: *each(&servos.limits, k),
                current_limit: *each(&servos.current_limit, k),
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

/// The commands (m) under which tendons of the straight robot have tensions (N): `L - T / k`.
fn home_commands(robot: &Robot, tensions: &[f64]) -> Result<Vec<f64>, RigError> {
    // Only the time step could be refused, and no step is made.
    let straight = MovingRobot::new(robot, 1e-3, Integrator::default(), 1)
        .map_err(|error| RigError::field("robot", &robot.spec().name, error.to_string()))?;
    let lengths = straight.pose().tendon_lengths;
    let tendons = robot.tendons().iter().zip(lengths).enumerate();
    tendons
        .map(|(k, (tendon, length))| match tendon.unit() {
            CommandUnit::Metre => Ok(length - each(tensions, k) / tendon.stiffness),
            CommandUnit::Newton => Err(RigError::field(
                "robot",
                &robot.spec().name,
                format!("tendons driven by lengths; tendon {k} is driven by its tension"),
            )),
        })
        .collect()
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
