//! Logs that were cut off or damaged.

use std::io::Cursor;

use proptest::prelude::*;
use tdcr_hw::log::{LogError, LogReader, LogRecord, Message, Problem, Recovery, repair};

use super::sample::{bytes, read};

/// Messages of a log, each with the byte of the file at which it is whole: where it stands, found by its bytes.
fn ends(log: &[u8], messages: &[Message]) -> Vec<usize> {
    let mut from = 0;
    let ends = messages.iter().map(|message| {
        // As the format's specification has it: opcode, length, channel, sequence, times, data.
        let mut record = vec![5];
        record.extend((22 + message.data.len() as u64).to_le_bytes());
        let found = (from..log.len()).find(|&at| {
            log[at..].starts_with(&record)
                && log[at + 11..].starts_with(&message.sequence.to_le_bytes())
                && log[at + 31..].starts_with(&message.data)
        });
        from = found.unwrap() + 31 + message.data.len();
        from
    });
    ends.collect()
}

#[test]
fn a_log_cut_at_any_byte_gives_all_messages_that_are_whole() {
    for chunk in [1 << 20, 700] {
        let log = bytes(1, chunk);
        let (messages, _) = read(&log);
        let ends = ends(&log, &messages);
        for cut in 0..log.len() {
            let (found, recovery) = read(&log[..cut]);
            let expected = ends.iter().filter(|&&end| end <= cut).count();
            assert_eq!(found, messages[..expected], "cut at byte {cut}");
            assert!(!recovery.is_whole(), "cut at byte {cut}");
            assert_eq!(recovery.damages, 1);
            let begins = recovery.damage[0].at as usize;
            assert!(begins <= cut, "cut at byte {cut}: {recovery:?}");
            let last = ends[..expected].last().copied().unwrap_or(0);
            assert!(begins >= last, "cut at byte {cut}: {recovery:?}");
        }
        assert_eq!(read(&log).0, messages);
    }
}

/// Whether all of `found` are among `messages`, in their order.
fn in_order(found: &[Message], messages: &[Message]) -> bool {
    let mut rest = messages.iter();
    found
        .iter()
        .all(|message| rest.any(|other| other == message))
}

#[test]
fn a_damaged_byte_costs_one_chunk_and_changes_no_message() {
    let log = bytes(2, 700);
    let (messages, _) = read(&log);
    let mut reported = 0;
    for at in 0..log.len() {
        let mut damaged = log.clone();
        damaged[at] ^= 1 << (at % 8);
        let (found, recovery) = read(&damaged);
        assert!(in_order(&found, &messages), "byte {at}");
        let lost = messages.len() - found.len();
        if lost > 0 {
            assert!(
                !recovery.is_whole(),
                "byte {at}: {lost} lost without a word"
            );
            reported += 1;
            let begins = recovery.damage.first().map(|damage| damage.at as usize);
            assert!(
                begins.is_none_or(|begins| begins <= at),
                "byte {at}: {recovery:?}"
            );
        }
        // The first chunk's definitions stand again in the summary.
        assert!(lost <= 8, "byte {at}: {lost} lost");
    }
    assert!(reported > log.len() / 2);
}

#[test]
fn a_hole_in_a_log_costs_what_was_in_it() {
    let log = bytes(40, 2000);
    let (messages, _) = read(&log);
    let mut damaged = log.clone();
    let middle = log.len() / 2;
    // All kinds of records begin within, and end.
    damaged[middle..middle + 5000].fill(0x55);
    let (found, recovery) = read(&damaged);
    assert!(in_order(&found, &messages));
    let all_lost = messages.len() - found.len();
    let ends = ends(&log, &messages);
    let near = |end: &&usize| (middle - 3000..middle + 8000).contains(*end);
    assert!(
        all_lost <= ends.iter().filter(near).count(),
        "{all_lost} lost"
    );
    assert_eq!(recovery.stated, Some(messages.len() as u64));
    let begins = recovery.damage[0].at as usize;
    // An index of messages, which nothing checks, may hide the first bytes of the hole.
    let near = middle - 3000..=middle + 64;
    assert!(near.contains(&begins), "{middle}: {recovery:?}");
    // Bytes that are missing altogether.
    let shorter = [&log[..middle], &log[middle + 3333..]].concat();
    let (found, _) = read(&shorter);
    assert!(in_order(&found, &messages));
    assert!(
        messages.len() - found.len() <= all_lost,
        "{} left",
        found.len()
    );
    // The beginning.
    let (found, recovery) = read(&log[1..]);
    assert_eq!(found, messages);
    assert_eq!(recovery.damage[0].problem, Problem::NoMagic);
}

#[test]
fn a_length_beyond_reason_takes_no_memory() {
    let log = bytes(1, 1 << 20);
    let (messages, _) = read(&log);
    // The length of each record outside chunks: after the magic, the header and the chunk.
    let header = 8;
    let length = |at: usize| u64::from_le_bytes(log[at + 1..at + 9].try_into().unwrap());
    let chunk = header + 9 + length(header) as usize;
    for at in [header, chunk] {
        for value in [1_u64 << 60, u64::MAX, u64::MAX - 8, 1 << 40] {
            let mut damaged = log.clone();
            damaged[at + 1..at + 9].copy_from_slice(&value.to_le_bytes());
            let (found, recovery) = read(&damaged);
            assert!(in_order(&found, &messages));
            assert!(!recovery.is_whole());
        }
    }
    // A chunk whose lengths agree on more than there is: its messages are read, up to the file's end.
    let mut damaged = log.clone();
    let records = (1_u64 << 60) - 40;
    damaged[chunk + 1..chunk + 9].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    damaged[chunk + 25..chunk + 33].copy_from_slice(&records.to_le_bytes());
    damaged[chunk + 41..chunk + 49].copy_from_slice(&records.to_le_bytes());
    let (found, recovery) = read(&damaged);
    assert_eq!(found, messages);
    assert!(!recovery.is_whole());
}

#[test]
fn a_repaired_log_is_whole_and_has_what_could_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let [broken, repaired] = ["broken", "repaired"].map(|name| folder.path().join(name));
    let log = bytes(3, 1000);
    for cut in [log.len(), log.len() - 1, log.len() * 2 / 3, 100, 8] {
        std::fs::write(&broken, &log[..cut]).unwrap();
        let recovery = repair(&broken, &repaired).unwrap();
        let (expected, found) = read(&log[..cut]);
        assert_eq!(recovery, found);
        let whole = std::fs::read(&repaired).unwrap();
        let (messages, after) = read(&whole);
        assert_eq!(messages, expected);
        assert!(after.is_whole(), "{after:?}");
        assert_eq!(after.stated, Some(expected.len() as u64));
        let theirs = mcap::MessageStream::new(&whole).unwrap();
        assert_eq!(theirs.map(Result::unwrap).count(), expected.len());
    }
    // In its own place.
    repair(&broken, &broken).unwrap();
    assert!(read(&std::fs::read(&broken).unwrap()).1.is_whole());
    let before = std::fs::read(&repaired).unwrap();
    for other in [&b""[..], b"\x89MCAP0\r", b"PNG and whatever else one has"] {
        std::fs::write(&broken, other).unwrap();
        let refused = repair(&broken, &repaired);
        assert!(
            matches!(refused, Err(LogError::NotALog { .. })),
            "{other:?}"
        );
    }
    assert_eq!(std::fs::read(&repaired).unwrap(), before);
}

#[test]
fn attachments_metadata_and_strangers_records_survive_a_repair() {
    let folder = tempfile::tempdir().unwrap();
    let [theirs, repaired] = ["theirs", "repaired"].map(|name| folder.path().join(name));
    let mut writer = mcap::WriteOptions::new()
        .compression(None)
        .create(std::fs::File::create(&theirs).unwrap())
        .unwrap();
    let attachment = mcap::Attachment {
        log_time: 1,
        create_time: 2,
        name: "robot.urdf".to_owned(),
        media_type: "text/xml".to_owned(),
        data: b"<robot/>"[..].into(),
    };
    writer.attach(&attachment).unwrap();
    let metadata = mcap::records::Metadata {
        name: "rig".to_owned(),
        metadata: [("owner".to_owned(), "us".to_owned())].into(),
    };
    writer.write_metadata(&metadata).unwrap();
    writer
        .write_private_record(0x90, b"private", Default::default())
        .unwrap();
    writer.finish().unwrap();
    let recovery = repair(&theirs, &repaired).unwrap();
    assert!(recovery.is_whole(), "{recovery:?}");
    let bytes = std::fs::read(&repaired).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.attachment_indexes[0].name, "robot.urdf");
    assert_eq!(
        mcap::read::attachment(&bytes, &summary.attachment_indexes[0])
            .unwrap()
            .data,
        attachment.data
    );
    assert_eq!(
        mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap(),
        metadata
    );
}

/// Reads everything, and what it says.
fn read_all(bytes: &[u8]) -> Recovery {
    let mut reader = LogReader::new(Cursor::new(bytes)).unwrap();
    while let Some(entry) = reader.next_entry().unwrap() {
        if let tdcr_hw::log::Entry::Message(message) = entry {
            drop(LogRecord::decode(&message.channel, &message.data));
        }
    }
    reader.recovery().clone()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn bytes_of_any_kind_are_read_to_their_end(
        start in any::<bool>(),
        bytes in prop::collection::vec(prop_oneof![any::<u8>(), 0_u8..16], 0..400),
    ) {
        let magic: &[u8] = if start { b"\x89MCAP0\r\n" } else { b"" };
        let recovery = read_all(&[magic, &bytes].concat());
        prop_assert!(recovery.damages > 0);
    }
}

#[test]
fn a_file_in_which_each_byte_begins_a_chunk_takes_no_more_than_a_moment() {
    // Chunk headers one after another, each of a chunk that reaches to the end.
    let mut file = Vec::new();
    let (count, size) = (20_000_u64, 58);
    for index in 0..count {
        let length = (count - index) * size - 9;
        file.push(6);
        file.extend(length.to_le_bytes());
        file.extend([0; 16]);
        file.extend((length - 40).to_le_bytes());
        file.extend(1_u32.to_le_bytes());
        file.extend(0_u32.to_le_bytes());
        file.extend((length - 40).to_le_bytes());
        file.push(5);
        file.extend(0_u64.to_le_bytes());
    }
    let began = std::time::Instant::now();
    assert!(read_all(&file).is_nothing());
    assert!(began.elapsed().as_secs_f64() < 5.0);
}
