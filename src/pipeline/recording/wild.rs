//! Cells of a recording that cannot be: a pull longer than its tendon, a marker farther away than the robot reaches, a servo that
//! jumps and takes no marker with it.
//!
//! A single such cell would spoil a fit. What a column says is held against its own median, so that zeros and frames that nobody
//! has given do not count.

use std::ops::Range;

use nalgebra::Vector3;
use tdcr_base::stats::{median, sorted};
use tdcr_sim::chain::Configuration;
use tdcr_sim::inverse::recording::Recording;
use tdcr_sim::robot::{Drive, Robot};

use super::{BadRow, Columns, RecordingFile};

/// Tensions above the largest of a tendon's range, and of nearly all rows, by this factor cannot be.
const TENSION: f64 = 10.0;
/// Places of markers on a robot of length 1 lie in a ball of radius 1, and a little outside where they stand off it; none is farther
/// than this from their median.
const REACH: f64 = 2.25;
/// Rows that a wild value lasts for at the most, where it is no longer than its tendon.
const RUN: usize = 3;
/// A servo alone that far from both neighbours, in distances of these from each other, has jumped.
const JUMP: f64 = 5.0;
/// And as far as this share of what the servos usually range over.
const FAR: f64 = 0.25;
/// If no marker moves by this share of it.
const FOLLOWED: f64 = 0.5;
/// Share of the values at each end that does not count where a usual one is asked for.
const TAIL: f64 = 0.05;

/// What a servo's column may say.
struct Column {
    name: String,
    median: f64,
    /// Farthest from the median (m, or N).
    most: f64,
    drive: Drive,
    /// What that is, for messages.
    limit: String,
}

impl RecordingFile {
    /// Takes the rows out, and tells them, in which a servo of `robot` says what cannot be, and markers that cannot be where they
    /// are said to be.
    pub(super) fn take_out_wild(&mut self, columns: &Columns, robot: &Robot) {
        let servos = servo_columns(&self.recording, columns, robot);
        let range = usual_range(&self.recording, &servos);
        let wild: Vec<Option<String>> = (0..self.recording.len())
            .map(|row| wild_servo(&self.recording, &servos, range, row))
            .collect();
        self.keep_rows(wild);
        self.take_out_far_markers(columns, robot);
    }

    /// Keeps the rows of which nothing is said.
    fn keep_rows(&mut self, wild: Vec<Option<String>>) {
        if wild.iter().all(Option::is_none) {
            return;
        }
        let kept: Vec<bool> = wild.iter().map(Option::is_none).collect();
        let bad = self.lines.iter().zip(wild);
        self.bad.extend(bad.filter_map(|(&line, reason)| {
            let reason = reason?;
            Some(BadRow { line, reason })
        }));
        self.bad.sort_by_key(|bad| bad.line);
        let Recording {
            times,
            pulls,
            points,
            clouds,
            payloads,
            ..
        } = &mut self.recording;
        keep(times, &kept);
        keep(pulls, &kept);
        keep(points, &kept);
        keep(clouds, &kept);
        keep(payloads, &kept);
        keep(&mut self.patterns, &kept);
        keep(&mut self.lines, &kept);
    }

    fn take_out_far_markers(&mut self, columns: &Columns, robot: &Robot) {
        let length = robot.arc_lengths().last().copied().unwrap_or(0.0);
        let names = columns.marker_names();
        for (marker, name) in names.iter().enumerate() {
            let places = self.recording.points.iter().filter_map(|row| row[marker]);
            let places: Vec<Vector3<f64>> = places.collect();
            let middle = |axis: usize| {
                let mut along: Vec<f64> = places.iter().map(|place| place[axis]).collect();
                median(&mut along)
            };
            let middle = Vector3::new(middle(0), middle(1), middle(2));
            for (row, line) in self.recording.points.iter_mut().zip(&self.lines) {
                let Some(place) = row[marker] else { continue };
                let distance = (place - middle).norm();
                // Of a distance too large for a number too.
                if distance <= REACH * length {
                    continue;
                }
                row[marker] = None;
                let reason = format!(
                    "{name} is {} from where the marker usually is; the robot is {} long",
                    millimetres(distance),
                    millimetres(length)
                );
                self.bad.push(BadRow {
                    line: *line,
                    reason,
                });
            }
        }
        self.bad.sort_by_key(|bad| bad.line);
    }
}

/// What the columns of the servos may say.
fn servo_columns(recording: &Recording, columns: &Columns, robot: &Robot) -> Vec<Column> {
    let straight = Configuration::straight(robot);
    let lengths = robot.tendon_kinematics(&straight).0;
    let tendons = robot.spec().tendons();
    (columns.servos.iter().zip(tendons).zip(lengths).enumerate())
        .map(|(servo, ((column, tendon), length))| {
            let pulls = || recording.pulls.iter().map(move |row| row[servo]);
            let (median, most, limit) = match tendon.drive {
                Drive::Tension => {
                    let [_, usual] = usual_ends(pulls().map(f64::abs));
                    let largest = usual.max(tendon.range[1]);
                    (
                        0.0,
                        TENSION * largest,
                        format!(
                            "{largest:.1} N is the largest of nearly all rows and of its range"
                        ),
                    )
                }
                _ => (
                    median(&mut pulls().collect::<Vec<f64>>()),
                    length,
                    format!("the whole tendon is {} long", millimetres(length)),
                ),
            };
            Column {
                name: column.column.clone(),
                median,
                most,
                drive: tendon.drive,
                limit,
            }
        })
        .collect()
}

/// The widest range of a servo that pulls by length (m), without the ends.
fn usual_range(recording: &Recording, servos: &[Column]) -> f64 {
    let range = |(servo, _): (usize, &Column)| {
        let pulls = recording.pulls.iter().map(|row| row[servo]);
        let [low, high] = usual_ends(pulls);
        high - low
    };
    let lengths = servos.iter().enumerate();
    lengths
        .filter(|(_, column)| column.drive != Drive::Tension)
        .map(range)
        .fold(0.0, f64::max)
}

/// What a servo says in a row that cannot be.
fn wild_servo(recording: &Recording, servos: &[Column], range: f64, row: usize) -> Option<String> {
    let pulls = &recording.pulls[row];
    (servos.iter().zip(pulls).enumerate()).find_map(|(servo, (column, &pull))| {
        let (name, away) = (&column.name, pull - column.median);
        let of_length = column.drive != Drive::Tension;
        if away.is_finite() && away.abs() <= column.most {
            let (jump, run) = of_length.then(|| jump(recording, servo, range, row))??;
            let is_at_end = run.start == 0 || run.end == recording.len();
            return Some(format!(
                "{name} jumps by {}{}, and no marker moves by half as much",
                millimetres(jump),
                if is_at_end { "" } else { " and back" }
            ));
        }
        let found = match of_length {
            true => format!("pulls by {}", millimetres(away)),
            false => format!("says {} N", number(pull)),
        };
        Some(format!("{name} {found}; {}", column.limit))
    })
}

/// By how much a servo is far from where it is before and after (m), in how many rows, up to [`RUN`], while no marker is. Where the
/// recording begins or ends, what is on the other side counts.
fn jump(
    recording: &Recording,
    servo: usize,
    range: f64,
    row: usize,
) -> Option<(f64, Range<usize>)> {
    let runs = (1..=RUN).flat_map(|rows| {
        let first = (row + 1).saturating_sub(rows);
        (first..=row).map(move |first| first..first + rows)
    });
    let mut runs = runs.filter(|run| run.end <= recording.len());
    runs.find_map(|run| Some((jump_of(recording, servo, range, run.clone())?, run)))
}

/// The same of the rows `run`, the least of them.
fn jump_of(recording: &Recording, servo: usize, range: f64, run: Range<usize>) -> Option<f64> {
    let [before, after] = beside(recording.len(), &run)?;
    let pull = |row: usize| recording.pulls[row][servo];
    let away = |row: usize| {
        (pull(row) - pull(before))
            .abs()
            .min((pull(row) - pull(after)).abs())
    };
    let alone = run.clone().map(away).fold(f64::INFINITY, f64::min);
    let moved = |marker: usize| {
        let place = |row: usize| recording.points[row][marker];
        let (Some(a), Some(c)) = (place(before), place(after)) else {
            return true;
        };
        let far = |row| place(row).is_none_or(|b| (b - (a + c) / 2.0).norm() >= FOLLOWED * alone);
        run.clone().any(far)
    };
    let mut markers = 0..recording.points[run.start].len();
    let steady = (pull(after) - pull(before)).abs();
    let jumped = range > 0.0 && alone > JUMP * steady + FAR * range;
    (jumped && !markers.is_empty() && !markers.any(moved)).then_some(alone)
}

/// The rows with which rows are compared: those before and after them, where they are at an end the two next to them.
fn beside(rows: usize, run: &Range<usize>) -> Option<[usize; 2]> {
    let after = |row: usize| (row < rows).then_some(row);
    match (run.start.checked_sub(1), after(run.end)) {
        (Some(before), Some(after)) => Some([before, after]),
        (None, Some(next)) => Some([next, after(next + 1)?]),
        (Some(last), None) => Some([last.checked_sub(1)?, last]),
        (None, None) => None,
    }
}

/// Keeps the elements of a list that is empty or has one for each row.
fn keep<T>(list: &mut Vec<T>, kept: &[bool]) {
    let mut kept = kept.iter();
    list.retain(|_| kept.next().copied().unwrap_or(true));
}

/// Two values between which nearly all lie: with the share [`TAIL`] of all below the first and above the second, the largest
/// never among them; zeros of none. Both are values that are there, and not quantiles: interpolated, the second would still
/// follow a wild value among a dozen.
fn usual_ends(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let values = sorted(values);
    let Some(last) = values.len().checked_sub(1) else {
        return [0.0; 2];
    };
    [TAIL, 1.0 - TAIL].map(|share| values[(share * last as f64) as usize])
}

fn millimetres(metres: f64) -> String {
    format!("{} mm", number(1e3 * metres))
}

/// A number of a length that can be read.
fn number(value: f64) -> String {
    match value.abs() < 1e6 {
        true => format!("{value:.1}"),
        false => format!("{value:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use tdcr_sim::robot::RobotSpec;

    use super::*;

    /// A recording of 2m with a marker at its tip, its servos pulling by 10 mm and back, one after the other.
    fn recording(columns: &Columns) -> RecordingFile {
        let row = |k: usize| {
            let phase = (k % 20) as f64 / 10.0;
            let pull = 0.01 * (1.0 - (phase - 1.0).abs());
            let mut pulls = vec![0.0; columns.servos.len()];
            pulls[k / 20] = pull;
            let tip = Vector3::new(4.0 * pull, 0.0, 0.19);
            (pulls, vec![Some(tip)])
        };
        let (pulls, points): (Vec<_>, Vec<_>) = (0..120).map(row).unzip();
        RecordingFile {
            recording: Recording {
                times: (0..120).map(f64::from).collect(),
                pulls,
                points,
                ..Recording::default()
            },
            patterns: vec![String::new(); 120],
            lines: (2..122).collect(),
            bad: Vec::new(),
        }
    }

    fn columns(spec: &RobotSpec) -> Columns {
        let mut columns = Columns::of_commands(spec);
        let marker = "disc = \"tip\"\ncolumns = [\"x\", \"y\", \"z\"]\nunit = \"mm\"";
        columns.markers = vec![toml::from_str(marker).expect("a marker")];
        columns
    }

    /// What is refused of 2m's recording after `change`, and how many rows are left.
    fn refused(change: impl FnOnce(&mut Recording)) -> (Vec<(usize, String)>, usize) {
        let spec = RobotSpec::standard("2m").expect("a standard robot");
        let columns = columns(&spec);
        let mut file = recording(&columns);
        change(&mut file.recording);
        file.take_out_wild(&columns, &Robot::new(spec).expect("valid"));
        let bad = file.bad.into_iter();
        (
            bad.map(|bad| (bad.line, bad.reason)).collect(),
            file.recording.len(),
        )
    }

    #[test]
    fn what_moves_as_robots_do_is_kept() {
        assert_eq!(refused(|_| ()), (Vec::new(), 120));
        // Zeros that nobody gave, a frame elsewhere, and a pull between two rests that the tip follows.
        let shifted = refused(|recording| {
            recording.pulls.iter_mut().for_each(|row| row[0] += 3.0);
            let points = recording.points.iter_mut().flatten().flatten();
            points.for_each(|point| point.x += 20.0);
            recording.pulls[60][5] = 0.012;
            recording.points[60][0] = Some(Vector3::new(20.03, 0.0, 0.19));
        });
        assert_eq!(shifted, (Vec::new(), 120));
    }

    #[test]
    fn a_wild_cell_of_a_servo_takes_its_row_out_and_is_named() {
        for (pull, expected) in [
            (1e300, "pulls by 1.0e303 mm; the whole tendon is"),
            (f64::MAX, "pulls by inf mm"),
            (1.0, "pulls by 1000.0 mm"),
            (-0.4, "pulls by -400.0 mm"),
            (0.006, "jumps by 6.0 mm and back, and no marker moves"),
            (0.016, "jumps by "),
        ] {
            for row in [0, 1, 25, 118, 119] {
                // At an end there is nothing to tell how the marker would have gone on.
                if [0, 119].contains(&row) && pull == 0.006 {
                    continue;
                }
                let (bad, left) = refused(|recording| recording.pulls[row][4] = pull);
                assert_eq!((bad.len(), left), (1, 119), "{pull} {bad:?}");
                assert_eq!(bad[0].0, row + 2);
                let named = format!("command 4 {expected}");
                assert!(bad[0].1.starts_with(&named), "{}", bad[0].1);
            }
        }
    }

    #[test]
    fn a_wild_value_that_lasts_for_some_rows_takes_all_of_them_out() {
        for rows in [0..2, 24..26, 50..53, 117..120] {
            let (bad, left) = refused(|recording| {
                for (row, pulls) in recording.pulls[rows.clone()].iter_mut().enumerate() {
                    pulls[4] = 0.03 + 0.001 * row as f64;
                }
            });
            let lines: Vec<usize> = bad.iter().map(|(line, _)| *line - 2).collect();
            assert_eq!(lines, rows.clone().collect::<Vec<_>>(), "{bad:?}");
            assert_eq!(left, 120 - rows.len());
        }
        // A servo that stays where it went moved, though no marker followed.
        let moved = refused(|recording| {
            let rest = &mut recording.pulls[60..];
            rest.iter_mut().for_each(|row| row[4] += 0.006);
        });
        assert_eq!(moved, (Vec::new(), 120));
    }

    #[test]
    fn a_marker_out_of_reach_is_taken_out_and_its_row_stays() {
        for (row, y) in [(0, 1e300), (30, 1e300), (119, 1e300), (0, 0.4), (119, -0.4)] {
            let far = Some(Vector3::new(0.0, y, 0.0));
            let (bad, left) = refused(|recording| recording.points[row][0] = far);
            assert_eq!((bad.len(), left), (1, 120), "{bad:?}");
            assert!(bad[0].1.starts_with("x, y, z is "), "{}", bad[0].1);
        }
    }

    #[test]
    fn tensions_are_held_against_the_tendons_range_and_the_other_rows() {
        let mut spec = RobotSpec::standard("2m").expect("a standard robot");
        for tendons in spec.modules.iter_mut().filter_map(|m| m.tendons.as_mut()) {
            tendons.drive = Drive::Tension;
            tendons.range = [0.0, 5.0];
        }
        let columns = columns(&spec);
        let robot = Robot::new(spec).expect("valid");
        for (tension, left) in [(40.0, 120), (60.0, 119), (1e300, 119)] {
            let mut file = recording(&columns);
            file.recording.pulls[7][1] = tension;
            file.take_out_wild(&columns, &robot);
            assert_eq!(file.recording.len(), left, "{tension}: {:?}", file.bad);
        }
    }
}
