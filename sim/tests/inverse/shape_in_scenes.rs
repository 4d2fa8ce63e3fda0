//! Commands for target shapes among obstacles.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{ContactError, ContactSettler};
use tdcr_sim::inverse::shape::{
    Arrival, Outcome, Search, ShapeControlError, ShapeController, Target,
};
use tdcr_sim::robot::{Frame, Loads, Robot, Wrench};
use tdcr_sim::scene::{Obstacle, Scene};

/// Two posts that the robot of two modules leans on under many commands.
fn posts() -> Scene {
    let post = |name, x, y| {
        let post = Obstacle::cylinder(name, 0.01, 0.4).unwrap();
        post.at([x, y, 0.25])
    };
    Scene::new(vec![post("left", -0.06, 0.0), post("right", 0.05, 0.03)]).unwrap()
}

#[test]
fn tips_that_the_robot_has_among_obstacles_are_reached_there_with_the_contacts_that_settling_finds()
{
    let (robot, scene, loads) = (Robot::load("2m").unwrap(), posts(), Loads::default());
    let controller = ShapeController::among(&robot, &scene, &loads, Search::default()).unwrap();
    let mut settler = ContactSettler::new(&robot, &scene);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let last = robot.discs().len() - 1;
    let (mut reached, mut touching) = (0, 0);
    for k in 0..40 {
        let wanted = settler
            .settle(&robot.random_command(&mut rng), &loads)
            .unwrap();
        assert!(wanted.equilibrium.converged);
        let target = Target::tip(&robot, wanted.equilibrium.positions[last]);
        let found = controller.reach(&[target]).unwrap();
        let again = settler.settle(&found.command, &loads).unwrap();
        let among = found.among.as_ref().unwrap();
        assert_eq!(
            again.equilibrium.positions, found.equilibrium.positions,
            "{k}"
        );
        assert_eq!(again.contacts, among.contacts);
        let off = (found.equilibrium.positions[last] - wanted_of(&target)).norm();
        assert!((off - found.errors[0]).abs() < 1e-15);
        assert_eq!(off <= 1e-6, found.outcome == Outcome::Reached);
        reached += usize::from(off <= 1e-6);
        touching += usize::from(!among.contacts.is_empty());
    }
    eprintln!("{reached} of 40 reached, {touching} touch");
    assert!(
        reached >= 38 && touching >= 5,
        "{reached} reached, {touching} touch"
    );
}

fn wanted_of(target: &Target) -> nalgebra::Vector3<f64> {
    match target.goal {
        tdcr_sim::inverse::shape::Goal::Position(wanted) => wanted,
        _ => unreachable!("a position was asked for"),
    }
}

#[test]
fn a_path_along_a_post_is_followed_and_says_what_is_touched() {
    let (robot, scene, loads) = (Robot::load("2m").unwrap(), posts(), Loads::default());
    let search = Search::default();
    let controller = ShapeController::among(&robot, &scene, &loads, search).unwrap();
    let settle = |share: f64| {
        let from = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
        let mean = robot.mean_command();
        let values: Vec<f64> = (from.iter().zip(mean.as_slice()))
            .map(|(a, b)| a + share * (b - a))
            .collect();
        let mut settler = ContactSettler::new(&robot, &scene);
        let found = settler
            .settle(&robot.command(&values).unwrap(), &loads)
            .unwrap();
        found.equilibrium.positions[robot.discs().len() - 1]
    };
    let mut path = controller.path();
    let mut touching = 0;
    for k in 0..8 {
        let target = Target::tip(&robot, settle(0.02 * f64::from(k)));
        let point = path.follow(&[target]).unwrap();
        assert_eq!(point.solution.outcome, Outcome::Reached, "{k}: {point:?}");
        let first = [Arrival::Followed, Arrival::First][usize::from(k == 0)];
        assert_eq!(point.arrival, first, "{k}");
        let among = point.solution.among.unwrap();
        assert_eq!(among.equilibrium.positions.len(), robot.discs().len());
        touching += usize::from(!among.contacts.is_empty());
    }
    assert!(touching > 0);
}

#[test]
fn a_scene_without_obstacles_changes_nothing() {
    let (robot, loads) = (Robot::load("3m").unwrap(), Loads::payload(0.01).unwrap());
    let search = Search::default();
    let alone = ShapeController::new(&robot, &loads, search).unwrap();
    let among = ShapeController::among(&robot, &Scene::default(), &loads, search).unwrap();
    let target = [Target::tip(&robot, [0.08, 0.02, 0.33].into())];
    let found = alone.reach(&target).unwrap();
    assert_eq!(found, among.reach(&target).unwrap());
    assert_eq!(found.among, None);
}

#[test]
fn what_cannot_be_settled_among_obstacles_is_refused() {
    let robot = Robot::load("2m").unwrap();
    let moment = Wrench {
        moment: [0.0, 0.01, 0.0],
        ..Wrench::none(3, Frame::World)
    };
    let loads = Loads::default().with_wrench(moment).unwrap();
    let refused = ShapeController::among(&robot, &posts(), &loads, Search::default());
    let expected = ShapeControlError::Contact(ContactError::Loads { disc: 3 });
    assert_eq!(refused.unwrap_err(), expected);
}
