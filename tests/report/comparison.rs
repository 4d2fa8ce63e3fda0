//! The page on two data sets beside each other.

use tdcr::report::{ComparisonPage, Measure, MotorGroup};
use tdcr::sim::cloud::PointCloud;

use crate::sample::example;
use crate::{assert_balanced, between};

fn page(names: [&str; 2], values: &[f64]) -> ComparisonPage {
    let measure = |name: &str, unit: &str| Measure {
        name: name.to_owned(),
        unit: unit.to_owned(),
        mean: 2.0,
        median: 1.5,
        p95: 4.25,
        worst: 5.0,
        values: values.to_vec(),
    };
    let mut shown = example("test 3, the worst", 0.4, 1.0, 0.5);
    shown.nearest = PointCloud::default();
    ComparisonPage {
        names: names.map(str::to_owned),
        headline: "Far apart.".to_owned(),
        measures: vec![
            measure("CD", "10⁻⁴ m²"),
            measure("EMD", "mm"),
            measure("Tip", "mm"),
        ],
        notes: vec!["Over all.".to_owned()],
        motors: MotorGroup::of(None, 6),
        configurations: (0..values.len())
            .map(|k| (format!("test {k}"), shown.command.clone()))
            .collect(),
        examples: vec![shown],
        summary: vec![("Seed".to_owned(), "0".to_owned())],
    }
}

#[test]
fn the_page_shows_both_clouds_and_all_distances_with_their_units() {
    let html = page(["seen", "simulated"], &[1.0, 5.0, 1.5, f64::NAN]).to_html();
    assert_balanced(&html);
    assert!(html.contains("<h1>seen beside simulated</h1>"));
    for (cloud, label) in [("truth", "seen"), ("prediction", "simulated")] {
        let input = format!("data-cloud=\"{cloud}\" checked>");
        assert!(
            between(&html, &input, "</label>").ends_with(label),
            "{label}"
        );
    }
    assert!(!html.contains("data-cloud=\"nearest\"") && !html.contains("raining"));
    // The table, the list and the axis.
    assert_eq!(html.matches("CD (10⁻⁴ m²)").count(), 3);
    assert!(html.contains("<td>2.0</td><td>1.5</td><td>4.2</td><td>5.0</td>"));
    assert_eq!(html.matches("<img ").count(), 3);
    assert_eq!(html.matches("<svg ").count(), 2);
    // The worst first; what is not known last or as such.
    let list = between(&html, "<div class=\"listed\">", "</table>");
    assert_eq!(list.matches("<tr>").count(), 5);
    let place = |name: &str| list.find(&format!(">{name}<")).unwrap();
    assert!(place("test 1") < place("test 2") && place("test 2") < place("test 0"));
    assert!(list.contains("not available"));
}

#[test]
fn names_are_escaped_and_a_page_of_nothing_is_one() {
    let evil = "</script><b a=\"'&{{viewer}}";
    let html = page([evil, "b"], &[1.0]).to_html();
    assert_balanced(&html);
    assert!(!html.contains(evil) && !html.contains("<b a"));
    assert_balanced(&ComparisonPage::default().to_html());
}
