//! Servos that follow their commands late: a first-order lag, and a largest rate.

use crate::robot::{Command, Robot, ServoSpec};

/// The commands that act on a robot's tendons while its servos follow those that are given ([`ServoSpec`]).
///
/// ```
/// use tdcr_sim::dynamics::Servos;
/// use tdcr_sim::robot::{Robot, RobotSpec, ServoSpec};
///
/// let mut spec = RobotSpec::standard("2m").expect("a standard robot");
/// for tendon in spec.tendon_specs_mut() {
///     tendon.servo = Some(ServoSpec { lag: 0.05, ..ServoSpec::default() });
/// }
/// let robot = Robot::new(spec)?;
/// let mut servos = Servos::at(&robot, &robot.command(&[0.0; 6])?);
/// let acting = servos.follow(&robot.command(&[0.02; 6])?, 0.05);
/// assert!((acting.as_slice()[0] - 0.02 * (1.0 - (-1.0f64).exp())).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Servos {
    servos: Vec<ServoSpec>,
    acting: Command,
}

impl Servos {
    /// Servos of `robot` that have come to `command`.
    pub fn at(robot: &Robot, command: &Command) -> Self {
        Self {
            servos: robot.tendons().iter().map(|tendon| tendon.servo).collect(),
            acting: command.clone(),
        }
    }

    /// Goes on for `duration` (s) under `command`; returns what acts then. Exact, so that two times make one of their sum; servos
    /// without a lag and a rate are there at once.
    pub fn follow(&mut self, command: &Command, duration: f64) -> &Command {
        if command.as_slice().len() != self.acting.as_slice().len() {
            // Of another robot, which steps refuse.
            self.acting.clone_from(command);
            return &self.acting;
        }
        let commands = command.as_slice().iter().zip(&self.servos);
        for (acting, (&command, servo)) in self.acting.as_mut_slice().iter_mut().zip(commands) {
            *acting = followed(servo, *acting, command, duration);
        }
        &self.acting
    }

    /// What acts on the tendons now.
    pub fn acting(&self) -> &Command {
        &self.acting
    }
}

/// Where a servo is that follows `command` from `at` for `duration` (s): at the largest rate as long as the lag asks for more, then
/// by the solution of `du/dt = (command - u) / lag`.
fn followed(servo: &ServoSpec, at: f64, command: f64, duration: f64) -> f64 {
    if !servo.follows() {
        return command;
    }
    let rate = servo.rate.unwrap_or(f64::INFINITY);
    let way = (command - at).abs();
    // What is left of the way from where on the lag is slower than the rate.
    let slower = match servo.lag > 0.0 {
        true => rate * servo.lag,
        false => 0.0,
    };
    let at_rate = ((way - slower).max(0.0) / rate).min(duration);
    let left = match servo.lag > 0.0 {
        true => (way - rate_times(rate, at_rate)) * (-(duration - at_rate) / servo.lag).exp(),
        false => way - rate_times(rate, at_rate),
    };
    let end = command - left.max(0.0).copysign(command - at);
    end.clamp(at.min(command), at.max(command))
}

/// The way at the largest rate; none without one.
fn rate_times(rate: f64, duration: f64) -> f64 {
    match rate.is_finite() {
        true => rate * duration,
        false => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_servo_follows_a_step_at_its_rate_and_then_with_its_lag() {
        let servo = ServoSpec {
            lag: 0.05,
            rate: Some(0.1),
            largest_force: None,
        };
        // 0.02 m away the rate rules for 0.15 s, until 0.005 m are left.
        let at = |time: f64| followed(&servo, 0.03, 0.01, time);
        assert!((at(0.1) - 0.02).abs() < 1e-15);
        assert!((at(0.2) - (0.01 + 0.005 * (-1.0f64).exp())).abs() < 1e-15);
        // Two times make one.
        let half = followed(&servo, at(0.13), 0.01, 0.07);
        assert!((half - at(0.2)).abs() < 1e-15);
        let by_rate = ServoSpec { lag: 0.0, ..servo };
        assert_eq!(followed(&by_rate, 0.0, 0.01, 0.05), 0.1 * 0.05);
        assert_eq!(followed(&by_rate, 0.0, 0.01, 0.2), 0.01);
        assert_eq!(followed(&ServoSpec::default(), 0.3, 0.017, 1e-9), 0.017);
    }
}
