//! Servos that only remember: enough of the other end of a line to test a driver against.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tdcr_hw::clock::{Clock, VirtualClock};
use tdcr_hw::dynamixel::joined::{JoinedWriter, length_field};
use tdcr_hw::dynamixel::{
    Access, Answers, ControlTable, Decoder, ErrorByte, Fault, Instruction, Item, Model, PacketId,
    Status, bulk_read_rows, sync_rows,
};
use tdcr_hw::servo::ServoId;
use tdcr_hw::transport::{Arriving, Transport};

pub struct Device {
    pub id: ServoId,
    table: &'static ControlTable,
    memory: [u8; 256],
    /// It neither hears nor speaks.
    pub dead: bool,
}

impl Device {
    pub fn new(id: u8, model: Model, firmware: u8) -> Self {
        let mut device = Self {
            id: ServoId::new(id).unwrap(),
            table: model.table(firmware),
            memory: [0; 256],
            dead: false,
        };
        device.set(Item::ModelNumber, model.number().into());
        device.set(Item::FirmwareVersion, firmware.into());
        device.power_on(0);
        device.set(Item::Id, id.into());
        device
    }

    /// Gives items from `start` on their first values.
    pub fn power_on(&mut self, start: u16) {
        for entry in self
            .table
            .entries()
            .iter()
            .filter(|entry| entry.address >= start)
        {
            let range = usize::from(entry.address)..usize::from(entry.end());
            for (at, place) in (0..).zip(self.memory[range].chunks_exact_mut(entry.size())) {
                let first = match entry.item {
                    Item::ModelNumber | Item::FirmwareVersion => continue,
                    Item::IndirectAddress => entry.initial.unwrap() + at,
                    // What a servo on the desk measures.
                    Item::PresentInputVoltage => 50,
                    Item::PresentTemperature => 31,
                    _ => entry.initial.unwrap_or(0),
                };
                place.copy_from_slice(&entry.kind.encode(first).unwrap()[..entry.size()]);
            }
        }
    }

    pub fn get(&self, item: Item) -> i64 {
        let entry = self.table.entry(item);
        let start = usize::from(entry.address);
        entry
            .kind
            .decode(&self.memory[start..start + entry.size()])
            .unwrap()
    }

    pub fn set(&mut self, item: Item, value: i64) {
        let entry = self.table.entry(item);
        let start = usize::from(entry.address);
        let bytes = entry.kind.encode(value).unwrap();
        self.memory[start..start + entry.size()].copy_from_slice(&bytes[..entry.size()]);
    }

    fn error(&self, fault: Option<Fault>) -> ErrorByte {
        ErrorByte::new(fault, self.get(Item::HardwareErrorStatus) != 0)
    }

    /// Where the byte at an address lies: elsewhere, for indirect data.
    fn place(&self, address: u16) -> usize {
        let data = self.table.entry(Item::IndirectData).address;
        let Some(index) = address.checked_sub(data) else {
            return address.into();
        };
        let pointer = usize::from(self.table.entry(Item::IndirectAddress).address + 2 * index);
        u16::from_le_bytes([self.memory[pointer], self.memory[pointer + 1]]).into()
    }

    fn read(&self, address: u16, length: u16) -> Vec<u8> {
        (address..address + length)
            .map(|address| self.memory[self.place(address)])
            .collect()
    }

    fn write(&mut self, address: u16, data: &[u8]) -> Option<Fault> {
        let entry = self.table.at(address);
        let is_locked = address < 64 && self.get(Item::TorqueEnable) == 1;
        if entry.is_none_or(|entry| entry.access == Access::Read) || is_locked {
            return Some(Fault::Access);
        }
        let tripped = self.get(Item::BusWatchdog) == -1;
        if tripped && entry.is_some_and(|entry| entry.item == Item::GoalPosition) {
            return Some(Fault::DataRange);
        }
        for (address, &byte) in (address..).zip(data) {
            self.memory[usize::from(address)] = byte;
        }
        None
    }
}

/// Servos on a line in memory.
pub struct Devices {
    pub devices: Vec<Device>,
    decoder: Decoder,
    arriving: Arriving,
    /// How many bytes are lost or flipped from here on: every so many-th one.
    pub flip_every: Option<usize>,
    sent: usize,
    /// The instructions heard, by their numbers.
    pub heard: Vec<u8>,
}

impl Devices {
    pub fn new(devices: impl IntoIterator<Item = Device>) -> Self {
        Self {
            devices: devices.into_iter().collect(),
            decoder: Decoder::new(),
            arriving: Arriving::new(Arc::new(VirtualClock::new())),
            flip_every: None,
            sent: 0,
            heard: Vec::new(),
        }
    }

    pub fn device(&mut self, id: u8) -> &mut Device {
        self.devices
            .iter_mut()
            .find(|device| device.id.get() == id)
            .unwrap()
    }

    fn alive(&mut self, id: ServoId) -> Option<&mut Device> {
        self.devices
            .iter_mut()
            .find(|device| device.id == id && !device.dead)
    }

    fn answer(&mut self, bytes: &[u8]) {
        let mut time = self.arriving.end() + Duration::from_micros(500);
        for &byte in bytes {
            time += Duration::from_micros(10);
            self.sent += 1;
            let flip = self
                .flip_every
                .is_some_and(|every| self.sent.is_multiple_of(every));
            self.arriving
                .push(time, if flip { byte ^ 0x10 } else { byte });
        }
    }

    fn answer_status(&mut self, id: ServoId, error: ErrorByte, parameters: &[u8]) {
        let mut bytes = Vec::new();
        let id = PacketId::Servo(id);
        let status = Status {
            id,
            error,
            parameters,
        };
        status.encode(&mut bytes).unwrap();
        self.answer(&bytes);
    }

    fn obey(&mut self, id: PacketId, instruction: Instruction) {
        self.heard.push(instruction.number());
        match instruction {
            Instruction::SyncRead {
                answers,
                address,
                length,
                ids,
            } => {
                let ids = ids.iter().map(|&id| ServoId::new(id).unwrap());
                self.answer_reads(answers, ids.map(|id| (id, address, length)).collect());
            }
            Instruction::BulkRead { answers, rows } => {
                self.answer_reads(answers, bulk_read_rows(rows).collect());
            }
            Instruction::SyncWrite {
                address,
                length,
                rows,
            } => {
                for (id, data) in sync_rows(length, rows) {
                    self.alive(id).map(|device| device.write(address, data));
                }
            }
            _ => {
                let ids: Vec<_> = self.devices.iter().map(|device| device.id).collect();
                for servo in ids {
                    if id == PacketId::Broadcast || id == PacketId::Servo(servo) {
                        self.obey_one(servo, instruction);
                    }
                }
            }
        }
    }

    fn obey_one(&mut self, id: ServoId, instruction: Instruction) {
        let Some(device) = self.alive(id) else { return };
        let level = device.get(Item::StatusReturnLevel);
        let (least_level, fault, data) = match instruction {
            Instruction::Ping => {
                let model = device.read(0, 2);
                let firmware = device.read(6, 1);
                (0, None, [model, firmware].concat())
            }
            Instruction::Read { address, length } => (1, None, device.read(address, length)),
            Instruction::Write { address, data } => (2, device.write(address, data), Vec::new()),
            Instruction::Reboot => {
                device.power_on(64);
                (2, None, Vec::new())
            }
            _ => (2, None, Vec::new()),
        };
        let error = device.error(fault);
        if level >= least_level {
            self.answer_status(id, error, &data);
        }
    }

    /// A servo waits for the answer of the one before it, for ever.
    fn answer_reads(&mut self, answers: Answers, reads: Vec<(ServoId, u16, u16)>) {
        let mut joined = Vec::new();
        let length = length_field(reads.iter().map(|&(_, _, length)| length.into()));
        let mut writer = JoinedWriter::new(&mut joined, length).unwrap();
        let mut statuses = Vec::new();
        for (id, address, length) in reads {
            let found = self
                .devices
                .iter()
                .find(|device| device.id == id && !device.dead);
            let Some(device) = found else { break };
            let data = device.read(address, length);
            let error = device.error(None);
            writer.section(id, error, &data);
            statuses.push((id, error, data));
        }
        match answers {
            Answers::Fast if statuses.is_empty() => {}
            Answers::Fast => self.answer(&joined),
            Answers::Each => {
                for (id, error, data) in statuses {
                    self.answer_status(id, error, &data);
                }
            }
        }
    }
}

impl Transport for &mut Devices {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.decoder.fill(bytes);
        let mut decoder = std::mem::take(&mut self.decoder);
        while let Some(frame) = decoder.next_frame() {
            if let Ok(instruction) = Instruction::decode(&frame) {
                self.obey(frame.id, instruction);
            }
        }
        self.decoder = decoder;
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> io::Result<usize> {
        Ok(self.arriving.read(buffer, deadline))
    }

    fn discard_input(&mut self) -> io::Result<()> {
        self.arriving.discard();
        Ok(())
    }

    fn clock(&self) -> &Arc<dyn Clock> {
        self.arriving.clock()
    }

    fn baud_rate(&self) -> u32 {
        1_000_000
    }

    fn latency(&self) -> Duration {
        Duration::from_millis(1)
    }
}
