//! Each masker alone on small pictures, and all of them on the D435's picture of a robot on a table.

use std::fs;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::{Isometry3, Point3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::camera::{Camera, Intrinsics};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::geometry::Instance;
use tdcr_sim::render::{BaseVisibility, Visuals};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::statics::Settler;

use super::*;
use crate::camera::RgbdCamera;
use crate::clock::VirtualClock;
use crate::simulated::camera::{CameraSetup, SimulatedCamera, table};

const SHOT: Shot = Shot { view: 0, sample: 0 };

/// A picture drawn with letters: a depth of 1 m for `.`, 0.5 m for `#`, none for a space.
fn picture(rows: &[&str]) -> RgbdFrame {
    let [width, height] = [rows[0].len() as u32, rows.len() as u32];
    let camera = Camera {
        intrinsics: Intrinsics::from_fovy(width, height, 0.8),
        pose: Isometry3::identity(),
    };
    let depth = rows
        .iter()
        .flat_map(|row| row.bytes())
        .map(|letter| match letter {
            b'#' => 0.5,
            b'.' => 1.0,
            _ => 0.0,
        });
    let depth: Vec<f32> = depth.collect();
    RgbdFrame::measured(&camera, vec![[90; 3]; depth.len()], depth).expect("of one size")
}

fn drawn(mask: &Mask) -> Vec<String> {
    let letter = |shown: &bool| if *shown { '#' } else { '.' };
    let rows = mask.pixels().chunks(mask.size()[0] as usize);
    rows.map(|row| row.iter().map(letter).collect()).collect()
}

/// Takes what is nearer than 0.7 m for the robot.
struct Near;

impl Masker for Near {
    fn mask(&self, frame: &RgbdFrame, _: Shot) -> Result<Mask, MaskError> {
        Ok(Mask::of_frame(frame, |index| {
            (0.1..0.7).contains(&frame.depth[index])
        }))
    }
}

#[test]
fn components_hang_together_over_gaps() {
    let frame = picture(&["##..#", "....#", "#...#", "##..."]);
    let kept = |keep, gap| drawn(&Near.keeping(keep, gap).mask(&frame, SHOT).expect("a mask"));
    // The first of the two largest.
    assert_eq!(kept(Keep::Largest, 0), ["....#", "....#", "....#", "....."]);
    assert_eq!(
        kept(Keep::AtLeast(3), 0),
        ["....#", "....#", "#...#", "##..."]
    );
    assert_eq!(kept(Keep::Largest, 1), ["##...", ".....", "#....", "##..."]);
    assert_eq!(kept(Keep::Largest, 2), ["##..#", "....#", "#...#", "##..."]);
    let empty = picture(&["....."]);
    assert_eq!(
        Near.keeping(Keep::Largest, 0)
            .mask(&empty, SHOT)
            .expect("a mask")
            .count(),
        0
    );
}

#[test]
fn combinations_are_those_of_sets() {
    let frame = picture(&["#. #"]);
    let everything = Not(Near.and(Not(Near)));
    let shown = |masker: &dyn Masker| drawn(&masker.mask(&frame, SHOT).expect("a mask"));
    assert_eq!(shown(&Near), ["#..#"]);
    assert_eq!(shown(&Not(Near)), [".##."]);
    assert_eq!(shown(&everything), ["####"]);
    assert_eq!(shown(&Near.and(everything)), ["#..#"]);
    assert_eq!(shown(&Near.or(Not(Near))), ["####"]);
}

#[test]
fn a_masked_picture_becomes_the_cloud_of_what_is_in_the_mask() {
    let frame = picture(&["#..", ".#."]);
    let kept = Near
        .mask(&frame, SHOT)
        .expect("a mask")
        .applied(&frame)
        .expect("of one size");
    let mut cloud = PointCloud::default();
    cloud.add_frame(&kept);
    assert_eq!(cloud.len(), 2);
    assert!(cloud.points.iter().all(|point| point[2] == 0.5));
    let error = Near
        .mask(&frame, SHOT)
        .expect("a mask")
        .applied(&picture(&["#"]))
        .expect_err("another size");
    assert!(
        error.to_string().contains("3 x 2 pixels; expected 1 x 1"),
        "{error}"
    );
}

#[test]
fn a_box_keeps_the_points_within_it() {
    let frame = picture(&["#.#", "...", "#.#"]);
    // The right half of what is near.
    let workspace = WorkspaceBox {
        low: [0.0, -1.0, 0.4],
        high: [1.0, 1.0, 0.6],
    };
    assert_eq!(
        drawn(&workspace.mask(&frame, SHOT).expect("a mask")),
        ["..#", "...", "..#"]
    );
    assert!(workspace.contains(&Point3::from(Vector3::new(0.0, 0.0, 0.5))));
}

#[test]
fn the_background_learns_noise_and_where_nothing_is() {
    let mut learner = BackgroundLearner::new();
    // The left column is still, the middle one noisy, the right one empty.
    for index in 0..6 {
        let mut frame = picture(&[".. ", ".. "]);
        for row in 0..2 {
            frame.depth[3 * row + 1] = 1.0 + 0.02 * if index % 2 == 0 { 1.0 } else { -1.0 };
        }
        let few = learner.finish(&BackgroundSetting::default());
        assert_eq!(index < 5 && index > 0, few.is_err(), "{index}");
        learner.add(0, &frame).expect("of one size");
    }
    let background = learner
        .finish(&BackgroundSetting::default())
        .expect("six pictures");
    let mut frame = picture(&["...", "..."]);
    frame.depth = vec![0.996, 0.94, 5.0, 0.994, 0.9, 0.0];
    assert_eq!(
        drawn(&background.mask(&frame, SHOT).expect("a mask")),
        ["..#", "##."]
    );
    let other = Shot { view: 1, sample: 0 };
    let error = background
        .mask(&frame, other)
        .expect_err("not learned")
        .to_string();
    assert!(
        error.contains("no background of camera 1") && error.contains("empty scene"),
        "{error}"
    );
    assert!(matches!(
        background.mask(&picture(&["."]), SHOT),
        Err(MaskError::Size { .. })
    ));
    assert!(matches!(
        learner.add(0, &picture(&["."])),
        Err(MaskError::Size { .. })
    ));
}

#[test]
fn folders_give_back_what_was_written_and_say_what_is_wrong() {
    let folder = tempfile::tempdir().expect("a folder");
    let masks = MaskFolder::new(folder.path());
    let shot = Shot {
        view: 3,
        sample: 12,
    };
    let frame = picture(&["#.#", ".#."]);
    let mask = Near.mask(&frame, shot).expect("a mask");
    masks.write(&mask, shot).expect("written");
    assert!(folder.path().join("camera3/000012.png").is_file());
    assert_eq!(masks.mask(&frame, shot).expect("a mask"), mask);
    let refused =
        |shot, frame: &RgbdFrame| masks.mask(frame, shot).expect_err("refused").to_string();
    let missing = refused(Shot { view: 0, sample: 7 }, &frame);
    assert!(
        missing.contains("camera 0 and sample 7") && missing.contains("000007.png"),
        "{missing}"
    );
    let wrong = refused(shot, &picture(&["."]));
    assert!(
        wrong.contains("000012.png has 3 x 2 pixels; expected 1 x 1"),
        "{wrong}"
    );
    let path = masks.path(shot);
    let bytes = fs::read(&path).expect("written");
    fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    assert!(refused(shot, &frame).contains("is no mask"));
    let mut color = Vec::new();
    let mut encoder = png::Encoder::new(&mut color, 1, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(&[1, 2, 3]))
        .expect("written");
    fs::write(&path, &color).expect("written");
    assert!(refused(shot, &picture(&["."])).contains("Rgb pixels of 8 bits"));
}

#[test]
fn maskers_find_the_robot_on_a_table() {
    let robot = Robot::load("2m").expect("built in");
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let command = robot.random_command(&mut rng);
    let mut settler = Settler::new(&robot);
    let equilibrium = settler.settle(&command, &Loads::default());
    let mut camera = Camera::placed(&robot.spec().cameras).swap_remove(0);
    camera.intrinsics = Intrinsics::from_fovy(320, 180, 45_f64.to_radians());
    let mut surroundings = table(0.0).expect("sizes above 0");
    surroundings.solids.extend(
        Visuals::of_robot(&robot, equilibrium, BaseVisibility::Shown)
            .solids
            .into_iter()
            .filter(|solid| solid.instance == Instance::Base),
    );
    let setup = CameraSetup {
        surroundings,
        ..CameraSetup::d435("a", camera)
    };
    let clock = Arc::new(VirtualClock::new());
    let patience = Duration::from_secs(1);
    let open =
        |visuals: Visuals| SimulatedCamera::new(setup.clone(), Box::new(visuals), clock.clone());
    let mut learner = BackgroundLearner::new();
    let mut empty = open(Visuals::default());
    for _ in 0..20 {
        let frame = empty.grab(patience).expect("a picture").value;
        learner.add(0, &frame).expect("of one size");
    }
    let background = learner
        .finish(&BackgroundSetting::default())
        .expect("enough pictures");
    let mut watching = open(Visuals::of_robot(
        &robot,
        equilibrium,
        BaseVisibility::Hidden,
    ));
    let frame = watching.grab(patience).expect("a picture").value;
    let truth = Mask::of_robot(watching.truth().expect("a picture was taken"));
    assert!(truth.count() > 500);
    let iou = |masker: &dyn Masker| {
        let mask = masker.mask(&frame, SHOT).expect("a mask");
        let measured = |index: usize| frame.depth[index] > 0.0;
        mask.overlap(&truth, measured).expect("of one size").iou()
    };
    let workspace = WorkspaceBox {
        low: [-0.35, -0.35, 0.05],
        high: [0.35, 0.35, 0.9],
    };
    let both = background.clone().and(workspace);
    let found = [
        iou(&background),
        iou(&workspace),
        iou(&ColorKey::saturated(0.5)),
        iou(&both),
    ];
    // Nothing but the robot is nearer than the empty scene; the box alone takes the base too.
    assert!(found[0] > 0.95 && found[3] > 0.95, "{found:?}");
    assert!(found[1] < 0.9 && found[2] < 0.9, "{found:?}");
    let cleaned = iou(&both.keeping(Keep::AtLeast(20), 2));
    assert!(cleaned > 0.95, "{cleaned}");
}
