//! How the models of a study learned.

use super::axes::INKS;
use crate::report::{Aspect, Figure, Mark, Panel, Scale, Shape, Spacing, StudyFigure};
use crate::study::spec::Study;
use crate::study::spec::models::Models;

/// Square metres in the unit of the figures, as papers have it.
const AREA: f64 = 1e-4;

/// The Chamfer distance in validation over the steps of each model's training, where logs lay beside the models.
pub(super) fn figure(study: &Study) -> Option<StudyFigure> {
    let models = study.models.iter().flat_map(Models::all);
    let logged = models.filter(|(_, model)| model.validations.len() > 1);
    let marks: Vec<Mark> = (logged.zip(INKS))
        .map(|((path, model), ink)| Mark {
            name: path.trim_end_matches("/model.safetensors").to_owned(),
            shape: Shape::Line,
            ink,
            points: (model.validations.iter())
                .map(|(step, cd)| [*step as f64, cd / AREA])
                .collect(),
        })
        .collect();
    if marks.is_empty() {
        return None;
    }
    let figure = Figure {
        title: "Training".to_owned(),
        caption: "Chamfer distance on the validation clouds of each model's own data set, as its log tells.".to_owned(),
        panels: vec![Panel {
            title: String::new(),
            x: Scale::linear("Step"),
            y: Scale::Numbers {
                title: "Validation CD (10\u{207b}\u{2074} m\u{b2})".to_owned(),
                spacing: Spacing::Log,
            },
            aspect: Aspect::Free,
            marks,
        }],
    };
    Some(StudyFigure {
        name: "training".to_owned(),
        svg: figure.to_svg(),
    })
}
