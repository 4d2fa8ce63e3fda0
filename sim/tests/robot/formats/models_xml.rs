//! The models in `models_xml/`.

use std::path::PathBuf;

use tdcr_sim::formats::mjcf::{self, ExportOptions};
use tdcr_sim::formats::urdf;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::RobotSpec;

/// Set, it makes this test write the models again.
const WRITE: &str = "WRITE_MODELS";

#[test]
fn the_models_are_what_is_exported() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models_xml");
    for name in RobotSpec::STANDARD {
        let spec = RobotSpec::standard(name).unwrap();
        let model = |base| {
            let options = ExportOptions {
                base,
                ..ExportOptions::default()
            };
            mjcf::export(&spec, &options).unwrap()
        };
        for (file, text) in [
            (format!("{name}.xml"), model(BaseVisibility::Hidden)),
            (format!("{name}_base.xml"), model(BaseVisibility::Shown)),
            (format!("{name}.urdf"), urdf::export(&spec).unwrap()),
        ] {
            let path = folder.join(&file);
            if std::env::var_os(WRITE).is_some() {
                std::fs::write(&path, &text).unwrap();
            }
            let stored = std::fs::read_to_string(&path).unwrap();
            let [(stored, pose), (text, settled)] = [&stored, &text].map(|text| apart(text));
            let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-6;
            assert!(
                stored == text
                    && pose.len() == settled.len()
                    && pose.iter().zip(&settled).all(near),
                "{file} is not what is exported: run with {WRITE}=1"
            );
        }
    }
}

/// A text without the pose of its keyframe, and that pose: it is solved for, so its last digits are
/// those of the processor.
fn apart(text: &str) -> (String, Vec<f64>) {
    let Some((before, rest)) = text.split_once(" qpos=\"") else {
        return (text.to_owned(), Vec::new());
    };
    let (pose, after) = rest.split_once('"').unwrap();
    let pose = pose.split(' ').map(|number| number.parse().unwrap());
    (format!("{before}{after}"), pose.collect())
}
