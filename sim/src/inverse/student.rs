//! Student's t distribution, and the normal one that it comes to.

use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

/// The `z` with `P(|Z| <= z) = 0.95` for the normal distribution.
pub(super) const NORMAL: f64 = 1.959963984540054;

/// The `t` with `P(|T| <= t) = level` for `freedom >= 1` degrees of freedom.
pub(super) fn two_sided_quantile(level: f64, freedom: usize) -> f64 {
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    // Halved until no number lies between.
    while let middle = 0.5 * (low + high)
        && low < middle
        && middle < high
    {
        if probability_within(middle, freedom) < level {
            low = middle;
        } else {
            high = middle;
        }
    }
    high.tan() * (freedom as f64).sqrt()
}

/// `P(|T| <= sqrt(freedom) tan(angle))`: the finite series of Abramowitz and Stegun, 26.7.3 and
/// 26.7.4.
fn probability_within(angle: f64, freedom: usize) -> f64 {
    let (sin, cos) = angle.sin_cos();
    let odd = freedom % 2 == 1;
    let (mut term, mut k) = if odd { (cos, 3) } else { (1.0, 2) };
    let mut sum = 0.0;
    while k <= freedom {
        sum += term;
        term *= cos * cos * (k - 1) as f64 / k as f64;
        k += 2;
    }
    if odd {
        FRAC_2_PI * (angle + sin * sum)
    } else {
        sin * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `scipy.stats.t.ppf((1 + level) / 2, freedom)`.
    #[test]
    fn quantiles_are_scipys() {
        for (level, freedom, expected) in [
            (0.95, 1, 12.706204736174694),
            (0.95, 2, 4.302652729749462),
            (0.95, 7, 2.364624251592784),
            (0.99, 10, 3.16927267261695),
            (0.95, 2997, 1.960755847499532),
        ] {
            let found = two_sided_quantile(level, freedom);
            assert!((found / expected - 1.0).abs() < 1e-9, "{freedom}: {found}");
        }
        let nearly = two_sided_quantile(0.95, 1_000_000);
        assert!((nearly / NORMAL - 1.0).abs() < 2e-6, "{nearly}");
    }
}
