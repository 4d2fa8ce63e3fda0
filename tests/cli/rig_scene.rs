//! A rig among the obstacles of a scene.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use serde_json::Value;
use tdcr::learn::data::{DataSet, Split};

use crate::capture::small_rig;
use crate::{refuse, stderr, succeed, tdcr, text};

/// The small rig with a table `[scene]`, beside a wall 6 mm from its home.
fn rig_by_a_wall(folder: &Path, scene: &str) -> PathBuf {
    let rig = small_rig(folder);
    let whole = fs::read_to_string(&rig).unwrap();
    let scene = format!("[scene]\n{scene}\n\n[motion]");
    fs::write(&rig, whole.replacen("[motion]", &scene, 1)).unwrap();
    fs::write(folder.join("wall.toml"), wall(0.04)).unwrap();
    rig
}

/// The scene of a wall of 2 cm across the x axis, about such a place on it (m).
fn wall(x: f64) -> String {
    format!(
        "[[obstacle]]\nname = \"wall\"\nbox = {{ size = [0.02, 2.0, 2.0] }}\nposition = [{x}, 0.0, 0.0]\n"
    )
}

fn keys(arguments: &[&str], keys: &str) -> Output {
    let mut command = tdcr(arguments);
    let pipes = command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = pipes.stderr(Stdio::piped()).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    stdin.write_all(keys.as_bytes()).unwrap();
    drop(stdin);
    child.wait_with_output().unwrap()
}

#[test]
fn keys_lead_no_disc_of_a_rig_into_a_wall() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig_by_a_wall(folder.path(), "file = \"wall.toml\"\nclearance = 0.004");
    // Along x to the wall, along y, and home.
    for (tip, along) in [(&["--tip"][..], "ddddwwhq"), (&[], "ddwwhq")] {
        let out = folder.path().join(format!("jogged{}", tip.len()));
        let jog = ["jog", "--rig", text(&rig), "--out", text(&out), "--json"];
        let jogged = keys(&[&jog[..], tip].concat(), along);
        let said = stderr(&jogged);
        assert!(jogged.status.success(), "{said}");
        assert!(said.contains("mm from the obstacle `wall`"), "{said}");
        let summary: Value = serde_json::from_slice(&jogged.stdout).unwrap();
        assert!(summary["refused"].as_u64().unwrap() >= 2, "{summary}");
        assert!(summary["moves"].as_u64().unwrap() >= 2, "{summary}");
    }
}

#[test]
fn scenes_of_rigs_that_are_wrong_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (scene, reason) in [
        ("file = \"gone.toml\"", "gone.toml: it cannot be read"),
        (
            "file = \"wall.toml\"\nclearence = 0.1",
            "unknown field `clearence`",
        ),
        ("clearance = 0.1", "missing field `file`"),
        (
            "file = \"wall.toml\"\nclearance = -0.1",
            "rig.toml:29: scene.clearance is -0.1",
        ),
        (
            "file = \"wall.toml\"\nclearance = 0.01",
            "`wall`, 0 % of the way",
        ),
    ] {
        let rig = rig_by_a_wall(folder.path(), scene);
        let capture = [
            "capture",
            "--rig",
            text(&rig),
            "--commands",
            "1",
            "--dry-run",
        ];
        refuse(&capture, 1, reason);
    }
}

/// The plan knows nothing of the wall: the robot presses against it, and the wall is background.
#[test]
fn a_capture_through_a_wall_is_of_a_robot_that_the_wall_holds() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (rig, scene) = (small_rig(folder.path()), path("wall.toml"));
    let masks = "[masks]\nbackground = { log = \"empty.mcap\" }\n";
    let whole = fs::read_to_string(&rig).unwrap();
    let whole = whole.replace("[masks]\n", masks);
    let world = "[simulation]\nscene = \"wall.toml\"\n";
    fs::write(&rig, whole.replace("[simulation]\n", world)).unwrap();
    fs::write(&scene, wall(0.05)).unwrap();
    let (log, out) = (path("empty.mcap"), path("data"));
    let record = ["background", "--rig", text(&rig), "--pictures", "10"];
    succeed(&[&record[..], &["--out", text(&log)]].concat());
    let few = ["--commands", "8", "--points", "300", "--voxel", "0.004"];
    let capture = ["capture", "--rig", text(&rig), "--out", text(&out)];
    succeed(&[&capture[..], &few, &["--no-log"]].concat());
    let set = DataSet::open(&out).unwrap();
    let samples = Split::ALL.map(|split| set.read_split(split).unwrap());
    let points = samples.iter().flatten().flat_map(|s| &s.cloud.points);
    // The wall's face is at 0.04. Of the wall a few pixels are nearer than they ever were.
    let [at, beyond] = [0.036, 0.041].map(|x| points.clone().filter(|p| p[0] > x).count());
    assert!(at > 60 && beyond < 15, "{at}, {beyond}");
    let meta = fs::read_to_string(out.join("meta.json")).unwrap();
    let meta: Value = serde_json::from_str(&meta).unwrap();
    let settings = &meta["origin"]["recorded"]["recording"]["settings"];
    let obstacle = &settings["simulation"]["scene"]["obstacle"][0];
    assert_eq!(obstacle["name"], "wall", "{settings}");
}

/// The rate is refused once the path's first point was found to be within reach, and before anything moves.
#[test]
fn the_model_of_a_rig_that_tracks_has_its_scene_unless_another_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig_by_a_wall(folder.path(), "file = \"wall.toml\"\nclearance = 0.004");
    let beside = folder.path().join("beside.toml");
    fs::write(&beside, wall(0.5)).unwrap();
    // The path begins 2 cm behind the wall's face.
    let path = ["--path", "circle", "--centre", "0.02,0,0.325"];
    let track = ["track", "--rig", text(&rig), "--rate", "0.5"];
    let track = [&track[..], &path].concat();
    refuse(&track, 1, "out of reach of robot");
    let among = [&track[..], &["--scene", text(&beside)]].concat();
    refuse(&among, 1, "the rate is 0.5 m/s");
}
