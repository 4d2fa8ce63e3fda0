//! From metres of tendon to ticks of its servo, and back.

use serde::{Deserialize, Serialize};

use crate::servo::Ticks;

/// Which way a servo's count goes when it winds its tendon up: `1` or `-1` in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "i64", into = "i64")]
pub enum Direction {
    /// It counts up.
    Up,
    /// It counts down.
    Down,
}

impl TryFrom<i64> for Direction {
    type Error = String;

    fn try_from(sign: i64) -> Result<Self, String> {
        match sign {
            1 => Ok(Self::Up),
            -1 => Ok(Self::Down),
            other => Err(format!(
                "direction {other}; expected 1 where the count goes up as the tendon is wound, or -1"
            )),
        }
    }
}

impl From<Direction> for i64 {
    fn from(direction: Direction) -> Self {
        match direction {
            Direction::Up => 1,
            Direction::Down => -1,
        }
    }
}

impl From<Direction> for i32 {
    fn from(direction: Direction) -> Self {
        match direction {
            Direction::Up => 1,
            Direction::Down => -1,
        }
    }
}

/// The spool between a servo and its tendon: a command of `home_command` is at position 0, and each turn that winds the
/// tendon up shortens it by the spool's circumference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spool {
    /// Radius, to the middle of the tendon (m).
    pub radius: f64,
    /// Which way the servo counts when it winds the tendon up.
    pub direction: Direction,
    /// The command at home (m).
    pub home_command: f64,
}

impl Spool {
    /// Length of tendon that a tick winds (m).
    pub fn metres_per_tick(&self) -> f64 {
        self.radius * Ticks(1).radians()
    }

    /// The position, from home, nearest to a command (m). Commands beyond the range of positions give its ends.
    pub fn ticks(&self, command: f64) -> Ticks {
        let wound = (self.home_command - command) / self.metres_per_tick();
        // `as` saturates.
        Ticks((self.sign() * wound).round() as i32)
    }

    /// The command (m) that a position from home stands for.
    pub fn command(&self, ticks: Ticks) -> f64 {
        self.home_command - self.sign() * f64::from(ticks.0) * self.metres_per_tick()
    }

    /// Change of the command with a position: m/s for rad/s, against the sign of winding.
    pub fn speed(&self, angular: f64) -> f64 {
        -self.sign() * angular * self.radius
    }

    /// Current (A) that pulls, given the servo's, which has the sign of its torque.
    pub fn pull(&self, current: f64) -> f64 {
        self.sign() * current
    }

    fn sign(&self) -> f64 {
        match self.direction {
            Direction::Up => 1.0,
            Direction::Down => -1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spools() -> impl Strategy<Value = Spool> {
        let direction = prop_oneof![Just(Direction::Up), Just(Direction::Down)];
        (0.002..0.05, direction, -0.1..0.3).prop_map(|(radius, direction, home_command)| Spool {
            radius,
            direction,
            home_command,
        })
    }

    proptest! {
        #[test]
        fn positions_come_back_from_commands(spool in spools(), ticks in -1_000_000..1_000_000) {
            prop_assert_eq!(spool.ticks(spool.command(Ticks(ticks))), Ticks(ticks));
        }

        #[test]
        fn commands_come_back_to_half_a_tick(spool in spools(), command in -1.0..1.0) {
            let back = spool.command(spool.ticks(command));
            prop_assert!((back - command).abs() <= 0.5 * spool.metres_per_tick() * (1.0 + 1e-9));
        }

        #[test]
        fn winding_shortens(spool in spools(), from in -100_000..100_000, ticks in 1..10_000) {
            let up = spool.command(Ticks(from + ticks)) < spool.command(Ticks(from));
            prop_assert_eq!(up, spool.direction == Direction::Up);
            prop_assert_eq!(spool.pull(1.0) > 0.0, up);
            prop_assert_eq!(spool.speed(1.0) < 0.0, up);
        }
    }

    #[test]
    fn a_turn_winds_the_circumference() {
        let spool = Spool {
            radius: 0.005,
            direction: Direction::Up,
            home_command: 0.04,
        };
        let turn = spool.command(Ticks(0)) - spool.command(Ticks(Ticks::PER_TURN));
        assert!((turn - std::f64::consts::TAU * 0.005).abs() < 1e-15);
        assert_eq!(spool.ticks(0.04), Ticks(0));
        assert_eq!(spool.ticks(f64::MAX), Ticks(i32::MIN));
    }
}
