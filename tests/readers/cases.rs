//! What the readers are given: a sound file of each kind, and files that once took a reader's memory, time or stack.

use serde_json::{Value, json};
use zip::CompressionMethod;

use super::bus::*;
use super::files::*;
use super::learned::*;
use super::readers;

/// A file's name, and its bytes.
pub type Case = (&'static str, Vec<u8>);

/// Sound files for the reader `name`, small enough to be damaged in every way.
pub fn sound(name: &str) -> Vec<Case> {
    match name {
        "robot_toml" => vec![("2m", ROBOT.into())],
        "robot_json" => vec![
            ("2m", json_of(&two_modules())),
            ("marked", marked(&json_of(&two_modules()))),
        ],
        "mjcf" => vec![
            ("2m", include_bytes!("../../models_xml/2m.xml").to_vec()),
            ("by_hand", BY_HAND.into()),
            ("obstacles", OBSTACLES.into()),
        ],
        "urdf" => vec![("2m", include_bytes!("../../models_xml/2m.urdf").to_vec())],
        "stl" => vec![
            ("text", STL.into()),
            ("marked", marked(STL.as_bytes())),
            ("binary", binary_stl()),
        ],
        "meta" => vec![("imported", json_of(&meta()))],
        "part" => vec![
            ("third", json_of(&part_of(3, meta()))),
            ("only", json_of(&part_of(1, meta()))),
        ],
        "motor_ranges" => {
            let ranges = json!({"min": [0.0, 0.01], "max": [0.04, 0.05], "scale": [0.04, 0.04]});
            vec![("two", json_of(&json!({ "all": ranges })))]
        }
        "point_scale" => {
            let scale = json!({"center": [0, 0, 0], "scale": 0.5});
            vec![("half", json_of(&json!({ "all": scale })))]
        }
        "shard" => {
            let shard = include_bytes!("../../learn/tests/data/chunked/val/shard-00000.h5");
            let latest = include_bytes!("../../learn/tests/data/latest.h5");
            vec![
                ("h5py", shard.to_vec()),
                ("latest", latest.to_vec()),
                ("ours", zeros(1, 5, None)),
            ]
        }
        "npy" => vec![
            ("floats", [npy_header(2, "<f4"), vec![0; 24]].concat()),
            ("colours", [npy_of([2, 6], "<f4"), vec![0; 48]].concat()),
        ],
        "npz" => vec![
            ("stored", archive(2, CompressionMethod::Stored)),
            ("deflated", archive(200, CompressionMethod::Deflated)),
        ],
        "pcd" => vec![
            ("binary", pcd("1 1 1 1", 2, 32)),
            ("text", PCD.into()),
            ("colours", COLORED_PCD.into()),
        ],
        "ply" => vec![
            ("binary", binary_ply()),
            ("text", PLY.into()),
            ("floats", COLORED_PLY.into()),
            ("marked", marked(COLORED_PLY.as_bytes())),
        ],
        "motors" => vec![
            ("two", b"{\"ctrl\": [0.01, 2e-3]}".to_vec()),
            ("marked", marked(b"{\"ctrl\": [0.01, 2e-3]}")),
        ],
        "predictions" => vec![("two", predictions(2, 3))],
        "study_file" => vec![
            ("stiffness", STUDY.into()),
            ("marked", marked(STUDY.as_bytes())),
        ],
        "rig_file" => vec![(
            "simulated",
            include_bytes!("../../examples/rig-sim.toml").to_vec(),
        )],
        "scene_file" => vec![
            ("shelf", SHELF.into()),
            ("marked", marked(SHELF.as_bytes())),
        ],
        "model" => vec![("mlp", model())],
        "training_state" => vec![("mlp", training_state())],
        "split_file" => vec![(
            "three",
            b"# by hand\na,train\nb.ply, val\n\nc,test\n".to_vec(),
        )],
        "journal" => vec![("entries", readers::journal_file())],
        "rig_log" => vec![
            (
                "sample",
                include_bytes!("../../hw/tests/data/sample.mcap").to_vec(),
            ),
            (
                "zstd",
                include_bytes!("../../hw/tests/data/events-zstd.mcap").to_vec(),
            ),
            (
                "lz4",
                include_bytes!("../../hw/tests/data/events-lz4.mcap").to_vec(),
            ),
        ],
        "commands" => vec![
            ("csv", b"# m\n0.01, 0.02\n\n3e-2,-0\n".to_vec()),
            ("json", b"[[0.01, 0.02], [3e-2, -0]]".to_vec()),
            ("marked", marked(b"0.01, 0.02\n")),
        ],
        "columns" => vec![("all", include_bytes!("columns.toml").to_vec())],
        "priors" => vec![
            ("two", PRIORS.into()),
            ("marked", marked(PRIORS.as_bytes())),
        ],
        "recording" => vec![
            ("commas", recording(",")),
            ("tabs", recording("\t")),
            ("bad_rows", BAD_ROWS.into()),
        ],
        "servo_frames" => vec![("instructions", instructions()), ("statuses", statuses())],
        "servo_answers" => vec![("statuses", statuses())],
        _ => vec![],
    }
}

/// Files for the reader `name` that ask for more than they hold.
pub fn hostile(name: &str) -> Vec<Case> {
    let robot = |from: &str, to: &str| ROBOT.replacen(from, to, 1).into_bytes();
    let meta_with = |field: &str, value: Value| {
        let mut meta = meta();
        meta[field] = value;
        json_of(&meta)
    };
    match name {
        "columns" => vec![
            ("deep", format!("pattern = {}", "[".repeat(100_000)).into()),
            ("many", "[[markers]]\n".repeat(200_000).into()),
        ],
        "priors" => vec![
            ("deep", format!("lag = {}", "[".repeat(100_000)).into()),
            (
                "many",
                (0..100_000)
                    .map(|k| format!("[u{k}]\n"))
                    .collect::<String>()
                    .into(),
            ),
        ],
        "recording" => vec![
            ("wide", ",".repeat(3_000_000).into()),
            (
                "long",
                format!("{NAMES}\n{}", "1,\n".repeat(1_000_000)).into(),
            ),
            (
                "quoted",
                format!("{NAMES}\n{}", "\"".repeat(3_000_000)).into(),
            ),
        ],
        "robot_toml" => vec![
            (
                "overflowing_norm",
                robot("position =", "orientation = [1e200, 0, 0, 0]\nposition ="),
            ),
            (
                "many_holes",
                robot(
                    "holes = [",
                    &format!("holes = [{}", "[0.01, 0.0], ".repeat(300_000)),
                ),
            ),
            ("deep", format!("name = {}", "[".repeat(100_000)).into()),
        ],
        "rig_log" => {
            // A chunk of 2^60 bytes whose lengths agree, and records that claim all there is and more.
            let length = 1_u64 << 60;
            let chunk = [
                &b"\x89MCAP0\r\n\x06"[..],
                &length.to_le_bytes(),
                &[0; 16],
                &(length - 40).to_le_bytes(),
                &[0; 8],
                &(length - 40).to_le_bytes(),
            ];
            let claims = [
                &b"\x89MCAP0\r\n"[..],
                &b"\x09\xff\xff\xff\xff\xff\xff\xff\xff".repeat(50_000),
            ];
            vec![
                ("endless_chunk", [chunk.concat(), vec![5; 100_000]].concat()),
                ("claims", claims.concat()),
            ]
        }
        "robot_json" => vec![("deep", "[".repeat(1_000_000).into())],
        "mjcf" => vec![
            ("deep", nested("<mujoco><worldbody>", "body", 200_000)),
            ("many_attributes", attributes("mujoco", 60_000)),
            (
                "endless_include",
                b"<mujoco><include file=\"/dev/zero\"/></mujoco>".to_vec(),
            ),
            (
                "itself",
                b"<mujoco><include file=\"robot.xml\"/></mujoco>".to_vec(),
            ),
        ],
        "urdf" => vec![
            ("deep", nested("<robot name=\"r\">", "link", 30_000)),
            ("many_attributes", attributes("robot", 60_000)),
        ],
        "stl" => vec![("counts_all", [&[0; 80][..], &[255; 4]].concat())],
        "meta" => vec![
            ("count_u64", meta_with("count", u64::MAX.into())),
            (
                "count_1e12",
                meta_with("count", 1_000_000_000_000_u64.into()),
            ),
            ("motors_u64", meta_with("motors", u64::MAX.into())),
            ("points_u64", meta_with("points_per_cloud", u64::MAX.into())),
            ("deep", "[".repeat(1_000_000).into()),
        ],
        "part" => {
            let mut many = meta();
            many["count"] = 10_000_000.into();
            vec![
                ("many_parts", json_of(&part_of(10_000_000, meta()))),
                ("many_samples", json_of(&part_of(1, many))),
                ("parts_u64", json_of(&part_of(u64::MAX, meta()))),
                ("deep", "[".repeat(1_000_000).into()),
            ]
        }
        "shard" => vec![
            ("zeros", zeros(1_000_000, 5, Some(9))),
            ("one_large", zeros(1, 20_000_000, Some(9))),
        ],
        "predictions" => vec![
            ("bomb", predictions(1, 25_000_000)),
            ("no_points", predictions(1 << 20, 0)),
        ],
        "study_file" => vec![
            ("deep", format!("want = {}", "[".repeat(100_000)).into()),
            (
                "many",
                "[[vary]]\nwhat = \"payload\"\n".repeat(20_000).into(),
            ),
            (
                "endless_model",
                b"want = [\"model\"]\n[model]\nfile = \"/dev/zero\"\n".to_vec(),
            ),
        ],
        "scene_file" => vec![
            ("deep", format!("obstacle = {}", "[".repeat(100_000)).into()),
            ("many", "[[obstacle]]\n".repeat(200_000).into()),
            (
                "many_pipes",
                "[[obstacle]]\npipe = { radius = 1, length = 1 }\n"
                    .repeat(10_000)
                    .into(),
            ),
            (
                "long_pipe",
                format!(
                    "[[obstacle]]\npipe = {{ radius = 1, path = [{}] }}\n",
                    "[0, 0, 0], [0, 0, 1], ".repeat(100_000)
                )
                .into(),
            ),
            (
                "endless_mesh",
                b"[[obstacle]]\nmesh = \"/dev/zero\"\n".to_vec(),
            ),
            ("itself", b"[[obstacle]]\nmesh = \"scene.toml\"\n".to_vec()),
        ],
        "rig_file" => vec![("deep", format!("servos = {}", "[".repeat(100_000)).into())],
        "npy" => vec![
            ("no_data", npy_header(1 << 60, "<f4")),
            ("one_wide_row", npy_of([3, 1 << 60], "<f4")),
            (
                "bytes",
                [npy_header(1 << 20, "|u1"), vec![0; 3 << 20]].concat(),
            ),
        ],
        "npz" => vec![("bomb", archive(25_000_000, CompressionMethod::Deflated))],
        "pcd" => vec![
            ("many_columns", pcd(&"4096 ".repeat(200_000), 1, 16)),
            ("long_name", long_name()),
            ("many_points", pcd("1 1 1 1", usize::MAX, 16)),
        ],
        "ply" => vec![
            (
                "many_points",
                PLY.replace("vertex 2", "vertex 4294967295").into(),
            ),
            (
                "before",
                PLY.replace("element", "element face 4294967295\nelement")
                    .into(),
            ),
        ],
        "motors" => vec![(
            "deep",
            format!("{{\"ctrl\": {}", "[".repeat(1_000_000)).into(),
        )],
        "split_file" => vec![("one_cloud_often", "a,train\n".repeat(300_000).into())],
        "journal" => vec![(
            "deep",
            format!("{{\"format\":1}}\n{}\n", "[".repeat(1_000_000)).into(),
        )],
        "commands" => vec![
            ("deep", "[".repeat(1_000_000).into()),
            (
                "empty_rows",
                format!("[{}[]]", "[],".repeat(300_000)).into(),
            ),
        ],
        // Headers that promise more than a frame holds, and as much as one does.
        "servo_frames" | "servo_answers" => vec![
            (
                "long",
                [0xFF, 0xFF, 0xFD, 0, 1, 0xFF, 0xFF, 0x55].repeat(100_000),
            ),
            (
                "longest",
                [0xFF, 0xFF, 0xFD, 0, 1, 0, 4, 0x55].repeat(100_000),
            ),
        ],
        "model" | "training_state" => vec![
            ("long_header", [&u64::MAX.to_le_bytes()[..], b"{}"].concat()),
            ("wide", wide(name)),
        ],
        _ => vec![],
    }
}
