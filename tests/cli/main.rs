//! The `tdcr` binary as a user meets it: what it prints, what it says to wrong input, how it resumes
//! interrupted work.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod calibrate;
mod calibrate_cameras;
mod calibrate_clouds;
mod calibrate_priors;
mod calibrate_tentacle;
mod calibrate_wild;
mod capture;
mod capture_given;
mod capture_payloads;
mod collect_scene;
mod colors;
mod compare;
mod contact;
mod data;
mod deploy;
mod disks;
mod distill;
mod end_to_end;
mod eval;
mod export;
mod extend;
mod files;
mod foreign_data;
mod initial;
mod lerobot;
mod log;
mod methods;
mod names;
mod new;
mod notes;
mod output;
mod parts;
mod picture;
mod plan;
mod predict;
mod python_options;
mod reach;
mod refusals;
mod release;
mod render;
mod resume;
mod rig_scene;
mod servo_sim;
mod settle;
mod settle_path;
mod signals;
mod simulate;
mod statics;
mod study;
mod study_outputs;
mod study_scene;
mod symmetry;
mod tables;
mod track;
mod training;
mod units;
mod view;
mod view_overlays;
mod view_rig;

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// A command of 2m (m).
const COMMAND: &str = "0.034,0.007,0.001,0.026,0.015,0.019";

/// The binary, ready to be given arguments.
fn tdcr(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tdcr"));
    command.args(arguments);
    command
}

/// Runs the binary; it must succeed. Returns its stdout.
fn succeed(arguments: &[&str]) -> String {
    let output = tdcr(arguments).output().unwrap();
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        stderr(&output)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// Runs the binary with `--json`; it must succeed. Returns the parsed result.
fn succeed_json(arguments: &[&str]) -> Value {
    let text = succeed(&[arguments, &["--json", "--quiet"]].concat());
    serde_json::from_str(&text).unwrap()
}

/// Runs the binary; it must fail with `status` and say `expected` on stderr, and nothing on stdout.
fn refuse(arguments: &[&str], status: i32, expected: &str) {
    let output = tdcr(arguments).output().unwrap();
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
    assert!(
        said.contains(expected),
        "{arguments:?} said\n{said}\nnot\n{expected}"
    );
    assert!(!said.contains("panicked"), "{said}");
    assert!(output.stdout.is_empty());
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A path as an argument.
fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Options of a data set that is made in a moment.
const SMALL_SET: [&str; 5] = ["collect", "--samples", "20", "--points", "400"];

/// Options of a network of a moment's training.
const TINY_SIZE: [&str; 9] = [
    "train",
    "--width",
    "16",
    "--depth",
    "2",
    "--embedding",
    "16",
    "--clouds",
    "8",
];

/// The same, trained in a moment.
const TINY_NETWORK: [&str; 13] = {
    let [train, width, w, depth, d, embedding, e, clouds, c] = TINY_SIZE;
    let (steps, every) = ("--steps", "--validate-every");
    [
        train, width, w, depth, d, embedding, e, clouds, c, steps, "40", every, "20",
    ]
};

/// Keys of the mean scores.
const SCORES: [&str; 12] = [
    "cd",
    "cd_floor",
    "cd_nearest",
    "cd_mean",
    "emd",
    "emd_floor",
    "emd_nearest",
    "emd_mean",
    "emd_squared",
    "emd_squared_floor",
    "emd_squared_nearest",
    "emd_squared_mean",
];

/// Collects a small data set of robot 2m into `folder`, with more options.
fn collect_small(folder: &Path, options: &[&str]) -> Value {
    succeed_json(&[&SMALL_SET[..], &["--out", text(folder)], options].concat())
}

/// Arguments that score `model` on a small data set, with as many points as its clouds have.
fn eval_small<'a>(model: &'a str, data: &'a Path) -> [&'a str; 9] {
    let (points, few) = ("--points", "--emd-points");
    [
        "eval",
        "--model",
        model,
        "--data",
        text(data),
        points,
        "400",
        few,
        "100",
    ]
}

/// Trains a tiny network on `data` in the folder `run`, with more options.
fn train_tiny(data: &Path, run: &Path, options: &[&str]) -> Value {
    succeed_json(
        &[
            &TINY_NETWORK[..],
            &["--data", text(data), "--out", text(run)],
            options,
        ]
        .concat(),
    )
}
