//! What is written comes back.

use std::path::Path;
use std::time::Duration;

use mcap::MessageStream;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_hw::clock::{Clock, SystemClock, VirtualClock};
use tdcr_hw::log::{
    DecodeError, Image, ImageFormat, LogError, LogRecord, LogSettings, LogWriter, Message, Topic,
    Transform,
};
use tdcr_sim::formats::urdf;
use tdcr_sim::robot::{Loads, Robot, RobotSpec};

use super::sample::{bytes, read, records, write};

/// All of a record, for comparisons.
fn text(record: &LogRecord) -> String {
    format!("{record:?}")
}

#[test]
fn every_record_comes_back_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    for colors in [ImageFormat::Png, ImageFormat::Raw] {
        let path = folder.path().join(format!("{colors:?}.mcap"));
        write(&path, 2, 1 << 20, colors);
        let (messages, recovery) = read(&std::fs::read(&path).unwrap());
        assert!(recovery.is_whole(), "{recovery:?}");
        assert_eq!(recovery.stated, Some(messages.len() as u64));
        let expected = [records(), records()].concat();
        assert_eq!(messages.len(), expected.len());
        for (index, (message, expected)) in messages.iter().zip(&expected).enumerate() {
            let record = LogRecord::decode(&message.channel, &message.data).unwrap();
            assert_eq!(text(&record.unwrap()), text(expected));
            assert_eq!(message.log_time, index as u64 * 10_000_000);
        }
    }
}

#[test]
fn the_formats_own_library_reads_the_same_messages() {
    let bytes = bytes(3, 1000);
    let (messages, _) = read(&bytes);
    let theirs: Vec<_> = MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap)
        .collect();
    assert_eq!(messages.len(), theirs.len());
    for (ours, theirs) in messages.iter().zip(&theirs) {
        assert_eq!(ours.data, *theirs.data);
        assert_eq!(ours.channel.topic, theirs.channel.topic);
        assert_eq!(ours.log_time, theirs.log_time);
        assert_eq!(ours.sequence, theirs.sequence);
        let schema = theirs.channel.schema.as_ref().unwrap();
        let our_schema = ours.channel.schema.as_ref().unwrap();
        assert_eq!(
            (&our_schema.name, &our_schema.data[..]),
            (&schema.name, &schema.data[..])
        );
    }
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count, messages.len() as u64);
}

/// The log that `tests/python/test_log.py` reads. `WRITE_SAMPLE=1` writes it again.
const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/sample.mcap");

/// Messages decoded, by topic, schema and time. PNG files of equal pictures may differ.
fn decoded(messages: &[Message]) -> Vec<String> {
    let decoded = messages.iter().map(|message| {
        let record = LogRecord::decode(&message.channel, &message.data).unwrap();
        format!("{} {:?} {record:?}", message.log_time, message.channel)
    });
    decoded.collect()
}

#[test]
fn the_sample_that_python_reads_is_what_is_written_today() {
    if std::env::var_os("WRITE_SAMPLE").is_some() {
        drop(std::fs::remove_file(SAMPLE));
        write(Path::new(SAMPLE), 1, 4000, ImageFormat::Png);
    }
    let (sample, recovery) = read(&std::fs::read(SAMPLE).unwrap());
    assert!(recovery.is_whole());
    assert_eq!(decoded(&sample), decoded(&read(&bytes(1, 4000)).0));
}

#[test]
fn time_stamps_count_from_the_unix_epoch() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let clock = SystemClock::new();
    let mut log = LogWriter::create(&path, &clock, LogSettings::default()).unwrap();
    log.write(Duration::from_secs(7), &LogRecord::Command(vec![]))
        .unwrap();
    log.finish().unwrap();
    let (messages, _) = read(&std::fs::read(&path).unwrap());
    let expected = clock.start() + Duration::from_secs(7);
    assert_eq!(u128::from(messages[0].log_time), expected.as_nanos());
}

#[test]
fn a_log_that_nobody_finished_is_on_the_disk_but_for_the_last_second() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let mut log = LogWriter::create(&path, &VirtualClock::new(), LogSettings::default()).unwrap();
    for step in 0..500 {
        let time = Duration::from_millis(10 * step);
        log.write(time, &LogRecord::Command(vec![step as f64]))
            .unwrap();
    }
    // As after a kill: what is in the file now.
    let (messages, recovery) = read(&std::fs::read(&path).unwrap());
    assert!(messages.len() > 400, "{}", messages.len());
    assert!(!recovery.is_whole());
    log.flush().unwrap();
    let (messages, _) = read(&std::fs::read(&path).unwrap());
    assert_eq!(messages.len(), 500);
    // As after a panic: dropped.
    drop(log);
    let (_, recovery) = read(&std::fs::read(&path).unwrap());
    assert!(recovery.is_whole());
    assert_eq!(recovery.messages, 500);
}

#[test]
fn a_log_is_not_written_over_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    std::fs::write(&path, "precious").unwrap();
    let refused = LogWriter::create(&path, &VirtualClock::new(), LogSettings::default());
    assert!(matches!(refused, Err(LogError::File { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}

#[test]
fn what_a_log_cannot_hold_is_refused_and_the_log_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let mut log = LogWriter::create(&path, &VirtualClock::new(), LogSettings::default()).unwrap();
    let image = Image {
        width: 2,
        height: 2,
        pixels: vec![[0; 3]; 3],
    };
    let serial = "1".to_owned();
    let bad = [
        LogRecord::Command(vec![f64::NAN]),
        LogRecord::Color { serial, image },
    ];
    for record in bad {
        let refused = log.write(Duration::ZERO, &record);
        assert!(
            matches!(refused, Err(LogError::Record { .. })),
            "{refused:?}"
        );
    }
    log.write(Duration::ZERO, &LogRecord::Command(vec![1.0]))
        .unwrap();
    log.finish().unwrap();
    let (messages, recovery) = read(&std::fs::read(&path).unwrap());
    assert!(recovery.is_whole());
    assert_eq!(messages.len(), 1);
}

#[test]
fn a_message_of_another_schema_than_its_topics_is_named() {
    let (messages, _) = read(&bytes(1, 1 << 20));
    let command = Topic::Command.name();
    let mut channel = (*messages[0].channel).clone();
    channel.topic = command.clone();
    let refused = LogRecord::decode(&channel, &messages[0].data).unwrap_err();
    assert_eq!(
        refused,
        DecodeError::Schema {
            topic: command,
            found: "std_msgs/String".to_owned(),
            expected: "tdcr.Command"
        }
    );
    channel.topic = "/somebody/elses".to_owned();
    assert!(LogRecord::decode(&channel, b"").unwrap().is_none());
}

/// Transforms of the discs put each link of the exported URDF where its disc is.
#[test]
fn transforms_of_discs_place_the_links_of_the_urdf() {
    let spec = RobotSpec::load("2m").unwrap();
    let robot = Robot::new(spec.clone()).unwrap();
    let command = robot.random_command(&mut ChaCha8Rng::seed_from_u64(1));
    let equilibrium = robot.settle(&command, &Loads::default());
    let pose = equilibrium.pose();
    let transforms = Transform::of_discs(&pose);
    let urdf = urdf_rs::read_from_string(&urdf::export(&spec).unwrap()).unwrap();
    for (index, disc) in robot.discs().iter().enumerate() {
        let mut link = format!("disc{index}");
        let mut placed = nalgebra::Isometry3::identity();
        while link != "world" {
            let joint = urdf.joints.iter().find(|joint| joint.child.link == link);
            let joint = joint.unwrap();
            let [x, y, z] = *joint.origin.xyz;
            let [roll, pitch, yaw] = *joint.origin.rpy;
            let origin = nalgebra::Isometry3::from_parts(
                nalgebra::Translation3::new(x, y, z),
                nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            );
            let turned = transforms.iter().find(|transform| transform.child == link);
            let turned = turned.map_or(nalgebra::Isometry3::identity(), |transform| {
                assert_eq!(transform.parent, joint.parent.link);
                transform.pose
            });
            placed = origin * turned * placed;
            link.clone_from(&joint.parent.link);
        }
        // The link's origin is the centre of the ball joint; the disc's lies beside it.
        let expected = pose.disc(index);
        let centre = placed * nalgebra::Translation3::from(disc.origin);
        let apart = centre.translation.vector - expected.translation.vector;
        assert!(apart.norm() < 1e-9, "disc {index}: {apart}");
        assert!(centre.rotation.angle_to(&expected.rotation) < 1e-9);
    }
}

/// Topics that a layout names anywhere.
fn topics_in(json: &serde_json::Value, topics: &mut Vec<String>) {
    match json {
        serde_json::Value::Array(all) => all.iter().for_each(|one| topics_in(one, topics)),
        serde_json::Value::Object(fields) => {
            for (key, value) in fields {
                match (key.as_str(), value) {
                    ("topics", serde_json::Value::Object(of)) => topics.extend(of.keys().cloned()),
                    // A path of a value begins with its topic.
                    (
                        "imageTopic" | "calibrationTopic" | "topicPath" | "topicToRender" | "value",
                        serde_json::Value::String(path),
                    ) => {
                        let end = path.find(['.', '[']).unwrap_or(path.len());
                        topics.push(path[..end].to_owned());
                    }
                    _ => {}
                }
                topics_in(value, topics);
            }
        }
        _ => {}
    }
}

#[test]
fn the_layout_for_foxglove_shows_topics_that_are_written() {
    let layout = include_str!("../../../examples/foxglove-layout.json");
    let mut topics = Vec::new();
    topics_in(&serde_json::from_str(layout).unwrap(), &mut topics);
    for name in &topics {
        assert!(Topic::parse(name).is_some(), "{name}");
    }
    let shown = |topic: &Topic| topics.contains(&topic.name());
    for topic in [
        Topic::Robot,
        Topic::Cloud,
        Topic::Present,
        Topic::Goals,
        Topic::Events,
    ] {
        assert!(shown(&topic), "{topic:?}");
    }
    let camera = "sim0".to_owned();
    assert!(shown(&Topic::Color(camera.clone())) && shown(&Topic::Calibration(camera)));
}
