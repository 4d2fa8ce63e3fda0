//! Training that is left alone: its log, presets, ends before the last step, and kills.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::{
    TINY_NETWORK, TINY_SIZE, collect_small, refuse, stderr, succeed, tdcr, text, train_tiny,
};

/// Kills of a training run, at moments spread over it.
const KILLS: u32 = 6;

/// Runs of it that may come to their end instead, before the test gives up.
const ATTEMPTS: u32 = 10 * KILLS;

fn train(data: &Path, run: &Path) -> Command {
    let length = ["--steps", "133", "--validate-every", "16", "--quiet"];
    let places = ["--data", text(data), "--out", text(run)];
    let mut command = tdcr(&[&TINY_SIZE[..], &length, &places].concat());
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Model, state and log of a run, and the steps of its events.
fn results(run: &Path) -> ([Vec<u8>; 3], Vec<u64>) {
    let files = ["model.safetensors", "state.safetensors", "log.csv"]
        .map(|file| fs::read(run.join(file)).unwrap());
    (files, event_steps(run))
}

/// Steps of the records of the event file. Checksums are left to the Python tests.
fn event_steps(run: &Path) -> Vec<u64> {
    let bytes = fs::read(run.join("events.out.tfevents.tdcr")).unwrap();
    let (mut rest, mut steps) = (&bytes[..], vec![]);
    while !rest.is_empty() {
        let length = u64::from_le_bytes(rest[..8].try_into().unwrap()) as usize;
        let event = &rest[12..12 + length];
        // Field 1 is eight bytes, field 2 the step, of at most 14 bits here.
        assert_eq!((event[0], event[9]), (0x09, 0x10));
        let high = (event[10] >> 7) * event[11];
        steps.push(u64::from(event[10] & 0x7f) + (u64::from(high) << 7));
        rest = &rest[length + 16..];
    }
    steps
}

/// Steps of the lines of the log.
fn logged_steps(csv: &[u8]) -> Vec<u64> {
    let lines = std::str::from_utf8(csv).unwrap().lines().skip(1);
    let step = |line: &str| line.split(',').next().unwrap().parse().unwrap();
    lines.map(step).collect()
}

#[test]
fn training_that_is_killed_at_any_moment_ends_as_if_it_had_not_been() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    collect_small(&data, &[]);
    let whole = folder.path().join("whole");
    let began = Instant::now();
    assert!(train(&data, &whole).status().unwrap().success());
    let span = began.elapsed();
    let expected = results(&whole);
    let steps = logged_steps(&expected.0[2]);
    assert_eq!([&[0], &steps[..]].concat(), expected.1);
    let due = |step: &u64| step.is_multiple_of(10) || step.is_multiple_of(16) || *step == 133;
    assert!(steps.into_iter().eq((1..=133).filter(due)));

    let mut run = folder.path().join("killed0");
    let mut kills = 0;
    for attempt in 1..=ATTEMPTS {
        let mut child = train(&data, &run).spawn().unwrap();
        // The golden ratio's multiples spread the moments evenly over a run.
        let share = (f64::from(attempt) * 0.618_034).fract();
        sleep(span.mul_f64(share).max(Duration::from_millis(5)));
        child.kill().unwrap();
        let finished = child.wait().unwrap().success();
        kills += u32::from(!finished);
        if !finished && kills == KILLS {
            assert!(train(&data, &run).status().unwrap().success());
        }
        if finished || kills == KILLS {
            assert!(results(&run) == expected, "{run:?} after {kills} kills");
            run = folder.path().join(format!("killed{attempt}"));
        }
        if kills == KILLS {
            return;
        }
    }
    panic!("only {kills} of {ATTEMPTS} attempts were killed before their end");
}

#[test]
fn what_was_logged_after_the_state_is_dropped_and_what_is_lost_written_again() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    train_tiny(&data, &run, &[]);
    let expected = results(&run);
    let log = |name: &str| run.join(name);
    let again = || {
        train_tiny(&data, &run, &[]);
        assert!(results(&run) == expected);
    };
    fs::write(log("log.csv"), "step,loss\n10,1\n50,2\n6").unwrap();
    let events = fs::read(log("events.out.tfevents.tdcr")).unwrap();
    fs::write(log("events.out.tfevents.tdcr"), &events[..events.len() - 3]).unwrap();
    again();
    fs::remove_file(log("log.csv")).unwrap();
    fs::remove_file(log("events.out.tfevents.tdcr")).unwrap();
    again();
}

#[test]
fn divergence_names_the_last_good_state_and_what_to_do_and_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    let places = ["--data", text(&data), "--out", text(&run)];
    let rate = ["--learning-rate", "200", "--warmup", "399"];
    let length = ["--steps", "4000", "--validate-every", "10"];
    let arguments = [&TINY_SIZE[..], &places, &rate, &length].concat();
    let output = tdcr(&arguments).output().unwrap();
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let state = run.join("state.safetensors");
    assert!(said.contains("training diverged at step"), "{said}");
    assert!(said.contains("lower --learning-rate than 200"), "{said}");
    let place = format!(", in {};", state.display());
    let (before, _) = said.split_once(&place).unwrap();
    let (_, step) = before
        .rsplit_once("the last good state is of step ")
        .unwrap();
    let step: u64 = step.parse().unwrap();
    // Every validated step is saved, but for those of the spike.
    let at = said.split_once("diverged at step ").unwrap().1;
    let at: u64 = at.split_once(':').unwrap().0.parse().unwrap();
    assert!((at - 20..=at - 10).contains(&step), "{said}");
    let bytes = fs::read(&state).unwrap();
    refuse(&arguments, 1, &format!("diverged at step {at}:"));
    assert!(fs::read(&state).unwrap() == bytes);

    // The command that it names goes on, here at a rate that is low enough.
    let model = run.join("model.safetensors");
    let named = format!(
        "tdcr train --init {} --learning-rate 6.7e1 --out NEW",
        model.display()
    );
    assert!(said.contains(&named), "{said}");
    let new = folder.path().join("new");
    let places = ["--data", text(&data), "--out", text(&new)];
    let lower = ["--init", text(&model), "--learning-rate", "1e-4"];
    let length = ["--steps", "20", "--validate-every", "10"];
    succeed(&[&TINY_SIZE[..], &places, &lower, &length].concat());
}

#[test]
fn a_run_out_of_patience_ends_early() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    let options = [
        "--patience",
        "1",
        "--steps",
        "4000",
        "--validate-every",
        "1",
    ];
    let places = ["--data", text(&data), "--out", text(&run)];
    let arguments = [&TINY_SIZE[..], &places, &options].concat();
    let ended = crate::succeed_json(&arguments);
    let steps = ended["steps"].as_u64().unwrap();
    assert!(steps < 4000);
    assert_eq!(ended["best_step"].as_u64().unwrap() + 1, steps);
    assert_eq!(crate::succeed_json(&arguments), ended);
    let other = folder.path().join("other");
    let other = ["--data", text(&data), "--out", text(&other)];
    refuse(
        &[&TINY_NETWORK[..], &other, &["--patience", "0"]].concat(),
        1,
        "patience is 0, expected at least 1",
    );
}

#[test]
fn more_points_than_clouds_have_are_said_to_be_cut_where_they_were_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    collect_small(&data, &[]);
    let said = |run: &str, options: &[&str]| {
        let run = folder.path().join(run);
        let arguments = [&TINY_NETWORK[..], options, &["--out", text(&run)]].concat();
        let output = tdcr(&arguments).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    };
    let set = ["--data", text(&data)];
    let cut = "--points 401 is more than the 400 points of a cloud: every step takes all 400";
    let many = said("many", &[&set[..], &["--points", "401"]].concat());
    assert!(many.contains(cut), "{many}");
    for points in [&["--points", "400"][..], &["--preset", "paper"]] {
        let enough = said(points[1], &[&set[..], points].concat());
        assert!(!enough.contains("WARN"), "{enough}");
    }
    let stream = ["--stream", "2m", "--stream-points", "400", "--window", "4"];
    let streamed = said("streamed", &[&stream[..], &["--points", "401"]].concat());
    assert!(streamed.contains(cut), "{streamed}");
}

#[test]
fn presets_are_explained_and_what_is_asked_for_goes_before_them() {
    let help = succeed(&["train", "--help"]);
    for expected in [
        "[default: quick]",
        "the authors' settings",
        "[default: quick 96, laptop 128, paper 512]",
        "[default: quick 5500, laptop 25000, paper 500 epochs]",
        "[default: quick muon, laptop muon, paper adamw]",
        "[default: quick 128; laptop 128; paper 8, hybrid 32]",
        "[default: quick 0.02; laptop 0.02; paper 0.0003, hybrid 0.0008]",
        "[default: quick no, laptop no, paper yes]",
        "[default: quick residual, laptop residual, paper pvcnn]",
    ] {
        assert!(help.contains(expected), "{expected} is not in\n{help}");
    }
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    // 16 training clouds in batches of 8: an epoch is two steps, and a cloud has 400 points of the 20,000.
    let options = [
        "--preset",
        "paper",
        "--width",
        "8",
        "--depth",
        "2",
        "--patience",
        "1",
    ];
    let small = ["--embedding", "8", "--validate-every", "400"];
    let places = ["--data", text(&data), "--out", text(&run)];
    let trained = crate::succeed_json(&[&["train"], &options[..], &small, &places].concat());
    assert!(trained["steps"].as_u64().unwrap() <= 1000);
    let state = fs::read(run.join("state.safetensors")).unwrap();
    let header = String::from_utf8_lossy(&state);
    for expected in [
        r#"\"steps\":1000,"#,
        r#"\"clouds\":8,"#,
        r#"\"points\":400,"#,
        r#"\"learning_rate\":0.0003,"#,
        r#"\"warmup_steps\":100,"#,
        r#"\"width\":8"#,
        r#"\"procedure\":\"authors\""#,
        r#"\"channels\":\"xyz-rgb\""#,
    ] {
        assert!(header.contains(expected), "{expected}");
    }
    let plain = folder.path().join("plain");
    let places = ["--data", text(&data), "--out", text(&plain)];
    succeed(&[&["train", "--no-colors"], &options[..], &small, &places].concat());
    let state = fs::read(plain.join("state.safetensors")).unwrap();
    assert!(String::from_utf8_lossy(&state).contains(r#"\"channels\":\"xyz\""#));
    // Their Hybrid, and a batch that their set does not fill.
    let hybrid = ["train", "--preset", "paper", "--net", "hybrid"];
    let never = folder.path().join("never");
    let places = ["--data", text(&data), "--out", text(&never)];
    let elsewhere = "train it in PyTorch, by `python -m tdcr.torch.train` with the same options";
    refuse(&[&hybrid[..], &places].concat(), 1, elsewhere);
    let residual = ["--layers", "residual"];
    let few = "clouds is 32, expected at most the 16 clouds of the training set";
    refuse(&[&hybrid[..], &residual, &places].concat(), 1, few);
    refuse(
        &[&["train", "--layers", "pvcnn"][..], &places].concat(),
        1,
        "--layers is of --net hybrid, the network is an mlp",
    );
    refuse(
        &[
            "train",
            "--preset",
            "paper",
            "--stream",
            "2m",
            "--out",
            "/tmp/never",
        ],
        1,
        "preset paper takes 500 epochs of a data set, and a stream has no end; say --steps N",
    );
}
