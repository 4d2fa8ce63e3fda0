//! Figures of hysteresis loops.

use super::axes::INKS;
use crate::report::{Aspect, Figure, Mark, Panel, Scale, Shape, StudyFigure};
use crate::study::outputs::tip_loop::TipLoop;
use crate::study::spec::case;
use crate::study::spec::cases::Cases;
use crate::study::spec::variable::{Target, phrase};
use crate::study::spec::{Levels, Study};

/// The loops of some values of one variable, the coefficient of friction where it varies, each under the first values of the
/// others and the first sampled command; none where none settles.
pub(super) fn figure(study: &Study, cases: &Cases, note: &str) -> Option<StudyFigure> {
    let of_friction = |levels: &Levels| levels.what.target == Target::Friction;
    let varied = study.levels.iter().position(of_friction).unwrap_or(0);
    let values = study.levels.get(varied).map_or(1, |l| l.values.len());
    // How many combinations further the variable's next value is.
    let behind = study.levels.iter().skip(varied + 1);
    let stride: usize = behind.map(|levels| levels.values.len()).product();
    let drawn = values.min(INKS.len());
    let marks: Vec<Mark> = (0..drawn)
        .filter_map(|k| {
            // The first, the last, and others evenly between.
            let which = stride * (k * (values - 1) / (drawn - 1).max(1));
            let case = cases.case(which * study.samples());
            let robot = case::robot(study, &case.settings).ok()?;
            let command = case::command(&robot, &case.settings, case.command.as_deref()).ok()?;
            let loads = case::loads(&robot, &case.settings).ok()?;
            let scene = case::scene(study, &case.settings).ok()?;
            let found = TipLoop::new((&robot, &scene), &command, &loads, study.hysteresis)?;
            let course = found.course();
            Some(Mark {
                name: phrase(cases.levels(which).get(varied..=varied).unwrap_or_default()),
                shape: Shape::Line,
                ink: INKS[k],
                points: course.iter().map(|[x, y]| [1e3 * x, 1e3 * y]).collect(),
            })
        })
        .collect();
    if marks.is_empty() {
        return None;
    }
    let unit = match study.command_unit() {
        "m" => "mm",
        _ => "10\u{207b}\u{b3} of its unit",
    };
    let mut others = cases.levels(0);
    others.retain(|(what, _)| study.levels.get(varied).is_some_and(|l| l.what != **what));
    let others = match phrase(&others) {
        none if none.is_empty() => none,
        others => format!(" All with {others}."),
    };
    let figure = Figure {
        title: "Hysteresis loops".to_owned(),
        caption: format!(
            "The tip as the command of tendon {} goes out and back: its displacement along the line from the start to the turn.{others} \
             {note}",
            study.hysteresis.tendon + 1
        ),
        panels: vec![Panel {
            title: String::new(),
            x: Scale::linear(&format!(
                "Command of tendon {} ({unit})",
                study.hysteresis.tendon + 1
            )),
            y: Scale::linear("Displacement of the tip (mm)"),
            aspect: Aspect::Free,
            marks,
        }],
    };
    Some(StudyFigure {
        name: "hysteresis-loops".to_owned(),
        svg: figure.to_svg(),
    })
}
