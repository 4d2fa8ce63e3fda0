//! What the reader of HDF5 cannot read, in words that say whether the file is damaged, or newer or compressed otherwise than the
//! reader knows.

use hdf5_pure::{Error, FormatError};

/// How to write a file so that it is read.
const REWRITE: &str = "write it again in h5py without libver=\"latest\", or with `h5repack IN OUT`";

/// What the reader says, or what is true where that misleads.
pub(super) fn reason(error: &Error) -> String {
    let Error::Format(format) = error else {
        return error.to_string();
    };
    if let Some((part, version, [oldest, newest])) = version_of(format) {
        return if version > newest {
            format!(
                "its {part} is of version {version}, newer than this reader knows (up to {newest}), unless the file is damaged: \
                 {REWRITE}"
            )
        } else if version < oldest {
            format!(
                "its {part} is of version {version}, older than this reader knows (from {oldest}), unless the file is damaged: \
                 write it again with h5py, or with `h5repack IN OUT`"
            )
        } else {
            format.to_string()
        };
    }
    match format {
        FormatError::UnsupportedFilter(id) => format!(
            "it is stored with the filter {}, which this reader does not know: write it again with gzip or without a filter, as \
             `h5repack -f GZIP=4 IN OUT` does",
            filter(*id)
        ),
        FormatError::InvalidChunkIndexType(kind) => format!(
            "its chunks are indexed by type {kind}, newer than this reader knows (up to 5), unless the file is damaged: {REWRITE}"
        ),
        FormatError::UnsupportedVirtualLayout => {
            "it is a virtual dataset, whose numbers are in other files, which are not read: copy it into one file".to_owned()
        }
        FormatError::UnsupportedExternalStorage => {
            "its numbers are in an external file, which is not read: copy it into one file, as `h5repack` does".to_owned()
        }
        FormatError::UnsupportedMessage(kind) => format!(
            "it has a message of type {kind:#06x}, which must be understood and is newer than this reader: {REWRITE}"
        ),
        _ => format.to_string(),
    }
}

/// Part of a file whose version is refused, that version, and the oldest and the newest that are read.
fn version_of(error: &FormatError) -> Option<(&'static str, u8, [u8; 2])> {
    Some(match *error {
        FormatError::UnsupportedVersion(found) => ("superblock", found, [0, 3]),
        FormatError::InvalidObjectHeaderVersion(found) => ("object header", found, [1, 2]),
        FormatError::InvalidDataspaceVersion(found) => ("dataspace", found, [1, 2]),
        FormatError::InvalidLayoutVersion(found) => ("data layout", found, [3, 4]),
        FormatError::InvalidFilterPipelineVersion(found) => ("list of filters", found, [1, 2]),
        FormatError::InvalidAttributeVersion(found) => ("attribute", found, [1, 3]),
        FormatError::InvalidDatatypeVersion { version, .. } => ("data type", version, [1, 5]),
        FormatError::UnsupportedFillValueVersion(found) => ("fill value", found, [1, 3]),
        FormatError::InvalidLinkVersion(found) => ("link", found, [1, 1]),
        FormatError::InvalidLinkInfoVersion(found) => ("table of links", found, [0, 0]),
        FormatError::InvalidBTreeV2Version(found) => ("B-tree", found, [0, 0]),
        FormatError::InvalidFractalHeapVersion(found) => ("fractal heap", found, [0, 0]),
        _ => return None,
    })
}

/// A filter's name (HDF Group, registered filter plugins) and number.
fn filter(id: u16) -> String {
    let name = match id {
        1 => "gzip",
        2 => "shuffle",
        3 => "fletcher32",
        4 => "szip",
        5 => "nbit",
        6 => "scale-offset",
        307 => "bzip2",
        32000 => "lzf",
        32001 => "blosc",
        32004 => "lz4",
        32008 => "bitshuffle",
        32013 => "zfp",
        32015 => "zstd",
        32017 => "sz",
        32026 => "blosc2",
        _ => return format!("number {id}"),
    };
    format!("{name} (number {id})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newer_and_older_features_are_named_and_damage_is_not_called_so() {
        let said = |format| reason(&Error::Format(format));
        for (format, expected) in [
            (
                FormatError::InvalidLayoutVersion(5),
                "data layout is of version 5, newer than this reader knows (up to 4)",
            ),
            (
                FormatError::InvalidLayoutVersion(2),
                "data layout is of version 2, older than this reader knows (from 3)",
            ),
            (
                FormatError::UnsupportedVersion(4),
                "superblock is of version 4, newer",
            ),
            (
                FormatError::UnsupportedFilter(32015),
                "the filter zstd (number 32015)",
            ),
            (FormatError::UnsupportedFilter(40000), "number 40000"),
            (FormatError::UnsupportedVirtualLayout, "virtual dataset"),
            (FormatError::InvalidChunkIndexType(6), "indexed by type 6"),
        ] {
            let text = said(format.clone());
            assert!(text.contains(expected), "{format:?}: {text}");
        }
        let damaged = FormatError::SignatureNotFound;
        assert_eq!(said(damaged.clone()), damaged.to_string());
    }
}
