//! `tdcr calibrate-cameras --check`: what a calibration leaves, seen on the robot itself.

use std::path::Path;

use anyhow::ensure;
use serde::Serialize;
use tdcr::hw::extrinsics::overlaps;
use tdcr::hw::mask::{MaskError, Masker, Shot};
use tdcr::hw::rig::{Pictures, Rig};
use tdcr::sim::render::RgbdFrame;

use super::console::Console;

/// Surfaces farther than this from a point are not its own (m): well above a depth camera's noise, well below a robot's
/// thickness.
const REACH: f64 = 0.01;

#[derive(Serialize)]
struct Checked {
    overlaps: Vec<PairOverlap>,
}

/// How far the points of one camera are from the surface that another one sees.
#[derive(Serialize)]
struct PairOverlap {
    points_of: String,
    surface_of: String,
    points: u32,
    /// Mean distance along the surface's normal, outside positive (m).
    mean: f64,
    /// Root mean square distance (m).
    rms: f64,
}

pub(super) fn run(file: &Path, console: &Console) -> anyhow::Result<()> {
    let mut rig = Rig::open(file)?;
    let serials: Vec<String> = (rig.cameras().iter())
        .map(|camera| camera.serial().to_owned())
        .collect();
    let count = serials.len();
    ensure!(
        count > 1,
        "{}: there are {count} cameras, expected two at least: pictures are compared with each other",
        file.display()
    );
    rig.warm_up()?;
    let masker = rig.masker()?;
    let frames = of_robot(&*masker, &rig.grab()?)?;
    let found: Vec<PairOverlap> = overlaps(&frames, REACH)
        .into_iter()
        .map(|overlap| PairOverlap {
            points_of: serials[overlap.points_of].clone(),
            surface_of: serials[overlap.surface_of].clone(),
            points: overlap.points,
            mean: overlap.mean,
            rms: overlap.rms,
        })
        .collect();
    ensure!(
        !found.is_empty(),
        "no two cameras see one place of the robot within {:.0} mm: is it in sight, do the masks keep it, are the poses right?",
        1e3 * REACH
    );
    console.result(&Checked { overlaps: found }, |checked| {
        let line = |pair: &PairOverlap| {
            format!(
                "{} from the surface of {}: {:+.2} mm on average, {:.2} mm rms ({} points)",
                pair.points_of,
                pair.surface_of,
                1e3 * pair.mean,
                1e3 * pair.rms,
                pair.points
            )
        };
        let lines: Vec<String> = checked.overlaps.iter().map(line).collect();
        lines.join("\n")
    })
}

/// The pictures without the depth of what is not the robot.
fn of_robot(masker: &dyn Masker, pictures: &Pictures) -> Result<Vec<RgbdFrame>, MaskError> {
    let frames = pictures.frames.iter().enumerate();
    frames
        .map(|(view, frame)| {
            let mask = masker.mask(&frame.value, Shot { view, sample: 0 })?;
            mask.applied(&frame.value)
        })
        .collect()
}
