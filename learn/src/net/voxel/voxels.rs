//! From points to voxels and back.

use rayon::prelude::*;

use super::grid::Grid;
use super::occupied::{Occupied, Sparse};
use crate::channels::DIM;
use crate::net::kernels::float32::vectorised;

/// Points that a task reads voxels for.
const POINTS: usize = 256;

/// Voxels that a task averages points for.
const VOXELS: usize = 64;

/// Where a cloud's points lie in a grid (Liu et al. 2019, Sec. 4.1).
///
/// The grid is the cube about the cloud's centre (its points' mean) that just holds the ball about that centre through the
/// farthest point. A point at `p` of this cube, in `[0, 1]^3`, has the coordinates `min(r p, r - 1)`; they lie in the voxel
/// of the nearest integers, and between the voxels of the integers below and above. As positions need no gradient, they
/// get none.
#[derive(Debug)]
pub struct Voxels {
    grid: Grid,
    /// What the cube is wider than the ball.
    slack: f32,
    /// Per point.
    places: Vec<Place>,
    /// The voxels with points.
    occupied: Occupied,
    /// Points by their voxel.
    averaged: Sorted,
    /// Points by the plane below them.
    interpolated: Sorted,
    /// Points in every row of the grid without its margins.
    counts: Vec<u32>,
    /// Of these rows, the index of the voxel among those with points.
    indices: Vec<usize>,
}

/// Where a point lies.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Row of its voxel.
    row: usize,
    /// Index of its voxel among the occupied ones.
    voxel: usize,
    /// Its share of the voxel's average.
    share: f32,
    /// Row of the voxel below it in all axes.
    below: usize,
    /// Distance in rows to the voxel above along x, y, z; 0 at the grid's border.
    steps: [usize; DIM],
    /// Coordinates relative to the voxel below, in [0, 1).
    fractions: [f32; DIM],
}

/// Points in the order of planes or voxels, and of their index within one.
#[derive(Debug, Default)]
struct Sorted {
    starts: Vec<usize>,
    points: Vec<usize>,
}

impl Sorted {
    /// Sorts points by `bin`, which is below `bins`. Allocates for `most` bins.
    fn sort(&mut self, bins: usize, most: usize, places: &[Place], bin: impl Fn(&Place) -> usize) {
        self.starts.clear();
        self.starts.reserve(most + 2);
        self.starts.resize(bins + 2, 0);
        // Counts are shifted by two: while points are placed, entry `k + 1` is where the next of bin `k` goes.
        places
            .iter()
            .for_each(|place| self.starts[bin(place) + 2] += 1);
        for k in 1..self.starts.len() {
            self.starts[k] += self.starts[k - 1];
        }
        self.points.resize(places.len(), 0);
        for (index, place) in places.iter().enumerate() {
            let next = &mut self.starts[bin(place) + 1];
            self.points[*next] = index;
            *next += 1;
        }
    }

    fn of(&self, bin: usize) -> &[usize] {
        &self.points[self.starts[bin]..self.starts[bin + 1]]
    }
}

impl Place {
    /// Rows of the voxels about the point, and its weights there.
    fn corners(&self) -> impl Iterator<Item = (usize, f32)> {
        (0..8).map(|corner| {
            let mut row = self.below;
            let mut weight = 1.0;
            for axis in 0..DIM {
                if corner >> axis & 1 == 1 {
                    row += self.steps[axis];
                    weight *= self.fractions[axis];
                } else {
                    weight *= 1.0 - self.fractions[axis];
                }
            }
            (row, weight)
        })
    }
}

impl Voxels {
    /// Buffers for a cloud, whose grid is wider by `slack` than the ball.
    pub fn new(grid: Grid, slack: f32) -> Self {
        Self {
            grid,
            slack,
            places: Vec::new(),
            occupied: Occupied::default(),
            averaged: Sorted::default(),
            interpolated: Sorted::default(),
            counts: Vec::new(),
            indices: Vec::new(),
        }
    }

    /// Places the points of a cloud, `columns` numbers each of which the first three are the position.
    pub fn place(&mut self, points: &[f32], columns: usize) {
        let position = |point: &[f32]| [point[0], point[1], point[2]];
        let points = points.chunks_exact(columns).map(position);
        let count = points.len() as f64;
        // In f64, so that the order of points does not move the centre by a rounding of f32.
        let sum = points.clone().fold([0.0; DIM], |sum, point| {
            [0, 1, 2].map(|k| sum[k] + f64::from(point[k]))
        });
        let centre = sum.map(|sum| (sum / count) as f32);
        let centred = points.map(|point| [0, 1, 2].map(|k| point[k] - centre[k]));
        let norm = |x: [f32; DIM]| (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt();
        let diameter = 2.0 * centred.clone().map(norm).fold(0.0, f32::max) + self.slack;

        // Coordinates in the grid, the voxel that each point is averaged in, and the eight that it interpolates.
        let grid = self.grid;
        let r = grid.resolution;
        self.places.clear();
        self.places.extend(centred.map(|x| {
            let last = (r - 1) as f32;
            // A cloud of one place lies at the centre.
            let unit = |x: f32| {
                if diameter > 0.0 {
                    x / diameter + 0.5
                } else {
                    0.5
                }
            };
            let x = x.map(|x| (unit(x) * r as f32).clamp(0.0, last));
            let below = x.map(|x| x as usize);
            let step = |axis: usize, step| if below[axis] + 1 < r { step } else { 0 };
            Place {
                row: grid.row(x.map(|x| x.round_ties_even() as usize)),
                voxel: 0,
                share: 1.0,
                below: grid.row(below),
                steps: [step(0, 1), step(1, grid.line()), step(2, grid.plane())],
                fractions: [0, 1, 2].map(|k| x[k] - below[k] as f32),
            }
        }));
        // Points per voxel, the occupied voxels, and the share of each point in its voxel's average.
        self.counts.clear();
        self.counts.resize(r * grid.plane(), 0);
        self.places
            .iter()
            .for_each(|place| self.counts[place.row] += 1);
        let count = self.places.len();
        self.occupied.set(grid, &self.counts, count);
        self.indices.resize(self.counts.len(), 0);
        for (index, row) in self.occupied.rows().iter().enumerate() {
            self.indices[*row] = index;
        }
        for place in &mut self.places {
            place.voxel = self.indices[place.row];
            place.share = 1.0 / self.counts[place.row] as f32;
        }
        // Points by the voxel that averages them, and by the plane that they interpolate.
        let occupied = self.occupied.rows().len();
        self.averaged
            .sort(occupied, count, &self.places, |place| place.voxel);
        let plane = grid.plane();
        self.interpolated
            .sort(r, r, &self.places, |place| place.below / plane);
    }

    /// Features `(M, C)` as those of the occupied voxels.
    pub fn sparse<'a>(&'a self, features: &'a [f32], channels: usize) -> Sparse<'a> {
        Sparse {
            voxels: &self.occupied,
            features,
            channels,
        }
    }

    /// Average of the points' features `(N, C)` in every occupied voxel, `(M, C)`.
    pub fn average(&self, features: &[f32], channels: usize, averages: &mut Vec<f32>) {
        averages.clear();
        averages.reserve(features.len());
        averages.resize(self.occupied.rows().len() * channels, 0.0);
        averages
            .par_chunks_mut(VOXELS * channels)
            .enumerate()
            .for_each(|(task, averages)| {
                for (voxel, average) in averages.chunks_exact_mut(channels).enumerate() {
                    for &index in self.averaged.of(task * VOXELS + voxel) {
                        let features = &features[index * channels..][..channels];
                        add_scaled(self.places[index].share, features, average);
                    }
                }
            });
    }

    /// Adds the gradient by the points' features to `d_features`, from that by the averages.
    pub fn average_backward(&self, d_averages: &[f32], channels: usize, d_features: &mut [f32]) {
        self.per_point(d_features, channels, |place, d| {
            let d_average = &d_averages[place.voxel * channels..][..channels];
            add_scaled(place.share, d_average, d);
        });
    }

    /// Features `(N, C)` of the points, trilinear between the eight voxels about them.
    pub fn interpolate(&self, voxels: &[f32], channels: usize, features: &mut [f32]) {
        let voxels = self.grid.body(voxels, channels);
        self.per_point(features, channels, |place, features| {
            features.fill(0.0);
            for (row, weight) in place.corners() {
                add_scaled(weight, &voxels[row * channels..][..channels], features);
            }
        });
    }

    /// Gradient by the voxels: `everywhere` `(C)` in each, plus what comes from the points.
    pub fn interpolate_backward(
        &self,
        d_features: &[f32],
        everywhere: &[f32],
        d_voxels: &mut [f32],
    ) {
        let (grid, channels) = (self.grid, everywhere.len());
        self.per_plane(d_voxels, channels, |plane, start, d_voxels| {
            for line in grid.rows().lines(d_voxels.len(), channels) {
                let voxels = d_voxels[line].chunks_exact_mut(channels);
                voxels.for_each(|voxel| voxel.copy_from_slice(everywhere));
            }
            let (end, from) = (start + grid.plane(), plane.saturating_sub(1));
            let points = (from..=plane).flat_map(|plane| self.interpolated.of(plane));
            for &index in points {
                let d = &d_features[index * channels..][..channels];
                for (row, weight) in self.places[index].corners() {
                    if (start..end).contains(&row) {
                        let voxel = &mut d_voxels[(row - start) * channels..][..channels];
                        add_scaled(weight, d, voxel);
                    }
                }
            }
        });
    }

    fn per_point(
        &self,
        features: &mut [f32],
        channels: usize,
        work: impl Fn(&Place, &mut [f32]) + Sync,
    ) {
        features
            .par_chunks_mut(POINTS * channels)
            .zip(self.places.par_chunks(POINTS))
            .for_each(|(features, places)| {
                for (place, features) in places.iter().zip(features.chunks_exact_mut(channels)) {
                    work(place, features);
                }
            });
    }

    /// Runs `work` on every plane of `voxels`, with its index and the row where it starts.
    fn per_plane(
        &self,
        voxels: &mut [f32],
        channels: usize,
        work: impl Fn(usize, usize, &mut [f32]) + Sync,
    ) {
        let grid = self.grid;
        grid.body_mut(voxels, channels)
            .par_chunks_mut(grid.plane() * channels)
            .enumerate()
            .for_each(|(plane, voxels)| work(plane, plane * grid.plane(), voxels));
    }
}

vectorised! {
    /// `y += factor x`.
    fn add_scaled(factor: f32, x: &'a [f32], y: &'a mut [f32]) {
        for (y, x) in y.iter_mut().zip(x) {
            *y = factor.mul_add(*x, *y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::kernels::check::{assert_close, assert_is_gradient, numbers, single};

    const GRID: Grid = Grid { resolution: 4 };
    const CHANNELS: usize = 3;
    const COUNT: usize = 300;

    /// Coordinates in the grid, in f64.
    fn coordinates(points: &[f64]) -> Vec<[f64; 3]> {
        let points = points.as_chunks::<3>().0;
        let mean =
            [0, 1, 2].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / points.len() as f64);
        let centred = points.iter().map(|p| [0, 1, 2].map(|k| p[k] - mean[k]));
        let norm = |p: [f64; 3]| p.iter().map(|x| x * x).sum::<f64>().sqrt();
        let diameter = 2.0 * centred.clone().map(norm).fold(0.0, f64::max);
        let unit = centred.map(|p| p.map(|x| x / diameter + 0.5));
        unit.map(|p| p.map(|x| (4.0 * x).clamp(0.0, 3.0))).collect()
    }

    /// All rows of the grid without margins, padding included, in f64.
    fn average(points: &[f64], features: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; GRID.resolution * GRID.plane() * CHANNELS];
        let rows: Vec<usize> = (coordinates(points).iter())
            .map(|x| GRID.row(x.map(|x| x.round_ties_even() as usize)))
            .collect();
        for (row, feature) in rows.iter().zip(features.chunks(CHANNELS)) {
            let count = rows.iter().filter(|other| *other == row).count() as f64;
            for (k, value) in feature.iter().enumerate() {
                sums[row * CHANNELS + k] += value / count;
            }
        }
        sums
    }

    /// Trilinear interpolation as a sum over all voxels of the product of hats.
    fn interpolate(points: &[f64], voxels: &[f64]) -> Vec<f64> {
        let mut features = Vec::new();
        for x in coordinates(points) {
            for k in 0..CHANNELS {
                let mut sum = 0.0;
                for voxel in 0..GRID.voxels() {
                    let v = [voxel % 4, voxel / 4 % 4, voxel / 16];
                    let hat = |axis: usize| (1.0 - (x[axis] - v[axis] as f64).abs()).max(0.0);
                    sum += hat(0) * hat(1) * hat(2) * voxels[GRID.row(v) * CHANNELS + k];
                }
                features.push(sum);
            }
        }
        features
    }

    fn cloud() -> (Vec<f64>, Voxels) {
        let points = numbers(1, COUNT * 3);
        let mut voxels = Voxels::new(GRID, 0.0);
        voxels.place(&single(&points), 3);
        (points, voxels)
    }

    fn grid() -> Vec<f32> {
        let mut grid = Vec::new();
        GRID.prepare(&mut grid, CHANNELS);
        grid
    }

    #[test]
    fn averages_and_their_gradient_are_those_of_the_definition() {
        let (points, voxels) = cloud();
        let features = numbers(2, COUNT * CHANNELS);
        let (mut found, mut averages) = (grid(), Vec::new());
        voxels.average(&single(&features), CHANNELS, &mut averages);
        voxels.sparse(&averages, CHANNELS).spread(GRID, &mut found);
        assert_close(GRID.body(&found, CHANNELS), &average(&points, &features));

        let weights = numbers(3, GRID.resolution * GRID.plane() * CHANNELS);
        GRID.body_mut(&mut found, CHANNELS)
            .copy_from_slice(&single(&weights));
        voxels
            .occupied
            .collect(GRID, &found, CHANNELS, &mut averages);
        let mut d = vec![0.0; features.len()];
        voxels.average_backward(&averages, CHANNELS, &mut d);
        assert_is_gradient(&d, &features, &weights, |features| {
            average(&points, features)
        });
    }

    #[test]
    fn interpolation_and_its_gradient_are_those_of_the_definition() {
        let (points, voxels) = cloud();
        let mut features = numbers(4, GRID.resolution * GRID.plane() * CHANNELS);
        let mut padded = grid();
        let body = GRID.body_mut(&mut padded, CHANNELS);
        body.copy_from_slice(&single(&features));
        for plane in body.chunks_mut(GRID.plane() * CHANNELS) {
            GRID.clear_padding(plane, CHANNELS);
        }
        features = body.iter().copied().map(f64::from).collect();
        let mut found = vec![0.0; COUNT * CHANNELS];
        voxels.interpolate(&padded, CHANNELS, &mut found);
        assert_close(&found, &interpolate(&points, &features));

        let weights = numbers(5, COUNT * CHANNELS);
        let mut d = grid();
        let everywhere = vec![0.0; CHANNELS];
        voxels.interpolate_backward(&single(&weights), &everywhere, &mut d);
        let d = GRID.body(&d, CHANNELS);
        assert_is_gradient(d, &features, &weights, |x| interpolate(&points, x));
    }
}
