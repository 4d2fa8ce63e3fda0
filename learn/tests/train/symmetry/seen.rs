//! Which symmetries clouds have, by their cameras, bases and colours.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_learn::data::{Condition, PayloadRange, Recipe, Simulator, Subject};
use tdcr_learn::metrics::chamfer;
use tdcr_learn::net::Channels;
use tdcr_learn::symmetry::{Agreement, Loss};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::render::{BaseVisibility, Sensor};
use tdcr_sim::robot::{Aim, CameraSpec, Cameras, Holes, Lens, Robot, RobotSpec};
use tdcr_sim::scene::{Obstacle, Scene};

use super::{recipe, ring};

#[test]
fn clouds_of_the_papers_robots_have_their_symmetries() {
    for base in [BaseVisibility::Hidden, BaseVisibility::Shown] {
        let mut recipe = recipe("2m", base);
        let seen = recipe.symmetries(Channels::Xyz).unwrap();
        assert_eq!((seen.symmetries.elements().len(), seen.lost), (6, None));
        assert!(
            seen.views
                .iter()
                .all(|view| view.1.positions > 0.9 && view.1.colors.is_none())
        );
        // The paper's 8 cameras are mirrored into each other by one reflection, and turned by 120 degrees stand elsewhere.
        assert_eq!(
            seen.to_string(),
            "6 tendon permutations (3 rotations, 3 reflections), seen in 3 views"
        );
        assert_eq!(seen.reduction().view_numbers(), 3);
        recipe.subject.payload = Some(PayloadRange {
            min: 0.0,
            max: 0.03,
        });
        recipe.sensor = Some(Sensor::d435());
        let seen = recipe.symmetries(Channels::Xyz).unwrap();
        assert_eq!(seen.symmetries.elements().len(), 6, "{seen}");
    }
}

#[test]
fn cameras_that_do_not_look_from_all_sides_break_symmetries_and_it_is_said() {
    // Six cameras have all the symmetries of the triangle, three are mirrored into other places.
    let mut six = recipe("2m", BaseVisibility::Hidden);
    ring(&mut six).count = 6;
    let seen = six.symmetries(Channels::Xyz).unwrap();
    assert!(
        seen.views.iter().all(|view| view.1.positions < 1.1),
        "{seen:?}"
    );
    assert_eq!(seen.reduction().view_numbers(), 0);

    let mut three = recipe("2m", BaseVisibility::Hidden);
    (ring(&mut three).count, ring(&mut three).resolution) = (3, [1280, 720]);
    let seen = three.symmetries(Channels::Xyz).unwrap();
    let counted =
        "3 tendon permutations (3 rotations, 0 reflections); no more because the cameras do not";
    assert!(seen.to_string().starts_with(counted), "{seen}");

    let mut one_side = recipe("2m", BaseVisibility::Hidden);
    let camera = |x: f64| CameraSpec {
        position: [x, -0.5, 0.3],
        aim: Aim::At([0.0, 0.0, 0.25]),
        lens: Lens::Fovy(45.0),
        resolution: [640, 360],
        distortion: None,
    };
    one_side.subject.robot.cameras = Cameras::Free([-0.1, 0.2].map(camera).to_vec());
    let seen = one_side.symmetries(Channels::Xyz).unwrap();
    assert!(seen.symmetries.is_trivial());
    assert!(
        matches!(seen.lost, Some(Loss::Positions(floors)) if floors > 4.0),
        "{seen}"
    );
    assert!(
        seen.to_string()
            .starts_with("none, because the cameras do not see"),
        "{seen}"
    );
}

#[test]
fn colours_that_show_where_cameras_are_break_symmetries_where_they_are_learned() {
    let seen = recipe("2m", BaseVisibility::Hidden)
        .symmetries(Channels::XyzRgb)
        .unwrap();
    assert!(
        matches!(seen.lost, Some(Loss::Colors(floors)) if floors > 1.75),
        "{seen}"
    );
    // The mirror image is seen by the mirrored cameras; a turn is not.
    assert!(seen.symmetries.elements().len() <= 2, "{seen}");
}

#[test]
fn a_base_in_sight_that_is_less_symmetric_takes_symmetries() {
    let mut recipe = recipe("2m", BaseVisibility::Shown);
    let robot = &mut recipe.subject.robot;
    robot.base.orientation = [1.0, 0.0, 0.0, 0.0];
    let turned = |[x, y]: [f64; 2]| {
        let (sin, cos) = 0.2_f64.sin_cos();
        [cos * x - sin * y, sin * x + cos * y]
    };
    let holes = [[0.0125, 0.0], [-0.00625, 0.010825], [-0.00625, -0.010825]].map(turned);
    let holes = Holes::At(holes.to_vec());
    robot.base.holes = holes.clone();
    for module in &mut robot.modules {
        module.holes = holes.clone();
    }
    let seen = recipe.symmetries(Channels::Xyz).unwrap();
    assert_eq!(
        (seen.symmetries.elements().len(), seen.lost),
        (3, Some(Loss::Base))
    );
    // A stiffer module is symmetric, a robot on its side is not.
    recipe.subject.robot.gravity = [0.0, 9.81, 0.0];
    let seen = recipe.symmetries(Channels::Xyz).unwrap();
    assert_eq!(seen.to_string(), "none, because the robot has none");
}

/// The table of docs/experiments.md: what the paper's ring of cameras costs.
#[test]
#[ignore = "prints a table; a minute"]
#[allow(clippy::print_stdout, reason = "a table to be read")]
fn what_perfect_predictors_of_representatives_score() {
    const POINTS: usize = 10_000;
    const COMMANDS: u64 = 6;
    for (name, count, base) in [
        ("2m", 8, BaseVisibility::Hidden),
        ("3m", 8, BaseVisibility::Hidden),
        ("5m", 8, BaseVisibility::Hidden),
        ("2m", 8, BaseVisibility::Shown),
        ("3m", 8, BaseVisibility::Shown),
        ("5m", 8, BaseVisibility::Shown),
        ("2m", 6, BaseVisibility::Hidden),
    ] {
        let mut recipe = Recipe {
            subject: Subject {
                robot: RobotSpec::standard(name).unwrap(),
                base,
                payload: None,
                ..Subject::default()
            },
            ..Recipe::default()
        };
        ring(&mut recipe).count = count;
        let seen = recipe.symmetries(Channels::XyzRgb).unwrap();
        let ratios = |of: fn(&Agreement) -> f64| {
            let ratios: Vec<String> = seen
                .views
                .iter()
                .map(|view| format!("{:.2}", of(&view.1)))
                .collect();
            ratios.join(" ")
        };
        let robot = Robot::new(recipe.subject.robot.clone()).unwrap();
        let symmetries = robot.symmetries();
        let mut simulator = Simulator::new(&robot, &recipe);
        let (mut perfect, mut of_representatives, mut floor) = (0.0, 0.0, 0.0);
        for seed in 0..COMMANDS {
            let rng = &mut ChaCha8Rng::seed_from_u64(seed);
            let command = robot.random_command(rng);
            let under = |values: &[f64]| Condition {
                motors: values.iter().map(|&value| value as f32).collect(),
                payload: None,
            };
            let condition = under(command.as_slice());
            let mut view = |rng: &mut ChaCha8Rng| {
                simulator.displace(rng);
                simulator.cloud(&condition, POINTS, rng).unwrap().points
            };
            let (truth, again) = (view(rng), view(rng));
            let own = simulator
                .independent_points(&condition, POINTS, rng)
                .unwrap();
            // A representative stands for all images of its class, each seen from other sides.
            let mut images = PointCloud::default();
            for symmetry in symmetries.elements() {
                let image = under(&symmetry.command(command.as_slice()));
                let mut seen = simulator.independent_points(&image, POINTS, rng).unwrap();
                symmetry.inverse().move_points(&mut seen.points, 1.0);
                images.points.extend(seen.points);
                images.colors.extend(seen.colors);
            }
            let images = images.sample_or_pad(POINTS, rng);
            floor += chamfer(&again, &truth).unwrap();
            perfect += chamfer(&own.points, &truth).unwrap();
            of_representatives += chamfer(&images.points, &truth).unwrap();
        }
        eprintln!(
            "{name}, {count} cameras, base {base:?}: views {}; colours {}; perfect {:.2} floors, of representatives {:.2}",
            ratios(|view| view.positions),
            ratios(|view| view.colors.unwrap_or(f64::NAN)),
            perfect / floor,
            of_representatives / floor
        );
    }
}

#[test]
fn clouds_of_a_robot_among_obstacles_have_no_symmetry() {
    let mut recipe = recipe("2m", BaseVisibility::Hidden);
    let floor = Obstacle::half_space("floor").at([0.0, 0.0, -1.0]);
    recipe.subject.scene = Scene::new(vec![floor]).unwrap();
    let seen = recipe.symmetries(Channels::Xyz).unwrap();
    assert!(seen.symmetries.is_trivial());
    assert_eq!(seen.lost, Some(Loss::Scene));
    let said = "none, because there are obstacles around the robot";
    assert_eq!(seen.to_string(), said);
}
