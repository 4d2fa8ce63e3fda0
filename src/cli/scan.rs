//! `tdcr scan`.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use clap::Args;
use serde::Serialize;
use tdcr::hw::clock::SystemClock;
use tdcr::hw::dynamixel::{Bus, BusSettings, Model};
use tdcr::hw::rig::{Pace, Rig};
use tdcr::hw::serial::{Serial, SerialSettings};
use tdcr::hw::servo::{ServoBus, ServoId};

use super::console::Console;

/// Find servos on a serial port, or those of a rig, and say how they fare; nothing moves
#[derive(Debug, Args)]
pub(super) struct ScanArgs {
    /// Serial port, such as /dev/ttyUSB0
    #[arg(required_unless_present = "rig", conflicts_with = "rig")]
    port: Option<PathBuf>,
    /// Bits per second of the line; the servos' factory setting is 57600
    #[arg(long, default_value_t = SerialSettings::default().baud_rate, value_name = "BAUD", conflicts_with = "rig")]
    baud: u32,
    /// File of a rig, in place of a port
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
}

#[derive(Serialize)]
struct Found {
    id: u8,
    model: String,
    firmware: u8,
    /// In the servo's own count (ticks).
    position: Option<i32>,
    /// Degrees Celsius.
    temperature: Option<f64>,
    /// V.
    voltage: Option<f64>,
    /// What it reports, or why it does not answer.
    status: String,
    /// Whether the rig expects it; `null` without one.
    in_rig: Option<bool>,
}

#[derive(Serialize)]
struct Scan {
    servos: Vec<Found>,
    /// Servos of the rig that did not answer.
    missing: Vec<u8>,
    /// Serial numbers of the rig's cameras, which are open.
    cameras: Vec<String>,
}

pub(super) fn run(args: &ScanArgs, console: &Console) -> anyhow::Result<()> {
    let scan = match (&args.rig, &args.port) {
        (Some(path), _) => {
            let mut rig = Rig::open_file(super::load_rig(path)?, Pace::Computed)?;
            let ids: Vec<ServoId> = rig.winches().iter().map(|winch| winch.id).collect();
            let cameras = rig
                .cameras()
                .iter()
                .map(|camera| camera.serial().to_owned())
                .collect();
            scan(rig.bus(), Some(&ids), cameras)?
        }
        (None, port) => {
            let port = port.as_deref().context("no port was given")?;
            let settings = SerialSettings {
                baud_rate: args.baud,
                ..SerialSettings::default()
            };
            let line = Serial::open(port, settings, Arc::new(SystemClock::new()))?;
            scan(
                &mut Bus::new(line, BusSettings::default()),
                None,
                Vec::new(),
            )?
        }
    };
    console.result(&scan, Scan::text)
}

fn scan(
    bus: &mut dyn ServoBus,
    rig: Option<&[ServoId]>,
    cameras: Vec<String>,
) -> anyhow::Result<Scan> {
    let found = bus.scan()?;
    let ids: Vec<ServoId> = found.iter().map(|(id, _)| *id).collect();
    let present = bus.present(&ids);
    let temperatures = bus.temperatures(&ids);
    let voltages = bus.voltages(&ids);
    let states = found
        .iter()
        .zip(present)
        .zip(temperatures.into_iter().zip(voltages));
    let servos = states.map(
        |(((id, identity), present), (temperature, voltage))| Found {
            id: id.get(),
            model: Model::from_number(identity.model).map_or_else(
                || format!("unknown model {}", identity.model),
                |model| format!("{model:?}"),
            ),
            firmware: identity.firmware,
            position: present.as_ref().ok().map(|present| present.position.0),
            temperature: temperature.ok(),
            voltage: voltage.ok(),
            status: match present {
                Ok(present) => present.errors.to_string(),
                Err(error) => error.to_string(),
            },
            in_rig: rig.map(|rig| rig.contains(id)),
        },
    );
    let servos = servos.collect();
    let missing = rig
        .unwrap_or_default()
        .iter()
        .filter(|id| !ids.contains(id));
    Ok(Scan {
        servos,
        missing: missing.map(|id| id.get()).collect(),
        cameras,
    })
}

impl Scan {
    fn text(&self) -> String {
        let mut text = String::new();
        for servo in &self.servos {
            let value = |value: Option<f64>, unit: &str| {
                value.map_or_else(String::new, |value| format!(", {value:.1} {unit}"))
            };
            let position = servo
                .position
                .map_or_else(String::new, |p| format!(", at {p} ticks"));
            let stranger = match servo.in_rig {
                Some(false) => ", none of the rig's",
                _ => "",
            };
            text += &format!(
                "servo {}: {}, firmware {}{position}{}{}, {}{stranger}\n",
                servo.id,
                servo.model,
                servo.firmware,
                value(servo.voltage, "V"),
                value(servo.temperature, "degrees Celsius"),
                servo.status,
            );
        }
        for id in &self.missing {
            text += &format!("servo {id} of the rig does not answer\n");
        }
        for serial in &self.cameras {
            text += &format!("camera {serial}\n");
        }
        match text.is_empty() {
            true => {
                "no servo answers: is there power, and is the baud rate right (--baud)?".to_owned()
            }
            false => text,
        }
    }
}
