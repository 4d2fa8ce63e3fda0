//! `tdcr calibrate --priors`: what is known of unknowns before a fit, from a file.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::calibrate::{example, excerpt, on, same};
use crate::{refuse, succeed_json, text};

/// A few rows of the example, fitted with priors.
struct Case {
    folder: tempfile::TempDir,
    data: PathBuf,
    robot: PathBuf,
    columns: PathBuf,
}

impl Case {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let data = excerpt(folder.path(), 40, same);
        Self {
            data,
            robot: example("robot.toml"),
            columns: example("columns.toml"),
            folder,
        }
    }

    fn priors(&self, content: &str) -> PathBuf {
        let file = self.folder.path().join("priors.toml");
        fs::write(&file, content).unwrap();
        file
    }

    fn options<'a>(&'a self, fit: &'a str, priors: &'a Path) -> Vec<&'a str> {
        let on = on(&self.data, &self.robot, &self.columns);
        [&on[..], &["--fit", fit, "--priors", text(priors)]].concat()
    }

    fn found(&self, priors: &str) -> Value {
        succeed_json(&self.options("stiffness,pretension", &self.priors(priors)))
    }

    fn refused(&self, fit: &str, priors: &str, expected: &str) {
        let file = self.priors(priors);
        refuse(&self.options(fit, &file), 1, expected);
    }
}

/// An unknown's value and interval.
fn unknown(found: &Value, name: &str) -> [f64; 3] {
    let mut all = found["parameters"].as_array().unwrap().iter();
    let one = all.find(|parameter| parameter["name"] == name).unwrap();
    [&one["value"], &one["interval"][0], &one["interval"][1]].map(|x| x.as_f64().unwrap())
}

/// A sure prior keeps an unknown at its mean, an unsure one leaves it to the recording, and no bound is passed, by intervals neither.
#[test]
fn priors_and_bounds_hold_as_they_say() {
    let case = Case::new();
    let [first, second] = [0, 1].map(|m| format!("bending stiffness factor of module {m}"));
    let free = case.found("");
    let [value, low, high] = unknown(&free, &first);
    // What a file says that says nothing new changes nothing.
    let same = case.found("[stiffness]\nspread = 0.2\nvalue = 1.0\nunit = \"\"\n");
    assert_eq!(free, same);
    let sure = case.found(&format!("[{first:?}]\nvalue = 1.3\nspread = 1e-3\n"));
    let [kept, kept_low, kept_high] = unknown(&sure, &first);
    assert!(
        (kept - 1.3).abs() < 0.01 && (value - 1.3).abs() > 0.05,
        "{kept} {value}"
    );
    assert!(kept_high - kept_low < 0.01);
    let unsure = case.found("[stiffness]\nspread = 2.0\n");
    let [_, wide_low, wide_high] = unknown(&unsure, &first);
    assert!(wide_high - wide_low > high - low, "{wide_low} {wide_high}");
    // The unknown's own entry goes before its group's.
    let both = format!("[stiffness]\nspread = 1e-3\n\n[{second:?}]\nspread = 0.2\n");
    let both = case.found(&both);
    assert!((unknown(&both, &first)[0] - 1.0).abs() < 0.01);
    assert!((unknown(&both, &second)[0] - 1.0).abs() > 0.02);
    let bound = if value > 1.0 {
        [0.9, 1.01]
    } else {
        [0.99, 1.1]
    };
    let stopped = case.found(&format!("[{first:?}]\nbounds = {bound:?}\n"));
    let [at, low, high] = unknown(&stopped, &first);
    let distance = bound.map(|end| (end - at).abs());
    assert!(
        distance[0].min(distance[1]) < 1e-9,
        "{at}, not bounded {value}"
    );
    assert!(bound[0] <= low && high <= bound[1], "{low} {high}");
}

#[test]
fn priors_that_cannot_be_are_refused_with_file_and_key() {
    let case = Case::new();
    let stiffness = |content: &str, expected: &str| {
        let content = format!("[stiffness]\n{content}\n");
        case.refused("stiffness", &content, &format!("priors.toml: {expected}"));
    };
    stiffness(
        "spread = nan",
        "stiffness.spread: NaN is no spread; expected",
    );
    stiffness("spread = 0", "stiffness.spread: 0 is no spread; expected");
    stiffness(
        "value = -1.0",
        "stiffness.value: -1 cannot be its value; expected a finite number above 0",
    );
    stiffness(
        "bounds = [2.0, 1.0]",
        "stiffness.bounds: [2, 1] are no bounds; expected the lower",
    );
    stiffness(
        "bounds = [-1.0, 1.5]",
        "stiffness.bounds: [-1, 1.5] are no bounds",
    );
    stiffness(
        "bounds = [0.5, nan]",
        "stiffness.bounds: [0.5, NaN] are no bounds",
    );
    stiffness(
        "bounds = [2.0, 3.0]",
        "stiffness.bounds: 1, where the fit of `bending stiffness factor of module 0` starts, is not within [2, 3]",
    );
    case.refused(
        "pretension",
        "[\"offset of servo 2\"]\nspread = 1.0\nunit = \"mm\"\n",
        "priors.toml: \"offset of servo 2\".unit: \"mm\" is not its unit, which is \"m\"",
    );
    case.refused(
        "pretension,lag",
        "[mass]\nspread = 1.0\n",
        "priors.toml: mass: nothing of this name is fitted; expected one of pretension, lag, offset of servo 1, offset of servo 2,",
    );
    case.refused(
        "base_pose",
        "[base_pose]\nspread = 1.0\n",
        "priors.toml: base_pose: its unknowns have no common unit",
    );
    case.refused(
        "none",
        "[mass]\nspread = 1.0\n",
        "priors.toml: mass: nothing is fitted",
    );
    case.refused(
        "stiffness",
        "[stiffness]\nsigma = 1.0\n",
        "unknown field `sigma`",
    );
    case.refused("stiffness", "stiffness = 0.1\n", "priors.toml: ");
    let nowhere = case.folder.path().join("nowhere.toml");
    refuse(&case.options("stiffness", &nowhere), 1, "nowhere.toml");
}
