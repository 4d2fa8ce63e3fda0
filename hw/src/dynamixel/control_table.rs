//! Control tables: what a servo's registers are called and where they lie.
//!
//! The tables are data: `tables/*.csv`, one row for each item. Addresses, sizes and units of velocity are those of the `.model`
//! files that the vendor's SDK ships, which `tests/python` checks entry by entry; access, first values, ranges and the other
//! units are those of the ROBOTIS e-Manual's pages of the three models. Up to firmware 52 there are 20 indirect bytes, with data
//! from 208 on; later ones have data from 224 on, after 28 addresses.

use std::sync::LazyLock;

/// Baud rates (bits per second) that "Baud Rate" numbers.
pub const BAUD_RATES: [u32; 7] = [
    9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000,
];

macro_rules! items {
    ($($(#[$doc:meta])* $item:ident = $name:literal,)*) => {
        /// An item of the control table.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Item {
            $($(#[$doc])* $item,)*
        }

        impl Item {
            /// All items, by address.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$item),*];

            /// The manufacturer's name.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$item => $name,)*
                }
            }
        }
    };
}

items! {
    /// Model number: see [`Model::number`].
    ModelNumber = "Model Number",
    /// Set by the manufacturer.
    ModelInformation = "Model Information",
    /// Version of the firmware.
    FirmwareVersion = "Firmware Version",
    /// Address on the bus.
    Id = "ID",
    /// Index into [`BAUD_RATES`].
    BaudRate = "Baud Rate",
    /// Time from an instruction to its status.
    ReturnDelayTime = "Return Delay Time",
    /// Bit 0: reversed; bit 2: profiles by time; bit 3: goals switch torque on.
    DriveMode = "Drive Mode",
    /// What goals mean.
    OperatingMode = "Operating Mode",
    /// Second address, for groups; none from 253 on.
    SecondaryId = "Secondary(Shadow) ID",
    /// 2 for Protocol 2.0.
    ProtocolType = "Protocol Type",
    /// Added to the position.
    HomingOffset = "Homing Offset",
    /// Speed from which on "Moving" is 1.
    MovingThreshold = "Moving Threshold",
    /// Overheating begins here.
    TemperatureLimit = "Temperature Limit",
    /// Largest supply voltage.
    MaxVoltageLimit = "Max Voltage Limit",
    /// Smallest supply voltage.
    MinVoltageLimit = "Min Voltage Limit",
    /// Largest duty cycle.
    PwmLimit = "PWM Limit",
    /// Largest current.
    CurrentLimit = "Current Limit",
    /// Largest speed of goals.
    VelocityLimit = "Velocity Limit",
    /// Largest goal within one turn.
    MaxPositionLimit = "Max Position Limit",
    /// Smallest goal within one turn.
    MinPositionLimit = "Min Position Limit",
    /// Bit 0: torque on at power-on; bit 1: RAM from the backup. For firmware 46 and newer.
    StartupConfiguration = "Startup Configuration",
    /// How fast the duty cycle changes.
    PwmSlope = "PWM Slope",
    /// Hardware errors that switch torque off, bit by bit as in "Hardware Error Status".
    Shutdown = "Shutdown",
    /// Whether the motor is driven. Locks the EEPROM.
    TorqueEnable = "Torque Enable",
    /// Lamp.
    Led = "LED",
    /// 0: only pings are answered; 1: also reads; 2: everything.
    StatusReturnLevel = "Status Return Level",
    /// Whether a write waits for "action".
    RegisteredInstruction = "Registered Instruction",
    /// Faults, bit by bit: see [`HardwareErrors`](crate::servo::HardwareErrors).
    HardwareErrorStatus = "Hardware Error Status",
    /// Gain of the velocity controller.
    VelocityIGain = "Velocity I Gain",
    /// Gain of the velocity controller.
    VelocityPGain = "Velocity P Gain",
    /// Gain of the position controller.
    PositionDGain = "Position D Gain",
    /// Gain of the position controller.
    PositionIGain = "Position I Gain",
    /// Gain of the position controller.
    PositionPGain = "Position P Gain",
    /// Gain of the acceleration of the profile.
    FeedforwardSecondGain = "Feedforward 2nd Gain",
    /// Gain of the velocity of the profile.
    FeedforwardFirstGain = "Feedforward 1st Gain",
    /// Silence after which the servo stops; 0: none; -1: it has stopped, and refuses goals until 0 is written.
    BusWatchdog = "Bus Watchdog",
    /// Goal, or bound, of the duty cycle.
    GoalPwm = "Goal PWM",
    /// Goal, or bound, of the current.
    GoalCurrent = "Goal Current",
    /// Goal of the velocity.
    GoalVelocity = "Goal Velocity",
    /// Acceleration of the profile (time, in ms, in profiles by time).
    ProfileAcceleration = "Profile Acceleration",
    /// Velocity of the profile (time, in ms, in profiles by time).
    ProfileVelocity = "Profile Velocity",
    /// Goal of the position; the range is that of one turn.
    GoalPosition = "Goal Position",
    /// Clock of the servo, which starts again at 32,768.
    RealtimeTick = "Realtime Tick",
    /// Whether it moves.
    Moving = "Moving",
    /// Bit 0: arrived; bit 1: a profile runs; bit 3: does not follow; bits 4 and 5: kind of profile.
    MovingStatus = "Moving Status",
    /// Duty cycle.
    PresentPwm = "Present PWM",
    /// Current.
    PresentCurrent = "Present Current",
    /// Velocity.
    PresentVelocity = "Present Velocity",
    /// Position.
    PresentPosition = "Present Position",
    /// Velocity that the profile asks for.
    VelocityTrajectory = "Velocity Trajectory",
    /// Position that the profile asks for.
    PositionTrajectory = "Position Trajectory",
    /// Supply voltage.
    PresentInputVoltage = "Present Input Voltage",
    /// Temperature inside.
    PresentTemperature = "Present Temperature",
    /// Whether a backup of the control table exists. For firmware 46 and newer.
    BackupReady = "Backup Ready",
    /// Addresses that "Indirect Data" stand for, one byte each. The first values count up.
    IndirectAddress = "Indirect Address",
    /// Bytes at those addresses, one behind the other.
    IndirectData = "Indirect Data",
}

impl Item {
    /// The item that the manufacturer calls so.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|item| item.name() == name)
    }
}

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

    fn from_name(name: &str) -> Option<Self> {
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
    fn from_text(text: &str) -> Option<Self> {
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
    fn from_name(name: &str) -> Option<Self> {
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

    /// The address behind the last item.
    pub fn end(&self) -> u16 {
        self.entry(Item::IndirectData).end()
    }

    /// The table of `firmware` in the text of a file; the error names the row.
    fn parse(text: &str, firmware: u8) -> Result<Self, String> {
        let mut entries = Vec::with_capacity(Item::ALL.len());
        for line in text.lines().skip(1) {
            let row: Vec<&str> = line.split(',').collect();
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
        include_str!("tables/xl330-m288.csv"),
        include_str!("tables/xc330-m288.csv"),
        include_str!("tables/xc330-t288.csv"),
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
        let text = include_str!("tables/xl330-m288.csv");
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
