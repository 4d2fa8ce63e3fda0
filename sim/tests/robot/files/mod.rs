//! Robot files: what they may say in other words or leave out, and what they are told when wrong.

use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use tdcr_sim::formats::RobotFileError;
use tdcr_sim::robot::{Body, Cameras, Holes, Robot, RobotSpec, SpecError, Waypoint};

mod documented;
mod page;

const EVERY_FIELD: &str = include_str!("../../../../examples/every-field.toml");
const THREE_SEGMENTS: &str = include_str!("../../../../examples/three-segments.toml");

/// Loads a robot from a file of this text.
fn load(extension: &str, text: &str) -> Result<RobotSpec, RobotFileError> {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let (process, count) = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let name = format!("tdcr-robot-file-{process}-{count}.{extension}");
    let path = std::env::temp_dir().join(name);
    std::fs::write(&path, text).unwrap();
    let loaded = RobotSpec::load(path.to_str().unwrap());
    std::fs::remove_file(path).unwrap();
    loaded
}

fn said(text: &str) -> String {
    load("toml", text).unwrap_err().to_string()
}

fn replaced(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from} is not in\n{text}");
    text.replacen(from, to, 1)
}

#[test]
fn robots_with_every_field_survive_their_files() {
    for text in [EVERY_FIELD, THREE_SEGMENTS] {
        let spec = load("toml", text).unwrap();
        let toml = spec.to_toml().unwrap();
        assert_eq!(load("toml", &toml).unwrap(), spec);
        let json = serde_json::to_string(&spec).unwrap();
        assert_eq!(load("json", &json).unwrap(), spec);
    }
}

#[test]
fn an_unknown_field_within_a_value_per_disc_is_named_with_the_valid_ones() {
    for (from, to, expected) in [
        (
            "backbone = { bending",
            "backbone = { young = 3.0, bending",
            "unknown field `young`, expected one of `bending`, `torsion`, `rest`, `rest_degrees`",
        ),
        (
            "limit = { angle = 0.4",
            "limit = { angel = 0.4",
            "unknown field `angel`, expected one of `angle`, `degrees`, `stiffness`",
        ),
        (
            "mass = { rigid = { mass",
            "mass = { rigid = { weight = 1.0, mass",
            "unknown field `weight`, expected one of `mass`, `inertia`, `centre_of_mass`",
        ),
        (
            "holes = { radius = 0.01, angles",
            "holes = { radius = 0.01, angle",
            "unknown field `angle`, expected one of `radius`, `angles`, `degrees`",
        ),
        (
            "damping = 0.01",
            "damping = [0.01, 0.01, \"x\", 0.01, 0.01]",
            "invalid type: string \"x\", expected f64",
        ),
    ] {
        let text = replaced(EVERY_FIELD, from, to);
        let line = 1 + text[..text.find(to).unwrap()].matches('\n').count();
        let message = said(&text);
        assert!(message.contains(expected), "{message}\nnot\n{expected}");
        assert!(message.contains(&format!("line {line}")), "{message}");
    }
}

#[test]
fn all_missing_fields_are_named_in_one_run_each_at_its_table() {
    let text = replaced(EVERY_FIELD, "radius = 0.015\n", "");
    let text = replaced(&text, "hole_height = -0.01\n", "");
    let text = replaced(&text, "pitch = 0.016 ", "# ");
    let text = replaced(&text, "range = [0.0, 0.06]\n", "");
    let text = replaced(&text, ", stiffness = 2.0 }", " }");
    let line = |start: &str| 1 + text[..text.find(start).unwrap()].matches('\n').count();
    let message = said(&text);
    for expected in [
        format!("`base` (line {}) lacks `hole_height`", line("[base]")),
        format!(
            "`modules[0]` (line {}) lacks `pitch` or `length`, `radius`",
            line("[[modules]]")
        ),
        format!(
            "`modules[0].limit` (line {}) lacks `stiffness`",
            line("limit = ")
        ),
        format!(
            "`modules[0].tendons` (line {}) lacks `range`",
            line("[modules.tendons]")
        ),
    ] {
        assert!(message.contains(&expected), "{message}\nnot\n{expected}");
    }
    // In JSON there are no lines to give.
    let message = load("json", "{\"name\": \"x\", \"base\": {}}")
        .unwrap_err()
        .to_string();
    assert!(
        message.contains(
            "the file lacks `gravity`, `routing`, `modules`; `base` lacks `position`, `holes`, \
             `hole_height`"
        ),
        "{message}"
    );
}

/// A second list of the fields that must be given would go out of date in silence.
#[test]
fn what_is_called_missing_is_what_reading_misses() {
    fn each_without(value: &toml::Value, out: &mut Vec<(String, toml::Value)>) {
        let put_back = |out: &mut Vec<(String, toml::Value)>,
                        first: usize,
                        wrap: &dyn Fn(toml::Value) -> toml::Value| {
            for (_, changed) in &mut out[first..] {
                *changed = wrap(changed.clone());
            }
        };
        match value {
            toml::Value::Table(table) => {
                for (key, inner) in table {
                    let mut without = table.clone();
                    without.remove(key);
                    out.push((key.clone(), toml::Value::Table(without)));
                    let first = out.len();
                    each_without(inner, out);
                    put_back(out, first, &|changed| {
                        let mut table = table.clone();
                        table.insert(key.clone(), changed);
                        toml::Value::Table(table)
                    });
                }
            }
            toml::Value::Array(list) => {
                for (index, inner) in list.iter().enumerate() {
                    let first = out.len();
                    each_without(inner, out);
                    put_back(out, first, &|changed| {
                        let mut list = list.clone();
                        list[index] = changed;
                        toml::Value::Array(list)
                    });
                }
            }
            _ => {}
        }
    }
    let two = RobotSpec::standard("2m").unwrap().to_toml().unwrap();
    for text in [EVERY_FIELD, THREE_SEGMENTS, &two] {
        let mut all = Vec::new();
        each_without(&toml::from_str(text).unwrap(), &mut all);
        assert!(all.len() > 30);
        let mut missed = 0;
        for (key, value) in all {
            let text = toml::to_string(&value).unwrap();
            match load("toml", &text) {
                Ok(_) | Err(RobotFileError::Robot(SpecError::Field { .. })) => {}
                Err(RobotFileError::Missing { missing, .. }) => {
                    missed += 1;
                    let [missing] = missing.as_slice() else {
                        panic!("{key}: {missing:?}");
                    };
                    assert_eq!(missing.fields.len(), 1, "{key}: {missing:?}");
                    assert!(
                        missing.fields[0].contains(&format!("`{key}`")),
                        "{missing:?}"
                    );
                }
                // An empty choice is not a missing field.
                Err(other) => {
                    let message = other.to_string();
                    assert!(!message.contains("missing field"), "{key}: {message}");
                }
            }
        }
        assert!(missed > 15, "{missed}");
    }
}

#[test]
fn angles_that_can_only_be_degrees_are_refused_with_the_way_on() {
    for (from, to, field, degrees) in [
        (
            "angles = [0.0, 2.0943951, 4.1887902]",
            "angles = [0, 90, 180, 270]",
            "modules[0].holes.angles` is 90;",
            "(degrees go into `degrees` in its place)",
        ),
        (
            "clocking = 0.0",
            "clocking = 40",
            "modules[0].clocking` is 40;",
            "(degrees go into `clocking_degrees` in its place)",
        ),
        (
            "rest = [0.0, 0.02, 0.0]",
            "rest = [0.0, 15.0, 0.0]",
            "modules[0].backbone.rest` is 15;",
            "(degrees go into `rest_degrees` in its place)",
        ),
        (
            "limit = { angle = 0.4",
            "limit = { angle = 20",
            "modules[0].limit.angle` is 20;",
            "`degrees` takes degrees",
        ),
    ] {
        let message = said(&replaced(EVERY_FIELD, from, to));
        assert!(
            message.contains(field) && message.contains(degrees),
            "{message}"
        );
    }
    let ring = RobotSpec::standard("2m").unwrap().to_toml().unwrap();
    let message = said(&replaced(&ring, "\npitch = 0.1973", "\npitch = 11.3"));
    assert!(message.contains("`cameras.pitch` is 11.3;"), "{message}");
    let text = replaced(
        EVERY_FIELD,
        "limit = { angle",
        "limit = { degrees = 20, angle",
    );
    assert!(said(&text).contains("both `angle` (radians) and `degrees` are given"));
}

#[test]
fn angles_may_be_in_degrees() {
    let radians = load("toml", EVERY_FIELD).unwrap();
    let text = replaced(
        EVERY_FIELD,
        "angles = [0.0, 2.0943951, 4.1887902]",
        "degrees = [0, 120, 240]",
    );
    let text = replaced(
        &text,
        "limit = { angle = 0.4",
        "limit = { degrees = 22.918311805232928",
    );
    let text = replaced(
        &text,
        "rest = [0.0, 0.02, 0.0]",
        "rest_degrees = [0, 1.1459155902616465, 0]",
    );
    let degrees = load("toml", &text).unwrap();
    let [a, b] = [&radians, &degrees].map(|spec| Robot::new(spec.clone()).unwrap());
    for (a, b) in a.discs().iter().zip(b.discs()) {
        assert!((a.limit.unwrap().angle - b.limit.unwrap().angle).abs() < 1e-15);
        assert!((a.backbone.unwrap().rest[1] - b.backbone.unwrap().rest[1]).abs() < 1e-15);
    }
    let holes = [&radians, &degrees].map(|spec| spec.hole_positions(Body::Disc(0)));
    for (a, b) in holes[0].iter().flatten().zip(holes[1].iter().flatten()) {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
}

#[test]
fn cameras_that_a_file_leaves_out_stand_around_the_robot_in_the_papers_proportions() {
    let spec = RobotSpec::standard("2m").unwrap();
    let text = spec.to_toml().unwrap();
    let (without, _) = text.split_once("[cameras]").unwrap();
    let Cameras::Ring(ring) = load("toml", without).unwrap().cameras else {
        panic!("the base stands on the axis");
    };
    let Cameras::Ring(paper) = spec.cameras else {
        unreachable!()
    };
    assert_eq!(
        (ring.count, ring.pitch, ring.fovy),
        (8, paper.pitch, paper.fovy)
    );
    assert_eq!(ring.resolution, paper.resolution);
    assert!((ring.radius - 3.0 * 0.16195).abs() < 1e-12);
    assert!((ring.height - 0.174 - ring.radius * 0.1973_f64.tan()).abs() < 1e-12);
    // Beside the axis, the same cameras around the base.
    let moved = replaced(
        without,
        "position = [0.0, 0.0, 0.174]",
        "position = [1.0, 2.0, 0.174]",
    );
    let Cameras::Free(free) = load("toml", &moved).unwrap().cameras else {
        panic!("a ring stands around the axis");
    };
    let on_ring = tdcr_sim::camera::Camera::ring(&ring);
    let beside = tdcr_sim::camera::Camera::placed(&Cameras::Free(free));
    assert_eq!(beside.len(), 8);
    for (a, b) in on_ring.iter().zip(&beside) {
        let moved = a.pose.translation.vector + nalgebra::Vector3::new(1.0, 2.0, 0.0);
        assert!((moved - b.pose.translation.vector).norm() < 1e-9);
        assert!(a.pose.rotation.angle_to(&b.pose.rotation) < 1e-9);
    }
}

#[test]
fn a_rod_gives_stiffness_and_mass_where_the_rod_is() {
    let spec = load("toml", THREE_SEGMENTS).unwrap();
    let robot = Robot::new(spec.clone()).unwrap();
    let (e, r, density) = (50e9, 0.0005_f64, 7870.0);
    let (second_moment, area) = (FRAC_PI_4 * r.powi(4), PI * r * r);
    let disc_mass = 1200.0 * PI * 0.006_f64.powi(2) * 0.001;
    for (index, disc) in robot.discs().iter().enumerate() {
        let pitch = [0.006, 0.00625, 0.0064][index / 10];
        let next = [0.006, 0.00625, 0.0064][((index + 1) / 10).min(2)];
        let backbone = disc.backbone.unwrap();
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12 * b.abs(), "{index}: {a} {b}");
        near(disc.offset.z, pitch);
        near(backbone.bending[0], e * second_moment / pitch);
        near(backbone.torsion, e / 2.6 * 2.0 * second_moment / pitch);
        // From half a pitch below to half a pitch above; nothing above the last.
        let above = if index == 29 { 0.0 } else { next / 2.0 };
        let rod = density * area * (pitch / 2.0 + above);
        near(disc.mass, disc_mass + rod);
        let centre = rod * (above - pitch / 2.0) / 2.0 / disc.mass;
        assert!((disc.centre_of_mass.z - centre).abs() < 1e-15);
    }
    let expected = robot.discs().iter().map(|disc| disc.mass).sum::<f64>();
    let length = 0.1865 - 0.003;
    assert!((expected - 30.0 * disc_mass - density * area * length).abs() < 1e-12);
}

#[test]
fn modules_are_as_long_as_their_file_says() {
    let spec = load("toml", THREE_SEGMENTS).unwrap();
    for (module, length) in spec.modules.iter().zip([0.06, 0.0625, 0.064]) {
        assert_eq!(module.pitch, length / 10.0);
        assert_eq!(module.first_offset, module.pitch);
    }
    let both = replaced(
        THREE_SEGMENTS,
        "length = 0.060 ",
        "pitch = 0.006\nlength = 0.060 ",
    );
    assert!(said(&both).contains("`length` is given beside `first_offset` or `pitch`"));
}

/// Clocked modules against the same tendons on routes of their own.
#[test]
fn clocked_modules_have_holes_of_their_own_in_the_bodies_below() {
    let spec = load("toml", THREE_SEGMENTS).unwrap();
    let counts = [Body::Base, Body::Disc(0), Body::Disc(10), Body::Disc(29)];
    assert_eq!(
        counts.map(|body| spec.hole_count(body)),
        [9, 9, 6, 3].map(Some)
    );
    let robot = Robot::new(spec.clone()).unwrap();
    assert_eq!(robot.tendons().len(), 9);
    let mut places: Vec<f64> = (0..9)
        .map(|tendon| {
            let module = tendon / 3;
            let expected = (40 * module + 120 * (tendon % 3)) as f64;
            for Waypoint(body, hole) in &robot.tendons()[tendon].route {
                let [x, y] = spec.hole_position(*body, *hole).unwrap();
                let angle = y.atan2(x).to_degrees().rem_euclid(360.0);
                assert!((angle - expected).abs() < 1e-9, "{tendon}: {angle}");
                assert!((x.hypot(y) - 0.0045).abs() < 1e-15);
            }
            assert_eq!(robot.tendons()[tendon].route.len(), 10 * (module + 1) + 1);
            expected
        })
        .collect();
    places.sort_by(f64::total_cmp);
    assert_eq!(
        places,
        [0.0, 40.0, 80.0, 120.0, 160.0, 200.0, 240.0, 280.0, 320.0]
    );
    // Written by hand: nine holes in every body, nine routes.
    let mut by_hand = spec.clone();
    let tendons: Vec<_> = spec.tendons().into_iter().cloned().collect();
    let all = Holes::At(spec.hole_positions(Body::Base));
    by_hand.base.holes = all.clone();
    for module in &mut by_hand.modules {
        (module.clocking, module.tendons, module.holes) = (0.0, None, all.clone());
    }
    by_hand.routes = (0..9)
        .map(|tendon| tdcr_sim::robot::RouteSpec {
            through: std::iter::once(Body::Base)
                .chain((0..10 * (tendon / 3 + 1)).map(Body::Disc))
                .map(|body| Waypoint(body, tendon))
                .collect(),
            tendon: tendons[tendon].clone(),
        })
        .collect();
    let by_hand = Robot::new(by_hand).unwrap();
    let command = [2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5];
    let [a, b] = [&robot, &by_hand].map(|robot| {
        let settled = robot.settle(&robot.command(&command).unwrap(), &Default::default());
        assert!(settled.converged);
        settled.positions[29]
    });
    assert!((a - b).norm() < 1e-9, "{a} {b}");
    assert!(a.xy().norm() > 0.01, "it bends");
}

#[test]
fn wrong_rods_and_centres_of_mass_are_named() {
    for (from, to, expected) in [
        (
            "poisson = 0.3",
            "poisson = 0.6",
            "`modules[0].rod.poisson` is 0.6; expected above -1",
        ),
        (
            "youngs = 50e9",
            "youngs = 0",
            "`modules[0].rod.youngs` is 0; expected a finite",
        ),
        ("youngs = 50e9", "youngs = 1e14", "`modules[0].rod` is of "),
        (
            "joint_below = 0.003 ",
            "joint_below = 0.007 ",
            "`modules[0].joint_below` is 0.007, more than `first_offset`;",
        ),
        (
            "mass = { density = 1200.0 } ",
            "mass = { solid = { density = 1200.0, centre_of_mass = [0.001, 0.0, 0.0] } } ",
            "`modules[0].mass.solid.centre_of_mass` is [0.001, 0, ..]; expected 0 in x and y",
        ),
        (
            "rod = {",
            "backbone = { bending = [1.0, 1.0], torsion = 1.0 }\nrod = {",
            "`modules[0].backbone` is given; expected none beside a `rod`",
        ),
    ] {
        let message = said(&replaced(THREE_SEGMENTS, from, to).replace(
            "radius = 0.0005, d",
            if to.contains("1e14") {
                "radius = 10, d"
            } else {
                "radius = 0.0005, d"
            },
        ));
        assert!(message.contains(expected), "{message}\nnot\n{expected}");
    }
}

/// Sizes are looked at before any work in proportion to their products is done.
#[test]
fn robots_of_absurd_sizes_are_refused_at_once() {
    let start = Instant::now();
    let base = RobotSpec::standard("2m").unwrap();
    let refused = |change: &dyn Fn(&mut RobotSpec)| {
        let mut spec = base.clone();
        change(&mut spec);
        Robot::new(spec).unwrap_err().to_string()
    };
    let many = refused(&|spec| {
        let holes = Holes::At((0..300_000).map(|k| [0.01, 1e-7 * k as f64]).collect());
        spec.base.holes = holes.clone();
        spec.modules
            .iter_mut()
            .for_each(|m| m.holes = holes.clone());
    });
    assert!(
        many.contains("`base.holes` is a list of 300000; expected 1000 holes"),
        "{many}"
    );
    let crowded = refused(&|spec| {
        let holes = Holes::At((0..65).map(|k| [0.01, 1e-4 * k as f64]).collect());
        spec.base.holes = holes.clone();
        spec.modules
            .iter_mut()
            .for_each(|m| m.holes = holes.clone());
    });
    assert!(
        crowded.contains("`tendons at joint 0` is 65; expected 64 at most"),
        "{crowded}"
    );
    let huge = refused(&|spec| spec.modules.iter_mut().for_each(|m| m.discs = usize::MAX));
    assert!(huge.contains("`modules[0].discs`"), "{huge}");
    let modules = refused(&|spec| spec.modules = vec![spec.modules[0].clone(); 100_000]);
    assert!(modules.contains("`modules` is 500000 discs"), "{modules}");
    let routes = refused(&|spec| {
        let route = tdcr_sim::robot::RouteSpec {
            through: vec![Waypoint(Body::Base, 0), Waypoint(Body::Disc(9), 0)],
            tendon: spec.modules[0].tendons.clone().unwrap(),
        };
        spec.routes = vec![route; 300_000];
    });
    assert!(routes.contains("`routes` is a list of 300000"), "{routes}");
    assert!(
        start.elapsed() < Duration::from_secs(5),
        "{:?}",
        start.elapsed()
    );
}
