//! Running a study: rows in blocks, on all cores.

mod finish;
mod measure;
mod merge;
mod progress;
mod solver;
mod worker;

pub use merge::merge;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;
use tdcr_base::Part;

use crate::pipeline::{Monitor, lock_folder};
use crate::study::error::{Refusal, StudyError};
use crate::study::outputs::columns::columns;
use crate::study::outputs::record::{ROWS, Record, TABLE};
use crate::study::outputs::table::{header, push_line};
use crate::study::spec::Study;
use crate::study::spec::cases::Cases;
use finish::finish;
use progress::Progress;
use worker::Worker;

/// Rows of the first block, and of the largest.
const SMALLEST_BLOCK: usize = 64;
const LARGEST_BLOCK: usize = 16384;
/// Blocks grow until one takes so long: an interruption loses one at most.
const BLOCK_TIME: Duration = Duration::from_millis(500);

/// What a run left.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finished {
    /// The folder.
    pub dir: PathBuf,
    /// Rows of its table.
    pub rows: usize,
    /// Those that settled.
    pub settled: usize,
    /// Wall clock of this run (s).
    pub seconds: f64,
}

/// Runs `study` into the folder `dir`, or a part of it, for [`merge`]. Interrupted or killed, the same call goes on
/// where it stopped. A finished study is only drawn again.
///
/// # Errors
/// [`StudyError`]: an interruption, a folder that holds something else, a file that cannot be written.
pub fn run(
    study: &Study,
    dir: &Path,
    part: Option<Part>,
    monitor: &dyn Monitor,
) -> Result<Finished, StudyError> {
    let (started, began) = (SystemTime::now(), Instant::now());
    let cases = Cases::new(study).map_err(design)?;
    let _lock = lock_folder(dir)?;
    let rows = part.map_or(0..cases.count(), |part| part.range(cases.count()));
    let part = part.map(|part| [part.number(), part.of()]);
    let columns = columns(study, &cases);
    let (table, unfinished) = (dir.join(TABLE), dir.join(ROWS));
    let record = match Record::read(dir)? {
        Some(record) if record.is_of(study, part) && table.exists() => record,
        Some(_) => {
            return Err(StudyError::OtherStudy {
                path: dir.to_owned(),
            });
        }
        None if table.exists() && !unfinished.exists() => {
            return Err(StudyError::OtherStudy {
                path: dir.to_owned(),
            });
        }
        None => {
            compute(study, &cases, &unfinished, rows.clone(), part, monitor)?;
            put_in_place(&unfinished, &table, &header(&columns))?;
            Record {
                tdcr_version: env!("CARGO_PKG_VERSION").to_owned(),
                title: study.title.clone(),
                seed: study.seed,
                rows: rows.len(),
                settled: 0,
                part,
                first_row: rows.start,
                // A clock before 1970 is 1970.
                began: started
                    .duration_since(UNIX_EPOCH)
                    .unwrap_or_default()
                    .as_secs(),
                seconds: began.elapsed().as_secs_f64(),
                columns,
                study: study.clone(),
            }
        }
    };
    let settled = finish(&cases, dir, record, monitor)?;
    Ok(Finished {
        dir: dir.to_owned(),
        rows: rows.len(),
        settled,
        seconds: began.elapsed().as_secs_f64(),
    })
}

fn design(refusal: Refusal) -> StudyError {
    match refusal {
        Refusal::Design(error) => StudyError::Design(error),
        other => StudyError::OtherParts {
            reason: other.to_string(),
        },
    }
}

/// Computes the rows that are missing.
fn compute(
    study: &Study,
    cases: &Cases,
    path: &Path,
    rows: Range<usize>,
    part: Option<[usize; 2]>,
    monitor: &dyn Monitor,
) -> Result<(), StudyError> {
    let key = json!({"tdcr_version": env!("CARGO_PKG_VERSION"), "part": part, "study": study});
    let mut progress = Progress::open(path, &key, rows.start)?;
    monitor.begin(
        "study",
        rows.len() as u64,
        (progress.next - rows.start) as u64,
    );
    let mut block = SMALLEST_BLOCK;
    while progress.next < rows.end {
        let began = Instant::now();
        let end = (progress.next + block).min(rows.end);
        let line = |worker: &mut Worker, index| {
            if monitor.interrupted() {
                return Err(StudyError::Interrupted);
            }
            let mut line = String::new();
            push_line(&mut line, &worker.row(index));
            monitor.advance(1);
            Ok(line)
        };
        let lines: Vec<String> = (progress.next..end)
            .into_par_iter()
            .map_init(|| Worker::new(study, cases), line)
            .collect::<Result<_, _>>()?;
        progress.add(&lines.concat(), lines.len())?;
        if began.elapsed() < BLOCK_TIME {
            block = (2 * block).min(LARGEST_BLOCK);
        }
    }
    monitor.end();
    progress.close()
}

/// Makes the table of the rows, which are removed once that is whole.
fn put_in_place(rows: &Path, table: &Path, header: &str) -> Result<(), StudyError> {
    use std::io::{BufRead, BufReader, Write};
    let fail = |source| StudyError::Write {
        path: table.to_owned(),
        source,
    };
    let mut from = BufReader::new(tdcr_base::files::open(rows).map_err(fail)?);
    from.skip_until(b'\n').map_err(fail)?;
    tdcr_base::files::write_atomically(table, |file| {
        file.write_all(header.as_bytes())?;
        std::io::copy(&mut from, file).map(drop)
    })
    .map_err(fail)
}
