//! TensorBoard's event files: records of scalars over steps.
//!
//! A record is its length (u64), the masked checksum of those eight bytes, the data, and their masked checksum, all
//! little-endian (TFRecord). The data are a protocol buffer `Event`: `wall_time` (field 1, double, s since 1970), `step`
//! (2, varint), and either `file_version` (3, string), which the first record has, or `summary` (5): values (1), each a
//! `tag` (1, string) and a `simple_value` (2, float).

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use tdcr_base::files;

/// Largest event file that is gone on with (bytes): three million steps of ten scalars each.
const LARGEST: u64 = 1 << 30;

/// An event file that grows.
#[derive(Debug)]
pub(super) struct EventFile {
    file: File,
}

impl EventFile {
    /// Opens the file, or makes it, and drops from it half a record that a killed process left, and all after step
    /// `until`. Also returns the last step that it then has; 0 for none.
    pub fn open(path: &Path, until: u64) -> io::Result<(Self, u64)> {
        if path.exists() {
            let length = files::regular(path)?.len();
            if length > LARGEST {
                let reason = format!("{length} bytes; expected at most {LARGEST}");
                return Err(io::Error::new(io::ErrorKind::FileTooLarge, reason));
            }
        }
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        let (mut kept, mut last) = (0, 0);
        while let Some(data) = first_record(&bytes[kept..]) {
            match step(data) {
                Some(step) if step <= until => last = step,
                _ => break,
            }
            kept += data.len() + FRAME;
        }
        file.set_len(kept as u64)?;
        file.seek(SeekFrom::End(0))?;
        let mut events = Self { file };
        if kept == 0 {
            events.add(0, |event| put_bytes(event, 3, b"brain.Event:2"))?;
        }
        Ok((events, last))
    }

    /// Adds scalars of a step.
    pub fn add_scalars(&mut self, step: u64, scalars: &[(&str, f64)]) -> io::Result<()> {
        let mut summary = Vec::new();
        for (tag, scalar) in scalars {
            let mut value = Vec::new();
            put_bytes(&mut value, 1, tag.as_bytes());
            value.push(2 << 3 | FIXED_32);
            value.extend((*scalar as f32).to_le_bytes());
            put_bytes(&mut summary, 1, &value);
        }
        self.add(step, |event| put_bytes(event, 5, &summary))
    }

    fn add(&mut self, step: u64, content: impl FnOnce(&mut Vec<u8>)) -> io::Result<()> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let mut event = vec![1 << 3 | FIXED_64];
        // A clock before 1970 is 1970.
        event.extend(now.unwrap_or_default().as_secs_f64().to_le_bytes());
        event.push(2 << 3 | VARINT);
        put_varint(&mut event, step);
        content(&mut event);
        self.file.write_all(&record(&event))
    }

    /// Flushes all to the disk.
    pub fn sync(&self) -> io::Result<()> {
        self.file.sync_data()
    }
}

/// Wire types of protocol buffers.
const VARINT: u8 = 0;
const FIXED_64: u8 = 1;
const LENGTH_DELIMITED: u8 = 2;
const FIXED_32: u8 = 5;

/// Bytes of a record beside its data.
const FRAME: usize = 16;

fn record(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let checksums = [&length[..], data].map(|bytes| masked_checksum(bytes).to_le_bytes());
    [&length, &checksums[0][..], data, &checksums[1]].concat()
}

/// The data of the record at the beginning of `bytes`; none where it is not whole.
fn first_record(bytes: &[u8]) -> Option<&[u8]> {
    let length = u64::from_le_bytes(*bytes.first_chunk()?);
    let data = bytes.get(12..)?.get(..usize::try_from(length).ok()?)?;
    bytes.starts_with(&record(data)).then_some(data)
}

/// The step of an event as [`EventFile`] writes it.
fn step(event: &[u8]) -> Option<u64> {
    let varint = event.get(10..)?;
    let mut step = 0;
    for (place, byte) in varint.iter().take(10).enumerate() {
        step |= u64::from(byte & 0x7f).checked_shl(7 * place as u32)?;
        if byte & 0x80 == 0 {
            return Some(step);
        }
    }
    None
}

fn put_varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn put_bytes(bytes: &mut Vec<u8>, field: u8, content: &[u8]) {
    bytes.push(field << 3 | LENGTH_DELIMITED);
    put_varint(bytes, content.len() as u64);
    bytes.extend(content);
}

fn masked_checksum(bytes: &[u8]) -> u32 {
    crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

/// CRC-32C (Castagnoli), bit by bit: records are short.
fn crc32c(bytes: &[u8]) -> u32 {
    let bit = |crc: u32, _| (crc >> 1) ^ ((crc & 1) * 0x82f6_3b78);
    !(bytes.iter()).fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), bit))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    /// RFC 3720, B.4, and the check value of the catalogue of CRCs.
    #[test]
    fn checksums_are_those_of_the_standard() {
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    fn steps(path: &Path) -> Vec<u64> {
        let bytes = std::fs::read(path).unwrap();
        let (mut at, mut steps) = (0, vec![]);
        while let Some(data) = first_record(&bytes[at..]) {
            at += data.len() + FRAME;
            steps.push(step(data).unwrap());
        }
        assert_eq!(at, bytes.len());
        steps
    }

    #[test]
    fn a_file_goes_on_after_the_step_asked_for_and_without_half_records() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events");
        let (mut events, last) = EventFile::open(&path, 0).unwrap();
        assert_eq!(last, 0);
        for step in [100, 200, 300] {
            events.add_scalars(step, &[("loss", 0.5)]).unwrap();
        }
        assert_eq!(EventFile::open(&path, 250).unwrap().1, 200);
        assert_eq!(steps(&path), [0, 100, 200]);
        let bytes = std::fs::read(&path).unwrap();
        for cut in 1..=bytes.len() {
            std::fs::write(&path, &bytes[..bytes.len() - cut]).unwrap();
            let (mut events, last) = EventFile::open(&path, 250).unwrap();
            events.add_scalars(last + 7, &[]).unwrap();
            let kept = steps(&path);
            assert_eq!((kept[0], kept[kept.len() - 1]), (0, last + 7), "cut {cut}");
        }
    }
}
