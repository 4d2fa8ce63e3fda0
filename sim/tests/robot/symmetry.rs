//! Symmetries of robots: which there are, that they form groups, and that settled shapes keep them.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{
    Backbone, Body, Drive, HoleCircle, Holes, Loads, MassSpec, Payload, PerDisc, Robot, RobotSpec,
    RouteSpec, Routing, SolidMass, Waypoint,
};
use tdcr_sim::symmetry::{Symmetries, Symmetry};

fn spec(name: &str) -> RobotSpec {
    RobotSpec::standard(name).unwrap()
}

fn symmetries(spec: RobotSpec) -> Symmetries {
    Robot::new(spec).unwrap().symmetries()
}

/// Rotations and reflections.
fn counts(symmetries: &Symmetries) -> [usize; 2] {
    let elements = symmetries.elements();
    let reflections = elements.iter().filter(|one| one.is_reflection()).count();
    [elements.len() - reflections, reflections]
}

/// A base, and modules, with holes at these angles (degrees), 12.5 mm from the axis.
fn with_holes(mut spec: RobotSpec, degrees: &[f64]) -> RobotSpec {
    let holes = Holes::Circle(HoleCircle {
        radius: 0.0125,
        angles: degrees.iter().map(|angle| angle.to_radians()).collect(),
    });
    spec.base.holes = holes.clone();
    for module in &mut spec.modules {
        module.holes = holes.clone();
    }
    spec
}

const THIRDS: [f64; 3] = [0.0, 120.0, 240.0];

/// Largest distance (m) of a settled disc from the image of its counterpart, and largest angle (rad) between its orientation
/// and `M R m'`: `m` is the symmetry in the discs' frames, so a disc that is no body of revolution is mapped as well.
fn miss(robot: &Robot, symmetry: &Symmetry, command: &[f64], loads: &Loads) -> [f64; 2] {
    let settle = |values: &[f64]| robot.settle(&robot.command(values).unwrap(), loads);
    let (from, to) = (settle(command), settle(&symmetry.command(command)));
    assert!(from.converged && to.converged);
    let matrix = Matrix3::from(symmetry.matrix).transpose();
    let [w, x, y, z] = robot.spec().base.orientation;
    let base = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
    let base = base.to_rotation_matrix();
    let in_disc = base.matrix().transpose() * matrix * base.matrix();
    let mut largest = [0.0_f64; 2];
    for disc in 0..robot.discs().len() {
        let image = Vector3::from(symmetry.point(from.positions[disc].into()));
        let rotation = from.orientations[disc].to_rotation_matrix();
        let expected = matrix * rotation.matrix() * in_disc.transpose();
        let expected = Rotation3::from_matrix_unchecked(expected);
        let found = to.orientations[disc].to_rotation_matrix();
        largest[0] = largest[0].max((image - to.positions[disc]).norm());
        largest[1] = largest[1].max(expected.angle_to(&found));
    }
    largest
}

#[test]
fn the_papers_robots_have_the_six_symmetries_of_a_triangle() {
    for name in ["2m", "3m", "5m"] {
        let found = symmetries(spec(name));
        assert_eq!(counts(&found), [3, 3], "{name}");
        let elements = found.elements();
        assert_eq!(elements[0], Symmetry::identity(elements[0].tendons.len()));
        // A turn by 120 degrees moves each module's tendons on by one.
        let next = |tendon: usize| tendon / 3 * 3 + (tendon + 1) % 3;
        let turn = &elements[1];
        assert!(
            turn.tendons
                .iter()
                .enumerate()
                .all(|(from, &to)| to == next(from))
        );
        let [x, y, z] = turn.point([0.1, 0.0, 0.3]);
        let expected = [-0.05, 0.05 * 3_f64.sqrt(), 0.3];
        assert!((Vector3::new(x, y, z) - Vector3::from(expected)).norm() < 1e-12);
        assert_eq!(
            found.to_string(),
            "6 tendon permutations (3 rotations, 3 reflections)"
        );
    }
}

#[test]
fn exact_holes_are_symmetric_to_rounding_and_rounded_ones_to_micrometres() {
    let command = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
    for (spec, position, angle) in [
        (with_holes(spec("2m"), &THIRDS), 1e-9, 1e-7),
        (spec("2m"), 1e-5, 1e-3),
    ] {
        let robot = Robot::new(spec).unwrap();
        for loads in [Loads::default(), Loads::payload(0.02).unwrap()] {
            for symmetry in robot.symmetries().elements() {
                let found = miss(&robot, symmetry, &command, &loads);
                assert!(found[0] < position && found[1] < angle, "{found:?}");
            }
        }
    }
}

#[test]
fn symmetries_form_a_group() {
    let square = with_holes(spec("2m"), &[0.0, 90.0, 180.0, 270.0]);
    for spec in [spec("3m"), square] {
        let found = symmetries(spec);
        let elements = found.elements();
        let is_one = |of: &Symmetry| elements.iter().any(|one| one.is_alike(of));
        for a in elements {
            assert!(is_one(&a.inverse()));
            assert!(a.after(&a.inverse()).is_alike(&elements[0]));
            for b in elements {
                assert!(is_one(&a.after(b)));
            }
        }
        assert_eq!(found.check(elements[0].tendons.len()), Ok(()));
    }
}

#[test]
fn four_tendons_have_the_eight_symmetries_of_a_square() {
    let found = symmetries(with_holes(spec("2m"), &[45.0, 135.0, 225.0, 315.0]));
    assert_eq!(counts(&found), [4, 4]);
    // Two pairs at other angles leave a rectangle.
    let found = symmetries(with_holes(spec("2m"), &[30.0, 150.0, 210.0, 330.0]));
    assert_eq!(counts(&found), [2, 2]);
}

#[test]
fn clocked_modules_keep_what_maps_all_of_them() {
    let clocked = |degrees: f64, routing| {
        let mut spec = with_holes(spec("2m"), &THIRDS);
        spec.routing = routing;
        spec.modules[1].clocking = degrees.to_radians();
        symmetries(spec)
    };
    for routing in [Routing::ModuleBelow, Routing::Base] {
        assert_eq!(counts(&clocked(60.0, routing)), [3, 3]);
        assert_eq!(counts(&clocked(40.0, routing)), [3, 0]);
    }
}

#[test]
fn what_differs_between_tendons_breaks_symmetries() {
    let routed = |change: &dyn Fn(&mut RouteSpec)| {
        let mut spec = spec("2m");
        let tendon = spec.modules[1].tendons.take().unwrap();
        let route = |hole: usize| RouteSpec {
            through: (4..10)
                .map(|disc| Waypoint(Body::Disc(disc), hole))
                .collect(),
            tendon: tendon.clone(),
        };
        spec.routes = (0..3).map(route).collect();
        change(&mut spec.routes[1]);
        counts(&symmetries(spec))
    };
    assert_eq!(routed(&|_| ()), [3, 3]);
    // The reflection in the plane of the second tendon is left.
    assert_eq!(
        routed(&|route| route.tendon.drive = Drive::Gain(550.0)),
        [1, 1]
    );
    assert_eq!(routed(&|route| route.tendon.range = [0.0, 0.03]), [1, 1]);
    assert_eq!(
        routed(&|route| route.tendon.axial_stiffness = Some(1e4)),
        [1, 1]
    );
    // Tendons of another order are permuted in theirs.
    let mut reordered = spec("2m");
    let tendon = reordered.modules[1].tendons.take().unwrap();
    for hole in [2, 0, 1] {
        reordered.routes.push(RouteSpec {
            through: (4..10)
                .map(|disc| Waypoint(Body::Disc(disc), hole))
                .collect(),
            tendon: tendon.clone(),
        });
    }
    let found = symmetries(reordered);
    assert_eq!(counts(&found), [3, 3]);
    assert_eq!(found.elements()[1].tendons, [1, 2, 0, 4, 5, 3]);
}

#[test]
fn weight_and_elasticity_across_the_axis_break_symmetries() {
    let changed = |change: &dyn Fn(&mut RobotSpec)| {
        let mut spec = spec("2m");
        change(&mut spec);
        counts(&symmetries(spec))
    };
    // Gravity along x leaves the reflection y -> -y, along y none of the triangle's.
    assert_eq!(changed(&|spec| spec.gravity = [9.81, 0.0, 0.0]), [1, 1]);
    assert_eq!(changed(&|spec| spec.gravity = [0.0, 9.81, 0.0]), [1, 0]);
    assert_eq!(changed(&|spec| spec.gravity = [0.0; 3]), [3, 3]);
    // A base on its side: gravity across the axis.
    assert_eq!(
        changed(&|spec| spec.base.orientation = [1.0, 0.0, 1.0, 0.0]),
        [1, 1]
    );
    // Lopsided discs.
    let lopsided = |place| {
        MassSpec::Solid(PerDisc::Uniform(SolidMass {
            density: 25.0,
            centre_of_mass: place,
        }))
    };
    let lopsided = |place: [f64; 3]| changed(&|spec| spec.modules[0].mass = lopsided(place));
    assert_eq!(lopsided([0.005, 0.0, 0.0]), [1, 1]);
    assert_eq!(lopsided([0.003, 0.004, 0.0]), [1, 0]);
    assert_eq!(lopsided([0.0, 0.0, 0.004]), [3, 3]);
    // A backbone that bends more easily one way.
    let backbone = |bending| Backbone {
        bending,
        torsion: 0.1,
        rest: [0.0; 3],
    };
    let backbone = |bending| {
        changed(&|spec| spec.modules[0].backbone = Some(PerDisc::Uniform(backbone(bending))))
    };
    assert_eq!(backbone([0.1, 0.1]), [3, 3]);
    assert_eq!(backbone([0.1, 0.3]), [1, 1]);
}

#[test]
fn a_payload_off_the_axis_breaks_symmetries() {
    let robot = Robot::load("2m").unwrap();
    let under = |offset| {
        let payload = Payload { mass: 0.02, offset };
        let loads = Loads::default().with_payload(payload).unwrap();
        counts(&robot.symmetries_under(&[loads]))
    };
    assert_eq!(under([0.0, 0.0, 0.02]), [3, 3]);
    assert_eq!(under([0.015, 0.0, 0.0]), [1, 1]);
    assert_eq!(under([0.0, 0.015, 0.0]), [1, 0]);
}

#[test]
fn a_base_anywhere_in_any_orientation_carries_its_symmetries_along() {
    let mut spec = spec("2m");
    spec.base.position = [0.1, -0.2, 0.5];
    let turn = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.1);
    spec.base.orientation = [turn.w, turn.i, turn.j, turn.k];
    spec.gravity = (turn * Vector3::new(0.0, 0.0, 9.81)).into();
    let found = symmetries(spec.clone());
    assert_eq!(counts(&found), [3, 3]);
    for symmetry in found.elements() {
        let base = Vector3::from(symmetry.point(spec.base.position));
        assert!((base - Vector3::from(spec.base.position)).norm() < 1e-12);
    }
    assert_eq!(counts(&found.of_base(&Robot::new(spec).unwrap())), [3, 3]);
}

#[test]
fn the_base_in_sight_has_the_symmetries_of_its_servos() {
    // Of the boxes at 120 degrees, a square of tendons keeps the reflection in the plane of the first.
    let robot = Robot::load("3m").unwrap();
    assert_eq!(counts(&robot.symmetries().of_base(&robot)), [3, 3]);
    let robot = Robot::new(with_holes(spec("2m"), &[0.0, 90.0, 180.0, 270.0])).unwrap();
    assert_eq!(counts(&robot.symmetries().of_base(&robot)), [1, 1]);
    let turned = with_holes(spec("2m"), &[10.0, 130.0, 250.0]);
    let robot = Robot::new(turned).unwrap();
    assert_eq!(counts(&robot.symmetries()), [3, 3]);
    assert_eq!(counts(&robot.symmetries().of_base(&robot)), [3, 0]);
}

#[test]
fn all_images_of_a_command_have_one_representative() {
    let found = symmetries(spec("3m"));
    let command = [
        0.03, 0.01, 0.02, 0.0, 0.02, 0.015, 0.04, 0.001, 0.002, 0.0271,
    ];
    // The last value is a payload.
    let (_, smallest) = found.canonical(&command);
    assert_eq!(smallest[..3], [0.01, 0.02, 0.03]);
    assert_eq!(smallest[9], 0.0271);
    for symmetry in found.elements() {
        let image = symmetry.command(&command);
        let (back, representative) = found.canonical(&image);
        assert_eq!(representative, smallest);
        assert_eq!(back.command(&image), smallest);
    }
    // Where module 1's are alike, the next module decides; of several symmetries that lead there, the first.
    let (chosen, smallest) = found.canonical(&[0.01, 0.01, 0.01, 0.03, 0.02, 0.01, 0.0, 0.0, 0.0]);
    assert_eq!(smallest[3..6], [0.01, 0.02, 0.03]);
    assert!(chosen.is_reflection());
    let alike = [0.01; 9];
    assert_eq!(
        found.canonical(&alike),
        (&found.elements()[0], alike.to_vec())
    );
}

#[test]
fn damaged_symmetries_are_refused() {
    let good = symmetries(spec("2m"));
    let json = serde_json::to_value(&good).unwrap();
    let refusal = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut json = json.clone();
        change(&mut json);
        serde_json::from_value::<Symmetries>(json)
            .unwrap()
            .check(6)
            .unwrap_err()
    };
    assert_eq!(
        serde_json::from_value::<Symmetries>(json.clone()).unwrap(),
        good
    );
    assert_eq!(good.check(7), Ok(()));
    assert!(good.check(5).unwrap_err().contains("no permutation"));
    assert!(refusal(&|json| json[1]["tendons"][0] = 2.into()).contains("no permutation"));
    assert!(refusal(&|json| json[1]["matrix"][0][0] = 2.0.into()).contains("no isometry"));
    assert!(refusal(&|json| json[0] = json[1].clone()).contains("identity first"));
    assert!(refusal(&|json| *json = serde_json::json!([])).contains("identity first"));
    assert!(Symmetries::default().is_trivial() && Symmetries::default().check(0).is_ok());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// Whatever is called a symmetry maps settled shapes to settled shapes, under other commands and loads than those that it
    /// was found by.
    #[test]
    fn settled_shapes_are_mapped_to_each_other(
        seed in any::<u64>(),
        count in 2..6_usize,
        modules in 1..3_usize,
        clocking in 0.0..1.0_f64,
        from_base in any::<bool>(),
        payload in 0.0..0.02_f64,
    ) {
        let angles: Vec<f64> = (0..count).map(|k| 360.0 * k as f64 / count as f64 + 7.0).collect();
        let mut spec = with_holes(spec("2m"), &angles);
        spec.modules.truncate(modules);
        for (index, module) in spec.modules.iter_mut().enumerate() {
            module.clocking = clocking * index as f64;
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.05)));
        }
        spec.routing = if from_base { Routing::Base } else { Routing::ModuleBelow };
        let robot = Robot::new(spec).unwrap();
        let found = robot.symmetries();
        prop_assert!(counts(&found)[0] == count);
        let command = robot.random_command(&mut ChaCha8Rng::seed_from_u64(seed));
        let loads = Loads::payload(payload).unwrap();
        for symmetry in found.elements() {
            let [position, angle] = miss(&robot, symmetry, command.as_slice(), &loads);
            prop_assert!(position < 1e-8 && angle < 1e-6, "{position} m, {angle} rad");
        }
    }
}
