//! A robot's symmetries in what cameras see of it, and learning by one representative of each class.

mod models;
mod reduction;
mod seen;

use std::iter::zip;

use tdcr_learn::data::{Normalisation, Recipe, Subject};
use tdcr_learn::symmetry::Reduction;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Cameras, RingSpec, Robot, RobotSpec};
use tdcr_sim::symmetry::Symmetries;

/// A recipe of a robot of the paper, seen in small pictures.
fn recipe(name: &str, base: BaseVisibility) -> Recipe {
    let mut robot = RobotSpec::standard(name).unwrap();
    if let Cameras::Ring(ring) = &mut robot.cameras {
        ring.resolution = [640, 360];
    }
    Recipe {
        subject: Subject {
            robot,
            base,
            payload: None,
            ..Subject::default()
        },
        ..Recipe::default()
    }
}

fn ring(recipe: &mut Recipe) -> &mut RingSpec {
    match &mut recipe.subject.robot.cameras {
        Cameras::Ring(ring) => ring,
        Cameras::Free(_) => unreachable!("the paper's robots have rings"),
    }
}

fn of_2m() -> Symmetries {
    Robot::load("2m").unwrap().symmetries()
}

fn units() -> Normalisation {
    Normalisation {
        motor_min: vec![0.0; 6],
        motor_max: vec![0.04; 6],
        scale: 0.4,
    }
}

fn assert_near(a: &[f32], b: &[f32]) {
    assert_eq!(a.len(), b.len());
    let largest = zip(a, b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-6, "{largest}");
}

/// By symmetries whose images are all seen alike.
fn in_one_view(symmetries: Symmetries) -> Reduction {
    Reduction::new(symmetries.clone(), &symmetries)
}
