//! What the readers are given: a sound file of each kind, and files that once took a reader's memory, time or stack.

use std::fmt::Write as _;
use std::io::{self, Cursor, Read, Write as _};
use std::path::Path;

use hdf5_pure::FileBuilder;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use tdcr::hw::dynamixel::joined::{JoinedWriter, length_field};
use tdcr::hw::dynamixel::{Answers, Backup, ErrorByte, Instruction, PacketId, Reset, Status};
use tdcr::hw::servo::ServoId;
use tdcr::learn::data::{CloudSet, Normalisation, Subject};
use tdcr::learn::net::{Channels, MlpShape, Network, TimeFeatures};
use tdcr::learn::symmetry::Reduction;
use tdcr::learn::train::{Model, Provenance, TrainSettings, Trainer};
use tdcr::sim::render::BaseVisibility;
use tdcr::sim::robot::RobotSpec;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::readers;

/// A file's name, and its bytes.
pub type Case = (&'static str, Vec<u8>);

/// Sound files for the reader `name`, small enough to be damaged in every way.
pub fn sound(name: &str) -> Vec<Case> {
    match name {
        "robot_toml" => vec![("2m", ROBOT.into())],
        "robot_json" => vec![("2m", json_of(&two_modules()))],
        "mjcf" => vec![
            ("2m", include_bytes!("../../models_xml/2m.xml").to_vec()),
            ("by_hand", BY_HAND.into()),
        ],
        "urdf" => vec![("2m", include_bytes!("../../models_xml/2m.urdf").to_vec())],
        "stl" => vec![("text", STL.into()), ("binary", binary_stl())],
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
            vec![("h5py", shard.to_vec()), ("ours", zeros(1, 5, None))]
        }
        "npy" => vec![("floats", [npy_header(2, "<f4"), vec![0; 24]].concat())],
        "npz" => vec![
            ("stored", archive(2, CompressionMethod::Stored)),
            ("deflated", archive(200, CompressionMethod::Deflated)),
        ],
        "pcd" => vec![("binary", pcd("1 1 1 1", 2, 32)), ("text", PCD.into())],
        "ply" => vec![("binary", binary_ply()), ("text", PLY.into())],
        "motors" => vec![("two", b"{\"ctrl\": [0.01, 2e-3]}".to_vec())],
        "model" => vec![("mlp", model())],
        "training_state" => vec![("mlp", training_state())],
        "split_file" => vec![(
            "three",
            b"# by hand\na,train\nb.ply, val\n\nc,test\n".to_vec(),
        )],
        "journal" => vec![("entries", readers::journal_file())],
        "rig_log" => vec![(
            "sample",
            include_bytes!("../../hw/tests/data/sample.mcap").to_vec(),
        )],
        "commands" => vec![
            ("csv", b"# m\n0.01, 0.02\n\n3e-2,-0\n".to_vec()),
            ("json", b"[[0.01, 0.02], [3e-2, -0]]".to_vec()),
        ],
        "columns" => vec![("all", include_bytes!("columns.toml").to_vec())],
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
        "npy" => vec![
            ("no_data", npy_header(1 << 60, "<f4")),
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

const ROBOT: &str = include_str!("../../sim/robots/2m.toml");
const BY_HAND: &str = include_str!("../../sim/tests/formats/by_hand/robot.xml");
const STL: &str = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
                   endloop\nendfacet\nendsolid s\n";
const PCD: &str = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 2\nDATA ascii\n1 2 3\n4 5 6\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                   end_header\n1 2 3\n4 5 6\n";

fn json_of(value: &impl serde::Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("plain values serialise")
}

fn two_modules() -> RobotSpec {
    RobotSpec::standard("2m").expect("a standard robot")
}

fn meta() -> Value {
    json!({
        "format": 2, "tdcr_version": "0.1.0", "seed": 0, "count": 10, "motors": 2, "points_per_cloud": 5,
        "samples_per_shard": 250, "origin": {"imported": {"source": "a test"}},
    })
}

/// The first of so many parts.
fn part_of(of: u64, meta: Value) -> Value {
    json!({"part": 1, "of": of, "meta": meta})
}

/// `count` elements one within the other.
fn nested(start: &str, tag: &str, count: usize) -> Vec<u8> {
    format!("{start}{}", format!("<{tag}>").repeat(count)).into()
}

/// An element of `count` attributes.
fn attributes(tag: &str, count: usize) -> Vec<u8> {
    let mut text = format!("<{tag}");
    for k in 0..count {
        let _ = write!(text, " a{k}=\"0\"");
    }
    format!("{text}/>").into()
}

fn binary_stl() -> Vec<u8> {
    let corners: [f32; 12] = [0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0.];
    let corners = corners.iter().flat_map(|x| x.to_le_bytes());
    let head = [0; 80].into_iter().chain(1_u32.to_le_bytes());
    head.chain(corners).chain([0; 2]).collect()
}

fn binary_ply() -> Vec<u8> {
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
                  property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    [header.as_bytes(), &[0; 30]].concat()
}

fn pcd(counts: &str, points: usize, bytes: usize) -> Vec<u8> {
    let fields = counts.split_whitespace().count();
    let others = fields - 4;
    let header = format!(
        "VERSION .7\nFIELDS x y z rgb{}\nSIZE {}\nTYPE F F F U{}\nCOUNT {counts}\nPOINTS {points}\nDATA binary\n",
        " f".repeat(others),
        "4 ".repeat(fields),
        " F".repeat(others)
    );
    [header.as_bytes(), &vec![0; bytes]].concat()
}

/// A field with a long name, of many numbers.
fn long_name() -> Vec<u8> {
    let name = "n".repeat(1_000_000);
    format!(
        "FIELDS x y z {name}\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 4096\nPOINTS 1\nDATA ascii\n"
    )
    .into()
}

/// The header of an array of `rows` points.
fn npy_header(rows: usize, descr: &str) -> Vec<u8> {
    let mut text =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({rows}, 3), }}");
    text += &" ".repeat(63 - (10 + text.len()) % 64);
    text += "\n";
    let length = (text.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], text.as_bytes()].concat()
}

/// An archive of `rows` points, all zeros.
fn archive(rows: usize, method: CompressionMethod) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(method);
    let write = |writer: &mut ZipWriter<_>| -> io::Result<()> {
        writer.start_file("points.npy", options)?;
        writer.write_all(&npy_header(rows, "<f4"))?;
        io::copy(&mut io::repeat(0).take(12 * rows as u64), writer).map(drop)
    };
    write(&mut writer).expect("memory can be written");
    writer.finish().expect("memory can be written").into_inner()
}

/// A shard of `samples` clouds of `points` points and two motors, all zeros.
fn zeros(samples: u64, points: u64, deflate: Option<u32>) -> Vec<u8> {
    let mut builder = FileBuilder::new();
    for (name, shape) in [
        ("data", vec![samples, points, 3]),
        ("rgb", vec![samples, points, 3]),
        ("motors", vec![samples, 2]),
        ("motors_norm", vec![samples, 2]),
        ("data_norm", vec![samples, points, 3]),
        ("center", vec![samples, 3]),
        ("scale", vec![samples]),
    ] {
        let count = shape.iter().product::<u64>() as usize;
        let array = builder.create_dataset(name);
        match name {
            "rgb" => array.with_u8_data(&vec![0; count]),
            _ => array.with_f32_data(&vec![0.0; count]),
        };
        array.with_shape(&shape);
        if let Some(level) = deflate {
            array.with_chunks(&shape).with_deflate(level);
        }
    }
    builder.finish().expect("memory can be written")
}

const SHAPE: MlpShape = MlpShape {
    width: 4,
    depth: 2,
    embedding: 4,
    condition_dim: 6,
    octaves: 0,
    time_features: TimeFeatures::Plain,
    channels: Channels::Xyz,
};

fn provenance() -> Provenance {
    Provenance {
        subject: Some(Subject {
            robot: two_modules(),
            base: BaseVisibility::Hidden,
            payload: None,
        }),
        normalisation: Normalisation {
            motor_min: vec![0.0; 6],
            motor_max: vec![0.04; 6],
            scale: 0.4,
        },
        reduction: Reduction::default(),
    }
}

/// What `save` writes to a file.
fn saved(save: impl FnOnce(&Path)) -> Vec<u8> {
    let file = tempfile::NamedTempFile::new().expect("a file can be made");
    save(file.path());
    std::fs::read(file.path()).expect("a file can be read")
}

fn model() -> Vec<u8> {
    let network = Network::new(SHAPE, &mut ChaCha8Rng::seed_from_u64(0));
    let model = Model {
        provenance: provenance(),
        settings: TrainSettings::default(),
        step: 3,
        validation_distance: 0.1,
        network: network.expect("a network of a sound shape"),
    };
    saved(|path| model.save(path).expect("a file can be written"))
}

fn training_state() -> Vec<u8> {
    let set = CloudSet {
        condition_dim: 6,
        points_per_cloud: 4,
        conditions: vec![0.5; 60],
        points: vec![0.25; 120],
        colors: None,
        starts: None,
    };
    let settings = TrainSettings {
        points: 4,
        validation_clouds: 2,
        validation_points: 4,
        ..TrainSettings::default()
    };
    let trainer = Trainer::new(SHAPE, settings, &set, &set);
    let state = trainer.expect("a run can start").state(provenance());
    saved(|path| state.save(path).expect("a file can be written"))
}

/// The file for `name` with a header of the widest network, and the tensors of a small one.
fn wide(name: &str) -> Vec<u8> {
    let whole = match name {
        "model" => model(),
        _ => training_state(),
    };
    // The header of the file, JSON, holds the program's own as a string.
    let (head, rest) = whole.split_at(8);
    let mut header: Value = serde_json::from_slice(&rest[..length_of(head)]).expect("a header");
    let own = header["__metadata__"]["tdcr"].as_str().expect("a string");
    let mut own: Value = serde_json::from_str(own).expect("a header");
    for (field, size) in [("width", 8192), ("depth", 64)] {
        own["content"]["shape"][field] = size.into();
    }
    header["__metadata__"]["tdcr"] = own.to_string().into();
    let header = json_of(&header);
    let length = (header.len() as u64).to_le_bytes();
    [&length, &header[..], &rest[length_of(head)..]].concat()
}

/// Length of a header (bytes), of which the first eight bytes of a file tell.
fn length_of(head: &[u8]) -> usize {
    u64::from_le_bytes(head.try_into().expect("8 bytes")) as usize
}

/// An instruction of each kind.
fn instructions() -> Vec<u8> {
    let answers = Answers::Joined;
    let (address, length, ids) = (116, 4, &[1, 2, 3]);
    let row = &[1, 116, 0, 4, 0, 0xFF, 0xFF, 0xFD, 0x00];
    let mut bytes = Vec::new();
    for instruction in [
        Instruction::Ping,
        Instruction::Read { address, length },
        Instruction::Write { address, data: row },
        Instruction::FactoryReset(Reset::All),
        Instruction::Backup(Backup::Store),
        Instruction::ClearTurns,
        Instruction::SyncRead {
            answers,
            address,
            length,
            ids,
        },
        Instruction::SyncWrite {
            address,
            length,
            rows: &row[..5],
        },
        Instruction::BulkRead {
            answers,
            rows: &row[..5],
        },
        Instruction::BulkWrite { rows: row },
    ] {
        let encoded = instruction.encode(PacketId::Broadcast, &mut bytes);
        encoded.expect("a short frame");
    }
    bytes
}

/// What three servos answer to a driver that meets and reads them.
fn statuses() -> Vec<u8> {
    let mut bytes = Vec::new();
    for id in (1..4).filter_map(ServoId::new) {
        for parameters in [&[0xB0, 4, 46][..], &[2], &[250], &[], &[50; 15], &[4]] {
            let status = Status {
                id: PacketId::Servo(id),
                error: ErrorByte(0x80),
                parameters,
            };
            status.encode(&mut bytes).expect("a short frame");
        }
    }
    let mut joined = JoinedWriter::new(&mut bytes, length_field([4; 3])).expect("a short frame");
    for id in (1..4).filter_map(ServoId::new) {
        joined.section(id, ErrorByte::NONE, &[1, 2, 3, 4]);
    }
    bytes
}

/// Names of the columns of `columns.toml`.
const NAMES: &str = "t,motion,a,b,c,d,e,f,x,y,z,mx,my,mz,qw,qx,qy,qz";

/// A recording with these columns.
fn recording(separator: &str) -> Vec<u8> {
    let row =
        |k: usize| format!("{k},up and down,1,180,0,0.1,-3,{k}e-3,0,0,2{k}0,0,0,0.1,1,0,0,0.1");
    let rows = std::iter::once(NAMES.to_owned()).chain((0..6).map(row));
    let rows: Vec<String> = rows.map(|row| row.replace(',', separator)).collect();
    rows.join("\n").into_bytes()
}

/// Each row is bad in another way.
const BAD_ROWS: &str = "\u{feff}# by hand
t,motion,a,b,c,d,e,f,x,y,z,mx,my,mz,qw,qx,qy,qz
1,\"a, b\",1,2,3,4,5,6,0,0,0,0,0,0,1,0,0,0
0,back,1,2,3,4,5,6,0,0,0,0,0,0,1,0,0,0
2,nan,nan,2,3,4,5,6,0,0,0,0,0,0,1,0,0,0
3,short,1,2
4,no turn,1,2,3,4,5,6,0,0,0,0,0,0,0,0,0,0
5,far,1,2,3,4,5,6,1e300,-1e300,0,0,0,0,1e200,1e200,0,0
";
