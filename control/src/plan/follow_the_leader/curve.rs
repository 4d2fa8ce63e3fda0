//! Curves through points, by their arc length.

use nalgebra::{Unit, UnitQuaternion, Vector3};

/// A line through points, by arc length.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    points: Vec<Vector3<f64>>,
    /// Arc length at each point (m).
    lengths: Vec<f64>,
}

impl Curve {
    /// The line through points, of which successive ones differ; `None` for fewer than two.
    pub fn new(points: impl IntoIterator<Item = Vector3<f64>>) -> Option<Self> {
        let mut curve = Self {
            points: Vec::new(),
            lengths: Vec::new(),
        };
        for point in points {
            let along = match (curve.points.last(), curve.lengths.last()) {
                (Some(last), Some(length)) => length + (point - last).norm(),
                _ => 0.0,
            };
            if curve.lengths.last().is_none_or(|last| along > *last) {
                curve.points.push(point);
                curve.lengths.push(along);
            }
        }
        (curve.points.len() >= 2).then_some(curve)
    }

    /// Its length (m).
    pub fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    /// The point at an arc length (m); on the end lines beyond.
    pub fn at(&self, along: f64) -> Vector3<f64> {
        let piece = self.piece(along);
        self.points[piece] + self.direction(piece) * (along - self.lengths[piece])
    }

    /// The unit vector in which it begins.
    pub fn start_direction(&self) -> Vector3<f64> {
        self.direction(0)
    }

    /// The point nearest to another of those up to an arc length (m), and the unit vector along the curve there; none at an end.
    pub fn nearest(&self, to: &Vector3<f64>, end: f64) -> (Vector3<f64>, Option<Vector3<f64>>) {
        let mut nearest = (f64::INFINITY, self.points[0], None);
        for piece in 0..self.points.len() - 1 {
            let whole = f64::min(self.lengths[piece + 1], end) - self.lengths[piece];
            if whole <= 0.0 && piece > 0 {
                break;
            }
            let (from, direction) = (self.points[piece], self.direction(piece));
            let along = (to - from).dot(&direction);
            let on = along.clamp(0.0, whole.max(0.0));
            let point = from + direction * on;
            let distance = (to - point).norm_squared();
            if distance < nearest.0 {
                let first = piece == 0 && on == 0.0;
                let last = self.lengths[piece] + on >= end.min(self.length());
                nearest = (distance, point, (!first && !last).then_some(direction));
            }
        }
        (nearest.1, nearest.2)
    }

    /// The curve with a straight line of a length (m) before it.
    pub fn lengthened(&self, before: f64) -> Self {
        let first = self.points[0] - self.start_direction() * before;
        let points = std::iter::once(first).chain(self.points.iter().copied());
        Self::new(points).unwrap_or_else(|| self.clone())
    }

    /// The curve bent by a share of what it is: of the turn between one piece and the next.
    pub fn bent(&self, share: f64) -> Self {
        let mut points = vec![self.points[0]];
        let mut direction = self.start_direction();
        let mut last = self.points[0];
        for piece in 0..self.points.len() - 1 {
            if piece > 0 {
                let pair = [self.direction(piece - 1), self.direction(piece)];
                direction = turned(&pair, share) * direction;
            }
            last += direction * (self.lengths[piece + 1] - self.lengths[piece]);
            points.push(last);
        }
        Self::new(points).unwrap_or_else(|| self.clone())
    }

    /// The piece on which an arc length is.
    fn piece(&self, along: f64) -> usize {
        let after = self.lengths.partition_point(|length| *length <= along);
        after.clamp(1, self.points.len() - 1) - 1
    }

    fn direction(&self, piece: usize) -> Vector3<f64> {
        (self.points[piece + 1] - self.points[piece]).normalize()
    }
}

/// A share of the shortest rotation from one direction to another.
fn turned([from, to]: &[Vector3<f64>; 2], share: f64) -> UnitQuaternion<f64> {
    let axis = from.cross(to);
    let angle = axis.norm().atan2(from.dot(to));
    match Unit::try_new(axis, 1e-12) {
        Some(axis) => UnitQuaternion::from_axis_angle(&axis, share * angle),
        None => UnitQuaternion::identity(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    fn arc() -> Curve {
        let at = |k: i32| {
            let (sin, cos) = (f64::from(k) * 0.01).sin_cos();
            Vector3::new(cos, sin, 0.0)
        };
        Curve::new((0..=100).map(at)).unwrap()
    }

    #[test]
    fn a_curve_bent_by_nothing_is_straight_and_by_all_of_it_itself() {
        let (arc, straight) = (arc(), arc().bent(0.0));
        let end = straight.at(straight.length());
        assert!((end - straight.at(0.0)).norm() > straight.length() - 1e-9);
        let whole = arc.bent(1.0);
        assert!((whole.at(0.7) - arc.at(0.7)).norm() < 1e-12);
        assert!((arc.length() - 1.0).abs() < 1e-5);
    }

    #[test]
    fn the_nearest_point_is_on_the_part_that_counts() {
        let arc = arc();
        let (point, along) = arc.nearest(
            &Vector3::new(2.0 * 0.5_f64.cos(), 2.0 * 0.5_f64.sin(), 0.0),
            1.0,
        );
        assert!((point - arc.at(0.5)).norm() < 1e-4);
        assert!(along.is_some());
        let (end, along) = arc.nearest(
            &Vector3::new(2.0 * 0.5_f64.cos(), 2.0 * 0.5_f64.sin(), 0.0),
            0.3,
        );
        assert!((end - arc.at(0.3)).norm() < 1e-12);
        assert!(along.is_none());
        let before = arc.lengthened(0.5);
        assert!((before.length() - arc.length() - 0.5).abs() < 1e-12);
    }
}
