//! A random permutation of the numbers below a count in constant memory: each place is computed when it is asked for.
//!
//! A Feistel network of keyed rounds permutes the numbers of an even number of bits (Luby and Rackoff, "How to construct
//! pseudorandom permutations from pseudorandom functions", 1988). A number that comes out at the count or beyond is permuted
//! again until it lies below (cycle walking: Black and Rogaway, "Ciphers with arbitrary finite domains", 2002). The rounds'
//! function is the finaliser of SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014).

use rand::{Rng, RngExt};

/// Four make it hard to tell from chance where the numbers have many bits; few bits take more to mix.
const ROUNDS: usize = 12;

/// A permutation of `0..count`.
#[derive(Clone, Debug)]
pub(super) struct Permutation {
    count: u64,
    /// Bits of each half of the numbers that the network permutes: fewer than four for each number below the count.
    half: u32,
    keys: [u64; ROUNDS],
}

impl Permutation {
    /// The permutation of the numbers below `count` that `rng` draws.
    pub fn new(count: usize, rng: &mut impl Rng) -> Self {
        let count = count as u64;
        let bits = u64::BITS - count.saturating_sub(1).leading_zeros();
        Self {
            count,
            half: bits.div_ceil(2).max(1),
            keys: rng.random(),
        }
    }

    /// Where number `index` goes.
    ///
    /// # Panics
    /// For an index that is not below the count.
    pub fn place(&self, index: usize) -> usize {
        let mut place = index as u64;
        assert!(place < self.count, "{place} is not below {}", self.count);
        // The walk ends: it goes along a cycle that contains the index, which is below the count.
        loop {
            place = self.network(place);
            if place < self.count {
                return place as usize;
            }
        }
    }

    fn network(&self, number: u64) -> u64 {
        let mask = (1 << self.half) - 1;
        let (mut high, mut low) = (number >> self.half, number & mask);
        for key in self.keys {
            (high, low) = (low, high ^ (mix(low ^ key) & mask));
        }
        high << self.half | low
    }
}

/// SplitMix64's finaliser.
fn mix(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::rng;
    use super::*;

    #[test]
    fn each_number_comes_once() {
        for count in (1..70).chain([255, 256, 257, 4097, 100_000]) {
            let permutation = Permutation::new(count, &mut rng(1, count as u64));
            let mut there = vec![false; count];
            for index in 0..count {
                there[permutation.place(index)] = true;
            }
            assert!(there.into_iter().all(|there| there), "{count}");
        }
    }

    #[test]
    fn few_numbers_come_in_each_order_equally_often() {
        const DRAWS: u64 = 24_000;
        let mut orders = BTreeMap::new();
        for seed in 0..DRAWS {
            let permutation = Permutation::new(4, &mut rng(seed, 0));
            let order: Vec<usize> = (0..4).map(|index| permutation.place(index)).collect();
            *orders.entry(order).or_insert(0.0) += 1.0;
        }
        // Pearson's chi-squared: 24 orders have 23 degrees of freedom, so it has mean 23 and deviation 6.8.
        let expected = DRAWS as f64 / 24.0;
        let statistic: f64 = (orders.values())
            .map(|&count: &f64| (count - expected).powi(2) / expected)
            .sum();
        assert_eq!(orders.len(), 24);
        assert!(statistic < 60.0, "{statistic}");
    }

    #[test]
    fn places_depend_neither_on_the_number_nor_on_another_permutation() {
        const COUNT: usize = 10_000;
        let [one, other] = [0, 1].map(|stream| Permutation::new(COUNT, &mut rng(7, stream)));
        let correlation = |pair: &dyn Fn(usize) -> [usize; 2]| {
            let centre = (COUNT - 1) as f64 / 2.0;
            let variance = (COUNT as f64 * COUNT as f64 - 1.0) / 12.0;
            let products = (0..COUNT).map(|index| {
                let [a, b] = pair(index).map(|place| place as f64 - centre);
                a * b
            });
            products.sum::<f64>() / (COUNT as f64 * variance)
        };
        // Of numbers in random order it has deviation 1 / sqrt(COUNT), 0.01.
        let found = [
            correlation(&|index| [index, one.place(index)]),
            correlation(&|index| [one.place(index), one.place((index + 1) % COUNT)]),
            correlation(&|index| [one.place(index), other.place(index)]),
        ];
        assert!(found.iter().all(|found| found.abs() < 0.04), "{found:?}");
    }
}
