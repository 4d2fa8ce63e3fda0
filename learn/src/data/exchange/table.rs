//! Rows of named numbers, as PLY and PCD files hold them.

use tdcr_sim::cloud::PointCloud;

use super::{Fault, GREY, Parsed, is_finite};

/// Names of the columns of red, green and blue; the first that are all there count.
const COLORS: [[&str; 3]; 3] = [
    ["red", "green", "blue"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ["r", "g", "b"],
];
/// Names of a column of packed colours.
const PACKED: [&str; 2] = ["rgb", "rgba"];
/// Names of columns that are known to be no colours.
const OTHERS: [&str; 13] = [
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "normal_x",
    "normal_y",
    "normal_z",
    "curvature",
    "intensity",
    "alpha",
    "confidence",
];
/// Rounding that a colour given from 0 to 1 may have beyond.
const ROUNDING: f64 = 1e-3;

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// A column.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    pub name: String,
    pub kind: Kind,
}

impl Kind {
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The little-endian number that `bytes` start with, as many as [`size`](Self::size).
    pub fn read(self, bytes: &[u8]) -> f64 {
        let mut raw = [0; 8];
        raw[..self.size()].copy_from_slice(&bytes[..self.size()]);
        let word = u64::from_le_bytes(raw);
        match self {
            Self::I8 => f64::from(word as u8 as i8),
            Self::U8 => f64::from(word as u8),
            Self::I16 => f64::from(word as u16 as i16),
            Self::U16 => f64::from(word as u16),
            Self::I32 => f64::from(word as u32 as i32),
            Self::U32 => f64::from(word as u32),
            Self::F32 => f64::from(f32::from_bits(word as u32)),
            Self::F64 => f64::from_bits(word),
        }
    }

    /// The colour that a number of this kind stands for: 0 to 1 in floats, else 0 to 255.
    ///
    /// # Errors
    /// What would be right, for a number outside of that.
    pub fn color(self, value: f64) -> Result<u8, &'static str> {
        match self {
            Self::F32 | Self::F64 => match (-ROUNDING..=1.0 + ROUNDING).contains(&value) {
                // A cast saturates.
                true => Ok((255.0 * value).round() as u8),
                false => Err("a colour from 0 to 1, as the numbers are floats"),
            },
            _ => match (0.0..=255.0).contains(&value) && value.fract() == 0.0 {
                true => Ok(value as u8),
                false => Err("a colour from 0 to 255, as the numbers are integers"),
            },
        }
    }
}

/// Where in a row a cloud's numbers are.
pub(super) struct Layout {
    columns: Vec<Column>,
    position: [usize; 3],
    color: Color,
}

enum Color {
    None,
    /// Red, green, blue in columns of their own, as [`Kind::color`] reads them.
    Separate([usize; 3]),
    /// 0x00RRGGBB in the bits of one column.
    Packed(usize),
}

impl Layout {
    /// Finds `x y z` and, if they are there, colours under one of the names [`COLORS`] or [`PACKED`].
    pub fn of(columns: Vec<Column>) -> Result<Self, Fault> {
        let find = |name: &str| {
            let mut names = columns.iter().map(|column| &column.name);
            names.position(|found| found.eq_ignore_ascii_case(name))
        };
        let mut position = [0; 3];
        for (place, name) in position.iter_mut().zip(["x", "y", "z"]) {
            let problem = || Fault::new("header", format!("no `{name}`, expected x, y and z"));
            *place = find(name).ok_or_else(problem)?;
        }
        let separate = COLORS.iter().find_map(|names| {
            let [red, green, blue] = names.map(&find);
            Some([red?, green?, blue?])
        });
        let packed = PACKED.iter().find_map(|name| find(name));
        let color = match (separate, packed) {
            (Some(places), _) => Color::Separate(places),
            (_, Some(packed)) if columns[packed].kind.size() == 4 => Color::Packed(packed),
            _ => Color::None,
        };
        Ok(Self {
            columns,
            position,
            color,
        })
    }

    /// The cloud, and of one without colours what might be some.
    pub fn parsed(&self, cloud: PointCloud) -> Parsed {
        let names = self.columns.iter().map(|column| &column.name);
        let unknown = |name: &&String| {
            !name.is_empty() && !OTHERS.iter().any(|known| known.eq_ignore_ascii_case(name))
        };
        let passed_over = match self.color {
            Color::None => names.filter(unknown).cloned().collect(),
            _ => Vec::new(),
        };
        Parsed { cloud, passed_over }
    }

    /// Bytes of a binary row.
    pub fn stride(&self) -> usize {
        self.columns.iter().map(|column| column.kind.size()).sum()
    }

    /// The cloud in the first `count` binary rows of `bytes`, which begin at byte `offset` of the file.
    pub fn binary(&self, bytes: &[u8], count: usize, offset: usize) -> Result<PointCloud, Fault> {
        let stride = self.stride();
        let whole = bytes.len() / stride.max(1);
        if whole < count {
            let end = offset + bytes.len();
            let problem = format!("the file ends after {whole} of {count} points");
            return Err(Fault::new(format!("byte {end}"), problem));
        }
        let mut cloud = PointCloud::default();
        let mut row = vec![0.0; self.columns.len()];
        for (number, bytes) in bytes.chunks_exact(stride).take(count).enumerate() {
            let mut rest = bytes;
            for (value, column) in row.iter_mut().zip(&self.columns) {
                *value = column.kind.read(rest);
                rest = &rest[column.kind.size()..];
            }
            self.push(&row, &mut cloud)
                .map_err(|problem| Fault::new(format!("point {number}"), problem))?;
        }
        Ok(cloud)
    }

    /// The cloud in `count` rows of text, the first of which is line `first` of the file.
    pub fn ascii(&self, text: &str, count: usize, first: usize) -> Result<PointCloud, Fault> {
        let mut cloud = PointCloud::default();
        let mut lines = (first..)
            .zip(text.lines())
            .filter(|(_, line)| !line.trim().is_empty());
        for done in 0..count {
            let Some((number, line)) = lines.next() else {
                let problem = format!("the file ends after {done} of {count} points");
                return Err(Fault::new("last line", problem));
            };
            let row: Vec<f64> = line
                .split_whitespace()
                .map(|word| {
                    word.parse().map_err(|_| {
                        Fault::new(
                            format!("line {number}"),
                            format!("`{word}`, expected a number"),
                        )
                    })
                })
                .collect::<Result<_, _>>()?;
            if row.len() < self.columns.len() {
                let problem = format!("{} numbers, expected {}", row.len(), self.columns.len());
                return Err(Fault::new(format!("line {number}"), problem));
            }
            self.push(&row, &mut cloud)
                .map_err(|problem| Fault::new(format!("line {number}"), problem))?;
        }
        Ok(cloud)
    }

    /// Adds a row; says what is wrong with its colour.
    fn push(&self, row: &[f64], cloud: &mut PointCloud) -> Result<(), String> {
        let point = self.position.map(|place| row[place] as f32);
        let color = match self.color {
            Color::None => GREY,
            // What was not seen is left out, and has no colour either.
            _ if !is_finite(&point) => GREY,
            Color::Separate(places) => {
                let mut color = GREY;
                for (channel, place) in color.iter_mut().zip(places) {
                    let Column { name, kind } = &self.columns[place];
                    *channel = kind.color(row[place]).map_err(|expected| {
                        format!("`{name}` is {}, expected {expected}", row[place])
                    })?;
                }
                color
            }
            Color::Packed(place) => {
                let bits = match self.columns[place].kind {
                    Kind::F32 => (row[place] as f32).to_bits(),
                    _ => row[place] as i64 as u32,
                };
                [16, 8, 0].map(|shift| (bits >> shift) as u8)
            }
        };
        cloud.push(point, color);
        Ok(())
    }
}
