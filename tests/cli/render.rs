//! `tdcr render`.

use std::fs;
use std::path::Path;

use crate::{refuse, succeed, succeed_json, text};

const ROBOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/every-field.toml");
const COMMAND: &str = "0.02,0.02,0.02,0.115,1.0";

/// Arguments that render the robot into `folder`, with more options.
fn arguments<'a>(folder: &'a Path, options: &[&'a str]) -> Vec<&'a str> {
    let what = ["render", "--robot", ROBOT, "--command", COMMAND];
    [&what[..], &["--out", text(folder)], options].concat()
}

fn render(folder: &Path, options: &[&str]) -> serde_json::Value {
    succeed_json(&arguments(folder, options))
}

/// Pixels of an instance in all images.
fn pixels(views: &serde_json::Value, instance: &str) -> u64 {
    let listed = views["mask"].as_array().unwrap();
    let entry = listed.iter().find(|entry| entry["instance"] == instance);
    entry.map_or(0, |entry| entry["pixels"].as_u64().unwrap())
}

#[test]
fn render_writes_images_cloud_and_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("views");
    let views = render(&out, &["--base"]);
    let written: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(out.join("views.json")).unwrap()).unwrap();
    assert_eq!(written, views);
    let mut files: Vec<_> = fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    let mut listed = vec!["cloud.ply".to_owned(), "views.json".to_owned()];
    for camera in views["cameras"].as_array().unwrap() {
        for image in ["color", "depth_png", "depth_npy", "mask"] {
            listed.push(camera[image].as_str().unwrap().to_owned());
        }
    }
    listed.sort();
    assert_eq!(files, listed);
    assert_eq!(files.len(), 2 * 4 + 2);
    // The second camera's distortion is there for whoever undoes it.
    assert_eq!(views["cameras"][1]["intrinsics"]["distortion"]["k1"], -0.05);
    assert!(pixels(&views, "base") > 0 && pixels(&views, "disc 4") > 0);
    assert_eq!(
        pixels(&views, "background")
            + (0..5)
                .map(|d| pixels(&views, &format!("disc {d}")))
                .sum::<u64>()
            + pixels(&views, "base"),
        2 * 320 * 240
    );
    let points = views["points"].as_u64().unwrap();
    let ply = fs::read(out.join("cloud.ply")).unwrap();
    assert!(points > 100 && String::from_utf8_lossy(&ply).contains(&format!("vertex {points}\n")));
    let npy = fs::read(out.join("camera0_depth.npy")).unwrap();
    assert_eq!(&npy[..8], b"\x93NUMPY\x01\x00");
    assert_eq!(npy.len() % 64, 0);
    assert_eq!(npy.len(), 128 + 4 * 320 * 240);
}

#[test]
fn payload_and_tendons_are_shown_when_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let load = ["--payload", "0.02"];
    let hidden = render(&folder.path().join("hidden"), &load);
    assert_eq!(pixels(&hidden, "payload") + pixels(&hidden, "tendon 1"), 0);
    let options = [&load[..], &["--show", "payload", "--show", "tendons"]].concat();
    let shown = render(&folder.path().join("shown"), &options);
    assert!(pixels(&shown, "payload") > 50 && pixels(&shown, "tendon 1") > 0);
}

/// Each obstacle that is seen has a value in the masks, and its name from the file.
#[test]
fn obstacles_of_a_scene_are_shown_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/scenes/shelf.toml");
    let without = render(&folder.path().join("without"), &[]);
    assert_eq!(pixels(&without, "obstacle 0"), 0);
    let shown = render(&folder.path().join("with"), &["--scene", scene]);
    let listed = shown["mask"].as_array().unwrap();
    let floor = listed
        .iter()
        .find(|entry| entry["instance"] == "obstacle 0");
    let floor = floor.unwrap();
    assert_eq!(
        (&floor["name"], &floor["value"]),
        (&"floor".into(), &40_000.into())
    );
    assert!(pixels(&shown, "obstacle 0") > 1_000);
    let disc = listed.iter().find(|entry| entry["instance"] == "disc 4");
    assert!(disc.unwrap().get("name").is_none());
}

#[test]
fn a_wrong_scene_is_named_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("s.toml"), folder.path().join("never"));
    fs::write(
        &file,
        "[[obstacle]]\nname = 'ball'\nsphere = { radius = 0 }\n",
    )
    .unwrap();
    let expected = format!(
        "scene file {}: obstacle 0 `ball`: field `sphere.radius` is 0; expected a length above 0, at most 1e6 m",
        file.display()
    );
    refuse(&arguments(&out, &["--scene", text(&file)]), 1, &expected);
    assert!(!out.exists());
}

/// A pyramid under the base as an STL text: 6 cm wide, its tip 1 cm below the base's origin.
const PYRAMID: [[[f64; 3]; 3]; 4] = {
    let (tip, low) = ([0.0, 0.0, -0.01], -0.05);
    let corners = [
        [-0.03, -0.03, low],
        [0.03, -0.03, low],
        [0.03, 0.03, low],
        [-0.03, 0.03, low],
    ];
    [
        [corners[0], corners[1], tip],
        [corners[1], corners[2], tip],
        [corners[2], corners[3], tip],
        [corners[3], corners[0], tip],
    ]
};

#[test]
fn a_base_of_ones_own_is_read_from_text_and_binary() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let mut lines = String::from("solid base\n");
    let mut binary = [
        b"solid binary".to_vec(),
        vec![0; 68],
        4u32.to_le_bytes().to_vec(),
    ]
    .concat();
    for triangle in PYRAMID {
        lines += " facet normal 0 0 0\n  outer loop\n";
        binary.extend([0; 12]);
        for [x, y, z] in triangle {
            lines += &format!("   vertex {x} {y:e} {z}\n");
            binary.extend([x, y, z].iter().flat_map(|x| (*x as f32).to_le_bytes()));
        }
        lines += "  endloop\n endfacet\n";
        binary.extend([0; 2]);
    }
    lines += "endsolid base\n";
    let base_pixels = |mesh: &Path, name: &str| {
        pixels(
            &render(&folder.path().join(name), &["--base-mesh", text(mesh)]),
            "base",
        )
    };
    let from_text = base_pixels(&file("text.stl", lines.as_bytes()), "text");
    let from_binary = base_pixels(&file("binary.stl", &binary), "binary");
    assert!(from_text > 500, "{from_text}");
    assert!(
        from_text.abs_diff(from_binary) <= 2,
        "{from_text} {from_binary}"
    );
    let refused = |mesh: &Path, expected: &str| {
        let out = folder.path().join("never");
        let options = ["--base-mesh", text(mesh)];
        refuse(&arguments(&out, &options), 1, expected);
        assert!(!out.exists());
    };
    refused(&folder.path().join("none.stl"), "cannot read mesh");
    refused(
        &file("short.stl", &binary[..200]),
        "is not STL: neither text that begins with `solid`",
    );
    let wrong = lines.replacen("-0.05", "low", 1);
    refused(
        &file("wrong.stl", wrong.as_bytes()),
        "line 4: `vertex -0.03 -3e-2 low`; expected `vertex`",
    );
    let lost = lines.replacen("   vertex 0 0e0 -0.01\n", "", 1);
    refused(
        &file("lost.stl", lost.as_bytes()),
        "line 7: a facet without three vertices",
    );
    refused(
        &file("empty.stl", b"solid empty\nendsolid empty\n"),
        "a mesh has no triangles",
    );
}

#[test]
fn faults_of_a_camera_are_a_function_of_the_seed() {
    let folder = tempfile::tempdir().unwrap();
    let images = |name: &str, options: &[&str], threads: &str| {
        let out = folder.path().join(name);
        render(&out, &[options, &["--threads", threads]].concat());
        fs::read(out.join("camera0_depth.npy")).unwrap()
    };
    let clean = images("clean", &[], "1");
    let noisy = images("noisy", &["--noise", "d435", "--seed", "3"], "1");
    assert_ne!(clean, noisy);
    assert_eq!(
        noisy,
        images("again", &["--noise", "d435", "--seed", "3"], "2")
    );
    assert_ne!(
        noisy,
        images("other", &["--noise", "d435", "--seed", "4"], "2")
    );
}

#[test]
fn a_folder_with_something_in_it_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("thesis.tex"), "precious").unwrap();
    let arguments = ["render", "--robot", ROBOT, "--command", COMMAND, "--out"];
    let expected = "has thesis.tex in it already; expected an empty folder, or a new one";
    refuse(
        &[&arguments[..], &[text(folder.path())]].concat(),
        1,
        expected,
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    let inside = folder.path().join("thesis.tex/views");
    let expected = format!("cannot write to {}", inside.display());
    refuse(&[&arguments[..], &[text(&inside)]].concat(), 1, &expected);
    let out = folder.path().join("new");
    let wrong = ["render", "--command", "0.01", "--out", text(&out)];
    refuse(
        &wrong,
        1,
        "the command has 1 entries; robot `2m` has 6 tendons",
    );
    refuse(
        &[&arguments[..], &[text(&out), "--noise", "kinect"]].concat(),
        2,
        "d435",
    );
    refuse(
        &[&arguments[..], &[text(&out), "--seed", "1"]].concat(),
        2,
        "--noise",
    );
    assert!(!out.exists());
}

#[test]
fn render_says_where_it_wrote_unless_it_is_to_be_quiet() {
    let folder = tempfile::tempdir().unwrap();
    let render = |out: &Path, options: &[&str]| {
        let what = ["render", "--robot", ROBOT, "--command", COMMAND];
        succeed(&[&what[..], &["--out", text(out)], options].concat())
    };
    assert_eq!(render(&folder.path().join("quiet"), &["-q"]), "");
    let out = folder.path().join("views");
    let said = render(&out, &[]);
    assert!(
        said.starts_with(&format!("{}: 2 views, ", out.display())),
        "{said}"
    );
}
