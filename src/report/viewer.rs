//! Data of the page's 3-D viewer: clouds thinned, quantised and packed into JSON.

use super::Example;
use super::html::base64;
use super::picture::bend_azimuth;
use serde::Serialize;
use tdcr_sim::cloud::PointCloud;

/// Points of a cloud that the viewer shows at most.
const POINTS: usize = 3000;

/// What viewer.js reads. A point's coordinate is `origin[axis] + step * q` (m).
#[derive(Serialize)]
struct Data {
    origin: [f64; 3],
    step: f64,
    examples: Vec<Clouds>,
}

/// One example: points as base64 of little-endian 16-bit `q`, `(x, y, z)` after each other.
#[derive(Serialize)]
struct Clouds {
    /// Direction of the bend (rad), across which the viewer looks at first.
    azimuth: f64,
    truth: String,
    prediction: String,
    nearest: String,
}

/// The viewer's data as JSON that can stand inside a `script` element.
pub(crate) fn data(examples: &[Example]) -> String {
    let clouds = || examples.iter().flat_map(Example::clouds);
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for point in clouds().flat_map(finite_points) {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let extent = (0..3)
        .map(|axis| high[axis] - low[axis])
        .fold(0.0, f64::max);
    let step = extent.max(1e-3) / f64::from(u16::MAX);
    let pack = |cloud| pack(cloud, low, step);
    let data = Data {
        origin: low.map(|x| if x.is_finite() { x } else { 0.0 }),
        step,
        examples: examples
            .iter()
            .map(|example| Clouds {
                azimuth: bend_azimuth(&example.truth),
                truth: pack(&example.truth),
                prediction: pack(&example.prediction),
                nearest: pack(&example.nearest),
            })
            .collect(),
    };
    serde_json::to_string(&data).expect("plain structures of numbers and text have a JSON form")
}

fn finite_points(cloud: &PointCloud) -> impl Iterator<Item = [f64; 3]> {
    let points = cloud.points.iter().map(|p| p.map(f64::from));
    points.filter(|p| p.iter().all(|x| x.is_finite()))
}

/// Packs evenly chosen points of a cloud: at most [`POINTS`], those that are finite.
fn pack(cloud: &PointCloud, origin: [f64; 3], step: f64) -> String {
    let points: Vec<[f64; 3]> = finite_points(cloud).collect();
    let count = points.len().min(POINTS);
    let mut bytes = Vec::with_capacity(6 * count);
    for k in 0..count {
        let point = points[k * points.len() / count];
        for (x, low) in point.into_iter().zip(origin) {
            bytes.extend_from_slice(&(((x - low) / step).round() as u16).to_le_bytes());
        }
    }
    base64(&bytes)
}
