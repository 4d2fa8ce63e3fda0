//! What `tdcr eval` says of a network, as JSON, as tables and as a page.

use serde_json::Value;

use crate::{collect_small, eval_small, stderr, succeed, succeed_json, tdcr, text, train_tiny};

const QUANTILES: [&str; 7] = ["min", "p5", "p25", "median", "p75", "p95", "max"];

/// A folder with a small data set of four test commands, and the arguments that score a network trained on it.
fn trained(options: &[&str]) -> (tempfile::TempDir, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    let size = ["collect", "--samples", "40", "--points", "400"];
    succeed_json(&[&size[..], &["--out", text(&data)], options].concat());
    let trained = train_tiny(&data, &run, &[]);
    let model = trained["model"].as_str().unwrap();
    let arguments = eval_small(model, &data).map(str::to_owned).into();
    (folder, arguments)
}

fn with<'a>(arguments: &'a [String], more: &[&'a str]) -> Vec<&'a str> {
    arguments
        .iter()
        .map(String::as_str)
        .chain(more.iter().copied())
        .collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn quantiles_and_worst_tests_agree_with_the_means() {
    let (_folder, arguments) = trained(&["--payload", "0:0.03"]);
    let scores = succeed_json(&with(&arguments, &["--worst", "9"]));
    let worst = scores["worst"].as_array().unwrap();
    assert_eq!(worst.len(), 4);
    for key in ["cd", "emd", "emd_squared"] {
        let values: Vec<f64> = worst.iter().map(|test| number(&test[key])).collect();
        let mean = values.iter().sum::<f64>() / 4.0;
        assert!((mean / number(&scores[key]) - 1.0).abs() < 1e-12, "{key}");
        let quantiles = QUANTILES.map(|name| number(&scores["network_quantiles"][key][name]));
        assert!(quantiles.is_sorted(), "{key}: {quantiles:?}");
        assert_eq!(
            quantiles[0],
            values.iter().copied().fold(f64::MAX, f64::min)
        );
        assert_eq!(quantiles[6], values.iter().copied().fold(0.0, f64::max));
        let mut sorted = values;
        sorted.sort_by(f64::total_cmp);
        assert!((quantiles[3] / (0.5 * (sorted[1] + sorted[2])) - 1.0).abs() < 1e-12);
    }
    assert!(worst.is_sorted_by(|a, b| number(&a["cd"]) >= number(&b["cd"])));
    let mut tests: Vec<u64> = worst.iter().map(|t| t["test"].as_u64().unwrap()).collect();
    tests.sort_unstable();
    assert_eq!(tests, [0, 1, 2, 3]);
    for test in worst {
        assert_eq!(test["command"].as_array().unwrap().len(), 6);
        assert!((0.0..=0.031).contains(&number(&test["payload"])));
        // The mean of squares is no less than the square of the mean.
        assert!(number(&test["emd_squared"]) >= number(&test["emd"]).powi(2));
    }
    // What is scored of a test command does not depend on how many are.
    let first = succeed_json(&with(&arguments, &["--tests", "3", "--worst", "9"]));
    let among_first = |test: &&Value| test["test"].as_u64().unwrap() < 3;
    let expected: Vec<_> = worst.iter().filter(among_first).collect();
    assert_eq!(
        first["worst"]
            .as_array()
            .unwrap()
            .iter()
            .collect::<Vec<_>>(),
        expected
    );
    assert_eq!(first["tests"], 3);
    let two = succeed_json(&with(&arguments, &["--worst", "2"]));
    assert_eq!(two["worst"].as_array().unwrap()[..], worst[..2]);
}

#[test]
fn the_matchings_behind_the_scores_are_proven_optimal() {
    let (_folder, arguments) = trained(&[]);
    let scores = succeed_json(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    for (gap, value) in [
        ("emd_gap", "emd_floor"),
        ("emd_squared_gap", "emd_squared_floor"),
    ] {
        let share = number(&scores[gap]) / number(&scores[value]);
        assert!((0.0..1e-9).contains(&share), "{gap}: {share}");
    }
}

#[test]
fn clouds_that_repeat_points_say_how_many_are_distinct() {
    let said = |options: &[&str]| {
        let (_folder, arguments) = trained(options);
        let scored = succeed_json(&with(&arguments, &[]));
        let table = succeed(&with(&arguments, &["--quiet"]));
        let [all, distinct] =
            ["true_points", "distinct_true_points"].map(|key| number(&scored[key]));
        assert_eq!(all, 400.0);
        (distinct, table.contains("are distinct on average"))
    };
    assert_eq!(said(&[]), (400.0, false));
    // The robot's surface in voxels of 3 cm.
    let (distinct, told) = said(&["--voxel", "0.03"]);
    assert!(told && (10.0..200.0).contains(&distinct), "{distinct}");
}

#[test]
fn tables_show_quantiles_and_the_worst_commands() {
    let (_folder, arguments) = trained(&[]);
    let table = succeed(&with(&arguments, &["--quiet", "--worst", "1"]));
    for expected in [
        "sq. EMD (1e-4 m²)",
        "median",
        "worst: test",
        "--command 0.0",
        "duality gaps are at most",
        "of 18 evaluations of the network each",
    ] {
        assert!(table.contains(expected), "{expected}\n{table}");
    }
    assert_eq!(table.matches("--command").count(), 1);
    let scores = succeed_json(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let emd = format!("{:.3}", 1e3 * number(&scores["emd"]));
    assert!(table.contains(&emd), "{emd}\n{table}");
}

#[test]
fn scores_say_how_well_the_uncertainty_tells_the_error() {
    let (folder, arguments) = trained(&[]);
    let scores = succeed_json(&with(&arguments, &["--worst", "9"]));
    for key in ["uncertainty_rank_points", "uncertainty_rank_commands"] {
        assert!((-1.0..=1.0).contains(&number(&scores[key])), "{key}");
    }
    assert!((0.0..=1.0).contains(&number(&scores["uncertainty_coverage"])));
    // What `predict` says of the test commands, with the seeds of their clouds, averages to the same.
    let out = folder.path().join("cloud.npz");
    let model = arguments[2].as_str();
    let mut pairs: Vec<(f64, f64)> = Vec::new();
    for test in scores["worst"].as_array().unwrap() {
        let command: Vec<String> = test["command"]
            .as_array()
            .unwrap()
            .iter()
            .map(Value::to_string)
            .collect();
        let (command, seed) = (command.join(","), test["test"].to_string());
        let options = [
            "--command",
            &command,
            "--seed",
            &seed,
            "--points",
            "400",
            "--out",
            text(&out),
        ];
        succeed_json(&[&["predict", "--model", model], &options[..]].concat());
        pairs.push((
            mean_uncertainty(&std::fs::read(&out).unwrap()),
            number(&test["cd"]),
        ));
    }
    let mean = pairs.iter().map(|pair| pair.0).sum::<f64>() / 4.0;
    assert!(
        (number(&scores["uncertainty"]) / mean - 1.0).abs() < 1e-4,
        "{mean}"
    );
    // Spearman's formula without ties; the pairs are sorted by distance, the greatest first.
    let squares: f64 = (pairs.iter().enumerate())
        .map(|(k, pair)| {
            (pairs.iter().filter(|other| other.0 > pair.0).count() as f64 - k as f64).powi(2)
        })
        .sum();
    let expected = 1.0 - 6.0 * squares / 60.0;
    assert!((number(&scores["uncertainty_rank_commands"]) - expected).abs() < 1e-12);
    let file = folder.path().join("scores.html");
    let table = succeed(&with(&arguments, &["--quiet", "--report", text(&file)]));
    let page = std::fs::read_to_string(&file).unwrap();
    let said = format!("{:.3} mm on average", 1e3 * mean);
    assert!(table.contains(&said) && page.contains(&said), "{table}");
}

/// Mean of the 400 numbers (m) that the last array of a predicted archive holds.
fn mean_uncertainty(archive: &[u8]) -> f64 {
    let header = b"'shape': (400, ), }";
    let place = archive
        .windows(header.len())
        .position(|w| w == header)
        .unwrap();
    let start = place
        + archive[place..]
            .iter()
            .position(|&byte| byte == b'\n')
            .unwrap()
        + 1;
    let values = archive[start..start + 1600].as_chunks().0.iter();
    values
        .map(|&bytes| f64::from(f32::from_le_bytes(bytes)))
        .sum::<f64>()
        / 400.0
}

#[test]
fn the_report_is_a_page_of_its_own_that_shows_the_worst_tests() {
    let (folder, arguments) = trained(&[]);
    let file = folder.path().join("scores.html");
    let options = ["--report", text(&file), "--worst", "1"];
    let scores = succeed_json(&with(&arguments, &options));
    let page = std::fs::read_to_string(&file).unwrap();
    let worst = scores["worst"][0]["test"].as_u64().unwrap();
    assert!(page.contains(&format!("<h3>test {worst}, the worst</h3>")));
    let ratio = format!(
        "<td>{:.1}</td>",
        number(&scores["cd"]) / number(&scores["cd_floor"])
    );
    let row = page.split("Network</th>").nth(1).unwrap();
    assert!(row.split("</tr>").next().unwrap().contains(&ratio));
    // Truth, prediction, its error and uncertainty, and nearest of one test.
    assert_eq!(page.matches("<img ").count(), 5);
    // All test commands: in a plot of their distances, in one over those to the training commands, and in the maps over pairs of
    // motors of both modules.
    assert_eq!(page.matches("<svg ").count(), 1 + 1 + 2);
    // The name of a language, which nothing loads.
    let page = page.replace(" xmlns=\"http://www.w3.org/2000/svg\"", "");
    assert!(!page.contains("http:") && !page.contains("https:") && !page.contains("Training</h2>"));
}

#[test]
fn scores_say_what_precision_they_were_reached_in() {
    let folder = tempfile::tempdir().unwrap();
    let [data, run, file] = ["data", "run", "scores.html"].map(|name| folder.path().join(name));
    collect_small(&data, &[]);
    let size = [
        "train",
        "--width",
        "32",
        "--depth",
        "2",
        "--embedding",
        "16",
    ];
    let length = ["--steps", "4", "--precision", "bfloat16"];
    let places = ["--data", text(&data), "--out", text(&run)];
    let trained = succeed_json(&[&size[..], &length, &places].concat());
    assert_eq!(trained["precision"], "bfloat16");
    let model = trained["model"].as_str().unwrap();
    let eval = eval_small(model, &data);
    let options = ["--report", text(&file), "--precision", "float32"];
    let scores = succeed_json(&[&eval[..], &options].concat());
    assert_eq!(
        [&scores["precision"], &scores["training_precision"]],
        ["float32", "bfloat16"]
    );
    let page = std::fs::read_to_string(&file).unwrap();
    assert!(page.contains("float32 in prediction, bfloat16 in training"));
    let scores = succeed_json(&[&eval[..], &["--precision", "bfloat16"]].concat());
    assert_eq!(scores["precision"], "bfloat16");
}

/// Other cameras see the base in another density, and that alone would put the floor where the nearest command is.
#[test]
fn the_floor_of_a_set_with_a_base_is_below_other_commands() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    let size = ["collect", "--samples", "40", "--points", "2000", "--base"];
    succeed_json(&[&size[..], &["--out", text(&data)]].concat());
    let trained = train_tiny(&data, &run, &[]);
    let model = trained["model"].as_str().unwrap();
    let eval = ["eval", "--model", model, "--data", text(&data)];
    let points = ["--points", "2000", "--emd-points", "400"];
    let scores = succeed_json(&[&eval[..], &points].concat());
    let [floor, nearest] = ["emd_squared_floor", "emd_squared_nearest"].map(|k| number(&scores[k]));
    assert!(
        floor < 0.5 * nearest,
        "floor {floor} m^2, nearest {nearest} m^2"
    );
}

#[test]
fn a_report_that_cannot_be_written_takes_no_scores_with_it() {
    let (folder, arguments) = trained(&[]);
    let nowhere = folder.path().join("no/folder.html");
    let options = ["--report", text(&nowhere), "--json"];
    let output = tdcr(&with(&arguments, &options)).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("cannot write"));
    let scores: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(number(&scores["cd"]) > 0.0);
}

/// A grid moved by half a voxel, near the worst phase of two regular samplings, differs by 2.0e-6 m^2, whatever the command;
/// random phases by 1.4e-6 on average, independent points by 1.6e-6 to 1.7e-6 (found by an independent program).
#[test]
fn the_floor_is_of_random_phases_and_a_perfect_predictor_is_shown_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let [data, run, page] = ["data", "run", "scores.html"].map(|name| folder.path().join(name));
    let size = ["collect", "--samples", "30", "--points", "10000"];
    succeed_json(&[&size[..], &["--out", text(&data)]].concat());
    let trained = train_tiny(&data, &run, &[]);
    let model = trained["model"].as_str().unwrap();
    let eval = ["eval", "--model", model, "--data", text(&data)];
    let eval = [&eval[..], &["--emd-points", "50", "--tests", "3"]].concat();
    let scores = succeed_json(&eval);
    let keys = ["cd_floor", "cd_perfect", "cd_perfect_selected"];
    let [floor, perfect, selected] = keys.map(|key| number(&scores[key]));
    assert!((1.2e-6..1.7e-6).contains(&floor), "{floor}");
    assert!((1.45e-6..1.75e-6).contains(&perfect), "{perfect}");
    // 1.44 on 25 commands of another set, by the same program.
    assert!((1.3e-6..1.55e-6).contains(&selected), "{selected}");
    assert!(selected < 0.97 * perfect, "{selected}, {perfect}");
    let table = succeed(&[&eval[..], &["--quiet", "--report", text(&page)]].concat());
    let row = |name: &str| {
        let row = table.lines().find(|line| line.starts_with(name)).unwrap();
        row.split_whitespace().last().unwrap().to_owned()
    };
    assert_eq!(row("perfect predictor"), format!("{:.1}", perfect / floor));
    assert_eq!(
        row("perfect, evenly spread"),
        format!("{:.1}", selected / floor)
    );
    let page = std::fs::read_to_string(&page).unwrap();
    assert!(page.contains("Perfect predictor</th>"));
}
