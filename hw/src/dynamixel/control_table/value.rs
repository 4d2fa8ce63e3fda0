//! What items may contain, and in which unit.

use super::item::Item;

/// Kind of number that an item is, low byte first on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One byte.
    U8,
    /// Two bytes.
    U16,
    /// Four bytes.
    U32,
    /// One byte, two's complement.
    I8,
    /// Two bytes, two's complement.
    I16,
    /// Four bytes, two's complement.
    I32,
}

impl Kind {
    /// Bytes of a number.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 => 4,
        }
    }

    /// Whether numbers may be negative.
    pub const fn is_signed(self) -> bool {
        matches!(self, Self::I8 | Self::I16 | Self::I32)
    }

    /// The number in exactly [`size`](Self::size) bytes; `None` for another number of bytes.
    pub fn decode(self, bytes: &[u8]) -> Option<i64> {
        Some(match self {
            Self::U8 => u8::from_le_bytes(bytes.try_into().ok()?).into(),
            Self::U16 => u16::from_le_bytes(bytes.try_into().ok()?).into(),
            Self::U32 => u32::from_le_bytes(bytes.try_into().ok()?).into(),
            Self::I8 => i8::from_le_bytes(bytes.try_into().ok()?).into(),
            Self::I16 => i16::from_le_bytes(bytes.try_into().ok()?).into(),
            Self::I32 => i32::from_le_bytes(bytes.try_into().ok()?).into(),
        })
    }

    /// The first [`size`](Self::size) of the four bytes are the number; `None` where it does not fit.
    pub fn encode(self, value: i64) -> Option<[u8; 4]> {
        let wide = match self {
            Self::U8 => u8::try_from(value).ok()?.into(),
            Self::U16 => u16::try_from(value).ok()?.into(),
            Self::U32 => u32::try_from(value).ok()?,
            Self::I8 => i8::try_from(value).ok()?.cast_unsigned().into(),
            Self::I16 => i16::try_from(value).ok()?.cast_unsigned().into(),
            Self::I32 => i32::try_from(value).ok()?.cast_unsigned(),
        };
        Some(wide.to_le_bytes())
    }

    pub(super) fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "u8" => Self::U8,
            "u16" => Self::U16,
            "u32" => Self::U32,
            "i8" => Self::I8,
            "i16" => Self::I16,
            "i32" => Self::I32,
            _ => return None,
        })
    }
}

/// Who may change an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The servo.
    Read,
    /// Also its user.
    ReadWrite,
}

/// Memory that an item lies in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Area {
    /// Kept without power, and locked while torque is on.
    Eeprom,
    /// Lost without power.
    Ram,
}

impl Area {
    /// The first address of RAM.
    pub const RAM_START: u16 = 64;

    /// The memory at an address.
    pub const fn of(address: u16) -> Self {
        if address < Self::RAM_START {
            Self::Eeprom
        } else {
            Self::Ram
        }
    }
}

/// An end of the range of values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// Always this.
    Fixed(i64),
    /// What another item contains.
    Of(Item),
    /// The negative of what another item contains.
    MinusOf(Item),
}

impl Bound {
    pub(super) fn from_text(text: &str) -> Option<Self> {
        if let Ok(number) = text.parse() {
            return Some(Self::Fixed(number));
        }
        match text.strip_prefix('-') {
            Some(name) => Item::from_name(name).map(Self::MinusOf),
            None => Item::from_name(text).map(Self::Of),
        }
    }
}

/// What a value times its scale is counted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Nothing: a number, a choice, bits.
    None,
    /// Steps of the encoder.
    Tick,
    /// rad/s.
    RadianPerSecond,
    /// rad/s^2.
    RadianPerSecondSquared,
    /// A.
    Ampere,
    /// V.
    Volt,
    /// V/s.
    VoltPerSecond,
    /// Degrees Celsius.
    Celsius,
    /// s.
    Second,
    /// Fraction of the supply voltage.
    Fraction,
}

impl Unit {
    pub(super) fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "" => Self::None,
            "tick" => Self::Tick,
            "rad/s" => Self::RadianPerSecond,
            "rad/s2" => Self::RadianPerSecondSquared,
            "A" => Self::Ampere,
            "V" => Self::Volt,
            "V/s" => Self::VoltPerSecond,
            "degC" => Self::Celsius,
            "s" => Self::Second,
            "1" => Self::Fraction,
            _ => return None,
        })
    }
}
