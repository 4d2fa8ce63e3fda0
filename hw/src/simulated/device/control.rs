//! The controllers: from goals to the duty cycle, once in a control period.
//!
//! Position: the duty cycle in its unit (885 is the whole) is `P/128 e + I/65536 sum e - D/16 v`, `e` the error behind the
//! trajectory (ticks), summed over control periods of 1 ms, `v` the velocity (ticks/ms); velocity: `P/128 e + I/65536 sum e`
//! with the error in the unit of "Present Velocity". These scales are the e-Manual's. Feed-forward gains are held and have no
//! effect; the D gain acts on the velocity itself and not on that of the error.

use std::f64::consts::TAU;

use super::super::motor::Drive;
use super::super::profile::{Profile, Trajectory, ramped};
use super::memory::{Memory, TRIPPED, mode};
use crate::dynamixel::Item;
use crate::servo::Ticks;

/// The whole duty cycle in its unit.
pub(super) const FULL: f64 = 885.0;
/// Ticks of a radian.
pub(super) const TICKS: f64 = Ticks::PER_TURN as f64 / TAU;

/// What the controllers remember.
#[derive(Clone, Debug)]
pub(super) struct Controller {
    /// Where the profile is (ticks, as in the registers).
    pub trajectory: Trajectory,
    profile: Profile,
    /// Sum of errors over control periods.
    integral: f64,
    /// Duty cycle as of the last period, in the direction of the registers.
    duty: f64,
}

/// What the controllers see, in the direction of the registers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measured {
    /// Position (ticks).
    pub position: i64,
    /// Velocity (ticks/s).
    pub velocity: f64,
    /// Voltage at the motor (V).
    pub voltage: f64,
}

impl Controller {
    /// At rest at `position` (ticks).
    pub fn at(position: i64) -> Self {
        Self {
            trajectory: Trajectory::at(position as f64),
            profile: Profile::timed(0.0, 0.0, 0.0, 0.0),
            integral: 0.0,
            duty: 0.0,
        }
    }

    /// Takes the profile of the registers up, to a goal position that was set just now.
    pub fn begin(&mut self, memory: &Memory) {
        let by_time = memory.get(Item::DriveMode) & 0x04 != 0;
        let velocity = memory.get(Item::ProfileVelocity);
        let acceleration = memory.get(Item::ProfileAcceleration);
        self.profile = if by_time {
            let way = memory.get(Item::GoalPosition) as f64 - self.trajectory.position;
            let [whole, ramp] = [velocity, acceleration].map(|ms| ms as f64 / 1000.0);
            Profile::timed(way, self.trajectory.velocity, whole, ramp)
        } else {
            let limit = memory.quantity(Item::VelocityLimit);
            let bound = |count: i64, quantity: f64| match count {
                0 => f64::INFINITY,
                _ => quantity * TICKS,
            };
            Profile {
                velocity: bound(velocity, memory.quantity(Item::ProfileVelocity).min(limit)),
                acceleration: bound(acceleration, memory.quantity(Item::ProfileAcceleration)),
            }
        };
    }

    /// Whether the profile is still on its way.
    pub fn is_moving(&self, memory: &Memory) -> bool {
        match memory.get(Item::OperatingMode) {
            mode::CURRENT | mode::PWM => false,
            mode::VELOCITY => {
                let wanted = memory.quantity(Item::GoalVelocity) * TICKS;
                (self.trajectory.velocity - wanted).abs() > 1e-9
            }
            _ => self.trajectory.position != memory.get(Item::GoalPosition) as f64,
        }
    }

    /// One control period of `dt` (s): what the bridge does, in the direction of the registers.
    pub fn period(&mut self, dt: f64, memory: &Memory, measured: &Measured) -> Drive {
        let per_period = dt / 1e-3;
        let stopped = memory.get(Item::BusWatchdog) == TRIPPED;
        let goal_pwm = memory.get(Item::GoalPwm) as f64 / FULL;
        let wanted = match memory.get(Item::OperatingMode) {
            mode::CURRENT => return Drive::Current(memory.quantity(Item::GoalCurrent)),
            mode::PWM => goal_pwm,
            mode::VELOCITY => {
                let entry = memory.entry(Item::GoalVelocity);
                let unit = entry.scale * TICKS;
                let wanted = memory.quantity(Item::GoalVelocity) * TICKS;
                let slope = match memory.get(Item::ProfileAcceleration) {
                    0 => f64::INFINITY,
                    _ if stopped => f64::INFINITY,
                    _ => memory.quantity(Item::ProfileAcceleration) * TICKS,
                };
                self.trajectory.position = measured.position as f64;
                self.trajectory.velocity = ramped(self.trajectory.velocity, wanted, slope * dt);
                let error = (self.trajectory.velocity - measured.velocity) / unit;
                let [p, i] = [Item::VelocityPGain, Item::VelocityIGain].map(|i| memory.get(i));
                self.integrate(error * per_period, i);
                (p as f64 / 128.0 * error + i as f64 / 65536.0 * self.integral) / FULL
            }
            _ => {
                let goal = memory.get(Item::GoalPosition) as f64;
                self.trajectory.step(dt, goal, &self.profile);
                let error = self.trajectory.position - measured.position as f64;
                let [p, i, d] = [
                    Item::PositionPGain,
                    Item::PositionIGain,
                    Item::PositionDGain,
                ]
                .map(|item| memory.get(item));
                self.integrate(error * per_period, i);
                let sum = p as f64 / 128.0 * error + i as f64 / 65536.0 * self.integral
                    - d as f64 / 16.0 * measured.velocity * 1e-3;
                sum / FULL
            }
        };
        let limit = goal_pwm.abs();
        let step = memory.quantity(Item::PwmSlope) * dt / measured.voltage.max(1.0);
        self.duty = ramped(self.duty, wanted.clamp(-limit, limit), step);
        let current_limit = match memory.get(Item::OperatingMode) {
            mode::CURRENT_BASED_POSITION => memory.quantity(Item::GoalCurrent).abs(),
            _ => f64::INFINITY,
        };
        Drive::Duty {
            duty: self.duty,
            current_limit,
        }
    }

    /// Adds to the integral, which alone never asks for more than the whole duty cycle.
    fn integrate(&mut self, error: f64, gain: i64) {
        let bound = match gain {
            0 => 0.0,
            _ => FULL * 65536.0 / gain as f64,
        };
        self.integral = (self.integral + error).clamp(-bound, bound);
    }
}
