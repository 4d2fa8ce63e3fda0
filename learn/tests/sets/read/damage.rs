//! Shards that were cut or whose bytes were changed.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use proptest::prelude::*;
use tdcr_learn::data::{DataError, DataSet, Split};
use tempfile::{TempDir, tempdir};

use crate::common::{CHUNKED, chunked, collect, meta};

/// A small shard of ours and one of h5py's, whole.
static WHOLE: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    [dir.path(), Path::new(CHUNKED)].map(|dir| fs::read(dir.join("val/shard-00000.h5")).unwrap())
});

/// One folder for all damaged shards, which are many.
static DAMAGED: LazyLock<TempDir> = LazyLock::new(chunked);

/// Reads a set whose val shard holds `bytes`; a panic fails the test, whatever is returned.
fn read_damaged(dir: &TempDir, bytes: &[u8]) -> Result<(), DataError> {
    let path = dir.path().join("val/shard-00000.h5");
    // A file written in place of another is flushed to the disk by some file systems, which is slow.
    fs::remove_file(&path).unwrap();
    fs::write(&path, bytes).unwrap();
    let set = DataSet::open(dir.path())?;
    set.read_split(Split::Val)?;
    set.cloud_set(Split::Val)?;
    Ok(())
}

#[test]
fn a_truncated_shard_is_refused_at_every_length() {
    let dir = chunked();
    for whole in WHOLE.iter() {
        for length in 0..whole.len() {
            let refused = read_damaged(&dir, &whole[..length]);
            assert!(
                matches!(refused, Err(DataError::Unreadable { .. })),
                "{length}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn no_damage_to_a_shard_makes_the_reader_panic(
        file in 0..2_usize,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = WHOLE[file].clone();
        for (position, value) in damage {
            let position = position.index(bytes.len());
            bytes[position] = value;
        }
        // Damage to the numbers themselves cannot be told from numbers.
        let _ = read_damaged(&DAMAGED, &bytes);
    }
}
