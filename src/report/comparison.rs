//! The page on two data sets beside each other.

use super::figure::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};
use super::frame::PageFrame;
use super::html::{base64, column_decimals, escape, fixed};
use super::motors::{MotorGroup, command_text};
use super::picture::{Framing, Subject};
use super::sections::{self, CloudBox};
use super::{Example, count::counted};

/// Width of a picture (pixels).
const PICTURE_WIDTH: usize = 300;
/// Plots side by side.
const PANELS: usize = 2;
/// Rows of the list of configurations, at most.
const LISTED: usize = 500;

/// All that the page shows, of `A` and `B`.
#[derive(Clone, Debug, Default)]
pub struct ComparisonPage {
    /// What `A` and `B` are called.
    pub names: [String; 2],
    /// The result, in one sentence.
    pub headline: String,
    /// The distances; the first orders the configurations.
    pub measures: Vec<Measure>,
    /// How they were computed, a sentence each.
    pub notes: Vec<String>,
    /// Which numbers of a command belong together.
    pub motors: Vec<MotorGroup>,
    /// Name and command of each configuration.
    pub configurations: Vec<(String, Vec<f64>)>,
    /// Configurations whose clouds are shown: that of `A` as the truth, that of `B` as the prediction, no nearest one.
    pub examples: Vec<Example>,
    /// Settings, as `(name, value)`.
    pub summary: Vec<(String, String)>,
}

/// A distance of two clouds, in the unit in which it is shown.
#[derive(Clone, Debug, Default)]
pub struct Measure {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Its mean over the configurations.
    pub mean: f64,
    /// Its median.
    pub median: f64,
    /// What 95 % of the configurations are below.
    pub p95: f64,
    /// Its greatest value.
    pub worst: f64,
    /// Its value for each configuration; not finite where it is not known.
    pub values: Vec<f64>,
}

impl Measure {
    fn title(&self) -> String {
        format!("{} ({})", self.name, self.unit)
    }
}

impl ComparisonPage {
    /// The page as one self-contained HTML text, the same for the same data.
    pub fn to_html(&self) -> String {
        let [a, b] = &self.names;
        let boxes = [
            CloudBox::new("truth", "truth", a),
            CloudBox::new("prediction", "network", b),
        ];
        let frame = PageFrame {
            title: &format!("{a} beside {b}"),
            lead: &self.headline,
            style: include_str!("comparison_page.css"),
        };
        frame.fill(
            include_str!("comparison_page.html"),
            &[
                ("distances", &self.distances()),
                ("viewer", &sections::viewer(&self.examples, &boxes)),
                ("pictures", &self.pictures()),
                ("distribution", &self.distribution()),
                ("configurations", &self.list()),
                ("settings", &sections::settings(&self.summary)),
            ],
        )
    }

    /// The table of means and quantiles.
    fn distances(&self) -> String {
        let row = |measure: &Measure| {
            let columns = [measure.mean, measure.median, measure.p95, measure.worst];
            let decimals = column_decimals(columns);
            let cells: String = columns
                .iter()
                .map(|&value| format!("<td>{}</td>", fixed(value, decimals)))
                .collect();
            format!(
                "<tr><th scope=\"row\">{}</th>{cells}</tr>",
                escape(&measure.title())
            )
        };
        let rows: String = self.measures.iter().map(row).collect();
        let notes: Vec<String> = self.notes.iter().map(|note| escape(note)).collect();
        format!(
            "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">Distance</th><th scope=\"col\">Mean</th>\
             <th scope=\"col\">Median</th><th scope=\"col\">95\u{a0}% below</th><th scope=\"col\">Worst</th></tr></thead>\
             <tbody>{rows}</tbody></table></div><p class=\"note\">{}</p>",
            notes.join(" ")
        )
    }

    /// A row of still pictures for each example.
    fn pictures(&self) -> String {
        if self.examples.is_empty() {
            return sections::missing();
        }
        let framing = Framing::of(&self.examples, PICTURE_WIDTH);
        let [a, b] = self.names.each_ref().map(|name| escape(name));
        let rows: String = self
            .examples
            .iter()
            .map(|example| self.picture_row(example, &framing))
            .collect();
        let scale = framing.error.map_or(String::new(), |scale| {
            let name = format!(
                "Distance of a point of {} from the other cloud",
                self.names[1]
            );
            sections::color_legend(&escape(&name), scale)
        });
        format!(
            "<ul class=\"legend\"><li><i class=\"dot truth\"></i>{a} alone</li><li><i class=\"dot network\"></i>{b} alone</li>\
             <li><i class=\"dot both\"></i>Both</li>{scale}</ul>{rows}\
             <p class=\"note\">Each row is one configuration. First the cloud of {a} in its own colours, then both clouds: grey \
             where their outlines agree, a colour where one stands out; last the cloud of {b}, each point in the colour of its \
             distance from the nearest point of {a}. A row is seen across the plane in which {a} bends, all pictures have the \
             same scale, and the bar at the lower left of each is {:.0}\u{a0}cm long.</p>",
            100.0 * framing.bar
        )
    }

    fn picture_row(&self, example: &Example, framing: &Framing) -> String {
        let [a, b] = self.names.each_ref().map(|name| escape(name));
        let label = escape(&example.label);
        let tip = example.tip.map_or(String::new(), |tip| {
            format!(", tips\u{a0}{}\u{a0}mm apart", fixed(1e3 * tip, 2))
        });
        let pictures = [
            (Subject::Truth, a.clone()),
            (
                Subject::Prediction,
                format!(
                    "Both: CD\u{a0}{}, EMD\u{a0}{}\u{a0}mm{tip}",
                    sections::cd_text(
                        example.cd,
                        column_decimals([example.cd / sections::CD_UNIT])
                    ),
                    fixed(1e3 * example.emd, 2)
                ),
            ),
            (
                Subject::Error,
                format!(
                    "{b}: distances from {a}, {}",
                    sections::values_text(&example.error)
                ),
            ),
        ];
        let figures: String = pictures
            .iter()
            .map(|(subject, caption)| {
                let image = framing.picture(example, *subject);
                let tag = format!(
                    "<img src=\"data:image/png;base64,{}\" width=\"{}\" height=\"{}\" alt=\"{label}: {caption}\">",
                    base64(&image.to_png()),
                    image.width,
                    image.height,
                );
                sections::figure("", &tag, caption)
            })
            .collect();
        format!(
            "<article class=\"example\"><h3>{label}</h3><p>{}</p><div class=\"pictures\" style=\"--columns:{}\">{figures}</div>\
             </article>",
            escape(&sections::condition_text(example, &self.motors)),
            pictures.len(),
        )
    }

    /// The share of configurations below each distance.
    fn distribution(&self) -> String {
        let panel = |measure: &Measure| {
            let mut values: Vec<f64> = measure
                .values
                .iter()
                .copied()
                .filter(|x| x.is_finite())
                .collect();
            values.sort_by(f64::total_cmp);
            let share = 100.0 / values.len().max(1) as f64;
            let ranked = values.iter().enumerate();
            Panel {
                title: measure.name.clone(),
                x: Scale::linear(&measure.title()),
                y: Scale::linear("configurations below (%)"),
                aspect: Aspect::Free,
                marks: vec![Mark {
                    name: String::new(),
                    shape: match values.len() {
                        // A line through a few would say more than is known.
                        ..20 => Shape::Dots,
                        _ => Shape::Line,
                    },
                    ink: Ink::Blue,
                    points: ranked.map(|(k, &x)| [x, share * (k + 1) as f64]).collect(),
                }],
            }
        };
        let panels: Vec<Panel> = self.measures.iter().map(panel).collect();
        let names = |panels: &[Panel]| -> Vec<String> {
            panels.iter().map(|panel| panel.title.clone()).collect()
        };
        let figures = panels.chunks(PANELS).map(|panels| Figure {
            title: names(panels).join(" and "),
            caption: String::new(),
            panels: panels.to_vec(),
        });
        let svgs: String = figures.map(|figure| figure.to_svg()).collect();
        let caption = format!(
            "Cumulative distributions over {}: the height of a curve is the share of them with a distance of at most the value \
             below it. The further left, the more alike; a long run to the right shows configurations that differ much.",
            counted(self.configurations.len(), "configuration")
        );
        sections::figure("figures", &svgs, &caption)
    }

    /// Every configuration, or the worst of them, the worst first.
    fn list(&self) -> String {
        let Some(first) = self.measures.first() else {
            return sections::missing();
        };
        let mut order: Vec<usize> = (0..self.configurations.len()).collect();
        order.sort_by(|&a, &b| first.values[b].total_cmp(&first.values[a]));
        order.truncate(LISTED);
        let decimals: Vec<usize> = (self.measures.iter())
            .map(|measure| column_decimals([measure.median]) + 1)
            .collect();
        let row = |&k: &usize| {
            let (name, command) = &self.configurations[k];
            let cells: String = (self.measures.iter().zip(&decimals))
                .map(|(measure, &decimals)| {
                    format!("<td>{}</td>", fixed(measure.values[k], decimals))
                })
                .collect();
            format!(
                "<tr><th scope=\"row\">{}</th><td>{}</td>{cells}</tr>",
                escape(name),
                escape(&command_text(command, &self.motors))
            )
        };
        let rows: String = order.iter().map(row).collect();
        let heads: String = (self.measures.iter())
            .map(|measure| format!("<th scope=\"col\">{}</th>", escape(&measure.title())))
            .collect();
        let left_out = match self.configurations.len() - order.len() {
            0 => String::new(),
            more => format!("; {more} better ones are left out, and are in the results as JSON"),
        };
        format!(
            "<div class=\"listed\"><table><thead><tr><th scope=\"col\">Configuration</th><th scope=\"col\">Condition</th>{heads}\
             </tr></thead><tbody>{rows}</tbody></table></div><p class=\"note\">The worst first, by {}{left_out}.</p>",
            escape(&first.name)
        )
    }
}
