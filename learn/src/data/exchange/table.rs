//! Rows of named numbers, as PLY and PCD files hold them.

use tdcr_sim::cloud::PointCloud;

use super::{Fault, GREY};

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
}

/// Where in a row a cloud's numbers are.
pub(super) struct Layout {
    columns: Vec<Column>,
    position: [usize; 3],
    color: Color,
}

enum Color {
    None,
    /// Red, green, blue in columns of their own, 0 to 255.
    Separate([usize; 3]),
    /// 0x00RRGGBB in the bits of one column.
    Packed(usize),
}

impl Layout {
    /// Finds `x y z` and, if they are there, `red green blue` or `rgb`.
    pub fn of(columns: Vec<Column>) -> Result<Self, Fault> {
        let find = |name: &str| columns.iter().position(|column| column.name == name);
        let mut position = [0; 3];
        for (place, name) in position.iter_mut().zip(["x", "y", "z"]) {
            let problem = || Fault::new("header", format!("no `{name}`, expected x, y and z"));
            *place = find(name).ok_or_else(problem)?;
        }
        let separate = ["red", "green", "blue"].map(&find);
        let packed = find("rgb").or_else(|| find("rgba"));
        let color = match (separate, packed) {
            ([Some(red), Some(green), Some(blue)], _) => Color::Separate([red, green, blue]),
            (_, Some(packed)) if columns[packed].kind.size() == 4 => Color::Packed(packed),
            _ => Color::None,
        };
        Ok(Self {
            columns,
            position,
            color,
        })
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
        for bytes in bytes.chunks_exact(stride).take(count) {
            let mut rest = bytes;
            for (value, column) in row.iter_mut().zip(&self.columns) {
                *value = column.kind.read(rest);
                rest = &rest[column.kind.size()..];
            }
            self.push(&row, &mut cloud);
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
            self.push(&row, &mut cloud);
        }
        Ok(cloud)
    }

    fn push(&self, row: &[f64], cloud: &mut PointCloud) {
        let color = match self.color {
            Color::None => GREY,
            // A cast saturates at 0 and 255.
            Color::Separate(places) => places.map(|place| row[place] as u8),
            Color::Packed(place) => {
                let bits = match self.columns[place].kind {
                    Kind::F32 => (row[place] as f32).to_bits(),
                    _ => row[place] as i64 as u32,
                };
                [16, 8, 0].map(|shift| (bits >> shift) as u8)
            }
        };
        cloud.push(self.position.map(|place| row[place] as f32), color);
    }
}
