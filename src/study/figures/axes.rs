//! What figures are drawn over: which variable runs along the axis, which tells lines apart, which plots.

use serde_json::Value;

use crate::report::{Ink, Spacing};
use crate::study::spec::vary::place_in;
use crate::study::spec::{Levels, Study};

/// Places along an axis, at most: more values are put together.
const MOST_PLACES: usize = 200;
/// Bins of a variable that is sampled.
const BINS: usize = 24;
/// Lines in a plot, and plots beside each other, at most.
const MOST_LINES: usize = 6;
const MOST_PLOTS: usize = 3;
/// Values of each of two variables from which their outputs are maps.
const MAP: usize = 7;

/// Plots beside each other.
pub(super) const ACROSS: usize = 3;
/// Ratios of numbers for which their axis is logarithmic. Beyond, the least are zeros but for rounding.
const WIDE: std::ops::Range<f64> = 100.0..1e9;
/// Colours of lines, which are no more than so many.
pub(super) const INKS: [Ink; 6] = [
    Ink::Blue,
    Ink::Vermilion,
    Ink::Green,
    Ink::Purple,
    Ink::Black,
    Ink::Grey,
];

/// A variable of figures, with its values in the unit in which they are shown.
#[derive(Clone, Debug)]
pub(super) struct PlotAxis {
    /// Its name and unit.
    pub title: String,
    name: String,
    source: Source,
    /// Its values; of names, their places.
    pub values: Vec<f64>,
    /// They as text, with units.
    pub labels: Vec<String>,
    /// Whether they are numbers.
    pub numeric: bool,
    /// How they are spaced.
    pub spacing: Spacing,
}

/// Where its values come from.
#[derive(Clone, Debug)]
enum Source {
    /// The values of the variable in this place.
    Levels { place: usize, count: usize },
    /// A range that is sampled, in the table's column of the variable.
    Range { range: [f64; 2], log: bool },
}

/// What one kind of figure is drawn over.
#[derive(Clone, Debug)]
pub(super) struct Axes {
    pub x: PlotAxis,
    /// What tells lines apart.
    pub lines: Option<PlotAxis>,
    /// What tells plots apart.
    pub plots: Option<PlotAxis>,
    /// What maps have upwards: outputs are then colours, and there are no lines.
    pub up: Option<PlotAxis>,
}

/// A unit in which numbers are easy to read, and how many of it make one.
pub(super) fn readable(unit: &str, largest: f64) -> (f64, String) {
    let small = largest.is_finite() && largest > 0.0;
    let scaled = match unit {
        "m" if small && largest < 1.0 => (1e3, "mm"),
        "m\u{b2}" if small && largest < 1.0 => (1e4, "cm\u{b2}"),
        "m\u{b3}" if small && largest < 1.0 => (1e3, "dm\u{b3}"),
        "kg" if small && largest < 1.0 => (1e3, "g"),
        "J" if small && largest < 0.1 => (1e3, "mJ"),
        "s" if small && largest < 1e-2 => (1e6, "\u{b5}s"),
        "s" if small && largest < 1.0 => (1e3, "ms"),
        "N m/rad" if small && largest < 0.1 => (1e3, "mN m/rad"),
        "m/N" if small && largest < 1.0 => (1e3, "mm/N"),
        _ => (1.0, unit),
    };
    (scaled.0, scaled.1.to_owned())
}

/// How numbers between two ends are spaced along their axis.
pub(super) fn spacing_between([least, most]: [f64; 2]) -> Spacing {
    match least > 0.0 && WIDE.contains(&(most / least)) {
        true => Spacing::Log,
        false => Spacing::Linear,
    }
}

/// A name with its unit.
pub(super) fn titled(name: &str, unit: &str) -> String {
    match unit {
        "" => name.to_owned(),
        unit => format!("{name} ({unit})"),
    }
}

impl PlotAxis {
    fn of_levels(place: usize, levels: &Levels, unit: &str) -> Self {
        let numbers: Option<Vec<f64>> = levels.values.iter().map(Value::as_f64).collect();
        let name = levels.what.shown().to_owned();
        let count = levels.values.len();
        let source = Source::Levels { place, count };
        let Some(numbers) = numbers else {
            let label = |value: &Value| {
                value
                    .as_str()
                    .map_or_else(|| value.to_string(), ToOwned::to_owned)
            };
            return Self {
                title: name.clone(),
                name,
                source,
                values: (0..count).map(|k| k as f64).collect(),
                labels: levels.values.iter().map(label).collect(),
                numeric: false,
                spacing: Spacing::Linear,
            };
        };
        let largest = numbers.iter().copied().map(f64::abs).fold(0.0, f64::max);
        let (factor, unit) = readable(unit, largest);
        // Several neighbours share a place where there are more values than places: that of their middle.
        let stride = count.div_ceil(MOST_PLACES);
        let values: Vec<f64> = numbers
            .chunks(stride)
            .map(|chunk| factor * chunk.iter().sum::<f64>() / chunk.len() as f64)
            .collect();
        Self {
            title: titled(&name, &unit),
            labels: values.iter().map(|value| labelled(*value, &unit)).collect(),
            name,
            source,
            spacing: spacing(&values),
            values,
            numeric: true,
        }
    }

    fn of_range(name: &str, unit: &str, range: [f64; 2], log: bool) -> Self {
        let largest = range[0].abs().max(range[1].abs());
        let (factor, unit) = readable(unit, largest);
        let spacing = match log {
            true => Spacing::Log,
            false => Spacing::Linear,
        };
        let middle =
            |bin: usize| factor * place_in(range, spacing, (bin as f64 + 0.5) / BINS as f64);
        let values: Vec<f64> = (0..BINS).map(middle).collect();
        Self {
            title: titled(name, &unit),
            name: name.to_owned(),
            source: Source::Range { range, log },
            labels: values.iter().map(|value| labelled(*value, &unit)).collect(),
            values,
            numeric: true,
            spacing,
        }
    }

    /// The place of a row along it, by its combination's digits and its cell of the variable.
    pub fn place(&self, digits: &[usize], cell: impl Fn(&str) -> Option<f64>) -> Option<usize> {
        match self.source {
            Source::Levels { place, count } => {
                let stride = match self.numeric {
                    true => count.div_ceil(MOST_PLACES),
                    false => 1,
                };
                digits.get(place).map(|digit| digit / stride)
            }
            Source::Range {
                range: [low, high],
                log,
            } => {
                let value = cell(&self.name)?;
                let share = match log {
                    true => (value / low).ln() / (high / low).ln(),
                    false => (value - low) / (high - low),
                };
                Some(((share * BINS as f64) as usize).min(BINS - 1))
            }
        }
    }

    /// A value of it with its name: `payload 10 g`.
    pub fn labelled(&self, place: usize) -> String {
        format!("{} {}", self.name, self.labels[place])
    }
}

/// A number of at most four digits, with its unit.
fn labelled(value: f64, unit: &str) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    match unit {
        "" => format!("{rounded}"),
        unit => format!("{rounded} {unit}"),
    }
}

/// Logarithmic where successive values have the same ratio, of more than a doubling overall.
fn spacing(values: &[f64]) -> Spacing {
    let positive = values.iter().all(|value| *value > 0.0);
    let [Some(first), Some(last)] = [values.first(), values.last()] else {
        return Spacing::Linear;
    };
    let mut ratios = values.windows(2).map(|pair| (pair[1] / pair[0]).ln());
    let mean = (last / first).ln() / (values.len().max(2) - 1) as f64;
    let even = positive
        && values.len() > 2
        && ratios.all(|ratio| (ratio - mean).abs() < 0.02 * mean.abs());
    match even && last / first > 8.0 {
        true => Spacing::Log,
        false => Spacing::Linear,
    }
}

impl Axes {
    /// What the figures of a study are drawn over; several where ranges are sampled, none where only commands are.
    pub fn of(study: &Study) -> Vec<Self> {
        let mut axes: Vec<PlotAxis> = (study.levels.iter().enumerate())
            .filter(|(_, levels)| levels.values.len() > 1)
            .map(|(place, levels)| PlotAxis::of_levels(place, levels, study.unit(&levels.what)))
            .collect();
        // The longest variable runs along the axis, numbers before names; of equals the first.
        axes.sort_by_key(|axis| (!axis.numeric, std::cmp::Reverse(axis.values.len())));
        let ranges = study.scalars().filter_map(|sampled| {
            let (range, _) = sampled.range()?;
            Some(PlotAxis::of_range(
                sampled.what.name(),
                study.unit(&sampled.what),
                range,
                sampled.log,
            ))
        });
        let mut all = Vec::new();
        if !axes.is_empty() {
            all.push(Self::with(axes[0].clone(), axes[1..].to_vec()));
        }
        for range in ranges {
            let rest = axes
                .iter()
                .filter(|axis| axis.values.len() <= MOST_LINES)
                .cloned();
            all.push(Self::with(range, rest.collect()));
        }
        all
    }

    fn with(x: PlotAxis, mut rest: Vec<PlotAxis>) -> Self {
        let is_map = |axis: &PlotAxis| axis.numeric && axis.values.len() >= MAP;
        let up = (rest.iter().position(is_map))
            .filter(|_| is_map(&x))
            .map(|place| rest.remove(place));
        let mut take = |most: usize| {
            let place = rest.iter().position(|axis| axis.values.len() <= most);
            place.map(|place| rest.remove(place))
        };
        let lines = if up.is_none() { take(MOST_LINES) } else { None };
        let plots = take(MOST_PLOTS);
        Self {
            x,
            lines,
            plots,
            up,
        }
    }
}
