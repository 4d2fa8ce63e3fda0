//! Closest points on triangles (Ericson, Real-Time Collision Detection, 2005, section 5.1.5).

use nalgebra::Vector3;

/// A triangle whose height is less than so much of its longest side has no face: it is its edges.
const SLIM: f64 = 1e-10;

/// The feature of a triangle whose Voronoi region a point is in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Region {
    /// The face, with its unit normal.
    Face(Vector3<f64>),
    /// The edge from this corner to the next.
    Edge(usize),
    /// This corner.
    Vertex(usize),
}

/// The unit normal by the order of the corners (m); none where they are on a line.
pub(super) fn normal(corners: &[Vector3<f64>; 3]) -> Option<Vector3<f64>> {
    let [a, b, c] = corners;
    let doubled = (b - a).cross(&(c - a));
    let longest = [b - a, c - b, a - c].map(|side| side.norm_squared());
    let longest = longest.into_iter().fold(0.0, f64::max);
    let area = doubled.norm();
    (area > SLIM * longest).then(|| doubled / area)
}

/// The point of a triangle nearest to `point` (m), and the feature that it is of.
pub(super) fn closest(corners: &[Vector3<f64>; 3], point: &Vector3<f64>) -> (Vector3<f64>, Region) {
    if let Some(normal) = normal(corners) {
        // In front of all three edges: above the face.
        let above = (0..3).all(|k| {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            normal.cross(&(to - from)).dot(&(point - from)) >= 0.0
        });
        if above {
            let height = normal.dot(&(point - corners[0]));
            return (point - normal * height, Region::Face(normal));
        }
    }
    let mut nearest = (corners[0], Region::Vertex(0));
    let mut least = f64::INFINITY;
    for k in 0..3 {
        let next = (k + 1) % 3;
        let (foot, share) = on_segment(&corners[k], &corners[next], point);
        let squared = (point - foot).norm_squared();
        if squared < least {
            least = squared;
            let region = match share {
                share if share <= 0.0 => Region::Vertex(k),
                share if share >= 1.0 => Region::Vertex(next),
                _ => Region::Edge(k),
            };
            nearest = (foot, region);
        }
    }
    nearest
}

/// The point of a segment nearest to `point` (m), and its share of the way from the first end to the second.
pub(super) fn on_segment(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    point: &Vector3<f64>,
) -> (Vector3<f64>, f64) {
    let side = to - from;
    let squared = side.norm_squared();
    let share = match side.dot(&(point - from)) {
        ahead if ahead <= 0.0 => 0.0,
        ahead if ahead >= squared => 1.0,
        ahead => ahead / squared,
    };
    match share {
        1.0 => (*to, share),
        _ => (from + side * share, share),
    }
}

/// How often, counted by the side it comes from, the ray from `origin` (m) along `ray` crosses the triangle: 1, -1 or 0 (Moeller and
/// Trumbore, 1997).
pub(super) fn crossing(
    corners: &[Vector3<f64>; 3],
    origin: &Vector3<f64>,
    ray: &Vector3<f64>,
) -> i32 {
    let [a, b, c] = corners;
    let (ab, ac, from_a) = (b - a, c - a, origin - a);
    let (p, q) = (ray.cross(&ac), from_a.cross(&ab));
    let determinant = ab.dot(&p);
    // Barycentric coordinates of the crossing, and its distance in lengths of the ray.
    let v = from_a.dot(&p) / determinant;
    let w = ray.dot(&q) / determinant;
    let ahead = ac.dot(&q) / determinant;
    match v >= 0.0 && w >= 0.0 && v + w <= 1.0 && ahead >= 0.0 {
        true if determinant > 0.0 => 1,
        true if determinant < 0.0 => -1,
        _ => 0,
    }
}
