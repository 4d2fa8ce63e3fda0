//! A whole log out of what is left of one.

use std::io::{BufWriter, Write};
use std::path::Path;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapResult, Writer};
use tdcr_base::files::AtomicFile;

use super::error::LogError;
use super::message::Entry;
use super::read::LogReader;
use super::recovery::Recovery;
use super::write::{LogSettings, options};

/// Writes what can be read of the log `from` as a whole log `to`, and says what that was. Messages, files and texts of the
/// log are copied as they are, also those that are not ours.
///
/// # Errors
/// [`LogError`]; `to` then holds what it held before.
pub fn repair(from: &Path, to: &Path) -> Result<Recovery, LogError> {
    let mut reader = LogReader::open(from)?;
    let at = |path: &Path| {
        let path = path.to_owned();
        |source| LogError::File { path, source }
    };
    let file = AtomicFile::create(to).map_err(at(to))?;
    let write = |source| LogError::Write { source };
    let mut writer = options(LogSettings::default())
        .create(NoSeek::new(BufWriter::new(file)))
        .map_err(write)?;
    while let Some(entry) = reader.next_entry().map_err(at(from))? {
        copy(&mut writer, &entry).map_err(write)?;
    }
    reader.recovery().require_readable(from)?;
    writer.finish().map_err(write)?;
    let mut buffered = writer.into_inner().into_inner();
    buffered.flush().map_err(at(to))?;
    let file = buffered.into_inner().map_err(|e| e.into_error());
    file.and_then(AtomicFile::commit).map_err(at(to))?;
    Ok(reader.recovery().clone())
}

fn copy(writer: &mut Writer<NoSeek<BufWriter<AtomicFile>>>, entry: &Entry) -> McapResult<()> {
    match entry {
        Entry::Attachment(attachment) => writer.attach(attachment),
        Entry::Metadata(metadata) => writer.write_metadata(metadata),
        Entry::Message(message) => {
            let channel = &message.channel;
            let schema = match &channel.schema {
                None => 0,
                Some(schema) => writer.add_schema(&schema.name, &schema.encoding, &schema.data)?,
            };
            let channel_id =
                writer.add_channel(schema, &channel.topic, &channel.encoding, &channel.metadata)?;
            let header = MessageHeader {
                channel_id,
                sequence: message.sequence,
                log_time: message.log_time,
                publish_time: message.publish_time,
            };
            writer.write_to_known_channel(&header, &message.data)
        }
    }
}
