//! Training that starts at the weights of a model, and the settings of its path.

use std::fs;
use std::path::Path;

use crate::{TINY_NETWORK, collect_small, refuse, text, train_tiny};

/// The header of a run's state, its quotes as they are escaped in the file.
fn header(run: &Path) -> String {
    String::from_utf8_lossy(&fs::read(run.join("state.safetensors")).unwrap()).into_owned()
}

fn loss_of_step_10(run: &Path) -> f64 {
    let log = fs::read_to_string(run.join("log.csv")).unwrap();
    let line = log.lines().nth(1).unwrap();
    let loss = line.strip_prefix("10,").unwrap().split(',').next();
    loss.unwrap().parse().unwrap()
}

#[test]
fn a_run_that_starts_at_a_model_is_taken_up_with_the_same_model_alone() {
    let folder = tempfile::tempdir().unwrap();
    let [data, first, second] = ["data", "first", "second"].map(|name| folder.path().join(name));
    collect_small(&data, &[]);
    train_tiny(&data, &first, &[]);
    let model = first.join("model.safetensors");
    let init = ["--init", text(&model), "--learning-rate", "0.002"];
    let trained = train_tiny(&data, &second, &init);
    assert!(header(&second).contains(r#"\"muon\":{\"learning_rate\":0.002}"#));
    assert_eq!(train_tiny(&data, &second, &init), trained);
    let [at_random, at_model] = [&first, &second].map(|run| loss_of_step_10(run));
    assert!(at_model < 0.7 * at_random, "{at_model} and {at_random}");

    let other = |init: &[&str], expected: &str| {
        let places = ["--data", text(&data), "--out", text(&second)];
        let rate = ["--learning-rate", "0.002"];
        let arguments = [&TINY_NETWORK[..], &places, &rate, init].concat();
        refuse(&arguments, 1, expected);
    };
    let another = second.join("model.safetensors");
    other(
        &[],
        "cannot be resumed: the training state is of another run: the start of the weights was \"network ",
    );
    other(
        &["--init", text(&another)],
        "the start of the weights was \"network ",
    );
}

#[test]
fn a_model_that_does_not_suit_the_run_is_no_start_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let set = |name: &str, options: &[&str]| {
        let data = folder.path().join(name);
        collect_small(&data, options);
        data
    };
    let data = set("data", &[]);
    let run = folder.path().join("run");
    // With symmetries, these would be what differs first.
    train_tiny(&data, &run, &["--symmetry", "none"]);
    let (model, never) = (run.join("model.safetensors"), folder.path().join("never"));
    let refused = |data: &Path, options: &[&str], expected: &str| {
        let places = ["--data", text(data), "--out", text(&never)];
        let init = ["--init", text(&model)];
        refuse(
            &[&TINY_NETWORK[..], &places, &init, options].concat(),
            1,
            expected,
        );
    };
    let head = "the run cannot start at the weights of this model: its ";
    let expect = |what: &str| format!("{head}{what}");
    refused(
        &data,
        &["--colors"],
        &expect("shape.channels is \"xyz\", expected \"xyz-rgb\""),
    );
    refused(
        &set("other", &["--seed", "1"]),
        &[],
        &expect("normalisation.motor_m"),
    );
    refused(
        &set("base", &["--base"]),
        &[],
        "the model was trained on clouds without the base, the data set shows clouds with the base",
    );
    let robot = ["--robot", "3m"];
    refused(
        &set("3m", &robot),
        &[],
        "the model is of robot `2m`, the data set of a different robot, `3m`",
    );
    let missing = ["--data", text(&data), "--init", "missing"];
    refuse(
        &[&TINY_NETWORK[..], &missing, &["--out", text(&never)]].concat(),
        1,
        "missing: cannot read",
    );
    assert!(!never.exists());
}

#[test]
fn coupling_and_flow_times_are_the_users_and_wrong_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    collect_small(&data, &[]);
    let path = |options: &[&str], expected: &str| {
        let run = folder
            .path()
            .join(expected.replace(|c: char| !c.is_alphanumeric(), "_"));
        train_tiny(&data, &run, options);
        assert!(
            header(&run).contains(&expected.replace('"', "\\\"")),
            "{expected}"
        );
    };
    path(
        &[],
        r#""coupling":"independent","late_times":0.5,"prior_cut":2.5,"prior_deviation":0.5,"time_exponent":3.0"#,
    );
    path(
        &[
            &["--coupling", "optimal-transport:7", "--time-exponent", "1"][..],
            &["--late-times", "0", "--prior-cut", "0"],
        ]
        .concat(),
        r#""coupling":{"optimal-transport":{"batch":7}},"late_times":0.0,"prior_cut":null,"prior_deviation":0.5,"time_exponent":1.0"#,
    );
    path(
        &["--coupling", "optimal-transport"],
        r#"{"optimal-transport":{"batch":32}}"#,
    );

    let never = folder.path().join("never");
    let refused = |options: &[&str], status: i32, expected: &str| {
        let places = ["--data", text(&data), "--out", text(&never)];
        refuse(
            &[&TINY_NETWORK[..], &places, options].concat(),
            status,
            expected,
        );
    };
    let forms = "expected independent, optimal-transport or optimal-transport:K";
    for wrong in [
        "any",
        "optimal-transport:",
        "optimal-transport:-3",
        "independent:4",
    ] {
        refused(&["--coupling", wrong], 2, forms);
    }
    let one = "the coupling's batch is 1, expected 2 to 256";
    refused(&["--coupling", "optimal-transport:1"], 2, one);
    refused(
        &["--time-exponent", "0"],
        1,
        "time_exponent is 0, expected a positive number",
    );
    refused(
        &["--late-times", "2"],
        1,
        "late_times is 2, expected a share, 0 to 1",
    );
    refused(
        &["--prior-cut", "0.5"],
        1,
        "prior_cut is 0.5, expected 1 or more deviations",
    );
    refused(
        &["--condition-blocks", "65"],
        1,
        "condition_blocks is 65, expected 0 to 64",
    );
    refused(&["--octaves", "13"], 1, "octaves is 13, expected 0 to 12");
    refused(
        &["--time-exponent", "-1"],
        1,
        "time_exponent is -1, expected a positive number",
    );
}
