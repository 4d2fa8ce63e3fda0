//! From a finished table to everything else in the folder.

use std::io::Write;
use std::path::Path;

use tdcr_base::files::write_atomically;

use crate::pipeline::Monitor;
use crate::study::error::StudyError;
use crate::study::figures::page;
use crate::study::outputs::columns::{SETTLED, STATUS, places};
use crate::study::outputs::record::{RECORD, ROWS, Record};
use crate::study::outputs::table::Table;
use crate::study::outputs::{parquet_file, summary};
use crate::study::spec::cases::Cases;

/// Writes the table as Parquet, the summary, the report and the record, which is last: a folder with it is whole. Of a part,
/// the record alone. Returns how many rows settled.
pub(super) fn finish(
    cases: &Cases,
    dir: &Path,
    mut record: Record,
    monitor: &dyn Monitor,
) -> Result<usize, StudyError> {
    record.settled = settled(&Table::new(dir, &record))?;
    if record.part.is_none() {
        let table = Table::new(dir, &record);
        monitor.status("writing table.parquet");
        parquet_file::write(&dir.join("table.parquet"), &table)?;
        monitor.status("writing the summary");
        summary::write(cases, &record, &table, dir)?;
        monitor.status("drawing the report");
        page::write(cases, &record, &table, dir)?;
    }
    let text = serde_json::to_string_pretty(&record).map_err(std::io::Error::from);
    let path = dir.join(RECORD);
    text.and_then(|text| write_atomically(&path, |file| writeln!(file, "{text}")))
        .map_err(|source| StudyError::Write { path, source })?;
    let unfinished = dir.join(ROWS);
    if unfinished.exists() {
        std::fs::remove_file(&unfinished).map_err(|source| StudyError::Write {
            path: unfinished,
            source,
        })?;
    }
    Ok(record.settled)
}

fn settled(table: &Table) -> Result<usize, StudyError> {
    let status = places(table.columns)
        .get(STATUS)
        .copied()
        .unwrap_or_default();
    let mut settled = 0;
    table.rows(|_, cells| {
        settled += usize::from(cells[status] == SETTLED);
        Ok(())
    })?;
    Ok(settled)
}
