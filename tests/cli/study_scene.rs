//! `tdcr study` among obstacles: rows, refusals, parts, models of data sets in scenes.

use std::fs;

use crate::study::{files, number, table, write};
use crate::{COMMAND, TINY_NETWORK, refuse, succeed, succeed_json, text};

/// A post that 2m leans on under [`COMMAND`].
const POST: &str = r#"
[[obstacle]]
name = "post"
cylinder = { radius = 0.01, length = 0.4 }
position = [-0.06, 0.0, 0.25]
"#;

/// What single configurations give in a scene.
fn study(scene: &str) -> String {
    format!(
        "{scene}want = [\"tip\", \"contact\", \"deflection\", \"stability\", \"compliance\"]\n[set]\n\
         command = [{COMMAND}]\n[[vary]]\nwhat = \"payload\"\nvalues = [0.0, 0.01]\n"
    )
}

#[test]
fn rows_are_what_settle_says_among_the_obstacles() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write(folder.path(), "post.toml", POST);
    let file = write(
        folder.path(),
        "study.toml",
        &study("scene = \"post.toml\"\n"),
    );
    let out = folder.path().join("out");
    let finished = succeed_json(&["study", text(&file), "--out", text(&out)]);
    assert_eq!(finished["settled"], 2);
    let rows = table(&out.join("table.csv"));
    for (row, payload) in rows.iter().zip(["0", "0.01"]) {
        let settled = succeed_json(&[
            "settle",
            "--command",
            COMMAND,
            "--payload",
            payload,
            "--scene",
            text(&scene),
        ]);
        for (axis, name) in ["tip_x", "tip_y", "tip_z"].into_iter().enumerate() {
            let tip = settled["positions"][9][axis].as_f64().unwrap();
            assert_eq!(number(row, name), tip);
        }
        let contacts = settled["contacts"].as_array().unwrap();
        let force = |contact: &serde_json::Value| -> f64 {
            let force: [f64; 3] = serde_json::from_value(contact["force"].clone()).unwrap();
            force.iter().map(|f| f * f).sum::<f64>().sqrt()
        };
        let forces: Vec<f64> = contacts.iter().map(force).collect();
        assert!(!forces.is_empty());
        assert_eq!(number(row, "contacts"), forces.len() as f64);
        let largest = forces.iter().copied().fold(0.0, f64::max);
        assert!((number(row, "contact_max") / largest - 1.0).abs() < 1e-12);
        let sum: f64 = forces.iter().sum();
        assert!((number(row, "contact_sum") / sum - 1.0).abs() < 1e-12);
        let gaps = contacts
            .iter()
            .map(|contact| contact["gap"].as_f64().unwrap());
        let least = gaps.fold(f64::INFINITY, f64::min);
        assert!((number(row, "gap") - least).abs() < 1e-12);
        assert!((number(row, "penetration") + least).abs() < 1e-12);
        let stiffness = settled["smallest_stiffness"].as_f64().unwrap();
        assert_eq!(number(row, "smallest_stiffness"), stiffness);
        assert!(number(row, "compliance_max") > 0.0);
    }
    let moved: Vec<f64> = (["tip_x", "tip_y", "tip_z"].iter())
        .map(|name| number(&rows[1], name) - number(&rows[0], name))
        .collect();
    let moved = moved.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!(
        (number(&rows[1], "deflection") - moved).abs() < 1e-9,
        "beside the same among obstacles"
    );
    assert!(number(&rows[0], "deflection") == 0.0);
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("among 1 obstacle") && page.contains("Largest contact force"));

    // A scene by the option is that of the file.
    let plain = write(folder.path(), "plain.toml", &study(""));
    let by_option = folder.path().join("by-option");
    succeed(&[
        "study",
        text(&plain),
        "--scene",
        text(&scene),
        "--out",
        text(&by_option),
    ]);
    assert!(files(&by_option) == files(&out));
    // Another scene is another study.
    write(folder.path(), "post.toml", &POST.replace("-0.06", "-0.061"));
    refuse(
        &["study", text(&file), "--out", text(&out)],
        1,
        "holds another study",
    );
    for number in ["1/2", "2/2"] {
        let part = folder.path().join(number.replace('/', "-of-"));
        let file = if number == "1/2" {
            text(&file)
        } else {
            text(&plain)
        };
        let mut arguments = vec!["study", file, "--part", number, "--out", text(&part)];
        let other = write(folder.path(), "other.toml", POST);
        if number == "2/2" {
            arguments.extend(["--scene", text(&other)]);
        }
        succeed(&arguments);
    }
    let [one, two] = ["1-of-2", "2-of-2"].map(|part| folder.path().join(part));
    let merged = folder.path().join("merged");
    let merge = [
        "study",
        "merge",
        text(&one),
        text(&two),
        "--out",
        text(&merged),
    ];
    refuse(&merge, 1, "expected all parts of one study");
}

#[test]
fn what_cannot_be_solved_among_obstacles_is_said_in_its_row() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "post.toml", POST);
    let inside =
        "[[obstacle]]\nname = \"ball\"\nsphere = { radius = 0.05 }\nposition = [0, 0, 0.2]\n";
    write(folder.path(), "inside.toml", inside);
    let study = "want = [\"contact\"]\n[[vary]]\nwhat = \"scene\"\nvalues = [\"post.toml\", \"inside.toml\"]\n\
                 [[vary]]\nwhat = \"moment[tip].x\"\nvalues = [0.0, 0.001]\n";
    let file = write(folder.path(), "study.toml", study);
    let out = folder.path().join("out");
    let finished = succeed_json(&["study", text(&file), "--out", text(&out)]);
    assert_eq!(
        (&finished["rows"], &finished["settled"]),
        (&4.into(), &1.into())
    );
    let said = fs::read_to_string(out.join("table.csv")).unwrap();
    let said: Vec<&str> = said.lines().collect();
    assert!(
        said[1].contains("post.toml") && said[1].contains("settled"),
        "{}",
        said[1]
    );
    assert!(
        said[2].contains("the wrench on disc 9 is a moment"),
        "{}",
        said[2]
    );
    assert!(
        said[3].contains("inside.toml") && said[3].contains("starts inside obstacle"),
        "{}",
        said[3]
    );
}

#[test]
fn scenes_that_no_study_has_are_refused_by_their_key() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "post.toml", POST);
    let file = folder.path().join("study.toml");
    let refused = |text_of_study: &str, expected: &str| {
        fs::write(&file, text_of_study).unwrap();
        refuse(&["study", text(&file), "--out", "unused"], 1, expected);
    };
    refused(&study("scene = \"none.toml\"\n"), "`scene`: scene file");
    refused(&study(""), "`want` has \"contact\", and there is no scene");
    refused(
        &study("").replace("[set]", "[set]\nscene = \"post.toml\""),
        "the key `scene` above all tables",
    );
    let number = study("").replace(
        "\"payload\"\nvalues = [0.0, 0.01]",
        "\"scene\"\nvalues = [1]",
    );
    refused(&number, "the path of a scene file");
}

#[test]
fn a_study_draws_the_workspace_among_its_obstacles() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write(folder.path(), "post.toml", POST);
    let study = "want = [\"workspace\"]\n[[vary]]\nwhat = \"command\"\n[sample]\ncount = 200\n";
    let file = write(folder.path(), "study.toml", study);
    let drawn = |options: &[&str], name: &str| {
        let out = folder.path().join(name);
        succeed(&[&["study", text(&file), "--out", text(&out)], options].concat());
        fs::read_to_string(out.join("figures/workspace-1.svg")).unwrap()
    };
    let (free, among) = (
        drawn(&[], "free"),
        drawn(&["--scene", text(&scene)], "among"),
    );
    assert!(among.contains("vermilion: obstacles") && !free.contains("obstacle"));
}

#[test]
fn a_model_is_tried_in_the_scene_of_its_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write(folder.path(), "post.toml", POST);
    let at = |name: &str| folder.path().join(name);
    let set = at("set");
    succeed(&[
        "collect",
        "--scene",
        text(&scene),
        "--samples",
        "10",
        "--points",
        "200",
        "--out",
        text(&set),
    ]);
    let run = at("run");
    let options = ["--data", text(&set), "--out", text(&run)];
    succeed(&[&TINY_NETWORK[..], &options].concat());
    let study = format!(
        "want = [\"model\", \"contact\"]\n[model]\nfile = \"run/model.safetensors\"\npoints = 100\nemd_points = 20\n\
         [[vary]]\nwhat = \"command\"\nvalues = [[{COMMAND}]]\n"
    );
    let file = write(folder.path(), "study.toml", &study);
    let out = at("out");
    succeed(&["study", text(&file), "--out", text(&out)]);
    let rows = table(&out.join("table.csv"));
    assert!(
        number(&rows[0], "contacts") > 0.0,
        "it settles among the obstacles of the data set"
    );
    assert!(number(&rows[0], "model_cd") > 0.0);
    let other = [
        "study",
        text(&file),
        "--scene",
        text(&scene),
        "--out",
        text(&out),
    ];
    refuse(
        &other,
        1,
        "no other scene than that of the model's data set",
    );
}
