//! `--picture`, completions, manual pages and the help.

use std::fs;
use std::path::Path;

use crate::{COMMAND, TINY_NETWORK, refuse, succeed, text};

/// Width, height and pictures of a PNG, and the share of its first picture's pixels that are not white.
fn png(path: &Path) -> ([u32; 2], u32, f64) {
    let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let frames = reader
        .info()
        .animation_control()
        .map_or(1, |control| control.num_frames);
    let size = [reader.info().width, reader.info().height];
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    for _ in 0..frames {
        reader.next_frame(&mut pixels).unwrap();
    }
    let inked = pixels.chunks(3).filter(|pixel| *pixel != [255; 3]).count();
    (size, frames, inked as f64 / (pixels.len() / 3) as f64)
}

#[test]
fn pictures_show_the_robot_that_was_settled_and_how_it_moved() {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    succeed(&[
        "settle",
        "--command",
        COMMAND,
        "--picture",
        text(&out("robot.png")),
    ]);
    let (size, frames, inked) = png(&out("robot.png"));
    assert_eq!((size, frames), ([960, 480], 1));
    assert!((0.02..0.5).contains(&inked), "{inked}");
    succeed(&[
        "settle",
        "--command",
        COMMAND,
        "--picture",
        text(&out("robot.svg")),
    ]);
    let svg = fs::read_to_string(out("robot.svg")).unwrap();
    let tip = crate::succeed_json(&["settle", "--command", COMMAND])["positions"][9].clone();
    let said = format!("z {:.1} mm", 1e3 * tip[2].as_f64().unwrap());
    assert!(svg.contains(&said), "{said}");
    // Among obstacles, of which those are drawn that are near.
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/scenes/shelf.toml");
    let among = out("among.svg");
    let settle = ["settle", "--command", COMMAND, "--scene", scene];
    succeed(&[&settle[..], &["--picture", text(&among)]].concat());
    let drawn = fs::read_to_string(&among).unwrap();
    assert!(drawn.contains("7 obstacles (vermilion)") && drawn.len() > svg.len() + 2000);
    assert!(!svg.contains("vermilion"));
    let commands = out("commands.csv");
    fs::write(&commands, format!("{COMMAND}\n").repeat(101)).unwrap();
    let simulate = |picture: &str| {
        succeed(&[
            "simulate",
            "--commands",
            text(&commands),
            "--picture",
            text(&out(picture)),
        ]);
    };
    simulate("film.png");
    // 101 steps of 2 ms, a picture every 40 ms.
    let (size, frames, inked) = png(&out("film.png"));
    assert_eq!((size, frames), ([480, 480], 6));
    assert!((0.02..0.5).contains(&inked), "{inked}");
    simulate("course.svg");
    let svg = fs::read_to_string(out("course.svg")).unwrap();
    assert!(svg.contains("The tip over 101 steps"));
    refuse(
        &["settle", "--random", "5", "--picture", text(&out("x.png"))],
        1,
        "expected --command",
    );
    refuse(
        &["settle", "--command", COMMAND, "--picture", "x.bmp"],
        1,
        "expected the extension .png or .svg",
    );
}

#[test]
fn a_predicted_cloud_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let (data, run) = (out("data"), out("run"));
    succeed(&[&crate::SMALL_SET[..], &["--out", text(&data)]].concat());
    succeed(
        &[
            &TINY_NETWORK[..],
            &["--data", text(&data), "--out", text(&run)],
        ]
        .concat(),
    );
    let model = run.join("model.safetensors");
    for picture in ["cloud.png", "cloud.svg"] {
        let (picture, cloud) = (out(picture), out("cloud.ply"));
        succeed(&[
            "predict",
            "--model",
            text(&model),
            "--command",
            COMMAND,
            "--points",
            "300",
            "--out",
            text(&cloud),
            "--picture",
            text(&picture),
        ]);
    }
    assert!(png(&out("cloud.png")).2 > 0.001);
    let svg = fs::read_to_string(out("cloud.svg")).unwrap();
    assert_eq!(svg.matches("<circle").count(), 2 * 300);
}

#[test]
fn an_evaluation_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let (data, run) = (out("data"), out("run"));
    succeed(&[&crate::SMALL_SET[..], &["--out", text(&data)]].concat());
    let options = ["--data", text(&data), "--out", text(&run)];
    succeed(&[&TINY_NETWORK[..], &options].concat());
    let model = run.join("model.safetensors");
    let evaluate = crate::eval_small(text(&model), &data);
    for picture in ["scores.png", "scores.svg"] {
        succeed(&[&evaluate[..], &["--picture", text(&out(picture))]].concat());
    }
    assert!(png(&out("scores.png")).2 > 0.01);
    let svg = fs::read_to_string(out("scores.svg")).unwrap();
    for row in ["network", "sampling floor", "Of 2 test commands"] {
        assert!(svg.contains(row), "{row}");
    }
    let wrong = [&evaluate[..], &["--picture", "scores.mp4"]].concat();
    refuse(&wrong, 1, "expected the extension .png or .svg");
}

/// A program in the place of ffmpeg: it counts the bytes of its pictures into the file that it is asked for.
#[cfg(unix)]
const COUNTER: &str = "#!/bin/sh\nfor last; do :; done\nwc -c > \"$last\"\n";

#[cfg(unix)]
#[test]
fn a_motion_is_a_video_where_ffmpeg_is_there_and_refused_where_not() {
    use std::os::unix::fs::PermissionsExt;

    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let (commands, video) = (out("commands.csv"), out("video.mp4"));
    fs::write(&commands, format!("{COMMAND}\n").repeat(101)).unwrap();
    let (commands, picture) = (text(&commands), text(&video));
    let arguments = ["simulate", "--commands", commands, "--picture", picture];
    let without = crate::tdcr(&arguments)
        .env("PATH", folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&without.stderr).into_owned();
    assert!(
        !without.status.success() && said.contains("takes the program ffmpeg"),
        "{said}"
    );
    assert!(!video.exists());
    let path =
        |programs: &Path| format!("{}:{}", programs.display(), std::env::var("PATH").unwrap());
    let programs = out("programs");
    fs::create_dir(&programs).unwrap();
    let program = programs.join("ffmpeg");
    let install = |script: &str| {
        fs::write(&program, script).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    };
    install(COUNTER);
    let with = crate::tdcr(&arguments)
        .env("PATH", path(&programs))
        .output()
        .unwrap();
    assert!(
        with.status.success(),
        "{}",
        String::from_utf8_lossy(&with.stderr)
    );
    // 101 steps of 2 ms, a picture every 40 ms.
    let bytes: usize = fs::read_to_string(&video).unwrap().trim().parse().unwrap();
    assert_eq!(bytes, 6 * 480 * 480 * 3);
    // One that fails leaves the old video and nothing beside it.
    install("#!/bin/sh\ncat > /dev/null\nexit 3\n");
    let failed = crate::tdcr(&arguments)
        .env("PATH", path(&programs))
        .output()
        .unwrap();
    assert!(String::from_utf8_lossy(&failed.stderr).contains("could not make"));
    assert_eq!(
        fs::read_to_string(&video).unwrap().trim(),
        bytes.to_string()
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
}

#[test]
fn shells_complete_commands_and_manuals_have_a_page_for_each() {
    for (shell, expected) in [
        ("bash", "complete -F _tdcr"),
        ("zsh", "#compdef tdcr"),
        ("fish", "complete -c tdcr"),
    ] {
        let script = succeed(&["completions", shell]);
        assert!(
            script.contains(expected) && script.contains("calibrate-cameras"),
            "{shell}"
        );
    }
    refuse(&["completions", "tcsh"], 2, "bash");
    let folder = tempfile::tempdir().unwrap();
    let man = folder.path().join("man");
    succeed(&["manual", "--out", text(&man)]);
    for (page, option) in [
        ("tdcr.1", "settle"),
        ("tdcr-settle.1", "payload"),
        ("tdcr-data-merge.1", "out"),
    ] {
        let text = fs::read_to_string(man.join(page)).unwrap();
        assert!(
            text.starts_with(".ie") && text.contains(option),
            "{page}: {text}"
        );
    }
}
