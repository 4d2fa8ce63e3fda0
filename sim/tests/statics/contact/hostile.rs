//! Scenes that no robot should be put in.

use tdcr_sim::contact::{ContactError, ContactSettler};
use tdcr_sim::geometry::Shape;
use tdcr_sim::robot::{Frame, Loads, Robot, Wrench};
use tdcr_sim::scene::{Obstacle, ObstacleShape, Scene};

const COMMAND: [f64; 6] = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];

/// Settles in a scene; whether it converged. All numbers are finite.
fn settle(obstacles: Vec<Obstacle>) -> Result<bool, ContactError> {
    let robot = Robot::load("2m").unwrap();
    let scene = Scene::new(obstacles).unwrap();
    let mut settler = ContactSettler::new(&robot, &scene);
    let command = robot.command(&COMMAND).unwrap();
    let found = settler.settle(&command, &Loads::default())?;
    assert!(
        found
            .equilibrium
            .positions
            .iter()
            .flatten()
            .all(|x| x.is_finite())
    );
    for contact in &found.contacts {
        assert!(
            contact
                .force
                .iter()
                .chain(&contact.point)
                .all(|x| x.is_finite())
        );
    }
    Ok(found.equilibrium.converged)
}

#[test]
fn a_robot_that_starts_inside_an_obstacle_is_told_which() {
    let ball = Obstacle::sphere("ball", 0.05).unwrap().at([0.0, 0.0, 0.25]);
    let error = settle(vec![Obstacle::half_space("floor"), ball]).unwrap_err();
    assert!(matches!(&error, ContactError::StartsInside { obstacle, .. } if obstacle == "ball"));
    assert!(
        error
            .to_string()
            .contains("starts inside obstacle \"ball\""),
        "{error}"
    );
}

#[test]
fn a_robot_inside_a_closed_mesh_starts_inside_it_and_one_in_an_open_mesh_does_not() {
    let s = 0.4;
    let corners = [[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]];
    let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
    let mesh = |faces: &[[u32; 3]]| {
        let shape = Shape::mesh(&corners, faces).unwrap();
        Obstacle::new("mesh", ObstacleShape::Solid(shape)).at([0.0, 0.0, 0.25])
    };
    assert!(matches!(
        settle(vec![mesh(&faces)]),
        Err(ContactError::StartsInside { .. })
    ));
    assert!(settle(vec![mesh(&faces[..3])]).unwrap());
}

#[test]
fn moments_are_refused_among_obstacles_and_name_their_disc() {
    let robot = Robot::load("2m").unwrap();
    let wrench = Wrench {
        moment: [0.0, 0.0, 1e-3],
        ..Wrench::none(4, Frame::World)
    };
    let loads = Loads::default().with_wrench(wrench).unwrap();
    let command = robot.command(&COMMAND).unwrap();
    let floor = Scene::new(vec![Obstacle::half_space("floor")]).unwrap();
    let error = ContactSettler::new(&robot, &floor)
        .settle(&command, &loads)
        .unwrap_err();
    assert_eq!(error, ContactError::Loads { disc: 4 });
    let alone = ContactSettler::new(&robot, &Scene::default());
    assert!(
        alone
            .clone()
            .settle(&command, &loads)
            .unwrap()
            .equilibrium
            .converged
    );
}

#[test]
fn obstacles_that_overlap_press_together() {
    let post = |name: &str, x: f64| {
        let post = Obstacle::cylinder(name, 0.01, 0.4).unwrap();
        post.at([x, 0.001, 0.25])
    };
    assert!(settle(vec![post("a", -0.06), post("b", -0.058), post("c", -0.06)]).unwrap());
}

#[test]
fn sizes_at_the_limits_of_scene_files_give_an_answer() {
    // Of large ones the position of the surface is rounded to 1e-10 m, and the forces to 1e-4 N.
    for radius in [1e2, 9e5] {
        let ball = Obstacle::sphere("ball", radius).unwrap();
        settle(vec![ball.at([-0.08 - radius, 0.0, 0.22])]).unwrap();
    }
    for radius in [1e-12, 1e-6, 1.0] {
        let ball = Obstacle::sphere("ball", radius).unwrap();
        assert!(
            settle(vec![ball.at([-0.08 - radius, 0.0, 0.22])]).unwrap(),
            "{radius}"
        );
    }
    // A wall so soft that beads sink in beyond their radius may have no answer, and says so.
    for compliance in [1.0, 1e15] {
        let soft = Obstacle::cuboid("wall", [0.01, 1.0, 1.0]).unwrap();
        let soft = soft.at([-0.07, 0.0, 0.3]).with_compliance(compliance);
        settle(vec![soft.unwrap()]).unwrap();
    }
    for compliance in [0.0, 1e-12, 1e-3] {
        let wall = Obstacle::cuboid("wall", [0.01, 1.0, 1.0]).unwrap();
        let wall = wall
            .at([-0.07, 0.0, 0.3])
            .with_compliance(compliance)
            .unwrap();
        assert!(settle(vec![wall]).unwrap(), "{compliance}");
    }
}

#[test]
fn a_slot_that_is_too_narrow_squeezes_the_discs() {
    let wall = |name: &str, x: f64| {
        let wall = Obstacle::cuboid(name, [0.04, 1.0, 1.0]).unwrap();
        wall.at([x, 0.0, 0.25]).with_compliance(1e-4).unwrap()
    };
    // 38 mm between the walls, and discs of 40 mm.
    assert!(settle(vec![wall("left", -0.039), wall("right", 0.039)]).unwrap());
}
