//! The page on a calibration: paths, errors, residuals, unknowns.

use nalgebra::Vector3;
use tdcr_base::stats::{median, quantile, sorted};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::inverse::recording::{Correlation, FittedUnknown, Replay, Residuals};
use tdcr_sim::robot::Drive;

use crate::pipeline::recording::{Calibration, Compared, Measured, RecordingFile};
use crate::report::{Aspect, CalibrationReport, Example, Figure, Ink, Mark, Panel, Scale, Shape};

const MM: f64 = 1e3;
/// Bins of the histogram of errors.
const BINS: usize = 40;
/// Points of a mark that are shown at most.
const POINTS: usize = 4000;
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

/// What the page is made of.
#[derive(Debug)]
pub struct CalibrationPage<'a> {
    /// Name of the robot.
    robot: String,
    /// What was measured.
    measured: Measured,
    /// How the tendons are driven.
    drives: Vec<Drive>,
    /// What the rows are counted by.
    time: &'static str,
    /// The recordings: of the training first.
    validated: Vec<Validated<'a>>,
    /// What was found.
    unknowns: Vec<FittedUnknown>,
    /// What the recording can hardly tell apart.
    correlations: Vec<Correlation>,
}

/// A recording, and how far the robot is from it.
#[derive(Debug)]
struct Validated<'a> {
    /// What it is called.
    name: &'a str,
    /// The recording.
    file: &'a RecordingFile,
    /// Residuals of the robot as given.
    before: &'a Residuals,
    /// Residuals of the calibrated robot.
    after: &'a Residuals,
    /// Where the calibrated robot says the markers are.
    replay: &'a Replay,
}

impl<'a> CalibrationPage<'a> {
    /// The page of a calibrated robot.
    pub fn new(calibration: &'a Calibration) -> Self {
        let validated = |name, compared: &'a Compared| Validated {
            name,
            file: &compared.file,
            before: &compared.before,
            after: &compared.after,
            replay: &compared.replay,
        };
        let train = std::iter::once(validated("Training", &calibration.train));
        let validation = calibration
            .validation
            .iter()
            .map(|v| validated("Validation", v));
        Self {
            robot: calibration.found.robot.clone(),
            measured: calibration.found.measured,
            drives: (calibration.spec.tendons().iter())
                .map(|tendon| tendon.drive)
                .collect(),
            time: match calibration.columns.time {
                Some(_) => "time (s)",
                None => "row",
            },
            validated: train.chain(validation).collect(),
            unknowns: calibration.found.parameters.clone(),
            correlations: calibration.found.correlations.clone(),
        }
    }

    /// The page as one self-contained HTML text, the same for the same data.
    pub fn to_html(&self) -> String {
        let mm = |rmse: f64| format!("{:.2} mm", MM * rmse);
        let headline = (self.validated.iter()).map(|validated| {
            let changed = |before, after| format!("{} before, {} after", mm(before), mm(after));
            let rmse = changed(validated.before.rmse, validated.after.rmse);
            match (validated.before.median, validated.after.median) {
                (Some(before), Some(after)) => {
                    let median = changed(before, after);
                    format!("{}: {median} (root mean square: {rmse})", validated.name)
                }
                _ => format!("{}: {rmse}", validated.name),
            }
        });
        let headline: Vec<String> = headline.collect();
        CalibrationReport {
            title: format!("Calibration of {}", self.robot),
            headline: headline.join(". ") + match self.measured {
                Measured::Markers => ". Root mean square distances of the markers from where the robot says, mean offset taken off.",
                Measured::Clouds => ". Median distances of the clouds' points from the robot's surface; stray points raise the root mean square.",
            },
            figures: (self.validated.iter())
                .flat_map(|validated| self.figures(validated))
                .collect(),
            examples: self.validated.iter().map(Validated::overlay).collect(),
            unknowns: (self.unknowns.iter())
                .map(|u| {
                    let note = if u.prior_only { "the recording says little" } else { "" };
                    let [low, high] = u.interval.map(|x| format!("{x:.5}"));
                    [u.name.clone(), format!("{:.5}", u.value), format!("{low} to {high}"), u.unit.to_owned(), note.to_owned()]
                })
                .collect(),
            correlations: (self.correlations.iter())
                .map(|c| [c.names[0].clone(), c.names[1].clone(), format!("{:.3}", c.correlation)])
                .collect(),
        }
        .to_html()
    }

    fn figures(&self, validated: &Validated) -> Vec<Figure> {
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
    /// Measured and simulated places of the markers, row by row, or points of clouds and the places of the surface nearest to
    /// them (m).
    fn pairs(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let rows = self.file.recording.points.iter().zip(&self.replay.points);
        let mut pairs = Vec::new();
        for (measured, simulated) in rows {
            let simulated = simulated.iter().flatten();
            pairs.extend(
                measured
                    .iter()
                    .zip(simulated)
                    .filter_map(|(p, q)| Some(((*p)?, *q))),
            );
        }
        let mut of_clouds = Vec::new();
        for (row, nearest) in self.replay.surface.iter().enumerate() {
            let cloud = self.file.recording.cloud(row).iter().copied();
            of_clouds.extend(cloud.zip(nearest.iter().flatten().copied()));
        }
        pairs.extend(of_clouds);
        thinned(pairs)
    }

    /// Each row's largest error of a marker, or median distance of its cloud (mm); not finite where there is none.
    fn errors(&self, residuals: &Residuals) -> Vec<f64> {
        (residuals.markers.iter().zip(&residuals.distances))
            .map(|(row, distances)| {
                let largest = row
                    .iter()
                    .flatten()
                    .map(Vector3::norm)
                    .fold(f64::NAN, f64::max);
                largest.max(median(&mut distances.clone())) * MM
            })
            .collect()
    }

    fn overlay(&self) -> Example {
        let cloud = |points: Vec<Vector3<f64>>| PointCloud {
            points: points
                .iter()
                .map(|p| [p.x as f32, p.y as f32, p.z as f32])
                .collect(),
            ..PointCloud::default()
        };
        let (truth, prediction) = self.pairs().into_iter().unzip();
        Example {
            label: self.name.to_owned(),
            truth: cloud(truth),
            prediction: cloud(prediction),
            ..Example::default()
        }
    }

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

/// Some of many, evenly spread.
fn thinned<T>(all: Vec<T>) -> Vec<T> {
    let stride = all.len().div_ceil(POINTS).max(1);
    all.into_iter().step_by(stride).collect()
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
