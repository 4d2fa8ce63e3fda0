//! One servo: an instruction, its answer, and attempts until there is one.

use std::ops::ControlFlow;
use std::time::Duration;

use super::super::frame::PacketId;
use super::super::instruction::Instruction;
use super::super::line::{EMPTY_STATUS, LONGEST_RETURN_DELAY, Received};
use super::super::status::ErrorByte;
use super::{Bus, line};
use crate::servo::{Fault, ServoError, ServoId};
use crate::transport::Transport;

impl<T: Transport> Bus<T> {
    /// Sends an instruction that is answered without data.
    pub(super) fn tell(
        &mut self,
        id: ServoId,
        instruction: Instruction,
        attempts: u32,
        action: impl Fn() -> String,
    ) -> Result<ErrorByte, ServoError> {
        self.ask(
            id,
            instruction,
            0,
            attempts,
            action,
            &mut |error, _: &[u8]| error,
        )
    }

    /// Sends an instruction until it is answered, `attempts` times at most.
    pub(super) fn ask<R>(
        &mut self,
        id: ServoId,
        instruction: Instruction,
        bytes: usize,
        attempts: u32,
        action: impl Fn() -> String,
        parse: &mut impl FnMut(ErrorByte, &[u8]) -> R,
    ) -> Result<R, ServoError> {
        let delay = self.return_delay(id);
        let mut failure = ServoError::Unknown { id };
        for attempt in 0..attempts.max(1) {
            self.pause_before(attempt);
            let start = self.clock().now();
            let sent = self
                .line
                .send(PacketId::Servo(id), instruction)
                .map_err(line)?;
            let deadline = self.line.deadline(sent, delay, EMPTY_STATUS + bytes);
            let mut answer = None;
            let mut found = None;
            let received = self.line.listen(deadline, |status| {
                if status.id != PacketId::Servo(id) {
                    return ControlFlow::Continue(());
                }
                answer = match status.error.fault() {
                    // Perhaps of an earlier one that lost a byte, so that this one completed it: the answer to this one may
                    // follow.
                    Some(Fault::Crc) => {
                        answer = Some(Err(Fault::Crc));
                        return ControlFlow::Continue(());
                    }
                    Some(fault) => Some(Err(fault)),
                    None if status.parameters.len() == bytes => {
                        Some(Ok(parse(status.error, status.parameters)))
                    }
                    // A late answer to something else.
                    None => {
                        found = Some(status.parameters.len());
                        return ControlFlow::Continue(());
                    }
                };
                ControlFlow::Break(())
            });
            let received = received.map_err(line)?;
            failure = match (answer, found) {
                (Some(Ok(value)), _) => {
                    self.silent.remove(&id);
                    return Ok(value);
                }
                (Some(Err(fault)), _) => {
                    self.silent.remove(&id);
                    let action = action();
                    let refused = ServoError::Refused { id, action, fault };
                    if fault != Fault::Crc {
                        return Err(refused);
                    }
                    refused
                }
                (None, Some(found)) => ServoError::WrongLength {
                    id,
                    expected: bytes,
                    found,
                },
                (None, None) if received == Received::Noise => ServoError::Damaged { id },
                (None, None) => ServoError::NoAnswer {
                    id,
                    waited: deadline.saturating_sub(start),
                },
            };
        }
        if matches!(failure, ServoError::NoAnswer { .. }) {
            self.silent.insert(id);
        }
        Err(failure)
    }

    pub(super) fn pause_before(&self, attempt: u32) {
        if let Some(doublings) = attempt.checked_sub(1) {
            let factor = 2_u32.saturating_pow(doublings);
            self.clock()
                .wait(self.settings.pause.saturating_mul(factor));
        }
    }

    pub(super) fn return_delay(&self, id: ServoId) -> Duration {
        let known = self.servos.get(&id);
        known.map_or(LONGEST_RETURN_DELAY, |known| known.return_delay)
    }
}
