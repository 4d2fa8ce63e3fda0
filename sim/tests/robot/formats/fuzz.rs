//! Whatever stands in a file: an answer, never a panic.

use proptest::prelude::*;
use tdcr_sim::formats::mjcf::{self, ExportOptions};
use tdcr_sim::formats::urdf;
use tdcr_sim::robot::Robot;

use super::random_robot;

/// Words that mean something to the readers.
const WORDS: [&str; 24] = [
    "\"",
    "<",
    "/>",
    "</body>",
    "<body>",
    "-",
    "0",
    "1e308",
    "-1e-308",
    "nan",
    "inf",
    " ",
    "quat",
    "fromto",
    "euler",
    "childclass",
    "class=\"visual\"",
    "hinge",
    "<default class=\"visual\">",
    "<tdcr>",
    "gear",
    "&#0;",
    "pos=\"\"",
    "payload",
];

/// Edits of a text: a place in it, as a share of its length, how many bytes go, and what comes.
fn edits() -> impl Strategy<Value = Vec<(f64, usize, &'static str)>> {
    let edit = (0.0..1.0, 0..12_usize, proptest::sample::select(&WORDS[..]));
    proptest::collection::vec(edit, 1..6)
}

fn edited(text: &str, edits: &[(f64, usize, &str)]) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for (share, removed, word) in edits {
        let start = (share * bytes.len() as f64) as usize;
        let end = (start + removed).min(bytes.len());
        bytes.splice(start..end, word.bytes());
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn a_mutated_model_is_read_or_refused(seed in 0..50_u64, edits in edits()) {
        let text = mjcf::export(random_robot(seed).spec(), &ExportOptions::default()).unwrap();
        match mjcf::import_text(&edited(&text, &edits)) {
            // What is read is a robot, and has a model of its own or is told why not.
            Ok(imported) => {
                let robot = Robot::new(imported.spec).unwrap();
                let _ = mjcf::export(robot.spec(), &ExportOptions::default());
            }
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn a_mutated_description_is_read_or_refused(seed in 0..20_u64, edits in edits()) {
        let text = urdf::export(random_robot(seed).spec()).unwrap();
        match urdf::import_text(&edited(&text, &edits)) {
            Ok(imported) => prop_assert!(Robot::new(imported.spec).is_ok()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn any_text_is_read_or_refused(text: String) {
        prop_assert!(mjcf::import_text(&text).is_err());
        prop_assert!(urdf::import_text(&text).is_err());
    }
}

#[test]
fn a_file_nested_without_end_is_refused() {
    let deep = format!("<mujoco><worldbody>{}", "<body>".repeat(200_000));
    let closed = format!("{deep}{}</worldbody></mujoco>", "</body>".repeat(200_000));
    for text in [deep, closed] {
        assert!(mjcf::import_text(&text).is_err());
    }
}

#[test]
fn nesting_and_attributes_beyond_bounds_are_refused_before_they_are_parsed() {
    // On a thread with the smallest stack that Rust gives by default.
    let answers = || {
        let nested = |tag: &str, depth: usize| {
            format!(
                "{}{}",
                format!("<{tag}>").repeat(depth),
                format!("</{tag}>").repeat(depth)
            )
        };
        let attributes: String = (0..60_000).map(|i| format!(" a{i}=\"0\"")).collect();
        let urdf = |within: &str| format!("<robot name=\"r\">{within}</robot>");
        let mjcf = |within: &str| format!("<mujoco><worldbody>{within}</worldbody></mujoco>");
        let wide = format!("<body{attributes}/>");
        [
            urdf::import_text(&urdf(&nested("link", 30_000))),
            urdf::import_text(&urdf(&wide)),
            mjcf::import_text(&mjcf(&nested("body", 30_000))),
            mjcf::import_text(&mjcf(&wide)),
        ]
        .map(|answer| answer.unwrap_err().to_string())
    };
    let start = std::time::Instant::now();
    let said = std::thread::spawn(answers).join().unwrap();
    let expected = [
        "nest more than 64",
        "60000 attributes",
        "nest more than 8000",
        "60000 attributes",
    ];
    for (said, expected) in said.iter().zip(expected) {
        assert!(said.contains(expected), "{said}\nnot\n{expected}");
    }
    assert!(start.elapsed().as_secs() < 5, "{:?}", start.elapsed());
}

#[test]
fn defaults_without_end_are_refused() {
    let joints = "<joint damping=\"1\"/>".repeat(50_000);
    let text = format!("<mujoco><default>{joints}</default><worldbody/></mujoco>");
    let said = mjcf::import_text(&text).unwrap_err().to_string();
    assert!(
        said.contains("the defaults have more than 4000 attributes"),
        "{said}"
    );
}
