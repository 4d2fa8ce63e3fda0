//! Logs of what a rig did: MCAP files (<https://mcap.dev>) with the message schemas of Foxglove, which viewers and the
//! libraries of many languages read.
//!
//! A [`LogWriter`] takes [`LogRecord`]s and their times. What is on the disk is at any time the start of the finished file,
//! so a log of a process that was killed lacks only its end. A [`LogReader`] reads logs whole or not, up to their last whole
//! message and beyond damaged parts, and says what was missing; [`repair`] writes a whole log of what it finds.
//! Chunks are compressed by zstd unless [`LogSettings`] say otherwise; those that are plain or compressed by lz4 are read too.
//!
//! | topic | schema | record |
//! |---|---|---|
//! | `/servos/present` | `foxglove.JointStates` | positions (rad), velocities (rad/s), as `effort` the currents (A) |
//! | `/servos/goals` | `foxglove.JointStates` | positions, as `effort` currents (A) |
//! | `/servos/status` | `tdcr.ServoStatus` (JSON) | models, modes, temperatures, voltages, faults |
//! | `/servos/homes` | `tdcr.Homes` (JSON) | where home is, in servos' own counts |
//! | `/servos/registers` | `tdcr.Registers` (JSON) | bytes of control tables |
//! | `/command` | `tdcr.Command` (JSON) | a value per tendon (m or N): what was asked for, and right before a sample's cloud what was measured |
//! | `/events` | `foxglove.Log` | what happened, in words |
//! | `/robot_description` | `std_msgs/String` (JSON) | the robot as URDF |
//! | `/tf` | `foxglove.FrameTransforms` | cameras in the world, discs on those below them |
//! | `/cloud` | `foxglove.PointCloud` | the fused cloud, world frame (m) |
//! | `/cameras/SERIAL/calibration` | `foxglove.CameraCalibration` | intrinsics |
//! | `/cameras/SERIAL/color` | `foxglove.CompressedImage` or `RawImage` | PNG, or `rgb8` |
//! | `/cameras/SERIAL/depth` | `foxglove.RawImage` | `16UC1` (mm) where that is exact, else `32FC1` (m) |
//!
//! [`servo_sink`] logs what a bus of servos is told and says.
//!
//! Joints are named `servo_ID`. All comes back as it was, bit for bit; a lens whose distortion is nothing comes back as a
//! pinhole.
//!
//! ```
//! use std::time::Duration;
//! use tdcr_hw::clock::VirtualClock;
//! use tdcr_hw::log::{Entry, LogReader, LogRecord, LogSettings, LogWriter};
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("run.mcap");
//! let mut log = LogWriter::create(&path, &VirtualClock::new(), LogSettings::default())?;
//! log.write(Duration::from_millis(20), &LogRecord::Command(vec![0.01, 0.02, 0.015]))?;
//! log.finish()?;
//!
//! let mut reader = LogReader::open(&path)?;
//! while let Some(entry) = reader.next_entry()? {
//!     let Entry::Message(message) = entry else { continue };
//!     let record = LogRecord::decode(&message.channel, &message.data)?;
//!     assert!(matches!(record, Some(LogRecord::Command(values)) if values == [0.01, 0.02, 0.015]));
//!     assert_eq!(message.log_time, 20_000_000);
//! }
//! assert!(reader.recovery().is_whole());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod compression;
mod container;
mod contents;
mod decode;
mod definitions;
mod encode;
mod error;
mod image;
mod json;
mod message;
mod read;
mod record;
mod recovery;
mod repair;
mod resync;
mod room;
mod ros2;
mod servos;
mod shared;
mod topic;
mod write;

pub use contents::{Contents, TopicContents};
pub(crate) use decode::color_png;
pub use error::{DecodeError, LogError};
pub use image::ImageFormat;
pub use message::{Channel, Entry, Message, Schema};
pub use read::{LogReader, Place};
pub use record::{
    Event, Goal, Image, Level, LogRecord, Reading, ServoHome, ServoStatus, Transform, WORLD,
    camera_frame,
};
pub use recovery::{Damage, Problem, Recovery};
pub use repair::repair;
pub use room::free_space;
pub use ros2::{Bag, export_rosbag2};
pub use servos::servo_sink;
pub use shared::SharedLog;
pub(crate) use shared::finish_all;
pub use topic::Topic;
pub use write::{ChunkFormat, LogSettings, LogWriter};
