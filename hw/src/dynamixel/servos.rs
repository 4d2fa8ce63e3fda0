//! What servos can do, as the traits of [`servo`](crate::servo) have it.

use std::io;
use std::time::Duration;

use super::bus::{Bus, Span, line, line_again};
use super::control_table::{ControlTable, Entry, Item};
use super::status::ErrorByte;
use crate::servo::{
    CurrentGoals, CurrentLimits, Fault, HardwareErrors, Health, Identity, Modes, OperatingMode,
    PerServo, Ping, PositionGoals, Present, PresentState, ServoError, ServoId, Ticks, Torque,
    TorqueSwitch, Watchdog, WatchdogState, for_those,
};
use crate::transport::Transport;

/// What one read of a servo brings: these items lie one behind the other in its indirect data.
const BLOCK: [Item; 7] = [
    Item::PresentPosition,
    Item::PresentVelocity,
    Item::PresentCurrent,
    Item::PresentInputVoltage,
    Item::PresentTemperature,
    Item::HardwareErrorStatus,
    Item::BusWatchdog,
];

/// How far (ticks) a servo's goal may be from its position when its torque goes on: a servo may take its position, which
/// trembles, for its goal by itself.
const HOLD_WITHIN: u32 = 16;

/// Values of [`BLOCK`].
struct Block {
    position: Ticks,
    /// rad/s.
    velocity: f64,
    /// A.
    current: f64,
    /// V.
    voltage: f64,
    /// Degrees Celsius.
    temperature: f64,
    errors: HardwareErrors,
    watchdog: WatchdogState,
}

impl Block {
    /// Where it lies.
    fn span(id: ServoId, table: &ControlTable) -> Span {
        let sizes = BLOCK.iter().map(|&item| table.entry(item).size() as u16);
        Span {
            id,
            address: table.entry(Item::IndirectData).address,
            length: sizes.sum(),
        }
    }

    /// The addresses of its bytes, as "Indirect Address" takes them.
    fn addresses(table: &ControlTable) -> Vec<u8> {
        let entries = BLOCK.iter().map(|&item| table.entry(item));
        let addresses = entries.flat_map(|entry| entry.address..entry.end());
        addresses.flat_map(u16::to_le_bytes).collect()
    }

    /// `None` where the bytes are of another length.
    fn decode(table: &ControlTable, mut bytes: &[u8]) -> Option<Self> {
        let mut counts = [0; BLOCK.len()];
        for (count, item) in counts.iter_mut().zip(BLOCK) {
            let kind = table.entry(item).kind;
            let (number, rest) = bytes.split_at_checked(kind.size())?;
            *count = kind.decode(number)?;
            bytes = rest;
        }
        let [
            position,
            velocity,
            current,
            voltage,
            temperature,
            errors,
            watchdog,
        ] = counts;
        let quantity = |item, count| table.entry(item).quantity(count);
        Some(Self {
            position: ticks(position),
            velocity: quantity(Item::PresentVelocity, velocity),
            current: quantity(Item::PresentCurrent, current),
            voltage: quantity(Item::PresentInputVoltage, voltage),
            temperature: quantity(Item::PresentTemperature, temperature),
            errors: hardware_errors(errors),
            watchdog: watchdog_state(watchdog),
        })
    }
}

/// A count of a four-byte item.
fn ticks(count: i64) -> Ticks {
    Ticks(count.clamp(i32::MIN.into(), i32::MAX.into()) as i32)
}

/// The bits of "Hardware Error Status" (e-Manual, "Shutdown").
fn hardware_errors(bits: i64) -> HardwareErrors {
    let bit = |bit: u32| bits >> bit & 1 == 1;
    HardwareErrors {
        input_voltage: bit(0),
        overheating: bit(2),
        encoder: bit(3),
        electrical_shock: bit(4),
        overload: bit(5),
    }
}

fn watchdog_state(count: i64) -> WatchdogState {
    match u32::try_from(count) {
        Err(_) => WatchdogState::Tripped,
        Ok(0) => WatchdogState::Off,
        Ok(count) => WatchdogState::Armed(Duration::from_millis(20) * count),
    }
}

/// The number of a mode (e-Manual, "Operating Mode").
const fn mode_number(mode: OperatingMode) -> i64 {
    match mode {
        OperatingMode::Current => 0,
        OperatingMode::Velocity => 1,
        OperatingMode::Position => 3,
        OperatingMode::ExtendedPosition => 4,
        OperatingMode::CurrentBasedPosition => 5,
        OperatingMode::Pwm => 16,
    }
}

const MODES: [OperatingMode; 6] = [
    OperatingMode::Current,
    OperatingMode::Velocity,
    OperatingMode::Position,
    OperatingMode::ExtendedPosition,
    OperatingMode::CurrentBasedPosition,
    OperatingMode::Pwm,
];

fn torque_of(id: ServoId, count: i64) -> Result<Torque, ServoError> {
    match count {
        0 => Ok(Torque::Off),
        1 => Ok(Torque::On),
        _ => Err(ServoError::Damaged { id }),
    }
}

impl<T: Transport> Bus<T> {
    /// Reads an item of several servos: the first number of those that have many. Each servo is named once.
    pub fn read_items(&mut self, ids: &[ServoId], item: Item) -> PerServo<i64> {
        let span = |id, table: &ControlTable| {
            let entry = table.entry(item);
            Span {
                id,
                address: entry.address,
                length: entry.size() as u16,
            }
        };
        self.read_known(ids, span, |table, data| table.entry(item).kind.decode(data))
    }

    /// Writes an item of one servo, and waits until that is acknowledged.
    ///
    /// # Errors
    /// [`ServoError`].
    pub fn write_item(
        &mut self,
        id: ServoId,
        item: Item,
        count: i64,
    ) -> Result<ErrorByte, ServoError> {
        let entry = self.meet(id)?.table().entry(item);
        let bytes = encode(id, entry, count)?;
        self.write(id, entry.address, &bytes[..entry.size()])
    }

    /// Writes an item of several servos at once. `Ok` says that it was sent.
    fn send_items(&mut self, item: Item, counts: &[(ServoId, i64)]) -> PerServo<()> {
        let mut address = None;
        let rows: Vec<_> = counts
            .iter()
            .map(|&(id, count)| {
                let entry = self.meet(id)?.table().entry(item);
                // It is the same for all models: only the indirect items move.
                address = Some((entry.address, entry.size()));
                Ok((id, encode(id, entry, count)?))
            })
            .collect();
        let Some((address, size)) = address else {
            return for_those(rows, |_| Vec::new());
        };
        for_those(rows, |rows| {
            let rows: Vec<_> = rows
                .iter()
                .map(|(id, bytes)| (*id, &bytes[..size]))
                .collect();
            let sent = self.sync_write(address, size as u16, &rows);
            rows.iter().map(|_| again(&sent)).collect()
        })
    }

    /// Sends quantities, in the item's unit, to several servos at once.
    fn send_quantities(
        &mut self,
        item: Item,
        quantity: &'static str,
        values: &[(ServoId, f64)],
    ) -> PerServo<()> {
        let counts: Vec<_> = values
            .iter()
            .map(|&(id, value)| {
                let entry = self.meet(id)?.table().entry(item);
                Ok((id, count_of(id, entry, quantity, value)?))
            })
            .collect();
        for_those(counts, |counts| self.send_items(item, counts))
    }

    /// Reads of servos that are met first where they are not known.
    fn read_known<R>(
        &mut self,
        ids: &[ServoId],
        span: impl Fn(ServoId, &ControlTable) -> Span,
        decode: impl Fn(&ControlTable, &[u8]) -> Option<R>,
    ) -> PerServo<R> {
        let met: Vec<_> = ids
            .iter()
            .map(|&id| {
                let table = self.meet(id)?.table();
                Ok((span(id, table), table))
            })
            .collect();
        for_those(met, |met| {
            let spans: Vec<Span> = met.iter().map(|&(span, _)| span).collect();
            self.gather(&spans, |at, _, data| {
                let (Span { id, length, .. }, table) = met[at];
                decode(table, data).ok_or(ServoError::WrongLength {
                    id,
                    expected: length.into(),
                    found: data.len(),
                })
            })
        })
    }

    /// One read of all that servos say of themselves.
    fn blocks(&mut self, ids: &[ServoId]) -> PerServo<Block> {
        let ready: Vec<_> = ids
            .iter()
            .map(|&id| self.set_up_block(id).map(|()| id))
            .collect();
        let blocks = for_those(ready, |ids| {
            self.read_known(ids, Block::span, Block::decode)
        });
        let blocks = ids.iter().zip(blocks);
        blocks
            .map(|(&id, block)| {
                let block = block?;
                // No supply is 0 V: the indirect addresses are those of power-on.
                if block.voltage == 0.0 {
                    self.servos.remove(&id);
                    return Err(ServoError::Restarted { id });
                }
                self.meet(id)?.tripped = block.watchdog == WatchdogState::Tripped;
                Ok(block)
            })
            .collect()
    }

    /// Points a servo's indirect addresses at the items of [`BLOCK`].
    fn set_up_block(&mut self, id: ServoId) -> Result<(), ServoError> {
        let known = *self.meet(id)?;
        if !known.has_block {
            let table = known.table();
            let address = table.entry(Item::IndirectAddress).address;
            self.write(id, address, &Block::addresses(table))?;
            self.meet(id)?.has_block = true;
        }
        Ok(())
    }

    /// Makes the goals of servos their positions, where their mode has positions for goals.
    fn hold(&mut self, ids: &[ServoId]) -> PerServo<()> {
        let modes = self.mode(ids);
        let blocks = self.blocks(ids);
        let servos = ids.iter().zip(modes).zip(blocks);
        let goals: Vec<_> = servos
            .map(|((&id, mode), block)| {
                let (mode, block) = (mode?, block?);
                if !block.errors.is_empty() {
                    let errors = block.errors;
                    return Err(ServoError::Hardware { id, errors });
                }
                if block.watchdog == WatchdogState::Tripped {
                    return Err(ServoError::WatchdogTripped { id });
                }
                Ok((id, goal_at(mode, block.position)))
            })
            .collect();
        for_those(goals, |goals| {
            let held = goals.iter().filter_map(|&(id, goal)| Some((id, goal?)));
            let held: Vec<(ServoId, Ticks)> = held.collect();
            let mut sent = self.set_goal_positions(&held).into_iter();
            let ids: Vec<_> = held.iter().map(|&(id, _)| id).collect();
            let mut found = self.goal_positions(&ids).into_iter();
            goals
                .iter()
                .map(|&(id, goal)| {
                    let Some(goal) = goal else { return Ok(()) };
                    let (sent, found) = (sent.next(), found.next());
                    sent.unwrap_or(Err(ServoError::Unknown { id }))?;
                    let found = found.unwrap_or(Err(ServoError::Unknown { id }))?;
                    if found.0.abs_diff(goal.0) <= HOLD_WITHIN {
                        return Ok(());
                    }
                    Err(ServoError::Refused {
                        id,
                        action: "take its position for its goal".to_owned(),
                        fault: Fault::Result,
                    })
                })
                .collect()
        })
    }
}

/// The goal that keeps a servo where it is.
fn goal_at(mode: OperatingMode, position: Ticks) -> Option<Ticks> {
    match mode {
        OperatingMode::ExtendedPosition | OperatingMode::CurrentBasedPosition => Some(position),
        // It forgets its turns when its torque goes on.
        OperatingMode::Position => Some(Ticks(position.0.rem_euclid(Ticks::PER_TURN))),
        OperatingMode::Current | OperatingMode::Velocity | OperatingMode::Pwm => None,
    }
}

fn encode(id: ServoId, entry: &Entry, count: i64) -> Result<[u8; 4], ServoError> {
    let bits = 8 * entry.size() as i32;
    entry.kind.encode(count).ok_or(ServoError::OutOfRange {
        id,
        quantity: entry.item.name(),
        value: count as f64,
        min: if entry.kind.is_signed() {
            -(2_f64.powi(bits - 1))
        } else {
            0.0
        },
        max: 2_f64.powi(bits - i32::from(entry.kind.is_signed())) - 1.0,
    })
}

/// A quantity as a count that fits the item.
fn count_of(
    id: ServoId,
    entry: &Entry,
    quantity: &'static str,
    value: f64,
) -> Result<i64, ServoError> {
    let count = entry.count_of(value);
    let fits = value.is_finite() && entry.kind.encode(count).is_some();
    let bits = 8 * entry.size() as i32 - i32::from(entry.kind.is_signed());
    let most = (2_f64.powi(bits) - 1.0) * entry.scale;
    let out_of_range = || ServoError::OutOfRange {
        id,
        quantity,
        value,
        min: if entry.kind.is_signed() { -most } else { 0.0 },
        max: most,
    };
    if fits { Ok(count) } else { Err(out_of_range()) }
}

/// The same result once more.
fn again(result: &Result<(), ServoError>) -> Result<(), ServoError> {
    match result {
        Ok(()) => Ok(()),
        Err(ServoError::Line { source }) => Err(line_again(source)),
        Err(other) => Err(line(io::Error::other(other.to_string()))),
    }
}

impl<T: Transport> Ping for Bus<T> {
    fn ping(&mut self, id: ServoId) -> Result<Identity, ServoError> {
        self.ping_one(id, self.attempts_for(id))
    }

    fn scan(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError> {
        self.ping_all()
    }
}

impl<T: Transport> TorqueSwitch for Bus<T> {
    /// A servo whose torque goes on gets its position for its goal first, so that it does not jump.
    fn set_torque(&mut self, ids: &[ServoId], torque: Torque) -> PerServo<()> {
        let ready = match torque {
            Torque::Off => ids.iter().map(|_| Ok(())).collect(),
            Torque::On => self.hold(ids),
        };
        let ready = ids.iter().zip(ready).map(|(&id, ready)| ready.map(|()| id));
        let count = i64::from(torque == Torque::On);
        for_those(ready, |ids| {
            let counts: Vec<_> = ids.iter().map(|&id| (id, count)).collect();
            let sent = self.send_items(Item::TorqueEnable, &counts);
            // Nobody has acknowledged it.
            let found = self.torque(ids);
            let servos = ids.iter().zip(sent).zip(found);
            servos
                .map(|((&id, sent), found)| {
                    if sent.is_ok() && matches!(found, Ok(found) if found == torque) {
                        return Ok(());
                    }
                    self.write_item(id, Item::TorqueEnable, count).map(drop)
                })
                .collect()
        })
    }

    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque> {
        let counts = ids.iter().zip(self.read_items(ids, Item::TorqueEnable));
        counts.map(|(&id, count)| torque_of(id, count?)).collect()
    }
}

impl<T: Transport> Modes for Bus<T> {
    fn set_mode(&mut self, ids: &[ServoId], mode: OperatingMode) -> PerServo<()> {
        let number = mode_number(mode);
        ids.iter()
            .map(|&id| self.write_item(id, Item::OperatingMode, number).map(drop))
            .collect()
    }

    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode> {
        let numbers = ids.iter().zip(self.read_items(ids, Item::OperatingMode));
        numbers
            .map(|(&id, number)| {
                let number = number?;
                let mode = MODES.into_iter().find(|&mode| mode_number(mode) == number);
                mode.ok_or(ServoError::Damaged { id })
            })
            .collect()
    }
}

impl<T: Transport> PositionGoals for Bus<T> {
    fn set_goal_positions(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()> {
        let counts: Vec<_> = goals
            .iter()
            .map(|&(id, goal)| match self.meet(id)?.tripped {
                true => Err(ServoError::WatchdogTripped { id }),
                false => Ok((id, i64::from(goal.0))),
            })
            .collect();
        for_those(counts, |counts| self.send_items(Item::GoalPosition, counts))
    }

    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks> {
        let counts = self.read_items(ids, Item::GoalPosition).into_iter();
        counts.map(|count| count.map(ticks)).collect()
    }
}

impl<T: Transport> CurrentGoals for Bus<T> {
    fn set_goal_currents(&mut self, goals: &[(ServoId, f64)]) -> PerServo<()> {
        let goals: Vec<_> = goals
            .iter()
            .map(|&(id, goal)| match self.meet(id)?.tripped {
                true => Err(ServoError::WatchdogTripped { id }),
                false => Ok((id, goal)),
            })
            .collect();
        for_those(goals, |goals| {
            self.send_quantities(Item::GoalCurrent, "goal current in A", goals)
        })
    }
}

impl<T: Transport> CurrentLimits for Bus<T> {
    fn set_current_limits(&mut self, limits: &[(ServoId, f64)]) -> PerServo<()> {
        limits
            .iter()
            .map(|&(id, limit)| {
                let entry = self.meet(id)?.table().entry(Item::CurrentLimit);
                let count = count_of(id, entry, "current limit in A", limit)?;
                self.write_item(id, Item::CurrentLimit, count).map(drop)
            })
            .collect()
    }

    fn current_limits(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let counts = ids.iter().zip(self.read_items(ids, Item::CurrentLimit));
        counts
            .map(|(&id, count)| {
                let count = count?;
                Ok(self
                    .meet(id)?
                    .table()
                    .entry(Item::CurrentLimit)
                    .quantity(count))
            })
            .collect()
    }
}

impl<T: Transport> PresentState for Bus<T> {
    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present> {
        let blocks = self.blocks(ids).into_iter();
        blocks
            .map(|block| {
                block.map(|block| Present {
                    position: block.position,
                    velocity: block.velocity,
                    current: block.current,
                    errors: block.errors,
                })
            })
            .collect()
    }
}

impl<T: Transport> Health for Bus<T> {
    fn temperatures(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let blocks = self.blocks(ids).into_iter();
        blocks
            .map(|block| block.map(|block| block.temperature))
            .collect()
    }

    fn voltages(&mut self, ids: &[ServoId]) -> PerServo<f64> {
        let blocks = self.blocks(ids).into_iter();
        blocks
            .map(|block| block.map(|block| block.voltage))
            .collect()
    }

    fn hardware_errors(&mut self, ids: &[ServoId]) -> PerServo<HardwareErrors> {
        let blocks = self.blocks(ids).into_iter();
        blocks
            .map(|block| block.map(|block| block.errors))
            .collect()
    }

    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError> {
        self.restart(id)
    }
}

impl<T: Transport> Watchdog for Bus<T> {
    fn set_watchdog(&mut self, ids: &[ServoId], timeout: Option<Duration>) -> PerServo<()> {
        ids.iter()
            .map(|&id| {
                let entry = self.meet(id)?.table().entry(Item::BusWatchdog);
                let seconds = timeout.map_or(0.0, |timeout| timeout.as_secs_f64());
                // Upwards, and never to 0, which is none.
                let count = (seconds / entry.scale - 1e-9).ceil().max(1.0);
                let most = f64::from(i8::MAX);
                if count > most {
                    return Err(ServoError::OutOfRange {
                        id,
                        quantity: "watchdog in s",
                        value: seconds,
                        min: entry.scale,
                        max: most * entry.scale,
                    });
                }
                // 0 resets one that has tripped.
                self.write_item(id, Item::BusWatchdog, 0)?;
                self.meet(id)?.tripped = false;
                if timeout.is_some() {
                    self.write_item(id, Item::BusWatchdog, count as i64)?;
                }
                Ok(())
            })
            .collect()
    }

    fn watchdog(&mut self, ids: &[ServoId]) -> PerServo<WatchdogState> {
        let counts = self.read_items(ids, Item::BusWatchdog).into_iter();
        counts.map(|count| count.map(watchdog_state)).collect()
    }
}
