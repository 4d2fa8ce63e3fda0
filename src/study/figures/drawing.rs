//! One set of axes with the outputs that are drawn over it: curves with bands, side by side, or maps.

use std::collections::BTreeMap;

use tdcr_base::stats::quantile;

use super::axes::{ACROSS, Axes, INKS, PlotAxis, readable, spacing_between, titled};
use crate::report::{
    Aspect, Figure, HeatMap, HeatPanel, Ink, Mark, Panel, Scale, Shape, Spacing, StudyFigure,
};
use crate::study::outputs::thinned::Thinned;
use crate::study::spec::{Column, Output, Study};

/// Values that a median and a band are of, at most.
const MOST_VALUES: usize = 1000;
/// What a dashed line is.
const DASHED: &str =
    "Dashed: another sample of the true surface, which no predictor can be expected to beat.";
/// Lines of at most so many places have dots.
const DOTTED: usize = 40;
/// An output to draw, its values by plot, line and place.
pub(super) struct DrawnOutput {
    column: Column,
    place: usize,
    values: Vec<Thinned<f64>>,
}

/// Outputs over one set of axes.
pub(super) struct Drawing {
    axes: Axes,
    outputs: Vec<DrawnOutput>,
}

impl Drawing {
    pub fn new(axes: Axes, drawn: &[Column], columns: &BTreeMap<&str, usize>) -> Self {
        let length = |axis: &Option<PlotAxis>| axis.as_ref().map_or(1, |axis| axis.values.len());
        let count =
            axes.x.values.len() * length(&axes.lines) * length(&axes.plots) * length(&axes.up);
        // Few values each where there are very many places.
        let most = (4_000_000 / count.max(1)).clamp(16, MOST_VALUES);
        let output = |column: &Column| DrawnOutput {
            column: column.clone(),
            place: columns
                .get(column.name.as_str())
                .copied()
                .unwrap_or_default(),
            values: vec![Thinned::new(most); count],
        };
        Self {
            outputs: drawn.iter().map(output).collect(),
            axes,
        }
    }

    pub fn add(
        &mut self,
        row: usize,
        digits: &[usize],
        cells: &[String],
        cell: impl Fn(&str) -> Option<f64> + Copy,
    ) {
        let along = |axis: &Option<PlotAxis>| match axis {
            None => Some(0),
            Some(axis) => axis.place(digits, cell),
        };
        let Axes {
            x,
            lines,
            plots,
            up,
        } = &self.axes;
        let found = (along(plots), along(lines), along(up), x.place(digits, cell));
        let (Some(plot), Some(line), Some(up), Some(x)) = found else {
            return;
        };
        let place = self.index(plot, line.max(up), x);
        for output in &mut self.outputs {
            if let Ok(value) = cells[output.place].parse() {
                output.values[place].add(row, value);
            }
        }
    }

    /// Lines of plots, or rows of maps.
    fn rows(&self) -> usize {
        let axis = self.axes.lines.as_ref().or(self.axes.up.as_ref());
        axis.map_or(1, |axis| axis.values.len())
    }

    fn plots(&self) -> usize {
        self.axes.plots.as_ref().map_or(1, |axis| axis.values.len())
    }

    fn index(&self, plot: usize, row: usize, x: usize) -> usize {
        (plot * self.rows() + row) * self.axes.x.values.len() + x
    }

    fn plot_title(&self, plot: usize) -> String {
        self.axes
            .plots
            .as_ref()
            .map_or(String::new(), |axis| axis.labelled(plot))
    }

    /// Its figures, with a note under each.
    pub fn figures(&self, study: &Study, note: &str) -> Vec<StudyFigure> {
        match self.axes.up.is_some() {
            true => self.maps(note),
            false => self.curves(study, note),
        }
    }

    /// A map for each output.
    fn maps(&self, note: &str) -> Vec<StudyFigure> {
        let Some(up) = &self.axes.up else {
            return Vec::new();
        };
        let map = |output: &DrawnOutput| {
            let title = Output::title(&output.column.name).unwrap_or(&output.column.name);
            let (factor, unit) = output.readable();
            let panel = |plot: usize| HeatPanel {
                title: self.plot_title(plot),
                values: (0..self.rows())
                    .map(|row| {
                        let median = |x| {
                            factor
                                * quantile(&output.values[self.index(plot, row, x)].sorted(), 0.5)
                        };
                        (0..self.axes.x.values.len()).map(median).collect()
                    })
                    .collect(),
            };
            let medians =
                (output.values.iter()).map(|values| factor * quantile(&values.sorted(), 0.5));
            let (least, most) = (medians.filter(|x| x.is_finite()))
                .fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), x| {
                    (least.min(x), most.max(x))
                });
            let map = HeatMap {
                title: title.to_owned(),
                spacing: spacing_between([least, most]),
                caption: format!(
                    "{} {note}",
                    output.caption(|| "Colours are medians".to_owned())
                ),
                x: (self.axes.x.title.clone(), self.axes.x.values.clone()),
                y: (up.title.clone(), up.values.clone()),
                value: unit,
                panels: (0..self.plots()).map(panel).collect(),
            };
            StudyFigure {
                name: self.file(&output.column.name),
                svg: map.to_svg(),
            }
        };
        self.drawn().map(map).collect()
    }

    /// Curves: outputs of one kind side by side, or the plots of one output.
    fn curves(&self, study: &Study, note: &str) -> Vec<StudyFigure> {
        if self.axes.plots.is_some() {
            let figure = |output: &DrawnOutput| {
                let title = Output::title(&output.column.name).unwrap_or(&output.column.name);
                let panels: Vec<Panel> = (0..self.plots())
                    .map(|plot| self.panel(output, plot, self.plot_title(plot)))
                    .collect();
                self.figure(title, &output.column.name, panels, &[output], note)
            };
            return self.drawn().map(figure).collect();
        }
        let mut figures = Vec::new();
        for (want, outputs) in by_want(study, self.drawn()) {
            for (part, outputs) in outputs.chunks(ACROSS).enumerate() {
                let panels = outputs
                    .iter()
                    .map(|output| self.panel(output, 0, String::new()));
                let name = match part {
                    0 => want.name().to_owned(),
                    part => format!("{}-{}", want.name(), part + 1),
                };
                figures.push(self.figure(want.heading(), &name, panels.collect(), outputs, note));
            }
        }
        figures
    }

    /// Outputs that have figures of their own.
    fn drawn(&self) -> impl Iterator<Item = &DrawnOutput> {
        let own = |output: &&DrawnOutput| !Output::is_reference(&output.column.name);
        self.outputs.iter().filter(own)
    }

    /// The output that a figure on another shows as a dashed line.
    fn reference(&self, output: &DrawnOutput) -> Option<&DrawnOutput> {
        let name = Output::reference(&output.column.name)?;
        self.outputs.iter().find(|other| other.column.name == name)
    }

    fn figure(
        &self,
        title: &str,
        name: &str,
        panels: Vec<Panel>,
        outputs: &[&DrawnOutput],
        note: &str,
    ) -> StudyFigure {
        let captions = outputs.iter().map(|output| {
            output.caption(|| {
                "Lines are medians, bands reach from the 10 % to the 90 % quantile".to_owned()
            })
        });
        let caption = captions.max_by_key(String::len).unwrap_or_default();
        let figure = Figure {
            title: title.to_owned(),
            caption: match outputs
                .iter()
                .any(|output| self.reference(output).is_some())
            {
                true => format!("{caption} {DASHED} {note}"),
                false => format!("{caption} {note}"),
            },
            panels,
        };
        StudyFigure {
            name: self.file(name),
            svg: figure.to_svg(),
        }
    }

    fn file(&self, name: &str) -> String {
        let plain =
            |letter: char| match letter.is_ascii_alphanumeric() || letter == '_' || letter == '-' {
                true => letter,
                false => '-',
            };
        let along = self.axes.x.title.split(" (").next().unwrap_or_default();
        let along: String = along.chars().map(plain).collect();
        format!("{name}-over-{}", along.trim_matches('-'))
    }

    /// Medians of an output along the axis, times a factor.
    fn medians(
        &self,
        output: &DrawnOutput,
        factor: f64,
        plot: usize,
        line: usize,
    ) -> Vec<[f64; 2]> {
        let values = self.axes.x.values.iter().enumerate();
        let medians = values.map(|(place, x)| {
            let sorted = output.values[self.index(plot, line, place)].sorted();
            [*x, factor * quantile(&sorted, 0.5)]
        });
        medians.filter(|point| point[1].is_finite()).collect()
    }

    /// One plot of an output.
    fn panel(&self, output: &DrawnOutput, plot: usize, title: String) -> Panel {
        let (factor, unit) = output.readable();
        let x = &self.axes.x;
        let (mut bands, mut lines) = (Vec::new(), Vec::new());
        let mut ends: Option<[f64; 2]> = None;
        for other in 0..self.plots() {
            for line in 0..self.rows() {
                let places = 0..x.values.len();
                let sorted = places.map(|place| {
                    (
                        place,
                        output.values[self.index(other, line, place)].sorted(),
                    )
                });
                let sorted: Vec<(f64, Vec<f64>)> = (sorted
                    .filter(|(_, values)| !values.is_empty()))
                .map(|(place, values)| (x.values[place], values))
                .collect();
                let at = |share: f64| -> Vec<[f64; 2]> {
                    (sorted.iter())
                        .map(|(x, values)| [*x, factor * quantile(values, share)])
                        .collect()
                };
                let (low, middle, high) = (at(0.1), at(0.5), at(0.9));
                for value in low.iter().chain(&high).map(|point| point[1]) {
                    ends = Some(reach(ends, value));
                }
                if other != plot {
                    continue;
                }
                let ink = INKS[line % INKS.len()];
                if let Some(reference) = self.reference(output) {
                    let points = self.medians(reference, factor, plot, line);
                    ends = points
                        .iter()
                        .fold(ends, |ends, point| Some(reach(ends, point[1])));
                    lines.push(Mark {
                        name: String::new(),
                        shape: Shape::Dashes,
                        ink,
                        points,
                    });
                }
                let mark = |name: String, shape, points| Mark {
                    name,
                    shape,
                    ink,
                    points,
                };
                if low != high {
                    let corners = high.into_iter().chain(low.into_iter().rev()).collect();
                    bands.push(mark(String::new(), Shape::Area, corners));
                }
                let name = self
                    .axes
                    .lines
                    .as_ref()
                    .map_or(String::new(), |axis| axis.labelled(line));
                if x.numeric {
                    if middle.len() <= DOTTED {
                        lines.push(mark(String::new(), Shape::Dots, middle.clone()));
                    }
                    lines.push(mark(name, Shape::Line, middle));
                } else {
                    lines.push(mark(name, Shape::Dots, middle));
                }
            }
        }
        let spacing = ends.map_or(Spacing::Linear, spacing_between);
        // The same axis for all plots of an output.
        if let (Some([least, most]), Some(first)) = (ends, x.values.first()) {
            lines.push(Mark {
                name: String::new(),
                shape: Shape::Unseen,
                ink: Ink::Black,
                points: vec![[*first, least], [*first, most]],
            });
        }
        Panel {
            title,
            x: match x.numeric {
                true => Scale::Numbers {
                    title: x.title.clone(),
                    spacing: x.spacing,
                },
                false => Scale::Names(x.labels.clone()),
            },
            y: Scale::Numbers {
                title: titled(
                    Output::title(&output.column.name).unwrap_or(&output.column.name),
                    &unit,
                ),
                spacing,
            },
            aspect: Aspect::Free,
            marks: bands.into_iter().chain(lines).collect(),
        }
    }
}

/// The ends of a range that holds a value, too.
fn reach(ends: Option<[f64; 2]>, value: f64) -> [f64; 2] {
    let [least, most] = ends.unwrap_or([value, value]);
    [least.min(value), most.max(value)]
}

impl DrawnOutput {
    /// The unit in which its values are easy to read.
    fn readable(&self) -> (f64, String) {
        let largest = self.values.iter().map(Thinned::largest).fold(0.0, f64::max);
        readable(&self.column.unit, largest)
    }

    /// What is drawn where places have several values; empty where each has one.
    fn caption(&self, what: impl Fn() -> String) -> String {
        let most = self.values.iter().map(Thinned::count).max().unwrap_or(0);
        match most {
            0 | 1 => String::new(),
            several => format!("{} over {several} configurations.", what()),
        }
    }
}

/// Outputs by what was wanted.
fn by_want<'a>(
    study: &Study,
    outputs: impl Iterator<Item = &'a DrawnOutput>,
) -> Vec<(Output, Vec<&'a DrawnOutput>)> {
    let limited = study.tension_limit.is_some();
    let outputs: Vec<&DrawnOutput> = outputs.collect();
    let of = |want: Output| {
        let columns = want.columns(limited);
        let of_want = outputs
            .iter()
            .copied()
            .filter(|output| columns.iter().any(|c| c.name == output.column.name));
        (want, of_want.collect::<Vec<_>>())
    };
    Output::ALL
        .into_iter()
        .map(of)
        .filter(|(_, outputs)| !outputs.is_empty())
        .collect()
}
