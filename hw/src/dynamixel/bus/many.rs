//! Several servos: one read of all, and of those again that it missed.

use std::io;
use std::ops::ControlFlow;
use std::time::Duration;

use super::super::frame::{MAX_LENGTH, PacketId};
use super::super::instruction::{Answers, Instruction};
use super::super::joined::length_field;
use super::super::line::EMPTY_STATUS;
use super::super::status::ErrorByte;
use super::{Bus, Span, line_again};
use crate::servo::{PerServo, ServoError};
use crate::transport::Transport;

/// The first firmware that answers fast reads.
const FIRST_FAST_FIRMWARE: u8 = 46;
/// Parameters besides rows, and some rows' stuffing.
pub(super) const ROOM_FOR_STUFFING: usize = 64;

impl<T: Transport> Bus<T> {
    /// Reads of several servos. First all in one exchange; those that were missed in another, each with a status of its own; at
    /// last one by one, since servos wait for the answer of the one before.
    pub(super) fn gather<R>(
        &mut self,
        spans: &[Span],
        mut parse: impl FnMut(usize, ErrorByte, &[u8]) -> Result<R, ServoError>,
    ) -> PerServo<R> {
        let mut results: Vec<Option<Result<R, ServoError>>> = spans.iter().map(|_| None).collect();
        let mut missing: Vec<usize> = (0..spans.len()).collect();
        missing.sort_by_key(|&index| self.silent.contains(&spans[index].id));
        let is_fast = |span: &Span| {
            let known = self.servos.get(&span.id);
            known.is_some_and(|known| known.firmware >= FIRST_FAST_FIRMWARE)
        };
        let joined = self.settings.answers == Answers::Fast && spans.iter().all(is_fast);
        let rounds: &[Answers] = if joined {
            &[Answers::Fast, Answers::Each]
        } else {
            &[Answers::Each]
        };
        for (round, &answers) in (0..).zip(rounds) {
            // One by one where it is one, and where all that are left were silent before.
            if missing.len() < 2
                || missing
                    .iter()
                    .all(|&index| self.silent.contains(&spans[index].id))
            {
                break;
            }
            self.pause_before(round);
            for chunk in chunks(spans, &missing, answers) {
                let exchanged = self.exchange(spans, chunk, answers, |index, error, data| {
                    results[index].get_or_insert_with(|| parse(index, error, data));
                });
                if let Err(error) = exchanged {
                    return spans.iter().map(|_| Err(line_again(&error))).collect();
                }
            }
            missing.retain(|&index| results[index].is_none());
        }
        for index in missing {
            let Span {
                id,
                address,
                length,
            } = spans[index];
            let attempts = if self.silent.contains(&id) {
                1
            } else {
                self.settings.attempts
            };
            let read = self.read_with(id, address, length, attempts, |error, data| {
                parse(index, error, data)
            });
            results[index] = Some(read.and_then(|parsed| parsed));
        }
        let servos = spans.iter().zip(results);
        servos
            .map(|(span, result)| result.unwrap_or(Err(ServoError::Unknown { id: span.id })))
            .collect()
    }

    /// One read of several servos, and the answers to it that have no fault.
    fn exchange(
        &mut self,
        spans: &[Span],
        chunk: &[usize],
        answers: Answers,
        mut take: impl FnMut(usize, ErrorByte, &[u8]),
    ) -> io::Result<()> {
        let asked: Vec<Span> = chunk.iter().map(|&index| spans[index]).collect();
        let Some(&Span {
            address, length, ..
        }) = asked.first()
        else {
            return Ok(());
        };
        let same = asked
            .iter()
            .all(|span| (span.address, span.length) == (address, length));
        let mut rows = Vec::with_capacity(5 * asked.len());
        for span in &asked {
            rows.push(span.id.get());
            if !same {
                rows.extend_from_slice(&span.address.to_le_bytes());
                rows.extend_from_slice(&span.length.to_le_bytes());
            }
        }
        let instruction = if same {
            Instruction::SyncRead {
                answers,
                address,
                length,
                ids: &rows,
            }
        } else {
            Instruction::BulkRead {
                answers,
                rows: &rows,
            }
        };
        let sent = self.line.send(PacketId::Broadcast, instruction)?;
        let delays: Duration = asked.iter().map(|span| self.return_delay(span.id)).sum();
        let bytes: usize = asked
            .iter()
            .map(|span| EMPTY_STATUS + usize::from(span.length))
            .sum();
        let deadline = self.line.deadline(sent, delays, bytes);
        let position = |id| asked.iter().position(|span| span.id == id);
        match answers {
            Answers::Fast => {
                let sizes: Vec<_> = asked
                    .iter()
                    .map(|span| (span.id, span.length.into()))
                    .collect();
                self.line.listen_joined(&sizes, deadline, |section| {
                    if let Some(at) = position(section.id)
                        && section.error.fault().is_none()
                    {
                        take(chunk[at], section.error, section.data);
                    }
                })?;
            }
            Answers::Each => {
                let mut left = asked.len();
                self.line.listen(deadline, |status| {
                    if let PacketId::Servo(id) = status.id
                        && let Some(at) = position(id)
                        && status.error.fault().is_none()
                        && status.parameters.len() == usize::from(asked[at].length)
                    {
                        take(chunk[at], status.error, status.parameters);
                        left -= 1;
                    }
                    if left == 0 {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                })?;
            }
        }
        Ok(())
    }
}

/// Splits servos so that neither the instruction nor a joined answer is too long for a frame.
fn chunks<'a>(
    spans: &[Span],
    missing: &'a [usize],
    answers: Answers,
) -> impl Iterator<Item = &'a [usize]> {
    let longest = missing
        .iter()
        .map(|&index| usize::from(spans[index].length))
        .max();
    let longest = longest.unwrap_or_default();
    let row = match answers {
        Answers::Each => 5,
        Answers::Fast => length_field([longest]).max(5),
    };
    missing.chunks(((MAX_LENGTH - ROOM_FOR_STUFFING) / row).max(1))
}
