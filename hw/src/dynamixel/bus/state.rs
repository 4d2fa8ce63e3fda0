//! All that a servo says of itself, in one read: by its indirect addresses.

use std::time::Duration;

use super::super::control_table::{ControlTable, Item};
use super::{Bus, Span};
use crate::servo::{
    HardwareErrors, PerServo, ServoError, ServoId, Ticks, WatchdogState, for_those,
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

/// Values of [`BLOCK`].
pub(super) struct Block {
    pub position: Ticks,
    /// rad/s.
    pub velocity: f64,
    /// A.
    pub current: f64,
    /// V.
    pub voltage: f64,
    /// Degrees Celsius.
    pub temperature: f64,
    pub errors: HardwareErrors,
    pub watchdog: WatchdogState,
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
pub(super) fn ticks(count: i64) -> Ticks {
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

pub(super) fn watchdog_state(count: i64) -> WatchdogState {
    match u32::try_from(count) {
        Err(_) => WatchdogState::Tripped,
        Ok(0) => WatchdogState::Off,
        Ok(count) => WatchdogState::Armed(Duration::from_millis(20) * count),
    }
}

impl<T: Transport> Bus<T> {
    /// One read of all that servos say of themselves.
    pub(super) fn blocks(&mut self, ids: &[ServoId]) -> PerServo<Block> {
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
    pub(super) fn set_up_block(&mut self, id: ServoId) -> Result<(), ServoError> {
        let known = *self.meet(id)?;
        if !known.has_block {
            let table = known.table();
            let address = table.entry(Item::IndirectAddress).address;
            self.write(id, address, &Block::addresses(table))?;
            self.meet(id)?.has_block = true;
        }
        Ok(())
    }
}
