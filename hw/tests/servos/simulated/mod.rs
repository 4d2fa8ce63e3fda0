//! The simulated bus as its users meet it: bytes in, bytes out, and what the robot does.

mod driver;
mod faults;
mod motion;
mod protocol;
mod scene;
mod several;
mod streams;

use std::sync::Arc;
use std::time::Duration;

use tdcr_hw::clock::{Clock, VirtualClock};
use tdcr_hw::dynamixel::{
    ControlTable, Decoder, ErrorByte, Fault as Refusal, Instruction, Item, Model, PacketId, Status,
};
use tdcr_hw::servo::ServoId;
use tdcr_hw::simulated::{SimulatedBus, Simulator, SimulatorSetup};
use tdcr_hw::transport::Transport;
use tdcr_sim::robot::RobotSpec;

/// Numbers of "Operating Mode".
const VELOCITY: i64 = 1;
const POSITION: i64 = 3;
const EXTENDED: i64 = 4;
const CURRENT_BASED: i64 = 5;

fn id(number: u8) -> ServoId {
    ServoId::new(number).expect("an id")
}

fn setup(robot: &str) -> SimulatorSetup {
    SimulatorSetup::of_robot(RobotSpec::standard(robot).expect("a standard robot"))
}

/// An answer: who, what was wrong, what was asked for.
#[derive(Clone, Debug, PartialEq)]
struct Answer {
    id: PacketId,
    error: ErrorByte,
    data: Vec<u8>,
}

/// A conversation with a simulator.
struct Desk {
    simulator: Simulator,
    clock: Arc<VirtualClock>,
    bus: SimulatedBus,
}

impl Desk {
    fn new(setup: &SimulatorSetup) -> Self {
        let clock = Arc::new(VirtualClock::new());
        let simulator = Simulator::new(setup, clock.clone()).expect("a valid setup");
        let bus = simulator.bus();
        Self {
            simulator,
            clock,
            bus,
        }
    }

    fn of(robot: &str) -> Self {
        Self::new(&setup(robot))
    }

    fn wait(&self, seconds: f64) {
        self.clock.wait(Duration::from_secs_f64(seconds));
    }

    /// All bytes that come within `patience` of the last one.
    fn listen(&mut self, patience: Duration) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut buffer = [0; 256];
        loop {
            let deadline = self.clock.now() + patience;
            match self
                .bus
                .read(&mut buffer, deadline)
                .expect("it is plugged in")
            {
                0 => return bytes,
                count => bytes.extend_from_slice(&buffer[..count]),
            }
        }
    }

    /// Sends an instruction and returns the bytes that come back.
    fn exchange(&mut self, to: PacketId, instruction: &Instruction<'_>) -> Vec<u8> {
        let mut bytes = Vec::new();
        instruction.encode(to, &mut bytes).expect("a short frame");
        self.bus.write(&bytes).expect("it is plugged in");
        self.listen(Duration::from_millis(25))
    }

    /// Sends an instruction and returns the answers to it.
    fn ask_all(&mut self, to: PacketId, instruction: &Instruction<'_>) -> Vec<Answer> {
        answers(&self.exchange(to, instruction))
    }

    /// Sends an instruction to one servo and returns its answer.
    fn ask(&mut self, to: u8, instruction: &Instruction<'_>) -> Option<Answer> {
        let mut answers = self.ask_all(PacketId::Servo(id(to)), instruction);
        assert!(answers.len() <= 1, "{answers:?}");
        answers.pop()
    }

    /// Writes an item; what was wrong with that.
    fn try_write(&mut self, to: u8, item: Item, value: i64) -> Option<Refusal> {
        let entry = table().entry(item);
        let bytes = entry.kind.encode(value).expect("it fits");
        let write = Instruction::Write {
            address: entry.address,
            data: &bytes[..entry.size()],
        };
        self.ask(to, &write).expect("an answer").error.fault()
    }

    fn write(&mut self, to: u8, item: Item, value: i64) {
        assert_eq!(self.try_write(to, item, value), None, "{item:?} = {value}");
    }

    /// Reads an item, with the error byte.
    fn read_with_error(&mut self, to: u8, item: Item) -> (i64, ErrorByte) {
        let entry = table().entry(item);
        let read = Instruction::Read {
            address: entry.address,
            length: entry.size() as u16,
        };
        let answer = self.ask(to, &read).expect("an answer");
        let value = entry.kind.decode(&answer.data).expect("a number");
        (value, answer.error)
    }

    fn read(&mut self, to: u8, item: Item) -> i64 {
        self.read_with_error(to, item).0
    }

    /// Switches a servo on in a mode, its goal where it stands.
    fn drive(&mut self, to: u8, mode: i64) {
        self.write(to, Item::OperatingMode, mode);
        let position = self.read(to, Item::PresentPosition);
        self.write(to, Item::GoalPosition, position);
        self.write(to, Item::TorqueEnable, 1);
    }
}

fn table() -> &'static ControlTable {
    Model::Xc330M288.table(Model::LAST_FIRMWARE_208)
}

/// The answers in some bytes.
fn answers(bytes: &[u8]) -> Vec<Answer> {
    let mut decoder = Decoder::new();
    let mut answers = Vec::new();
    let mut rest = bytes;
    while !rest.is_empty() {
        let taken = decoder.fill(rest);
        rest = &rest[taken..];
        while let Some(frame) = decoder.next_frame() {
            let status = Status::decode(&frame).expect("an answer");
            answers.push(Answer {
                id: status.id,
                error: status.error,
                data: status.parameters.to_vec(),
            });
        }
    }
    answers
}
