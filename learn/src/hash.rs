//! A hash that tells runs, sets and priors apart, in files too.

/// FNV-1a over 32-bit words.
pub(crate) fn hash(words: impl Iterator<Item = u32>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |hash, word| {
        (hash ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// The same over hashes.
pub(crate) fn hash_all(hashes: &[u64]) -> u64 {
    hash(hashes.iter().flat_map(|x| [*x as u32, (*x >> 32) as u32]))
}
