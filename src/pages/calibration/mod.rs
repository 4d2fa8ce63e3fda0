//! The page on a calibration: paths, errors, residuals, unknowns.

mod figures;

use nalgebra::Vector3;
use tdcr_base::stats::median;
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::inverse::recording::{Correlation, FittedUnknown, Replay, Residuals};
use tdcr_sim::robot::Drive;

use crate::pipeline::recording::{Calibration, Compared, Measured, RecordingFile};
use crate::report::{CalibrationReport, Example};

const MM: f64 = 1e3;
/// Points of a mark that are shown at most.
const POINTS: usize = 4000;

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
}

/// Some of many, evenly spread.
fn thinned<T>(all: Vec<T>) -> Vec<T> {
    let stride = all.len().div_ceil(POINTS).max(1);
    all.into_iter().step_by(stride).collect()
}
