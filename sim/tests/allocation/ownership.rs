//! Solvers own their robot: a thread, a struct or an object of another language can keep one.

use tdcr_sim::cloud::{Observer, VoxelGrid};
use tdcr_sim::dynamics::{Integrator, Lineariser, Stepper};
use tdcr_sim::inverse::shape::{Search, ShapeController, ShapePath};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::sensitivity::Sensitivity;
use tdcr_sim::statics::Settler;
use tdcr_sim::tendon_friction::FrictionPath;

fn can_be_kept<T: Send + 'static>(_: &T) {}

#[test]
fn solvers_outlive_the_robot_that_they_were_made_from_and_go_to_other_threads() {
    let robot = Robot::load("2m").unwrap();
    let (command, loads) = (robot.mean_command(), Loads::default());
    let settled = robot.settle(&command, &loads);
    let mut settler = Settler::new(&robot);
    let observer = Observer::new(&robot, BaseVisibility::Hidden, VoxelGrid::new(0.002));
    can_be_kept(&observer);
    can_be_kept::<FrictionPath>(&FrictionPath::new(&robot));
    can_be_kept::<Stepper>(&Stepper::new(&robot, 1e-3, Integrator::default()).unwrap());
    can_be_kept::<Lineariser>(&Lineariser::new(&robot, 1e-3).unwrap());
    can_be_kept::<Sensitivity>(&robot.sensitivity(&command, &loads, &settled).unwrap());
    let search = Search {
        samples: 3,
        ..Search::default()
    };
    let path: ShapePath = ShapeController::new(&robot, &loads, search).unwrap().path();
    can_be_kept(&path);

    drop(robot);
    let elsewhere = std::thread::spawn(move || settler.settle(&command, &loads).clone());
    assert_eq!(elsewhere.join().unwrap(), settled);
}

/// A clone is a second handle of the same robot, whatever its size.
#[test]
fn a_clone_of_a_robot_allocates_nothing() {
    let robot = Robot::load("5m").unwrap();
    let counts = allocation_counter::measure(|| drop(robot.clone()));
    assert_eq!(counts.count_total, 0);
}
