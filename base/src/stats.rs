//! Quantiles and medians, of one definition.
//!
//! Between two values, a quantile is interpolated linearly: definition 7 of Hyndman and Fan, "Sample quantiles in statistical
//! packages", The American Statistician 50 (1996), which is the default of NumPy (`method="linear"`), R and Julia. The median of
//! an even count is thus the mean of the two values in the middle.

/// The value that the share `share` (0 to 1) of values is below; not a number of no values.
///
/// The values are in ascending order, by [`f64::total_cmp`]. Beside an infinite value nothing is interpolated: the lower one
/// of the two counts.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = place as usize;
    let (low, high) = (sorted[below], sorted[(below + 1).min(last)]);
    let rise = (place - below as f64) * (high - low);
    match rise.is_nan() && !high.is_nan() {
        true => low,
        false => low + rise,
    }
}

/// The median of values, which are sorted for it; not a number of no values.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    quantile(values, 0.5)
}

/// Values in ascending order, as [`quantile`] takes them.
pub fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_numpys() {
        let values = sorted([0.3, 0.1, 0.7, 0.2, 1.5, 0.4]);
        // numpy.quantile(values, [0, 0.05, 0.25, 0.5, 0.75, 0.95, 1])
        let expected = [
            (0.0, 0.1),
            (0.05, 0.125),
            (0.25, 0.225),
            (0.5, 0.35),
            (0.75, 0.625),
            (0.95, 1.3),
            (1.0, 1.5),
        ];
        for (share, expected) in expected {
            let found = quantile(&values, share);
            assert!((found - expected).abs() < 1e-15, "{share}: {found}");
        }
    }

    #[test]
    fn the_median_of_an_even_count_is_the_mean_of_the_middle_two() {
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 8.0]), 3.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [7.0]), 7.0);
        assert!(median(&mut []).is_nan());
    }

    #[test]
    fn infinite_values_are_not_interpolated() {
        let infinite = f64::INFINITY;
        assert_eq!(median(&mut [1.0, 2.0, infinite]), 2.0);
        assert_eq!(median(&mut [1.0, infinite, infinite]), infinite);
        assert_eq!(
            median(&mut [1.0, infinite, infinite, infinite, infinite, infinite]),
            infinite
        );
        assert_eq!(median(&mut [-infinite, -infinite, 0.0]), -infinite);
        assert!(median(&mut [1.0, f64::NAN]).is_nan());
        assert!(quantile(&[f64::NAN], 0.5).is_nan());
    }
}
