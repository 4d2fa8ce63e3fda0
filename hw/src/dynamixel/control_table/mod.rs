//! Control tables: what a servo's registers are called and where they lie.
//!
//! The tables are data: `tables/*.csv`, one row for each item. Addresses, sizes and units of velocity are those of the `.model`
//! files that the vendor's SDK ships, which `tests/python` checks entry by entry; access, first values, ranges and the other
//! units are those of the ROBOTIS e-Manual's pages of the three models. Up to firmware 52 there are 20 indirect bytes, with data
//! from 208 on; later ones have data from 224 on, after 28 addresses.

mod item;
mod value;

use std::sync::LazyLock;

use tdcr_base::rows::Splitter;

pub use item::Item;
pub use value::{Access, Area, Bound, Kind, Unit};

/// Baud rates (bits per second) that "Baud Rate" numbers.
pub const BAUD_RATES: [u32; 7] = [
    9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000,
];

/// Where an item lies and what it may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// Which one.
    pub item: Item,
    /// Address of its first byte.
    pub address: u16,
    /// Its numbers.
    pub kind: Kind,
    /// How many numbers lie one behind the other: 1 but for the indirect items.
    pub count: u16,
    /// Who may change it.
    pub access: Access,
    /// First value: at the factory in EEPROM, at power-on in RAM. `None`: the manual states none.
    pub initial: Option<i64>,
    /// Smallest value.
    pub min: Option<Bound>,
    /// Largest value.
    pub max: Option<Bound>,
    /// What a value of 1 is, in `unit`.
    pub scale: f64,
    /// What it is counted in.
    pub unit: Unit,
}

impl Entry {
    /// Bytes of one number.
    pub const fn size(&self) -> usize {
        self.kind.size()
    }

    /// The memory that it lies in.
    pub const fn area(&self) -> Area {
        Area::of(self.address)
    }

    /// The address behind its last byte.
    pub fn end(&self) -> u16 {
        self.address + self.count * self.size() as u16
    }

    /// The number nearest to a quantity in [`unit`](Self::unit). What is not finite or does not fit becomes the nearest that
    /// does; NaN becomes 0.
    pub fn count_of(&self, quantity: f64) -> i64 {
        (quantity / self.scale).round() as i64
    }

    /// The quantity, in [`unit`](Self::unit), that a number stands for.
    pub fn quantity(&self, count: i64) -> f64 {
        count as f64 * self.scale
    }
}

/// A model of servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Model {
    /// XL330-M288-T, for 5 V.
    Xl330M288,
    /// XC330-M288-T, for 5 V, with metal gears.
    Xc330M288,
    /// XC330-T288-T, for 11.1 V, with metal gears.
    Xc330T288,
}

impl Model {
    /// All models.
    pub const ALL: [Self; 3] = [Self::Xl330M288, Self::Xc330M288, Self::Xc330T288];
    /// The last firmware whose indirect data begin at 208.
    pub const LAST_FIRMWARE_208: u8 = 52;

    /// The manufacturer's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Xl330M288 => "XL330-M288-T",
            Self::Xc330M288 => "XC330-M288-T",
            Self::Xc330T288 => "XC330-T288-T",
        }
    }

    /// What "Model Number" contains.
    pub const fn number(self) -> u16 {
        match self {
            Self::Xl330M288 => 1200,
            Self::Xc330M288 => 1240,
            Self::Xc330T288 => 1220,
        }
    }

    /// The model of that number.
    pub fn from_number(number: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|model| model.number() == number)
    }

    /// The control table of a version of the firmware.
    pub fn table(self, firmware: u8) -> &'static ControlTable {
        let [older, newer] = &TABLES[self as usize];
        if firmware <= Self::LAST_FIRMWARE_208 {
            older
        } else {
            newer
        }
    }
}

/// The items of one model and firmware.
#[derive(Clone, Debug)]
pub struct ControlTable {
    /// In the order of [`Item::ALL`].
    entries: [Entry; Item::ALL.len()],
}

impl ControlTable {
    /// Where an item lies.
    pub fn entry(&self, item: Item) -> &Entry {
        &self.entries[item as usize]
    }

    /// All items, by address.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// The item that has a byte at `address`; `None` in the gaps between items.
    pub fn at(&self, address: u16) -> Option<&Entry> {
        self.entries
            .iter()
            .find(|entry| (entry.address..entry.end()).contains(&address))
    }

    /// The addresses and lengths of items that lie one behind the other without a gap.
    pub fn pieces(&self) -> Vec<(u16, u16)> {
        let mut pieces: Vec<(u16, u16)> = Vec::new();
        for entry in &self.entries {
            match pieces.last_mut() {
                Some((address, length)) if *address + *length == entry.address => {
                    *length = entry.end() - *address;
                }
                _ => pieces.push((entry.address, entry.end() - entry.address)),
            }
        }
        pieces
    }

    /// The address behind the last item.
    pub fn end(&self) -> u16 {
        self.entry(Item::IndirectData).end()
    }

    /// The table of `firmware` in the text of a file; the error names the row.
    fn parse(text: &str, firmware: u8) -> Result<Self, String> {
        let mut entries = Vec::with_capacity(Item::ALL.len());
        let mut splitter = Splitter::new(b',');
        for line in text.lines().skip(1) {
            let row = splitter.cells(line);
            let row: Vec<&str> = row.iter().map(String::as_str).collect();
            let &[
                address,
                kind,
                name,
                count,
                access,
                initial,
                min,
                max,
                scale,
                unit,
                versions,
            ] = row.as_slice()
            else {
                return Err(line.to_owned());
            };
            let applies = match versions.split_once("..") {
                None => true,
                Some(("", last)) => last.parse().is_ok_and(|last: u8| firmware <= last),
                Some((first, _)) => first.parse().is_ok_and(|first: u8| firmware >= first),
            };
            if !applies {
                continue;
            }
            let bound = |text: &str| {
                (!text.is_empty())
                    .then(|| Bound::from_text(text).ok_or(()))
                    .transpose()
            };
            let entry = || {
                Some(Entry {
                    item: Item::from_name(name)?,
                    address: address.parse().ok()?,
                    kind: Kind::from_name(kind)?,
                    count: count.parse().ok()?,
                    access: match access {
                        "r" => Access::Read,
                        "rw" => Access::ReadWrite,
                        _ => return None,
                    },
                    initial: (!initial.is_empty())
                        .then(|| initial.parse())
                        .transpose()
                        .ok()?,
                    min: bound(min).ok()?,
                    max: bound(max).ok()?,
                    scale: scale.parse().ok()?,
                    unit: Unit::from_name(unit)?,
                })
            };
            entries.push(entry().ok_or(line)?);
        }
        let complete = entries.iter().map(|entry| entry.item).eq(Item::ALL);
        let entries = entries.try_into().map_err(|_| "some rows are missing")?;
        complete
            .then_some(Self { entries })
            .ok_or_else(|| "the rows are not in the order of the items".to_owned())
    }
}

/// By the model and the layout, older one first.
static TABLES: LazyLock<[[ControlTable; 2]; Model::ALL.len()]> = LazyLock::new(|| {
    [
        include_str!("../tables/xl330-m288.csv"),
        include_str!("../tables/xc330-m288.csv"),
        include_str!("../tables/xc330-t288.csv"),
    ]
    .map(|text| {
        let last = Model::LAST_FIRMWARE_208;
        // The files are part of the program, and a test reads each.
        [last, last + 1].map(|firmware| ControlTable::parse(text, firmware).expect("a table"))
    })
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_lie_one_behind_the_other_and_are_found_by_each_of_their_addresses() {
        for model in Model::ALL {
            for firmware in [46, 52, 53, 60] {
                let table = model.table(firmware);
                let mut end = 0;
                for entry in table.entries() {
                    assert!(entry.address >= end, "{}", entry.item.name());
                    end = entry.end();
                    for address in entry.address..end {
                        assert_eq!(table.at(address), Some(entry));
                    }
                }
                assert_eq!(table.end(), end);
                assert_eq!(table.at(end), None);
                assert_eq!(table.at(14), None);
            }
        }
    }

    #[test]
    fn first_values_and_fixed_bounds_fit_their_items() {
        for table in TABLES.iter().flatten() {
            for entry in table.entries() {
                let name = entry.item.name();
                if let Some(initial) = entry.initial {
                    assert!(entry.kind.encode(initial).is_some(), "{name}");
                    if let Some(Bound::Fixed(min)) = entry.min {
                        assert!(min <= initial, "{name}");
                    }
                    if let Some(Bound::Fixed(max)) = entry.max {
                        assert!(initial <= max, "{name}");
                    }
                }
                assert_eq!(entry.min.is_some(), entry.max.is_some(), "{name}");
            }
        }
    }

    #[test]
    fn indirect_data_move_after_firmware_52() {
        for model in Model::ALL {
            assert_eq!(model.table(52).entry(Item::IndirectData).address, 208);
            assert_eq!(model.table(53).entry(Item::IndirectData).address, 224);
        }
    }

    #[test]
    fn a_damaged_table_is_refused() {
        let text = include_str!("../tables/xl330-m288.csv");
        for (from, to) in [
            ("i32,Goal", "i33,Goal"),
            ("Goal PWM,", "Goal MWP,"),
            ("-PWM Limit", "-PWM Limits"),
            (",rw,885", ",w,885"),
            ("\n147,u8,Backup Ready,1,r,,0,1,1,,", ""),
            ("\n65,u8,LED,1,rw,0,0,1,1,,", "\n65,u8,LED"),
        ] {
            let damaged = text.replace(from, to);
            assert_ne!(damaged, text, "{from}");
            assert!(ControlTable::parse(&damaged, 46).is_err(), "{from}");
        }
    }

    #[test]
    fn numbers_survive_the_wire_and_others_are_refused() {
        for (kind, numbers) in [
            (Kind::U8, [0, 255]),
            (Kind::I8, [-128, 127]),
            (Kind::U16, [0, 65_535]),
            (Kind::I16, [-32_768, 32_767]),
            (Kind::U32, [0, 4_294_967_295]),
            (Kind::I32, [-2_147_483_648, 2_147_483_647]),
        ] {
            let [min, max] = numbers;
            for number in numbers {
                let bytes = kind.encode(number).expect("it fits");
                assert_eq!(kind.decode(&bytes[..kind.size()]), Some(number));
            }
            assert_eq!(kind.encode(min - 1), None);
            assert_eq!(kind.encode(max + 1), None);
            assert_eq!(kind.decode(&[0; 3]), None);
        }
    }
}
