//! Items of control tables, read and written by name.

use std::io;

use super::super::control_table::{ControlTable, Entry, Item};
use super::super::status::ErrorByte;
use super::{Bus, Span, line, line_again};
use crate::servo::{PerServo, ServoError, ServoId, for_those};
use crate::transport::Transport;

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
    pub(super) fn send_items(&mut self, item: Item, counts: &[(ServoId, i64)]) -> PerServo<()> {
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
    pub(super) fn send_quantities(
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
    pub(super) fn read_known<R>(
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
pub(super) fn count_of(
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
