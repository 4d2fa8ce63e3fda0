//! `tdcr calibrate` on the static poses of a soft tentacle: `examples/soromox_tentacle`, as its README has it.

use std::path::{Path, PathBuf};

use crate::calibrate::on;
use crate::{succeed_json, text};

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("examples/soromox_tentacle")
        .join(name)
}

#[test]
fn a_soft_tentacle_is_calibrated_to_13_mm_with_its_tendons_inside_its_skin() {
    let [robot, columns, data, priors] =
        ["robot.toml", "columns.toml", "poses.csv", "priors.toml"].map(example);
    let fit = [
        "--fit",
        "stiffness,hole_radius,rest_bend,mass,base_pose,marker_offset",
        "--loss",
        "1",
        "--priors",
        text(&priors),
    ];
    let found = succeed_json(&[&on(&data, &robot, &columns)[..], &fit].concat());
    let number = |key: &str| found[key].as_f64().unwrap();
    assert_eq!(found["rows"], 22);
    assert!((number("uncalibrated_rmse") - 37.14e-3).abs() < 0.1e-3);
    assert!(number("train_rmse") < 13e-3, "{}", number("train_rmse"));
    for parameter in found["parameters"].as_array().unwrap() {
        let name = parameter["name"].as_str().unwrap();
        let value = parameter["value"].as_f64().unwrap();
        if name.starts_with("hole radius") {
            assert!((0.6..2.7).contains(&value), "{name}: {value}");
        } else if name.starts_with("bending stiffness") {
            assert!((0.5..2.5).contains(&value), "{name}: {value}");
        }
    }
}
