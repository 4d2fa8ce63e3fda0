//! Logs whose chunks are compressed, as most tools write them.

use std::io::{BufWriter, Cursor};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use mcap::{Compression, WriteOptions};
use tdcr_hw::clock::VirtualClock;
use tdcr_hw::log::{
    ChunkFormat, Contents, Image, LogError, LogReader, LogRecord, LogSettings, LogWriter, Problem,
    repair,
};
use tdcr_hw::recorded::{Commands, LoggedClouds, RecordedBus, RecordedCamera, Samples, homes};

use super::sample::{bytes, read};

const BOTH: [Compression; 2] = [Compression::Zstd, Compression::Lz4];

/// The log of a sample, written anew by the format's own library in chunks of so many bytes.
fn compressed(times: usize, chunk: u64, compression: Compression) -> Vec<u8> {
    let (messages, _) = read(&bytes(times, 1 << 20));
    let mut file = Cursor::new(Vec::new());
    let options = WriteOptions::new().compression(Some(compression));
    let mut writer = options.chunk_size(Some(chunk)).create(&mut file).unwrap();
    for message in &messages {
        let channel = &message.channel;
        let schema = channel.schema.as_ref().unwrap();
        let schema = writer
            .add_schema(&schema.name, &schema.encoding, &schema.data)
            .unwrap();
        let channel_id = writer
            .add_channel(schema, &channel.topic, &channel.encoding, &channel.metadata)
            .unwrap();
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
        };
        writer
            .write_to_known_channel(&header, &message.data)
            .unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name)
}

#[test]
fn compressed_logs_have_all_messages_and_are_repaired_whole() {
    let folder = tempfile::tempdir().unwrap();
    let [path, repaired] = ["log.mcap", "repaired.mcap"].map(|name| folder.path().join(name));
    let (expected, _) = read(&bytes(3, 1 << 20));
    for compression in BOTH {
        for chunk in [700, 1 << 20] {
            let log = compressed(3, chunk, compression);
            let (messages, recovery) = read(&log);
            assert_eq!(messages, expected, "{compression:?}");
            assert!(recovery.is_whole(), "{recovery:?}");
            std::fs::write(&path, &log).unwrap();
            assert!(repair(&path, &repaired).unwrap().is_whole());
            assert_eq!(read(&std::fs::read(&repaired).unwrap()).0, expected);
        }
    }
}

/// A log by the format's Python library with its defaults, the same without compression, and by lz4.
#[test]
fn a_log_by_pythons_library_is_read() {
    let of = |name| read(&std::fs::read(data(name)).unwrap());
    let (plain, recovery) = of("events-none.mcap");
    assert!(plain.len() == 14 && recovery.is_whole());
    let (zstd, recovery) = of("events-zstd.mcap");
    assert_eq!(zstd, plain);
    assert!(
        recovery.is_whole() && recovery.stated == Some(14),
        "{recovery:?}"
    );
    let (lz4, recovery) = of("events-lz4.mcap");
    assert!(lz4 == plain && recovery.is_whole());
    let contents = Contents::of(&data("events-zstd.mcap")).unwrap();
    assert_eq!(
        contents
            .topics
            .values()
            .map(|topic| topic.messages)
            .sum::<u64>(),
        14
    );
}

/// Whether all of `found` are the first of `messages`.
fn begins<T: PartialEq>(found: &[T], messages: &[T]) -> bool {
    messages.starts_with(found)
}

#[test]
fn a_compressed_log_that_is_cut_off_gives_its_beginning() {
    let (messages, _) = read(&bytes(2, 1 << 20));
    for compression in BOTH {
        let log = compressed(2, 2000, compression);
        let mut counts = Vec::new();
        for cut in 0..log.len() {
            let (found, recovery) = read(&log[..cut]);
            assert!(
                begins(&found, &messages),
                "{compression:?}, cut at byte {cut}"
            );
            assert!(!recovery.is_whole(), "{compression:?}, cut at byte {cut}");
            counts.push(found.len());
        }
        assert!(counts.is_sorted() && counts[log.len() / 2] > 0);
        assert_eq!(counts.last(), Some(&messages.len()));
    }
}

#[test]
fn damage_of_a_compressed_log_costs_chunks_and_changes_no_message() {
    let (messages, _) = read(&bytes(2, 1 << 20));
    for compression in BOTH {
        let log = compressed(2, 2000, compression);
        for at in 0..log.len() {
            let mut damaged = log.clone();
            damaged[at] ^= 1 << (at % 8);
            let (found, recovery) = read(&damaged);
            let mut rest = messages.iter();
            let in_order = found.iter().all(|m| rest.any(|other| other == m));
            assert!(in_order, "{compression:?}, byte {at}");
            let lost = messages.len() - found.len();
            assert!(
                lost == 0 || !recovery.is_whole(),
                "{compression:?}, byte {at}"
            );
        }
        // Behind a hole, the next whole chunk is found.
        let (messages, _) = read(&bytes(40, 1 << 20));
        let mut damaged = compressed(40, 2000, compression);
        let middle = damaged.len() / 3;
        damaged[middle..middle + 3000].fill(0x55);
        let (found, recovery) = read(&damaged);
        assert!(!recovery.is_whole());
        let (lost, all) = (messages.len() - found.len(), messages.len());
        assert!(
            (1..all / 3).contains(&lost),
            "{compression:?}: {lost} of {all}"
        );
        assert_eq!(found.last(), messages.last());
    }
}

/// A log of one chunk whose records are zeros, which states that they are `stated` bytes.
fn bomb(zeros: usize, stated: u64) -> Vec<u8> {
    let records = zstd::encode_all(&vec![0; zeros][..], 19).unwrap();
    let mut chunk = [0; 16].to_vec();
    chunk.extend(stated.to_le_bytes());
    chunk.extend(0_u32.to_le_bytes());
    chunk.extend(4_u32.to_le_bytes());
    chunk.extend(b"zstd");
    chunk.extend((records.len() as u64).to_le_bytes());
    chunk.extend(records);
    let mut log = mcap::MAGIC.to_vec();
    log.extend([[1].to_vec(), 8_u64.to_le_bytes().to_vec(), vec![0; 8]].concat());
    log.push(6);
    log.extend((chunk.len() as u64).to_le_bytes());
    log.extend(chunk);
    log
}

#[test]
fn a_chunk_that_states_less_or_more_than_it_holds_is_lost() {
    let problem = |log: &[u8]| {
        let (messages, recovery) = read(log);
        assert!(messages.is_empty());
        recovery.damage[0].problem.clone()
    };
    for stated in [1000, (8 << 20) + 1] {
        let found = problem(&bomb(8 << 20, stated));
        assert!(matches!(found, Problem::Decompression(..)), "{found:?}");
    }
    for stated in [(256 << 20) + 1, u64::MAX] {
        assert_eq!(problem(&bomb(8 << 20, stated)), Problem::TooLong(stated));
    }
}

#[test]
fn compressions_that_are_not_known_are_refused_by_name_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let [path, repaired] = ["log.mcap", "repaired.mcap"].map(|name| folder.path().join(name));
    let text = compressed(2, 2000, Compression::Zstd);
    let names = text
        .windows(8)
        .enumerate()
        .filter(|(_, bytes)| *bytes == b"\x04\0\0\0zstd");
    let mut log = text.clone();
    names.for_each(|(at, _)| log[at + 4..at + 8].copy_from_slice(b"br-1"));
    std::fs::write(&path, &log).unwrap();
    let refused = |error: String| {
        assert!(
            error.contains("`br-1`") && error.contains("expected zstd, lz4 or none"),
            "{error}"
        );
        assert!(error.contains("log.mcap"), "{error}");
    };
    refused(Contents::of(&path).unwrap_err().to_string());
    refused(repair(&path, &repaired).unwrap_err().to_string());
    assert!(!repaired.exists());
    let clock = || Arc::new(VirtualClock::new());
    refused(
        RecordedBus::open(&path, clock(), Commands::Compare)
            .err()
            .unwrap()
            .to_string(),
    );
    refused(
        RecordedCamera::open(&path, "0123", clock())
            .err()
            .unwrap()
            .to_string(),
    );
    refused(Samples::open(&path).err().unwrap().to_string());
    refused(LoggedClouds::open(&path).err().unwrap().to_string());
    refused(homes(&path).err().unwrap().to_string());
    // A single such chunk is damage to a repair, and the end of a playback: what it holds is not passed over.
    let mut one = text.clone();
    // Of the names, those of chunks come first, then those of the index of chunks.
    let names = text
        .windows(8)
        .enumerate()
        .filter(|(_, bytes)| *bytes == b"\x04\0\0\0zstd");
    let (second, _) = names.clone().nth(1).unwrap();
    assert!(names.count() > 4);
    one[second + 4..second + 8].copy_from_slice(b"br-1");
    std::fs::write(&path, &one).unwrap();
    let recovery = repair(&path, &repaired).unwrap();
    assert!(
        recovery.messages > 0 && !recovery.is_whole(),
        "{recovery:?}"
    );
    let mut samples = Samples::open(&path).unwrap();
    refused(samples.next_sample().unwrap_err().to_string());
    assert!(matches!(
        repair(Path::new("/missing"), &repaired),
        Err(LogError::File { .. })
    ));
}

/// What is played back, pictures and clouds are those of the log that is not compressed.
#[test]
fn compressed_logs_are_played_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let of = |log: &[u8]| {
        std::fs::write(&path, log).unwrap();
        let mut clouds = LoggedClouds::open(&path).unwrap();
        let mut found = Vec::new();
        while let Some(cloud) = clouds.next_cloud().unwrap() {
            found.push(format!("{cloud:?}"));
        }
        let camera = RecordedCamera::open(&path, "0123", Arc::new(VirtualClock::new())).is_ok();
        (found, homes(&path).unwrap(), camera)
    };
    let plain = of(&bytes(3, 1000));
    assert!(!plain.0.is_empty());
    for compression in BOTH {
        assert_eq!(
            of(&compressed(3, 1000, compression)),
            plain,
            "{compression:?}"
        );
    }
}

#[test]
fn the_libraries_default_is_read() {
    let mut file = Cursor::new(Vec::new());
    let mut writer = WriteOptions::new()
        .create(BufWriter::new(&mut file))
        .unwrap();
    let channel = writer
        .add_channel(0, "/mine", "json", &Default::default())
        .unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 7,
        log_time: 1,
        publish_time: 2,
    };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    drop(writer);
    let mut reader = LogReader::new(Cursor::new(file.into_inner())).unwrap();
    assert!(
        matches!(reader.next_entry(), Ok(Some(tdcr_hw::log::Entry::Message(m))) if m.data == b"{}")
    );
}

/// What we write is so compressed by default, and each message is there again.
#[test]
fn our_own_logs_are_compressed_and_smaller() {
    let folder = tempfile::tempdir().unwrap();
    let length = |chunks| {
        let path = folder.path().join(format!("{chunks:?}.mcap"));
        let settings = LogSettings {
            chunks,
            ..LogSettings::default()
        };
        let mut log = LogWriter::create(&path, &VirtualClock::new(), settings).unwrap();
        let depths: Vec<f32> = (0..320 * 240)
            .map(|k| 0.5 + 1e-4 * (k % 97) as f32)
            .collect();
        for time in 0..5 {
            let image = Image {
                width: 320,
                height: 240,
                pixels: depths.clone(),
            };
            let serial = "south".to_owned();
            let record = LogRecord::Depth { serial, image };
            log.write(Duration::from_millis(time), &record).unwrap();
        }
        log.finish().unwrap();
        let (messages, recovery) = read(&std::fs::read(&path).unwrap());
        assert!(messages.len() == 5 && recovery.is_whole());
        std::fs::metadata(&path).unwrap().len()
    };
    assert!(2 * length(ChunkFormat::default()) < length(ChunkFormat::Plain));
}
