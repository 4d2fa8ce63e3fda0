//! `tdcr collect --scene`: data sets of a robot among obstacles.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use tdcr::learn::data::{
    Condition, DataSet, Meta, Origin, Sample, Simulator, Split, split_indices,
};
use tdcr::sim::robot::Robot;

use crate::resume::set_files;
use crate::{refuse, stderr, succeed, succeed_json, tdcr, text};

/// A post that the robot of two modules leans on under some commands, and a shelf that cameras see.
const SCENE: &str = r#"
[[obstacle]]
name = "post"
cylinder = { radius = 0.01, length = 0.4 }
position = [-0.06, 0.0, 0.25]

[[obstacle]]
name = "shelf"
box = { size = [0.1, 0.1, 0.01] }
position = [0.25, 0.0, 0.2]
"#;

const SET: [&str; 5] = ["collect", "--samples", "24", "--points", "400"];

fn scene(folder: &Path, lines: &str) -> PathBuf {
    let path = folder.join("scene.toml");
    fs::write(&path, lines).unwrap();
    path
}

fn collect(threads: &str, scene: &Path, out: &Path, more: &[&str]) -> Output {
    let place = ["--scene", text(scene), "--out", text(out)];
    let output = tdcr(&[&SET[..], &place, more].concat())
        .env("RAYON_NUM_THREADS", threads)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    output
}

fn samples(dir: &Path, split: Split) -> Vec<Sample> {
    DataSet::open(dir).unwrap().read_split(split).unwrap()
}

#[test]
fn a_set_in_a_scene_is_the_same_on_any_threads_and_in_parts_and_counts_what_touches() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scene = scene(folder.path(), SCENE);
    let said = collect("1", &scene, &path("one"), &[]);
    let said = String::from_utf8(said.stdout).unwrap();
    collect("2", &scene, &path("two"), &[]);
    assert!(set_files(&path("one")) == set_files(&path("two")));
    for part in ["1/2", "2/2"] {
        let out = path(&part.replace('/', "-"));
        collect("2", &scene, &out, &["--part", part]);
    }
    let parts = [path("1-2"), path("2-2")];
    let [first, second] = parts.each_ref().map(|part| text(part));
    let merged = path("merged");
    succeed(&["data", "merge", first, second, "--out", text(&merged)]);
    assert!(set_files(&path("one")) == set_files(&merged));

    // What settle says of the same commands.
    let again = ["--scene", text(&scene), "--out", text(&merged)];
    let counted = succeed_json(&[&SET[..], &again].concat());
    let conditions = Split::ALL
        .into_iter()
        .flat_map(|split| samples(&merged, split))
        .map(|sample| sample.condition.to_vec());
    let touching = conditions.filter(|command| {
        let command: Vec<String> = command.iter().map(f64::to_string).collect();
        let place = ["--command", &command.join(","), "--scene", text(&scene)];
        let settled = succeed_json(&[&["settle"][..], &place].concat());
        let contacts = &settled["contacts"];
        !contacts.as_array().unwrap().is_empty()
    });
    let touching = touching.count();
    assert!(touching > 0);
    assert_eq!(counted["poses"]["in_contact"], touching);
    let phrase = format!("; of 24 poses {touching} touch obstacles");
    assert!(said.contains(&phrase), "{said}");
}

#[test]
fn clouds_are_of_the_robot_alone_and_what_they_were_made_in_is_in_the_set() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, data) = (scene(folder.path(), SCENE), folder.path().join("data"));
    collect("2", &scene, &data, &[]);
    fs::remove_file(&scene).unwrap();
    for sample in samples(&data, Split::Train) {
        assert!(sample.cloud.points.iter().all(|[x, ..]| x.abs() < 0.19));
    }
    let set = DataSet::open(&data).unwrap();
    let subject = set.meta().and_then(Meta::subject).unwrap();
    let around = &subject.scene.obstacles()[0];
    assert_eq!(around.name, "post");
    assert_eq!(around.pose.translation.vector.z, 0.25);
    let info = succeed(&["data", "info", text(&data)]);
    assert!(info.contains("2: post, shelf"), "{info}");
    let info = &succeed_json(&["data", "info", text(&data)])[0];
    assert_eq!(info["obstacles"][1], "shelf");
    // Settled again from the recipe, the robot is where it touches the post, and elsewhere than without it.
    let again = succeed_json(&["compare", text(&data), text(&data), "--emd-points", "64"]);
    assert_eq!(again["tip"]["max"], 0.0);
    let free = folder.path().join("free");
    succeed(&[&SET[..], &["--out", text(&free)]].concat());
    let other = succeed_json(&["compare", text(&data), text(&free), "--emd-points", "64"]);
    assert!(other["tip"]["max"].as_f64().unwrap() > 1e-3);
}

#[test]
fn a_set_is_not_resumed_in_another_scene() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let one = scene(folder.path(), SCENE);
    collect("2", &one, &data, &[]);
    let again = |scene: &Path, expected: &str| {
        let place = ["--scene", text(scene), "--out", text(&data)];
        refuse(&[&SET[..], &place].concat(), 1, expected);
    };
    let thicker = scene(
        folder.path(),
        &SCENE.replace("radius = 0.01", "radius = 0.02"),
    );
    let field =
        "`origin.simulated.recipe.subject.scene.obstacle[0].cylinder.radius` is 0.01, not 0.02";
    again(&thicker, field);
    let inside = scene(
        folder.path(),
        &SCENE.replace("-0.06, 0.0, 0.25", "0.0, 0.0, 0.25"),
    );
    let elsewhere = folder.path().join("elsewhere");
    let place = ["--scene", text(&inside), "--out", text(&elsewhere)];
    let place = [&SET[..], &place].concat();
    refuse(&place, 1, "starts inside obstacle \"post\"");
    assert!(!elsewhere.exists(), "nothing stays behind");
}

#[test]
fn poses_through_ground_and_base_are_counted_without_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("data");
    let set = [
        "collect",
        "--robot",
        "5m",
        "--samples",
        "100",
        "--points",
        "50",
    ];
    let counted = succeed_json(&[&set[..], &["--out", text(&out)]].concat());
    let count = |name: &str| counted["poses"][name].as_u64().unwrap();
    assert_eq!(count("in_contact"), 0);
    assert!(count("below_ground") > 0 && count("through_base") > 0);
}

const VARIED: [&str; 2] = ["--vary-obstacles", "0.02:20"];

#[test]
fn obstacles_are_moved_for_each_sample_and_clouds_are_those_of_the_moved_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scene = scene(folder.path(), SCENE);
    collect("1", &scene, &path("one"), &VARIED);
    collect("2", &scene, &path("two"), &VARIED);
    assert!(set_files(&path("one")) == set_files(&path("two")));

    let set = DataSet::open(&path("one")).unwrap();
    let meta = set.meta().unwrap();
    assert_eq!((meta.motors, meta.condition_dim()), (6 + 12, 18));
    let Origin::Simulated { recipe, .. } = &meta.origin else {
        panic!("not simulated");
    };
    let variation = recipe.subject.obstacles.unwrap();
    assert_eq!(variation.shift, 0.02);
    let splits = split_indices(meta.count, meta.seed).unwrap();
    let indices = splits.of(Split::Val).iter().chain(splits.of(Split::Test));
    let kept = samples(&path("one"), Split::Val).into_iter();
    let kept = kept.chain(samples(&path("one"), Split::Test));
    let robot = Robot::new(recipe.subject.robot.clone()).unwrap();
    let mut places = Vec::new();
    for (sample, &index) in kept.zip(indices) {
        let (command, numbers) = sample.condition.motors.split_at(6);
        assert!(
            numbers
                .iter()
                .zip([0.02, 0.02, 0.02, 0.3491, 0.3491, 0.3491].repeat(2))
                .all(|(x, most)| x.abs() <= most)
        );
        // The same cloud as in a scene that stands there.
        let mut still = recipe.clone();
        still.subject.obstacles = None;
        still.subject.scene = variation.place(&recipe.subject.scene, numbers).unwrap();
        let condition = Condition {
            motors: command.to_vec(),
            payload: None,
        };
        let again = Simulator::new(&robot, &still).sample(condition, 400, meta.seed, index as u64);
        assert_eq!(again.unwrap().cloud, sample.cloud);
        places.push(numbers.to_vec());
    }
    assert!(places.len() >= 4 && places[0] != places[1]);
    let info = succeed(&["data", "info", text(&path("one"))]);
    let moved = "2: post, shelf; moved by 12 numbers of a sample (m, rad)";
    assert!(
        info.contains(moved) && info.contains("6, values from"),
        "{info}"
    );
}

#[test]
fn a_network_learns_and_is_scored_with_obstacles_in_its_conditions() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scene = scene(folder.path(), SCENE);
    collect("2", &scene, &path("data"), &VARIED);
    let (data, run) = (path("data"), path("run"));
    let model = run.join("model.safetensors");
    let small = [
        "train",
        "--data",
        text(&data),
        "--out",
        text(&run),
        "--steps",
        "4",
    ];
    succeed(&small);
    let eval = [
        "eval",
        "--data",
        text(&data),
        "--model",
        text(&model),
        "--emd-points",
        "64",
    ];
    let scored = succeed_json(&eval);
    assert!(scored.is_object());
    // Of obstacles that stand there is another set.
    let still = path("still");
    collect("2", &scene, &still, &[]);
    let other = ["eval", "--data", text(&still), "--model", text(&model)];
    refuse(
        &other,
        1,
        "the model was trained with obstacles that are moved by up to 0.02 m and 20 degrees",
    );
    let stream = [
        "train",
        "--stream",
        "2m",
        "--scene",
        text(&scene),
        "--steps",
        "2",
        "--stream-points",
        "200",
        "--window",
        "8",
    ];
    let streamed = path("streamed");
    succeed(&[&stream[..], &VARIED, &["--out", text(&streamed)]].concat());
}

#[test]
fn obstacles_that_cannot_be_moved_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let floor = scene(folder.path(), "[[obstacle]]\nhalf_space = {}\n");
    let out = folder.path().join("data");
    let place = ["--scene", text(&floor), "--out", text(&out)];
    let set = [&SET[..], &place].concat();
    refuse(
        &[&set[..], &VARIED].concat(),
        1,
        "expected a scene with an obstacle that is not a half space",
    );
    refuse(
        &[&SET[..], &VARIED, &["--out", text(&out)]].concat(),
        1,
        "of 0 obstacles",
    );
    refuse(
        &[&set[..], &["--vary-obstacles", "far"]].concat(),
        2,
        "expected SHIFT or SHIFT:TURN",
    );
    assert!(!out.exists());
}
