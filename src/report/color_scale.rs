//! Colours for numbers: from light grey at zero to a dark purple.

use tdcr_base::stats::{quantile, sorted};

use super::figure::axis::mark_at_or_above;

/// Colours at equal distances along the scale, ever darker, so that the scale also reads without colour vision and
/// large values stand out from white paper.
const STOPS: [[u8; 3]; 6] = [
    [0xdd, 0xe2, 0xe8],
    [0xf4, 0xc9, 0x6b],
    [0xee, 0x8a, 0x3c],
    [0xcf, 0x45, 0x3f],
    [0x8e, 0x1b, 0x5e],
    [0x33, 0x0a, 0x4d],
];
/// Steps of the scale: few enough for pictures to compress well, enough for a reader.
const LEVELS: f64 = 10.0;
/// Share of the values that the scale tells apart; the rest has the last colour.
const COVERED: f64 = 0.98;
/// Colour of what has no number.
const UNKNOWN: [u8; 3] = [0xb0, 0xb8, 0xc0];

/// Colour at a share of the way along the scale.
pub(crate) fn color_at(share: f64) -> [u8; 3] {
    if !share.is_finite() {
        return UNKNOWN;
    }
    let level = (share.clamp(0.0, 1.0) * LEVELS).round() / LEVELS;
    let place = level * (STOPS.len() - 1) as f64;
    let below = (place as usize).min(STOPS.len() - 2);
    let part = place - below as f64;
    std::array::from_fn(|k| {
        let [low, high] = [below, below + 1].map(|stop| f64::from(STOPS[stop][k]));
        (low + part * (high - low)).round() as u8
    })
}

/// The scale as a gradient of a style sheet, from left to right.
pub(crate) fn css_gradient() -> String {
    let stops = STOPS.map(|[r, g, b]| format!("#{r:02x}{g:02x}{b:02x}"));
    format!("linear-gradient(to right,{})", stops.join(","))
}

/// A scale of lengths from zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ColorScale {
    /// The length with the last colour (m), a round number; greater ones have it too.
    pub top: f64,
}

impl ColorScale {
    /// The scale that tells nearly all of the values (m) apart; `None` where none of them is above zero.
    pub fn covering(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values = sorted(values.into_iter().filter(|x| x.is_finite()));
        let covered = quantile(&values, COVERED);
        (covered > 0.0).then(|| Self {
            top: mark_at_or_above(covered),
        })
    }

    /// Colour of a length (m).
    pub fn color(&self, value: f64) -> [u8; 3] {
        color_at(value / self.top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greater_values_are_darker_and_the_greatest_are_alike() {
        let scale = ColorScale::covering((0..1000).map(|k| 4e-6 * f64::from(k)));
        assert_eq!(scale, Some(ColorScale { top: 5e-3 }));
        let brightness = |share: f64| color_at(share).map(u32::from).iter().sum::<u32>();
        let steps: Vec<u32> = (0..=10).map(|k| brightness(0.1 * f64::from(k))).collect();
        assert!(steps.is_sorted_by(|a, b| a > b), "{steps:?}");
        assert_eq!(color_at(1.0), color_at(7.0));
        assert_eq!(color_at(f64::NAN), UNKNOWN);
        assert_eq!(ColorScale::covering([0.0, f64::NAN]), None);
        assert_eq!(ColorScale::covering([]), None);
    }
}
