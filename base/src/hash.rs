//! A hash that tells runs, sets and priors apart, in files too.

/// FNV-1a over 32-bit words (Fowler, Noll and Vo; offset basis and prime of 64 bits).
pub fn hash(words: impl Iterator<Item = u32>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |hash, word| {
        (hash ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// The same over hashes, each as two words, the lower first.
pub fn hash_all(hashes: &[u64]) -> u64 {
    hash(hashes.iter().flat_map(|x| [*x as u32, (*x >> 32) as u32]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_published_algorithm() {
        // FNV-1a of the bytes of "a" and "foobar", from the test suite of its authors: a byte is a word here.
        let of = |text: &str| hash(text.bytes().map(u32::from));
        assert_eq!(of(""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(of("a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(of("foobar"), 0x8594_4171_f739_67e8);
        assert_eq!(hash_all(&[(2 << 32) | 1]), hash([1, 2].into_iter()));
    }
}
