//! Data sets that are collected in parts, as on several machines, and merged.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::slice::from_ref;
use std::thread::sleep;
use std::time::Duration;

use crate::resume::set_files;
use crate::{refuse, stderr, succeed, succeed_json, tdcr, text};

/// Options of the data sets.
const SET: [&str; 9] = [
    "collect",
    "--samples",
    "11",
    "--points",
    "300",
    "--payload",
    "0:0.03",
    "--noise",
    "d435",
];

/// Arguments that collect a part of a data set, with more options.
fn part_arguments<'a>(part: &'a str, out: &'a Path, options: &[&'a str]) -> Vec<&'a str> {
    [&SET[..], &["--part", part, "--out", text(out)], options].concat()
}

/// Collects all parts of a data set below `folder`, with more options.
fn collect_parts(folder: &Path, of: usize, options: &[&str]) -> Vec<PathBuf> {
    let collect = |number: usize| {
        let out = folder.join(format!("part-{number}-of-{of}"));
        succeed(&part_arguments(&format!("{number}/{of}"), &out, options));
        out
    };
    (1..=of).map(collect).collect()
}

/// Arguments that merge parts.
fn merge_arguments<'a>(parts: &'a [PathBuf], out: &'a Path) -> Vec<&'a str> {
    let parts = parts.iter().map(|part| text(part));
    ["data", "merge"]
        .into_iter()
        .chain(parts)
        .chain(["--out", text(out)])
        .collect()
}

#[test]
fn parts_merged_are_the_files_of_one_run() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    let collected = succeed_json(&[&SET[..], &["--out", text(&whole)]].concat());
    let expected = set_files(&whole);
    assert_eq!(expected.len(), 6);
    // 11 samples in 13 parts: two parts have none.
    for of in [1, 2, 3, 7, 13] {
        let parts = collect_parts(folder.path(), of, &[]);
        let before: Vec<_> = parts.iter().map(|part| set_files(part)).collect();
        let out = folder.path().join(format!("merged-{of}"));
        let merged = succeed_json(&merge_arguments(&parts, &out));
        assert!(set_files(&out) == expected, "{of} parts");
        assert!(before == parts.iter().map(|part| set_files(part)).collect::<Vec<_>>());
        assert_eq!(merged["parts"], of);
        for field in ["robot", "train", "val", "test", "points"] {
            assert_eq!(merged[field], collected[field], "{field}");
        }
    }
}

#[test]
fn a_part_says_what_it_is_and_is_collected_once() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("second");
    let first = succeed_json(&part_arguments("2/3", &out, &[]));
    assert_eq!(first["part"], serde_json::json!({"number": 2, "of": 3}));
    assert_eq!(
        [&first["samples"], &first["points"], &first["robot"]],
        [
            &serde_json::json!(4),
            &serde_json::json!(300),
            &serde_json::json!("2m")
        ]
    );
    assert_eq!(first.get("train"), None);
    let files = set_files(&out);
    assert_eq!(succeed(&part_arguments("2/3", &out, &["--quiet"])), "");
    let said = succeed(&part_arguments("2/3", &out, &[]));
    assert!(said.contains("second: part 2 of 3, 4 clouds of 300 points of robot 2m"));
    assert!(set_files(&out) == files);
}

/// Starts to collect a part.
fn start(out: &Path) -> Child {
    let size = ["collect", "--samples", "60", "--points", "3000", "--base"];
    let place = ["--part", "1/1", "--threads", "2", "--quiet", "--out"];
    tdcr(&[&size[..], &place, &[text(out)]].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

#[test]
fn a_part_that_is_stopped_at_any_moment_ends_as_one_that_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, stopped, out] = ["whole", "stopped", "out"].map(|name| folder.path().join(name));
    assert!(start(&whole).wait().unwrap().success());
    let mut interruptions = 0;
    for attempt in 1.. {
        let mut child = start(&stopped);
        sleep(Duration::from_millis(60 * attempt));
        if attempt % 2 == 0 {
            child.kill().unwrap();
        } else {
            let id = child.id().to_string();
            let sent = Command::new("kill").args(["-INT", &id]).status();
            assert!(sent.unwrap().success());
        }
        if child.wait().unwrap().success() {
            break;
        }
        interruptions += 1;
        // A part that is not finished is not merged.
        let merged = tdcr(&merge_arguments(from_ref(&stopped), &out)).output();
        let merged = merged.unwrap();
        if merged.status.success() {
            break;
        }
        let said = stderr(&merged);
        let reasons = ["part 1 of 1 unfinished: ", "expected a part of a data set"];
        assert!(reasons.iter().any(|reason| said.contains(reason)), "{said}");
        assert!(!out.exists());
    }
    assert!(interruptions > 0);
    assert!(start(&stopped).wait().unwrap().success());
    assert!(set_files(&stopped) == set_files(&whole));
}

#[test]
fn a_part_is_no_data_set_until_it_is_merged() {
    let folder = tempfile::tempdir().unwrap();
    let parts = collect_parts(folder.path(), 2, &[]);
    let part = text(&parts[0]);
    let run = folder.path().join("run");
    let expected = "part-1-of-2 holds part 1 of 2 of a data set; merge all 2 first; `tdcr data merge PARTS... --out DIR` puts them together";
    refuse(&["data", "info", part], 1, expected);
    refuse(&["data", "check", part], 1, expected);
    refuse(
        &[
            "data",
            "view",
            part,
            "--out",
            text(&run.with_extension("html")),
        ],
        1,
        expected,
    );
    let export = ["data", "export", part, "--format", "npz", "--out"];
    refuse(&[&export[..], &[text(&run)]].concat(), 1, expected);
    let train = [
        &crate::TINY_NETWORK[..],
        &["--data", part, "--out", text(&run)],
    ]
    .concat();
    refuse(&train, 1, expected);
    // Nor does it become one, or another part.
    let way_on = "of a data set, expected a whole data set; choose another folder";
    refuse(&[&SET[..], &["--out", part]].concat(), 1, way_on);
    refuse(&merge_arguments(&parts, &parts[0]), 1, way_on);
    refuse(
        &part_arguments("2/2", &parts[0], &[]),
        1,
        "holds part 1 of 2 of a data set, expected part 2 of 2 of a data set; choose another folder",
    );
    let other = part_arguments("1/2", &parts[0], &["--seed", "3"]);
    refuse(&other, 1, "its `seed` is 0, not 3; choose another folder");
    for wrong in ["0/2", "3/2", "2", "1/2/3", "a/b", "1/0"] {
        let expected = format!("`{wrong}` is no part, expected I/N");
        refuse(&part_arguments(wrong, &run, &[]), 2, &expected);
    }
    refuse(
        &merge_arguments(&parts, Path::new("set.h5")),
        1,
        "--out set.h5 is named like a file; expected a folder for the data set",
    );
    refuse(&["data", "merge", "--out", text(&run)], 2, "<PART>...");
}

#[test]
fn parts_that_do_not_belong_together_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let parts = collect_parts(folder.path(), 3, &[]);
    let [one, two, three] = [&parts[0], &parts[1], &parts[2]];
    let says = |parts: &[&PathBuf], expected: &str| {
        let parts: Vec<PathBuf> = parts.iter().map(|&part| part.clone()).collect();
        refuse(&merge_arguments(&parts, &out), 1, expected);
        assert!(!out.exists());
    };
    let missing = "1 of 3 parts is missing: 3; expected all 3; `tdcr collect --part I/3`";
    says(&[two, one], missing);
    says(
        &[one, two, three, one],
        "part-1-of-3 both hold part 1 of 3, expected each part once",
    );
    let other = |name: &str, part: &str, options: &[&str]| {
        let dir = folder.path().join(name);
        succeed(&part_arguments(part, &dir, options));
        dir
    };
    let of_four = other("of-four", "2/4", &[]);
    says(
        &[one, &of_four],
        "of-four holds a part of another data set than",
    );
    says(
        &[one, &of_four],
        "its `parts` is 4, not 3; expected parts collected with the same options",
    );
    let seeded = other("seeded", "2/3", &["--seed", "5"]);
    says(&[one, &seeded, three], "its `seed` is 5, not 0");
    let robot = other("robot", "2/3", &["--robot", "3m"]);
    says(
        &[one, &robot, three],
        "robot holds a part of another data set than",
    );
    let shown = other("shown", "2/3", &["--base"]);
    says(
        &[one, &shown, three],
        "its `origin.simulated.recipe.subject.base` is \"shown\", not \"hidden\"",
    );
    let older = other("older", "2/3", &[]);
    let file = older.join("part.json");
    let version = format!("\"{}\"", env!("CARGO_PKG_VERSION"));
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.contains(&version));
    fs::write(&file, text.replace(&version, "\"0.0.9\"")).unwrap();
    says(
        &[one, &older, three],
        "its `tdcr_version` is \"0.0.9\", not",
    );
    says(
        &[one, &folder.path().join("none")],
        "none holds nothing: there is no such folder",
    );
}
