//! Pictures of examples: one view per example, one scale for all.

use super::Example;
use super::axis::mark_at_or_below;
use super::raster::{Frame, Image, Layer, Paint, View, render};
use tdcr_sim::cloud::PointCloud;

/// Colours of the true, the predicted and the nearest cloud where they stand alone: blue, vermilion
/// and a purple, told apart with any colour vision (after Okabe and Ito, 2008).
pub(crate) const TRUTH: [u8; 3] = [0x00, 0x72, 0xb2];
pub(crate) const PREDICTION: [u8; 3] = [0xd5, 0x5e, 0x00];
pub(crate) const NEAREST: [u8; 3] = [0xc4, 0x6a, 0x9b];
/// Colour where two compared clouds cover each other.
pub(crate) const BOTH: [u8; 3] = [0xd3, 0xd7, 0xdd];

/// Height of the camera above the horizon (rad).
const ELEVATION: f64 = 0.21;
/// Radius of a point (m), large enough for a few thousand of them to close the robot's surface.
const POINT_RADIUS: f64 = 0.003;
/// Free border (pixels); the scale bar has its own strip below.
const BORDER: f64 = 10.0;
const BAR_STRIP: f64 = 18.0;
const BAR_THICKNESS: usize = 3;
const BAR_COLOR: [u8; 3] = [0x44, 0x4b, 0x55];
/// Space between the panels of a contact sheet (pixels).
const GAP: usize = 8;

/// What a picture of an example shows.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Subject {
    /// The true cloud in its own colours.
    Truth,
    /// The predicted cloud and the true cloud.
    Prediction,
    /// The cloud of the nearest training command and the true cloud.
    Nearest,
}

impl Subject {
    pub const ALL: [Subject; 3] = [Subject::Truth, Subject::Prediction, Subject::Nearest];

    fn layers(self, example: &Example) -> Vec<Layer<'_>> {
        let layer = |cloud, paint| Layer {
            cloud,
            paint,
            radius: POINT_RADIUS,
        };
        let truth = layer(&example.truth, Paint::Flat(TRUTH));
        match self {
            Subject::Truth => vec![layer(&example.truth, Paint::Own)],
            Subject::Prediction => vec![truth, layer(&example.prediction, Paint::Flat(PREDICTION))],
            Subject::Nearest => vec![truth, layer(&example.nearest, Paint::Flat(NEAREST))],
        }
    }
}

/// The frame and the scale bar that all pictures of a report share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Framing {
    pub frame: Frame,
    /// Length of the scale bar (m).
    pub bar: f64,
}

impl Framing {
    /// The frame `width` pixels wide that holds every example in its own view.
    pub fn of(examples: &[Example], width: usize) -> Self {
        let width = width.max(8 * BORDER as usize);
        let [[left, right], [bottom, top]] = bounds(examples);
        let inner = width as f64 - 2.0 * BORDER;
        let margins = 2.0 * BORDER + BAR_STRIP;
        let height = (inner * (top - bottom) / (right - left) + margins)
            .clamp(0.7 * width as f64, 1.3 * width as f64)
            .round();
        let metres_per_pixel = ((right - left) / inner).max((top - bottom) / (height - margins));
        let frame = Frame {
            width,
            height: height as usize,
            metres_per_pixel,
            center: [
                0.5 * (left + right),
                0.5 * (bottom + top - BAR_STRIP * metres_per_pixel),
            ],
        };
        Self {
            frame,
            bar: mark_at_or_below(0.3 * width as f64 * metres_per_pixel),
        }
    }

    /// Draws one picture of an example, with the scale bar at the lower left.
    pub fn picture(&self, example: &Example, subject: Subject) -> Image {
        let view = View::turned(bend_azimuth(&example.truth), ELEVATION);
        let mut image = render(&subject.layers(example), BOTH, &view, &self.frame);
        let mut bar = Image::white(
            (self.bar / self.frame.metres_per_pixel).round() as usize,
            BAR_THICKNESS,
        );
        for pixel in bar.rgb.chunks_exact_mut(3) {
            pixel.copy_from_slice(&BAR_COLOR);
        }
        let y = self.frame.height - BORDER as usize - BAR_THICKNESS;
        image.paste(&bar, BORDER as usize, y);
        image
    }
}

/// PNG of examples side by side: a column for each, with the true cloud in its own colours, the
/// prediction (vermilion) against the truth (blue), and the cloud of the nearest training command
/// (purple) against the truth; where the outlines of both agree, they are grey.
///
/// Each panel is `panel_width` pixels wide (at least 80). Each column is seen across its plane of
/// bending; all panels have one scale, that of the bar at their lower left, whose length (m) is
/// [`scale_bar`]. No example gives one white panel.
pub fn contact_sheet(examples: &[Example], panel_width: usize) -> Vec<u8> {
    let framing = Framing::of(examples, panel_width);
    let (width, height) = (framing.frame.width + GAP, framing.frame.height + GAP);
    let mut sheet = Image::white(
        examples.len().max(1) * width - GAP,
        Subject::ALL.len() * height - GAP,
    );
    for (column, example) in examples.iter().enumerate() {
        for (row, subject) in Subject::ALL.into_iter().enumerate() {
            let picture = framing.picture(example, subject);
            sheet.paste(&picture, column * width, row * height);
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
        let picture = framing.picture(example, Subject::Truth);
        sheet.paste(&picture, k % columns * width, k / columns * height);
    }
    (sheet.to_png(), framing.bar)
}

/// Length (m) of the scale bar in the [`contact_sheet`] of the same arguments.
pub fn scale_bar(examples: &[Example], panel_width: usize) -> f64 {
    Framing::of(examples, panel_width).bar
}

/// Horizontal direction of a cloud's bend, as an angle from x (rad): the principal axis of its
/// second moments about the robot's axis (world z), on the side where most points lie.
pub(crate) fn bend_azimuth(cloud: &PointCloud) -> f64 {
    let [mut xx, mut xy, mut yy, mut sx, mut sy] = [0.0; 5];
    for point in cloud
        .points
        .iter()
        .filter(|p| p.iter().all(|x| x.is_finite()))
    {
        let [x, y] = [f64::from(point[0]), f64::from(point[1])];
        xx += x * x;
        xy += x * y;
        yy += y * y;
        sx += x;
        sy += y;
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    if sx * angle.cos() + sy * angle.sin() < 0.0 {
        angle + std::f64::consts::PI
    } else {
        angle
    }
}

/// Bounds `[[left, right], [bottom, top]]` (m) of all clouds, each in its example's view.
fn bounds(examples: &[Example]) -> [[f64; 2]; 2] {
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for example in examples {
        let view = View::turned(bend_azimuth(&example.truth), ELEVATION);
        for cloud in example.clouds() {
            for position in cloud.points.iter().map(|&p| view.project(p)) {
                if position.iter().all(|x| x.is_finite()) {
                    for (bound, x) in bounds.iter_mut().zip(position) {
                        *bound = [bound[0].min(x), bound[1].max(x)];
                    }
                }
            }
        }
    }
    bounds.map(|[low, high]| {
        if low <= high {
            [low - POINT_RADIUS, high + POINT_RADIUS]
        } else {
            [-0.1, 0.1]
        }
    })
}
