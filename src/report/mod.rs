//! The report on a network's scores: one self-contained HTML page, and a picture for a README. Also
//! plots of anything, as self-contained SVG: [`Figure`].
//!
//! Plain data in, text or PNG bytes out: nothing here computes a score or reads a file. The page
//! loads nothing: its style, script, pictures and point clouds are inside it, and its content
//! security policy forbids anything else.

mod calibration;
mod closing;
mod color_scale;
mod command_space;
mod comparison;
mod count;
mod curves;
mod data_page;
mod figure;
mod frame;
mod html;
mod lettering;
mod motors;
mod obstacles;
mod picture;
mod raster;
mod sections;
mod sheet;
mod study_page;
mod surface;
mod viewer;

pub use calibration::CalibrationReport;
pub use comparison::{ComparisonPage, Measure};
pub use count::counted;
pub use data_page::{DataPage, SetSummary};
pub use figure::{Aspect, Figure, HeatMap, HeatPanel, Ink, Mark, Panel, Scale, Shape, Spacing};
pub use motors::MotorGroup;
pub use obstacles::{Window, outlines, sections};
pub use sheet::{cloud_sheet, contact_sheet, scale_bar};
pub use study_page::{StudyFigure, StudyPage};
pub use surface::Surface;

use tdcr_sim::cloud::PointCloud;

/// All that the page shows. Whatever is empty or not finite appears as "not available".
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Title of the page.
    pub title: String,
    /// The result, in one sentence.
    pub headline: String,
    /// Settings, as `(name, value)`: robot, commands per split, network, seed, version, ...
    pub summary: Vec<(String, String)>,
    /// Scores of the network and of what it is compared with, in the order of the
    /// table; the first, the network's, stands out.
    pub scores: Vec<Score>,
    /// Score of two samples of the same surface, which no predictor can be expected to be below.
    /// The table's last row, and the unit of its ratios.
    pub floor: Option<Score>,
    /// How the scores were computed, a sentence each: numbers of points and of commands, ...
    pub score_notes: Vec<String>,
    /// Scores of each test command.
    pub per_test: Option<PerTest>,
    /// How the network was trained; without it, the page has no such section.
    pub training: Option<Training>,
    /// Wall-clock time of each stage, in the order in which they ran; without any, the page has no such
    /// section.
    pub stages: Vec<Stage>,
    /// Which numbers of a command belong together.
    pub motors: Vec<MotorGroup>,
    /// Test commands whose clouds are shown.
    pub examples: Vec<Example>,
}

/// Mean distances of a method's clouds from the true ones.
#[derive(Clone, Debug)]
pub struct Score {
    /// Name of the method.
    pub name: String,
    /// Squared Chamfer distance (m^2).
    pub cd: f64,
    /// Earth mover's distance (m).
    pub emd: f64,
    /// Mean squared distance of the bijection that makes it least (m^2).
    pub emd_squared: f64,
}

/// What a method costs, as far as it is known.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    /// Time of all processors that its training took (s).
    pub training: Option<f64>,
    /// Time of a prediction (s).
    pub prediction: Option<f64>,
}

/// The report on several methods beside each other.
#[derive(Clone, Debug, Default)]
pub struct MethodsReport {
    /// What the report on one has; the examples are of each method in turn.
    pub report: Report,
    /// What the methods of the first rows of the table cost, in their order.
    pub costs: Vec<Cost>,
}

impl MethodsReport {
    /// The report as one HTML page, as [`Report::to_html`]; its table has columns of the costs.
    pub fn to_html(&self) -> String {
        self.report.page(&self.costs)
    }
}

/// The test commands and their Chamfer distances, one after another in the same order in each list.
#[derive(Clone, Debug, Default)]
pub struct PerTest {
    /// Of each method; the first is the one that the page is on.
    pub methods: Vec<MethodDistances>,
    /// The commands, as in [`Example::command`].
    pub commands: Vec<Vec<f64>>,
    /// Distance of each condition from the nearest training condition: Euclidean, each number in units of its range in the
    /// training data.
    pub apart: Vec<f64>,
}

/// A method's Chamfer distances.
#[derive(Clone, Debug)]
pub struct MethodDistances {
    /// Name of the method.
    pub name: String,
    /// How its curve is drawn.
    pub role: Role,
    /// Chamfer distance of each test command (m^2).
    pub values: Vec<f64>,
}

/// What a method is in a plot, which decides its colour and stroke.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Role {
    /// The one that the page is on.
    Network,
    /// The nearest training command.
    Nearest,
    /// Another one that it is compared with: the number tells several apart.
    Other(usize),
    /// The sampling floor: a dashed reference line.
    Floor,
}

/// The course of a training.
#[derive(Clone, Debug, Default)]
pub struct Training {
    /// Training loss as `(step, loss)`, by ascending step.
    pub loss_curve: Vec<(u64, f64)>,
    /// Chamfer distance on the validation commands as `(step, m^2)`, by ascending step.
    pub validation_curve: Vec<(u64, f64)>,
    /// How these were computed, a sentence: fewer points than in the table make them larger.
    pub validation_note: String,
}

/// A stage of the run.
#[derive(Clone, Debug)]
pub struct Stage {
    /// What was done.
    pub name: String,
    /// Wall-clock time (s).
    pub seconds: f64,
}

/// A test command and the clouds that belong to it, all in the world frame.
#[derive(Clone, Debug, Default)]
pub struct Example {
    /// Name of the example.
    pub label: String,
    /// Command of each tendon, in SI units or those of the recording.
    pub command: Vec<f64>,
    /// Mass hung from the tip (kg); `None` in a data set without payloads.
    pub payload: Option<f64>,
    /// The cloud that was observed.
    pub truth: PointCloud,
    /// The cloud that the network predicts.
    pub prediction: PointCloud,
    /// The cloud of the nearest training command.
    pub nearest: PointCloud,
    /// Chamfer distance of the prediction from the truth (m^2).
    pub cd: f64,
    /// Earth mover's distance of the prediction from the truth (m).
    pub emd: f64,
    /// Chamfer distance of the nearest command's cloud from the truth (m^2).
    pub cd_nearest: f64,
    /// Distance of each point of the prediction from the nearest point of the truth (m); empty where it is not known.
    pub error: Vec<f64>,
    /// Uncertainty of each point of the prediction (m); empty where it is not known.
    pub uncertainty: Vec<f64>,
    /// Distance of the predicted tip from the true one (m); `None` where no robot says where that is.
    pub tip: Option<f64>,
}

impl Example {
    fn clouds(&self) -> [&PointCloud; 3] {
        [&self.truth, &self.prediction, &self.nearest]
    }
}

impl Report {
    /// The report as one HTML page, the same text for the same data.
    ///
    /// Eight examples make about one megabyte: the viewer holds at most 3,000 points of each cloud.
    pub fn to_html(&self) -> String {
        self.page(&[])
    }

    /// The page, with what the first rows of the table cost.
    fn page(&self, costs: &[Cost]) -> String {
        let frame = frame::PageFrame {
            title: &self.title,
            lead: &self.headline,
            style: "",
        };
        frame.fill(
            include_str!("page.html"),
            &[
                ("scores", &sections::scores(self, costs)),
                (
                    "viewer",
                    &sections::viewer(&self.examples, &sections::evaluation_boxes()),
                ),
                ("pictures", &sections::pictures(self)),
                (
                    "distribution",
                    &curves::distribution(self.per_test.as_ref()),
                ),
                (
                    "commands",
                    &command_space::section(self.per_test.as_ref(), &self.motors),
                ),
                (
                    "training",
                    &self
                        .training
                        .as_ref()
                        .map_or_else(String::new, curves::training),
                ),
                ("stages", &curves::stages(&self.stages)),
                ("settings", &sections::settings(&self.summary)),
            ],
        )
    }
}
