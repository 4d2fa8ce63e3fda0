//! A mesh of a million triangles.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use tdcr_sim::contact::{ContactSettler, Partner};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};

/// Squares of the plate along each side, each of two triangles.
const SQUARES: usize = 708;
/// Half of its sides (m), and how high its waves are (m), of a length of 60 mm: less curved than the beads.
const HALF: f64 = 1.5;
const WAVES: f64 = 1e-3;

/// Height of the plate over its plane (m).
fn height(x: f64, y: f64) -> f64 {
    let phase = std::f64::consts::TAU / 0.06;
    WAVES * (phase * x).sin() * (phase * y).cos()
}

/// Writes the plate as a binary STL file.
fn write_plate(path: &Path) {
    let mut file = BufWriter::new(File::create(path).unwrap());
    file.write_all(&[0; 80]).unwrap();
    file.write_all(&(2 * SQUARES as u32 * SQUARES as u32).to_le_bytes())
        .unwrap();
    let place = |number: usize| HALF * (2.0 * number as f64 / SQUARES as f64 - 1.0);
    let corner = |i: usize, j: usize| {
        let [x, y] = [place(i), place(j)];
        [x, y, height(x, y)].map(|coordinate| coordinate as f32)
    };
    for (i, j) in (0..SQUARES).flat_map(|i| (0..SQUARES).map(move |j| (i, j))) {
        let [a, b, c, d] =
            [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|[i, j]| corner(i, j));
        for triangle in [[a, b, c], [a, c, d]] {
            // The normal, which readers take from the corners, before them, and two bytes of attributes behind.
            file.write_all(&[0; 12]).unwrap();
            for coordinate in triangle.as_flattened() {
                file.write_all(&coordinate.to_le_bytes()).unwrap();
            }
            file.write_all(&[0; 2]).unwrap();
        }
    }
    file.flush().unwrap();
}

/// A robot leans on it as on the waves that it stands for.
#[test]
fn a_robot_leans_on_a_mesh_of_a_million_triangles() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("plate.stl");
    write_plate(&file);
    let turned = std::f64::consts::FRAC_1_SQRT_2;
    let wall = Obstacle::mesh("plate", &file, 1.0)
        .unwrap()
        .at([-0.05, 0.0, 0.25])
        .with_orientation([turned, 0.0, turned, 0.0])
        .unwrap();
    let robot = Robot::load("2m").unwrap();
    let command = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
    let command = robot.command(&command).unwrap();
    let scene = Scene::new(vec![wall]).unwrap();
    let mut settler = ContactSettler::new(&robot, &scene);
    let found = settler.settle(&command, &Loads::default()).unwrap();
    assert!(found.equilibrium.converged && found.equilibrium.residual <= 1e-9);
    assert!(found.complementarity <= 1e-12 && !found.contacts.is_empty());
    for contact in &found.contacts {
        assert_eq!(contact.partner, Partner::Obstacle(0));
        let own = scene.obstacles()[0].pose.inverse() * nalgebra::Point3::from(contact.point);
        // Triangles of 6 mm are within the waves' curvature, 22 / m, times an eighth of that squared.
        assert!((own.z - height(own.x, own.y)).abs() < 1e-4, "{own}");
        assert!(contact.normal.x > 0.9, "{}", contact.normal);
    }
}
