//! Random scenes.

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::geometry::Shape;
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{Obstacle, ObstacleShape, Scene};

/// A random scene of 1 to 5 obstacles about a robot, each made at a place; a few are in the way of the straight robot.
pub fn scene(
    rng: &mut ChaCha8Rng,
    robot: &Robot,
    obstacle: fn(&mut ChaCha8Rng, &str, &Place) -> Obstacle,
) -> Scene {
    let straight = robot.settle(&robot.mean_command(), &Loads::default());
    let low = robot.spec().base.position[2];
    let high = straight.positions[straight.positions.len() - 1].z;
    let count = rng.random_range(1..=5);
    let obstacles = (0..count).map(|number| {
        let place = Place::random(rng, [low, high]);
        obstacle(rng, &number.to_string(), &place)
    });
    Scene::new(obstacles.collect()).unwrap()
}

/// Where an obstacle stands, and how large it is.
pub struct Place {
    /// (m)
    pub size: f64,
    /// Away from the straight robot.
    out: Vector3<f64>,
    /// Rotation vector of the obstacle.
    turn: Vector3<f64>,
    /// (m)
    pub height: f64,
}

impl Place {
    fn random(rng: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> Self {
        let size = rng.random_range(0.01..0.05);
        let around = rng.random_range(0.0..std::f64::consts::TAU);
        Self {
            size,
            out: Vector3::new(f64::cos(around), f64::sin(around), 0.0),
            turn: Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0)),
            height: rng.random_range(low..high),
        }
    }

    /// An obstacle turned and beside the robot.
    pub fn beside(&self, rng: &mut ChaCha8Rng, mut obstacle: Obstacle) -> Obstacle {
        let away = 0.023 + self.size * 1.8 + rng.random_range(0.0..0.05);
        let above = Vector3::z() * self.height;
        obstacle.pose.translation = Translation3::from(self.out * away + above);
        obstacle.pose.rotation = UnitQuaternion::from_scaled_axis(self.turn);
        obstacle
    }

    /// The kind of obstacle with this number from 0 to 6: convex, or the inside of a straight pipe.
    pub fn plain(&self, rng: &mut ChaCha8Rng, name: &str, kind: u32) -> Obstacle {
        let size = self.size;
        let solid = match kind {
            0 => {
                let mut wall = Obstacle::half_space(name);
                wall.pose.translation = Translation3::from(self.out * rng.random_range(0.03..0.1));
                wall.pose.rotation =
                    UnitQuaternion::rotation_between(&Vector3::z(), &-self.out).unwrap();
                return wall;
            }
            1 => {
                let pipe = Obstacle::pipe(name, rng.random_range(0.03..0.06), 0.5).unwrap();
                return pipe.at([0.0, 0.0, self.height + 0.25]);
            }
            2 => Obstacle::sphere(name, size),
            3 => Obstacle::capsule(name, 0.5 * size, 4.0 * size),
            4 => Obstacle::cuboid(name, [2.0 * size, size, 2.0 * size]),
            5 => Ok(Obstacle::new(
                name,
                ObstacleShape::Solid(tetrahedron(1.4 * size)),
            )),
            _ => Obstacle::cylinder(name, size, 1.4 * size),
        };
        self.beside(rng, solid.unwrap())
    }
}

/// A mesh whose corners are this far from the origin (m).
fn tetrahedron(size: f64) -> Shape {
    let s = size / 3.0_f64.sqrt();
    let corners = [[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]];
    Shape::mesh(&corners, &[[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]).unwrap()
}
