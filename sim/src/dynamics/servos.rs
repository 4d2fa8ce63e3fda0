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

/// Derivative of [`followed`] by where the servo is; that by the command is what is left to 1.
fn kept(servo: &ServoSpec, at: f64, command: f64, duration: f64) -> f64 {
    if !servo.follows() {
        return 0.0;
    }
    let rate = servo.rate.unwrap_or(f64::INFINITY);
    let slower = if servo.lag > 0.0 {
        rate * servo.lag
    } else {
        0.0
    };
    let at_rate = ((command - at).abs() - slower).max(0.0) / rate;
    if at_rate >= duration {
        return 1.0;
    }
    match servo.lag > 0.0 {
        true => (-(duration - at_rate) / servo.lag).exp(),
        false => 0.0,
    }
}

/// The commands that act in the steps of a motion, and how they change with those that are given.
pub(super) struct Acting<'a> {
    given: &'a [Command],
    /// Where servos follow late.
    late: Option<Late>,
}

struct Late {
    acting: Vec<Command>,
    /// Of each step, the derivatives of what acts by what acted before.
    kept: Vec<Vec<f64>>,
}

impl<'a> Acting<'a> {
    /// In steps by `timestep` (s), at the start of which the servos have come to the first command.
    pub fn new(robot: &Robot, given: &'a [Command], timestep: f64) -> Self {
        let late = robot.tendons().iter().any(|tendon| tendon.servo.follows());
        let Some(first) = given.first().filter(|_| late) else {
            return Self { given, late: None };
        };
        let mut servos = Servos::at(robot, first);
        let mut late = Late {
            acting: Vec::with_capacity(given.len()),
            kept: Vec::with_capacity(given.len()),
        };
        for command in given {
            let before = servos.acting().as_slice().iter().zip(command.as_slice());
            let servos_at = servos.servos.iter().zip(before);
            let kept = servos_at.map(|(servo, (&at, &to))| kept(servo, at, to, timestep));
            late.kept.push(kept.collect());
            late.acting.push(servos.follow(command, timestep).clone());
        }
        Self {
            given,
            late: Some(late),
        }
    }

    /// What acts in a step.
    pub fn command(&self, step: usize) -> &Command {
        match &self.late {
            Some(late) => &late.acting[step],
            None => &self.given[step],
        }
    }

    /// Turns derivatives by what acts in each step into those by what is given.
    pub fn pull_back(&self, commands: &mut [Vec<f64>]) {
        let Some(late) = &self.late else { return };
        let mut later = vec![0.0; commands.first().map_or(0, Vec::len)];
        for (command, kept) in commands.iter_mut().zip(&late.kept).rev() {
            for ((by, later), kept) in command.iter_mut().zip(&mut later).zip(kept) {
                let all = *by + *later;
                (*by, *later) = ((1.0 - kept) * all, kept * all);
            }
        }
        // Before the first step acts the first command.
        if let Some(first) = commands.first_mut() {
            first
                .iter_mut()
                .zip(&later)
                .for_each(|(by, later)| *by += later);
        }
    }

    /// Changes of what acts in each step by those of what is given.
    pub fn push_forward(&self, given: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut acting = given.to_vec();
        let Some(late) = &self.late else {
            return acting;
        };
        for step in 1..acting.len() {
            let (before, after) = acting.split_at_mut(step);
            let changes = after[0].iter_mut().zip(&before[step - 1]);
            for ((change, before), kept) in changes.zip(&late.kept[step]) {
                *change = (1.0 - kept) * *change + kept * before;
            }
        }
        acting
    }
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
        for (from, time) in [(0.03, 0.1), (0.03, 0.2), (0.014, 0.02)] {
            let ahead = followed(&servo, from + 1e-7, 0.01, time);
            let change = (ahead - followed(&servo, from - 1e-7, 0.01, time)) / 2e-7;
            assert!((kept(&servo, from, 0.01, time) - change).abs() < 1e-8);
        }
        let by_rate = ServoSpec { lag: 0.0, ..servo };
        assert_eq!(followed(&by_rate, 0.0, 0.01, 0.05), 0.1 * 0.05);
        assert_eq!(followed(&by_rate, 0.0, 0.01, 0.2), 0.01);
        assert_eq!(followed(&ServoSpec::default(), 0.3, 0.017, 1e-9), 0.017);
    }
}
