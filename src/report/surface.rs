//! Surfaces that one can turn on a page.

use serde::Serialize;

use super::html::{base64, escape, fill};

/// A surface of triangles, such as the boundary of a workspace, in the world frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Name in the list.
    pub name: String,
    /// Corners (m).
    pub points: Vec<[f64; 3]>,
    /// Triangles, of the corners' numbers.
    pub triangles: Vec<[usize; 3]>,
}

/// What surface.js reads. A corner's coordinate is `origin[axis] + step * q` (m).
#[derive(Serialize)]
struct Data {
    origin: [f64; 3],
    step: f64,
    surfaces: Vec<Packed>,
}

/// Base64 of little-endian numbers: 16 bits for each coordinate, 32 for each corner of a triangle.
#[derive(Serialize)]
struct Packed {
    points: String,
    triangles: String,
}

/// The section with the viewer; nothing without surfaces.
pub(super) fn section(surfaces: &[Surface], note: &str) -> String {
    if surfaces.is_empty() {
        return String::new();
    }
    let all = || surfaces.iter().flat_map(|surface| &surface.points);
    let low: [f64; 3] =
        std::array::from_fn(|axis| all().map(|p| p[axis]).fold(f64::INFINITY, f64::min));
    let high: [f64; 3] =
        std::array::from_fn(|axis| all().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max));
    let extent = (0..3)
        .map(|axis| high[axis] - low[axis])
        .fold(0.0, f64::max);
    let step = extent.max(1e-6) / f64::from(u16::MAX);
    let pack = |surface: &Surface| {
        // Corners of triangles alone, and numbered anew.
        let mut used: Vec<usize> = surface.triangles.as_flattened().to_vec();
        used.sort_unstable();
        used.dedup();
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        for &corner in &used {
            for (x, low) in surface.points[corner].into_iter().zip(low) {
                points.extend((((x - low) / step).round() as u16).to_le_bytes());
            }
        }
        for corner in surface.triangles.as_flattened() {
            let number = used.partition_point(|other| other < corner);
            triangles.extend((number as u32).to_le_bytes());
        }
        Packed {
            points: base64(&points),
            triangles: base64(&triangles),
        }
    };
    let data = Data {
        origin: low.map(|x| if x.is_finite() { x } else { 0.0 }),
        step,
        surfaces: surfaces.iter().map(pack).collect(),
    };
    let data = serde_json::to_string(&data)
        .expect("plain structures of numbers and text have a JSON form");
    let option = |surface: &Surface| format!("<option>{}</option>", escape(&surface.name));
    let options: String = surfaces.iter().map(option).collect();
    fill(
        include_str!("surface.html"),
        &[
            ("options", &options),
            ("note", &escape(note)),
            ("data", &data),
            ("script", include_str!("surface.js")),
        ],
    )
}
