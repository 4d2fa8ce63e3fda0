//! The alpha shape of points in space: what is left of their hull when balls of radius alpha that hold no point carve it
//! (Edelsbrunner and Mucke, Three-dimensional alpha shapes, 1994). Unlike the convex hull it keeps hollows.

use std::collections::HashMap;

use nalgebra::Vector3;

use super::delaunay::tetrahedra;
use super::triangles::cut;

/// Share of the points that the shape joins.
const JOINED: f64 = 0.99;
/// The radius chosen is so many times the smallest one that joins them: wide enough for the gaps between random points.
const WIDER: f64 = 2.0;

/// An alpha shape.
#[derive(Clone, Debug, Default)]
pub struct AlphaShape {
    /// Radius of the balls (m).
    pub alpha: f64,
    /// Its volume (m³).
    pub volume: f64,
    points: Vec<Vector3<f64>>,
    kept: Vec<[usize; 4]>,
}

impl AlphaShape {
    /// The shape of `points` (m) for a radius, or the one that is twice the smallest that joins 99 % of the points. Empty for
    /// points in a plane.
    pub fn new(points: Vec<Vector3<f64>>, alpha: Option<f64>) -> Self {
        let mut all: Vec<(f64, [usize; 4])> = (tetrahedra(&points).into_iter())
            .map(|corners| (circumradius(corners.map(|corner| points[corner])), corners))
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let alpha = alpha.unwrap_or_else(|| WIDER * joining_radius(points.len(), &all));
        let kept: Vec<[usize; 4]> = (all.into_iter())
            .take_while(|(radius, _)| *radius <= alpha)
            .map(|(_, t)| t)
            .collect();
        let volume = kept
            .iter()
            .map(|t| volume(t.map(|corner| points[corner])))
            .sum();
        Self {
            alpha,
            volume,
            points,
            kept,
        }
    }

    /// Area (m²) of the section by the plane through `point` with this unit `normal`.
    pub fn section(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        let height = |p: &Vector3<f64>| (p - point).dot(normal);
        let area = |tetrahedron: &[usize; 4]| {
            let corners = tetrahedron.map(|corner| self.points[corner]);
            let (above, below): (Vec<_>, Vec<_>) = corners.iter().partition(|p| height(p) > 0.0);
            let cut = |a: &Vector3<f64>, b: &Vector3<f64>| {
                let share = height(a) / (height(a) - height(b));
                a + (b - a) * share
            };
            // A triangle, or a quadrilateral whose corners go round when those of one side are taken in turn.
            let mut corners: Vec<Vector3<f64>> = Vec::with_capacity(4);
            for (turn, a) in above.iter().enumerate() {
                let cuts = below.iter().map(|b| cut(a, b));
                match turn % 2 {
                    0 => corners.extend(cuts),
                    _ => corners.extend(cuts.rev()),
                }
            }
            polygon_area(&corners)
        };
        self.kept.iter().map(area).sum()
    }

    /// The outline of that section: the ends of its pieces, two by two (m).
    pub fn outline(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let piece = |triangle: [usize; 3]| {
            let corners = triangle.map(|corner| self.points[corner]);
            cut(corners, point, normal).into_iter().flatten()
        };
        self.boundary().into_iter().flat_map(piece).collect()
    }

    /// The triangles of its boundary: those of one tetrahedron alone.
    pub fn boundary(&self) -> Vec<[usize; 3]> {
        let mut faces: HashMap<[usize; 3], ([usize; 3], usize)> = HashMap::new();
        for t in &self.kept {
            for face in [
                [t[1], t[2], t[3]],
                [t[0], t[3], t[2]],
                [t[0], t[1], t[3]],
                [t[0], t[2], t[1]],
            ] {
                let mut key = face;
                key.sort_unstable();
                faces.entry(key).or_insert((face, 0)).1 += 1;
            }
        }
        let mut outer: Vec<[usize; 3]> = faces
            .into_values()
            .filter(|(_, count)| *count == 1)
            .map(|(face, _)| face)
            .collect();
        outer.sort_unstable();
        outer
    }

    /// The points that it is of (m).
    pub fn points(&self) -> &[Vector3<f64>] {
        &self.points
    }
}

/// The smallest radius at which tetrahedra of at most it join [`JOINED`] of the points; those come by ascending radius.
fn joining_radius(points: usize, ascending: &[(f64, [usize; 4])]) -> f64 {
    let mut parent: Vec<usize> = (0..points).collect();
    let mut size = vec![1; points];
    for (radius, corners) in ascending {
        let first = root(&mut parent, corners[0]);
        let mut joined = first;
        for &corner in &corners[1..] {
            let other = root(&mut parent, corner);
            if other != joined {
                let (large, small) = match size[joined] >= size[other] {
                    true => (joined, other),
                    false => (other, joined),
                };
                parent[small] = large;
                size[large] += size[small];
                joined = large;
            }
        }
        if size[joined] as f64 >= JOINED * points as f64 {
            return *radius;
        }
    }
    ascending.last().map_or(0.0, |(radius, _)| *radius)
}

fn root(parent: &mut [usize], mut at: usize) -> usize {
    while parent[at] != at {
        parent[at] = parent[parent[at]];
        at = parent[at];
    }
    at
}

/// Six times the signed volume.
fn determinant([a, b, c, d]: [Vector3<f64>; 4]) -> f64 {
    (b - a).cross(&(c - a)).dot(&(d - a))
}

fn volume(corners: [Vector3<f64>; 4]) -> f64 {
    determinant(corners).abs() / 6.0
}

fn circumradius(corners: [Vector3<f64>; 4]) -> f64 {
    let [a, b, c, d] = corners;
    let (u, v, w) = (b - a, c - a, d - a);
    let centre = (v.cross(&w) * u.norm_squared()
        + w.cross(&u) * v.norm_squared()
        + u.cross(&v) * w.norm_squared())
        / (2.0 * u.dot(&v.cross(&w)));
    // Flat tetrahedra have no sphere.
    match centre.norm() {
        radius if radius.is_finite() => radius,
        _ => f64::INFINITY,
    }
}

/// Area of a plane polygon.
fn polygon_area(corners: &[Vector3<f64>]) -> f64 {
    let Some(first) = corners.first() else {
        return 0.0;
    };
    let fan = corners
        .windows(2)
        .map(|pair| (pair[0] - first).cross(&(pair[1] - first)));
    fan.sum::<Vector3<f64>>().norm() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use std::f64::consts::PI;

    /// Points in the unit ball, none nearer to the centre than `hollow`.
    fn ball(count: usize, hollow: f64) -> Vec<Vector3<f64>> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        let mut points = Vec::new();
        while points.len() < count {
            let p = Vector3::from_fn(|_, _| 2.0 * rng.random::<f64>() - 1.0);
            if (hollow..=1.0).contains(&p.norm()) {
                points.push(p);
            }
        }
        points
    }

    #[test]
    fn a_full_ball_has_nearly_its_volume_and_its_sections() {
        let shape = AlphaShape::new(ball(6000, 0.0), None);
        let share = shape.volume / (4.0 / 3.0 * PI);
        assert!((0.88..1.0).contains(&share), "{share}");
        for height in [0.0, 0.5] {
            let section = shape.section(&Vector3::new(0.0, 0.0, height), &Vector3::z());
            let share = section / (PI * (1.0 - height * height));
            assert!((0.85..1.0).contains(&share), "{share}");
        }
        // A closed surface: every edge of its boundary lies between as many triangles as make it even.
        let mut edges: HashMap<[usize; 2], usize> = HashMap::new();
        for [a, b, c] in shape.boundary() {
            for (a, b) in [(a, b), (b, c), (c, a)] {
                *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
            }
        }
        assert!(edges.values().all(|count| count % 2 == 0));
    }

    /// The boundary runs through the outermost points: what is missing beyond them shrinks with their distances, by the third
    /// root of their number.
    #[test]
    fn a_hollow_ball_keeps_its_hollow_and_more_points_come_nearer_to_its_volume() {
        let expected = 4.0 / 3.0 * PI * (1.0 - 0.7_f64.powi(3));
        let missing = |count: usize| {
            let shape = AlphaShape::new(ball(count, 0.7), None);
            1.0 - shape.volume / expected
        };
        let (few, many) = (missing(6000), missing(24_000));
        assert!(
            (0.0..0.2).contains(&few) && (0.0..0.75 * few).contains(&many),
            "{few} {many}"
        );
        let shape = AlphaShape::new(ball(6000, 0.7), None);
        let hull = AlphaShape::new(ball(6000, 0.7), Some(1e6));
        assert!(hull.volume > 1.4 * shape.volume);
    }

    #[test]
    fn points_in_a_plane_have_no_volume() {
        let flat = (0..50).map(|k| Vector3::new(f64::from(k % 7), f64::from(k / 7), 0.0));
        assert!(AlphaShape::new(flat.collect(), None).volume < 1e-6);
        assert_eq!(AlphaShape::new(Vec::new(), None).volume, 0.0);
    }
}
