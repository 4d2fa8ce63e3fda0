//! Calibration on a recording: what a robot did, in the order of time, under what its servos reported.
//!
//! A recording differs from the observations of [`calibration`](super::calibration) in what lies between it and the robot: servos
//! that start anywhere ([`Servo::offset`]), backlash, a lag, markers somewhere on the discs, a base somewhere in the world. Those
//! are unknowns as well as the robot's own, in [`Group`]s that are chosen by name.
//!
//! What was measured are markers, or points of the robot's surface: a [cloud](Recording::clouds) in each row, whose residuals are
//! their distances from it. Clouds of data sets are of a robot [at rest](Order::AtRest).
//!
//! The fit minimises the pseudo-Huber loss of the residuals of markers and points, and the squares of the unknowns' distances from what the
//! robot file says, in units of prior standard deviations: a maximum a posteriori estimate (Bishop, Pattern Recognition and Machine
//! Learning, 2006, ch. 3.3). Residuals of neighbouring rows are correlated, because what the model lacks changes as slowly as the
//! robot moves. So a first fit says how large they are and over how many rows they are correlated (their integrated
//! autocorrelation: Sokal, Monte Carlo Methods in Statistical Mechanics, 1997, ch. 3), and the second fit counts so many rows
//! as one: the priors then keep what the recording does not make identifiable, and intervals are as wide as they should be. Residuals of the markers of one row
//! are correlated too, and count as one; so do all points of one cloud, together as one marker.
//!
//! Derivatives are those of the equilibria by the implicit function theorem, with the model taken as linear over a ten
//! thousandth of a prior's standard deviation; those by the servos' backlash, whose play operator has kinks, and by the lag are
//! differences of commands over that step. Without friction each row is an equilibrium by itself, and only the servos' backlash depends on the path. With friction
//! in the holes ([`Group::Friction`], or in the robot file) rows are those of a [path](crate::tendon_friction), along which
//! derivatives are carried; the first fit leaves it out.

mod cloud;
mod error;
mod explicit;
mod facts;
mod fit;
mod frame;
mod group;
mod interval;
mod numbers;
mod path;
mod places;
mod problem;
mod replay;
mod servo_map;
mod table;
#[cfg(test)]
mod tests;
mod transmission;
mod unknowns;

pub use cloud::{Shown, Surface, Touch};
pub use error::RecordingError;
pub use fit::{Progress, RecordingFit, RecordingSettings, fit_recording};
pub use frame::{FoundFrame, find_frame};
pub use group::Group;
pub use interval::{Correlation, FittedUnknown};
pub use replay::{Replay, Residuals};
pub use servo_map::{MappedServo, ServoMap, find_servo_map};
pub use transmission::{Marker, Order, Recording, Servo, Transmission};

use crate::robot::RobotSpec;

/// The robot with a route of its own for each tendon, and commands of any size: ranges are for users, not for what happened.
fn without_ranges(spec: &RobotSpec) -> Result<RobotSpec, RecordingError> {
    let mut spec = explicit::Explicit::new(spec)?.spec;
    for route in &mut spec.routes {
        route.tendon.range = [0.0, 1e6];
    }
    Ok(spec)
}

/// Refuses a recording or a transmission of another robot.
fn check(
    spec: &RobotSpec,
    transmission: &Transmission,
    recording: &Recording,
) -> Result<(), RecordingError> {
    let count = |what: String, found: usize, expected: usize| match found == expected {
        true => Ok(()),
        false => Err(RecordingError::Count {
            what,
            found,
            expected,
        }),
    };
    let (tendons, discs) = (spec.tendon_count(), spec.disc_count());
    count(
        "servos of the transmission".into(),
        transmission.servos.len(),
        tendons,
    )?;
    for (marker, at) in transmission.markers.iter().enumerate() {
        if at.disc >= discs {
            let last = discs.saturating_sub(1);
            return Err(RecordingError::Marker {
                marker,
                disc: at.disc,
                last,
            });
        }
    }
    let rows = recording.len();
    if !recording.clouds.is_empty() {
        count("rows of clouds".into(), recording.clouds.len(), rows)?;
    }
    if !recording.payloads.is_empty() {
        count("rows of payloads".into(), recording.payloads.len(), rows)?;
    }
    count("rows of pulls".into(), recording.pulls.len(), rows)?;
    count("rows of points".into(), recording.points.len(), rows)?;
    for row in 0..rows {
        count(
            format!("pulls of row {row}"),
            recording.pulls[row].len(),
            tendons,
        )?;
        count(
            format!("points of row {row}"),
            recording.points[row].len(),
            transmission.markers.len(),
        )?;
        let points = recording.points[row].iter().flatten();
        let numbers = points.chain(recording.cloud(row)).flatten();
        if numbers
            .chain(&recording.pulls[row])
            .chain([&recording.times[row]])
            .any(|x| !x.is_finite())
        {
            return Err(RecordingError::Row {
                row,
                reason: "a number is not finite",
            });
        }
        let mass = recording.payloads.get(row).copied().unwrap_or(0.0);
        if !(mass >= 0.0 && mass.is_finite()) {
            return Err(RecordingError::Row {
                row,
                reason: "its payload is no mass: expected 0 kg or above",
            });
        }
        if row > 0 && recording.times[row] < recording.times[row - 1] {
            return Err(RecordingError::Row {
                row,
                reason: "it is earlier than the row before",
            });
        }
    }
    Ok(())
}
