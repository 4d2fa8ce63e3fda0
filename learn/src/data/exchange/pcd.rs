//! PCD of the Point Cloud Library: ASCII and binary.

use super::ply::Lines;
use super::table::{Column, Kind, Layout};
use super::{Fault, Parsed, require_points};

/// Most numbers of a point: PCL's largest descriptor has 7,992.
const MAX_COLUMNS: usize = 1 << 14;

/// The cloud of a file.
pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, Fault> {
    let mut lines = Lines::new(bytes);
    let (mut fields, mut sizes, mut types, mut counts) = (vec![], vec![], vec![], vec![]);
    let (mut width, mut height, mut points) = (None, None, None);
    let data = loop {
        let line = lines.next()?;
        let mut words = line.split_whitespace();
        let key = words.next().unwrap_or("#");
        let values: Vec<&str> = words.collect();
        let number = || values.first().and_then(|word| word.parse::<usize>().ok());
        match key {
            "FIELDS" => fields = values,
            "SIZE" => sizes = values,
            "TYPE" => types = values,
            "COUNT" => counts = values,
            "WIDTH" => width = number(),
            "HEIGHT" => height = number(),
            "POINTS" => points = number(),
            "DATA" => break values.first().copied().unwrap_or(""),
            "VERSION" | "VIEWPOINT" => {}
            comment if comment.starts_with('#') => {}
            _ => {
                let problem = "not a line of a PCD header, expected FIELDS, SIZE, TYPE and so on";
                return Err(Fault::new(format!("line {}", lines.number), problem));
            }
        }
    };
    let columns = columns(&fields, &sizes, &types, &counts)?;
    let layout = Layout::of(columns)?;
    let area = width.zip(height).and_then(|(w, h)| w.checked_mul(h));
    let count = points.or(area);
    let count = count.ok_or_else(|| Fault::new("header", "no POINTS, expected their number"))?;
    require_points("header", count)?;
    let cloud = match data {
        "ascii" => {
            let text = std::str::from_utf8(lines.rest)
                .map_err(|_| Fault::new("points", "not text, though DATA is ascii"))?;
            layout.ascii(text, count, lines.number + 1)
        }
        "binary" => layout.binary(lines.rest, count, bytes.len() - lines.rest.len()),
        "binary_compressed" => Err(Fault::new(
            format!("line {}", lines.number),
            "DATA binary_compressed is not read; write the file as binary or ascii",
        )),
        _ => Err(Fault::new(
            format!("line {}", lines.number),
            "expected DATA ascii or binary",
        )),
    };
    Ok(layout.parsed(cloud?))
}

/// One column for each number of a point.
fn columns(
    fields: &[&str],
    sizes: &[&str],
    types: &[&str],
    counts: &[&str],
) -> Result<Vec<Column>, Fault> {
    let lengths = [sizes.len(), types.len()];
    if fields.is_empty() || lengths != [fields.len(); 2] {
        let found = [fields.len(), sizes.len(), types.len()];
        let problem = format!("FIELDS, SIZE and TYPE have {found:?} values, expected as many each");
        return Err(Fault::new("header", problem));
    }
    let mut columns = Vec::new();
    for (k, name) in fields.iter().enumerate() {
        let kind = match (types[k], sizes[k]) {
            ("I", "1") => Kind::I8,
            ("U", "1") => Kind::U8,
            ("I", "2") => Kind::I16,
            ("U", "2") => Kind::U16,
            ("I", "4") => Kind::I32,
            ("U", "4") => Kind::U32,
            ("F", "4") => Kind::F32,
            ("F", "8") => Kind::F64,
            (kind, size) => {
                let problem = format!("field `{name}` is of TYPE {kind}, SIZE {size}, not known");
                return Err(Fault::new("header", problem));
            }
        };
        let count = counts.get(k).map_or(Some(1), |count| count.parse().ok());
        let count: usize = count.ok_or_else(|| {
            let problem = format!("COUNT of `{name}` is {}, not a number", counts[k]);
            Fault::new("header", problem)
        })?;
        if count > MAX_COLUMNS - columns.len() {
            let problem = format!(
                "COUNT of `{name}` is {count}, expected at most {MAX_COLUMNS} numbers a point in all"
            );
            return Err(Fault::new("header", problem));
        }
        // The first number has the field's name, and none else: a long one is not repeated.
        columns.extend((0..count).map(|k| Column {
            name: if k == 0 {
                (*name).to_owned()
            } else {
                String::new()
            },
            kind,
        }));
    }
    Ok(columns)
}
