//! The pictures of a capture's samples.

use std::path::Path;
use std::time::Duration;

use super::stream::{RecordedError, Stream};
use crate::log::{LogRecord, Message, Topic, color_png};

/// What the cameras showed when a sample was captured.
#[derive(Clone, Debug, PartialEq)]
pub struct SamplePictures {
    /// The sample's number.
    pub sample: u64,
    /// Colours of each camera as a PNG file of 8-bit RGB, in the order of the rig's file; none where the log has lost them.
    pub colors: Vec<Option<Vec<u8>>>,
}

/// The samples of a capture's log, in the order in which they were captured.
///
/// A sample's pictures are those from which its cloud was made: the last that each camera gave before. Of a sample that was
/// captured again after a fault, each attempt that came to its end is given.
pub struct Samples {
    stream: Stream,
    /// Serial numbers in the order of the rig's file, as the log names cameras before anything else.
    serials: Vec<String>,
    /// The last picture of each, as the log has it: most are of no sample, and are not looked at.
    last: Vec<Option<(Duration, Message)>>,
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
        while let Some((time, message)) = self.stream.next_message(of_samples)? {
            if let Some(Topic::Color(serial)) = Topic::parse(&message.channel.topic) {
                let view = self.view(serial);
                self.last[view] = Some((time, message));
                continue;
            }
            let bad = |source| RecordedError::Message { time, source };
            match LogRecord::decode(&message.channel, &message.data).map_err(bad)? {
                Some(LogRecord::Calibration { serial, .. }) => {
                    self.view(serial);
                }
                Some(LogRecord::Event(event)) => {
                    if let Some(sample) = event.sample() {
                        // What is shown again is logged again.
                        let last = self.last.iter_mut().map(Option::take);
                        let colors = last.map(|last| last.map(png).transpose());
                        let colors = colors.collect::<Result<_, _>>()?;
                        return Ok(Some(SamplePictures { sample, colors }));
                    }
                }
                _ => {}
            }
        }
        Ok(None)
    }
}

/// The PNG file of a picture.
fn png((time, message): (Duration, Message)) -> Result<Vec<u8>, RecordedError> {
    color_png(&message.channel, &message.data)
        .map_err(|source| RecordedError::Message { time, source })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use tdcr_sim::camera::Intrinsics;

    use super::*;
    use crate::clock::VirtualClock;
    use crate::log::{Event, Image, ImageFormat, Level, LogSettings, LogWriter};

    /// The last byte of a picture in a PNG file.
    fn last_byte(file: &[u8]) -> u8 {
        let mut reader = png::Decoder::new(std::io::Cursor::new(file))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels[pixels.len() - 1]
    }

    #[test]
    fn a_samples_pictures_are_the_last_before_it() {
        for colors in [ImageFormat::Png, ImageFormat::Raw] {
            pictures_of(LogSettings {
                colors,
                ..LogSettings::default()
            });
        }
    }

    fn pictures_of(settings: LogSettings) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        let mut log = LogWriter::create(&path, &VirtualClock::new(), settings).unwrap();
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
            let greys = colors.iter().map(|c| c.as_deref().map(last_byte));
            found.push((sample, greys.collect::<Vec<_>>()));
        }
        assert_eq!(
            found,
            [(7, vec![Some(4), Some(3)]), (8, vec![Some(5), None])]
        );
    }
}
