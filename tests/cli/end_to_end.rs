//! The stages, one after the other.

use std::path::Path;
use std::process::Stdio;

use crate::{
    COMMAND, SCORES, collect_small, eval_small, succeed, succeed_json, tdcr, text, train_tiny,
};

#[test]
fn every_command_explains_itself() {
    let overview = succeed(&["--help"]);
    let commands = [
        "settle",
        "simulate",
        "collect",
        "data",
        "train",
        "distill",
        "predict",
        "eval",
        "demo",
        "export",
        "servo-sim",
    ];
    for command in commands {
        assert!(overview.contains(command));
        let help = succeed(&[command, "--help"]);
        assert!(help.contains("Usage:") && help.contains("--json"), "{help}");
    }
    // With the commit where the build was told of one.
    let version = concat!("tdcr ", env!("TDCR_VERSION_LINE"));
    assert_eq!(succeed(&["--version"]).trim(), version);
    assert!(version.contains(env!("CARGO_PKG_VERSION")));
}

/// A table of symbols would make what a user installs a quarter larger.
#[cfg(all(
    target_os = "linux",
    target_pointer_width = "64",
    not(debug_assertions)
))]
#[test]
fn a_release_build_has_no_symbols() {
    // Types of an ELF file's sections.
    const PROGRAM: usize = 1;
    const SYMBOLS: usize = 2;
    let file = std::fs::read(env!("CARGO_BIN_EXE_tdcr")).unwrap();
    let number = |at: usize, bytes: usize| {
        let digits = file[at..at + bytes].iter().rev();
        digits.fold(0, |sum, &digit| 256 * sum + usize::from(digit))
    };
    // The sections' headers: where they begin, how long one is, how many there are. A type is 4 bytes into its own.
    let (begin, length, count) = (number(0x28, 8), number(0x3a, 2), number(0x3c, 2));
    let types: Vec<_> = (0..count)
        .map(|k| number(begin + k * length + 4, 4))
        .collect();
    assert!(types.contains(&PROGRAM), "{types:?}");
    assert!(!types.contains(&SYMBOLS), "{types:?}");
}

#[test]
fn settle_surveys_random_commands_on_one_thread() {
    let survey = succeed_json(&["settle", "--robot", "3m", "--random", "300", "--seed", "5"]);
    assert_eq!(survey["count"], 300);
    assert_eq!(survey["converged"], 300);
    assert!(survey["max_residual"].as_f64().unwrap() <= 1e-9);
    let [median, p99] = ["median_us", "p99_us"].map(|key| survey[key].as_f64().unwrap());
    assert!(0.0 < median && median <= p99);
    // The same seed draws the same commands.
    let again = succeed_json(&["settle", "--robot", "3m", "--random", "300", "--seed", "5"]);
    assert_eq!(again["max_residual"], survey["max_residual"]);
}

#[test]
fn the_robot_file_with_every_field_settles() {
    let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/every-field.toml");
    let command = "0.02,0.02,0.02,0.11,1.0";
    let settled = succeed_json(&["settle", "--robot", robot, "--command", command]);
    assert_eq!(settled["converged"], true);
    assert!((settled["tendon_lengths"][3].as_f64().unwrap() - 0.11).abs() < 1e-9);
    assert_eq!(settled["tendon_tensions"][4], 1.0);
}

#[test]
fn settle_prints_the_equilibrium_as_json() {
    let settled = succeed_json(&[
        "settle",
        "--robot",
        "2m",
        "--command",
        COMMAND,
        "--payload",
        "0.02",
    ]);
    let rows = |key: &str| settled[key].as_array().unwrap().clone();
    assert_eq!(
        (rows("positions").len(), rows("orientations").len()),
        (10, 10)
    );
    assert_eq!(
        (rows("tendon_lengths").len(), rows("tendon_tensions").len()),
        (6, 6)
    );
    for quaternion in rows("orientations") {
        let parts = quaternion.as_array().unwrap();
        let norm: f64 = parts.iter().map(|x| x.as_f64().unwrap().powi(2)).sum();
        assert!((norm - 1.0).abs() < 1e-12);
    }
    assert!(settled["residual"].as_f64().unwrap() <= 1e-9);
    assert!(settled["smallest_stiffness"].as_f64().unwrap() > 0.0);
    assert!(settled["iterations"].as_u64().unwrap() > 0);
    assert_eq!(settled["converged"], true);
    let unloaded = succeed_json(&["settle", "--command", COMMAND]);
    let height = |value: &serde_json::Value| value["positions"][9][2].as_f64().unwrap();
    assert!(height(&settled) < height(&unloaded));
}

#[test]
fn settle_takes_a_robot_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("one-module.toml");
    std::fs::write(&file, include_str!("one-module.toml")).unwrap();
    let settled = succeed_json(&[
        "settle",
        "--robot",
        text(&file),
        "--command",
        "0.03,0.01,0.01",
    ]);
    assert_eq!(settled["positions"].as_array().unwrap().len(), 4);
    assert_eq!(settled["converged"], true);
}

#[test]
fn settle_prints_a_table_for_people() {
    let table = succeed(&["settle", "--command", COMMAND]);
    assert!(
        table.contains("x (m)") && table.contains("tension (N)") && table.contains("settled in")
    );
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let mut child = tdcr(&["settle", "--command", COMMAND])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    assert!(
        output.stderr.is_empty(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Sizes of a context network that is trained in a moment.
const TINY_CONTEXT: [&str; 10] = [
    "--net",
    "hybrid",
    "--channels",
    "8,8,8",
    "--resolutions",
    "4,3,2",
    "--blocks",
    "1",
    "--context",
    "4",
];

#[test]
fn a_hybrid_network_is_trained_and_predicts() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    let parameters = |run: &Path, options: &[&str]| {
        let trained = train_tiny(&data, run, options);
        trained["parameters"].as_u64().unwrap()
    };
    let mlp = parameters(&folder.path().join("mlp"), &[]);
    assert!(parameters(&run, &TINY_CONTEXT) > 2 * mlp);
    let (model, cloud) = (
        run.join("model.safetensors"),
        folder.path().join("cloud.ply"),
    );
    let files = ["--model", text(&model), "--out", text(&cloud)];
    let options = ["predict", "--command", COMMAND, "--points", "300"];
    let predicted = succeed_json(&[&options[..], &files].concat());
    assert_eq!(predicted["points"], 300);
}

#[test]
fn data_set_network_prediction_and_scores_follow_one_from_another() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    let collected = collect_small(&data, &[]);
    assert_eq!(
        [&collected["train"], &collected["val"], &collected["test"]],
        [16, 2, 2]
    );
    let trained = train_tiny(&data, &run, &[]);
    let model = trained["model"].as_str().unwrap();
    assert!(trained["validation_cd"].as_f64().unwrap() > 0.0);
    assert!(trained["best_step"].as_u64().unwrap() <= 40);

    let cloud = folder.path().join("cloud.ply");
    let predicted = succeed_json(&[
        "predict",
        "--model",
        model,
        "--command",
        COMMAND,
        "--points",
        "300",
        "--out",
        text(&cloud),
    ]);
    assert_eq!(predicted["points"], 300);
    let ply = std::fs::read(&cloud).unwrap();
    assert!(ply.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
    assert!(String::from_utf8_lossy(&ply).contains("element vertex 300\n"));

    let scores = succeed_json(&eval_small(model, &data));
    for key in SCORES {
        assert!(scores[key].as_f64().unwrap() > 0.0, "{key}");
    }
    assert!(scores["cd_floor"].as_f64() < scores["cd_nearest"].as_f64());
    assert!(scores["cd_floor"].as_f64() < scores["cd"].as_f64());
    assert_eq!(scores["tests"], 2);
}

#[test]
fn the_same_seed_gives_the_same_files_on_one_thread_and_on_two() {
    let folder = tempfile::tempdir().unwrap();
    let made = ["1", "2"].map(|threads| {
        let (data, run) = (
            folder.path().join(threads),
            folder.path().join(format!("run{threads}")),
        );
        collect_small(&data, &["--threads", threads]);
        train_tiny(&data, &run, &["--threads", threads]);
        let shard = std::fs::read(data.join("train/shard-00000.h5")).unwrap();
        (shard, std::fs::read(run.join("model.safetensors")).unwrap())
    });
    assert!(made[0] == made[1]);
}

#[test]
fn what_a_network_is_compared_with_does_not_depend_on_the_network() {
    let folder = tempfile::tempdir().unwrap();
    let [other, data] = ["other", "data"].map(|name| folder.path().join(name));
    collect_small(&other, &["--seed", "1"]);
    collect_small(&data, &["--seed", "2"]);
    let scores = [&other, &data].map(|trained_on| {
        let run = trained_on.with_extension("run");
        let trained = train_tiny(trained_on, &run, &[]);
        let model = trained["model"].as_str().unwrap();
        let points = ["--points", "400", "--emd-points", "100"];
        succeed_json(
            &[
                &["eval", "--model", model, "--data", text(&data)],
                &points[..],
            ]
            .concat(),
        )
    });
    for key in SCORES {
        let of_network = ["cd", "emd", "emd_squared"].contains(&key);
        let differ = scores[0][key] != scores[1][key];
        assert_eq!(differ, of_network, "{key}");
    }
}

#[test]
fn a_network_of_payload_data_predicts_and_scores_under_payloads() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &["--payload", "0:0.03", "--design", "sobol"]);
    let trained = train_tiny(&data, &run, &[]);
    let model = trained["model"].as_str().unwrap();
    let cloud = folder.path().join("cloud.ply");
    let predict = |payload: &str| {
        let arguments = ["predict", "--model", model, "--command", COMMAND];
        let more = ["--payload", payload, "--out", text(&cloud)];
        let predicted = succeed_json(&[&arguments[..], &more].concat());
        predicted["max"].clone()
    };
    assert_ne!(predict("0"), predict("0.03"));
    let points = ["--points", "400", "--emd-points", "100"];
    let scores = succeed_json(
        &[
            &["eval", "--model", model, "--data", text(&data)],
            &points[..],
        ]
        .concat(),
    );
    assert!(scores["cd_floor"].as_f64() < scores["cd_nearest"].as_f64());
}

#[test]
fn a_network_trains_on_a_stream_with_and_without_a_fixed_validation_set() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    collect_small(&data, &[]);
    let train = |run: &str, options: &[&str]| {
        let run = folder.path().join(run);
        let stream = ["--stream", "2m", "--stream-points", "300", "--window", "4"];
        let out = ["--out", text(&run)];
        let arguments = [&crate::TINY_NETWORK[..], &stream, &out, options].concat();
        let trained = succeed_json(&arguments);
        (
            trained["validation_cd"].as_f64().unwrap(),
            run.join("model.safetensors"),
        )
    };
    let fixed = train("fixed", &["--validation", text(&data), "--threads", "1"]);
    let again = train("again", &["--validation", text(&data), "--threads", "2"]);
    assert!(std::fs::read(&fixed.1).unwrap() == std::fs::read(again.1).unwrap());
    assert_ne!(train("own", &[]).0, fixed.0);
    let scored = ["eval", "--model", text(&fixed.1), "--data", text(&data)];
    let points = ["--points", "400", "--emd-points", "100"];
    assert_eq!(succeed_json(&[&scored[..], &points].concat())["tests"], 2);
}

#[test]
fn a_noisy_set_is_another_one_and_the_same_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let make = |name: &str, options: &[&str]| {
        let data = folder.path().join(name);
        collect_small(&data, options);
        std::fs::read(data.join("train/shard-00000.h5")).unwrap()
    };
    let truth = make("truth", &[]);
    let noisy = make("noisy", &["--noise", "d435", "--threads", "1"]);
    assert!(noisy != truth);
    assert!(noisy == make("again", &["--noise", "d435", "--threads", "2"]));
}
