//! A small log with a record of each kind.

use std::path::Path;
use std::time::Duration;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use tdcr_hw::clock::VirtualClock;
use tdcr_hw::log::{
    ChunkFormat, Entry, Event, Goal, Image, ImageFormat, Level, LogReader, LogRecord, LogSettings,
    LogWriter, Message, Reading, Recovery, ServoHome, ServoStatus, Transform,
};
use tdcr_hw::servo::{
    HardwareErrors, Identity, OperatingMode, Registers, ServoId, Ticks, Torque, WatchdogState,
};
use tdcr_sim::camera::{Distortion, Intrinsics};
use tdcr_sim::cloud::PointCloud;

/// A servo's address.
pub fn id(id: u8) -> ServoId {
    ServoId::new(id).unwrap()
}

/// Records of all kinds, with values that do not come back by chance.
pub fn records() -> Vec<LogRecord> {
    let present = |position, velocity, current| Reading {
        position: Ticks(position),
        velocity,
        current,
    };
    let intrinsics = Intrinsics {
        width: 3,
        height: 2,
        fx: 612.345,
        fy: 611.1,
        cx: 1.03,
        cy: 0.47,
        distortion: Some(Distortion {
            k1: 0.1,
            k2: -0.2,
            p1: 1e-3,
            p2: -2e-4,
            k3: 0.03,
        }),
    };
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(0.1, -0.7, 0.3, 0.2));
    let mut cloud = PointCloud::default();
    cloud.push([0.1, -0.2, 0.3], [1, 2, 3]);
    cloud.push([f32::MIN_POSITIVE, 1e9, -0.0], [255, 0, 128]);
    vec![
        LogRecord::Robot("<robot name=\"é\"/>".to_owned()),
        LogRecord::Calibration {
            serial: "0123".to_owned(),
            intrinsics,
        },
        LogRecord::Calibration {
            serial: "pinhole".to_owned(),
            intrinsics: Intrinsics::from_fovy(640, 480, 0.9),
        },
        LogRecord::Transforms(vec![Transform::of_camera(
            "0123",
            Isometry3::from_parts(
                Translation3::from(Vector3::new(0.5, -1e-9, 1.0 / 3.0)),
                turn,
            ),
        )]),
        LogRecord::Status(vec![
            ServoStatus {
                identity: Some(Identity {
                    model: 1200,
                    firmware: 52,
                }),
                torque: Some(Torque::On),
                mode: Some(OperatingMode::CurrentBasedPosition),
                current_limit: Some(0.35),
                watchdog: Some(WatchdogState::Armed(Duration::from_millis(500))),
                temperature: Some(31.0),
                voltage: Some(5.1),
                hardware_errors: Some(HardwareErrors {
                    overload: true,
                    ..HardwareErrors::default()
                }),
                ..ServoStatus::of(id(1))
            },
            ServoStatus::of(id(252)),
        ]),
        LogRecord::Goals(vec![
            (
                id(1),
                Goal {
                    position: Some(Ticks(-1234)),
                    current: None,
                },
            ),
            (
                id(2),
                Goal {
                    position: None,
                    current: Some(0.1234),
                },
            ),
        ]),
        LogRecord::Present(vec![
            (id(1), present(i32::MIN, -0.024, 0.1 + 0.2)),
            (id(2), present(i32::MAX, 0.0, -1e-3)),
            (id(3), present(6789, 1e-300, 0.0)),
        ]),
        LogRecord::Homes(vec![ServoHome {
            id: id(3),
            home: Ticks(-4100),
            last: Ticks(6789),
        }]),
        LogRecord::Registers(Registers {
            id: id(3),
            address: 0x7fff,
            bytes: vec![0, 255, 17],
        }),
        LogRecord::Command(vec![0.1 + 0.2, -0.0, 1e-17]),
        LogRecord::Event(Event {
            level: Level::Warning,
            source: "servo 3".to_owned(),
            text: "did not answer within 20 ms".to_owned(),
        }),
        LogRecord::Color {
            serial: "0123".to_owned(),
            image: Image {
                width: 3,
                height: 2,
                pixels: (0..6).map(|i| [i * 40, 255 - i, 6]).collect(),
            },
        },
        LogRecord::Depth {
            serial: "0123".to_owned(),
            image: Image {
                width: 3,
                height: 2,
                // Whole millimetres, as a RealSense gives them.
                pixels: [0, 500, 123, 1000, 65_535, 700_u16]
                    .map(|mm| f32::from(mm) * 0.001)
                    .to_vec(),
            },
        },
        LogRecord::Depth {
            serial: "0123".to_owned(),
            image: Image {
                width: 1,
                height: 2,
                pixels: vec![0.123_456, f32::INFINITY],
            },
        },
        LogRecord::Cloud(cloud),
    ]
}

/// Writes a log of the sample's records, `times` over and 10 ms apart, in chunks of `chunk` bytes.
pub fn write(path: &Path, times: usize, chunk: u64, colors: ImageFormat) {
    let settings = LogSettings {
        chunk,
        colors,
        chunks: ChunkFormat::Plain,
        ..LogSettings::default()
    };
    let mut log = LogWriter::create(path, &VirtualClock::new(), settings).unwrap();
    let mut time = Duration::ZERO;
    for _ in 0..times {
        for record in records() {
            log.write(time, &record).unwrap();
            time += Duration::from_millis(10);
        }
    }
    log.finish().unwrap();
}

/// The bytes of such a log.
pub fn bytes(times: usize, chunk: u64) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    write(&path, times, chunk, ImageFormat::Png);
    std::fs::read(&path).unwrap()
}

/// All messages that can be read of `bytes`, and what was found.
pub fn read(bytes: &[u8]) -> (Vec<Message>, Recovery) {
    let mut reader = LogReader::new(std::io::Cursor::new(bytes)).unwrap();
    let mut messages = Vec::new();
    while let Some(entry) = reader.next_entry().unwrap() {
        if let Entry::Message(message) = entry {
            messages.push(message);
        }
    }
    assert_eq!(reader.recovery().messages, messages.len() as u64);
    (messages, reader.recovery().clone())
}
