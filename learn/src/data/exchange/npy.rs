//! NumPy's NPY and NPZ.

use std::io::{self, Cursor, Read, Seek, Write};

use tdcr_base::limits;
use tdcr_sim::cloud::PointCloud;
use zip::read::ZipFile;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::table::Kind;
use super::{Fault, GREY, Parsed, is_finite, require_points};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Names of the array of points, and of that of colours.
const POINTS: [&str; 4] = ["points", "data", "xyz", "arr_0"];
const COLORS: [&str; 5] = ["rgb", "colors", "colours", "color", "colour"];

/// A table of numbers in the bytes of a file, row-major.
pub(super) struct Table<'a> {
    rows: usize,
    columns: usize,
    data: &'a [u8],
    kind: Kind,
}

impl Table<'_> {
    /// Row after row, each as what reads the number in a column.
    pub fn rows(&self) -> impl Iterator<Item = impl Fn(usize) -> f64> {
        let (kind, size) = (self.kind, self.kind.size());
        let rows = self.data.chunks_exact(self.columns * size);
        rows.map(move |row| move |column| kind.read(&row[column * size..]))
    }

    /// The colours of `points`, in the three columns from `first` on, as [`Kind::color`] reads them. Points that are not finite
    /// have none.
    pub fn colors(&self, first: usize, points: &[[f32; 3]]) -> Result<Vec<[u8; 3]>, Fault> {
        let mut colors = Vec::with_capacity(points.len());
        for (number, (at, point)) in self.rows().zip(points).enumerate() {
            let mut color = GREY;
            if is_finite(point) {
                for (k, channel) in color.iter_mut().enumerate() {
                    let value = at(first + k);
                    *channel = self.kind.color(value).map_err(|expected| {
                        let problem =
                            format!("column {} is {value}, expected {expected}", first + k);
                        Fault::new(format!("row {number}"), problem)
                    })?;
                }
            }
            colors.push(color);
        }
        Ok(colors)
    }
}

/// A cloud of `(N, 3)` points, or `(N, 6)` with colours from 0 to 1, or to 255 in an array of bytes.
pub(super) fn parse_npy(bytes: &[u8]) -> Result<Parsed, Fault> {
    let table = parse(bytes)?;
    if ![3, 6].contains(&table.columns) {
        let expected = "(N, 3), or (N, 6) with colours: a row for each point";
        return Err(wrong_shape(&table, expected));
    }
    let mut cloud = points(&table);
    if table.columns == 6 {
        cloud.colors = table.colors(3, &cloud.points)?;
    }
    Ok(Parsed::of(cloud))
}

/// A cloud of an archive's arrays: points `(N, 3)` under one of [`POINTS`], colours `(N, 3)` under one of [`COLORS`].
pub(super) fn parse_npz(bytes: &[u8]) -> Result<Parsed, Fault> {
    let mut archive =
        ZipArchive::new(Cursor::new(bytes)).map_err(|error| Fault::new("archive", error))?;
    let mut find = |names: &[&'static str]| -> Result<Option<Member>, Fault> {
        for &name in names {
            let Ok(file) = archive.by_name(&format!("{name}.npy")) else {
                continue;
            };
            return Member::unpack(name, file, bytes.len() as u64).map(Some);
        }
        Ok(None)
    };
    let member = find(&POINTS)?;
    let member = member.ok_or_else(|| {
        Fault::new(
            "archive",
            format!("no array of points, expected one of {POINTS:?}"),
        )
    })?;
    let table = member.table()?;
    if table.columns != 3 {
        return Err(member.inside(wrong_shape(&table, "(N, 3), a row for each point")));
    }
    let mut cloud = points(&table);
    if let Some(member) = find(&COLORS)? {
        let colors = member.table()?;
        let coloured = match (colors.rows, colors.columns) == (table.rows, 3) {
            true => colors.colors(0, &cloud.points),
            false => Err(wrong_shape(&colors, "the shape of the points")),
        };
        cloud.colors = coloured.map_err(|fault| member.inside(fault))?;
        return Ok(Parsed::of(cloud));
    }
    let names = archive.file_names().filter_map(|name| {
        let name = name.ok()?;
        Some(name.strip_suffix(".npy")?.to_owned())
    });
    Ok(Parsed {
        passed_over: names.filter(|name| name != member.name).collect(),
        cloud,
    })
}

/// An array of an archive, unpacked.
pub(super) struct Member {
    name: &'static str,
    npy: Vec<u8>,
}

impl Member {
    /// Unpacks `file` of an archive of `held` bytes, as far as the archive says that it is long.
    pub fn unpack<R: Read>(name: &'static str, file: ZipFile<R>, held: u64) -> Result<Self, Fault> {
        let place = || format!("array `{name}`");
        let asked = file.size();
        limits::require(asked, held).map_err(|error| Fault::new(place(), error))?;
        let mut npy = Vec::with_capacity(asked as usize);
        let read = file.take(asked).read_to_end(&mut npy);
        read.map_err(|error| Fault::new(place(), error))?;
        Ok(Self { name, npy })
    }

    fn table(&self) -> Result<Table<'_>, Fault> {
        parse(&self.npy).map_err(|fault| self.inside(fault))
    }

    /// Its shape, and its numbers as a table with as many columns as the last dimension is long.
    pub fn shaped_table(&self) -> Result<(Vec<usize>, Table<'_>), Fault> {
        parse_shaped(&self.npy).map_err(|fault| self.inside(fault))
    }

    /// The number of an array without dimensions.
    pub fn number(&self) -> Result<f64, Fault> {
        let read = || {
            let array = parse_array(&self.npy)?;
            let kind = number_kind(array.descr)?;
            match (&array.shape[..], array.data.len() == kind.size()) {
                ([], true) => Ok(kind.read(array.data)),
                _ => Err(fault(&format!(
                    "shape {:?}, expected a number without dimensions",
                    array.shape
                ))),
            }
        };
        read().map_err(|fault| self.inside(fault))
    }

    /// The text of an array without dimensions, of NumPy's kind `U`: UTF-32, filled up with zeros.
    pub fn text(&self) -> Result<String, Fault> {
        let read = || {
            let array = parse_array(&self.npy)?;
            let (words, rest) = array.data.as_chunks::<4>();
            let length = array.descr.strip_prefix("<U").map(str::parse::<usize>);
            if length != Some(Ok(words.len())) || !array.shape.is_empty() || !rest.is_empty() {
                let (descr, shape) = (array.descr, &array.shape);
                return Err(fault(&format!(
                    "elements of type `{descr}` in the shape {shape:?}, expected one text, <U"
                )));
            }
            let letters = words.iter().map(|word| u32::from_le_bytes(*word));
            let text: Option<String> = letters.map(char::from_u32).collect();
            let text = text.ok_or_else(|| fault("not text"))?;
            Ok(text.trim_end_matches('\0').to_owned())
        };
        read().map_err(|fault| self.inside(fault))
    }

    /// A fault of the array, with its name.
    pub fn inside(&self, fault: Fault) -> Fault {
        Fault {
            place: format!("array `{}`, {}", self.name, fault.place),
            ..fault
        }
    }
}

fn wrong_shape(table: &Table, expected: &str) -> Fault {
    let problem = format!(
        "shape ({}, {}), expected {expected}",
        table.rows, table.columns
    );
    Fault::new("header", problem)
}

fn points(table: &Table) -> PointCloud {
    let rows = table.rows();
    PointCloud {
        points: rows.map(|at| [0, 1, 2].map(|k| at(k) as f32)).collect(),
        colors: vec![GREY; table.rows],
    }
}

/// Reads a two-dimensional array of little-endian numbers in C order.
fn parse(bytes: &[u8]) -> Result<Table<'_>, Fault> {
    let (shape, table) = parse_shaped(bytes)?;
    match shape[..] {
        [_, _] => {
            require_points("header", table.rows)?;
            Ok(table)
        }
        _ => {
            let problem = format!("shape {shape:?}, expected two dimensions");
            Err(Fault::new("header", problem))
        }
    }
}

/// An array in the bytes of a file, in C order: type of its elements as NumPy names it, shape, and the bytes of its elements.
struct Array<'a> {
    descr: &'a str,
    shape: Vec<usize>,
    /// Where the elements begin in the file.
    start: usize,
    data: &'a [u8],
}

fn fault(problem: &str) -> Fault {
    Fault::new("header", problem)
}

/// Reads the header of an array in C order.
fn parse_array(bytes: &[u8]) -> Result<Array<'_>, Fault> {
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
        return Err(fault(
            "the array is in Fortran order, expected C order: save numpy.ascontiguousarray of it",
        ));
    }
    let descr = value("descr")?.trim_start_matches('\'');
    let shape = value("shape")?.trim_start_matches('(');
    Ok(Array {
        descr: descr.split('\'').next().unwrap_or(""),
        shape: shape
            .split(')')
            .next()
            .unwrap_or("")
            .split(',')
            .map(str::trim)
            .filter(|word| !word.is_empty())
            .map(|word| word.parse().map_err(|_| fault("shape is not of numbers")))
            .collect::<Result<_, _>>()?,
        start: start + length,
        data: &bytes[start + length..],
    })
}

/// Reads an array of little-endian numbers in C order, of at least one dimension: its shape, and a table with as many
/// columns as the last dimension is long.
fn parse_shaped(bytes: &[u8]) -> Result<(Vec<usize>, Table<'_>), Fault> {
    let Array {
        descr,
        shape,
        start,
        data,
    } = parse_array(bytes)?;
    let Some((&columns, leading)) = shape.split_last() else {
        return Err(fault("no shape, expected at least one dimension"));
    };
    let rows = leading.iter().try_fold(1_usize, |n, &k| n.checked_mul(k));
    let rows = rows.ok_or_else(|| fault(&format!("shape {shape:?} is too large")))?;
    let kind = number_kind(descr)?;
    let count = data.len() / kind.size();
    if rows.checked_mul(columns) != Some(count) || count == 0 {
        let problem = format!("{count} numbers, expected {rows} times {columns}");
        return Err(Fault::new(format!("byte {start}"), problem));
    }
    let table = Table {
        rows,
        columns,
        data,
        kind,
    };
    Ok((shape, table))
}

fn number_kind(descr: &str) -> Result<Kind, Fault> {
    match descr {
        "<f4" => Ok(Kind::F32),
        "<f8" => Ok(Kind::F64),
        "|u1" => Ok(Kind::U8),
        _ => {
            let problem = format!("elements of type `{descr}`, expected <f4, <f8 or |u1");
            Err(fault(&problem))
        }
    }
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
