//! `tdcr calibrate-cameras`, on pictures of a board by cameras whose poses are known.

use std::fs::{self, File};
use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use tdcr::hw::extrinsics::{Board, BoardSpec, Exposure, GreyImage, picture};
use tdcr::sim::camera::Camera;
use tdcr::sim::robot::{Aim, CameraSpec, Lens};

use crate::capture::small_rig;
use crate::{refuse, succeed, succeed_json, text};

const BOARD: &str =
    "squares = [7, 5]\nsquare = 0.05\nmarker = 0.037\ndictionary = \"DICT_4X4_50\"\n";
const SERIALS: [&str; 3] = ["left", "middle", "right"];
/// Small images, so that they are rendered in a moment.
const SIZE: [u32; 2] = [640, 360];

/// Three cameras before a table, half a radian from each other.
fn cameras() -> Vec<Camera> {
    let camera = |index: usize| {
        let (sin, cos) = (0.5 * (index as f64 - 1.0)).sin_cos();
        Camera::free(&CameraSpec {
            position: [0.7 * sin, -0.7 * cos, 0.4],
            aim: Aim::At([0.0, 0.0, 0.1]),
            lens: Lens::Fovy(42.0),
            resolution: SIZE,
            distortion: None,
        })
    };
    (0..3).map(camera).collect()
}

/// Where the board stands in the views, its front towards the cameras: turned about the vertical, tilted up.
fn places() -> Vec<(&'static str, Isometry3<f64>)> {
    let stand = |turn: f64, tilt: f64, x: f64, z: f64| {
        // Standing upright it faces -y.
        let upright = UnitQuaternion::from_axis_angle(
            &Vector3::x_axis(),
            -std::f64::consts::FRAC_PI_2 - tilt,
        );
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn) * upright;
        let middle = rotation * Vector3::new(0.175, 0.125, 0.0);
        Isometry3::from_parts(
            Translation3::from(Vector3::new(x, 0.0, z) - middle),
            rotation,
        )
    };
    vec![
        ("base", stand(0.0, 0.5, 0.0, 0.1)),
        ("a", stand(0.3, 0.2, 0.05, 0.15)),
        ("b", stand(-0.3, 0.3, -0.05, 0.08)),
        ("c", stand(0.1, 0.9, 0.02, 0.05)),
        ("d", stand(-0.5, 0.6, 0.0, 0.12)),
        ("e", stand(0.5, 0.7, -0.03, 0.1)),
    ]
}

fn write_png(path: &Path, image: &GreyImage) {
    let [width, height] = image.size();
    let mut encoder = png::Encoder::new(File::create(path).unwrap(), width, height);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(image.pixels()).unwrap();
}

/// A folder with `images/SERIAL/VIEW.png`, `board.toml` and `cameras.toml`.
fn session() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let board = Board::new(BoardSpec {
        squares: [7, 5],
        square: 0.05,
        marker: 0.037,
        dictionary: "DICT_4X4_50".into(),
    })
    .unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for (serial, camera) in SERIALS.iter().zip(cameras()) {
        let images = folder.path().join("images").join(serial);
        fs::create_dir_all(&images).unwrap();
        for (view, placed) in places() {
            let image = picture(&board, &placed, &camera, &Exposure::default(), &mut rng);
            write_png(&images.join(format!("{view}.png")), &image);
        }
    }
    let pose = places()[0].1;
    let (p, q) = (pose.translation.vector, pose.rotation);
    let world = format!(
        "[world]\nview = \"base\"\nposition = [{}, {}, {}]\norientation = [{}, {}, {}, {}]\n",
        p.x, p.y, p.z, q.w, q.i, q.j, q.k
    );
    fs::write(folder.path().join("board.toml"), BOARD.to_owned() + &world).unwrap();
    let camera = |serial: &&str| {
        format!(
            "[[cameras]]\nserial = \"{serial}\"\nlink = \"realsense\"\n[cameras.camera]\nlens = {{ fovy = 42.0 }}\nresolution = \
             [{}, {}]\n",
            SIZE[0], SIZE[1]
        )
    };
    let cameras: String = SERIALS.iter().map(camera).collect();
    fs::write(
        folder.path().join("cameras.toml"),
        "name = \"rig\"\n".to_owned() + &cameras,
    )
    .unwrap();
    folder
}

fn arguments<'a>(images: &'a Path, board: &'a Path, cameras: &'a Path) -> [&'a str; 6] {
    [
        "calibrate-cameras",
        text(images),
        "--board",
        text(board),
        "--cameras",
        text(cameras),
    ]
}

#[test]
fn poses_are_found_and_written_into_the_file_of_the_cameras() {
    let folder = session();
    let at = |name: &str| folder.path().join(name);
    let (images, board, file, out) = (
        at("images"),
        at("board.toml"),
        at("cameras.toml"),
        at("out.toml"),
    );
    let arguments = arguments(&images, &board, &file);
    let found = succeed_json(&[&arguments[..], &["--out", text(&out)]].concat());
    assert_eq!(found["world"], "board in view base");
    assert_eq!(found["units"]["position_deviation"], "m");
    assert!(found["noise"].as_f64().unwrap() < 0.3, "{found}");
    let written: Value = toml::from_str::<Value>(&fs::read_to_string(&out).unwrap()).unwrap();
    assert_eq!(
        (&written["name"], &written["cameras"][1]["link"]),
        (&"rig".into(), &"realsense".into())
    );
    for (index, truth) in cameras().iter().enumerate() {
        let said = &found["cameras"][index];
        assert_eq!(said["serial"], SERIALS[index]);
        assert_eq!(said["images"], 6);
        // Seen from the side a board may be missed.
        let views = said["views"].as_u64().unwrap();
        assert!(
            (4..=6).contains(&views),
            "{}: {views} views",
            SERIALS[index]
        );
        let camera = &written["cameras"][index]["camera"];
        assert_eq!(camera["position"], said["position"]);
        assert_eq!(camera["aim"]["orientation"], said["orientation"]);
        let spec: CameraSpec = serde_json::from_value(camera.clone()).unwrap();
        let pose = Camera::free(&spec).pose;
        let apart = (pose.translation.vector - truth.pose.translation.vector).norm();
        let turned = pose.rotation.angle_to(&truth.pose.rotation).to_degrees();
        assert!(
            apart < 2e-3 && turned < 0.15,
            "{}: {apart} m, {turned} degrees",
            SERIALS[index]
        );
    }
    // The result is a file of cameras too, and the first camera may be the world.
    fs::write(&board, BOARD).unwrap();
    let again = [
        "calibrate-cameras",
        text(&images),
        "--board",
        text(&board),
        "--cameras",
        text(&out),
    ];
    let said = succeed(&again);
    assert!(
        said.contains("camera left: at 0.0000, 0.0000, 0.0000 m"),
        "{said}"
    );
    assert!(
        said.contains(" of 6 images") && said.contains("world: first camera"),
        "{said}"
    );
}

#[test]
fn what_is_missing_or_wrong_is_named() {
    let folder = session();
    let at = |name: &str| folder.path().join(name);
    let (images, board, cameras) = (at("images"), at("board.toml"), at("cameras.toml"));
    let arguments = arguments(&images, &board, &cameras);
    let change = |file: &Path, from: &str, to: &str, expected: &str| {
        let text = fs::read_to_string(file).unwrap();
        assert!(text.contains(from), "{text}");
        fs::write(file, text.replacen(from, to, 1)).unwrap();
        refuse(&arguments, 1, expected);
        fs::write(file, text).unwrap();
    };
    change(
        &board,
        "marker = 0.037",
        "marker = 0.06",
        "board.toml: marker = 0.06; expected the edge of a marker",
    );
    change(
        &board,
        "DICT_4X4_50",
        "4X4",
        "dictionary = \"4X4\" is not known",
    );
    change(
        &board,
        "view = \"base\"",
        "view = \"bass\"",
        "no camera sees the board in view bass",
    );
    change(
        &board,
        "DICT_4X4_50",
        "DICT_7X7_50",
        "no camera sees the board in any of 6 views: is it the board described",
    );
    change(&cameras, "fovy = 42.0", "fovy = 420.0", "cameras.toml: ");
    change(
        &cameras,
        "\"middle\"",
        "\"left\"",
        "cameras[1].serial is \"left\"; expected a name",
    );
    change(
        &cameras,
        "\"middle\"",
        "\"../up\"",
        "cameras[1].serial is \"../up\"; expected a name",
    );
    change(
        &cameras,
        "\"right\"",
        "\"front\"",
        "right has images of no camera of the list; expected folders named left, middle, front",
    );
    change(
        &cameras,
        "360",
        "361",
        "left/a.png: the image has 640 x 360 pixels; the camera's have 640 x 361",
    );
    // No image of a camera, no board in any of them, a damaged one.
    let (right, away) = (images.join("right"), at("away"));
    fs::rename(&right, &away).unwrap();
    refuse(&arguments, 1, "there are no images ");
    fs::create_dir(&right).unwrap();
    let empty = GreyImage::new(SIZE, vec![90; (SIZE[0] * SIZE[1]) as usize]).unwrap();
    write_png(&right.join("a.png"), &empty);
    refuse(
        &arguments,
        1,
        "no image of right shows the board with 6 corners or more",
    );
    fs::write(right.join("a.png"), b"\x89PNG\r\n\x1a\n damaged").unwrap();
    refuse(&arguments, 1, "right/a.png: ");
    let wrong = at("out.json");
    refuse(
        &[&arguments[..], &["--out", text(&wrong)]].concat(),
        1,
        "expected the extension .toml",
    );
    refuse(
        &["calibrate-cameras", "--board", text(&board)],
        2,
        "required",
    );
}

#[test]
fn boards_are_printed_at_their_size() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let board = at("board.toml");
    fs::write(&board, BOARD).unwrap();
    let print = |file: &Path| {
        succeed(&[
            "calibrate-cameras",
            "--board",
            text(&board),
            "--print-board",
            text(file),
        ])
    };
    let said = print(&at("board.svg"));
    assert!(
        said.contains("350.0 mm x 250.0 mm; print it at 100 %"),
        "{said}"
    );
    let svg = fs::read_to_string(at("board.svg")).unwrap();
    assert!(svg.contains("width=\"400mm\" height=\"300mm\""));
    print(&at("board.png"));
    let decoder = png::Decoder::new(std::io::BufReader::new(
        File::open(at("board.png")).unwrap(),
    ));
    let reader = decoder.read_info().unwrap();
    let density = reader.info().pixel_dims.unwrap().xppu;
    let width = f64::from(reader.info().width) / f64::from(density);
    assert!((width - 0.4).abs() < 1e-4, "{width}");
}

/// The cameras of the rig in memory stand where its file says: what is left are their errors, such as that of each one's
/// depth scale.
#[test]
fn pictures_of_the_robot_by_a_rigs_cameras_lie_on_each_other() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/rig-sim.toml");
    let check = ["calibrate-cameras", "--check", file];
    let checked = succeed_json(&check);
    let pairs = checked["overlaps"].as_array().unwrap();
    assert!(pairs.len() >= 4, "{checked}");
    for pair in pairs
        .iter()
        .filter(|pair| pair["points"].as_u64() > Some(200))
    {
        let [mean, rms] = ["mean", "rms"].map(|key| pair[key].as_f64().unwrap());
        assert!(mean.abs() < 4e-3 && rms < 5e-3, "{pair}");
    }
    // Two small cameras say it in the same words.
    let folder = tempfile::tempdir().unwrap();
    let said = succeed(&[
        "calibrate-cameras",
        "--check",
        text(&small_rig(folder.path())),
    ]);
    assert!(said.contains(" from the surface of "), "{said}");
    let both = [&check[..], &["--board", "board.toml"]].concat();
    refuse(&both, 2, "cannot be used with");
}
