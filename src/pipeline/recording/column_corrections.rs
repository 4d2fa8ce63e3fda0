//! Column maps as a recording contradicts them: servos of other tendons, a frame elsewhere.

use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};
use serde::Serialize;
use tdcr_learn::data::Split;
use tdcr_sim::inverse::recording::{Replay, find_frame};
use tdcr_sim::robot::{Robot, RobotSpec};

use super::clouds::Source;
use super::fitted::Fitted;
use super::reader::Reader;
use super::servos::{self, FoundServos};
use super::{CalibrateError, Columns, RecordingFile};

/// A frame that is rotated by less (rad) is one that the base's pose fits.
const TURNED: f64 = 0.4;
/// Of the markers' residuals such a rotation leaves at most this share.
const LEFT: f64 = 0.5;
/// A frame that is shifted by less of the robot's length is one that the base's pose fits.
const SHIFTED: f64 = 0.3;

/// How a recording's frame was moved before the fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MovedFrame {
    /// Angle that it was rotated by (rad).
    #[serde(rename = "turn")]
    pub rotation: f64,
    /// Distance that the middle of the markers' positions was moved by (m).
    pub shift: f64,
}

/// A recording by its column map, or by what it contradicts of it.
pub(super) struct Corrected {
    pub file: RecordingFile,
    pub columns: Columns,
    pub servo_map: Option<FoundServos>,
    pub frame: Option<MovedFrame>,
}

impl Corrected {
    /// The recording `data` of `robot` by `columns`, changed as `fitted` asks.
    pub fn read(
        robot: &RobotSpec,
        columns: Columns,
        data: &Path,
        reader: &Reader<'_>,
        fitted: &Fitted,
        notes: &mut Vec<String>,
    ) -> Result<Self, CalibrateError> {
        let splits = &[Split::Train];
        let mut corrected = Self {
            file: reader.load(data, &columns, splits, notes)?,
            columns,
            servo_map: None,
            frame: None,
        };
        if Source::of(data).has_clouds() {
            return match fitted.servo_map {
                true => Err(CalibrateError::NoMarkers {
                    path: data.to_owned(),
                }),
                false => Ok(corrected),
            };
        }
        // What was left out is noted once.
        let again = |columns: &Columns| reader.load(data, columns, splits, &mut Vec::new());
        let found = match fitted.servo_map {
            true => Some(servos::find(
                robot,
                &corrected.columns,
                &corrected.file,
                data,
            )?),
            false => {
                let ambiguity = servos::ambiguity(robot, &corrected.columns, &corrected.file);
                let taken =
                    fitted.defaults && ambiguity.as_ref().is_some_and(|ambiguity| ambiguity.sure);
                if ambiguity.is_some() {
                    let then = match taken {
                        true => "they are taken so",
                        false => "servo_map among what is fitted finds which",
                    };
                    notes.push(format!(
                        "when servos move alone, the robot moves as if they pulled other tendons, or the other way round, than the columns \
                         say; {then}"
                    ));
                }
                ambiguity.filter(|_| taken).map(|ambiguity| ambiguity.found)
            }
        };
        if let Some((columns, servo_map)) = found {
            corrected.file = again(&columns)?;
            (corrected.columns, corrected.servo_map) = (columns, Some(servo_map));
        }
        if fitted.defaults
            && let Some((pose, frame)) = corrected.elsewhere(robot, reader.robot)
        {
            notes.push(format!(
                "the recording's frame lies turned by {:.0} degrees and {:.0} mm away from where the columns and the robot's base say; it is \
                 taken so",
                frame.rotation.to_degrees(),
                1e3 * frame.shift
            ));
            corrected.columns = corrected.columns.moved(&pose);
            corrected.file = again(&corrected.columns)?;
            corrected.frame = Some(frame);
        }
        Ok(corrected)
    }

    /// Where the recording's frame is instead, if that is far from where it is said to be.
    fn elsewhere(&self, robot: &RobotSpec, built: &Robot) -> Option<(Isometry3<f64>, MovedFrame)> {
        let length = *built.arc_lengths().last()?;
        let recording = &self.file.recording;
        let replay = Replay::new(robot, &self.columns.transmission(robot), recording).ok()?;
        let found = find_frame(&replay, recording)?;
        let measured: Vec<_> = recording.points.iter().flatten().flatten().collect();
        let middle = measured.iter().copied().sum::<Vector3<f64>>() / measured.len() as f64;
        let moved = (found.pose * Point3::from(middle)).coords - middle;
        let turn = found.pose.rotation.angle();
        let (turned, shifted) = (
            turn > TURNED && found.rmse_after < LEFT * found.rmse_before,
            moved.norm() > SHIFTED * length,
        );
        let pose = match (turned, shifted) {
            (true, _) => found.pose,
            (false, true) => Isometry3::translation(moved.x, moved.y, moved.z),
            (false, false) => return None,
        };
        let frame = MovedFrame {
            rotation: pose.rotation.angle(),
            shift: moved.norm(),
        };
        Some((pose, frame))
    }
}
