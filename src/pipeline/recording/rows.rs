//! Rows of a recording as a table has them, and what is wrong with some.

use std::path::Path;

use nalgebra::Vector3;
use tdcr_base::files::{self, without_mark};
use tdcr_base::rows::Splitter;
use tdcr_base::stats::{quantile, sorted};
use tdcr_sim::inverse::recording::Recording;

use super::{BadRow, Columns, MOST_ROWS, RecordingFileError};

/// Largest table (bytes): so many rows of 250 columns.
const LARGEST: u64 = 512 << 20;

/// A marker alone that far from both neighbours, in distances of these from each other, has jumped.
const JUMP: f64 = 5.0;
/// And as far as this share of what the markers' places extend over.
const FAR: f64 = 0.1;

/// What happens to rows that cannot be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BadRows {
    /// The recording is refused.
    #[default]
    Refused,
    /// They are left out, and noted.
    LeftOut,
}

/// A recording, and which line of the file each row is.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingFile {
    /// The rows that are good.
    pub recording: Recording,
    /// The motion that each row belongs to; empty names without a pattern column. Of a data set the split.
    pub patterns: Vec<String>,
    /// The line of each row, from 1; of a data set's or a log's sample its number in its split or the log, from 0.
    pub lines: Vec<usize>,
    /// The rows that are not, by line.
    pub bad: Vec<BadRow>,
}

impl RecordingFile {
    /// Reads a table (CSV, its separator a comma, a semicolon or a tab).
    ///
    /// Bad are rows with a cell that is no finite number, with fewer cells than columns, earlier than the row before, and with a
    /// marker that is far from where it was before and after. They are told, not refused: see [`RecordingFile::refuse_bad`].
    ///
    /// # Errors
    /// [`RecordingFileError`] for a file that cannot be read, without the columns that the map names, or without rows.
    pub fn load(path: &Path, columns: &Columns) -> Result<Self, RecordingFileError> {
        let bytes = files::read(path, LARGEST).map_err(|source| RecordingFileError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(&bytes, columns, path)
    }

    /// The same from bytes; `path` is for messages.
    ///
    /// # Errors
    /// As [`RecordingFile::load`].
    pub fn parse(bytes: &[u8], columns: &Columns, path: &Path) -> Result<Self, RecordingFileError> {
        if columns.markers.is_empty() {
            return Err(RecordingFileError::Columns {
                path: path.to_owned(),
                reason: "it is a table, and the column map has no [[markers]]; expected one or more measured points".to_owned(),
            });
        }
        let text = String::from_utf8_lossy(bytes);
        let mut lines = (1..)
            .zip(without_mark(&text).lines())
            .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
        let Some((_, header)) = lines.next() else {
            return Err(RecordingFileError::Empty {
                path: path.to_owned(),
            });
        };
        let found = |separator: u8| header.bytes().filter(|&byte| byte == separator).count();
        let separator = [b',', b';', b'\t']
            .into_iter()
            .max_by_key(|&separator| (found(separator), separator == b','))
            .unwrap_or(b',');
        let mut splitter = Splitter::new(separator);
        let names = splitter.trimmed(header);
        let places = Places::new(&names, columns, path)?;
        let mut rows = Vec::new();
        let mut file = Self {
            recording: Recording::default(),
            patterns: Vec::new(),
            lines: Vec::new(),
            bad: Vec::new(),
        };
        while let Some((line, text)) = lines.next() {
            if rows.len() + file.bad.len() == MOST_ROWS {
                return Err(RecordingFileError::TooManyRows {
                    path: path.to_owned(),
                    found: MOST_ROWS + 1 + lines.count(),
                });
            }
            let cells = splitter.trimmed(text);
            match places.read(&cells, &names, columns, rows.len()) {
                Ok(row) => rows.push((line, row)),
                Err(reason) => file.bad.push(BadRow { line, reason }),
            }
        }
        file.add_in_time(rows);
        file.drop_jumps(columns);
        if file.recording.is_empty() && file.bad.is_empty() {
            return Err(RecordingFileError::Empty {
                path: path.to_owned(),
            });
        }
        file.bad.sort_by_key(|bad| bad.line);
        Ok(file)
    }

    /// Adds rows in the order of time, and tells those that are not: one that is later than the two after it, which follow the one
    /// before it, is out of order itself, else each that is earlier than one above.
    fn add_in_time(&mut self, rows: Vec<(usize, Row)>) {
        let times: Vec<f64> = rows.iter().map(|(_, row)| row.time).collect();
        for (place, (line, row)) in rows.into_iter().enumerate() {
            let last = self.recording.times.last().copied();
            let earlier = |time: f64| last.is_some_and(|last| time < last);
            let next = times.get(place + 1..).unwrap_or_default();
            let ahead = match *next {
                [a, b, ..] => row.time > a.max(b) && !earlier(a.min(b)),
                _ => false,
            };
            let reason = match (earlier(row.time), ahead) {
                (true, _) => "its time is before that of the row above",
                (false, true) => "its time is after those of the rows below",
                (false, false) => {
                    self.recording.times.push(row.time);
                    self.recording.pulls.push(row.pulls);
                    let points = row.points.into_iter().map(Some);
                    self.recording.points.push(points.collect());
                    self.patterns.push(row.pattern);
                    self.lines.push(line);
                    continue;
                }
            };
            let reason = reason.to_owned();
            self.bad.push(BadRow { line, reason });
        }
    }

    /// Refuses a file with bad rows, the first of them by line; `skip` leaves them out, unless no row is left.
    ///
    /// # Errors
    /// [`RecordingFileError::BadRows`].
    pub fn refuse_bad(&self, path: &Path, skip: bool) -> Result<(), RecordingFileError> {
        match self.bad.is_empty() || (skip && !self.recording.is_empty()) {
            true => Ok(()),
            false => Err(RecordingFileError::BadRows {
                path: path.to_owned(),
                rows: self.bad.clone(),
            }),
        }
    }

    /// Tells rows in which a marker alone is far from both neighbours, and takes its place out: the servos still count.
    fn drop_jumps(&mut self, columns: &Columns) {
        let rows = self.recording.len();
        let names = columns.marker_names();
        for (marker, name) in names.iter().enumerate() {
            let points: Vec<Vector3<f64>> = self
                .recording
                .points
                .iter()
                .filter_map(|row| row[marker])
                .collect();
            let extent = |axis: usize| {
                let all = points.iter().map(|p| p[axis]);
                all.clone().fold(f64::MIN, f64::max) - all.fold(f64::MAX, f64::min)
            };
            // Half of the places lie within their quartiles, whatever a few of them say.
            let distances = sorted(points.iter().map(|p| (p - points[0]).norm()));
            let typical = quantile(&distances, 0.75).min((0..3).map(extent).fold(0.0, f64::max));
            for row in 1..rows.saturating_sub(1) {
                let (before, at, after) = (points[row - 1], points[row], points[row + 1]);
                let alone = (at - before).norm().min((at - after).norm());
                if alone > JUMP * (after - before).norm() + FAR * typical {
                    self.recording.points[row][marker] = None;
                    let reason = format!("{name} jumps by {:.1} mm and back", 1e3 * alone);
                    self.bad.push(BadRow {
                        line: self.lines[row],
                        reason,
                    });
                }
            }
        }
    }
}

/// Where each column is.
struct Places {
    time: Option<usize>,
    pattern: Option<usize>,
    servos: Vec<usize>,
    markers: Vec<MarkerPlaces>,
}

struct MarkerPlaces {
    position: [usize; 3],
    orientation: Option<[usize; 4]>,
}

struct Row {
    time: f64,
    pattern: String,
    pulls: Vec<f64>,
    points: Vec<Vector3<f64>>,
}

impl Places {
    fn new(names: &[String], columns: &Columns, path: &Path) -> Result<Self, RecordingFileError> {
        let place = |wanted: &String| {
            let mut found = (0..names.len()).filter(|&place| names[place] == *wanted);
            match (found.next(), found.count()) {
                (Some(place), 0) => Ok(place),
                (Some(_), others) => Err(RecordingFileError::SameColumn {
                    path: path.to_owned(),
                    column: wanted.clone(),
                    count: 1 + others,
                }),
                (None, _) => Err(RecordingFileError::NoColumn {
                    path: path.to_owned(),
                    column: wanted.clone(),
                    found: names.join(", "),
                }),
            }
        };
        Ok(Self {
            time: columns
                .time
                .as_ref()
                .map(|time| place(&time.column))
                .transpose()?,
            pattern: columns.pattern.as_ref().map(place).transpose()?,
            servos: columns
                .servos
                .iter()
                .map(|servo| place(&servo.column))
                .collect::<Result<_, _>>()?,
            markers: (columns.markers.iter())
                .map(|marker| {
                    let [x, y, z] = &marker.columns;
                    let orientation = match &marker.orientation {
                        Some([w, x, y, z]) => Some([place(w)?, place(x)?, place(y)?, place(z)?]),
                        None => None,
                    };
                    Ok(MarkerPlaces {
                        position: [place(x)?, place(y)?, place(z)?],
                        orientation,
                    })
                })
                .collect::<Result<_, RecordingFileError>>()?,
        })
    }

    /// A row's numbers, or what is wrong with it.
    fn read(
        &self,
        cells: &[String],
        names: &[String],
        columns: &Columns,
        row: usize,
    ) -> Result<Row, String> {
        if cells.len() < names.len() {
            return Err(format!(
                "{} cells; the header has {} columns",
                cells.len(),
                names.len()
            ));
        }
        let number = |place: usize| match cells[place].parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!(
                "{} is `{}`; expected a finite number",
                names[place], cells[place]
            )),
        };
        let time = match (self.time, &columns.time) {
            (Some(place), Some(time)) => number(place)? * time.unit.seconds(),
            _ => row as f64,
        };
        let pulls: Result<Vec<f64>, String> = (self.servos.iter().zip(&columns.servos))
            .map(|(&place, servo)| Ok(servo.pull(number(place)?)))
            .collect();
        let frame = columns.pose();
        let mut points = Vec::new();
        for (places, marker) in self.markers.iter().zip(&columns.markers) {
            let [x, y, z] = places.position;
            let orientation = match places.orientation {
                Some([w, x, y, z]) => Some([number(w)?, number(x)?, number(y)?, number(z)?]),
                None => None,
            };
            let position = [number(x)?, number(y)?, number(z)?];
            points.extend(marker.measured(&frame, position, orientation)?);
        }
        Ok(Row {
            time,
            pattern: self
                .pattern
                .map_or_else(String::new, |place| cells[place].clone()),
            pulls: pulls?,
            points,
        })
    }
}
