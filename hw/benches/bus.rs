//! Times of the drivers that `benches/bus.py` sets beside the vendor's SDK: prints one line of JSON. Arguments: the path of a
//! serial port with 15 servos, its baud rate, `ours` or `rustypot`, `each` or `joined` (fast sync reads), and the number of
//! rounds.
//!
//! A round is what a controller does once in a period: a sync write of 15 goal positions, and a sync read of 15 present
//! currents, velocities and positions (10 bytes of each).
#![allow(clippy::print_stdout, reason = "the result goes to stdout")]

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustypot::DynamixelProtocolHandler;
use tdcr_hw::clock::SystemClock;
use tdcr_hw::dynamixel::{Answers, Bus, BusSettings, Span};
use tdcr_hw::serial::{Serial, SerialSettings};
use tdcr_hw::servo::{ServoBus, ServoId};

type Outcome<T> = Result<T, Box<dyn Error>>;

const SERVOS: u8 = 15;
/// Addresses and sizes of "Goal Position", and of "Present Current" to "Present Position".
const GOAL: (u16, u16) = (116, 4);
const PRESENT: (u16, u16) = (126, 10);

fn main() -> Outcome<()> {
    // `cargo bench` adds an option of its own; without the others there is nothing to measure.
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| a != "--bench")
        .collect();
    let [path, baud_rate, driver, answers, rounds] = arguments.as_slice() else {
        return Ok(());
    };
    let (baud_rate, rounds) = (baud_rate.parse()?, rounds.parse()?);
    let joined = answers == "joined";
    let seconds = match driver.as_str() {
        "ours" => ours(path, baud_rate, joined, rounds)?,
        "rustypot" => theirs(path, baud_rate, joined, rounds)?,
        other => return Err(format!("unknown driver `{other}`").into()),
    };
    println!("{}", serde_json::json!({ "median_us": 1e6 * seconds }));
    Ok(())
}

/// Median time of a round (s).
fn median(rounds: usize, mut round: impl FnMut(i32) -> Outcome<()>) -> Outcome<f64> {
    let mut times = Vec::with_capacity(rounds);
    for number in 0..rounds + 5 {
        let began = Instant::now();
        round(number as i32 % 50)?;
        times.push(began.elapsed().as_secs_f64());
    }
    // The first rounds meet the servos.
    let times = &mut times[5..];
    times.sort_by(f64::total_cmp);
    Ok(times[rounds / 2])
}

fn ours(path: &str, baud_rate: u32, joined: bool, rounds: usize) -> Outcome<f64> {
    let settings = SerialSettings {
        baud_rate,
        // As long as rustypot is told to wait below: a busy machine may take so long.
        scheduling: Duration::from_millis(100),
    };
    let port = Serial::open(Path::new(path), settings, Arc::new(SystemClock::new()))?;
    let settings = BusSettings {
        answers: if joined { Answers::Fast } else { Answers::Each },
        ..BusSettings::default()
    };
    let mut bus = Bus::new(port, settings);
    let ids: Vec<ServoId> = (1..=SERVOS).filter_map(ServoId::new).collect();
    let spans: Vec<Span> = (ids.iter())
        .map(|&id| Span {
            id,
            address: PRESENT.0,
            length: PRESENT.1,
        })
        .collect();
    // Servos are met: fast reads need to know their firmware.
    for torque in bus.torque(&ids) {
        torque?;
    }
    median(rounds, |number| {
        let goal = (2048 + number).to_le_bytes();
        let rows: Vec<(ServoId, &[u8])> = ids.iter().map(|&id| (id, &goal[..])).collect();
        bus.sync_write(GOAL.0, GOAL.1, &rows)?;
        for reply in bus.read_many(&spans) {
            reply?;
        }
        Ok(())
    })
}

fn theirs(path: &str, baud_rate: u32, joined: bool, rounds: usize) -> Outcome<f64> {
    let mut port = serialport::new(path, baud_rate)
        .timeout(Duration::from_millis(100))
        .open()?;
    let protocol = match joined {
        true => DynamixelProtocolHandler::v2().with_fast_sync_read(),
        false => DynamixelProtocolHandler::v2(),
    };
    let ids: Vec<u8> = (1..=SERVOS).collect();
    median(rounds, |number| {
        let goals = vec![(2048 + number).to_le_bytes().to_vec(); ids.len()];
        protocol.sync_write(port.as_mut(), &ids, GOAL.0 as u8, &goals)?;
        protocol.sync_read(port.as_mut(), &ids, PRESENT.0 as u8, PRESENT.1 as u8)?;
        Ok(())
    })
}
