//! Which servo pulls which tendon, and which way, told from rows in which one servo moves alone.

use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;
use tdcr_base::stats::median;

use super::problem::place;
use super::{Marker, Recording, RecordingError, Transmission, without_ranges};
use crate::robot::{Loads, Robot, RobotSpec};
use crate::sensitivity::DiscPoint;
use crate::statics::Settler;

/// A servo rests while it moves by less than this share of the widest range of all.
const REST: f64 = 0.03;
/// A servo that moves alone by this share of the widest range is pulled.
const PULLED: f64 = 0.15;
/// Pulls of one servo that are looked at: the widest.
const PULLS: usize = 4;
/// Turns of the robot about its base from which maps are sought.
const TURNS: usize = 12;
/// Rounds of servos by the turn and the turn by servos: they may go to and fro between maps with equal misfit.
const ROUNDS: usize = 20;
/// What half a turn of the robot about its base costs, as a share of the motion of a single pull. A robot whose tendons stand
/// evenly around its axis looks the same after a part of a turn: of such maps the one that turns the least is right.
const TURN_COST: f64 = 0.1;

/// Which servo pulls which tendon.
#[derive(Clone, Debug, PartialEq)]
pub struct ServoMap {
    /// Of each tendon, in a command's order, its servo.
    pub servos: Vec<MappedServo>,
    /// Rotation of the recording's frame about the robot's base (its z axis) that these servos ask for (rad).
    pub rotation: f64,
    /// Mean misfit if each servo pulled the tendon of its own number as its reports rise, at the best turn.
    pub misfit_as_given: f64,
}

/// The servo of a tendon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MappedServo {
    /// Its number in the recording.
    pub servo: usize,
    /// What its reports are to be multiplied by: 1, or -1 where it pulls as they fall.
    pub sign: f64,
    /// Share of the markers' motion that the robot misses when its servo moves alone: 0 for none, 1 for as much as there is.
    pub misfit: f64,
}

impl ServoMap {
    /// Mean misfit.
    pub fn misfit(&self) -> f64 {
        let all: f64 = self.servos.iter().map(|servo| servo.misfit).sum();
        all / self.servos.len().max(1) as f64
    }

    /// Mean misfit, and what the turn costs.
    fn cost(&self) -> f64 {
        self.misfit() + TURN_COST * (self.rotation / PI).powi(2)
    }

    /// Whether each servo pulls the tendon of its own number, and pulls as its reports rise.
    pub fn is_identity(&self) -> bool {
        let mut pairs = self.servos.iter().enumerate();
        pairs.all(|(tendon, mapped)| mapped.servo == tendon && mapped.sign > 0.0)
    }
}

/// Two rows between which one servo moved alone.
struct Pull {
    servo: usize,
    /// What it reports in both (m, or N).
    from: f64,
    to: f64,
    /// What the others report meanwhile, at the median.
    others: f64,
    /// How far each marker moved (m); none where it was not seen in both.
    moved: Vec<Option<Vector3<f64>>>,
}

/// What a robot's markers do, beside what was measured.
#[derive(Clone, Copy, Debug, Default)]
struct Overlap {
    /// Squares of measured and of simulated motions.
    squares: f64,
    /// Parts of their scalar product that do not change, change with the cosine, and with the sine of a turn about the base.
    along: f64,
    cosine: f64,
    sine: f64,
}

impl Overlap {
    /// Adds a motion that was `measured`, and `simulated` by the robot, whose base has the axis `axis`.
    fn add(&mut self, measured: &Vector3<f64>, simulated: &Vector3<f64>, axis: &Vector3<f64>) {
        self.squares += measured.norm_squared() + simulated.norm_squared();
        let along = axis.dot(measured) * axis.dot(simulated);
        self.along += along;
        self.cosine += measured.dot(simulated) - along;
        self.sine += axis.cross(measured).dot(simulated);
    }

    /// Squared misfit by the squares of both motions, with the recording turned.
    fn misfit(&self, turn: f64) -> f64 {
        let product = self.along + self.cosine * turn.cos() + self.sine * turn.sin();
        match self.squares > 0.0 {
            true => (1.0 - 2.0 * product / self.squares).max(0.0),
            false => 1.0,
        }
    }
}

/// Finds which servo of `recording` pulls which tendon of a robot, and the way in which its reports count, from rows in which it moves
/// alone: the markers have to move as the robot's would. `transmission` has the servos' numbers as they are given.
///
/// # Errors
/// [`RecordingError::NeverAlone`] where a servo never moves alone; those of a recording of another robot.
pub fn find_servo_map(
    spec: &RobotSpec,
    transmission: &Transmission,
    recording: &Recording,
) -> Result<ServoMap, RecordingError> {
    super::check(spec, transmission, recording)?;
    let robot = Robot::new(without_ranges(spec)?)?;
    let tendons = transmission.servos.len();
    let pulls = single_pulls(recording, tendons);
    let missing: Vec<usize> = (0..tendons)
        .filter(|&servo| pulls.iter().all(|pull| pull.servo != servo))
        .collect();
    if !missing.is_empty() {
        return Err(RecordingError::NeverAlone { servos: missing });
    }
    // Servos at rest report what they report whichever of them moves: most of them count the same way, up or down.
    let found = [1.0, -1.0].map(|rest| {
        let overlaps = overlaps(&robot, transmission, &pulls, rest);
        let turns = (0..TURNS).map(|k| 2.0 * PI * (k as f64 / TURNS as f64 - 0.5));
        let maps = turns.map(|turn| assign(&overlaps, turn));
        // There are turns to start from.
        (maps.min_by(|a, b| a.cost().total_cmp(&b.cost())))
            .unwrap_or_else(|| assign(&overlaps, 0.0))
    });
    let [up, down] = found;
    let misfit_as_given = up.misfit_as_given;
    let better = if up.cost() <= down.cost() { up } else { down };
    Ok(ServoMap {
        misfit_as_given,
        ..better
    })
}

/// The widest pulls of each servo alone.
fn single_pulls(recording: &Recording, tendons: usize) -> Vec<Pull> {
    let rows = &recording.pulls;
    let range = |servo: usize, rows: &[Vec<f64>]| {
        let all = rows.iter().map(|row| row[servo]);
        all.clone().fold(f64::MIN, f64::max) - all.fold(f64::MAX, f64::min)
    };
    let widest = (0..tendons)
        .map(|servo| range(servo, rows))
        .fold(0.0, f64::max);
    let mut pulls: Vec<Pull> = Vec::new();
    let mut begin = 0;
    while begin + 1 < rows.len() {
        let moving = |end: usize| -> Vec<usize> {
            (0..tendons)
                .filter(|&servo| range(servo, &rows[begin..end]) > REST * widest)
                .collect()
        };
        let mut end = begin + 2;
        while end < rows.len() && moving(end + 1).len() <= 1 {
            end += 1;
        }
        if let [servo] = moving(end)[..]
            && let Some(pull) = pull(recording, begin..end, servo)
            && (pull.to - pull.from).abs() > PULLED * widest
        {
            pulls.push(pull);
        }
        begin = end - 1;
    }
    pulls.sort_by(|a, b| {
        let width = |pull: &Pull| (pull.to - pull.from).abs();
        (a.servo.cmp(&b.servo)).then(width(b).total_cmp(&width(a)))
    });
    let mut kept = vec![0; tendons];
    pulls.retain(|pull| {
        kept[pull.servo] += 1;
        kept[pull.servo] <= PULLS
    });
    pulls
}

/// The pull of a servo between its lowest and its highest row in which markers were seen.
fn pull(recording: &Recording, rows: std::ops::Range<usize>, servo: usize) -> Option<Pull> {
    let reported = |row: &usize| recording.pulls[*row][servo];
    let seen = rows.filter(|&row| recording.points[row].iter().any(Option::is_some));
    let seen: Vec<usize> = seen.collect();
    let by_report = |a: &&usize, b: &&usize| reported(a).total_cmp(&reported(b));
    let (&low, &high) = (
        seen.iter().min_by(by_report)?,
        seen.iter().max_by(by_report)?,
    );
    let mut others: Vec<f64> = (recording.pulls[high].iter().enumerate())
        .filter(|(other, _)| *other != servo)
        .map(|(_, reported)| *reported)
        .collect();
    let points = recording.points[low].iter().zip(&recording.points[high]);
    Some(Pull {
        servo,
        from: reported(&low),
        to: reported(&high),
        others: match others.is_empty() {
            true => 0.0,
            false => median(&mut others),
        },
        moved: points.map(|(low, high)| Some((*high)? - (*low)?)).collect(),
    })
}

/// For each servo and tendon what the robot's markers would do, for both signs; what servos at rest report counts with the sign `rest`.
fn overlaps(
    robot: &Robot,
    transmission: &Transmission,
    pulls: &[Pull],
    rest: f64,
) -> Vec<Vec<[Overlap; 2]>> {
    let tendons = transmission.servos.len();
    let markers: Vec<DiscPoint> = transmission.markers.iter().map(Marker::point).collect();
    let [w, x, y, z] = robot.spec().base.orientation;
    let base = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
    let axis = base * Vector3::z();
    let one = |settler: &mut Settler, pull: &Pull, tendon: usize, sign: f64| {
        let mut overlap = Overlap::default();
        let mut at = |level: f64| -> Option<Vec<Vector3<f64>>> {
            let mut reported = vec![rest * pull.others; tendons];
            reported[tendon] = sign * level;
            let still = Recording {
                times: vec![0.0],
                pulls: vec![reported],
                points: vec![Vec::new()],
                ..Recording::default()
            };
            let command = transmission.commands(robot, &still).pop()?;
            let settled = settler.settle(&robot.command(&command).ok()?, &Loads::default());
            let places = markers.iter().map(|marker| place(settled, marker));
            settled.converged.then(|| places.collect())
        };
        let (from, to) = (at(pull.from), at(pull.to));
        for (m, moved) in pull.moved.iter().enumerate() {
            if let Some(measured) = moved {
                // A robot that does not settle so is none that was measured.
                let simulated = from
                    .as_ref()
                    .zip(to.as_ref())
                    .map(|(from, to)| to[m] - from[m]);
                overlap.add(measured, &simulated.unwrap_or(-measured), &axis);
            }
        }
        overlap
    };
    let found: Vec<(usize, Vec<[Overlap; 2]>)> = (pulls.par_iter())
        .map_init(
            || Settler::new(robot),
            |settler, pull| {
                let row = (0..tendons)
                    .map(|tendon| [1.0, -1.0].map(|sign| one(settler, pull, tendon, sign)));
                (pull.servo, row.collect())
            },
        )
        .collect();
    let mut all = vec![vec![[Overlap::default(); 2]; tendons]; tendons];
    for (servo, row) in found {
        for (sum, one) in all[servo].iter_mut().flatten().zip(row.iter().flatten()) {
            sum.squares += one.squares;
            sum.along += one.along;
            sum.cosine += one.cosine;
            sum.sine += one.sine;
        }
    }
    all
}

/// The map with the smallest misfit from a first turn on: servos by the turn, then the turn by the servos, until neither changes.
fn assign(overlaps: &[Vec<[Overlap; 2]>], first: f64) -> ServoMap {
    let mut turn = first;
    let mut servos = Vec::new();
    for _ in 0..ROUNDS {
        let next = servos_at(overlaps, turn);
        let chosen = next.iter().enumerate();
        turn = best_turn(chosen.map(|(tendon, &servo)| better(&overlaps[servo][tendon], turn).1));
        if next == servos {
            break;
        }
        servos = next;
    }
    let mapped = servos.iter().enumerate().map(|(tendon, &servo)| {
        let (sign, overlap) = better(&overlaps[servo][tendon], turn);
        MappedServo {
            servo,
            sign,
            misfit: overlap.misfit(turn),
        }
    });
    let given = || (0..overlaps.len()).map(|tendon| &overlaps[tendon][tendon][0]);
    let unchanged = best_turn(given());
    let misfits: f64 = given().map(|overlap| overlap.misfit(unchanged)).sum();
    ServoMap {
        servos: mapped.collect(),
        rotation: turn,
        misfit_as_given: misfits / overlaps.len().max(1) as f64,
    }
}

/// The turn at which motions are most alike; 0 where it does not matter.
fn best_turn<'a>(overlaps: impl Iterator<Item = &'a Overlap>) -> f64 {
    let (mut cosine, mut sine) = (0.0, 0.0);
    for overlap in overlaps.filter(|overlap| overlap.squares > 0.0) {
        cosine += overlap.cosine / overlap.squares;
        sine += overlap.sine / overlap.squares;
    }
    f64::atan2(sine, cosine)
}

/// Of each tendon the servo, all servos once: the nearest first, then exchanged in pairs while the misfit falls.
fn servos_at(overlaps: &[Vec<[Overlap; 2]>], turn: f64) -> Vec<usize> {
    let count = overlaps.len();
    let misfit =
        |servo: usize, tendon: usize| better(&overlaps[servo][tendon], turn).1.misfit(turn);
    let mut pairs: Vec<(usize, usize)> = (0..count)
        .flat_map(|servo| (0..count).map(move |tendon| (servo, tendon)))
        .collect();
    pairs.sort_by(|&(s, t), &(u, v)| misfit(s, t).total_cmp(&misfit(u, v)));
    let (mut servos, mut taken) = (vec![None; count], vec![false; count]);
    for (servo, tendon) in pairs {
        if !taken[servo] && servos[tendon].is_none() {
            (taken[servo], servos[tendon]) = (true, Some(servo));
        }
    }
    // Each tendon has one, as there are as many servos.
    let mut servos: Vec<usize> = servos.into_iter().flatten().collect();
    loop {
        let mut exchanged = false;
        for a in 0..count {
            for b in a + 1..count {
                let (s, t) = (servos[a], servos[b]);
                if misfit(t, a) + misfit(s, b) < misfit(s, a) + misfit(t, b) - 1e-12 {
                    servos.swap(a, b);
                    exchanged = true;
                }
            }
        }
        if !exchanged {
            return servos;
        }
    }
}

/// The sign with the smaller misfit.
fn better(overlaps: &[Overlap; 2], turn: f64) -> (f64, &Overlap) {
    let [up, down] = overlaps;
    match up.misfit(turn) <= down.misfit(turn) {
        true => (1.0, up),
        false => (-1.0, down),
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand::seq::SliceRandom;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    use super::super::{Replay, Servo};
    use super::*;
    use crate::robot::{Backbone, Drive, PerDisc, Pull as Pulls};

    /// Servos in any order, some of which report the other way round, of a robot that stands turned: each moves alone, up and down.
    fn shuffled(turn: f64, seed: u64) -> (RobotSpec, Transmission, Recording, Vec<(usize, f64)>) {
        let mut spec = RobotSpec::standard("3m").expect("a standard robot");
        for module in &mut spec.modules {
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.5)));
            if let Some(tendons) = &mut module.tendons {
                tendons.pull = Pulls::TensionOnly;
                tendons.drive = Drive::Gain(2000.0);
            }
        }
        let tip = spec.disc_count() - 1;
        let marker = Marker {
            disc: tip,
            place: Vector3::new(0.004, 0.0, 0.0),
        };
        let transmission = Transmission::ideal(9, vec![marker]);
        let mut recording = Recording::default();
        for servo in 0..9 {
            for step in 0..12 {
                let up = 1.0 - (f64::from(step) - 6.0).abs() / 6.0;
                let mut pulls = vec![-1e-3; 9];
                pulls[servo] = -1e-3 + 0.012 * up;
                recording.times.push(recording.times.len() as f64);
                recording.pulls.push(pulls);
                recording.points.push(vec![None]);
            }
        }
        let replay = Replay::new(&spec, &transmission, &recording).expect("a replay");
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let normal = Normal::new(0.0, 1e-3).expect("a deviation above 0");
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -turn);
        for (points, simulated) in recording.points.iter_mut().zip(&replay.points) {
            let simulated = simulated.as_ref().expect("settled")[0];
            points[0] = Some(turned * simulated + Vector3::from_fn(|_, _| normal.sample(&mut rng)));
        }
        let mut order: Vec<usize> = (0..9).collect();
        order.shuffle(&mut rng);
        let signs: Vec<f64> = (0..9)
            .map(|k| if k % 4 == 1 { -1.0 } else { 1.0 })
            .collect();
        for pulls in &mut recording.pulls {
            // Servo `order[t]` pulls tendon `t`.
            let mut reported = vec![0.0; 9];
            for (tendon, &servo) in order.iter().enumerate() {
                reported[servo] = signs[tendon] * pulls[tendon];
            }
            *pulls = reported;
        }
        let truth = order.into_iter().zip(signs).collect();
        (spec, transmission, recording, truth)
    }

    #[test]
    fn servos_are_told_by_what_they_move_alone() {
        for (turn, seed) in [(0.0, 1), (0.3, 2), (-0.5, 3)] {
            let (spec, transmission, recording, truth) = shuffled(turn, seed);
            let map = find_servo_map(&spec, &transmission, &recording).expect("a map");
            let found: Vec<(usize, f64)> = map.servos.iter().map(|m| (m.servo, m.sign)).collect();
            assert_eq!(found, truth, "turn {turn}: {map:?}");
            assert!(
                (map.rotation - turn).abs() < 0.05,
                "{} for {turn}",
                map.rotation
            );
            assert!(map.servos.iter().all(|m| m.misfit < 0.05), "{map:?}");
            assert!(!map.is_identity());
        }
    }

    #[test]
    fn a_servo_that_never_moves_alone_is_named() {
        let (spec, mut transmission, mut recording, _) = shuffled(0.0, 4);
        transmission.servos[2] = Servo::default();
        for pulls in &mut recording.pulls {
            pulls[7] = pulls[2];
        }
        let error = find_servo_map(&spec, &transmission, &recording);
        assert_eq!(
            error,
            Err(RecordingError::NeverAlone { servos: vec![2, 7] })
        );
    }
}
