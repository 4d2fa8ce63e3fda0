//! Chart axes: range, position of values, ticks.

/// How values are spaced along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spacing {
    /// In proportion to their differences.
    Linear,
    /// Logarithmic: values that are not positive have no place on the axis.
    Log,
}

impl Spacing {
    /// Whether a value has a place on such an axis.
    pub fn shows(self, value: f64) -> bool {
        value.is_finite() && (self == Spacing::Linear || value > 0.0)
    }
}

/// An axis from `low` to `high`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Axis {
    spacing: Spacing,
    low: f64,
    high: f64,
    ticks: Vec<f64>,
}

impl Axis {
    /// The axis between round numbers that covers the values that it can show; `None` if there is no such value.
    pub fn covering(spacing: Spacing, values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let shown = values.into_iter().filter(|&x| spacing.shows(x));
        let range = shown.fold(None, |range: Option<(f64, f64)>, x| {
            let (low, high) = range.unwrap_or((x, x));
            Some((low.min(x), high.max(x)))
        });
        range.map(|(low, high)| match spacing {
            Spacing::Linear => Self::linear(low, high),
            Spacing::Log => Self::log(low, high),
        })
    }

    /// The axis of so many names, the first at 0, each with as much place as the others; `None` without any.
    pub fn of_names(count: usize) -> Option<Self> {
        (count > 0).then(|| Self {
            spacing: Spacing::Linear,
            low: -0.5,
            high: count as f64 - 0.5,
            ticks: (0..count).map(|k| k as f64).collect(),
        })
    }

    fn linear(low: f64, high: f64) -> Self {
        let span = if high > low {
            high - low
        } else {
            low.abs().max(1.0)
        };
        let step = mark_at_or_above(span / 5.0);
        let first = (low / step).floor();
        let last = (high / step).ceil().max(first + 1.0);
        let ticks = (0..=(last - first) as usize).map(|k| rounded((first + k as f64) * step));
        Self {
            spacing: Spacing::Linear,
            low: first * step,
            high: last * step,
            ticks: ticks.collect(),
        }
    }

    fn log(low: f64, high: f64) -> Self {
        let first = mark_at_or_below(low);
        let mut marks = vec![first];
        while marks.len() < 2 || marks[marks.len() - 1] < high * (1.0 - 1e-9) {
            marks.push(next_mark(marks[marks.len() - 1]));
        }
        let last = marks[marks.len() - 1];
        // Few enough marks are all labelled; else only whole decades, at most about eight of them.
        if marks.len() > 8 {
            let decades = (last / first).log10();
            let stride = (decades / 8.0).ceil() as i64;
            marks.retain(|mark| {
                let exponent = mark.log10().round();
                (mark / 10f64.powf(exponent) - 1.0).abs() < 1e-6 && exponent as i64 % stride == 0
            });
        }
        Self {
            spacing: Spacing::Log,
            low: first,
            high: last,
            ticks: marks,
        }
    }

    /// Position of a value, 0 at the low end and 1 at the high end; `None` off a finite place.
    pub fn fraction(&self, value: f64) -> Option<f64> {
        self.spacing.shows(value).then(|| match self.spacing {
            Spacing::Linear => (value - self.low) / (self.high - self.low),
            Spacing::Log => (value / self.low).ln() / (self.high / self.low).ln(),
        })
    }

    /// Distance between the ends; of a log axis, their ratio's logarithm.
    pub fn span(&self) -> f64 {
        match self.spacing {
            Spacing::Linear => self.high - self.low,
            Spacing::Log => (self.high / self.low).ln(),
        }
    }

    /// Values of the ticks, ascending.
    pub fn ticks(&self) -> &[f64] {
        &self.ticks
    }
}

/// Label of a tick: plain digits with thousands separated, powers of ten beyond six digits.
pub(crate) fn tick_label(value: f64) -> String {
    let size = value.abs();
    if size >= 1e7 || (size > 0.0 && size < 1e-4) {
        return format!("{value:e}");
    }
    let text = format!("{value}");
    let (whole, rest) = text.split_at(text.find('.').unwrap_or(text.len()));
    if size < 1e4 {
        return text;
    }
    let digits = whole.len();
    let mut label = String::with_capacity(digits + digits / 3);
    for (k, digit) in whole.chars().enumerate() {
        if k > 0 && (digits - k) % 3 == 0 && digit.is_ascii_digit() && !label.ends_with('-') {
            label.push(',');
        }
        label.push(digit);
    }
    label + rest
}

/// The value without the last digits of floating-point noise, so that its label is short.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}")
        .parse()
        .expect("Rust reads the numbers that it writes")
}

/// The greatest of 1, 2, 5 times a power of ten that is at most `value > 0`.
pub(crate) fn mark_at_or_below(value: f64) -> f64 {
    let decade = 10f64.powf(value.log10().floor());
    let mark = [5.0, 2.0]
        .into_iter()
        .map(|step| step * decade)
        .find(|&mark| mark <= value * (1.0 + 1e-9))
        .unwrap_or(decade);
    rounded(mark)
}

/// The least of 1, 2, 5 times a power of ten that is at least `value > 0`.
pub(crate) fn mark_at_or_above(value: f64) -> f64 {
    let below = mark_at_or_below(value);
    if below >= value * (1.0 - 1e-9) {
        below
    } else {
        next_mark(below)
    }
}

/// The mark after `mark` in 1, 2, 5, 10, 20, 50, ...
fn next_mark(mark: f64) -> f64 {
    let leading = mark / 10f64.powf((mark.log10() + 1e-9).floor());
    rounded(
        mark * if (1.5..3.0).contains(&leading) {
            2.5
        } else {
            2.0
        },
    )
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]
    use super::*;

    #[test]
    fn linear_ticks_are_round_and_cover_the_data() {
        let axis = Axis::covering(Spacing::Linear, [3.0, 97.0]).unwrap();
        assert_eq!(axis.ticks(), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(axis.fraction(50.0), Some(0.5));
        let axis = Axis::covering(Spacing::Linear, [0.12, 0.48]).unwrap();
        assert_eq!(axis.ticks(), [0.1, 0.2, 0.3, 0.4, 0.5]);
    }

    #[test]
    fn a_constant_has_an_axis_around_it() {
        for spacing in [Spacing::Linear, Spacing::Log] {
            for value in [1e-9, 0.3, 1.0, 7e8] {
                let axis = Axis::covering(spacing, [value]).unwrap();
                let place = axis.fraction(value).unwrap();
                assert!((0.0..=1.0).contains(&place), "{spacing:?} {value}: {place}");
                assert!(axis.ticks().len() >= 2, "{spacing:?} {value}");
            }
        }
    }

    #[test]
    fn log_ticks_are_one_two_five_in_short_ranges_and_decades_in_long_ones() {
        let axis = Axis::covering(Spacing::Log, [0.03, 0.9]).unwrap();
        assert_eq!(axis.ticks(), [0.02, 0.05, 0.1, 0.2, 0.5, 1.0]);
        let middle = axis.fraction(0.02f64.sqrt()).unwrap();
        assert!((middle - 0.5).abs() < 1e-12);
        let axis = Axis::covering(Spacing::Log, [2e-4, 40.0]).unwrap();
        assert_eq!(axis.ticks(), [1e-3, 1e-2, 0.1, 1.0, 10.0]);
    }

    #[test]
    fn values_without_a_place_make_no_axis() {
        let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        assert_eq!(Axis::covering(Spacing::Linear, bad), None);
        assert_eq!(Axis::covering(Spacing::Log, [0.0, -1.0]), None);
    }

    #[test]
    fn tick_labels_are_short() {
        let labels = [0.0, 0.05, 20.0, 5000.0, 40_000.0, 1_200_000.0, 1e-6].map(tick_label);
        let expected = ["0", "0.05", "20", "5000", "40,000", "1,200,000", "1e-6"];
        assert_eq!(labels, expected);
    }
}
