//! Who is there, and what is to be known of a servo before it is used.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Duration;

use super::super::control_table::{ControlTable, Item, Model};
use super::super::frame::PacketId;
use super::super::instruction::Instruction;
use super::super::line::EMPTY_STATUS;
use super::{Bus, line};
use crate::servo::{Identity, ServoError, ServoId};
use crate::transport::Transport;

/// Longest wait of a servo, from the one before, until it answers a ping of all: the vendor's SDK allows as much.
const PING_SLOT: Duration = Duration::from_millis(3);
/// Model and firmware.
const PING_BYTES: usize = 3;
/// The status return level at which all instructions are answered.
const ANSWER_ALL: i64 = 2;

/// What is known of a servo that has been met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub model: Model,
    pub firmware: u8,
    pub return_delay: Duration,
    /// Whether its indirect addresses are set.
    pub has_block: bool,
    /// Whether its watchdog had tripped when last seen.
    pub tripped: bool,
}

impl Known {
    pub fn table(&self) -> &'static ControlTable {
        self.model.table(self.firmware)
    }
}

impl<T: Transport> Bus<T> {
    pub(super) fn ping_one(&mut self, id: ServoId, attempts: u32) -> Result<Identity, ServoError> {
        let action = || "answer a ping".to_owned();
        self.ask(
            id,
            Instruction::Ping,
            PING_BYTES,
            attempts,
            action,
            &mut |_, data: &[u8]| identity(data),
        )
    }

    /// How often a servo is asked: once where it was silent before.
    pub(super) fn attempts_for(&self, id: ServoId) -> u32 {
        if self.silent.contains(&id) {
            1
        } else {
            self.settings.attempts
        }
    }

    pub(super) fn ping_all(&mut self) -> Result<Vec<(ServoId, Identity)>, ServoError> {
        let mut found = BTreeMap::new();
        let sent = self
            .line
            .send(PacketId::Broadcast, Instruction::Ping)
            .map_err(line)?;
        let servos = u32::from(ServoId::MAX) + 1;
        let bytes = servos as usize * (EMPTY_STATUS + PING_BYTES);
        let deadline = self.line.deadline(sent, PING_SLOT * servos, bytes);
        let heard = self.line.listen(deadline, |status| {
            if let (PacketId::Servo(id), PING_BYTES) = (status.id, status.parameters.len()) {
                found.insert(id, identity(status.parameters));
            }
            ControlFlow::Continue(())
        });
        heard.map_err(line)?;
        Ok(found.into_iter().collect())
    }

    /// What is known of a servo, which is met where nothing is.
    pub(super) fn meet(&mut self, id: ServoId) -> Result<&mut Known, ServoError> {
        if !self.servos.contains_key(&id) {
            let known = self.get_to_know(id)?;
            self.servos.insert(id, known);
        }
        self.servos.get_mut(&id).ok_or(ServoError::Unknown { id })
    }

    fn get_to_know(&mut self, id: ServoId) -> Result<Known, ServoError> {
        let Identity { model, firmware } = self.ping_one(id, self.attempts_for(id))?;
        let model = Model::from_number(model).ok_or(ServoError::UnknownModel { id, model })?;
        let table = model.table(firmware);
        let level = table.entry(Item::StatusReturnLevel);
        let delay = table.entry(Item::ReturnDelayTime);
        // Below level 2 it does not acknowledge the write, at level 0 not even this read.
        let found = self.read(id, level.address, 1);
        let answers_all =
            matches!(&found, Ok(reply) if level.kind.decode(&reply.data) == Some(ANSWER_ALL));
        if !answers_all {
            if let Err(error @ ServoError::Line { .. }) = found {
                return Err(error);
            }
            let [data, ..] = level.kind.encode(ANSWER_ALL).unwrap_or_default();
            match self.write(id, level.address, &[data]) {
                Ok(_) | Err(ServoError::NoAnswer { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        let reply = self.read(id, delay.address, 1)?;
        let count = delay.kind.decode(&reply.data).unwrap_or_default();
        Ok(Known {
            model,
            firmware,
            return_delay: Duration::from_secs_f64(delay.quantity(count)),
            has_block: false,
            tripped: false,
        })
    }
}

/// The parameters of an answer to a ping.
fn identity(data: &[u8]) -> Identity {
    match *data {
        [low, high, firmware, ..] => Identity {
            model: u16::from_le_bytes([low, high]),
            firmware,
        },
        // Answers of another length are not taken.
        _ => Identity {
            model: 0,
            firmware: 0,
        },
    }
}
