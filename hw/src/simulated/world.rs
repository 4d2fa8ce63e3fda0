//! Servos, line and robot in one time: what happens, in the order in which it happens.

use std::collections::VecDeque;
use std::time::Duration;

use super::device::{Device, PERIOD};
use super::fault::{Fault, ScheduledFault};
use super::plant::Plant;
use super::tendon::TendonFault;
use super::wire::{Noise, Received, Wire};
use crate::dynamixel::joined::{self, JoinedWriter};
use crate::dynamixel::{
    Answers, ErrorByte, Fault as Refusal, Frame, Instruction, InstructionError, PacketId, Reset,
    Status, bulk_read_rows, bulk_write_rows, sync_rows,
};
use crate::servo::ServoId;

/// Control period of the servos, in which everything moves on.
const STEP: Duration = Duration::from_micros(1000);
/// What a servo waits before it answers a ping to all, for each id before its own: the vendor's SDK leaves room for a status
/// and 3 ms.
const PING_BYTES: u32 = 14;
const PING_GAP: Duration = Duration::from_millis(3);
/// Degrees above its limit of a servo that overheats at once.
const FEVER: f64 = 5.0;

/// Everything that is simulated.
#[derive(Debug)]
pub(super) struct World {
    pub devices: Vec<Device>,
    pub plant: Plant,
    pub wire: Wire,
    pub unplugged: bool,
    /// Faults to come, the earliest first.
    schedule: VecDeque<ScheduledFault>,
    /// Time up to which everything has moved; a whole number of steps.
    moved: Duration,
    now: Duration,
}

impl World {
    /// A world at time 0.
    pub fn new(devices: Vec<Device>, plant: Plant, wire: Wire) -> Self {
        Self {
            devices,
            plant,
            wire,
            unplugged: false,
            schedule: VecDeque::new(),
            moved: Duration::ZERO,
            now: Duration::ZERO,
        }
    }

    /// Begins at `time`.
    pub fn start(&mut self, time: Duration) {
        let steps = time.as_nanos() / STEP.as_nanos();
        self.moved = STEP * u32::try_from(steps).unwrap_or(u32::MAX);
        self.now = time;
    }

    /// Lets happen what happens until `time`.
    pub fn advance(&mut self, time: Duration) {
        while let Some(next) = self.schedule.front().map(|next| next.at)
            && next <= time
        {
            self.converse(next);
            if let Some(due) = self.schedule.pop_front() {
                self.strike(&due.fault);
            }
        }
        self.converse(time);
        self.now = self.now.max(time);
    }

    /// Lets a fault happen when its time comes: now, where that has passed.
    pub fn schedule(&mut self, fault: ScheduledFault) {
        let place = self.schedule.partition_point(|other| other.at <= fault.at);
        self.schedule.insert(place, fault);
        self.advance(self.now);
    }

    /// Ends all faults that last, and those to come.
    pub fn repair(&mut self) {
        self.schedule.clear();
        self.unplugged = false;
        self.wire.noise = Noise::default();
        for (index, device) in self.devices.iter_mut().enumerate() {
            device.connected = true;
            self.plant.set_fault(index, TendonFault::Whole);
        }
    }

    /// When something next happens on the line.
    pub fn next_event(&self) -> Option<Duration> {
        let events = [self.wire.next_arrival(), self.wire.next_delivery()];
        events.into_iter().flatten().min()
    }

    /// Instructions that arrive until `time`, and the motion between them.
    fn converse(&mut self, time: Duration) {
        while let Some((at, received)) = self.wire.arrive(time) {
            for received in received {
                self.move_on(at);
                match received {
                    Received::Frame {
                        id,
                        instruction,
                        parameters,
                    } => {
                        let frame = Frame {
                            id,
                            instruction,
                            parameters: &parameters,
                        };
                        self.execute(at, id, Instruction::decode(&frame));
                    }
                    Received::Damaged(id) => self.refuse(at, id, Refusal::Crc),
                }
            }
        }
        self.move_on(time);
    }

    fn move_on(&mut self, time: Duration) {
        while self.moved + STEP <= time {
            self.moved += STEP;
            for (index, device) in self.devices.iter_mut().enumerate() {
                device.step(self.moved, self.plant.torque(index));
            }
            let horns = self.devices.iter().map(|device| device.motor.angle);
            self.plant.advance(PERIOD, horns);
        }
    }

    fn strike(&mut self, fault: &Fault) {
        let (moved, noise) = (self.moved, &mut self.wire.noise);
        match *fault {
            Fault::Lost(share) => noise.lost = share,
            Fault::Corrupted(share) => noise.corrupted = share,
            Fault::Duplicated(share) => noise.duplicated = share,
            Fault::Late(share) => noise.late = share,
            Fault::Unplugged => {
                self.unplugged = true;
                self.wire.clear();
            }
            Fault::Silent(id)
            | Fault::Overheated(id)
            | Fault::Overloaded(id)
            | Fault::PowerCycled(id)
            | Fault::Snapped(id)
            | Fault::Jammed(id) => {
                for (index, device) in self.devices.iter_mut().enumerate() {
                    if device.id() != id.get() {
                        continue;
                    }
                    match fault {
                        Fault::Silent(_) => device.connected = false,
                        Fault::Overheated(_) => {
                            device.motor.temperature = device.temperature_limit() + FEVER;
                        }
                        Fault::Overloaded(_) => device.fail_with_overload(),
                        Fault::PowerCycled(_) => device.restart(moved),
                        Fault::Snapped(_) => self.plant.set_fault(index, TendonFault::Snapped),
                        Fault::Jammed(_) => self.plant.set_fault(index, TendonFault::Jammed),
                        _ => {}
                    }
                }
            }
        }
    }

    /// The servos that hear the computer.
    fn listening(&mut self) -> impl Iterator<Item = &mut Device> {
        let baud_rate = self.wire.baud_rate();
        (self.devices.iter_mut()).filter(move |device| device.listens(baud_rate))
    }

    /// An instruction has arrived.
    fn execute(
        &mut self,
        at: Duration,
        id: PacketId,
        instruction: Result<Instruction<'_>, InstructionError>,
    ) {
        let instruction = match (instruction, id) {
            (Ok(instruction), _) => instruction,
            (Err(InstructionError::Status), _) | (Err(_), PacketId::Broadcast) => return,
            (Err(_), PacketId::Servo(id)) => return self.refuse(at, id, Refusal::Instruction),
        };
        self.listening().for_each(|device| device.hear(at));
        match (id, instruction) {
            (PacketId::Servo(id), instruction) => self.execute_one(at, id, &instruction),
            (PacketId::Broadcast, Instruction::Ping) => self.answer_in_turn(at),
            (PacketId::Broadcast, Instruction::Read { .. }) => {}
            // Too dangerous, says the manual: all servos would have one id.
            (PacketId::Broadcast, Instruction::FactoryReset(Reset::All)) => {}
            (
                PacketId::Broadcast,
                Instruction::SyncRead {
                    answers,
                    address,
                    length,
                    ids,
                },
            ) => {
                let ids = ids.iter().filter_map(|&id| ServoId::new(id));
                let asked: Vec<_> = ids.map(|id| (id, address, length)).collect();
                self.answer_many(at, answers, &asked);
            }
            (PacketId::Broadcast, Instruction::BulkRead { answers, rows }) => {
                let asked: Vec<_> = bulk_read_rows(rows).collect();
                self.answer_many(at, answers, &asked);
            }
            (
                PacketId::Broadcast,
                Instruction::SyncWrite {
                    address,
                    length,
                    rows,
                },
            ) => {
                for (id, data) in sync_rows(length, rows) {
                    self.write(at, id, address, data);
                }
            }
            (PacketId::Broadcast, Instruction::BulkWrite { rows }) => {
                for (id, address, data) in bulk_write_rows(rows) {
                    self.write(at, id, address, data);
                }
            }
            (PacketId::Broadcast, instruction) => {
                for device in self.listening() {
                    // Nobody answers what all were told.
                    let _ = device.execute(&instruction, at);
                }
            }
        }
    }

    /// An instruction to one servo.
    fn execute_one(&mut self, at: Duration, id: ServoId, instruction: &Instruction<'_>) {
        let mut answers = Vec::new();
        for device in self.listening() {
            if device.shadows(id) {
                let _ = device.execute(instruction, at);
            } else if device.id() == id.get() {
                let answered = device.answers(instruction);
                let start = at + device.return_delay();
                let outcome = device.execute(instruction, at);
                if answered {
                    answers.push((start, status(device, id, outcome)));
                }
            }
        }
        for (start, bytes) in answers {
            self.wire.answer(start, &bytes);
        }
    }

    /// Answers what cannot be carried out, and was for one servo.
    fn refuse(&mut self, at: Duration, id: ServoId, refusal: Refusal) {
        let answers: Vec<_> = self
            .listening()
            .filter(|device| device.id() == id.get() && device.answers_from(2))
            .map(|device| {
                let bytes = status(device, id, Err(refusal));
                (at + device.return_delay(), bytes)
            })
            .collect();
        for (start, bytes) in answers {
            self.wire.answer(start, &bytes);
        }
    }

    /// A row of a write to several servos.
    fn write(&mut self, at: Duration, id: ServoId, address: u16, data: &[u8]) {
        let write = Instruction::Write { address, data };
        for device in self.listening() {
            if device.id() == id.get() || device.shadows(id) {
                // Nobody answers such a write.
                let _ = device.execute(&write, at);
            }
        }
    }

    /// Answers to a ping to all, spaced by ids.
    fn answer_in_turn(&mut self, at: Duration) {
        let gap = self.wire.byte_time() * PING_BYTES + PING_GAP;
        let answers: Vec<_> = self
            .listening()
            .filter_map(|device| {
                let id = ServoId::new(device.id())?;
                let outcome = device.execute(&Instruction::Ping, at);
                let start = at + device.return_delay() + gap * u32::from(id.get());
                Some((start, status(device, id, outcome)))
            })
            .collect();
        for (start, bytes) in answers {
            self.wire.answer(start, &bytes);
        }
    }

    /// Answers to a read of several servos: what each is asked for is its id, an address and a length.
    fn answer_many(&mut self, at: Duration, answers: Answers, asked: &[(ServoId, u16, u16)]) {
        match answers {
            Answers::Each => self.answer_each(at, asked),
            Answers::Fast => self.answer_joined(at, asked),
        }
    }

    /// One after the other. The time of one that is silent passes unused.
    fn answer_each(&mut self, at: Duration, asked: &[(ServoId, u16, u16)]) {
        let mut free = at;
        for &(id, address, length) in asked {
            let read = Instruction::Read { address, length };
            let replies: Vec<_> = self
                .listening()
                .filter(|device| device.id() == id.get() && device.answers(&read))
                .map(|device| {
                    let outcome = device.execute(&read, at);
                    (device.return_delay(), status(device, id, outcome))
                })
                .collect();
            let mut end = None;
            for (delay, bytes) in replies {
                end = Some(self.wire.answer(free + delay, &bytes));
            }
            let unused = self.wire.byte_time() * (u32::from(length) + 11);
            free = end.unwrap_or(free + unused);
        }
    }

    /// In one status, which ends before the first servo that is silent.
    fn answer_joined(&mut self, at: Duration, asked: &[(ServoId, u16, u16)]) {
        let lengths = asked.iter().map(|&(_, _, length)| usize::from(length));
        let mut bytes = Vec::new();
        let Ok(mut writer) = JoinedWriter::new(&mut bytes, joined::length_field(lengths)) else {
            return;
        };
        let mut start = None;
        for &(id, address, length) in asked {
            let read = Instruction::Read { address, length };
            let Some(device) = self.listening().find(|device| {
                device.id() == id.get() && device.answers(&read) && device.is_fast()
            }) else {
                break;
            };
            start.get_or_insert(at + device.return_delay());
            let outcome = device.execute(&read, at);
            let error = device.error_byte(outcome.as_ref().err().copied());
            let data = outcome.unwrap_or_else(|_| vec![0; usize::from(length)]);
            writer.section(id, error, &data);
        }
        if let Some(start) = start {
            self.wire.answer(start, &bytes);
        }
    }
}

/// A servo's status after an outcome, from `id`.
fn status(device: &Device, id: ServoId, outcome: Result<Vec<u8>, Refusal>) -> Vec<u8> {
    let error: ErrorByte = device.error_byte(outcome.as_ref().err().copied());
    let parameters = outcome.unwrap_or_default();
    let mut bytes = Vec::new();
    let status = Status {
        id: PacketId::Servo(id),
        error,
        parameters: &parameters,
    };
    // A control table is shorter than a frame, so the status fits.
    let _ = status.encode(&mut bytes);
    bytes
}
