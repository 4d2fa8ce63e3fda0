//! How a rig's file tells the robot from what else the cameras see.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::RigError;
use crate::mask::{BackgroundSetting, ColorKey, WorkspaceBox};

/// How the robot is told from what else the cameras see: a pixel has to pass all that is given. Of what is left, components may
/// be kept. Tables nest in `any` and `not`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MasksSpec {
    /// The robot is within this box.
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    pub workspace: Option<WorkspaceBox>,
    /// The robot has these colours.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<ColorKey>,
    /// The robot is nearer than the empty scene was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<BackgroundSpec>,
    /// The robot passes at least one of these.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub any: Vec<MasksSpec>,
    /// The robot does not pass this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not: Option<Box<MasksSpec>>,
    /// Of what is left, the robot is all that hangs together and is not small.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub components: Option<ComponentsSpec>,
    /// Of what is left, the robot is the largest that hangs together.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest: Option<LargestSpec>,
}

/// The empty scene, as `tdcr background` records it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BackgroundSpec {
    /// The log of its pictures, from the rig file's folder.
    pub log: PathBuf,
    /// The robot is nearer by so many standard deviations of a pixel's depth.
    #[serde(default = "deviations")]
    pub deviations: f64,
    /// And by so much (m) than the pixel ever was.
    #[serde(default = "margin")]
    pub margin: f64,
}

fn deviations() -> f64 {
    BackgroundSetting::default().deviations
}

fn margin() -> f64 {
    BackgroundSetting::default().margin
}

/// What hangs together and is not small.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ComponentsSpec {
    /// Fewest pixels.
    pub pixels: usize,
    /// Pixels hang together over gaps of so many others.
    pub gap: u32,
}

/// What hangs together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LargestSpec {
    /// Pixels hang together over gaps of so many others.
    pub gap: u32,
}

/// How far from the world's origin a box may reach (m): farther than any depth camera sees.
const WORLD: f64 = 100.0;

impl MasksSpec {
    /// Refuses values that make no sense, those of the table `field` of a rig whose cameras have pictures of these widths and
    /// heights.
    pub(super) fn check(&self, field: &str, cameras: &[[u32; 2]]) -> Result<(), RigError> {
        let within = |name: String, [low, high]: [f64; 2], [least, most]: [f64; 2]| {
            let fits = least <= low && low <= high && high <= most;
            let expected = format!("two numbers of {least} to {most}, the smaller first");
            let found = format!("[{low}, {high}]");
            fits.then_some(())
                .ok_or_else(|| RigError::field(name, found, expected))
        };
        if let Some(bounds) = self.workspace {
            for axis in 0..3 {
                let [low, high] = [bounds.low[axis], bounds.high[axis]];
                let bounded = low.abs() <= WORLD && high.abs() <= WORLD;
                if !(bounded && low < high) {
                    let found = format!("{low} to {high} along axis {axis}");
                    let expected = format!("low below high, both within {WORLD} m");
                    return Err(RigError::field(format!("{field}.box"), found, expected));
                }
            }
        }
        if let Some(color) = self.color {
            // A range of hues may go through 360.
            let [from, to] = color.hue;
            let hue = [from.min(to), from.max(to)];
            within(format!("{field}.color.hue"), hue, [0.0, 360.0])?;
            let unit = [0.0, 1.0];
            within(format!("{field}.color.saturation"), color.saturation, unit)?;
            within(format!("{field}.color.value"), color.value, unit)?;
        }
        if let Some(background) = &self.background {
            for (name, value, most) in [
                ("deviations", background.deviations, 100.0),
                ("margin", background.margin, 1.0),
            ] {
                if !(0.0..=most).contains(&value) {
                    let name = format!("{field}.background.{name}");
                    return Err(RigError::field(name, value, format!("0 to {most}")));
                }
            }
            if cameras.is_empty() {
                let (name, log) = (format!("{field}.background"), background.log.display());
                let expected = "a background only where there are cameras";
                return Err(RigError::field(name, log, expected));
            }
        }
        if let (Some(_), Some(_)) = (self.components, self.largest) {
            let found = "there beside largest";
            let expected = "one of components and largest";
            let name = format!("{field}.components");
            return Err(RigError::field(name, found, expected));
        }
        // A gap as large as a picture parts nothing, and no component has more pixels than it.
        let side = cameras.iter().flatten().min().copied();
        let pixels = (cameras.iter()).map(|&[width, height]| width as usize * height as usize);
        let pixels = pixels.min().unwrap_or(usize::MAX);
        let gaps = [
            (
                "components",
                self.components.map(|components| components.gap),
            ),
            ("largest", self.largest.map(|largest| largest.gap)),
        ];
        for (name, gap) in gaps {
            if let (Some(gap), Some(side)) = (gap, side)
                && gap >= side
            {
                let expected = format!("0 to {}: pictures have a side of {side} pixels", side - 1);
                return Err(RigError::field(
                    format!("{field}.{name}.gap"),
                    gap,
                    expected,
                ));
            }
        }
        if let Some(found) = self.components.map(|components| components.pixels)
            && found > pixels
        {
            let expected = format!("no more than {pixels}, those of a picture");
            return Err(RigError::field(
                format!("{field}.components.pixels"),
                found,
                expected,
            ));
        }
        let nested = self.any.iter().enumerate();
        let nested = nested.map(|(k, masks)| (format!("{field}.any[{k}]"), masks));
        let not = (self.not.iter()).map(|masks| (format!("{field}.not"), &**masks));
        for (field, masks) in nested.chain(not) {
            if *masks == Self::default() {
                let expected = "a table with one at least of box, color, background, any, not, \
                                components and largest";
                return Err(RigError::field(field, "empty", expected));
            }
            masks.check(&field, cameras)?;
        }
        Ok(())
    }
}
