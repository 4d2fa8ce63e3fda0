//! Plots of a calibration: paths, errors, residuals.

use tdcr_base::stats::{quantile, sorted};
use tdcr_sim::robot::Drive;

use super::{CalibrationPage, MM, POINTS, Validated, thinned};
use crate::pipeline::recording::Measured;
use crate::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};

/// Bins of the histogram of errors.
const BINS: usize = 40;
/// Points that are drawn as dots of full size at most.
const FEW: usize = 300;
/// Share of the errors that a histogram shows at least.
const SHOWN: f64 = 0.99;
/// Motions that are named at most.
const MOTIONS: usize = 14;
/// Plots side by side.
const PANELS: usize = 3;
/// Axes of a path's plots.
const VIEWS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];
const AXES: [&str; 3] = ["x", "y", "z"];

impl CalibrationPage<'_> {
    /// The plots of a recording, from above.
    pub(super) fn figures(&self, validated: &Validated) -> Vec<Figure> {
        let mut figures = vec![
            validated.paths(),
            self.histogram(validated),
            self.patterns(validated),
        ];
        if self.measured == Measured::Markers {
            figures.push(validated.along(self.time));
        }
        figures.extend(self.by_command(validated));
        figures
    }

    /// What the error of a row is.
    fn error(&self) -> &'static str {
        match self.measured {
            Measured::Markers => "the largest distance of a marker, the mean offset taken off",
            Measured::Clouds => "the median distance of its points from the surface",
        }
    }

    fn histogram(&self, validated: &Validated) -> Figure {
        let all = [validated.before, validated.after].map(|residuals| validated.errors(residuals));
        let fitted = sorted(all[1].iter().copied().filter(|x| x.is_finite()));
        let most = 1.25 * quantile(&fitted, SHOWN).max(1e-3);
        let curve = |errors: &[f64]| -> Vec<[f64; 2]> {
            let width = most / BINS as f64;
            let count = errors.iter().filter(|x| x.is_finite()).count().max(1) as f64;
            (0..BINS)
                .flat_map(|bin| {
                    let [low, high] = [bin as f64 * width, (bin + 1) as f64 * width];
                    let share =
                        errors.iter().filter(|&&x| x >= low && x < high).count() as f64 / count;
                    [[low, 100.0 * share], [high, 100.0 * share]]
                })
                .collect()
        };
        Figure {
            title: format!("{}: how often which error", validated.name),
            caption: format!(
                "Of a row: {}. Errors beyond the axis are left out.",
                self.error()
            ),
            panels: vec![Panel {
                title: "Errors".into(),
                x: Scale::linear("error (mm)"),
                y: Scale::linear("share of the rows (%)"),
                aspect: Aspect::Free,
                marks: vec![
                    mark("as given", Shape::Line, Ink::Grey, curve(&all[0])),
                    mark("calibrated", Shape::Line, Ink::Vermilion, curve(&all[1])),
                ],
            }],
        }
    }

    /// Root mean square error of each motion.
    fn patterns(&self, validated: &Validated) -> Figure {
        let errors = validated.errors(validated.after);
        let mut names: Vec<&String> = Vec::new();
        for name in &validated.file.patterns {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let points: Vec<[f64; 2]> = (names.iter().enumerate())
            .map(|(k, name)| {
                let own: Vec<f64> = (errors.iter().zip(&validated.file.patterns))
                    .filter(|(error, pattern)| error.is_finite() && pattern == name)
                    .map(|(error, _)| error * error)
                    .collect();
                [
                    (own.iter().sum::<f64>() / own.len().max(1) as f64).sqrt(),
                    k as f64,
                ]
            })
            .collect();
        let worst = |k: &usize| points[*k][0];
        let mut order: Vec<usize> = (0..names.len()).collect();
        order.sort_by(|a, b| worst(b).total_cmp(&worst(a)));
        order.truncate(MOTIONS);
        let shown: Vec<[f64; 2]> = order
            .iter()
            .enumerate()
            .map(|(k, &i)| [points[i][0], k as f64])
            .collect();
        let label = |&i: &usize| {
            if names[i].is_empty() {
                "all".to_owned()
            } else {
                names[i].clone()
            }
        };
        Figure {
            title: format!("{}: the motions with the largest errors", validated.name),
            caption: format!(
                "Root mean square over the rows of a motion; of a row: {}. {MOTIONS} motions at most.",
                self.error()
            ),
            panels: vec![Panel {
                title: "Error by motion".into(),
                x: Scale::linear("error (mm)"),
                y: Scale::Names(order.iter().map(label).collect()),
                aspect: Aspect::Free,
                marks: vec![mark("", Shape::Dots, Ink::Blue, shown)],
            }],
        }
    }

    /// Length of the residual against what each servo reports, pulling and letting go apart.
    fn by_command(&self, validated: &Validated) -> Vec<Figure> {
        let errors = validated.errors(validated.after);
        let pulls = &validated.file.recording.pulls;
        let servos = pulls.first().map_or(0, Vec::len);
        let shape = dots(pulls.len());
        let panel = |servo: usize| {
            let (reported, unit) = match self.drives.get(servo) {
                Some(Drive::Tension) => ("tension reported (N)", 1.0),
                _ => ("pull reported (mm)", MM),
            };
            let points = |pulling: bool| -> Vec<[f64; 2]> {
                let rows = (1..pulls.len())
                    .filter(|&row| (pulls[row][servo] > pulls[row - 1][servo]) == pulling)
                    .map(|row| [unit * pulls[row][servo], errors[row]]);
                thinned(rows.collect())
            };
            Panel {
                title: format!("Servo {}", servo + 1),
                x: Scale::linear(reported),
                y: Scale::linear("error (mm)"),
                aspect: Aspect::Free,
                marks: vec![
                    mark("pulling", shape, Ink::Blue, points(true)),
                    mark(
                        "letting go, or at rest",
                        shape,
                        Ink::Vermilion,
                        points(false),
                    ),
                ],
            }
        };
        let servos: Vec<usize> = (0..servos).collect();
        (servos.chunks(PANELS).enumerate())
            .map(|(k, chunk)| Figure {
                title: match k {
                    0 => format!("{}: errors against what servos report", validated.name),
                    _ => String::new(),
                },
                caption: match k {
                    0 => format!("Of a row: {}.", self.error()),
                    _ => String::new(),
                },
                panels: chunk.iter().map(|&servo| panel(servo)).collect(),
            })
            .collect()
    }
}

impl Validated<'_> {
    fn paths(&self) -> Figure {
        let pairs = self.pairs();
        let panel = |&(a, b): &(usize, usize)| Panel {
            title: format!("{}{}", AXES[a], AXES[b]),
            x: Scale::linear(&format!("{} (mm)", AXES[a])),
            y: Scale::linear(&format!("{} (mm)", AXES[b])),
            aspect: Aspect::Equal,
            // What was measured lies above what was fitted to it.
            marks: vec![
                mark(
                    "calibrated robot",
                    Shape::Halos,
                    Ink::Vermilion,
                    pairs.iter().map(|(_, p)| [MM * p[a], MM * p[b]]).collect(),
                ),
                mark(
                    "measured",
                    Shape::Specks,
                    Ink::Black,
                    pairs.iter().map(|(p, _)| [MM * p[a], MM * p[b]]).collect(),
                ),
            ],
        };
        Figure {
            title: format!("{}: what was measured, and where the robot is", self.name),
            caption: format!(
                "Each marker of a row is a point, without the alignment of means. Of clouds points are shown with the places of the \
                 robot's surface nearest to them. Of many, {POINTS} at most."
            ),
            panels: VIEWS.iter().map(panel).collect(),
        }
    }

    /// Residuals against time, one plot for each axis.
    fn along(&self, time: &str) -> Figure {
        let start = self.file.recording.times.first().copied().unwrap_or(0.0);
        let panels = (0..3).map(|axis| {
            let rows = self.file.recording.times.iter().zip(&self.after.markers);
            let points = rows
                .filter_map(|(t, row)| Some([t - start, MM * row.iter().flatten().next()?[axis]]));
            residual_panel(time, axis, thinned(points.collect()))
        });
        Figure {
            title: format!("{}: residuals in the order of time", self.name),
            caption: "Of the first marker, the mean taken off.".into(),
            panels: panels.collect(),
        }
    }
}

/// What so many points are drawn as.
fn dots(count: usize) -> Shape {
    match count {
        0..=FEW => Shape::Dots,
        _ => Shape::Specks,
    }
}

fn residual_panel(x: &str, axis: usize, points: Vec<[f64; 2]>) -> Panel {
    Panel {
        title: format!("Along {}", AXES[axis]),
        x: Scale::linear(x),
        y: Scale::linear("residual (mm)"),
        aspect: Aspect::Free,
        marks: vec![mark("", dots(points.len()), Ink::Blue, points)],
    }
}

fn mark(name: &str, shape: Shape, ink: Ink, points: Vec<[f64; 2]>) -> Mark {
    Mark {
        name: name.to_owned(),
        shape,
        ink,
        points,
    }
}
