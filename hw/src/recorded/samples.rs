//! The pictures of a capture's samples.

use std::path::Path;

use super::stream::{RecordedError, Stream};
use crate::log::{Image, LogRecord, Topic};

/// What the cameras showed when a sample was captured.
#[derive(Clone, Debug, PartialEq)]
pub struct SamplePictures {
    /// The sample's number.
    pub sample: u64,
    /// Colours (8-bit RGB) of each camera, in the order of the rig's file; none where the log has lost them.
    pub colors: Vec<Option<Image<[u8; 3]>>>,
}

/// The samples of a capture's log, in the order in which they were captured.
///
/// A sample's pictures are those from which its cloud was made: the last that each camera gave before. Of a sample that was
/// captured again after a fault, each attempt that came to its end is given.
pub struct Samples {
    stream: Stream,
    /// Serial numbers in the order of the rig's file, as the log names cameras before anything else.
    serials: Vec<String>,
    last: Vec<Option<Image<[u8; 3]>>>,
}

impl Samples {
    /// The samples of the log at `path`.
    ///
    /// # Errors
    /// [`RecordedError`] where the log cannot be read.
    pub fn open(path: &Path) -> Result<Self, RecordedError> {
        Ok(Self {
            stream: Stream::open(path)?,
            serials: Vec::new(),
            last: Vec::new(),
        })
    }

    /// The number of a camera.
    fn view(&mut self, serial: String) -> usize {
        let known = self.serials.iter().position(|known| *known == serial);
        known.unwrap_or_else(|| {
            self.serials.push(serial);
            self.last.push(None);
            self.last.len() - 1
        })
    }

    /// The next sample; none after the last.
    ///
    /// # Errors
    /// [`RecordedError`] where the log cannot be read on.
    pub fn next_sample(&mut self) -> Result<Option<SamplePictures>, RecordedError> {
        let of_samples = |topic: &Topic| {
            matches!(
                topic,
                Topic::Calibration(_) | Topic::Color(_) | Topic::Events
            )
        };
        while let Some((_, record)) = self.stream.next(of_samples)? {
            match record {
                LogRecord::Calibration { serial, .. } => {
                    self.view(serial);
                }
                LogRecord::Color { serial, image } => {
                    let view = self.view(serial);
                    self.last[view] = Some(image);
                }
                LogRecord::Event(event) => {
                    if let Some(sample) = event.sample() {
                        // What is shown again is logged again.
                        let colors = self.last.iter_mut().map(Option::take).collect();
                        return Ok(Some(SamplePictures { sample, colors }));
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

    use tdcr_sim::camera::Intrinsics;

    use super::*;
    use crate::clock::VirtualClock;
    use crate::log::{Event, Level, LogSettings, LogWriter};

    #[test]
    fn a_samples_pictures_are_the_last_before_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        let mut log =
            LogWriter::create(&path, &VirtualClock::new(), LogSettings::default()).unwrap();
        let calibration = |serial: &str| LogRecord::Calibration {
            serial: serial.to_owned(),
            intrinsics: Intrinsics::from_fovy(2, 1, 1.0),
        };
        let color = |serial: &str, grey: u8| LogRecord::Color {
            serial: serial.to_owned(),
            image: Image {
                width: 2,
                height: 1,
                pixels: vec![[grey; 3]; 2],
            },
        };
        let event = |text: String| {
            let (level, source) = (Level::Info, "rig".to_owned());
            LogRecord::Event(Event {
                level,
                source,
                text,
            })
        };
        // The second camera is the first to show something, and later once nothing.
        let records = [
            calibration("west"),
            calibration("east"),
            color("east", 1),
            color("west", 2),
            color("east", 3),
            event("a look at home".to_owned()),
            color("west", 4),
            event(Event::sample_text(7)),
            color("west", 5),
            event(Event::sample_text(8)),
        ];
        for (time, record) in (0..).map(Duration::from_millis).zip(&records) {
            log.write(time, record).unwrap();
        }
        log.finish().unwrap();
        let mut samples = Samples::open(&path).unwrap();
        let mut found = Vec::new();
        while let Some(SamplePictures { sample, colors }) = samples.next_sample().unwrap() {
            let greys = colors.iter().map(|c| c.as_ref().map(|c| c.pixels[1][0]));
            found.push((sample, greys.collect::<Vec<_>>()));
        }
        assert_eq!(
            found,
            [(7, vec![Some(4), Some(3)]), (8, vec![Some(5), None])]
        );
    }
}
