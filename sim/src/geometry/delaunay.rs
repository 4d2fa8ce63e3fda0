//! Delaunay tetrahedra of points in space, by inserting one after another (Bowyer, 1981; Watson, 1981) with exact predicates
//! (Shewchuk, 1997).

use std::collections::HashMap;

use nalgebra::Vector3;
use robust::{Coord3D, insphere, orient3d};

/// No tetrahedron.
const NONE: usize = usize::MAX;
/// The tetrahedron around all points is so much larger than they are.
const AROUND: f64 = 1e3;
/// Points are displaced by so much of their extent, so that no five lie on a sphere and no four in a plane.
const DISPLACED: f64 = 1e-9;

/// A tetrahedron: its corners, and the neighbour opposite to each.
struct Tetrahedron {
    corners: [usize; 4],
    neighbours: [usize; 4],
    alive: bool,
}

/// A triangulation that grows.
struct Triangulation {
    points: Vec<Coord3D<f64>>,
    all: Vec<Tetrahedron>,
    last: usize,
}

/// Corners of the Delaunay tetrahedra of `points`, positively oriented. Points nearer to another than rounding tells are
/// corners of none. None of fewer than four points.
pub(super) fn tetrahedra(points: &[Vector3<f64>]) -> Vec<[usize; 4]> {
    let (low, high) = points.iter().fold(
        (
            Vector3::repeat(f64::INFINITY),
            Vector3::repeat(f64::NEG_INFINITY),
        ),
        |(low, high), point| (low.inf(point), high.sup(point)),
    );
    let extent = (high - low).max();
    if points.len() < 4 || !extent.is_finite() || extent == 0.0 {
        return Vec::new();
    }
    let middle = (low + high) / 2.0;
    // In units of the extent, about the middle.
    let scaled = points.iter().enumerate().map(|(index, point)| {
        let p = (point - middle) / extent + displacement(index);
        coord(p)
    });
    let mut triangulation = Triangulation::around(scaled.collect());
    for point in 0..points.len() {
        triangulation.insert(point);
    }
    let count = points.len();
    let whole = triangulation
        .all
        .iter()
        .filter(|t| t.alive && t.corners.iter().all(|&c| c < count));
    whole.map(|t| t.corners).collect()
}

/// A small displacement that follows from a point's number.
fn displacement(index: usize) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| {
        let mixed = ((3 * index + axis) as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        DISPLACED * ((mixed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
    })
}

fn coord(p: Vector3<f64>) -> Coord3D<f64> {
    Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    }
}

impl Triangulation {
    /// One tetrahedron around all points, whose corners are put behind them.
    fn around(mut points: Vec<Coord3D<f64>>) -> Self {
        let first = points.len();
        let corners = [
            [1.0, 1.0, 1.0],
            [1.0, -1.0, -1.0],
            [-1.0, 1.0, -1.0],
            [-1.0, -1.0, 1.0],
        ];
        points.extend(corners.map(|corner| coord(Vector3::from(corner) * AROUND)));
        let mut corners = [first, first + 1, first + 2, first + 3];
        let [a, b, c, d] = corners.map(|corner| points[corner]);
        if orient3d(a, b, c, d) < 0.0 {
            corners.swap(0, 1);
        }
        Self {
            points,
            all: vec![Tetrahedron {
                corners,
                neighbours: [NONE; 4],
                alive: true,
            }],
            last: 0,
        }
    }

    /// The corners of a tetrahedron, one of them replaced.
    fn with(&self, tetrahedron: usize, place: usize, point: usize) -> [Coord3D<f64>; 4] {
        let mut corners = self.all[tetrahedron].corners;
        corners[place] = point;
        corners.map(|corner| self.points[corner])
    }

    /// The tetrahedron that a point lies in: a walk through the faces that it lies behind.
    fn locate(&self, point: usize) -> usize {
        let mut at = self.last;
        loop {
            let behind = (0..4).find(|&place| {
                let [a, b, c, d] = self.with(at, place, point);
                orient3d(a, b, c, d) < 0.0
            });
            match behind.map(|place| self.all[at].neighbours[place]) {
                None | Some(NONE) => return at,
                Some(next) => at = next,
            }
        }
    }

    fn encloses(&self, tetrahedron: usize, point: usize) -> bool {
        let [a, b, c, d] = self.all[tetrahedron]
            .corners
            .map(|corner| self.points[corner]);
        insphere(a, b, c, d, self.points[point]) > 0.0
    }

    /// Replaces the tetrahedra whose spheres hold the point by those that join it to their outer faces.
    fn insert(&mut self, point: usize) {
        let start = self.locate(point);
        if !self.encloses(start, point) {
            return;
        }
        let mut cavity = vec![start];
        self.all[start].alive = false;
        let mut faces: Vec<(usize, usize)> = Vec::new();
        let mut next = 0;
        while let Some(&at) = cavity.get(next) {
            next += 1;
            for place in 0..4 {
                let neighbour = self.all[at].neighbours[place];
                if neighbour != NONE && self.all[neighbour].alive && self.encloses(neighbour, point)
                {
                    self.all[neighbour].alive = false;
                    cavity.push(neighbour);
                } else if neighbour == NONE || self.all[neighbour].alive {
                    faces.push((at, place));
                }
            }
        }
        // A face that was outer when seen may lie between two tetrahedra that both went.
        let alive = |neighbour: usize| neighbour == NONE || self.all[neighbour].alive;
        faces.retain(|&(at, place)| alive(self.all[at].neighbours[place]));
        let mut edges: HashMap<(usize, usize), (usize, usize)> = HashMap::new();
        for (at, place) in faces {
            let mut corners = self.all[at].corners;
            let outside = self.all[at].neighbours[place];
            corners[place] = point;
            let new = self.all.len();
            let mut neighbours = [NONE; 4];
            neighbours[place] = outside;
            if outside != NONE
                && let Some(back) = self.all[outside].neighbours.iter_mut().find(|n| **n == at)
            {
                *back = new;
            }
            self.all.push(Tetrahedron {
                corners,
                neighbours,
                alive: true,
            });
            // New tetrahedra meet in faces of the point and an edge of the cavity's surface.
            for opposite in (0..4).filter(|&opposite| opposite != place) {
                let mut edge = (0..4)
                    .filter(|&k| k != place && k != opposite)
                    .map(|k| corners[k]);
                let (Some(a), Some(b)) = (edge.next(), edge.next()) else {
                    continue;
                };
                if let Some((other, place)) = edges.remove(&(a.min(b), a.max(b))) {
                    self.all[new].neighbours[opposite] = other;
                    self.all[other].neighbours[place] = new;
                } else {
                    edges.insert((a.min(b), a.max(b)), (new, opposite));
                }
            }
            self.last = new;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn tetrahedra_fill_the_hull_and_their_spheres_are_empty() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut points: Vec<Vector3<f64>> = (0..8)
            .map(|k| Vector3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)))
            .collect();
        points.extend((0..300).map(|_| Vector3::from_fn(|_, _| rng.random::<f64>())));
        let all = tetrahedra(&points);
        let at = |corner: usize| points[corner];
        let volume: f64 = (all.iter())
            .map(|t| {
                (at(t[1]) - at(t[0]))
                    .cross(&(at(t[2]) - at(t[0])))
                    .dot(&(at(t[3]) - at(t[0])))
                    .abs()
                    / 6.0
            })
            .sum();
        assert!((volume - 1.0).abs() < 1e-6, "{volume}");
        for t in all.iter().step_by(7) {
            let [a, b, c, d] = t.map(|corner| coord(at(corner)));
            for (other, point) in points.iter().enumerate().filter(|(k, _)| !t.contains(k)) {
                assert!(insphere(a, b, c, d, coord(*point)) < 1e-9, "{t:?} {other}");
            }
        }
    }

    #[test]
    fn points_on_a_lattice_and_points_twice_are_no_trouble() {
        let lattice = (0..5).flat_map(|x| (0..5).flat_map(move |y| (0..5).map(move |z| [x, y, z])));
        let mut points: Vec<Vector3<f64>> =
            lattice.map(|p| Vector3::from(p.map(f64::from))).collect();
        points.extend(points.clone());
        let at = |corner: usize| points[corner];
        let volume: f64 = (tetrahedra(&points).iter())
            .map(|t| {
                (at(t[1]) - at(t[0]))
                    .cross(&(at(t[2]) - at(t[0])))
                    .dot(&(at(t[3]) - at(t[0])))
                    .abs()
                    / 6.0
            })
            .sum();
        assert!((volume - 64.0).abs() < 1e-5, "{volume}");
        assert!(tetrahedra(&points[..3]).is_empty());
        assert!(tetrahedra(&[Vector3::zeros(); 9]).is_empty());
    }
}
