//! How far a point is from an obstacle.

use nalgebra::Vector3;

use super::{Obstacle, ObstacleShape};
use crate::geometry::Kind;

impl Obstacle {
    /// Signed distance of a point in the world from the obstacle's surface (m): below 0 inside. A mesh that is not closed has no
    /// inside, and no distance from it is below 0.
    ///
    /// ```
    /// use tdcr_sim::scene::Obstacle;
    ///
    /// let ball = Obstacle::sphere("ball", 0.02)?.at([0.1, 0.0, 0.0]);
    /// assert!((ball.signed_distance(&[0.0, 0.0, 0.0].into()) - 0.08).abs() < 1e-15);
    /// # Ok::<(), tdcr_sim::scene::SceneError>(())
    /// ```
    pub fn signed_distance(&self, point: &Vector3<f64>) -> f64 {
        self.signed_distance_and_gradient(point).0
    }

    /// [`signed_distance`](Self::signed_distance), and its gradient by the point, world axes.
    pub(crate) fn signed_distance_and_gradient(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let local = self.pose.inverse_transform_point(&(*point).into()).coords;
        let (distance, normal) = match &self.shape {
            ObstacleShape::HalfSpace => (local.z, Vector3::z()),
            ObstacleShape::Pipe(pipe) => {
                let nearest = pipe.nearest(&local);
                (nearest.distance, nearest.normal)
            }
            ObstacleShape::Solid(shape) => {
                let nearest = shape.nearest(&local);
                // That from a mesh is above 0 on either side of its triangles.
                match &shape.0 {
                    Kind::Mesh(_) if shape.contains(&local) => (-nearest.distance, -nearest.normal),
                    _ => (nearest.distance, nearest.normal),
                }
            }
        };
        (distance, self.pose.rotation * normal)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    /// A cube of triangles whose sides are 2 m.
    fn cube() -> crate::geometry::Shape {
        let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(|bit| f64::from(bit) * 2.0 - 1.0);
        let corners: Vec<[f64; 3]> = (0..8).map(corner).collect();
        let sides = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        let triangles: Vec<[u32; 3]> = sides.into_iter().flat_map(halves).collect();
        crate::geometry::Shape::mesh(&corners, &triangles).unwrap()
    }

    #[test]
    fn a_mesh_and_the_box_of_its_size_are_equally_far_inside_and_outside() {
        let mesh = Obstacle::new("mesh", ObstacleShape::Solid(cube())).at([0.3, 0.0, 0.0]);
        let cuboid = Obstacle::cuboid("box", [2.0; 3])
            .unwrap()
            .at([0.3, 0.0, 0.0]);
        let mut inside = 0;
        for step in 0..200 {
            let at = |turn: f64| 3.0 * (f64::from(step) * turn).fract() - 1.5;
            let point = Vector3::new(at(0.618), at(0.414), at(0.732));
            let [a, b] = [&mesh, &cuboid].map(|one| one.signed_distance(&point));
            assert!((a - b).abs() < 1e-12, "{point:?}: {a} {b}");
            inside += usize::from(a < 0.0);
        }
        assert!((20..150).contains(&inside), "{inside}");
    }

    #[test]
    fn the_gradient_is_that_of_the_distance() {
        let turned = nalgebra::UnitQuaternion::from_euler_angles(0.3, -0.5, 1.1);
        let pose = nalgebra::Isometry3::from_parts([0.3, 0.1, -0.2].into(), turned);
        let obstacles = [
            Obstacle::half_space("floor"),
            Obstacle::new("mesh", ObstacleShape::Solid(cube())),
            Obstacle::cuboid("box", [1.0, 2.0, 0.5]).unwrap(),
            Obstacle::capsule("bar", 0.3, 1.0).unwrap(),
            Obstacle::pipe("pipe", 0.9, 3.0).unwrap(),
        ];
        for obstacle in obstacles.map(|obstacle| obstacle.with_pose(pose)) {
            for step in 0..50 {
                let at = |turn: f64| 1.4 * (f64::from(step) * turn).fract() - 0.7;
                let point = Vector3::new(at(0.618), at(0.414), at(0.732));
                let gradient = obstacle.signed_distance_and_gradient(&point).1;
                let difference = Vector3::from_fn(|axis, _| {
                    let mut step = Vector3::zeros();
                    step[axis] = 1e-6;
                    let [below, above] =
                        [point - step, point + step].map(|p| obstacle.signed_distance(&p));
                    (above - below) / 2e-6
                });
                let off = (gradient - difference).amax();
                assert!(off < 1e-6, "{} {point:?}: {off:e}", obstacle.name);
            }
        }
    }

    #[test]
    fn planes_and_pipes_are_solid_on_one_side() {
        let floor = Obstacle::half_space("floor").at([0.0, 0.0, 0.1]);
        assert_eq!(
            floor.signed_distance(&Vector3::new(1.0, 2.0, 0.3)),
            0.3 - 0.1
        );
        let pipe = Obstacle::pipe("pipe", 0.02, 0.1).unwrap();
        assert!((pipe.signed_distance(&Vector3::new(0.015, 0.0, 0.0)) - 0.005).abs() < 1e-12);
        assert!(pipe.signed_distance(&Vector3::new(0.03, 0.0, 0.0)) < 0.0);
    }
}
