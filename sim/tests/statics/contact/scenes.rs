//! Random scenes with bent pipes, and with concave meshes: rings and angle irons.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::geometry::Shape;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::{Obstacle, ObstacleShape, Scene};

use plain::Place;

#[path = "../../common/scenes.rs"]
mod plain;

/// A random scene of 1 to 5 obstacles of all shapes about a robot; a few are in the way of the straight robot.
pub fn scene(rng: &mut ChaCha8Rng, robot: &Robot) -> Scene {
    plain::scene(rng, robot, obstacle)
}

fn obstacle(rng: &mut ChaCha8Rng, name: &str, place: &Place) -> Obstacle {
    match rng.random_range(0..10) {
        2 => {
            let radius = rng.random_range(0.03..0.06);
            let bent = Obstacle::pipe_along(name, radius, &bends(rng, radius)).unwrap();
            bent.at([0.0, 0.0, place.height])
        }
        3 => {
            let [far, thick] = [rng.random_range(0.05..0.08), rng.random_range(0.01..0.02)];
            let ring = Obstacle::new(name, ObstacleShape::Solid(torus(far, thick)));
            ring.at([0.0, 0.0, place.height])
        }
        4 => {
            let iron = Obstacle::new(name, ObstacleShape::Solid(angle(place.size)));
            place.beside(rng, iron)
        }
        straight @ 0..2 => place.plain(rng, name, straight),
        convex => place.plain(rng, name, convex - 3),
    }
}

/// A line for a pipe of a radius (m) that bends to and fro about the straight robot, and away above it.
fn bends(rng: &mut ChaCha8Rng, radius: f64) -> Vec<[f64; 3]> {
    let most = 0.6 * (radius - 0.022);
    let mut aside = |most: f64| rng.random_range(-most..most);
    let about = (0..4).map(|k| 0.1 * f64::from(k));
    let mut line: Vec<[f64; 3]> = about.map(|z| [aside(most), aside(most), z]).collect();
    line.push([aside(0.2), aside(0.2), 0.5]);
    line
}

/// A ring about the z axis: the distance of its middle line from that, and its thickness (m).
fn torus(radius: f64, thickness: f64) -> Shape {
    const ALONG: u32 = 24;
    const AROUND: u32 = 10;
    let turn = |number: u32, of: u32| std::f64::consts::TAU * f64::from(number) / f64::from(of);
    let corner = |number: u32| {
        let (along, around) = (turn(number / AROUND, ALONG), turn(number % AROUND, AROUND));
        let away = radius + 0.5 * thickness * around.cos();
        [
            away * along.cos(),
            away * along.sin(),
            0.5 * thickness * around.sin(),
        ]
    };
    let corners: Vec<[f64; 3]> = (0..ALONG * AROUND).map(corner).collect();
    let patch = |number: u32| {
        let (along, around) = (number / AROUND, number % AROUND);
        let at = |along: u32, around: u32| (along % ALONG) * AROUND + around % AROUND;
        let [a, b, c, d] = [
            at(along, around),
            at(along + 1, around),
            at(along + 1, around + 1),
            at(along, around + 1),
        ];
        [[a, b, c], [a, c, d]]
    };
    let triangles: Vec<[u32; 3]> = (0..ALONG * AROUND).flat_map(patch).collect();
    Shape::mesh(&corners, &triangles).unwrap()
}

/// An angle iron, with a concave edge: two plates of this width (m) at right angles to each other.
fn angle(size: f64) -> Shape {
    let [w, t] = [1.1 * size, 0.4 * size];
    let section = [
        [-w, -w],
        [w, -w],
        [w, t - w],
        [t - w, t - w],
        [t - w, w],
        [-w, w],
    ];
    let corner = |[x, y]: [f64; 2], z: f64| [x, y, z];
    let [below, above] = [-size, size].map(|z| section.map(|at| corner(at, z)));
    let corners = [below, above].concat();
    // Seen from above; below turned about.
    let faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
    let mut triangles: Vec<[u32; 3]> = faces.map(|[a, b, c]| [a + 6, b + 6, c + 6]).to_vec();
    triangles.extend(faces.map(|[a, b, c]| [a, c, b]));
    triangles.extend((0..6).flat_map(|a: u32| {
        let b = (a + 1) % 6;
        [[a, b, b + 6], [a, b + 6, a + 6]]
    }));
    Shape::mesh(&corners, &triangles).unwrap()
}
