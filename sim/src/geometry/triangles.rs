//! Surfaces as triangles: where planes cut them, and which of their edges are seen.

use std::collections::HashMap;

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::Vec3;
use parry3d_f64::shape;
use parry3d_f64::transformation::try_convex_hull;

use super::Shape;
use super::shape::Kind;

/// Corners around the axis of what is round.
const AROUND: u32 = 36;
/// Cosine of the angle (30 degrees) between the normals of two triangles from which on their edge is drawn.
const CREASE: f64 = 0.866;

/// Share of a hull's volume that a surface may lack and be convex.
const CONVEX: f64 = 1e-9;

/// A surface of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    /// Corners (m).
    pub points: Vec<Vector3<f64>>,
    /// Triangles, of the corners' numbers.
    pub triangles: Vec<[u32; 3]>,
}

/// The ends of an edge, and the normals of the triangles that it is of.
type Edge = ([Vector3<f64>; 2], Vec<Vector3<f64>>);

impl Shape {
    /// Its surface at a pose (m); what is round has 36 corners around.
    pub fn triangles(&self, pose: &Isometry3<f64>) -> Triangles {
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
        let (points, triangles) = match &self.0 {
            Kind::Cuboid(cuboid) => {
                let half = cuboid.half;
                shape::Cuboid::new(x * half.x + y * half.y + z * half.z).to_trimesh()
            }
            Kind::Sphere(sphere) => shape::Ball::new(sphere.radius).to_trimesh(AROUND, AROUND / 2),
            Kind::Capsule(capsule) => {
                let end = z * capsule.half_length;
                shape::Capsule::new(-end, end, capsule.radius).to_trimesh(AROUND, AROUND / 2)
            }
            Kind::Cylinder(cylinder) => {
                // That of parry is about the y axis.
                let (points, triangles) =
                    shape::Cylinder::new(cylinder.half_height, cylinder.radius).to_trimesh(AROUND);
                let turned = points.iter().map(|p| x * p.z + y * p.x + z * p.y);
                (turned.collect(), triangles)
            }
            Kind::Mesh(mesh) => (mesh.mesh.vertices().to_vec(), mesh.mesh.indices().to_vec()),
        };
        let placed = points.iter().map(|p| pose * Point3::new(p.x, p.y, p.z));
        Triangles {
            points: placed.map(|point| point.coords).collect(),
            triangles,
        }
    }

    /// The surface of its convex hull, where the shape is closed and convex, so that the hull is the shape itself; `None` of others.
    pub(crate) fn convex_surface(&self) -> Option<Triangles> {
        let surface = self.triangles(&Isometry3::identity());
        let hull = surface.hull()?;
        (surface.volume().abs() >= (1.0 - CONVEX) * hull.volume()).then_some(hull)
    }
}

impl Triangles {
    /// Where the plane through `point` at right angles to `normal` cuts the surface: the ends of straight pieces (m).
    pub fn section(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> Vec<[Vector3<f64>; 2]> {
        let cut = |corners| cut(corners, point, normal);
        self.corners().filter_map(cut).collect()
    }

    /// The edges that one sees from far away in the direction `towards`, those behind others included: where the surface turns
    /// away, ends, or bends by more than 30 degrees. The ends of each (m).
    pub fn edges(&self, towards: &Vector3<f64>) -> Vec<[Vector3<f64>; 2]> {
        // Triangles of files share places, not numbers.
        let mut places = HashMap::new();
        let mut place = |p: Vector3<f64>| {
            let next = places.len();
            *places
                .entry([p.x, p.y, p.z].map(f64::to_bits))
                .or_insert(next)
        };
        let mut edges: HashMap<[usize; 2], Edge> = HashMap::new();
        for corners in self.corners() {
            let [a, b, c] = corners;
            let Some(normal) = (b - a).cross(&(c - a)).try_normalize(0.0) else {
                continue;
            };
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let (mut first, mut last) = (place(from), place(to));
                if first > last {
                    (first, last) = (last, first);
                }
                let edge = edges.entry([first, last]);
                edge.or_insert(([from, to], Vec::new())).1.push(normal);
            }
        }
        let is_seen = |normals: &[Vector3<f64>]| match normals {
            [one, other] => {
                let turns = (one.dot(towards) > 0.0) != (other.dot(towards) > 0.0);
                turns || one.dot(other) < CREASE
            }
            _ => true,
        };
        let mut seen: Vec<_> = (edges.into_iter())
            .filter(|(_, (_, normals))| is_seen(normals))
            .map(|(key, (ends, _))| (key, ends))
            .collect();
        seen.sort_unstable_by_key(|(key, _)| *key);
        seen.into_iter().map(|(_, ends)| ends).collect()
    }

    /// What a closed surface encloses (m³).
    pub fn volume(&self) -> f64 {
        // Of the tetrahedra on its triangles, from a corner near all of them.
        let apex = self.points.first().copied().unwrap_or_default();
        let six = |[a, b, c]: [Vector3<f64>; 3]| (a - apex).dot(&(b - apex).cross(&(c - apex)));
        self.corners().map(six).sum::<f64>() / 6.0
    }

    /// The surface of the convex hull of its corners; `None` where that is flat.
    pub fn hull(&self) -> Option<Self> {
        let points: Vec<Vec3> = self
            .points
            .iter()
            .map(|p| Vec3::new(p.x, p.y, p.z))
            .collect();
        let (points, triangles) = try_convex_hull(&points).ok()?;
        let hull = Self {
            points: points.iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect(),
            triangles,
        };
        (hull.volume() > 0.0).then_some(hull)
    }

    fn corners(&self) -> impl Iterator<Item = [Vector3<f64>; 3]> {
        let corners = |triangle: &[u32; 3]| triangle.map(|corner| self.points[corner as usize]);
        self.triangles.iter().map(corners)
    }
}

/// Where the plane through `point` at right angles to `normal` cuts a triangle.
pub(super) fn cut(
    corners: [Vector3<f64>; 3],
    point: &Vector3<f64>,
    normal: &Vector3<f64>,
) -> Option<[Vector3<f64>; 2]> {
    let height = |p: &Vector3<f64>| (p - point).dot(normal);
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (corners[a], corners[b]));
    let mut ends = edges
        .into_iter()
        .filter(|(a, b)| (height(a) > 0.0) != (height(b) > 0.0))
        .map(|(a, b)| a + (b - a) * (height(&a) / (height(&a) - height(&b))));
    Some([ends.next()?, ends.next()?])
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    #[test]
    fn a_box_shows_its_twelve_edges_and_is_cut_along_its_four_sides() {
        let shape = Shape::cuboid([0.1, 0.2, 0.3]).unwrap();
        let pose = Isometry3::translation(1.0, 0.0, 0.0);
        let surface = shape.triangles(&pose);
        assert_eq!(surface.edges(&Vector3::new(1.0, 2.0, 3.0)).len(), 12);
        let pieces = surface.section(&Vector3::new(1.0, 0.0, 0.1), &Vector3::z());
        let length: f64 = pieces.iter().map(|[a, b]| (b - a).norm()).sum();
        assert!((length - 1.2).abs() < 1e-12, "{length}");
        assert!(pieces.iter().flatten().all(|p| (p.z - 0.1).abs() < 1e-12));
    }

    #[test]
    fn the_hull_of_a_box_is_the_box_and_that_of_two_is_more() {
        let shape = Shape::cuboid([0.1, 0.2, 0.3]).unwrap();
        let mut boxes = shape.triangles(&Isometry3::identity());
        assert!((boxes.volume() - 0.048).abs() < 1e-15);
        assert!((boxes.hull().unwrap().volume() - 0.048).abs() < 1e-12);
        let other = shape.triangles(&Isometry3::translation(1.0, 0.0, 0.0));
        let first = boxes.points.len() as u32;
        boxes.points.extend(other.points);
        boxes.triangles.extend(
            other
                .triangles
                .iter()
                .map(|t| t.map(|corner| corner + first)),
        );
        assert!((boxes.volume() - 0.096).abs() < 1e-12);
        assert!((boxes.hull().unwrap().volume() - 0.288).abs() < 1e-12);
        let flat = Triangles {
            points: vec![Vector3::zeros(); 4],
            triangles: Vec::new(),
        };
        assert!(flat.hull().is_none());
    }

    #[test]
    fn what_is_round_shows_its_outline() {
        let pose = Isometry3::identity();
        let length = |edges: Vec<[Vector3<f64>; 2]>| -> f64 {
            edges.iter().map(|[a, b]| (b - a).norm()).sum()
        };
        let ball = Shape::sphere(0.1).unwrap().triangles(&pose);
        let around = length(ball.edges(&Vector3::x()));
        assert!((around / 0.6283 - 1.0).abs() < 0.01, "{around}");
        // Two rims, and two lines between them.
        let post = Shape::cylinder(0.1, 0.3).unwrap().triangles(&pose);
        let around = length(post.edges(&Vector3::x()));
        assert!(
            (around / (2.0 * 0.6283 + 2.0 * 0.6) - 1.0).abs() < 0.01,
            "{around}"
        );
        let ends = post.points.iter().map(|p| p.z).fold(0.0, f64::max);
        assert!((ends - 0.3).abs() < 1e-12, "about the z axis: {ends}");
    }
}
