//! A part of many values, chosen by their rows' numbers, in constant memory.

/// At most so many values of those that were added: which ones follows from their rows' numbers alone.
#[derive(Clone, Debug)]
pub(in crate::study) struct Thinned<T> {
    most: usize,
    /// Values whose key is above are left out.
    limit: u64,
    added: usize,
    kept: Vec<(u64, T)>,
}

impl<T: Clone> Thinned<T> {
    pub fn new(most: usize) -> Self {
        Self {
            most,
            limit: u64::MAX,
            added: 0,
            kept: Vec::new(),
        }
    }

    /// Adds the value of a row.
    pub fn add(&mut self, row: usize, value: T) {
        self.added += 1;
        let key = key(row);
        if key > self.limit {
            return;
        }
        self.kept.push((key, value));
        while self.kept.len() > self.most {
            self.limit /= 2;
            self.kept.retain(|(key, _)| *key <= self.limit);
        }
    }

    /// The values kept, in the order in which they came; none are left.
    pub fn take(&mut self) -> Vec<T> {
        std::mem::take(&mut self.kept)
            .into_iter()
            .map(|(_, value)| value)
            .collect()
    }
}

impl Thinned<f64> {
    /// Largest magnitude of the values kept; 0 of none.
    pub fn largest(&self) -> f64 {
        self.kept
            .iter()
            .map(|(_, value)| value.abs())
            .fold(0.0, f64::max)
    }

    /// How many were added.
    pub fn count(&self) -> usize {
        self.added
    }

    /// The values kept, ascending.
    pub fn sorted(&self) -> Vec<f64> {
        let mut values: Vec<f64> = self.kept.iter().map(|(_, value)| *value).collect();
        values.sort_by(f64::total_cmp);
        values
    }
}

/// A number that is spread evenly over all, whatever the rows' order: SplitMix64 (Steele, Lea and Flood, 2014).
fn key(row: usize) -> u64 {
    let mixed = (row as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_are_kept_whole_and_many_evenly() {
        let of = |count: usize| {
            let mut thinned = Thinned::new(1000);
            (0..count).for_each(|row| thinned.add(row, row as f64));
            thinned.sorted()
        };
        assert_eq!(of(1000).len(), 1000);
        let many = of(100_000);
        assert!((400..=1000).contains(&many.len()), "{}", many.len());
        let mean = many.iter().sum::<f64>() / many.len() as f64;
        assert!((mean / 50_000.0 - 1.0).abs() < 0.1, "{mean}");
    }
}
