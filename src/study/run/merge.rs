//! Putting the parts of a study together.

use std::io::{BufRead, BufReader, Write, copy};
use std::path::{Path, PathBuf};
use std::time::Instant;

use tdcr_base::files::{self, write_atomically};

use super::Finished;
use super::finish::finish;
use crate::pipeline::{Monitor, lock_folder};
use crate::study::error::StudyError;
use crate::study::outputs::record::{Record, TABLE};
use crate::study::outputs::table::{Table, header};
use crate::study::spec::cases::Cases;

/// Puts the parts of a study in the folders `parts`, in any order, together in the folder `out`: table, summary and report byte
/// for byte those of a run without parts. The parts are only read.
///
/// # Errors
/// [`StudyError::NoPart`], [`StudyError::OtherParts`] where the folders are not all parts of one study, each finished and there
/// once; a folder that cannot be read or written.
pub fn merge(parts: &[PathBuf], out: &Path, monitor: &dyn Monitor) -> Result<Finished, StudyError> {
    let began = Instant::now();
    let mut found = parts
        .iter()
        .map(|dir| read_part(dir))
        .collect::<Result<Vec<_>, _>>()?;
    found.sort_by_key(|(_, record)| record.part);
    let wrong = |reason: String| StudyError::OtherParts { reason };
    let Some((first_dir, first)) = found.first() else {
        return Err(wrong("no folder is given".to_owned()));
    };
    let of = first.part.map_or(1, |[_, of]| of);
    for (place, (dir, record)) in found.iter().enumerate() {
        if record.study != first.study || record.tdcr_version != first.tdcr_version {
            let (a, b) = (first_dir.display(), dir.display());
            return Err(wrong(format!(
                "{a} and {b} are of different studies or by different versions"
            )));
        }
        if record.part != Some([place + 1, of]) {
            let found = record
                .part
                .map_or(String::new(), |[part, of]| format!("part {part} of {of}"));
            return Err(wrong(format!(
                "{} is {found} where part {} of {of} is missing",
                dir.display(),
                place + 1
            )));
        }
    }
    if found.len() != of {
        return Err(wrong(format!("{} parts of {of}", found.len())));
    }
    for (dir, record) in &found {
        Table::new(dir, record).rows(|_, _| Ok(()))?;
    }
    let study = first.study.clone();
    let _lock = lock_folder(out)?;
    match Record::read(out)? {
        Some(record) if !record.is_of(&study, None) => {
            return Err(StudyError::OtherStudy {
                path: out.to_owned(),
            });
        }
        _ => {}
    }
    let table = out.join(TABLE);
    let fail = |source| StudyError::Write {
        path: table.clone(),
        source,
    };
    write_atomically(&table, |file| {
        file.write_all(header(&first.columns).as_bytes())?;
        for (dir, _) in &found {
            let mut rows = BufReader::new(files::open(&dir.join(TABLE))?);
            rows.skip_until(b'\n')?;
            copy(&mut rows, file)?;
        }
        Ok(())
    })
    .map_err(fail)?;
    let cases = Cases::new(&study).map_err(|refusal| wrong(refusal.to_string()))?;
    let record = Record {
        rows: found.iter().map(|(_, record)| record.rows).sum(),
        part: None,
        first_row: 0,
        began: found
            .iter()
            .map(|(_, record)| record.began)
            .min()
            .unwrap_or_default(),
        seconds: found.iter().map(|(_, record)| record.seconds).sum(),
        ..first.clone()
    };
    let rows = record.rows;
    let settled = finish(&cases, out, record, monitor)?;
    Ok(Finished {
        dir: out.to_owned(),
        rows,
        settled,
        seconds: began.elapsed().as_secs_f64(),
    })
}

fn read_part(dir: &Path) -> Result<(PathBuf, Record), StudyError> {
    let none = |reason: &str| StudyError::NoPart {
        path: dir.to_owned(),
        reason: reason.to_owned(),
    };
    let record = Record::read(dir)?.ok_or_else(|| none("it has no study.json"))?;
    match record.part {
        Some(_) => Ok((dir.to_owned(), record)),
        None => Err(none("it holds a whole study")),
    }
}
