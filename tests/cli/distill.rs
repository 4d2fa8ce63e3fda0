//! A network distilled to a few evaluations.

use crate::{COMMAND, collect_small, refuse, succeed_json, text, train_tiny};

#[test]
fn a_distilled_network_predicts_and_scores_with_its_own_steps_alone() {
    let folder = tempfile::tempdir().unwrap();
    let [data, run, fast] = ["data", "run", "fast"].map(|name| folder.path().join(name));
    collect_small(&data, &[]);
    train_tiny(&data, &run, &[]);
    let teacher = run.join("model.safetensors");
    let files = [
        "--model",
        text(&teacher),
        "--data",
        text(&data),
        "--out",
        text(&fast),
    ];
    let how = ["distill", "--steps", "20", "--evaluations", "3"];
    let distilled = succeed_json(&[&how[..], &files].concat());
    assert_eq!(distilled["evaluations"], 3);
    assert_eq!(distilled["precision"], "float32");
    assert!(distilled["validation_cd"].as_f64().unwrap() > 0.0);
    assert!(distilled["teacher_validation_cd"].as_f64().unwrap() > 0.0);

    let (model, cloud) = (
        fast.join("model.safetensors"),
        folder.path().join("cloud.ply"),
    );
    let predict = [
        "predict",
        "--command",
        COMMAND,
        "--points",
        "300",
        "--model",
        text(&model),
    ];
    let predict = [&predict[..], &["--out", text(&cloud)]].concat();
    assert_eq!(succeed_json(&predict)["points"], 300);
    let own = "the network was distilled for 3 evaluations by its own sampler";
    refuse(&[&predict[..], &["--sampler-steps", "16"]].concat(), 1, own);
    // How many points are drawn for a cloud is no part of that.
    let more = [&predict[..], &["--sampler-spare", "1"]].concat();
    assert_eq!(succeed_json(&more)["evaluations"], 3);
    let few = ["--points", "300", "--emd-points", "50"];
    let eval = ["eval", "--model", text(&model), "--data", text(&data)];
    assert!(
        succeed_json(&[&eval[..], &few].concat())["cd"]
            .as_f64()
            .unwrap()
            > 0.0
    );

    let again = ["distill", "--model", text(&model), "--data", text(&data)];
    refuse(
        &[&again[..], &["--out", text(&folder.path().join("again"))]].concat(),
        1,
        "the teacher's target is steps, expected velocity: a distilled network cannot teach",
    );
}
