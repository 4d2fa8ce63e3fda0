//! Pictures of examples: one view per example, one scale for all.

use super::Example;
use super::closing::closing_radius;
use super::color_scale::ColorScale;
use super::figure::axis::mark_at_or_below;
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
/// Radius of a point (m): one that lies off the robot is seen, and is no lump.
const POINT_RADIUS: f64 = 0.001;
/// Free border (pixels); the scale bar has its own strip below.
pub(crate) const BORDER: f64 = 10.0;
const BAR_STRIP: f64 = 18.0;
pub(crate) const BAR_THICKNESS: usize = 3;
pub(crate) const BAR_COLOR: [u8; 3] = [0x44, 0x4b, 0x55];
/// What a picture of an example shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Subject {
    /// The true cloud in its own colours.
    Truth,
    /// The predicted cloud and the true cloud.
    Prediction,
    /// The predicted cloud, coloured by the distance of each point from the true cloud.
    Error,
    /// The predicted cloud, coloured by the uncertainty of each point.
    Uncertainty,
    /// The cloud of the nearest training command and the true cloud.
    Nearest,
}

/// The frame and the scale bar that all pictures of a report share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Framing {
    pub frame: Frame,
    /// Length of the scale bar (m).
    pub bar: f64,
    /// Radius of the balls that close the true surfaces (m).
    closing: f64,
    /// Scale of the errors; `None` where no example has any.
    pub error: Option<ColorScale>,
    /// Scale of the uncertainties; `None` where no example has any.
    pub uncertainty: Option<ColorScale>,
}

impl Framing {
    /// The frame `width` pixels wide that holds every example in its own view.
    pub fn of(examples: &[Example], width: usize) -> Self {
        let width = width.max(8 * BORDER as usize);
        // By the true clouds alone: they lie on a surface, while those of a bad network fill a space.
        let truths = examples.iter().map(|example| &example.truth);
        let closing = truths.map(closing_radius).fold(POINT_RADIUS, f64::max);
        let [[left, right], [bottom, top]] = bounds(examples, closing);
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
            closing,
            error: ColorScale::covering(examples.iter().flat_map(|e| &e.error).copied()),
            uncertainty: ColorScale::covering(
                examples.iter().flat_map(|e| &e.uncertainty).copied(),
            ),
        }
    }

    /// What the pictures show: truth and both predictions, and what is known beside.
    pub fn subjects(&self) -> Vec<Subject> {
        [
            Some(Subject::Truth),
            Some(Subject::Prediction),
            self.error.map(|_| Subject::Error),
            self.uncertainty.map(|_| Subject::Uncertainty),
            Some(Subject::Nearest),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// The scale of a subject's colours, where they stand for lengths.
    pub fn scale(&self, subject: Subject) -> Option<ColorScale> {
        match subject {
            Subject::Error => self.error,
            Subject::Uncertainty => self.uncertainty,
            Subject::Truth | Subject::Prediction | Subject::Nearest => None,
        }
    }

    /// Draws one picture of an example, with the scale bar at the lower left.
    pub fn picture(&self, example: &Example, subject: Subject) -> Image {
        let view = View::turned(bend_azimuth(&example.truth), ELEVATION);
        let layer = |cloud, paint| Layer {
            cloud,
            paint,
            ball: POINT_RADIUS,
            closing: self.closing,
        };
        let truth = layer(&example.truth, Paint::Flat(TRUTH));
        let values = match subject {
            Subject::Uncertainty => &example.uncertainty,
            _ => &example.error,
        };
        let scale = self.scale(subject);
        let color = |&value: &f64| scale.map_or(BOTH, |scale| scale.color(value));
        let colors: Vec<[u8; 3]> = values.iter().map(color).collect();
        let layers = match subject {
            Subject::Truth => vec![layer(&example.truth, Paint::Own)],
            Subject::Prediction => vec![truth, layer(&example.prediction, Paint::Flat(PREDICTION))],
            Subject::Error | Subject::Uncertainty => {
                vec![layer(&example.prediction, Paint::Each(&colors))]
            }
            Subject::Nearest => vec![truth, layer(&example.nearest, Paint::Flat(NEAREST))],
        };
        let mut image = render(&layers, BOTH, &view, &self.frame);
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

/// Bounds `[[left, right], [bottom, top]]` (m) of all clouds with points of a radius (m), each in its example's view.
fn bounds(examples: &[Example], radius: f64) -> [[f64; 2]; 2] {
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
            [low - radius, high + radius]
        } else {
            [-0.1, 0.1]
        }
    })
}
