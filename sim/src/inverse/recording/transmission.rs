//! From what servos report to what tendons are commanded.

use nalgebra::{DVector, Vector3};
use tdcr_base::stats::median;

use super::cloud::Shown;
use crate::chain::Configuration;
use crate::robot::{Drive, Loads, Robot};
use crate::sensitivity::DiscPoint;

/// What a robot did, in the order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// When (s, ascending); without a clock the number of the row.
    pub times: Vec<f64>,
    /// For each time what the servo of each tendon reports: how far it has pulled its tendon (m), positive when it pulls;
    /// of a tension drive the tension (N).
    pub pulls: Vec<Vec<f64>>,
    /// For each time where each marker was (m, world frame); none where it was not seen.
    pub points: Vec<Vec<Option<Vector3<f64>>>>,
    /// For each time points of the robot's surface that were seen (m, world frame); empty where no row has any.
    pub clouds: Vec<Vec<Vector3<f64>>>,
    /// For each time the mass that hung from the tip (kg); empty where nothing did in any row.
    pub payloads: Vec<f64>,
    /// What of the robot the clouds show.
    pub shown: Shown,
    /// Whether rows follow one another.
    pub order: Order,
}

/// Whether the way from row to row counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Rows are moments of one motion.
    #[default]
    Motion,
    /// Each row is the robot at rest under commands of its own: servos have no speed, nor backlash, and tendons no friction.
    AtRest,
}

/// What lies between servos and tendons, and between discs and markers: numbers that are no part of the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Transmission {
    /// Of each tendon, in a command's order.
    pub servos: Vec<Servo>,
    /// How far positions are behind what servos report (s, or rows where the recording has no clock).
    pub lag: f64,
    /// What was measured.
    pub markers: Vec<Marker>,
}

/// How a servo pulls its tendon: the tendon is pulled by `gain p + offset`, `p` what the servo reports after its backlash.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// Tendon pulled by what the servo reports: the radius of its spool by the one that it reckons with.
    pub gain: f64,
    /// Tendon displacement where the servo reports 0 (m; N of a tension drive): above 0 pretension, below 0 slack.
    pub offset: f64,
    /// Half the backlash between servo and tendon (m; N of a tension drive).
    pub backlash: f64,
}

impl Default for Servo {
    fn default() -> Self {
        Self {
            gain: 1.0,
            offset: 0.0,
            backlash: 0.0,
        }
    }
}

impl Servo {
    /// What the servo has pulled after its backlash (m or N), where it reports `pull` and stood at `last` before: the play
    /// operator (Visintin, Differential Models of Hysteresis, 1994, ch. III.2).
    pub fn play(&self, last: f64, pull: f64) -> f64 {
        last.clamp(pull - self.backlash, pull + self.backlash)
    }

    /// What its tendon is commanded (m, or N for a tension drive) where the servo has pulled by `pull` after its backlash:
    /// `straight` is the tendon's length in the straight pose (m).
    pub fn command(&self, drive: Drive, straight: f64, pull: f64) -> f64 {
        let pull = self.gain * pull + self.offset;
        match drive {
            Drive::Tension => pull.max(0.0),
            Drive::Gain(_) | Drive::Length => (straight - pull).max(0.0),
        }
    }
}

/// A measured point on a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marker {
    /// The disc, from 0 at the base.
    pub disc: usize,
    /// The marker in the disc's frame (m).
    pub place: Vector3<f64>,
}

impl Marker {
    pub(super) fn point(&self) -> DiscPoint {
        DiscPoint {
            disc: self.disc,
            place: self.place,
        }
    }
}

/// Steps of time longer than this many medians are gaps, over which nothing is known of the servos' speed.
const GAP: f64 = 2.5;

impl Recording {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// The points of a row's cloud (m, world frame).
    pub fn cloud(&self, row: usize) -> &[Vector3<f64>] {
        self.clouds.get(row).map_or(&[], Vec::as_slice)
    }

    /// What the robot bears in a row.
    pub(super) fn loads(&self, row: usize) -> Loads {
        let mass = self.payloads.get(row).copied().unwrap_or(0.0);
        Loads::payload(mass).unwrap_or_default()
    }

    /// Coordinates that were measured: three of each marker, and the distance of each point of a cloud.
    pub(super) fn coordinates(&self) -> usize {
        let markers = self.points.iter().flatten().flatten().count();
        3 * markers + self.clouds.iter().map(Vec::len).sum::<usize>()
    }

    /// Leaves at most so many points in each cloud, evenly spread over it.
    pub fn thin_clouds(&mut self, most: usize) {
        for cloud in self.clouds.iter_mut().filter(|cloud| cloud.len() > most) {
            let points = cloud.len();
            *cloud = (0..most).map(|k| cloud[k * points / most]).collect();
        }
    }

    /// Median time between rows; 1 where there is none.
    pub fn median_step(&self) -> f64 {
        let mut steps: Vec<f64> = self.times.windows(2).map(|t| t[1] - t[0]).collect();
        match steps.is_empty() {
            true => 1.0,
            false => median(&mut steps),
        }
    }

    /// Speed of each servo at each row (1/s): from the last row of an earlier time, after a gap from the next one, between two gaps 0.
    pub(super) fn speeds(&self) -> Vec<Vec<f64>> {
        if self.order == Order::AtRest {
            let still = |pulls: &Vec<f64>| vec![0.0; pulls.len()];
            return self.pulls.iter().map(still).collect();
        }
        let longest = GAP * self.median_step();
        let between = |a: usize, b: usize| -> Option<Vec<f64>> {
            let step = self.times.get(b)? - self.times[a];
            let pairs = self.pulls[a].iter().zip(&self.pulls[b]);
            // Clocks may be so coarse that rows share a time.
            (step > 0.0 && step <= longest).then(|| pairs.map(|(a, b)| (b - a) / step).collect())
        };
        // The last row of an earlier time.
        let mut earlier = None;
        (0..self.len())
            .map(|row| {
                if row > 0 && self.times[row - 1] < self.times[row] {
                    earlier = Some(row - 1);
                }
                let before = earlier.and_then(|last| between(last, row));
                let speed = before.or_else(|| between(row, row + 1));
                speed.unwrap_or_else(|| vec![0.0; self.pulls[row].len()])
            })
            .collect()
    }

    /// A row not later than `row`, and the time (s) before it that is `lag` before `row`: straight lines lead from there back.
    fn before(&self, row: usize, lag: f64, longest: f64) -> (usize, f64) {
        let (mut row, mut left) = (row, lag);
        while self.order == Order::Motion && row > 0 {
            let step = self.times[row] - self.times[row - 1];
            if !(step > 0.0 && step < left && step <= longest) {
                break;
            }
            (row, left) = (row - 1, left - step);
        }
        (row, left)
    }
}

impl Transmission {
    /// Servos that pull as far as they report, at once, and markers in these places.
    pub fn ideal(tendons: usize, markers: Vec<Marker>) -> Self {
        Self {
            servos: vec![Servo::default(); tendons],
            lag: 0.0,
            markers,
        }
    }

    /// The command of each row (m, or N): a tendon that is pulled by `p` has the length `L - p`, `L` that in the straight
    /// pose. Backlash is a play operator: the tendon rests until the servo has crossed the play, then follows (Visintin,
    /// Differential Models of Hysteresis, 1994, ch. III.2). The lag takes the servo back in time, straight from row to row.
    pub fn commands(&self, robot: &Robot, recording: &Recording) -> Vec<Vec<f64>> {
        self.commands_at(robot, recording, &recording.speeds())
    }

    /// The same with the servos' speeds.
    pub(super) fn commands_at(
        &self,
        robot: &Robot,
        recording: &Recording,
        speeds: &[Vec<f64>],
    ) -> Vec<Vec<f64>> {
        let (lengths, _) = robot.tendon_kinematics(&Configuration::straight(robot));
        let mut played: Option<DVector<f64>> = None;
        let longest = GAP * recording.median_step();
        (0..recording.len())
            .map(|row| {
                let (row, back) = recording.before(row, self.lag, longest);
                let delayed = recording.pulls[row].iter().zip(&speeds[row]);
                let delayed = delayed.map(|(p, v)| p - back * v);
                let mut pulls = DVector::from_iterator(speeds[row].len(), delayed);
                if let Some(last) = &played {
                    for (t, pull) in pulls.iter_mut().enumerate() {
                        *pull = self.servos[t].play(last[t], *pull);
                    }
                }
                let command = (0..pulls.len()).map(|t| {
                    self.servos[t].command(robot.tendons()[t].drive, lengths[t], pulls[t])
                });
                let command = command.collect();
                played = (recording.order == Order::Motion).then_some(pulls);
                command
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording(pulls: &[f64], times: &[f64]) -> Recording {
        Recording {
            times: times.to_vec(),
            pulls: pulls.iter().map(|&p| vec![p; 6]).collect(),
            points: vec![Vec::new(); pulls.len()],
            ..Recording::default()
        }
    }

    #[test]
    fn a_tendon_rests_until_its_servo_has_crossed_the_play() {
        let robot = Robot::load("2m").expect("a standard robot");
        let mut transmission = Transmission::ideal(6, Vec::new());
        transmission.servos[0].backlash = 1e-3;
        let to_and_fro = recording(&[0.0, 0.5e-3, 3e-3, 2e-3, 0.0], &[0.0, 1.0, 2.0, 3.0, 4.0]);
        let commands = transmission.commands(&robot, &to_and_fro);
        let pulled: Vec<f64> = (commands.iter())
            .map(|c| 1e3 * (commands[0][0] - c[0]))
            .collect();
        for (found, expected) in pulled.iter().zip([0.0, 0.0, 2.0, 2.0, 1.0]) {
            assert!((found - expected).abs() < 1e-9, "{pulled:?}");
        }
    }

    #[test]
    fn rows_at_rest_have_neither_play_nor_lag() {
        let robot = Robot::load("2m").expect("a standard robot");
        let mut still = recording(&[0.0, 0.5e-3, 3e-3], &[0.0, 1.0, 2.0]);
        let mut transmission = Transmission::ideal(6, Vec::new());
        let plain = transmission.commands(&robot, &still);
        (transmission.lag, transmission.servos[0].backlash) = (0.3, 1e-3);
        assert_ne!(transmission.commands(&robot, &still), plain);
        still.order = Order::AtRest;
        assert_eq!(transmission.commands(&robot, &still), plain);
    }

    #[test]
    fn clouds_are_thinned_evenly() {
        let cloud = |points: u8| -> Vec<Vector3<f64>> {
            (0..points).map(|k| Vector3::x() * f64::from(k)).collect()
        };
        let mut recording = Recording {
            clouds: vec![cloud(9), cloud(2), Vec::new()],
            ..Recording::default()
        };
        recording.thin_clouds(3);
        let kept: Vec<f64> = recording.clouds[0].iter().map(|point| point.x).collect();
        assert_eq!(kept, [0.0, 3.0, 6.0]);
        assert_eq!(
            (recording.clouds[1].len(), recording.clouds[2].len()),
            (2, 0)
        );
    }

    /// At constant speed a lag is that much time; over a gap the speed is that of the rows beyond it.
    #[test]
    fn a_lag_takes_a_servo_back_by_its_speed() {
        let robot = Robot::load("2m").expect("a standard robot");
        let mut transmission = Transmission::ideal(6, Vec::new());
        transmission.lag = 0.25;
        let moving = recording(
            &[0.0, 1e-3, 2e-3, 3e-3, 8e-3, 8e-3],
            &[0.0, 1.0, 2.0, 3.0, 60.0, 61.0],
        );
        let [late, prompt] = [0.25, 0.0].map(|lag| {
            transmission.lag = lag;
            transmission.commands(&robot, &moving)
        });
        let behind: Vec<f64> = (late.iter().zip(&prompt))
            .map(|(a, b)| 1e3 * (a[2] - b[2]))
            .collect();
        for (found, expected) in behind.iter().zip([0.25, 0.25, 0.25, 0.25, 0.0, 0.0]) {
            assert!((found - expected).abs() < 1e-9, "{behind:?}");
        }
    }

    /// Over more than a row the way back is that of the rows between; rows that share a time have the speed since the last one before it.
    #[test]
    fn a_lag_of_several_rows_follows_what_the_servo_did() {
        let robot = Robot::load("2m").expect("a standard robot");
        let mut transmission = Transmission::ideal(6, Vec::new());
        let moving = recording(
            &[0.0, 1e-3, 3e-3, 3e-3, 1e-3, 2e-3, 4e-3],
            &[0.0, 1.0, 2.0, 3.0, 4.0, 4.0, 5.0],
        );
        let [late, prompt] = [1.5, 0.0].map(|lag| {
            transmission.lag = lag;
            transmission.commands(&robot, &moving)
        });
        let straight = prompt[0][2];
        let pulls: Vec<f64> = late.iter().map(|c| 1e3 * (straight - c[2])).collect();
        for (row, expected) in [(2, 0.5), (3, 2.0), (4, 3.0), (5, 3.5), (6, 2.5)] {
            assert!((pulls[row] - expected).abs() < 1e-9, "row {row}: {pulls:?}");
        }
    }
}
