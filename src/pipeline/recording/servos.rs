//! Which servo of a recording pulls which tendon.

use std::path::Path;

use serde::Serialize;
use tdcr_sim::inverse::recording::{RecordingError, ServoMap, find_servo_map};
use tdcr_sim::robot::RobotSpec;

use super::{CalibrateError, Columns, RecordingFile};

/// Single pulls that the column map explains this many times worse than another order of servos make one doubt it.
const AMBIGUOUS: f64 = 3.0;
/// An order of servos with at most this misfit, a share of the single pulls' motion, of squares, is taken for the right one.
const SURE: f64 = 0.25;

/// The servo of a tendon, as it was found.
#[derive(Clone, Debug, Serialize)]
pub struct FoundServo {
    /// Tendon, by its number in a command.
    pub tendon: usize,
    /// Column of the servo.
    pub column: String,
    /// 1 where positive values pull, -1 where they let go.
    pub sign: f64,
    /// Share of the markers' motion that the robot misses when the servo moves alone, of squares.
    pub misfit: f64,
}

/// What was found of servos.
#[derive(Clone, Debug, Serialize)]
pub struct FoundServos {
    /// Of each tendon.
    pub servos: Vec<FoundServo>,
    /// Turn of the recording's frame about the robot's base (rad).
    #[serde(rename = "turn")]
    pub rotation: f64,
}

/// The columns with the servos as `train`, the recording `path`, tells them when they move alone.
pub(super) fn find(
    robot: &RobotSpec,
    columns: &Columns,
    train: &RecordingFile,
    path: &Path,
) -> Result<(Columns, FoundServos), CalibrateError> {
    let map = find_servo_map(robot, &columns.transmission(robot), &train.recording);
    let map = map.map_err(|error| match error {
        RecordingError::NeverAlone { servos } => CalibrateError::NeverAlone {
            columns: (servos.iter())
                .map(|&servo| columns.servos[servo].column.clone())
                .collect(),
        },
        source => CalibrateError::Recording {
            path: path.to_owned(),
            source,
        },
    })?;
    Ok(by(&map, robot, columns))
}

/// The columns with the servos of `map`.
fn by(map: &ServoMap, robot: &RobotSpec, columns: &Columns) -> (Columns, FoundServos) {
    let mapped = columns.mapped(map, robot);
    let found = (0..).zip(mapped.servos.iter().zip(&map.servos));
    let found = found.map(|(tendon, (column, servo))| FoundServo {
        tendon,
        column: column.column.clone(),
        sign: column.sign,
        misfit: servo.misfit,
    });
    let found = FoundServos {
        servos: found.collect(),
        rotation: map.rotation,
    };
    (mapped, found)
}

/// Another order of servos than that of the columns.
pub(super) struct Ambiguity {
    pub found: (Columns, FoundServos),
    /// Whether it is as good as it should be if it is the right one.
    pub sure: bool,
}

/// The order of servos by which the markers move when servos move alone, where that is clearly not the columns'.
pub(super) fn ambiguity(
    robot: &RobotSpec,
    columns: &Columns,
    train: &RecordingFile,
) -> Option<Ambiguity> {
    // Where servos never move alone there is nothing to tell it by.
    let map = find_servo_map(robot, &columns.transmission(robot), &train.recording).ok()?;
    (!map.is_identity() && map.misfit_as_given > AMBIGUOUS * map.misfit()).then(|| Ambiguity {
        sure: map.misfit() < SURE,
        found: by(&map, robot, columns),
    })
}
