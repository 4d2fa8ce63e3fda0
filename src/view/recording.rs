//! A log as a robot over time: what was asked of its tendons, what its servos did, the clouds that were seen, and the pictures of
//! cameras. Pictures stay in the file, and are read when they are shown.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;
use tdcr_hw::log::{
    DecodeError, Entry, Image, Level, LogError, LogReader, LogRecord, Place, Topic,
};
use tdcr_sim::cloud::PointCloud;
use thiserror::Error;

/// Most points of all clouds that are kept: 15 bytes each. Clouds beyond are left out.
const MOST_POINTS: usize = 20_000_000;
/// Most entries of what servos did that are kept: beyond, each second one is left out, as often as it takes.
const MOST_STATES: usize = 100_000;

/// A log that is scrubbed through. Times (s) count from its first message.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    commands: Vec<(f64, Vec<f64>)>,
    servos: Vec<(f64, Vec<Servo>)>,
    clouds: Vec<(f64, PointCloud)>,
    events: Vec<Happened>,
    /// The colour pictures of each camera, in the order in which cameras come.
    cameras: Vec<Filmed>,
    file: Option<PictureFile>,
    /// Clouds that were left out.
    omitted: usize,
    /// Time of the last message.
    end: f64,
}

/// The log that pictures are read from.
type PictureFile = Arc<Mutex<LogReader<BufReader<File>>>>;

/// The pictures of a camera.
#[derive(Clone, Debug)]
struct Filmed {
    serial: String,
    pictures: Vec<(f64, Place)>,
}

/// What a servo did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Servo {
    pub id: u8,
    /// Position (ticks).
    pub position: i32,
    /// A.
    pub current: f64,
    /// Degrees Celsius, as last said.
    pub temperature: Option<f64>,
}

/// An event.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Happened {
    pub time: f64,
    pub level: &'static str,
    pub text: String,
}

/// What a page is told of a recording.
#[derive(Debug, Serialize)]
pub(super) struct Contents {
    /// s.
    end: f64,
    /// Times of the clouds (s).
    clouds: Vec<f64>,
    /// Clouds that were left out.
    omitted: usize,
    events: Vec<Happened>,
}

/// What a recording has at a time.
pub(super) struct Moment<'r> {
    pub command: Option<&'r [f64]>,
    pub servos: &'r [Servo],
    /// The last cloud, and its number.
    pub cloud: Option<(usize, &'r PointCloud)>,
}

/// Why a log cannot be shown.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// It cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// Reading broke off.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A message is not what its topic says.
    #[error("{} at {time:.3} s: {source}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// s.
        time: f64,
        /// What is wrong.
        source: DecodeError,
    },
    /// There is nothing of a robot in it.
    #[error(
        "{} has neither commands nor states of servos nor clouds nor pictures; expected the log of a rig",
        path.display()
    )]
    Nothing {
        /// The file.
        path: PathBuf,
    },
}

impl Recording {
    /// Reads a log.
    ///
    /// # Errors
    /// [`RecordingError`].
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let mut reader = LogReader::open(path)?;
        let mut found = Self::default();
        let mut temperatures = BTreeMap::new();
        let (mut first, mut points) = (None, 0);
        let (mut skipped, mut every) = (0, 1);
        loop {
            let entry = reader.next_entry();
            let entry = entry.map_err(|source| RecordingError::Read {
                path: path.to_owned(),
                source,
            })?;
            let message = match entry {
                None => break,
                Some(Entry::Message(message)) => message,
                Some(_) => continue,
            };
            let first = *first.get_or_insert(message.log_time);
            let time = message.log_time.saturating_sub(first) as f64 * 1e-9;
            found.end = found.end.max(time);
            match Topic::parse(&message.channel.topic) {
                Some(Topic::Color(serial)) => {
                    found.film(&serial).push((time, reader.place()));
                    continue;
                }
                Some(topic) if is_wanted(&topic) => {}
                _ => continue,
            }
            let record = LogRecord::decode(&message.channel, &message.data);
            let record = record.map_err(|source| RecordingError::Message {
                path: path.to_owned(),
                time,
                source,
            })?;
            match record {
                Some(LogRecord::Command(values)) => found.commands.push((time, values)),
                Some(LogRecord::Status(servos)) => {
                    let told = servos.iter();
                    temperatures.extend(told.filter_map(|s| Some((s.id.get(), s.temperature?))));
                }
                Some(LogRecord::Present(readings)) => {
                    skipped += 1;
                    if skipped < every {
                        continue;
                    }
                    skipped = 0;
                    let servos = readings.iter().map(|(id, reading)| Servo {
                        id: id.get(),
                        position: reading.position.0,
                        current: reading.current,
                        temperature: temperatures.get(&id.get()).copied(),
                    });
                    found.servos.push((time, servos.collect()));
                    if found.servos.len() > MOST_STATES {
                        let mut place = 0;
                        found.servos.retain(|_| {
                            place += 1;
                            place % 2 == 1
                        });
                        every *= 2;
                    }
                }
                Some(LogRecord::Event(event)) => found.events.push(Happened {
                    time,
                    level: match event.level {
                        Level::Debug => "debug",
                        Level::Info => "info",
                        Level::Warning => "warning",
                        Level::Error => "error",
                    },
                    text: event.text,
                }),
                Some(LogRecord::Cloud(cloud)) if points + cloud.len() <= MOST_POINTS => {
                    points += cloud.len();
                    found.clouds.push((time, cloud));
                }
                Some(LogRecord::Cloud(_)) => found.omitted += 1,
                _ => {}
            }
        }
        let is_empty = found.commands.is_empty() && found.servos.is_empty();
        if is_empty && found.clouds.is_empty() && found.cameras.is_empty() {
            let path = path.to_owned();
            return Err(RecordingError::Nothing { path });
        }
        found.file = Some(Arc::new(Mutex::new(reader)));
        Ok(found)
    }

    /// The pictures of a camera.
    fn film(&mut self, serial: &str) -> &mut Vec<(f64, Place)> {
        let known = self.cameras.iter().position(|known| known.serial == serial);
        let place = known.unwrap_or_else(|| {
            self.cameras.push(Filmed {
                serial: serial.to_owned(),
                pictures: Vec::new(),
            });
            self.cameras.len() - 1
        });
        &mut self.cameras[place].pictures
    }

    pub(super) fn contents(&self) -> Contents {
        Contents {
            end: self.end,
            clouds: self.clouds.iter().map(|(time, _)| *time).collect(),
            omitted: self.omitted,
            events: self.events.clone(),
        }
    }

    /// What there is at a time (s): of everything the last before it.
    pub(super) fn at(&self, time: f64) -> Moment<'_> {
        let cloud = last(&self.clouds, time);
        Moment {
            command: last(&self.commands, time).map(|place| &self.commands[place].1[..]),
            servos: last(&self.servos, time).map_or(&[], |place| &self.servos[place].1),
            cloud: cloud.map(|place| (place, &self.clouds[place].1)),
        }
    }
}

impl Recording {
    /// The number of each camera's picture at a time (s), the last before it; none where there is none yet.
    pub(super) fn pictures_at(&self, time: f64) -> Vec<Option<usize>> {
        let cameras = self.cameras.iter();
        cameras.map(|camera| last(&camera.pictures, time)).collect()
    }

    /// A picture of a camera; `None` where the file does not have it any more.
    pub(super) fn picture(&self, camera: usize, number: usize) -> Option<Image<[u8; 3]>> {
        let (_, place) = self.cameras.get(camera)?.pictures.get(number)?;
        let mut file = self
            .file
            .as_ref()?
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let message = file.message_at(*place).ok()??;
        match LogRecord::decode(&message.channel, &message.data).ok()?? {
            LogRecord::Color { image, .. } => Some(image),
            _ => None,
        }
    }
}

fn is_wanted(topic: &Topic) -> bool {
    let wanted = [
        Topic::Command,
        Topic::Status,
        Topic::Present,
        Topic::Events,
        Topic::Cloud,
    ];
    wanted.contains(topic)
}

/// Place of the last entry that is not after a time.
fn last<T>(entries: &[(f64, T)], time: f64) -> Option<usize> {
    entries
        .partition_point(|(at, _)| *at <= time)
        .checked_sub(1)
}
