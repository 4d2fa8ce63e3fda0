//! The clouds of a log, with what was commanded before each.

use std::path::Path;

use tdcr_sim::cloud::PointCloud;

use super::stream::{RecordedError, Stream};
use crate::log::{LogRecord, Topic};

/// A cloud of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedCloud {
    /// The sample of a capture that it is; none for other clouds, such as looks at the robot at home.
    pub sample: Option<u64>,
    /// What was last asked of the tendons (m, or N for a tension); of a sample, what its servos stood at.
    pub command: Vec<f64>,
    /// The cloud, world frame (m).
    pub cloud: PointCloud,
}

/// The clouds of a log in their order; those before the first command are left out.
///
/// Of a sample that was captured again after a fault, each attempt that came to its end is given.
pub struct LoggedClouds {
    stream: Stream,
    command: Option<Vec<f64>>,
    sample: Option<u64>,
}

impl LoggedClouds {
    /// The clouds of the log at `path`.
    ///
    /// # Errors
    /// [`RecordedError`] where the log cannot be read.
    pub fn open(path: &Path) -> Result<Self, RecordedError> {
        Ok(Self {
            stream: Stream::open(path)?,
            command: None,
            sample: None,
        })
    }

    /// The next cloud; none after the last.
    ///
    /// # Errors
    /// [`RecordedError`] where the log cannot be read on.
    pub fn next_cloud(&mut self) -> Result<Option<LoggedCloud>, RecordedError> {
        let of_clouds = |topic: &Topic| {
            let topics = [Topic::Command, Topic::Events, Topic::Cloud];
            topics.contains(topic)
        };
        while let Some((_, record)) = self.stream.next(of_clouds)? {
            match record {
                LogRecord::Command(values) => self.command = Some(values),
                // The word of a sample comes right before its cloud.
                LogRecord::Event(event) => self.sample = event.sample(),
                LogRecord::Cloud(cloud) => {
                    let sample = self.sample.take();
                    if let Some(command) = self.command.clone() {
                        return Ok(Some(LoggedCloud {
                            sample,
                            command,
                            cloud,
                        }));
                    }
                }
                _ => {}
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::time::Duration;

    use super::*;
    use crate::clock::VirtualClock;
    use crate::log::{Event, Level, LogSettings, LogWriter};

    #[test]
    fn a_cloud_is_that_of_the_last_command_and_of_the_sample_named_before_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        let mut log =
            LogWriter::create(&path, &VirtualClock::new(), LogSettings::default()).unwrap();
        let cloud = |x: f32| PointCloud {
            points: vec![[x, 0.0, 0.0]],
            colors: vec![[0; 3]],
        };
        let event = |text: String| {
            let (level, source) = (Level::Info, "rig".to_owned());
            LogRecord::Event(Event {
                level,
                source,
                text,
            })
        };
        let records = [
            LogRecord::Cloud(cloud(0.0)),
            LogRecord::Command(vec![0.1]),
            LogRecord::Command(vec![0.2]),
            event(Event::sample_text(3)),
            LogRecord::Cloud(cloud(1.0)),
            event("a look at home".to_owned()),
            LogRecord::Cloud(cloud(2.0)),
        ];
        for (time, record) in (0..).zip(&records) {
            log.write(Duration::from_secs(time), record).unwrap();
        }
        log.finish().unwrap();
        let mut clouds = LoggedClouds::open(&path).unwrap();
        let mut found = Vec::new();
        while let Some(next) = clouds.next_cloud().unwrap() {
            found.push((next.sample, next.command[0], next.cloud.points[0][0]));
        }
        assert_eq!(found, [(Some(3), 0.2, 1.0), (None, 0.2, 2.0)]);
    }
}
