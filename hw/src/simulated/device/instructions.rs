//! What a servo does with instructions.

use std::time::Duration;

use super::control::Controller;
use super::memory::{Change, mode};
use super::{Device, Refusal};
use crate::dynamixel::{Area, Backup, Instruction, Item, Reset};

impl Device {
    /// Carries out an instruction to this servo alone, or its own part of one to several.
    pub fn execute(
        &mut self,
        instruction: &Instruction<'_>,
        now: Duration,
    ) -> Result<Vec<u8>, Refusal> {
        match *instruction {
            Instruction::Ping => {
                let [low, high] = (self.memory.get(Item::ModelNumber) as u16).to_le_bytes();
                return Ok(vec![
                    low,
                    high,
                    self.memory.get(Item::FirmwareVersion) as u8,
                ]);
            }
            Instruction::Read { address, length } => return self.read(address, length, now),
            Instruction::Write { address, data } => self.write(address, data, now)?,
            Instruction::RegWrite { address, data } => {
                // What the servo would refuse it does not keep.
                self.plan(address, data)?;
                self.registered = Some((address, data.to_vec()));
                self.memory.set(Item::RegisteredInstruction, 1);
            }
            Instruction::Action => {
                let (address, data) = self.registered.take().ok_or(Refusal::Instruction)?;
                self.memory.set(Item::RegisteredInstruction, 0);
                self.write(address, &data, now)?;
            }
            Instruction::FactoryReset(reset) => {
                let kept = [Item::Id, Item::BaudRate].map(|item| self.memory.get(item));
                self.memory.restore(Area::Eeprom);
                if reset != Reset::All {
                    self.memory.set(Item::Id, kept[0]);
                }
                if reset == Reset::KeepIdAndBaudRate {
                    self.memory.set(Item::BaudRate, kept[1]);
                }
                self.restart(now);
            }
            Instruction::Reboot => self.restart(now),
            Instruction::ClearTurns => {
                if self.is_turning() {
                    return Err(Refusal::Result);
                }
                self.forget_turns();
                // It stays where it is.
                let position = self.position();
                self.memory.set(Item::GoalPosition, position);
                self.controller = Controller::at(position);
            }
            Instruction::Backup(what) => {
                if !self.is_fast() {
                    return Err(Refusal::Instruction);
                }
                if self.memory.get(Item::TorqueEnable) != 0 {
                    return Err(Refusal::Result);
                }
                match what {
                    Backup::Store => self.backup = Some(self.memory.clone()),
                    Backup::Restore => {
                        let backup = self.backup.as_ref().ok_or(Refusal::Result)?;
                        let stored = backup.area(Area::Eeprom).to_vec();
                        self.memory.set_area(Area::Eeprom, &stored);
                        self.restart(now);
                    }
                }
            }
            // These address several servos, and come here as reads and writes of each.
            Instruction::SyncRead { .. }
            | Instruction::SyncWrite { .. }
            | Instruction::BulkRead { .. }
            | Instruction::BulkWrite { .. } => return Err(Refusal::Instruction),
        }
        Ok(Vec::new())
    }

    fn read(&mut self, address: u16, length: u16, now: Duration) -> Result<Vec<u8>, Refusal> {
        self.publish(now);
        self.memory.read(address, length)
    }

    fn plan(&self, address: u16, data: &[u8]) -> Result<Vec<Change>, Refusal> {
        let changes = self.memory.plan(address, data)?;
        // After a shutdown only a reboot lets the motor run again.
        let starts = |c: &Change| c.item == Item::TorqueEnable && c.value != 0;
        match self.is_shut_down() && changes.iter().any(starts) {
            true => Err(Refusal::Result),
            false => Ok(changes),
        }
    }

    fn write(&mut self, address: u16, data: &[u8], now: Duration) -> Result<(), Refusal> {
        let was_driven = self.is_driven();
        for change in self.plan(address, data)? {
            self.memory.apply(&change);
            self.apply(&change, was_driven);
        }
        self.heard = now;
        Ok(())
    }

    /// What a change brings about.
    fn apply(&mut self, change: &Change, was_driven: bool) {
        let on_by_goal = self.memory.get(Item::DriveMode) & 0x08 != 0;
        match change.item {
            Item::TorqueEnable if change.value != 0 && !was_driven => self.switch_on(),
            Item::OperatingMode => {
                if change.value == mode::POSITION {
                    self.forget_turns();
                }
                self.reset_goals();
            }
            // Goals stay within limits that are lowered.
            Item::PwmLimit => self.bound(Item::GoalPwm, change.value),
            Item::CurrentLimit => self.bound(Item::GoalCurrent, change.value),
            Item::VelocityLimit => self.bound(Item::GoalVelocity, change.value),
            Item::GoalPwm | Item::GoalCurrent | Item::GoalVelocity | Item::GoalPosition => {
                if on_by_goal && !was_driven && !self.is_shut_down() {
                    self.memory.set(Item::TorqueEnable, 1);
                    self.switch_on();
                }
                self.controller.begin(&self.memory);
            }
            _ => {}
        }
    }

    fn bound(&mut self, goal: Item, limit: i64) {
        let value = self.memory.get(goal).clamp(-limit, limit);
        self.memory.set(goal, value);
    }
}
