//! What the input layer takes of a point: its numbers, and Fourier features of its position.

use std::f32::consts::PI;

use rayon::prelude::*;

use super::shape::MlpShape;
use crate::channels::DIM;

/// Points per task.
const BLOCK: usize = 1024;

/// The inputs `(N, C + 6 K)` of `points` `(N, C)`: each point, then for every octave `k` the sines of `2^k pi x` and their
/// cosines, of the three coordinates each ([`MlpShape::octaves`]). Without octaves the points themselves. `inputs` is storage.
pub fn point_inputs<'a>(
    shape: &MlpShape,
    points: &'a [f32],
    inputs: &'a mut Vec<f32>,
) -> &'a [f32] {
    if shape.octaves == 0 {
        return points;
    }
    let (channels, count) = (shape.channels.count(), shape.point_inputs());
    inputs.resize(points.len() / channels * count, 0.0);
    inputs
        .par_chunks_mut(BLOCK * count)
        .zip(points.par_chunks(BLOCK * channels))
        .for_each(|(inputs, points)| {
            for (row, point) in inputs
                .chunks_exact_mut(count)
                .zip(points.chunks_exact(channels))
            {
                let (own, features) = row.split_at_mut(channels);
                own.copy_from_slice(point);
                fill(&point[..DIM], features);
            }
        });
    inputs
}

/// Fourier features of a position. Octaves by doubling the angle: `sin 2a = 2 sin a cos a`, `cos 2a = 1 - 2 sin^2 a`.
fn fill(position: &[f32], features: &mut [f32]) {
    let (mut sines, mut cosines) = ([0.0; DIM], [0.0; DIM]);
    for (k, x) in position.iter().enumerate() {
        (sines[k], cosines[k]) = (PI * x).sin_cos();
    }
    for octave in features.chunks_exact_mut(2 * DIM) {
        octave[..DIM].copy_from_slice(&sines);
        octave[DIM..].copy_from_slice(&cosines);
        for (sine, cosine) in sines.iter_mut().zip(&mut cosines) {
            (*sine, *cosine) = (2.0 * *sine * *cosine, 1.0 - 2.0 * *sine * *sine);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channels::Channels;
    use crate::net::TimeFeatures;

    #[test]
    fn inputs_are_the_point_and_its_octaves() {
        let shape = MlpShape {
            width: 8,
            depth: 1,
            embedding: 2,
            condition_dim: 1,
            condition_blocks: 0,
            octaves: 6,
            time_features: TimeFeatures::Plain,
            channels: Channels::XyzRgb,
        };
        let points = [
            0.3, -0.7, 1.2, 0.1, 0.2, 0.3, -0.01, 0.5, 0.0, 0.4, 0.5, 0.6,
        ];
        let mut storage = Vec::new();
        let inputs = point_inputs(&shape, &points, &mut storage);
        assert_eq!(inputs.len(), 2 * (6 + 36));
        for (row, point) in inputs.chunks_exact(42).zip(points.chunks_exact(6)) {
            assert_eq!(row[..6], *point);
            for (k, octave) in row[6..].chunks_exact(6).enumerate() {
                for (axis, x) in point[..DIM].iter().enumerate() {
                    let angle = f64::from(1 << k) * std::f64::consts::PI * f64::from(*x);
                    let [sine, cosine] = [axis, 3 + axis].map(|column| f64::from(octave[column]));
                    assert!((sine - angle.sin()).abs() < 2e-5, "octave {k}");
                    assert!((cosine - angle.cos()).abs() < 2e-5, "octave {k}");
                }
            }
        }
    }

    #[test]
    fn without_octaves_points_are_their_inputs() {
        let shape = MlpShape {
            width: 8,
            depth: 1,
            embedding: 2,
            condition_dim: 1,
            condition_blocks: 0,
            octaves: 0,
            time_features: TimeFeatures::Plain,
            channels: Channels::Xyz,
        };
        let mut storage = Vec::new();
        assert_eq!(
            point_inputs(&shape, &[1.0, 2.0, 3.0], &mut storage),
            [1.0, 2.0, 3.0]
        );
    }
}
