//! Rank correlation.

/// Spearman's rank correlation of the pairs `(x[i], y[i])`, in [-1, 1]: Pearson's of their ranks, where equal values
/// share the mean of their ranks. `None` where all values of one side are equal, or there are fewer than two pairs.
///
/// # Panics
/// Where `x` and `y` have different lengths.
pub fn rank_correlation(x: &[f64], y: &[f64]) -> Option<f64> {
    assert_eq!(x.len(), y.len(), "values come in pairs");
    let (x, y) = (centred_ranks(x), centred_ranks(y));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let norm = (product(&x, &x) * product(&y, &y)).sqrt();
    (norm > 0.0).then(|| product(&x, &y) / norm)
}

/// The rank of each value, from 0, less the mean rank.
fn centred_ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let middle = (values.len() as f64 - 1.0) / 2.0;
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    for equal in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let rank = first as f64 + (equal.len() as f64 - 1.0) / 2.0;
        equal.iter().for_each(|&k| ranks[k] = rank - middle);
        first += equal.len();
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_correlation_is_that_of_scipy() {
        // scipy.stats.spearmanr, SciPy 1.17.1.
        let cases: [(&[f64], &[f64], f64); 3] = [
            (
                &[0.3, 0.1, 0.7, 0.2, 1.5, 0.4],
                &[2.0, 1.0, 5.0, 3.0, 4.0, 0.5],
                0.5428571428571429,
            ),
            (
                &[1.0, 2.0, 2.0, 2.0, 3.0, 5.0, 5.0],
                &[4.0, 3.0, 3.0, 7.0, 9.0, 9.0, 1.0],
                0.12386008926958972,
            ),
            (
                &[1.0, 1.0, 1.0, 2.0],
                &[0.0, 0.0, 1.0, 1.0],
                0.5773502691896257,
            ),
        ];
        for (x, y, expected) in cases {
            let found = rank_correlation(x, y);
            assert!(
                found.is_some_and(|found| (found - expected).abs() < 1e-14),
                "{found:?}"
            );
        }
    }

    #[test]
    fn what_rises_with_the_other_correlates_wholly() {
        let x = [0.1, 0.5, 0.2, 3.0];
        assert_eq!(rank_correlation(&x, &x.map(f64::exp)), Some(1.0));
        assert_eq!(rank_correlation(&x, &x.map(|x| -x)), Some(-1.0));
    }

    #[test]
    fn equal_values_have_no_ranks_to_correlate() {
        assert_eq!(rank_correlation(&[1.0; 3], &[1.0, 2.0, 3.0]), None);
        assert_eq!(rank_correlation(&[1.0], &[1.0]), None);
        assert_eq!(rank_correlation(&[], &[]), None);
    }
}
