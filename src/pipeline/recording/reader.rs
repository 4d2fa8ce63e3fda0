//! Recordings of whatever kind, read from where they are.

use std::path::Path;

use tdcr_learn::data::Split;
use tdcr_sim::robot::{Robot, RobotSpec};

use super::clouds::Source;
use super::{BadRows, Columns, RecordingFile, RecordingFileError, bad_row_count};

/// The columns of a recording that needs no map.
pub(super) fn own_columns(robot: &RobotSpec, data: &Path) -> Result<Columns, RecordingFileError> {
    if Source::of(data).has_clouds() {
        return Ok(Columns::of_commands(robot));
    }
    let path = data.to_owned();
    Err(match data.metadata() {
        Err(source) => RecordingFileError::Read { path, source },
        Ok(_) => RecordingFileError::Columns {
            path,
            reason: "it is a table, which needs a column map; only the folder of a data set and the log of a rig (.mcap) need none".to_owned(),
        },
    })
}

/// Whether two paths lead to one file.
pub(super) fn same(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => one == other,
    }
}

/// Reads recordings of a robot.
pub(super) struct Reader<'a> {
    pub robot: &'a Robot,
    pub bad_rows: BadRows,
}

impl Reader<'_> {
    /// The recording at `path`, of a data set the `splits`; notes what was left out.
    pub fn load(
        &self,
        path: &Path,
        columns: &Columns,
        splits: &[Split],
        notes: &mut Vec<String>,
    ) -> Result<RecordingFile, RecordingFileError> {
        let frame = columns.pose();
        let mut file = match Source::of(path) {
            Source::Table => RecordingFile::load(path, columns)?,
            Source::DataSet => RecordingFile::of_data_set(path, splits, self.robot, frame)?,
            Source::Log => RecordingFile::of_log(path, self.robot, frame)?,
        };
        file.take_out_wild(columns, self.robot);
        file.refuse_bad(path, self.bad_rows == BadRows::LeftOut)?;
        if !file.bad.is_empty() {
            let lines: Vec<String> = (file.bad.iter())
                .map(|bad| format!("line {}: {}", bad.line, bad.reason))
                .collect();
            notes.push(format!(
                "{}: {} left out; {}",
                path.display(),
                bad_row_count(lines.len()),
                lines.join("; ")
            ));
        }
        Ok(file)
    }
}
