//! PLY: ASCII and binary little-endian, vertices before anything of variable length.

use tdcr_base::files::bytes_without_mark;

use super::table::{Column, Kind, Layout};
use super::{Fault, Parsed, require_points};

/// The cloud of a file's vertices.
pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, Fault> {
    let mut lines = Lines::new(bytes);
    if lines.next()? != "ply" {
        return Err(Fault::new("line 1", "not a PLY file, expected `ply`"));
    }
    let mut format = None;
    let mut elements: Vec<(String, usize, Vec<Column>)> = Vec::new();
    loop {
        let line = lines.next()?;
        let fault = |problem: &str| Fault::new(format!("line {}", lines.number), problem);
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["end_header"] => break,
            [] | ["comment", ..] | ["obj_info", ..] => {}
            ["format", "ascii", _] => format = Some(Format::Ascii),
            ["format", "binary_little_endian", _] => format = Some(Format::Binary),
            ["format", ..] => {
                return Err(fault("expected format ascii or binary_little_endian"));
            }
            ["element", name, count] => {
                let count = count.parse::<u32>().ok();
                let count = count.ok_or_else(|| fault("expected a number of elements"))? as usize;
                elements.push((name.to_owned(), count, Vec::new()));
            }
            ["property", "list", ..] if has_vertices(&elements) => {}
            ["property", "list", ..] => {
                return Err(fault(
                    "a list before or among the vertices, expected numbers",
                ));
            }
            ["property", kind, name] => {
                let kind = kind_of(kind).ok_or_else(|| fault("unknown type of number"))?;
                let element = elements.last_mut();
                let (_, _, columns) =
                    element.ok_or_else(|| fault("a property without an element"))?;
                let name = name.to_owned();
                columns.push(Column { name, kind });
            }
            _ => {
                return Err(fault(
                    "expected format, element, property, comment or end_header",
                ));
            }
        }
    }
    let format = format.ok_or_else(|| Fault::new("header", "no format"))?;
    let vertex = elements.iter().position(|(name, ..)| name == "vertex");
    let vertex = vertex.ok_or_else(|| Fault::new("header", "no element `vertex`"))?;
    let (before, rest) = elements.split_at(vertex);
    let layout = Layout::of(rest[0].2.clone())?;
    let count = rest[0].1;
    require_points("header", count)?;
    let cloud = match format {
        Format::Ascii => {
            let text = std::str::from_utf8(lines.rest)
                .map_err(|_| Fault::new("points", "not text, though the format is ascii"))?;
            let skipped: usize = before.iter().map(|(_, count, _)| count).sum();
            let rest = after_lines(text, skipped);
            layout.ascii(rest, count, lines.number + skipped + 1)
        }
        Format::Binary => {
            let size = |(_, count, columns): &(String, usize, Vec<Column>)| {
                count
                    * columns
                        .iter()
                        .map(|column| column.kind.size())
                        .sum::<usize>()
            };
            let skipped = before.iter().map(size).sum::<usize>().min(lines.rest.len());
            let offset = bytes.len() - lines.rest.len() + skipped;
            layout.binary(&lines.rest[skipped..], count, offset)
        }
    };
    Ok(layout.parsed(cloud?))
}

/// What follows the first `count` lines.
fn after_lines(text: &str, count: usize) -> &str {
    match count.checked_sub(1) {
        None => text,
        Some(last) => {
            let end = text.match_indices('\n').nth(last);
            end.map_or("", |(end, _)| &text[end + 1..])
        }
    }
}

enum Format {
    Ascii,
    Binary,
}

/// Whether all vertices come before what is being declared.
fn has_vertices(elements: &[(String, usize, Vec<Column>)]) -> bool {
    let earlier = elements.len().saturating_sub(1);
    elements[..earlier]
        .iter()
        .any(|(name, ..)| name == "vertex")
}

fn kind_of(name: &str) -> Option<Kind> {
    Some(match name {
        "char" | "int8" => Kind::I8,
        "uchar" | "uint8" => Kind::U8,
        "short" | "int16" => Kind::I16,
        "ushort" | "uint16" => Kind::U16,
        "int" | "int32" => Kind::I32,
        "uint" | "uint32" => Kind::U32,
        "float" | "float32" => Kind::F32,
        "double" | "float64" => Kind::F64,
        _ => return None,
    })
}

/// Lines of a header, and what comes after it.
pub(super) struct Lines<'a> {
    pub rest: &'a [u8],
    /// Lines read.
    pub number: usize,
}

impl<'a> Lines<'a> {
    /// Lines of a file, which may begin with the byte order mark of UTF-8.
    pub fn new(bytes: &'a [u8]) -> Self {
        let rest = bytes_without_mark(bytes);
        Self { rest, number: 0 }
    }

    /// The next line, without white space at its ends.
    pub fn next(&mut self) -> Result<&'a str, Fault> {
        self.number += 1;
        let place = || format!("line {}", self.number);
        let end = self.rest.iter().position(|&byte| byte == b'\n');
        let end = end.ok_or_else(|| Fault::new(place(), "the file ends within its header"))?;
        let line = std::str::from_utf8(&self.rest[..end])
            .map_err(|_| Fault::new(place(), "not text, expected a header"))?;
        self.rest = &self.rest[end + 1..];
        Ok(line.trim())
    }
}
