//! A run as numbers, as a table and as a page.

use std::fmt::Write;

use nalgebra::Vector3;
use serde::Serialize;
use tdcr_control::belief::Unknown;
use tdcr_control::tracking::{Tracking, TrackingRow};
use tdcr_sim::robot::{Robot, TendonGroup};

use super::{ControllerName, Tracked};
use crate::report::{
    Aspect, Figure, Ink, Mark, Panel, Scale, Shape, StudyFigure, StudyPage, counted,
};

/// A run in numbers.
#[derive(Clone, Debug, Serialize)]
pub struct TrackSummary {
    /// Name of the robot.
    pub robot: String,
    /// Name of the controller.
    pub controller: &'static str,
    /// Periods on the path.
    pub periods: usize,
    /// Time between commands (s).
    pub period: f64,
    /// Root mean square distance of the tip from its target (m); `None` where the path was not begun.
    pub rms_error: Option<f64>,
    /// The same in percent of the robot's length.
    pub rms_error_percent: Option<f64>,
    /// The largest distance (m).
    pub largest_error: Option<f64>,
    /// Root mean square distance in each trial (m); `None` where one did not come to the path.
    pub trials: Vec<Option<f64>>,
    /// Root mean square distance in open loop through the model, on the same robot (m); `None` where that was not run.
    pub rms_error_open_loop: Option<f64>,
    /// What is known of what the model does not have, at the end.
    pub estimated: Vec<EstimatedJson>,
    /// Periods from a command to when the tendons get it, as told from the tip.
    pub delay_periods: usize,
    /// Periods of a rig that took longer than they were to.
    pub late_periods: usize,
    /// What the measurements do not identify.
    pub unidentified: Vec<String>,
    /// What went wrong.
    pub incidents: Vec<IncidentJson>,
    /// Why the run ended before the path did.
    pub stopped: Option<String>,
}

/// What is known of an unknown.
#[derive(Clone, Debug, Serialize)]
pub struct EstimatedJson {
    /// Its name.
    pub name: String,
    /// Its value (kg, N, m or 1).
    pub value: f64,
    /// Standard deviation of that.
    pub deviation: f64,
}

/// Something that went wrong.
#[derive(Clone, Debug, Serialize)]
pub struct IncidentJson {
    /// When (s, from the path's start).
    pub time: f64,
    /// What.
    pub reason: String,
}

impl TrackSummary {
    /// The numbers of a run of `robot`'s model.
    pub fn new(robot: &Robot, tracked: &Tracked) -> Self {
        let run = &tracked.run;
        let estimated = run.rows.last().map_or(&[][..], |row| &row.estimated);
        let rms_error = run.rms_error();
        Self {
            robot: robot.spec().name.clone(),
            controller: run.controller,
            periods: run.errors().len(),
            period: tracked.period,
            rms_error,
            rms_error_percent: rms_error.map(|error| 100.0 * error / run.length),
            largest_error: run.largest_error(),
            trials: tracked.trials.clone(),
            rms_error_open_loop: match &tracked.open_loop {
                Some(open_loop) => open_loop.rms_error(),
                None if run.controller == ControllerName::Inverse.name() => rms_error,
                None => None,
            },
            estimated: (estimated.iter())
                .map(|estimated| EstimatedJson {
                    name: estimated.unknown.to_string(),
                    value: estimated.value,
                    deviation: estimated.deviation,
                })
                .collect(),
            delay_periods: run.rows.last().map_or(0, |row| row.delay),
            late_periods: tracked.late,
            unidentified: run.unidentified.clone(),
            incidents: (run.incidents.iter())
                .map(|incident| IncidentJson {
                    time: incident.time,
                    reason: incident.reason.clone(),
                })
                .collect(),
            stopped: run.stopped.clone(),
        }
    }
}

/// The run as CSV: a line for each period, the approach's at times below 0.
pub fn table(robot: &Robot, run: &Tracking) -> String {
    let mut text = String::from("time (s)");
    for what in ["target", "measured", "tip"] {
        for axis in ["x", "y", "z"] {
            let _ = write!(text, ",{what} {axis} (m)");
        }
    }
    for (t, tendon) in robot.tendons().iter().enumerate() {
        let _ = write!(text, ",c{t} ({})", tendon.unit());
    }
    for t in 0..robot.tendons().len() {
        let _ = write!(text, ",tension{t} (N)");
    }
    let names = run.rows.first().map_or(&[][..], |row| &row.estimated);
    for estimated in names {
        let name = estimated.unknown;
        let _ = write!(text, ",{name},{name} deviation");
    }
    text += ",held\n";
    for row in &run.rows {
        let _ = write!(text, "{}", row.time);
        for point in [Some(row.target), row.measured, row.tip] {
            match point {
                Some(point) => {
                    let _ = write!(text, ",{},{},{}", point.x, point.y, point.z);
                }
                None => text += ",,,",
            }
        }
        for value in &row.command {
            let _ = write!(text, ",{value}");
        }
        match &row.tensions {
            Some(tensions) => tensions.iter().for_each(|value| {
                let _ = write!(text, ",{value}");
            }),
            None => text += &",".repeat(robot.tendons().len()),
        }
        for estimated in &row.estimated {
            let _ = write!(text, ",{},{}", estimated.value, estimated.deviation);
        }
        let held = row.held.as_deref().unwrap_or_default().replace('"', "\"\"");
        let _ = writeln!(text, ",\"{held}\"");
    }
    text
}

/// The page on a run: error, path, commands, tensions and the estimated load.
pub fn page(robot: &Robot, tracked: &Tracked, settings: Vec<(String, String)>) -> StudyPage {
    let summary = TrackSummary::new(robot, tracked);
    let rows = &tracked.run.rows;
    let mut figures = vec![
        ("error", error_figure(tracked)),
        ("path", path_figure(tracked)),
    ];
    figures.push(("commands", tendon_figure(robot, rows, Tendons::Commands)));
    if rows.iter().any(|row| row.tensions.is_some()) {
        figures.push(("tensions", tendon_figure(robot, rows, Tendons::Tensions)));
    }
    figures.extend(payload_figure(tracked).map(|figure| ("payload", figure)));
    let mut what: Vec<(String, String)> = settings;
    for incident in &summary.incidents {
        what.push((
            format!("At {:.2} s", incident.time),
            incident.reason.clone(),
        ));
    }
    if !summary.unidentified.is_empty() {
        what.push((
            "Not identified by the measurements".to_owned(),
            summary.unidentified.join(", "),
        ));
    }
    StudyPage {
        title: format!("{} along a path, by {}", summary.robot, summary.controller),
        headline: headline(&summary),
        figures: (figures.into_iter())
            .map(|(name, figure)| StudyFigure {
                name: name.to_owned(),
                svg: figure.to_svg(),
            })
            .collect(),
        summary: what,
        ..StudyPage::default()
    }
}

/// The result in a sentence.
pub fn headline(summary: &TrackSummary) -> String {
    let millimetres = |error: Option<f64>| match error {
        Some(error) => format!("{:.2} mm", 1e3 * error),
        None => "not known".to_owned(),
    };
    let mut text = format!(
        "RMS error of the tip over {}: {}",
        counted(summary.periods, "period"),
        millimetres(summary.rms_error),
    );
    if let Some(percent) = summary.rms_error_percent {
        let _ = write!(text, " ({percent:.3} % of the length)");
    }
    match summary.rms_error_open_loop {
        Some(error) => {
            let _ = write!(text, "; in open loop {}.", millimetres(Some(error)));
        }
        None => text.push('.'),
    }
    if summary.trials.len() > 1 {
        let trials = summary.trials.iter().map(|&error| millimetres(error));
        let trials: Vec<String> = trials.collect();
        let _ = write!(text, " Trial by trial: {}.", trials.join(", "));
    }
    if let Some(stopped) = &summary.stopped {
        let _ = write!(text, " The run was stopped: {stopped}.");
    }
    text
}

const TIME: &str = "time (s)";

fn line(name: &str, ink: Ink, points: Vec<[f64; 2]>) -> Mark {
    Mark {
        name: name.to_owned(),
        shape: Shape::Line,
        ink,
        points,
    }
}

fn panel(title: &str, x: Scale, y: Scale, aspect: Aspect, marks: Vec<Mark>) -> Panel {
    Panel {
        title: title.to_owned(),
        x,
        y,
        aspect,
        marks,
    }
}

fn error_figure(tracked: &Tracked) -> Figure {
    // A logarithm of 0 has no place.
    let errors = |run: &Tracking| -> Vec<[f64; 2]> {
        let errors = run.errors().into_iter();
        errors
            .map(|[time, error]| [time, 1e3 * error.max(1e-7)])
            .collect()
    };
    let mut marks = Vec::new();
    if let Some(open_loop) = &tracked.open_loop {
        marks.push(line(open_loop.controller, Ink::Grey, errors(open_loop)));
    }
    marks.push(line(
        tracked.run.controller,
        Ink::Vermilion,
        errors(&tracked.run),
    ));
    Figure {
        title: "Distance of the tip from its target".to_owned(),
        caption: "On the simulated robot, in closed loop and in open loop through the same model."
            .to_owned(),
        panels: vec![panel(
            "",
            Scale::linear(TIME),
            Scale::log("error (mm)"),
            Aspect::Free,
            marks,
        )],
    }
}

fn path_figure(tracked: &Tracked) -> Figure {
    let in_plane = |axes: [usize; 2]| {
        let points = |run: &Tracking, place: &dyn Fn(&TrackingRow) -> Option<Vector3<f64>>| {
            let rows = run.rows.iter().filter(|row| row.time >= 0.0);
            rows.filter_map(place)
                .map(|point| axes.map(|axis| 1e3 * point[axis]))
                .collect()
        };
        let run = &tracked.run;
        let mut marks = vec![line(
            "target",
            Ink::Black,
            points(run, &|row| Some(row.target)),
        )];
        if let Some(open_loop) = &tracked.open_loop {
            let open = points(open_loop, &|row| row.tip);
            marks.push(line(open_loop.controller, Ink::Grey, open));
        }
        marks.push(line(
            run.controller,
            Ink::Vermilion,
            points(run, &|row| row.tip),
        ));
        let name = |axis: usize| format!("{} (mm)", ["x", "y", "z"][axis]);
        let [across, up] = axes.map(name);
        panel(
            "",
            Scale::linear(&across),
            Scale::linear(&up),
            Aspect::Equal,
            marks,
        )
    };
    Figure {
        title: "The tip's path".to_owned(),
        caption: "From above, and from the side.".to_owned(),
        panels: vec![in_plane([0, 1]), in_plane([0, 2])],
    }
}

#[derive(Clone, Copy)]
enum Tendons {
    Commands,
    Tensions,
}

fn tendon_figure(robot: &Robot, rows: &[TrackingRow], what: Tendons) -> Figure {
    const INKS: [Ink; 5] = [
        Ink::Blue,
        Ink::Vermilion,
        Ink::Green,
        Ink::Purple,
        Ink::Black,
    ];
    let of_group = |group: &TendonGroup| {
        let unit = group.unit.display();
        let marks = group.tendons.clone().map(|t| {
            let value = |row: &TrackingRow| match what {
                Tendons::Commands => Some(row.command[t] * unit.per_unit),
                Tendons::Tensions => row.tensions.as_ref().map(|tensions| tensions[t]),
            };
            let points = rows.iter().filter_map(|row| Some([row.time, value(row)?]));
            let ink = INKS[(t - group.tendons.start) % INKS.len()];
            line(&format!("{}", t + 1), ink, points.collect())
        });
        let y = match what {
            Tendons::Commands => format!("command ({})", unit.symbol),
            Tendons::Tensions => "tension (N)".to_owned(),
        };
        panel(
            &group.name,
            Scale::linear(TIME),
            Scale::linear(&y),
            Aspect::Free,
            marks.collect(),
        )
    };
    let (title, caption) = match what {
        Tendons::Commands => ("Commands", "Before 0 s the tip is led to the path."),
        Tendons::Tensions => ("Tensions", "As measured at the servos."),
    };
    Figure {
        title: title.to_owned(),
        caption: caption.to_owned(),
        panels: robot.spec().tendon_groups().iter().map(of_group).collect(),
    }
}

/// The estimated payload beside the true one, where it is estimated.
fn payload_figure(tracked: &Tracked) -> Option<Figure> {
    let rows = &tracked.run.rows;
    let found = |row: &TrackingRow| {
        let mut estimated = row.estimated.iter();
        let payload = estimated.find(|estimated| estimated.unknown == Unknown::Payload)?;
        Some([row.time, 1e3 * payload.value, 2e3 * payload.deviation])
    };
    let values: Vec<[f64; 3]> = rows.iter().filter_map(found).collect();
    let (first, last) = (values.first()?[0], values.last()?[0]);
    let truth = 1e3 * tracked.payload;
    let at = |sign: f64| {
        let band = values
            .iter()
            .map(|[time, value, band]| [*time, value + sign * band]);
        band.collect::<Vec<_>>()
    };
    let dashes = |name: &str, ink, points| Mark {
        shape: Shape::Dashes,
        ..line(name, ink, points)
    };
    let mut marks = vec![
        dashes("", Ink::Vermilion, at(-1.0)),
        dashes("", Ink::Vermilion, at(1.0)),
        line("estimated", Ink::Vermilion, at(0.0)),
    ];
    if truth.is_finite() {
        marks.insert(
            0,
            line("in truth", Ink::Black, vec![[first, truth], [last, truth]]),
        );
    }
    Some(Figure {
        title: "Estimated payload".to_owned(),
        caption: "Dashed: two standard deviations of the estimate.".to_owned(),
        panels: vec![panel(
            "",
            Scale::linear(TIME),
            Scale::linear("payload (g)"),
            Aspect::Free,
            marks,
        )],
    })
}
