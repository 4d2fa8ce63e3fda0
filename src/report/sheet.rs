//! Pictures of several examples in one PNG file, with labels.

use super::Example;
use super::color_scale::{ColorScale, color_at};
use super::lettering::{LETTER, text_width, write};
use super::picture::{BAR_COLOR, BAR_THICKNESS, BORDER, Framing, Subject};
use super::raster::Image;
use tdcr_sim::cloud::PointCloud;

/// Space between panels (pixels).
const GAP: usize = 8;
/// Height of a line of labels.
const LINE: usize = LETTER[1] + 10;
/// Width and height of a colour bar.
const COLOR_BAR: [usize; 2] = [120, 14];
const INK: [u8; 3] = [0x1c, 0x21, 0x28];

/// PNG of examples side by side: a column for each under its label, with the true cloud in its own colours, the
/// prediction (vermilion) against the truth (blue), the error of each predicted point in colour, where it is known, and
/// the cloud of the nearest training command (purple) against the truth; where the outlines of both agree, they are grey.
/// Each row says what it shows.
///
/// Each panel is `panel_width` pixels wide (at least 80). Each column is seen across its plane of
/// bending; all panels have one scale, that of the bar at their lower left, whose length (m) is
/// [`scale_bar`]. No example gives one white panel.
pub fn contact_sheet(examples: &[Example], panel_width: usize) -> Vec<u8> {
    let framing = Framing::of(examples, panel_width);
    let mut subjects = framing.subjects();
    subjects.retain(|subject| *subject != Subject::Uncertainty);
    let (width, height) = (framing.frame.width + GAP, framing.frame.height + LINE + GAP);
    let mut sheet = Image::white(
        examples.len().max(1) * width - GAP,
        LINE + subjects.len() * height - GAP,
    );
    for (column, example) in examples.iter().enumerate() {
        // A label that is too long for its column is cut.
        let letters = framing.frame.width / LETTER[0];
        let label: String = example.label.chars().take(letters).collect();
        write(&mut sheet, [column * width, 0], &label, INK);
    }
    for (row, &subject) in subjects.iter().enumerate() {
        let top = LINE + row * height;
        let name = match subject {
            Subject::Truth => "true cloud",
            Subject::Prediction => "prediction against the true cloud",
            Subject::Error => "error of the prediction",
            Subject::Uncertainty => "uncertainty of the prediction",
            Subject::Nearest => "cloud of the nearest training command against the true cloud",
        };
        write(&mut sheet, [0, top], name, INK);
        if let Some(scale) = framing.scale(subject) {
            color_bar(&mut sheet, [text_width(name) + 3 * LETTER[0], top], scale);
        }
        for (column, example) in examples.iter().enumerate() {
            let picture = labelled(&framing, example, subject);
            sheet.paste(&picture, column * width, top + LINE);
        }
    }
    sheet.to_png()
}

/// PNG of clouds in their own colours, row by row with `columns` in each: as [`contact_sheet`], and with the length (m) of
/// its scale bars.
pub fn cloud_sheet(clouds: &[PointCloud], columns: usize, panel_width: usize) -> (Vec<u8>, f64) {
    let alone = |cloud: &PointCloud| Example {
        truth: cloud.clone(),
        ..Example::default()
    };
    let examples: Vec<Example> = clouds.iter().map(alone).collect();
    let framing = Framing::of(&examples, panel_width);
    let (width, height) = (framing.frame.width + GAP, framing.frame.height + GAP);
    let columns = columns.clamp(1, examples.len().max(1));
    let rows = examples.len().div_ceil(columns).max(1);
    let mut sheet = Image::white(columns * width - GAP, rows * height - GAP);
    for (k, example) in examples.iter().enumerate() {
        let picture = labelled(&framing, example, Subject::Truth);
        sheet.paste(&picture, k % columns * width, k / columns * height);
    }
    (sheet.to_png(), framing.bar)
}

/// Length (m) of the scale bar in the [`contact_sheet`] of the same arguments.
pub fn scale_bar(examples: &[Example], panel_width: usize) -> f64 {
    Framing::of(examples, panel_width).bar
}

/// A picture of an example with the length beside its scale bar.
fn labelled(framing: &Framing, example: &Example, subject: Subject) -> Image {
    let mut picture = framing.picture(example, subject);
    let x = BORDER as usize + (framing.bar / framing.frame.metres_per_pixel).round() as usize + 8;
    // Half of a capital's height above the middle of the bar.
    let middle = picture.height - BORDER as usize - BAR_THICKNESS / 2;
    let y = middle.saturating_sub(LETTER[1] / 2 + 1);
    let length = length_text(framing.bar);
    write(&mut picture, [x, y], &length, BAR_COLOR);
    picture
}

/// The colours from zero to the last, with the lengths of both.
fn color_bar(sheet: &mut Image, [x, y]: [usize; 2], scale: ColorScale) {
    let mut bar = Image::white(COLOR_BAR[0], COLOR_BAR[1]);
    for (k, pixel) in bar.rgb.chunks_exact_mut(3).enumerate() {
        let column = k % COLOR_BAR[0];
        pixel.copy_from_slice(&color_at(column as f64 / (COLOR_BAR[0] - 1) as f64));
    }
    write(sheet, [x, y], "0", INK);
    let start = x + 2 * LETTER[0];
    sheet.paste(&bar, start, y + (LETTER[1] - COLOR_BAR[1]) / 2);
    let end = format!("{} or more", length_text(scale.top));
    write(sheet, [start + COLOR_BAR[0] + LETTER[0], y], &end, INK);
}

/// A round length (m) in the unit in which one would say it.
fn length_text(length: f64) -> String {
    // Rounded to what a mark has: one digit.
    match length {
        x if x >= 0.9 => format!("{} m", x.round()),
        x if x >= 9e-3 => format!("{} cm", (100.0 * x).round()),
        x if x >= 9e-4 => format!("{} mm", (1e3 * x).round()),
        x => format!("{} um", (1e6 * x).round()),
    }
}

#[cfg(test)]
mod tests {
    use super::length_text;

    #[test]
    fn lengths_are_said_in_fitting_units() {
        let said = [1.0, 0.05, 0.1, 5e-3, 2e-4].map(length_text);
        assert_eq!(said, ["1 m", "5 cm", "10 cm", "5 mm", "200 um"]);
    }
}
