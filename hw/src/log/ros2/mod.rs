//! Logs as bags of ROS 2 (rosbag2): a folder with a file of MCAP, whose messages are those of `sensor_msgs` and its like in CDR, their
//! definitions inside, and `metadata.yaml`.
//!
//! | record | topic | message |
//! |---|---|---|
//! | servos' positions, velocities, currents | `/servos/present`, `/servos/goals` | `sensor_msgs/JointState`; in goals, what was not told is not a number |
//! | command | `/command` | `std_msgs/Float64MultiArray` |
//! | events | `/events` | `rcl_interfaces/Log` |
//! | URDF | `/robot_description` | `std_msgs/String` |
//! | poses of frames | `/tf` | `tf2_msgs/TFMessage` |
//! | cloud | `/cloud` | `sensor_msgs/PointCloud2` |
//! | pictures | `/camera_SERIAL/color/image_raw`, `../depth/image_raw` | `sensor_msgs/Image` |
//! | intrinsics | `/camera_SERIAL/color/camera_info` | `sensor_msgs/CameraInfo` |
//!
//! Servos' temperatures, homes and registers have no message there and are left out, as are messages of others.

mod cdr;
mod definitions;
mod messages;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Compression, WriteOptions, Writer};
use tdcr_base::files::write_atomically;

use super::error::LogError;
use super::message::Entry;
use super::read::LogReader;
use super::record::LogRecord;
use super::recovery::Recovery;
use messages::{Message, message};

/// What a bag holds of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Bag {
    /// Messages of each topic, with their type.
    pub topics: BTreeMap<String, (&'static str, u64)>,
    /// Messages of the log that ROS 2 has no message for.
    pub left_out: u64,
    /// What could be read of the log.
    pub recovery: Recovery,
    /// Times of the first and last message (ns since the Unix epoch).
    span: Option<(u64, u64)>,
}

/// Writes what can be read of the log `from` as the bag `to`, a folder that must not be there.
///
/// # Errors
/// [`LogError`]. Where nothing of the log can be read, `to` is not made; else it is left as far as it was written, without
/// `metadata.yaml`.
pub fn export_rosbag2(from: &Path, to: &Path) -> Result<Bag, LogError> {
    let at = |path: &Path| {
        let path = path.to_owned();
        |source| LogError::File { path, source }
    };
    let mut reader = LogReader::open(from)?;
    let mut next = reader.next_entry().map_err(at(from))?;
    if next.is_none() {
        reader.recovery().require_readable(from)?;
    }
    std::fs::create_dir(to).map_err(at(to))?;
    let stem = to.file_name().unwrap_or_default().to_string_lossy();
    let name = format!("{stem}_0.mcap");
    let path = to.join(&name);
    let file = File::create_new(&path).map_err(at(&path))?;
    let write = |source| LogError::Write { source };
    let mut writer = WriteOptions::new()
        .profile("ros2")
        .compression(Some(Compression::Zstd))
        .compression_level(1)
        .compression_threads(0)
        .library(concat!("tdcr ", env!("CARGO_PKG_VERSION")))
        .disable_seeking(true)
        .create(NoSeek::new(BufWriter::new(file)))
        .map_err(write)?;
    let mut bag = Bag {
        topics: BTreeMap::new(),
        left_out: 0,
        recovery: reader.recovery().clone(),
        span: None,
    };
    while let Some(entry) = next {
        next = reader.next_entry().map_err(at(from))?;
        let Entry::Message(found) = entry else {
            continue;
        };
        // A damaged message is as one of others.
        let record = LogRecord::decode(&found.channel, &found.data)
            .ok()
            .flatten();
        match record.and_then(|record| message(&record, found.log_time)) {
            None => bag.left_out += 1,
            Some(message) => bag
                .put(&mut writer, found.log_time, message)
                .map_err(write)?,
        }
    }
    reader.recovery().require_readable(from)?;
    bag.recovery = reader.recovery().clone();
    writer.finish().map_err(write)?;
    let mut file = writer.into_inner().into_inner();
    let synced = file.flush().and_then(|()| file.get_ref().sync_all());
    synced.map_err(at(&path))?;
    let metadata = to.join("metadata.yaml");
    let text = bag.metadata(&name);
    write_atomically(&metadata, |file| file.write_all(text.as_bytes())).map_err(at(&metadata))?;
    Ok(bag)
}

impl Bag {
    fn put(
        &mut self,
        writer: &mut Writer<NoSeek<BufWriter<File>>>,
        time: u64,
        message: Message,
    ) -> mcap::McapResult<()> {
        let definition = message.definition;
        let schema = writer.add_schema(definition.name, "ros2msg", definition.text.as_bytes())?;
        let channel_id = writer.add_channel(schema, &message.topic, "cdr", &BTreeMap::new())?;
        let (_, count) = (self.topics.entry(message.topic)).or_insert((definition.name, 0));
        let header = MessageHeader {
            channel_id,
            sequence: *count as u32,
            log_time: time,
            publish_time: time,
        };
        *count += 1;
        let (first, last) = self.span.unwrap_or((time, time));
        self.span = Some((first.min(time), last.max(time)));
        writer.write_to_known_channel(&header, &message.bytes)
    }

    /// Messages of all topics.
    pub fn messages(&self) -> u64 {
        self.topics.values().map(|(_, count)| count).sum()
    }

    /// `metadata.yaml` of version 5, which Humble and all later ones read.
    fn metadata(&self, file: &str) -> String {
        let (first, last) = self.span.unwrap_or_default();
        let (duration, messages) = (last - first, self.messages());
        // JSON's texts are YAML's.
        let quoted = |text: &str| serde_json::Value::from(text).to_string();
        let topics: String = (self.topics.iter())
            .map(|(topic, (kind, count))| {
                format!(
                    "    - topic_metadata:\n        name: {topic}\n        type: {kind}\n        serialization_format: cdr\n        \
                     offered_qos_profiles: \"\"\n      message_count: {count}\n"
                )
            })
            .collect();
        let list = match topics.is_empty() {
            true => " []\n".to_owned(),
            false => format!("\n{topics}"),
        };
        let file = quoted(file);
        format!(
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {duration}\n  \
             starting_time:\n    nanoseconds_since_epoch: {first}\n  message_count: {messages}\n  topics_with_message_count:{list}  \
             compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {file}\n  files:\n    - path: {file}\n      \
             starting_time:\n        nanoseconds_since_epoch: {first}\n      duration:\n        nanoseconds: {duration}\n      \
             message_count: {messages}\n"
        )
    }
}
