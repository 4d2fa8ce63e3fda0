//! Files that say which cloud is in which split.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use tdcr_base::files::{LARGEST_TEXT, read_text};

use super::{CloudFileError, Fault};
use crate::data::{Split, SplitIndices};

/// Reads a CSV file of lines `NAME,SPLIT`: the name of a cloud's file, with its extension or without, and `train`, `val` or
/// `test`. Empty lines and lines that begin with `#` are passed over. Every one of `clouds` must be named once.
pub(super) fn read_split(path: &Path, clouds: &[PathBuf]) -> Result<SplitIndices, CloudFileError> {
    let text = read_text(path, LARGEST_TEXT).map_err(|error| Fault::new("file", error).at(path))?;
    parse(&text, clouds).map_err(|fault| fault.at(path))
}

fn parse(text: &str, clouds: &[PathBuf]) -> Result<SplitIndices, Fault> {
    let mut indices = HashMap::new();
    for (index, cloud) in clouds.iter().enumerate() {
        for name in [cloud.file_stem(), cloud.file_name()].into_iter().flatten() {
            indices.insert(name.to_string_lossy().into_owned(), index);
        }
    }
    let mut places = vec![None; clouds.len()];
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let fault = |problem: String| Fault::new(format!("line {}", number + 1), problem);
        let (name, split) = line
            .rsplit_once(',')
            .map(|(name, split)| (name.trim(), split.trim()))
            .ok_or_else(|| fault(format!("`{line}`, expected NAME,SPLIT")))?;
        let found = Split::ALL.iter().position(|known| known.folder() == split);
        let split =
            found.ok_or_else(|| fault(format!("split `{split}`, expected train, val or test")))?;
        let index = *indices.get(name).ok_or_else(|| {
            fault(format!(
                "no cloud `{name}`, expected the name of a cloud's file"
            ))
        })?;
        if places[index].replace(split).is_some() {
            return Err(fault(format!("cloud `{name}` a second time")));
        }
    }
    let mut splits = [vec![], vec![], vec![]];
    for (index, place) in places.into_iter().enumerate() {
        let place = place.ok_or_else(|| {
            let name = clouds[index].file_name().unwrap_or_default();
            Fault::new(
                "file",
                format!("no line for cloud `{}`", name.to_string_lossy()),
            )
        })?;
        splits[place].push(index);
    }
    if let Some(empty) = splits.iter().position(Vec::is_empty) {
        let name = Split::ALL[empty].folder();
        let problem = format!("no cloud for {name}, expected at least one for each split");
        return Err(Fault::new("file", problem));
    }
    let [train, val, test] = splits;
    Ok(SplitIndices { train, val, test })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    fn clouds() -> Vec<PathBuf> {
        ["a.ply", "b.c.ply", "d,e.npz", "f.npy"]
            .map(PathBuf::from)
            .into()
    }

    #[test]
    fn clouds_are_named_with_and_without_extension() {
        let text = "# by hand\na, test\n\nb.c.ply,train\nd,e,val\nf,train\n";
        let split = parse(text, &clouds()).unwrap();
        assert_eq!(split.train, [1, 3]);
        assert_eq!((split.val, split.test), (vec![2], vec![0]));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let whole = "a,test\nb.c,train\nd,e,val\n";
        for (text, expected) in [
            ("a", "line 1: `a`, expected NAME,SPLIT"),
            ("a,dev", "line 1: split `dev`, expected train, val or test"),
            ("#\nx,val", "line 2: no cloud `x`"),
            (
                &format!("{whole}a.ply,val"),
                "line 4: cloud `a.ply` a second time",
            ),
            (whole, "file: no line for cloud `f.npy`"),
            (
                "a,test\nb.c,test\nd,e,val\nf,val",
                "file: no cloud for train",
            ),
        ] {
            let error = parse(text, &clouds()).unwrap_err();
            let said = error.at(Path::new("split.csv")).to_string();
            assert!(
                said.starts_with(&format!("split.csv: {expected}")),
                "{said}"
            );
        }
    }
}
