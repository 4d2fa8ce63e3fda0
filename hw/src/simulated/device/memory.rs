//! The bytes of a control table, and which writes to them a servo accepts.

use crate::dynamixel::{
    Access, Area, Bound, ControlTable, Entry, Fault as Refusal, Item, Kind, Model,
};

/// Largest goal over several turns (ticks).
const FURTHEST: i64 = 1_048_575;
/// "Bus Watchdog" after it has stopped the servo.
pub(super) const TRIPPED: i64 = -1;

/// Numbers of "Operating Mode".
pub(super) mod mode {
    pub const CURRENT: i64 = 0;
    pub const VELOCITY: i64 = 1;
    pub const POSITION: i64 = 3;
    pub const EXTENDED_POSITION: i64 = 4;
    pub const CURRENT_BASED_POSITION: i64 = 5;
    pub const PWM: i64 = 16;
    pub const ALL: [i64; 6] = [
        CURRENT,
        VELOCITY,
        POSITION,
        EXTENDED_POSITION,
        CURRENT_BASED_POSITION,
        PWM,
    ];
}

/// A number that a write puts into the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Change {
    pub item: Item,
    pub value: i64,
    address: u16,
    kind: Kind,
}

/// The control table of one servo.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    table: &'static ControlTable,
    bytes: Vec<u8>,
}

impl Memory {
    /// As it leaves the factory.
    pub fn new(model: Model, firmware: u8) -> Self {
        let table = model.table(firmware);
        let mut memory = Self {
            table,
            bytes: vec![0; usize::from(table.end())],
        };
        for area in [Area::Eeprom, Area::Ram] {
            memory.restore(area);
        }
        memory.set(Item::ModelNumber, model.number().into());
        memory.set(Item::FirmwareVersion, firmware.into());
        memory
    }

    /// Brings an area to its first values. What has none becomes 0, and numbers of an item count up.
    pub fn restore(&mut self, area: Area) {
        for entry in self.table.entries() {
            let is_identity = matches!(entry.item, Item::ModelNumber | Item::FirmwareVersion);
            if entry.area() == area && !is_identity {
                let counts_up = i64::from(entry.item == Item::IndirectAddress);
                for index in 0..entry.count {
                    let initial = entry.initial.unwrap_or(0) + counts_up * i64::from(index);
                    self.put(element(entry, index), entry.kind, initial);
                }
            }
        }
    }

    /// Where an item lies, and what its values mean.
    pub fn entry(&self, item: Item) -> &'static Entry {
        self.table.entry(item)
    }

    /// An item's number; the first one where it has several.
    pub fn get(&self, item: Item) -> i64 {
        let entry = self.table.entry(item);
        self.number(entry.address, entry.kind)
    }

    /// An item's number in its unit.
    pub fn quantity(&self, item: Item) -> f64 {
        self.table.entry(item).quantity(self.get(item))
    }

    /// Sets an item to a number, or the nearest one that it can hold.
    pub fn set(&mut self, item: Item, value: i64) {
        let entry = self.table.entry(item);
        self.put(entry.address, entry.kind, value);
    }

    /// Sets an item to the number nearest to a quantity in its unit.
    pub fn set_quantity(&mut self, item: Item, quantity: f64) {
        let entry = self.table.entry(item);
        self.put(entry.address, entry.kind, entry.count_of(quantity));
    }

    /// The whole of an area.
    pub fn area(&self, area: Area) -> &[u8] {
        &self.bytes[self.extent(area)]
    }

    /// Sets the whole of an area to what another servo of this model had there.
    pub fn set_area(&mut self, area: Area, bytes: &[u8]) {
        let extent = self.extent(area);
        if bytes.len() == extent.len() {
            self.bytes[extent].copy_from_slice(bytes);
        }
    }

    /// Carries a change out.
    pub fn apply(&mut self, change: &Change) {
        self.put(change.address, change.kind, change.value);
    }

    /// Reads bytes, through indirect addresses where they are. Gaps between items read as 0.
    pub fn read(&self, address: u16, length: u16) -> Result<Vec<u8>, Refusal> {
        let end = usize::from(address) + usize::from(length);
        if end > self.bytes.len() {
            return Err(Refusal::Access);
        }
        if length == 0 {
            return Err(Refusal::DataLength);
        }
        let mut addresses = address..address + length;
        if !addresses.clone().any(|a| self.table.at(a).is_some()) {
            return Err(Refusal::Access);
        }
        Ok(addresses
            .by_ref()
            .map(|a| self.bytes[usize::from(self.target(a))])
            .collect())
    }

    /// What writing `data` at `address` changes, or why the servo refuses: then nothing changes.
    pub fn plan(&self, address: u16, data: &[u8]) -> Result<Vec<Change>, Refusal> {
        if usize::from(address) + data.len() > self.bytes.len() {
            return Err(Refusal::Access);
        }
        if data.is_empty() {
            return Err(Refusal::DataLength);
        }
        let targets: Vec<(u16, u8)> = (address..)
            .zip(data)
            .map(|(address, &byte)| (self.target(address), byte))
            .collect();
        let mut changes = Vec::new();
        let mut rest = targets.as_slice();
        while let Some(&(first, _)) = rest.first() {
            let entry = self.table.at(first).ok_or(Refusal::Access)?;
            let size = entry.size();
            if entry.access == Access::Read
                || (entry.area() == Area::Eeprom && self.get(Item::TorqueEnable) != 0)
            {
                return Err(Refusal::Access);
            }
            // The whole number must be there, in order, from its first byte on.
            let is_whole = (first - entry.address).is_multiple_of(size as u16)
                && rest.len() >= size
                && (first..).zip(&rest[..size]).all(|(a, &(b, _))| a == b);
            if !is_whole {
                return Err(Refusal::DataLength);
            }
            let bytes: Vec<u8> = rest[..size].iter().map(|&(_, byte)| byte).collect();
            let value = entry.kind.decode(&bytes).ok_or(Refusal::DataLength)?;
            self.check(entry, value)?;
            changes.push(Change {
                item: entry.item,
                value,
                address: first,
                kind: entry.kind,
            });
            rest = &rest[size..];
        }
        Ok(changes)
    }

    /// Whether a value is within an item's range.
    fn check(&self, entry: &Entry, value: i64) -> Result<(), Refusal> {
        let within = |range: std::ops::RangeInclusive<i64>| match range.contains(&value) {
            true => Ok(()),
            false => Err(Refusal::DataRange),
        };
        let is_goal = matches!(
            entry.item,
            Item::GoalPwm | Item::GoalCurrent | Item::GoalVelocity | Item::GoalPosition
        );
        let tripped = self.get(Item::BusWatchdog) == TRIPPED;
        match entry.item {
            _ if tripped && is_goal => Err(Refusal::DataRange),
            Item::BusWatchdog if tripped => within(0..=0),
            Item::OperatingMode if !mode::ALL.contains(&value) => Err(Refusal::DataRange),
            // Another protocol would end the conversation.
            Item::ProtocolType => within(2..=2),
            Item::GoalPosition if self.get(Item::OperatingMode) != mode::POSITION => {
                within(-FURTHEST..=FURTHEST)
            }
            _ => {
                let ends = [(entry.min, true), (entry.max, false)];
                for (bound, is_least) in ends {
                    let (end, refusal) = match bound {
                        None => continue,
                        Some(Bound::Fixed(end)) => (end, Refusal::DataRange),
                        Some(Bound::Of(item)) => (self.get(item), Refusal::DataLimit),
                        Some(Bound::MinusOf(item)) => (-self.get(item), Refusal::DataLimit),
                    };
                    let outside = if is_least { value < end } else { value > end };
                    if outside {
                        return Err(refusal);
                    }
                }
                Ok(())
            }
        }
    }

    /// Where the byte at `address` lies: elsewhere where it is an indirect one.
    fn target(&self, address: u16) -> u16 {
        let data = self.table.entry(Item::IndirectData);
        let addresses = self.table.entry(Item::IndirectAddress);
        let is_indirect = |address| (data.address..data.end()).contains(&address);
        if !is_indirect(address) {
            return address;
        }
        let pointer = element(addresses, address - data.address);
        // The range of these items is that of the table's addresses.
        u16::try_from(self.number(pointer, addresses.kind))
            .ok()
            .filter(|&target| usize::from(target) < self.bytes.len())
            .unwrap_or(address)
    }

    fn number(&self, address: u16, kind: Kind) -> i64 {
        let start = usize::from(address);
        let bytes = &self.bytes[start..start + kind.size()];
        kind.decode(bytes).unwrap_or_default()
    }

    fn put(&mut self, address: u16, kind: Kind, value: i64) {
        let [low, high] = match kind {
            Kind::U8 => [0, u8::MAX.into()],
            Kind::U16 => [0, u16::MAX.into()],
            Kind::U32 => [0, u32::MAX.into()],
            Kind::I8 => [i8::MIN.into(), i8::MAX.into()],
            Kind::I16 => [i16::MIN.into(), i16::MAX.into()],
            Kind::I32 => [i32::MIN.into(), i32::MAX.into()],
        };
        let bytes = kind.encode(value.clamp(low, high)).unwrap_or_default();
        let start = usize::from(address);
        self.bytes[start..start + kind.size()].copy_from_slice(&bytes[..kind.size()]);
    }

    fn extent(&self, area: Area) -> std::ops::Range<usize> {
        let start = usize::from(Area::RAM_START);
        match area {
            Area::Eeprom => 0..start,
            Area::Ram => start..self.bytes.len(),
        }
    }
}

/// Address of number `index` of an item.
fn element(entry: &Entry, index: u16) -> u16 {
    entry.address + index * entry.size() as u16
}
