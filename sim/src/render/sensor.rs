//! What real RGB-D cameras do to a picture: noise, quantisation, drop-outs, wrong extrinsics.
//!
//! Faults draw from a random stream for each row, and draw the same numbers whichever of the faults are on.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::distr::Distribution;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::RgbdFrame;
use crate::geometry::Instance;

/// A stereo depth camera's faults, each of them off where it is `None`.
///
/// A stereo camera measures the disparity `d = f B / z` (pixels) of a point at depth `z`, from its
/// focal length `f` (pixels) and baseline `B`; noise of RMS `sigma` on it is noise of
/// `z² / (f B) sigma` on the depth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Distance between the two imagers (m).
    pub baseline: f64,
    /// Largest disparity that is searched (pixels): nothing is seen nearer than `f B` over it.
    pub max_disparity: Option<f64>,
    /// RMS of the noise on disparities (pixels).
    pub disparity_noise: Option<f64>,
    /// Step that disparities are rounded to (pixels).
    pub disparity_step: Option<f64>,
    /// Surfaces seen at a slant are lost.
    pub grazing: Option<Grazing>,
    /// Pixels at edges of depth are lost, or fly.
    pub edges: Option<Edges>,
    /// RMS of the noise on colours (of 255).
    pub color_noise: Option<f64>,
    /// The pose that a camera is believed to have is not the one that it has.
    pub extrinsics: Option<ExtrinsicError>,
}

/// Loss of depth on surfaces seen at a slant: none where the sine of the angle between ray and
/// surface is above `limit`, and below it with a probability that grows linearly to 1 at 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grazing {
    /// Sine of the angle between ray and surface.
    pub limit: f64,
}

/// What happens at pixels beside a jump of depth, in the row or the column.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edges {
    /// Smallest jump of depth between neighbours (m).
    pub jump: f64,
    /// Probability that such a pixel has no depth.
    pub lost: f64,
    /// Probability that one which is not lost flies: has a depth between those of the two sides.
    pub flying: f64,
    /// How far pixels fly where nothing is behind the edge (m).
    pub reach: f64,
}

/// Errors of a camera's pose, normal in each coordinate and the same for all of its frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExtrinsicError {
    /// RMS error of the position along each axis (m).
    pub position: f64,
    /// RMS of the rotation about each of the camera's axes (rad).
    pub rotation: f64,
}

impl Sensor {
    /// Intel's RealSense D435: baseline, search range of 126 pixels, sub-pixel noise of 0.08 pixels
    /// and steps of 1/32 pixel as its data sheet and tuning guide have them; the shares of pixels
    /// lost and flying, the noise of colours and of extrinsics are of a plausible size.
    pub fn d435() -> Self {
        Self {
            baseline: 0.050,
            max_disparity: Some(126.0),
            disparity_noise: Some(0.08),
            disparity_step: Some(1.0 / 32.0),
            grazing: Some(Grazing { limit: 0.2 }),
            edges: Some(Edges {
                jump: 0.005,
                lost: 0.4,
                flying: 0.3,
                reach: 0.01,
            }),
            color_noise: Some(2.0),
            extrinsics: Some(ExtrinsicError {
                position: 0.001,
                rotation: 0.002,
            }),
        }
    }

    /// A camera without faults.
    pub fn ideal() -> Self {
        Self {
            baseline: 0.050,
            max_disparity: None,
            disparity_noise: None,
            disparity_step: None,
            grazing: None,
            edges: None,
            color_noise: None,
            extrinsics: None,
        }
    }

    /// The `index`-th picture of camera number `camera`, given the true one: a function of that picture
    /// and of these three numbers. The mask stays the true one; lost pixels have depth 0.
    pub fn take(&self, truth: &RgbdFrame, seed: u64, camera: u64, index: u64) -> RgbdFrame {
        let mut frame = truth.clone();
        if let Some(error) = &self.extrinsics {
            frame.camera.pose *= error.draw(&mut stream([seed, camera, u64::MAX], 0));
        }
        for v in 0..truth.camera.intrinsics.height {
            let span = truth.span(v);
            if span.is_empty() {
                continue;
            }
            let mut rng = stream([seed, camera, index], u64::from(v));
            for u in span {
                let draws = Draws::of(&mut rng);
                let pixel = truth.index(u, v);
                if truth.mask[pixel] == Instance::Background {
                    continue;
                }
                frame.depth[pixel] = self.depth(truth, u, v, &draws) as f32;
                if let Some(noise) = self.color_noise {
                    for (channel, normal) in frame.color[pixel].iter_mut().zip(draws.color) {
                        // `as` saturates at black and white.
                        *channel = (f64::from(*channel) + noise * normal).round() as u8;
                    }
                }
            }
        }
        frame
    }

    /// Measured depth (m) at a pixel that shows something; 0 where it is lost.
    fn depth(&self, truth: &RgbdFrame, u: u32, v: u32, draws: &Draws) -> f64 {
        let mut z = f64::from(truth.depth[truth.index(u, v)]);
        // Lost on a surface that is seen at a slant.
        if let Some(grazing) = &self.grazing
            && let Some(facing) = facing(truth, u, v)
            && draws.grazing * grazing.limit > facing
        {
            return 0.0;
        }
        // Lost at an edge, or between its two depths.
        if let Some(edges) = &self.edges
            && let Some(other) = edges.beyond(truth, u, v)
        {
            if draws.lost < edges.lost {
                return 0.0;
            }
            if draws.flying < edges.flying {
                z += draws.flight * (other - z);
            }
        }
        // Noise and rounding of the disparity d = f B / z.
        let scale = truth.camera.intrinsics.fx * self.baseline;
        let mut disparity = scale / z + self.disparity_noise.unwrap_or(0.0) * draws.disparity;
        if let Some(step) = self.disparity_step {
            disparity = (disparity / step).round() * step;
        }
        let found = disparity > 0.0 && self.max_disparity.is_none_or(|max| disparity <= max);
        if found { scale / disparity } else { 0.0 }
    }
}

impl Edges {
    /// Depth (m) on the other side of the largest jump beside a pixel.
    fn beyond(&self, truth: &RgbdFrame, u: u32, v: u32) -> Option<f64> {
        let z = f64::from(truth.depth[truth.index(u, v)]);
        let sides = neighbours(truth, u, v).into_iter().flatten();
        let others = sides.map(|(_, depth)| if depth > 0.0 { depth } else { z + self.reach });
        let jump = |other: &f64| (other - z).abs();
        (others.filter(|other| jump(other) > self.jump)).max_by(|a, b| jump(a).total_cmp(&jump(b)))
    }
}

impl ExtrinsicError {
    fn draw(&self, rng: &mut ChaCha8Rng) -> Isometry3<f64> {
        let mut normal = |rms: f64| Vector3::from_fn(|_, _| rms * gaussian(rng));
        let place = Translation3::from(normal(self.position));
        let turn = UnitQuaternion::from_scaled_axis(normal(self.rotation));
        Isometry3::from_parts(place, turn)
    }
}

/// The random numbers of a pixel: the same whichever faults are on.
struct Draws {
    grazing: f64,
    lost: f64,
    flying: f64,
    flight: f64,
    disparity: f64,
    color: [f64; 3],
}

impl Draws {
    fn of(rng: &mut ChaCha8Rng) -> Self {
        Self {
            grazing: rng.random(),
            lost: rng.random(),
            flying: rng.random(),
            flight: rng.random(),
            disparity: gaussian(rng),
            color: std::array::from_fn(|_| gaussian(rng)),
        }
    }
}

fn gaussian(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// The random stream of three numbers and a row.
fn stream(numbers: [u64; 3], row: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    for (bytes, number) in key.chunks_exact_mut(8).zip(numbers) {
        bytes.copy_from_slice(&number.to_le_bytes());
    }
    let mut rng = ChaCha8Rng::from_seed(key);
    rng.set_stream(row);
    rng
}

/// The pixels left, right, above and below: place and depth.
fn neighbours(truth: &RgbdFrame, u: u32, v: u32) -> [Option<([u32; 2], f64)>; 4] {
    let k = &truth.camera.intrinsics;
    let at = |u: Option<u32>, v: Option<u32>| {
        let (u, v) = (u.filter(|u| *u < k.width)?, v.filter(|v| *v < k.height)?);
        Some(([u, v], f64::from(truth.depth[truth.index(u, v)])))
    };
    [
        at(u.checked_sub(1), Some(v)),
        at(u.checked_add(1), Some(v)),
        at(Some(u), v.checked_sub(1)),
        at(Some(u), v.checked_add(1)),
    ]
}

/// Sine of the angle between the ray through a pixel and the surface there, from the neighbours
/// that show the same thing; `None` where they do not tell it.
fn facing(truth: &RgbdFrame, u: u32, v: u32) -> Option<f64> {
    let camera = &truth.camera;
    let instance = truth.mask[truth.index(u, v)];
    let point = |([u, v], z): ([u32; 2], f64)| camera.ray(f64::from(u), f64::from(v)) * z;
    let here = point(([u, v], f64::from(truth.depth[truth.index(u, v)])));
    let same = |side: Option<([u32; 2], f64)>| {
        side.filter(|&([u, v], z)| z > 0.0 && truth.mask[truth.index(u, v)] == instance)
    };
    let [left, right, above, below] = neighbours(truth, u, v).map(same);
    // Of the two sides, the one of the lesser change: the other may be across an edge.
    let along = |one: Option<_>, other: Option<_>| {
        let steps = [one, other].map(|side| side.map(|side| point(side) - here));
        let by_length = |a: &Vector3<f64>, b: &Vector3<f64>| a.norm().total_cmp(&b.norm());
        steps.into_iter().flatten().min_by(by_length)
    };
    let normal = along(left, right)?.cross(&along(above, below)?);
    Some((normal.dot(&here) / (normal.norm() * here.norm())).abs())
}
