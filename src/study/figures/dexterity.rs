//! Maps of dexterity.

use nalgebra::Vector3;

use crate::report::{HeatMap, HeatPanel, Spacing, StudyFigure};
use crate::study::outputs::dexterity::{BANDS, Dexterity, SECTORS};
use crate::study::outputs::workspace::bounds;

/// Places across the larger side of a map.
const ACROSS: f64 = 40.0;

/// Maps of the dexterity in the plane of the world's x and z axes through the middle of all tips, one for each named group.
pub(in crate::study) fn figure(groups: &[(String, Dexterity)], note: &str) -> Option<StudyFigure> {
    let radius = groups.first()?.1.radius;
    let places = groups.iter().flat_map(|(_, group)| &group.tips);
    let places: Vec<Vector3<f64>> = places.map(|tip| tip.place).collect();
    if places.is_empty() {
        return None;
    }
    let (low, high) = bounds(&places);
    let middle = (low.y + high.y) / 2.0;
    let step = ((high.x - low.x).max(high.z - low.z) / ACROSS).max(f64::MIN_POSITIVE);
    let along = |low: f64, high: f64| -> Vec<f64> {
        let count = ((high - low) / step).ceil() as usize + 1;
        (0..count).map(|k| low + k as f64 * step).collect()
    };
    let (across, up) = (along(low.x, high.x), along(low.z, high.z));
    let panel = |(name, group): &(String, Dexterity)| HeatPanel {
        title: name.clone(),
        values: (up.iter())
            .map(|z| {
                let share = |x: &f64| match group.at(&Vector3::new(*x, middle, *z)) {
                    (_, 0) => f64::NAN,
                    (share, _) => 100.0 * share,
                };
                across.iter().map(share).collect()
            })
            .collect(),
    };
    let millimetres = |values: &[f64]| values.iter().map(|x| 1e3 * x).collect();
    let map = HeatMap {
        title: "Dexterity".to_owned(),
        caption: format!(
            "Share of {} directions of equal solid angle in which the tip points under the sampled commands that bring it within \
             {:.0} mm of a place; the plane y = {:.0} mm. {note}",
            BANDS * SECTORS,
            1e3 * radius,
            1e3 * middle + 0.0
        ),
        x: ("x (mm)".to_owned(), millimetres(&across)),
        y: ("z (mm)".to_owned(), millimetres(&up)),
        value: "%".to_owned(),
        spacing: Spacing::Linear,
        panels: groups.iter().map(panel).collect(),
    };
    Some(StudyFigure {
        name: "dexterity".to_owned(),
        svg: map.to_svg(),
    })
}
