//! What is of some colours.

use serde::{Deserialize, Serialize};
use tdcr_sim::render::RgbdFrame;

use super::{Mask, MaskError, Masker, Shot};

/// Pixels whose colours lie in a range of hue, saturation and value (HSV), bounds included. Light and shade change the value
/// most.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorKey {
    /// From and to (degrees, red at 0, green at 120, blue at 240); from above to, the range goes through 360. Colours without
    /// saturation have the hue 0.
    pub hue: [f64; 2],
    /// From and to, of 0 (grey) to 1.
    pub saturation: [f64; 2],
    /// From and to, of 0 (black) to 1.
    pub value: [f64; 2],
}

impl ColorKey {
    /// Colours that are clearly no grey, of any hue.
    pub fn saturated(least: f64) -> Self {
        Self {
            hue: [0.0, 360.0],
            saturation: [least, 1.0],
            value: [0.0, 1.0],
        }
    }

    /// Whether a colour (8-bit RGB) is in the range.
    pub fn contains(&self, color: [u8; 3]) -> bool {
        let within = |[from, to]: [f64; 2], x: f64| (from..=to).contains(&x);
        let [hue, saturation, value] = hsv(color);
        let [from, to] = self.hue;
        let hue_fits = match from <= to {
            true => within(self.hue, hue),
            false => hue >= from || hue <= to,
        };
        hue_fits && within(self.saturation, saturation) && within(self.value, value)
    }
}

/// Hue (degrees), saturation and value (0 to 1) of a colour: Foley et al., Computer Graphics, 13.3.4.
fn hsv(color: [u8; 3]) -> [f64; 3] {
    let [r, g, b] = color.map(|channel| f64::from(channel) / 255.0);
    let value = r.max(g).max(b);
    let chroma = value - r.min(g).min(b);
    if chroma == 0.0 {
        return [0.0, 0.0, value];
    }
    let sixths = if value == r {
        ((g - b) / chroma).rem_euclid(6.0)
    } else if value == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    [60.0 * sixths, chroma / value, value]
}

impl Masker for ColorKey {
    fn mask(&self, frame: &RgbdFrame, _: Shot) -> Result<Mask, MaskError> {
        Ok(Mask::of_frame(frame, |index| {
            self.contains(frame.color[index])
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hues_saturations_and_values_are_those_of_textbooks() {
        for (color, expected) in [
            ([255, 0, 0], [0.0, 1.0, 1.0]),
            ([0, 255, 0], [120.0, 1.0, 1.0]),
            ([0, 0, 255], [240.0, 1.0, 1.0]),
            ([255, 0, 128], [329.882, 1.0, 1.0]),
            ([128, 64, 64], [0.0, 0.5, 0.502]),
            ([0, 0, 0], [0.0, 0.0, 0.0]),
            ([255, 255, 255], [0.0, 0.0, 1.0]),
        ] {
            let found = hsv(color);
            let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f64::max) < 1e-3, "{color:?}: {found:?}");
        }
    }

    #[test]
    fn ranges_of_hues_may_go_through_red() {
        let reds = ColorKey {
            hue: [330.0, 30.0],
            ..ColorKey::saturated(0.5)
        };
        assert!(reds.contains([255, 0, 20]) && reds.contains([255, 20, 0]));
        assert!(!reds.contains([0, 255, 0]) && !reds.contains([200, 190, 190]));
    }
}
