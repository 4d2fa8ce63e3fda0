//! Writing logs.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Compression, WriteOptions, Writer};
use nalgebra::Isometry3;
use tdcr_sim::camera::Camera;
use tdcr_sim::render::RgbdFrame;

use super::container::LONGEST_RECORD;
use super::encode::{EFFORT, Encoded, encode};
use super::error::LogError;
use super::image::ImageFormat;
use super::record::{Image, LogRecord, Transform};
use super::room::Room;
use super::topic::Topic;
use crate::camera::Stamped;
use crate::clock::Clock;

/// How chunks are compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ChunkFormat {
    /// By zstd, fast: depth images take a quarter of their bytes, for some milliseconds each.
    #[default]
    Zstd,
    /// As they are: of a chunk that is cut off, each message is read that is whole.
    Plain,
}

/// How a log is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogSettings {
    /// Colour images.
    pub colors: ImageFormat,
    /// Chunks.
    pub chunks: ChunkFormat,
    /// Bytes after which a chunk is written. A chunk is held in memory until then, with the message that fills it.
    pub chunk: u64,
    /// Time, by the records' time stamps, after which a chunk is written though it is not full.
    pub flush_after: Duration,
    /// Bytes that are to stay free on the disk: before it takes them, the log ends.
    pub reserve: u64,
}

impl Default for LogSettings {
    fn default() -> Self {
        Self {
            colors: ImageFormat::default(),
            chunks: ChunkFormat::default(),
            chunk: 1 << 20,
            flush_after: Duration::from_secs(1),
            reserve: 4 << 20,
        }
    }
}

/// Options of our files: chunks are put together in memory and written whole, so what is on the disk is at any time the
/// start of the finished file.
pub(super) fn options(settings: LogSettings) -> WriteOptions {
    let compression = match settings.chunks {
        ChunkFormat::Zstd => Some(Compression::Zstd),
        ChunkFormat::Plain => None,
    };
    WriteOptions::new()
        .compression(compression)
        .compression_level(1)
        // In the thread that writes: a rig's others have work of their own.
        .compression_threads(0)
        .library(concat!("tdcr ", env!("CARGO_PKG_VERSION")))
        .chunk_size(Some(settings.chunk))
        .disable_seeking(true)
}

/// Writes a log, a record at a time.
///
/// A process that is killed loses the records since the last chunk was written: at most those of
/// [`flush_after`](LogSettings::flush_after), and of `chunk` bytes. Dropped, a log is finished as well as that goes;
/// [`finish`](Self::finish) says whether it did.
pub struct LogWriter {
    writer: Writer<NoSeek<BufWriter<File>>>,
    path: PathBuf,
    settings: LogSettings,
    room: Room,
    /// The clock's start since the Unix epoch.
    start: Duration,
    /// By names of topics and schemas.
    channels: HashMap<(Topic, String), Channel>,
    /// When a chunk was last known to be written.
    flushed: Duration,
}

/// A channel's number in the file, and how many messages it has.
#[derive(Clone, Copy)]
struct Channel {
    id: u16,
    messages: u32,
}

impl LogWriter {
    /// Begins a log of what happens by `clock`.
    ///
    /// # Errors
    /// [`LogError::File`]; for one, where `path` exists: no log is written over another file.
    pub fn create(path: &Path, clock: &dyn Clock, settings: LogSettings) -> Result<Self, LogError> {
        let file = File::create_new(path).map_err(|source| LogError::File {
            path: path.to_owned(),
            source,
        })?;
        let writer = options(settings)
            .create(NoSeek::new(BufWriter::new(file)))
            .map_err(|source| LogError::Write { source })?;
        Ok(Self {
            writer,
            path: path.to_owned(),
            settings,
            room: Room::new(settings.reserve),
            start: clock.start(),
            channels: HashMap::new(),
            flushed: clock.now(),
        })
    }

    /// Begins a log in `folder` under the first of the names `STEM.mcap`, `STEM-2.mcap`, `STEM-3.mcap` and so on that is free; returns
    /// its path too.
    ///
    /// # Errors
    /// [`LogError::File`].
    pub fn create_numbered(
        folder: &Path,
        stem: &str,
        clock: &dyn Clock,
        settings: LogSettings,
    ) -> Result<(Self, PathBuf), LogError> {
        let mut number = 1_u32;
        loop {
            let path = folder.join(match number {
                1 => format!("{stem}.mcap"),
                number => format!("{stem}-{number}.mcap"),
            });
            match Self::create(&path, clock, settings) {
                Err(LogError::File { source, .. })
                    if source.kind() == io::ErrorKind::AlreadyExists =>
                {
                    number += 1;
                }
                log => return Ok((log?, path)),
            }
        }
    }

    /// Logs `record` of a `time` of the clock.
    ///
    /// # Errors
    /// [`LogError`] where the record is none that a log can hold, which costs nothing but the record; [`LogError::Room`] where the
    /// log is to end, as its disk is full but for the reserve; and where it cannot be written, after which nothing is.
    pub fn write(&mut self, time: Duration, record: &LogRecord) -> Result<(), LogError> {
        // 584 years fit.
        let nanoseconds = u64::try_from((self.start + time).as_nanos()).unwrap_or(u64::MAX);
        let encoded = encode(record, nanoseconds, self.settings.colors)?;
        if encoded.bytes.len() as u64 > LONGEST_RECORD / 2 {
            return Err(LogError::Record {
                record: "a message",
                problem: format!("it has {} bytes", encoded.bytes.len()),
            });
        }
        let length = encoded.bytes.len() as u64;
        if let Some([free, reserve]) = self.room.lacks(&self.path, self.settings.chunk, length) {
            return Err(LogError::Room { free, reserve });
        }
        self.put(nanoseconds, encoded)
            .map_err(|source| LogError::Write { source })?;
        if time.saturating_sub(self.flushed) >= self.settings.flush_after {
            self.flush()?;
            self.flushed = time;
        }
        Ok(())
    }

    fn put(&mut self, nanoseconds: u64, encoded: Encoded) -> mcap::McapResult<()> {
        let Encoded {
            topic,
            schema,
            encoding,
            bytes,
        } = encoded;
        let name = topic.name();
        let key = (topic, schema.name);
        let channel = match self.channels.get_mut(&key) {
            Some(channel) => channel,
            None => {
                let (topic, schema_name) = &key;
                let schema =
                    (self.writer).add_schema(schema_name, &schema.encoding, &schema.data)?;
                let metadata = metadata(topic);
                let id = (self.writer).add_channel(schema, &name, encoding, &metadata)?;
                let new = Channel { id, messages: 0 };
                self.channels.entry(key).or_insert(new)
            }
        };
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.messages,
            log_time: nanoseconds,
            publish_time: nanoseconds,
        };
        channel.messages = channel.messages.wrapping_add(1);
        self.writer.write_to_known_channel(&header, &bytes)
    }

    /// Logs where a camera is and how it sees.
    ///
    /// # Errors
    /// Those of [`write`](Self::write).
    pub fn camera(
        &mut self,
        time: Duration,
        serial: &str,
        camera: &Camera,
        depth_to_color: Isometry3<f64>,
    ) -> Result<(), LogError> {
        let calibration = LogRecord::Calibration {
            serial: serial.to_owned(),
            intrinsics: camera.intrinsics,
        };
        self.write(time, &calibration)?;
        let transforms = vec![
            Transform::of_camera(serial, camera.pose),
            Transform::of_depth_sensor(serial, depth_to_color),
        ];
        self.write(time, &LogRecord::Transforms(transforms))
    }

    /// Logs a picture as its colour and its depth image, both of the picture's time.
    ///
    /// # Errors
    /// Those of [`write`](Self::write).
    pub fn frame(&mut self, serial: &str, frame: &Stamped<RgbdFrame>) -> Result<(), LogError> {
        let Stamped { time, value } = frame;
        let (width, height) = (
            value.camera.intrinsics.width,
            value.camera.intrinsics.height,
        );
        let color = LogRecord::Color {
            serial: serial.to_owned(),
            image: Image {
                width,
                height,
                pixels: value.color.clone(),
            },
        };
        self.write(*time, &color)?;
        let depth = LogRecord::Depth {
            serial: serial.to_owned(),
            image: Image {
                width,
                height,
                pixels: value.depth.clone(),
            },
        };
        self.write(*time, &depth)
    }

    /// Writes all that was logged.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn flush(&mut self) -> Result<(), LogError> {
        (self.writer.flush()).map_err(|source| LogError::Write { source })
    }

    /// Ends the log with its summary, and brings it to the disk.
    ///
    /// # Errors
    /// [`LogError`] where that fails: what was written before remains readable.
    pub fn finish(mut self) -> Result<(), LogError> {
        (self.writer.finish()).map_err(|source| LogError::Write { source })?;
        let mut file = self.writer.into_inner().into_inner();
        let synced = file.flush().and_then(|()| file.get_ref().sync_all());
        synced.map_err(|source| LogError::File {
            path: self.path,
            source,
        })
    }
}

fn metadata(topic: &Topic) -> BTreeMap<String, String> {
    let (key, value) = EFFORT;
    match topic {
        Topic::Present | Topic::Goals => BTreeMap::from([(key.to_owned(), value.to_owned())]),
        _ => BTreeMap::new(),
    }
}
