//! NumPy's NPY and NPZ.

use std::io::{self, Cursor, Read, Seek, Write};

use tdcr_sim::cloud::PointCloud;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::{Fault, GREY};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Most bytes that an array of an archive may unfold to.
const MAX_UNPACKED: u64 = 1 << 32;

/// Names of the array of points, and of that of colours.
const POINTS: [&str; 4] = ["points", "data", "xyz", "arr_0"];
const COLORS: [&str; 3] = ["rgb", "colors", "colours"];

/// A table of numbers, row-major.
struct Table {
    rows: usize,
    columns: usize,
    values: Vec<f64>,
    /// Whether they are bytes, as colours of 8 bits are.
    bytes: bool,
}

/// A cloud of `(N, 3)` points, or `(N, 6)` with colours from 0 to 1, or to 255 in an array of bytes.
pub(super) fn parse_npy(bytes: &[u8]) -> Result<PointCloud, Fault> {
    let table = parse(bytes)?;
    if table.columns < 3 {
        return Err(wrong_shape(&table, "(N, 3) or (N, 6)"));
    }
    let mut cloud = points(&table);
    if table.columns == 6 {
        let rows = table.values.chunks_exact(6);
        cloud.colors = rows.map(|row| color(&row[3..], table.bytes)).collect();
    }
    Ok(cloud)
}

/// A cloud of an archive's arrays: points `(N, 3)` under one of [`POINTS`], colours `(N, 3)` under one of [`COLORS`].
pub(super) fn parse_npz(bytes: &[u8]) -> Result<PointCloud, Fault> {
    let mut archive =
        ZipArchive::new(Cursor::new(bytes)).map_err(|error| Fault::new("archive", error))?;
    let mut find = |names: &[&str]| -> Result<Option<Table>, Fault> {
        for name in names {
            let Ok(mut file) = archive.by_name(&format!("{name}.npy")) else {
                continue;
            };
            let mut bytes = Vec::new();
            let read = file.by_ref().take(MAX_UNPACKED).read_to_end(&mut bytes);
            read.map_err(|error| Fault::new(format!("array `{name}`"), error))?;
            let inside = |fault: Fault| Fault {
                place: format!("array `{name}`, {}", fault.place),
                ..fault
            };
            return parse(&bytes).map(Some).map_err(inside);
        }
        Ok(None)
    };
    let table = find(&POINTS)?;
    let table = table.ok_or_else(|| {
        Fault::new(
            "archive",
            format!("no array of points, expected one of {POINTS:?}"),
        )
    })?;
    if table.columns != 3 {
        return Err(wrong_shape(&table, "(N, 3)"));
    }
    let mut cloud = points(&table);
    if let Some(colors) = find(&COLORS)? {
        if (colors.rows, colors.columns) != (table.rows, 3) {
            return Err(wrong_shape(&colors, "the shape of the points"));
        }
        let rows = colors.values.chunks_exact(3);
        cloud.colors = rows.map(|row| color(row, colors.bytes)).collect();
    }
    Ok(cloud)
}

fn wrong_shape(table: &Table, expected: &str) -> Fault {
    let problem = format!(
        "shape ({}, {}), expected {expected}",
        table.rows, table.columns
    );
    Fault::new("header", problem)
}

fn points(table: &Table) -> PointCloud {
    let rows = table.values.chunks_exact(table.columns);
    let points = rows.map(|row| [0, 1, 2].map(|k| row[k] as f32)).collect();
    PointCloud {
        points,
        colors: vec![GREY; table.rows],
    }
}

/// Casts saturate, so that what is out of range is the nearest colour.
fn color(channels: &[f64], bytes: bool) -> [u8; 3] {
    let unit = if bytes { 1.0 } else { 255.0 };
    [0, 1, 2].map(|k| (channels[k] * unit).round() as u8)
}

/// Reads a two-dimensional array of little-endian numbers in C order.
fn parse(bytes: &[u8]) -> Result<Table, Fault> {
    let fault = |problem: &str| Fault::new("header", problem);
    let short = || fault("the file ends within its header");
    if !bytes.starts_with(MAGIC) {
        return Err(Fault::new("byte 0", "not an NPY array"));
    }
    let field = |range: std::ops::Range<usize>| bytes.get(range).ok_or_else(short);
    let (start, length) = match field(6..7)? {
        [1] => {
            let length = field(8..10)?;
            (10, usize::from(length[0]) | usize::from(length[1]) << 8)
        }
        _ => {
            let length = field(8..12)?;
            let length = length
                .iter()
                .rev()
                .fold(0, |sum, &byte| sum << 8 | usize::from(byte));
            (12, length)
        }
    };
    let header = field(start..start + length)?;
    let header = std::str::from_utf8(header).map_err(|_| fault("not text"))?;
    let value = |key: &str| {
        let after = header
            .split_once(&format!("'{key}':"))
            .map(|(_, after)| after.trim_start());
        after.ok_or_else(|| fault(&format!("no `{key}`")))
    };
    if !value("fortran_order")?.starts_with("False") {
        return Err(fault("the array is in Fortran order, expected C order"));
    }
    let descr = value("descr")?.trim_start_matches('\'');
    let descr = descr.split('\'').next().unwrap_or("");
    let shape = value("shape")?.trim_start_matches('(');
    let shape: Vec<usize> = shape
        .split(')')
        .next()
        .unwrap_or("")
        .split(',')
        .map(str::trim)
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().map_err(|_| fault("shape is not of numbers")))
        .collect::<Result<_, _>>()?;
    let [rows, columns] = shape[..] else {
        return Err(fault(&format!("shape {shape:?}, expected two dimensions")));
    };
    let data = &bytes[start + length..];
    let values: Vec<f64> = match descr {
        "<f4" => numbers(data, |b| f64::from(f32::from_le_bytes(b))),
        "<f8" => numbers(data, f64::from_le_bytes),
        "|u1" => data.iter().map(|&byte| byte.into()).collect(),
        _ => {
            let problem = format!("elements of type `{descr}`, expected <f4, <f8 or |u1");
            return Err(fault(&problem));
        }
    };
    if rows.checked_mul(columns) != Some(values.len()) || values.is_empty() {
        let problem = format!("{} numbers, expected {rows} times {columns}", values.len());
        return Err(Fault::new(format!("byte {}", start + length), problem));
    }
    Ok(Table {
        rows,
        columns,
        values,
        bytes: descr == "|u1",
    })
}

fn numbers<const N: usize>(data: &[u8], read: impl Fn([u8; N]) -> f64) -> Vec<f64> {
    data.as_chunks()
        .0
        .iter()
        .map(|&bytes| read(bytes))
        .collect()
}

/// An NPY file, version 1.0, up to its data, which follow in C order.
pub(super) fn header(shape: &[usize], descr: &str) -> Vec<u8> {
    let sizes: String = shape.iter().map(|size| format!("{size}, ")).collect();
    let mut header =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({sizes}), }}");
    // Magic, version, length and header fill whole blocks of 64 bytes.
    let padding = 64 - (MAGIC.len() + 4 + header.len() + 1) % 64;
    header.push_str(&" ".repeat(padding));
    header.push('\n');
    let length = (header.len() as u16).to_le_bytes();
    [MAGIC, &[1, 0], &length, header.as_bytes()].concat()
}

/// Writes an NPZ file, uncompressed, of NPY files: names, sizes (bytes) and contents.
pub(super) fn write_archive<R: Read>(
    file: impl Write + Seek,
    arrays: impl IntoIterator<Item = (String, u64, R)>,
) -> io::Result<()> {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut archive = ZipWriter::new(file);
    for (name, size, mut npy) in arrays {
        let options = options.large_file(size >= u64::from(u32::MAX));
        archive.start_file(format!("{name}.npy"), options)?;
        io::copy(&mut npy, &mut archive)?;
    }
    archive.finish()?;
    Ok(())
}
