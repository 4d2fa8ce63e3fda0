//! The report's page and contact sheet, from a report of made-up numbers.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod comparison;
mod sample;
mod sheet;

use sample::{example, full_report, method};
use std::sync::LazyLock;
use tdcr::report::{MotorGroup, PerTest, Report, Role, Score, Stage, Training};
use tdcr::sim::robot::CommandUnit;

static PAGE: LazyLock<String> = LazyLock::new(|| full_report().to_html());

/// Elements of HTML without an end tag.
const VOID: [&str; 4] = ["meta", "img", "input", "br"];

/// Panics unless each start tag has its end tag, properly nested.
fn assert_balanced(page: &str) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = page;
    while let Some((_, tail)) = rest.split_once('<') {
        let (tag, after) = tail.split_once('>').unwrap();
        rest = after;
        if tag.starts_with('!') || tag.ends_with('/') {
            continue;
        }
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "end tag");
            continue;
        }
        let name = tag.split_whitespace().next().unwrap();
        if name == "script" || name == "style" {
            rest = rest.split_once(&format!("</{name}>")).unwrap().1;
        } else if !VOID.contains(&name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "open at the end: {open:?}");
}

/// Decodes base64, by the position of each digit in the alphabet.
fn from_base64(text: &str) -> Vec<u8> {
    const ALPHABET: &str = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digits = text.bytes().filter_map(|b| ALPHABET.find(char::from(b)));
    let bits: Vec<u8> = digits
        .flat_map(|d| (0..6).rev().map(move |k| (d >> k & 1) as u8))
        .collect();
    bits.chunks_exact(8)
        .map(|byte| byte.iter().fold(0, |sum, bit| 2 * sum + bit))
        .collect()
}

/// What stands between `before` and `after`.
fn between<'a>(text: &'a str, before: &str, after: &str) -> &'a str {
    text.split_once(before)
        .unwrap()
        .1
        .split_once(after)
        .unwrap()
        .0
}

#[test]
fn the_page_loads_nothing_and_says_so() {
    // The name of a language, which nothing loads.
    let page = PAGE.replace(" xmlns=\"http://www.w3.org/2000/svg\"", "");
    for forbidden in [
        "http:", "https:", "@import", "url(", "<link", " src=\"/", "{{",
    ] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
    assert!(PAGE.contains("default-src 'none'"));
    assert_eq!(
        PAGE.matches(" src=\"").count(),
        PAGE.matches(" src=\"data:image/png;base64,").count()
    );
}

#[test]
fn the_page_is_well_formed_and_the_same_each_time() {
    assert_balanced(&PAGE);
    assert_eq!(*PAGE, full_report().to_html());
}

#[test]
fn eight_examples_fit_in_a_megabyte_and_a_half() {
    assert_eq!(full_report().examples.len(), 8);
    assert!(PAGE.len() < 1_500_000, "{} bytes", PAGE.len());
}

#[test]
fn scores_are_shown_in_their_units_and_relative_to_the_floor() {
    let row = |name: &str| -> Vec<String> {
        let cells = between(&PAGE, &format!("{name}</th>"), "</tr>");
        cells
            .split("</td>")
            .map(|cell| cell.replace("<td>", ""))
            .take(6)
            .collect()
    };
    assert_eq!(
        row("Network"),
        ["0.330", "12.2", "5.2", "2.2", "0.324", "4.7"]
    );
    assert_eq!(
        row("Sampling floor"),
        ["0.027", "1.0", "2.4", "1.0", "0.069", "1.0"]
    );
}

/// How a path of a colour is drawn.
const SOLID: &str = "stroke=\"{}\" stroke-width=\"1.8\"";
const DASHED: &str = "stroke=\"{}\" stroke-width=\"1.2\" stroke-dasharray=\"5 4\"";

/// The paths of a section that are drawn so.
fn paths<'a>(section: &'a str, stroke: &'a str) -> impl Iterator<Item = &'a str> {
    let paths = section.split("<path d=\"").skip(1);
    let ends = paths.filter_map(|path| path.split_once("\" "));
    ends.filter(move |(_, drawn)| drawn.split("/>").next() == Some(stroke))
        .map(|(path, _)| path)
}

#[test]
fn the_floor_of_every_test_command_is_drawn_beside_the_predictors() {
    let distribution = between(&PAGE, "Every test command</h2>", "</section>");
    for (name, stroke) in [
        ("Network", SOLID.replace("{}", "#d55e00")),
        ("Nearest training command", SOLID.replace("{}", "#a0558a")),
        ("Sampling floor", DASHED.replace("{}", "#8a929c")),
    ] {
        let paths = paths(distribution, &stroke);
        // In the legend, and as many corners as a curve has at most: a value of each of 500 test commands, thinned.
        let corners = paths.map(|path| path.matches(['M', 'L']).count());
        assert_eq!(corners.collect::<Vec<_>>(), [2, 250], "{name}");
        assert!(distribution.contains(&format!(">{name}</text>")), "{name}");
    }
    assert!(distribution.contains("CD (10⁻⁴\u{a0}m²)"));
}

#[test]
fn any_method_has_a_row_in_the_table_and_a_curve_of_its_own() {
    let mut report = full_report();
    let others = ["Bend", "Spline", "Guess", "Memory"];
    for (place, name) in others.into_iter().enumerate() {
        let score = Score {
            name: name.to_owned(),
            ..report.scores[1].clone()
        };
        report.scores.push(score);
        let values = vec![1e-5, 2e-5];
        let methods = &mut report.per_test.as_mut().unwrap().methods;
        methods.push(method(name, Role::Other(place), values));
    }
    let page = report.to_html();
    assert_balanced(&page);
    let distribution = between(&page, "Every test command</h2>", "</section>");
    let strokes = [
        (SOLID, "#009e73"),
        (SOLID, "#0072b2"),
        (SOLID, "#1c2128"),
        (DASHED, "#009e73"),
    ];
    for (name, (stroke, ink)) in others.iter().zip(strokes) {
        assert!(page.contains(&format!("<tr><th scope=\"row\">{name}</th>")));
        assert!(distribution.contains(&format!(">{name}</text>")), "{name}");
        // In the legend and in the plot.
        assert_eq!(
            paths(distribution, &stroke.replace("{}", ink)).count(),
            2,
            "{name}"
        );
    }
}

#[test]
fn a_page_without_training_and_stages_has_no_such_sections() {
    let headings = |page: &str| -> Vec<String> {
        let sections = page.split("<h2>").skip(1);
        sections
            .map(|s| s.split("</h2>").next().unwrap().to_owned())
            .collect()
    };
    let whole = headings(&PAGE);
    let scored = Report {
        training: None,
        stages: Vec::new(),
        ..full_report()
    };
    let page = scored.to_html();
    assert_balanced(&page);
    let left: Vec<String> = (whole.into_iter())
        .filter(|heading| heading != "Training" && heading != "Time per stage")
        .collect();
    assert_eq!(headings(&page), left);
    assert_eq!(left.len(), 6);
    assert!(!page.contains("not available"));
}

#[test]
fn an_example_says_its_command_and_payload_in_their_units() {
    let mut example = example("a", 0.3, 0.4, 1.0);
    example.command = vec![0.034, 0.007, 0.001, 0.0265];
    let group = |motors, unit| MotorGroup {
        name: String::new(),
        motors,
        unit,
    };
    let said = |example: &tdcr::report::Example, motors: &[MotorGroup]| {
        let page = Report {
            examples: vec![example.clone()],
            motors: motors.to_vec(),
            ..Report::default()
        }
        .to_html();
        between(&page, "<h3>a</h3><p>", "</p>").to_owned()
    };
    let metre = Some(CommandUnit::Metre);
    let modules = [group(0..3, metre), group(3..4, metre)];
    assert_eq!(
        said(&example, &modules),
        "Command (mm): 34.0, 7.0, 1.0 | 26.5"
    );
    example.payload = Some(0.02);
    assert_eq!(
        said(&example, &[group(0..4, None)]),
        "Command (motor units): 0.0340, 0.0070, 0.0010, 0.0265; payload (g): 20.0"
    );
    example.command = vec![2.3594, 0.0, 1.0, 10.0];
    assert_eq!(
        said(&example, &[group(0..4, Some(CommandUnit::Newton))]),
        "Command (N): 2.36, 0.00, 1.00, 10.00; payload (g): 20.0"
    );
}

#[test]
fn every_picture_and_chart_has_a_text_alternative() {
    assert_eq!(PAGE.matches("<img ").count(), 40);
    assert_eq!(PAGE.matches("alt=\"Test command ").count(), 40);
    // Beside the four plots of scores and training, those of errors over the commands: one, and the maps of each module.
    assert_eq!(PAGE.matches("<svg ").count(), 4 + 3);
    assert_eq!(PAGE.matches("role=\"img\" aria-label=\"").count(), 5 + 3);
}

#[test]
fn the_viewer_gets_the_points_of_the_clouds() {
    let json = between(&PAGE, "id=\"viewer-data\">", "</script>");
    let data: serde_json::Value = serde_json::from_str(json).unwrap();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let step = number(&data["step"]);
    assert!(step < 2e-5, "{step} m");
    let bytes = from_base64(data["examples"][0]["truth"].as_str().unwrap());
    assert_eq!(bytes.len(), 6 * 3000);
    let truth = &full_report().examples[0].truth;
    for (k, point) in bytes.chunks_exact(6).enumerate() {
        let original = truth.points[k * truth.len() / 3000];
        for axis in 0..3 {
            let q = u16::from_le_bytes([point[2 * axis], point[2 * axis + 1]]);
            let x = number(&data["origin"][axis]) + step * f64::from(q);
            assert!((x - f64::from(original[axis])).abs() <= 0.5 * step + 1e-12);
        }
    }
}

#[test]
fn text_is_escaped_wherever_it_stands() {
    let evil = "</script><b a=\"'&{{scores}}";
    let mut report = full_report();
    report.title = evil.to_owned();
    report.headline = evil.to_owned();
    report.summary = vec![(evil.to_owned(), evil.to_owned())];
    report.score_notes = vec![evil.to_owned()];
    report.scores[0].name = evil.to_owned();
    report.stages[0].name = evil.to_owned();
    report.examples.truncate(1);
    report.examples[0].label = evil.to_owned();
    let page = report.to_html();
    assert!(!page.contains("<b a"));
    assert!(page.contains("&lt;/script&gt;&lt;b a=&quot;&#39;&amp;{{scores}}"));
    assert_balanced(&page);
}

#[test]
fn an_empty_report_is_a_page_that_says_what_is_missing() {
    let page = Report::default().to_html();
    assert_balanced(&page);
    assert_eq!(page.matches("not available").count(), 4);
    assert!(!page.contains("<canvas"));
}

#[test]
fn numbers_that_are_not_finite_are_not_available() {
    let mut broken = example("broken", 0.0, 0.5, 1.0);
    broken.truth.points[0] = [f32::NAN, f32::INFINITY, 0.0];
    broken.prediction = Default::default();
    broken.command = vec![f64::NAN];
    (broken.cd, broken.cd_nearest) = (f64::NAN, f64::INFINITY);
    (broken.error, broken.uncertainty) = (vec![f64::NAN; 3], vec![f64::INFINITY, 1e-3]);
    broken.tip = Some(f64::NAN);
    let score = |cd, emd| Score {
        name: "n".to_owned(),
        cd,
        emd,
        emd_squared: emd,
    };
    let report = Report {
        scores: vec![score(f64::NAN, f64::INFINITY), score(1e-4, 1e-3)],
        floor: Some(score(0.0, f64::NAN)),
        training: Some(Training {
            loss_curve: vec![(0, f64::NAN), (1, -1.0), (2, 0.5), (3, f64::INFINITY)],
            validation_curve: vec![(0, f64::NAN)],
            validation_note: "On <few> points.".to_owned(),
        }),
        per_test: Some(PerTest {
            methods: vec![
                method("n", Role::Network, vec![f64::NAN, 0.0]),
                method("n", Role::Nearest, vec![]),
                method("n", Role::Floor, vec![f64::NAN, f64::INFINITY]),
            ],
            commands: vec![vec![f64::NAN], vec![]],
            apart: vec![f64::INFINITY, 0.1],
        }),
        stages: vec![
            Stage {
                name: "a".to_owned(),
                seconds: f64::NAN,
            },
            Stage {
                name: "b".to_owned(),
                seconds: 1.0,
            },
        ],
        examples: vec![broken],
        ..Report::default()
    };
    let page = report.to_html();
    assert_balanced(&page);
    let data = between(&page, "id=\"viewer-data\">", "</script>");
    assert!(serde_json::from_str::<serde_json::Value>(data).is_ok());
    // What remains without the packed points, the script and the pictures.
    let mut text = page
        .replace(data, "")
        .replace(between(&page, "<script>", "</script>"), "");
    for source in page.split("src=\"").skip(1) {
        text = text.replace(source.split('"').next().unwrap(), "");
    }
    assert!(!text.contains("NaN") && !text.contains("inf"));
    assert!(page.matches("not available").count() >= 8);
}
