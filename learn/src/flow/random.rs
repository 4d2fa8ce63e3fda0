//! Random streams: each a pure function of a seed and a purpose.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The purpose of a random stream. No two share numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// Initial parameters of a network.
    Parameters,
    /// The batch of a training step.
    Step(u64),
    /// The noise of a predicted cloud.
    Sample(u64),
    /// The order of a training set's clouds in an epoch.
    Epoch(u64),
    /// The noise of a cloud that a network predicts to learn from.
    Own(u64),
}

/// The generator of `stream` under `seed`.
///
/// Resuming at step `k` needs no saved generator: it is `rng(seed, Stream::Step(k))` again. Indices are below `2^61`.
pub fn rng(seed: u64, stream: Stream) -> ChaCha8Rng {
    let (purpose, index) = match stream {
        Stream::Parameters => (0, 0),
        Stream::Step(index) => (1, index),
        Stream::Sample(index) => (2, index),
        Stream::Epoch(index) => (3, index),
        // The upper half of the samples' indices.
        Stream::Own(index) => (2, (1 << 61) | index),
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((purpose << 62) | index);
    rng
}
