//! The sections of the page, each from the part of the report that it shows.

use tdcr_base::stats::{quantile, sorted};

use super::color_scale::{ColorScale, css_gradient};
use super::html::{NOT_AVAILABLE, base64, column_decimals, escape, fill, fixed};
use super::motors::command_text;
use super::picture::{BOTH, Framing, NEAREST, PREDICTION, Subject, TRUTH};
use super::{Cost, Example, MotorGroup, Report, Score, viewer as viewer_data};

/// Units of the table and the charts: 1e-4 m^2 and 1 mm.
pub(crate) const CD_UNIT: f64 = 1e-4;
const EMD_UNIT: f64 = 1e-3;
pub(crate) const CD_TITLE: &str = "CD (10⁻⁴\u{a0}m²)";

/// Width of a picture (pixels).
const PICTURE_WIDTH: usize = 240;

/// Style sheet of the page.
pub(crate) fn style() -> String {
    let hex = |[r, g, b]: [u8; 3]| format!("#{r:02x}{g:02x}{b:02x}");
    fill(
        include_str!("style.css"),
        &[
            ("truth", &hex(TRUTH)),
            ("prediction", &hex(PREDICTION)),
            ("nearest", &hex(NEAREST)),
            ("both", &hex(BOTH)),
            ("gradient", &css_gradient()),
        ],
    )
}

/// What stands for an empty section.
pub(crate) fn missing() -> String {
    format!("<p class=\"missing\">{NOT_AVAILABLE}</p>")
}

/// A figure with its caption (HTML both).
pub(crate) fn figure(class: &str, body: &str, caption: &str) -> String {
    format!("<figure class=\"{class}\">{body}<figcaption>{caption}</figcaption></figure>")
}

/// The table of scores, with columns of what its first rows cost where that is known of any.
pub(crate) fn scores(report: &Report, costs: &[Cost]) -> String {
    let rows: Vec<&Score> = report.scores.iter().chain(&report.floor).collect();
    if rows.is_empty() {
        return missing();
    }
    let column = |pick: fn(&Score) -> f64, unit: f64| {
        let decimals = column_decimals(rows.iter().map(|score| pick(score) / unit));
        let floor = report.floor.as_ref().map_or(f64::NAN, pick);
        move |score: &Score| {
            let value = fixed(pick(score) / unit, decimals);
            let ratio = fixed(pick(score) / floor, 1);
            format!("<td>{value}</td><td>{ratio}</td>")
        }
    };
    let cd = column(|score| score.cd, CD_UNIT);
    let emd = column(|score| score.emd, EMD_UNIT);
    let emd_squared = column(|score| score.emd_squared, CD_UNIT);
    let row = |score: &Score, class: &str, cost: Option<&Cost>| {
        format!(
            "<tr{class}><th scope=\"row\">{}</th>{}{}{}{}</tr>",
            escape(&score.name),
            cd(score),
            emd(score),
            emd_squared(score),
            cost_cells(costs, cost),
        )
    };
    let mut body: String = (report.scores.iter().enumerate())
        .map(|(place, score)| row(score, "", costs.get(place)))
        .collect();
    if let Some(floor) = &report.floor {
        body += &row(floor, " class=\"floor\"", None);
    }
    let cost_titles = match costs {
        [] => String::new(),
        _ => ["Training (processor s)", "Prediction (ms)"]
            .map(|title| format!("<th scope=\"col\">{title}</th>"))
            .concat(),
    };
    let notes: Vec<String> = report.score_notes.iter().map(|note| escape(note)).collect();
    let notes = notes.join(" ");
    format!(
        "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">Method</th>\
         <th scope=\"col\">{CD_TITLE}</th><th scope=\"col\">CD ÷ floor</th>\
         <th scope=\"col\">EMD (mm)</th><th scope=\"col\">EMD ÷ floor</th>\
         <th scope=\"col\">Squared EMD (10⁻⁴\u{a0}m²)</th>\
         <th scope=\"col\">Squared EMD ÷ floor</th>{cost_titles}</tr></thead>\
         <tbody>{body}</tbody></table></div>\
         <p class=\"note\">Lower is better. CD, the squared Chamfer distance: the mean squared \
         distance from each predicted point to the nearest true point, plus the same from true to \
         predicted. EMD, the earth mover’s distance: the mean distance between the points of both \
         clouds when they are matched one to one at the least total distance. Squared EMD: the mean \
         squared distance when they are matched at the least total squared distance. The sampling floor \
         is what two independent samples of the same surface score: no prediction can be expected \
         to score less. {notes}</p>"
    )
}

/// The cells of what a row costs, in a table that has `costs`.
fn cost_cells(costs: &[Cost], cost: Option<&Cost>) -> String {
    if costs.is_empty() {
        return String::new();
    }
    let cost = cost.copied().unwrap_or_default();
    let cell = |seconds: Option<f64>, scale: f64, decimals: usize| match seconds {
        Some(seconds) => format!("<td>{}</td>", fixed(scale * seconds, decimals)),
        None => "<td>–</td>".to_owned(),
    };
    cell(cost.training, 1.0, 0) + &cell(cost.prediction, 1e3, 1)
}

/// A cloud that the viewer can show.
pub(crate) struct CloudBox<'a> {
    /// Its name in the viewer's data.
    cloud: &'static str,
    /// Class of its colour.
    class: &'static str,
    /// What it is called.
    label: &'a str,
    /// Whether it is shown at first.
    shown: bool,
}

impl<'a> CloudBox<'a> {
    /// A cloud that is shown at first.
    pub fn new(cloud: &'static str, class: &'static str, label: &'a str) -> Self {
        Self {
            cloud,
            class,
            label,
            shown: true,
        }
    }

    fn html(&self) -> String {
        let checked = if self.shown { " checked" } else { "" };
        format!(
            "<label><input type=\"checkbox\" data-cloud=\"{}\"{checked}><i class=\"dot {}\"></i>{}</label>\n",
            self.cloud,
            self.class,
            escape(self.label)
        )
    }
}

/// The clouds of an evaluation.
pub(crate) fn evaluation_boxes() -> [CloudBox<'static>; 3] {
    let nearest = CloudBox::new("nearest", "nearest", "Nearest training command");
    [
        CloudBox::new("truth", "truth", "Truth"),
        CloudBox::new("prediction", "network", "Prediction"),
        CloudBox {
            shown: false,
            ..nearest
        },
    ]
}

/// The 3-D viewer; nothing without examples.
pub(crate) fn viewer(examples: &[Example], boxes: &[CloudBox<'_>]) -> String {
    if examples.is_empty() {
        return String::new();
    }
    let option = |example: &Example| format!("<option>{}</option>", escape(&example.label));
    let options: String = examples.iter().map(option).collect();
    fill(
        include_str!("viewer.html"),
        &[
            ("options", &options),
            (
                "boxes",
                &boxes.iter().map(CloudBox::html).collect::<String>(),
            ),
            ("data", &viewer_data::data(examples)),
            ("script", include_str!("viewer.js")),
        ],
    )
}

/// A row of still pictures for each example.
pub(crate) fn pictures(report: &Report) -> String {
    let examples = &report.examples;
    if examples.is_empty() {
        return missing();
    }
    let framing = Framing::of(examples, PICTURE_WIDTH);
    let decimals = column_decimals(
        examples
            .iter()
            .flat_map(|example| [example.cd / CD_UNIT, example.cd_nearest / CD_UNIT]),
    );
    let rows: String = examples
        .iter()
        .map(|example| picture_row(example, &report.motors, &framing, decimals))
        .collect();
    let bar_cm = 100.0 * framing.bar;
    let scales: String = [
        (
            "Error: distance of a predicted point from the true cloud",
            framing.error,
        ),
        ("Uncertainty", framing.uncertainty),
    ]
    .into_iter()
    .filter_map(|(name, scale)| Some(color_legend(name, scale?)))
    .collect();
    let tip = match examples.iter().any(|example| example.tip.is_some()) {
        true => TIP_NOTE,
        false => "",
    };
    format!(
        "<ul class=\"legend\"><li><i class=\"dot truth\"></i>True cloud alone</li>\
         <li><i class=\"dot network\"></i>Prediction alone</li>\
         <li><i class=\"dot nearest\"></i>Nearest training command’s cloud alone</li>\
         <li><i class=\"dot both\"></i>Both</li></ul><ul class=\"legend\">{scales}</ul>{rows}\
         <p class=\"note\">Each row is one test command. First: the true cloud in its own colours. \
         Where two clouds are compared: grey where the outlines of both agree, a colour where one cloud \
         stands out. Between them, where they are known: the prediction in the colours of its error and of its \
         uncertainty. A row is seen across its plane of bending, all pictures have the same scale, \
         and the bar at the lower left of each is {bar_cm}\u{a0}cm long. CD is the squared Chamfer \
         distance from the true cloud, EMD the earth mover’s distance. {tip}</p>"
    )
}

fn picture_row(
    example: &Example,
    motors: &[MotorGroup],
    framing: &Framing,
    decimals: usize,
) -> String {
    let label = escape(&example.label);
    let subjects = framing.subjects();
    let figures: String = subjects
        .iter()
        .map(|&subject| {
            let (alt, caption) = match subject {
                Subject::Truth => ("true cloud in its own colours", "Truth".to_owned()),
                Subject::Prediction => (
                    "predicted cloud against the true cloud",
                    format!(
                        "Prediction, CD\u{a0}{}, EMD\u{a0}{}\u{a0}mm{}",
                        cd_text(example.cd, decimals),
                        fixed(example.emd / EMD_UNIT, 1),
                        example.tip.map_or(String::new(), |tip| {
                            format!(", tip\u{a0}{}\u{a0}mm off", fixed(tip / EMD_UNIT, 1))
                        })
                    ),
                ),
                Subject::Error => (
                    "predicted cloud, coloured by the distance of each point from the true cloud",
                    format!("Its error, {}", values_text(&example.error)),
                ),
                Subject::Uncertainty => (
                    "predicted cloud, coloured by the uncertainty of each point",
                    format!("Its uncertainty, {}", values_text(&example.uncertainty)),
                ),
                Subject::Nearest => (
                    "cloud of the nearest training command against the true cloud",
                    format!(
                        "Nearest training command, CD\u{a0}{}",
                        cd_text(example.cd_nearest, decimals)
                    ),
                ),
            };
            let image = framing.picture(example, subject);
            let tag = format!(
                "<img src=\"data:image/png;base64,{}\" width=\"{}\" height=\"{}\" alt=\"{label}: {alt}\">",
                base64(&image.to_png()),
                image.width,
                image.height,
            );
            figure("", &tag, &caption)
        })
        .collect();
    format!(
        "<article class=\"example\"><h3>{label}</h3><p>{}</p>\
         <div class=\"pictures\" style=\"--columns:{}\">{figures}</div></article>",
        condition_text(example, motors),
        subjects.len(),
    )
}

/// What a tip's error is.
const TIP_NOTE: &str = "The tip is off by how far the last disc moves when the points of the true cloud on it are laid onto \
     the predicted cloud. Of errors up to half the robot's length nine in ten are told within 10 %; larger ones may be told \
     too small.";

/// A scale of colours in a legend, from zero to its end.
pub(crate) fn color_legend(name: &str, scale: ColorScale) -> String {
    let top = fixed(
        scale.top / EMD_UNIT,
        column_decimals([scale.top / EMD_UNIT]).saturating_sub(1),
    );
    format!("<li>{name}: 0 <i class=\"scale\"></i> {top}\u{a0}mm or more</li>")
}

/// Mean and 95 % quantile of lengths (m).
pub(crate) fn values_text(values: &[f64]) -> String {
    let values = sorted(values.iter().copied().filter(|x| x.is_finite()));
    if values.is_empty() {
        return NOT_AVAILABLE.to_owned();
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let most = quantile(&values, 0.95);
    let decimals = column_decimals([mean / EMD_UNIT]);
    let [mean, most] = [mean, most].map(|x| fixed(x / EMD_UNIT, decimals));
    format!("mean\u{a0}{mean}\u{a0}mm, 95\u{a0}% below {most}\u{a0}mm")
}

/// A squared distance in the table's unit, kept on one line.
pub(crate) fn cd_text(cd: f64, decimals: usize) -> String {
    if cd.is_finite() {
        let value = fixed(cd / CD_UNIT, decimals);
        format!("{value}\u{a0}×\u{a0}10⁻⁴\u{a0}m²")
    } else {
        NOT_AVAILABLE.to_owned()
    }
}

/// The command, and the payload if there is one.
pub(crate) fn condition_text(example: &Example, motors: &[MotorGroup]) -> String {
    let command = command_text(&example.command, motors);
    let payload = match example.payload {
        Some(payload) => format!("; payload (g): {}", fixed(payload / 1e-3, 1)),
        None => String::new(),
    };
    format!("{command}{payload}")
}

/// The list of settings.
pub(crate) fn settings(summary: &[(String, String)]) -> String {
    if summary.is_empty() {
        return missing();
    }
    let entry = |(name, value): &(String, String)| {
        format!(
            "<div><dt>{}</dt><dd>{}</dd></div>",
            escape(name),
            escape(value)
        )
    };
    format!("<dl>{}</dl>", summary.iter().map(entry).collect::<String>())
}
