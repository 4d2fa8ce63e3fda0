//! Data sets and runs that are asked for more, and folders that hold something of another origin.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use crate::{TINY_SIZE, collect_small, refuse, succeed, succeed_json, tdcr, text, train_tiny};

/// The files of a data set.
fn set_files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let names = [
        "meta.json",
        "global_motors_scope-all.json",
        "global_norm_scope-all_anchor-origin.json",
        "train/shard-00000.h5",
        "val/shard-00000.h5",
        "test/shard-00000.h5",
    ];
    let read = |name: &str| (name.to_owned(), fs::read(dir.join(name)).unwrap());
    names.into_iter().map(read).collect()
}

#[test]
fn a_data_set_of_more_samples_in_its_folder_is_that_collected_at_once() {
    let folder = tempfile::tempdir().unwrap();
    for (options, name) in [
        (&["--payload", "0:0.03", "--noise", "d435"][..], "uniform"),
        (&["--design", "sobol"], "sobol"),
    ] {
        let [grown, at_once] =
            ["grown", "at-once"].map(|kind| folder.path().join(format!("{name}-{kind}")));
        collect_small(&grown, options);
        let more = [options, &["--samples", "37"]].concat();
        let size = |dir: &Path| {
            let place = ["collect", "--points", "400", "--out", text(dir)];
            succeed_json(&[&place[..], &more].concat())
        };
        assert_eq!([&size(&grown)["train"], &size(&at_once)["train"]], [29, 29]);
        assert!(set_files(&grown) == set_files(&at_once), "{name}");
        assert!(!grown.join(".partial").exists());
    }
}

#[test]
fn a_data_set_that_cannot_take_the_size_names_the_field_and_the_way_on() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    collect_small(&data, &[]);
    let again = |samples: &str, options: &[&str], data: &Path, expected: &str| {
        let size = ["collect", "--points", "400", "--samples", samples];
        let place = ["--out", text(data)];
        refuse(&[&size[..], &place, options].concat(), 1, expected);
    };
    let way_on = "a data set can grow, not shrink; ask for 20, or choose another folder";
    again(
        "12",
        &[],
        &data,
        &format!("holds 20 samples and `samples` is 12: {way_on}"),
    );
    let cube = folder.path().join("cube");
    let design = ["--design", "latin-hypercube"];
    collect_small(&cube, &design);
    again(
        "30",
        &design,
        &cube,
        "holds 20 samples and `samples` is 30: the places of a latin-hypercube",
    );
}

/// Learning rate that the log of a run says of a step.
fn logged_rate(run: &Path, step: u64) -> f64 {
    let log = fs::read_to_string(run.join("log.csv")).unwrap();
    let line = log
        .lines()
        .find(|line| line.starts_with(&format!("{step},")));
    line.unwrap().split(',').nth(3).unwrap().parse().unwrap()
}

#[test]
fn a_run_that_is_given_more_steps_goes_on_and_says_that_it_was_shorter() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, run, stopped) = (path("data"), path("run"), path("stopped"));
    collect_small(&data, &[]);
    let arguments = |run: &Path, steps: &str| {
        let length = ["--steps", steps, "--validate-every", "20"];
        let places = ["--data", text(&data), "--out", text(run)];
        let arguments = [&TINY_SIZE[..], &length, &places].concat();
        arguments.into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    let train = |run: &Path, steps: &str| {
        let arguments = arguments(run, steps);
        succeed_json(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    };
    train(&run, "40");
    let losses = |run: &Path| fs::read_to_string(run.join("log.csv")).unwrap();
    let before = losses(&run);
    assert_eq!(train(&run, "100")["steps"], 100);
    // What was done stands, with the rates of then; the rest has the schedule of the new length.
    assert!(losses(&run).starts_with(&before));
    assert!(logged_rate(&run, 40) < 2e-6 && logged_rate(&run, 50) > 1e-3);
    assert!(logged_rate(&run, 100) < 2e-6);
    let model = fs::read(run.join("model.safetensors")).unwrap();
    let header = String::from_utf8_lossy(&model);
    let said = r#"\"earlier\":[{\"steps\":40,\"until\":40,\"warmup_steps\":4}]"#;
    assert!(header.contains(said), "the model's settings");
    // Asked for again it is done, and with fewer steps refused by the field.
    train(&run, "100");
    assert!(fs::read(run.join("model.safetensors")).unwrap() == model);
    let fewer = arguments(&run, "60");
    let fewer: Vec<&str> = fewer.iter().map(String::as_str).collect();
    refuse(
        &fewer,
        1,
        "`steps` is 60, and the run is of 100: a run can be given more steps, not fewer; choose another folder (--out)",
    );

    // Interrupted while it goes on, it ends as it would have.
    train(&stopped, "40");
    let longer = arguments(&stopped, "100");
    let longer: Vec<&str> = longer.iter().map(String::as_str).collect();
    for wait in [30, 60, 90, 120] {
        let mut child = tdcr(&longer)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        sleep(Duration::from_millis(wait));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    train(&stopped, "100");
    for file in ["model.safetensors", "state.safetensors", "log.csv"] {
        let [whole, taken_up] = [&run, &stopped].map(|run| fs::read(run.join(file)).unwrap());
        assert!(whole == taken_up, "{file}");
    }
}

#[test]
fn a_model_without_its_run_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, run) = (path("data"), path("run"));
    collect_small(&data, &[]);
    train_tiny(&data, &run, &[]);
    let alone = path("alone");
    fs::create_dir(&alone).unwrap();
    let model = alone.join("model.safetensors");
    fs::copy(run.join("model.safetensors"), &model).unwrap();
    let bytes = fs::read(&model).unwrap();
    let expected = "alone/model.safetensors is a model without the state of its run beside it, and would be overwritten; \
                    choose another folder (--out), or move it away";
    let places = ["--data", text(&data), "--out", text(&alone)];
    let distill = ["distill", "--steps", "20", "--model", text(&model)];
    refuse(&[&distill[..], &places].concat(), 1, expected);
    refuse(&[&crate::TINY_NETWORK[..], &places].concat(), 1, expected);
    let init = ["--init", text(&model)];
    refuse(
        &[&crate::TINY_NETWORK[..], &places, &init].concat(),
        1,
        expected,
    );
    assert!(fs::read(&model).unwrap() == bytes);
    let left: Vec<_> = fs::read_dir(&alone)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert!(left.len() <= 2, "{left:?}");
    // A run's own folder is no place for its student either.
    let places = ["--data", text(&data), "--out", text(&run)];
    let teacher = run.join("model.safetensors");
    let distill = ["distill", "--steps", "50", "--model", text(&teacher)];
    refuse(&[&distill[..], &places].concat(), 1, "cannot be resumed");
    assert!(fs::read(&teacher).unwrap() == bytes);
}

#[test]
fn one_process_trains_in_a_folder_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    let length = ["--steps", "1000000", "--validate-every", "10"];
    let places = ["--data", text(&data), "--out", text(&run)];
    let arguments = [&TINY_SIZE[..], &length, &places].concat();
    let mut first = tdcr(&arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !run.join("model.safetensors").exists() {
        assert!(first.try_wait().unwrap().is_none());
        sleep(Duration::from_millis(10));
    }
    refuse(
        &arguments,
        1,
        "run is being written by another process; wait for its end, or choose another folder (--out)",
    );
    first.kill().unwrap();
    first.wait().unwrap();
    // The lock ends with its process, however that ends.
    let model = run.join("model.safetensors");
    succeed(&[
        "predict",
        "--model",
        text(&model),
        "--command",
        crate::COMMAND,
        "--out",
        text(&folder.path().join("cloud.ply")),
    ]);
    let mut second = tdcr(&arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    sleep(Duration::from_millis(500));
    assert!(second.try_wait().unwrap().is_none(), "it goes on");
    second.kill().unwrap();
    second.wait().unwrap();
}
