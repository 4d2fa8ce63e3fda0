//! How many samples a data set may have.

/// Fewest samples that split 80/10/10 with none empty.
pub(super) const MIN_SAMPLES: usize = 10;

/// Most samples: far above any data set's, and few enough that their indices fit into memory.
pub(super) const MAX_SAMPLES: usize = 10_000_000;
