//! A run as a log for Foxglove.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::time::Duration;

use nalgebra::{Isometry3, Vector3};
use tdcr_control::tracking::Tracking;
use tdcr_hw::clock::VirtualClock;
use tdcr_hw::log::{Event, Level, LogError, LogRecord, LogSettings, LogWriter, Transform, WORLD};

/// Writes a run as an MCAP log, in place of one that is there: the frames `target` and `tip` in the world, commands, and what went wrong. Its
/// times count from the run's first period, that of the approach.
///
/// # Errors
/// [`LogError`] where it cannot be written.
pub fn write_log(path: &Path, run: &Tracking) -> Result<(), LogError> {
    let of_file = |source| LogError::File {
        path: path.to_owned(),
        source,
    };
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(of_file(error)),
        _ => {}
    }
    let mut log = LogWriter::create(path, &VirtualClock::new(), LogSettings::default())?;
    let first = run.rows.first().map_or(0.0, |row| row.time);
    let at = |time: f64| Duration::from_secs_f64((time - first).max(0.0));
    let mut incidents = run.incidents.iter().peekable();
    for row in &run.rows {
        let frame = |child: &str, place: Vector3<f64>| Transform {
            parent: WORLD.to_owned(),
            child: child.to_owned(),
            pose: Isometry3::translation(place.x, place.y, place.z),
        };
        let mut frames = vec![frame("target", row.target)];
        frames.extend(row.tip.map(|tip| frame("tip", tip)));
        log.write(at(row.time), &LogRecord::Transforms(frames))?;
        log.write(at(row.time), &LogRecord::Command(row.command.clone()))?;
        while let Some(incident) = incidents.next_if(|incident| incident.time <= row.time) {
            let event = Event {
                level: match incident.is_end {
                    true => Level::Error,
                    false => Level::Warning,
                },
                source: run.controller.to_owned(),
                text: incident.reason.clone(),
            };
            log.write(at(row.time), &LogRecord::Event(event))?;
        }
    }
    log.finish()
}
