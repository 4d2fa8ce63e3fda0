//! The features of a triangle mesh around a point: its faces, edges and vertices that are local minima of the distance.
//!
//! A face is one if the point projects into it; an edge or a vertex if the point is in its normal cone with respect to all
//! triangles around it, none of which has a nearer point then. A ball that rolls over coplanar triangles has one feature, one in a
//! concave edge those of both sides, one at a convex edge a single one with a continuous distance.
//!
//! Where regions meet, rounding may leave a point in both: distances count as equal up to a `slack`, and features whose feet on
//! the mesh are as near to each other as that admits are one. Then the face counts before the edge, the edge before the vertex.

use nalgebra::Vector3;
use parry3d_f64::math::Vec3;
use parry3d_f64::query::Ray;

use super::super::primitives::Mesh;
use super::triangle::{Region, closest, crossing, normal, on_segment};
use super::{Adjacency, Nearest, direction};

/// Errors of distances by rounding, relative to the extent of mesh and point.
const ROUNDING: f64 = 1e-12;

/// Directions in general position, along which rays are cast: most of them meet no edge.
const RAYS: [[f64; 3]; 3] = [
    [0.434_17, 0.271_83, 0.858_91],
    [-0.707_31, 0.577_29, 0.408_07],
    [0.161_8, -0.926_54, -0.339_73],
];

/// A feature of a mesh: its place nearest to the point (m), which of the features at one place counts (the lowest), and how near
/// places of one feature are (m).
#[derive(Clone, Copy)]
struct Feature {
    foot: Vector3<f64>,
    rank: u8,
    apart: f64,
    nearest: Nearest,
}

/// A point (m) seen from a mesh: what distances from it are known up to (m).
struct Query<'a> {
    mesh: &'a Mesh,
    point: Vector3<f64>,
    slack: f64,
}

impl Mesh {
    /// The corners of a triangle (m).
    pub(super) fn corners(&self, triangle: u32) -> [Vector3<f64>; 3] {
        self.mesh.indices()[triangle as usize].map(|vertex| self.vertex(vertex))
    }

    /// The position of a vertex (m).
    fn vertex(&self, vertex: u32) -> Vector3<f64> {
        let position = self.mesh.vertices()[vertex as usize];
        Vector3::new(position.x, position.y, position.z)
    }

    fn adjacency(&self) -> &Adjacency {
        let build = || Adjacency::new(self.mesh.vertices(), self.mesh.indices());
        self.adjacency.get_or_init(build)
    }

    /// The triangles whose boxes are within `reach` of a point (m).
    fn within(&self, point: &Vector3<f64>, reach: f64) -> impl Iterator<Item = u32> {
        let at = Vec3::new(point.x, point.y, point.z);
        (self.mesh.bvh()).leaves(move |node| {
            let beyond = (node.mins() - at).max(at - node.maxs()).max(Vec3::ZERO);
            beyond.length_squared() <= reach * reach
        })
    }

    /// Appends the features less than `reach` from a point (m), as [`super::Shape::features`].
    pub(super) fn features(&self, point: &Vector3<f64>, reach: f64, found: &mut Vec<Nearest>) {
        let extent = self.middle.norm() + self.half.norm() + point.norm();
        if reach.is_nan() || reach <= 0.0 || !extent.is_finite() {
            return;
        }
        let query = Query {
            mesh: self,
            point: *point,
            slack: ROUNDING * extent,
        };
        let features = merged(query.features(reach));
        found.extend(features.into_iter().map(|feature| feature.nearest));
    }

    /// Whether a point (m) is inside, as [`super::Shape::contains`]: whether rays from it leave the mesh more often, or less often,
    /// than they enter it. Of three rays two decide, as one may meet an edge.
    pub(super) fn contains(&self, point: &Vector3<f64>) -> bool {
        let from_middle = point - self.middle;
        let in_box = (0..3).all(|k| from_middle[k].abs() <= self.half[k]);
        if !in_box || !self.adjacency().closed {
            return false;
        }
        let inside = RAYS.iter().filter(|ray| {
            let ray = Vector3::from(**ray);
            let [origin, along] = [point, &ray].map(|v| Vec3::new(v.x, v.y, v.z));
            let parrys = Ray::new(origin, along);
            let met = (self.mesh.bvh()).leaves(|node| node.cast_ray(&parrys, f64::MAX) < f64::MAX);
            let crossings: i32 = met
                .map(|triangle| crossing(&self.corners(triangle), point, &ray))
                .sum();
            crossings != 0
        });
        inside.count() >= 2
    }
}

impl Query<'_> {
    /// The features within `reach` (m), some of them perhaps more than once.
    fn features(&self, reach: f64) -> Vec<Feature> {
        let mesh = self.mesh;
        let (mut faces, mut edges, mut vertices) = (Vec::new(), Vec::new(), Vec::new());
        let adjacency = mesh.adjacency();
        for triangle in mesh.within(&self.point, reach) {
            let (foot, region) = closest(&mesh.corners(triangle), &self.point);
            if (self.point - foot).norm() >= reach {
                continue;
            }
            match region {
                Region::Face(normal) => {
                    let away = self.point - foot;
                    let side = if normal.dot(&away) < 0.0 { -1.0 } else { 1.0 };
                    let nearest = Nearest::flat(away.norm(), normal * side);
                    faces.push(self.feature(foot, 0, nearest));
                }
                Region::Edge(corner) => edges.push(adjacency.edge(triangle, corner)),
                Region::Vertex(corner) => vertices.push(adjacency.vertex(triangle, corner)),
            }
        }
        edges.sort_unstable();
        edges.dedup();
        vertices.sort_unstable();
        vertices.dedup();
        let mut features = faces;
        features.extend(edges.into_iter().filter_map(|edge| {
            let [from, to] = edge.map(|vertex| mesh.vertex(vertex));
            let (foot, _) = on_segment(&from, &to, &self.point);
            let mut around = adjacency.around_edge(edge);
            let along = (to - from).try_normalize(0.0);
            (around.all(|triangle| !self.is_nearer(triangle, &foot)))
                .then(|| self.local_minimum(foot, along))?
        }));
        features.extend(vertices.into_iter().filter_map(|vertex| {
            let foot = mesh.vertex(vertex);
            let mut around = adjacency.around_vertex(vertex).iter();
            (around.all(|&triangle| !self.is_nearer(triangle, &foot)))
                .then(|| self.local_minimum(foot, None))?
        }));
        features
    }

    /// Whether a triangle has a point nearer than `foot`.
    fn is_nearer(&self, triangle: u32, foot: &Vector3<f64>) -> bool {
        let (other, _) = closest(&self.mesh.corners(triangle), &self.point);
        (self.point - other).norm() < (self.point - foot).norm() - self.slack
    }

    /// The feature at `foot`, on an edge along a unit vector or at a vertex, unless a triangle that it lies on has a nearer point:
    /// also one that does not share its vertices, as those behind a slim triangle or at a T-junction.
    ///
    /// On the boundary of its normal cone the curvature is that of the face, or of a vertex' edge, on the other side: a vertex
    /// within a flat or singly curved part of the mesh makes no corner.
    fn local_minimum(&self, foot: Vector3<f64>, edge: Option<Vector3<f64>>) -> Option<Feature> {
        let away = self.point - foot;
        let distance = away.norm();
        let (mut flat, mut along, mut otherwise) = (false, edge, None);
        for triangle in self.mesh.within(&foot, self.slack) {
            let corners = self.mesh.corners(triangle);
            if (closest(&corners, &foot).0 - foot).norm() > self.slack {
                continue;
            }
            if self.is_nearer(triangle, &foot) {
                return None;
            }
            if let Some(normal) = normal(&corners) {
                flat |= normal.dot(&away).abs() >= distance - self.slack;
                otherwise = otherwise.or(Some(normal));
            }
            along = along.or_else(|| self.edge_across(&corners, &foot));
        }
        let otherwise = otherwise.unwrap_or_else(Vector3::z);
        let nearest = match flat {
            true => Nearest::flat(distance, direction(&away, otherwise)),
            false => Nearest::round(&away, 0.0, along, otherwise),
        };
        Some(self.feature(foot, if edge.is_some() { 1 } else { 2 }, nearest))
    }

    /// The direction of an edge that ends at `foot`, at right angles to the way from there to the point.
    fn edge_across(
        &self,
        corners: &[Vector3<f64>; 3],
        foot: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        let away = self.point - foot;
        (0..3).find_map(|k| {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let ends = [from, to].map(|end| (end - foot).norm() <= self.slack);
            let along = (to - from).try_normalize(0.0)?;
            let across = along.dot(&away).abs() <= self.apart(away.norm());
            (ends[0] != ends[1] && across).then_some(along)
        })
    }

    /// How far a foot at a distance (m) may lie from that of a feature nearer by the slack, on a plane (m).
    fn apart(&self, distance: f64) -> f64 {
        (2.0 * distance * self.slack).sqrt() + self.slack
    }

    fn feature(&self, foot: Vector3<f64>, rank: u8, nearest: Nearest) -> Feature {
        Feature {
            foot,
            rank,
            apart: 2.0 * self.apart(nearest.distance),
            nearest,
        }
    }
}

/// One feature for each place: of those at one place the one of the lowest rank.
fn merged(mut features: Vec<Feature>) -> Vec<Feature> {
    features.sort_by(|a, b| a.foot.x.total_cmp(&b.foot.x));
    let mut kept: Vec<Feature> = Vec::with_capacity(features.len());
    for feature in features {
        let close = (kept.iter_mut().rev())
            .take_while(|other| feature.foot.x - other.foot.x <= feature.apart)
            .find(|other| (feature.foot - other.foot).norm() <= feature.apart);
        match close {
            Some(other) if feature.rank < other.rank => {
                // Where it is in the order stays.
                let foot = other.foot;
                *other = Feature { foot, ..feature };
            }
            Some(_) => {}
            None => kept.push(feature),
        }
    }
    kept
}

#[cfg(test)]
pub(super) mod tests;
