//! Files of robots, shapes, clouds and recordings.

use std::fmt::Write as _;
use std::io::{self, Cursor, Read, Write as _};

use hdf5_pure::FileBuilder;
use serde_json::{Value, json};
use tdcr::sim::robot::RobotSpec;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

pub const ROBOT: &str = include_str!("../../sim/robots/2m.toml");
pub const BY_HAND: &str = include_str!("../../sim/tests/data/by_hand/robot.xml");
pub const STL: &str = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
                   endloop\nendfacet\nendsolid s\n";
pub const PCD: &str = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 2\nDATA ascii\n1 2 3\n4 5 6\n";
pub const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                   end_header\n1 2 3\n4 5 6\n";

/// Colours in floats, under names that not all programs use.
pub const COLORED_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
                   property float z\nproperty float diffuse_red\nproperty float diffuse_green\n\
                   property float diffuse_blue\nend_header\n1 2 3 0.25 0 1\n4 5 6 0 0.5 0\n";
pub const COLORED_PCD: &str =
    "FIELDS x y z r g b\nSIZE 4 4 4 1 1 1\nTYPE F F F U U U\nPOINTS 1\nDATA ascii\n1 2 3 4 5 6\n";
pub const STUDY: &str = "want = [\"tip\", \"manipulability\"]\n[[vary]]\nwhat = \"payload\"\n\
                     range = [0.0, 0.1]\nsteps = 3\n[[vary]]\nwhat = \"command\"\n[sample]\ncount = 4\n";

/// Obstacles of all shapes but meshes.
pub const SHELF: &str = include_str!("../../examples/scenes/shelf.toml");

/// A text behind a byte order mark.
pub fn marked(text: &[u8]) -> Vec<u8> {
    ["\u{feff}".as_bytes(), text].concat()
}

pub fn json_of(value: &impl serde::Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("plain values serialise")
}

pub fn two_modules() -> RobotSpec {
    RobotSpec::standard("2m").expect("a standard robot")
}

pub fn meta() -> Value {
    json!({
        "format": 2, "tdcr_version": "0.1.0", "seed": 0, "count": 10, "motors": 2, "points_per_cloud": 5,
        "samples_per_shard": 250, "origin": {"imported": {"source": "a test"}},
    })
}

/// The first of so many parts.
pub fn part_of(of: u64, meta: Value) -> Value {
    json!({"part": 1, "of": of, "meta": meta})
}

/// `count` elements one within the other.
pub fn nested(start: &str, tag: &str, count: usize) -> Vec<u8> {
    format!("{start}{}", format!("<{tag}>").repeat(count)).into()
}

/// An element of `count` attributes.
pub fn attributes(tag: &str, count: usize) -> Vec<u8> {
    let mut text = format!("<{tag}");
    for k in 0..count {
        let _ = write!(text, " a{k}=\"0\"");
    }
    format!("{text}/>").into()
}

pub fn binary_stl() -> Vec<u8> {
    let corners: [f32; 12] = [0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0.];
    let corners = corners.iter().flat_map(|x| x.to_le_bytes());
    let head = [0; 80].into_iter().chain(1_u32.to_le_bytes());
    head.chain(corners).chain([0; 2]).collect()
}

pub fn binary_ply() -> Vec<u8> {
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
                  property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    [header.as_bytes(), &[0; 30]].concat()
}

pub fn pcd(counts: &str, points: usize, bytes: usize) -> Vec<u8> {
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
pub fn long_name() -> Vec<u8> {
    let name = "n".repeat(1_000_000);
    format!(
        "FIELDS x y z {name}\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 4096\nPOINTS 1\nDATA ascii\n"
    )
    .into()
}

/// The header of an array of `rows` points.
pub fn npy_header(rows: usize, descr: &str) -> Vec<u8> {
    npy_of([rows, 3], descr)
}

/// The header of an array of any shape.
pub fn npy_of<const N: usize>(shape: [usize; N], descr: &str) -> Vec<u8> {
    let sizes: String = shape.iter().map(|size| format!("{size}, ")).collect();
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({sizes}), }}");
    text += &" ".repeat(63 - (10 + text.len()) % 64);
    text += "\n";
    let length = (text.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], text.as_bytes()].concat()
}

/// An archive of `rows` points, all zeros.
pub fn archive(rows: usize, method: CompressionMethod) -> Vec<u8> {
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

/// An archive of `clouds` of `points` points each and their colours, all zeros.
pub fn predictions(clouds: usize, points: usize) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    let mut write = |name: &str, header: Vec<u8>, bytes: usize| -> io::Result<()> {
        writer.start_file(name, options)?;
        writer.write_all(&header)?;
        io::copy(&mut io::repeat(0).take(bytes as u64), &mut writer).map(drop)
    };
    let (shape, count) = ([clouds, points, 3], 3 * clouds * points);
    write("points.npy", npy_of(shape, "<f4"), 4 * count).expect("memory can be written");
    write("rgb.npy", npy_of(shape, "|u1"), count).expect("memory can be written");
    write("commands.npy", npy_of([clouds, 2], "<f4"), 8 * clouds).expect("memory can be written");
    writer.finish().expect("memory can be written").into_inner()
}

/// A shard of `samples` clouds of `points` points and two motors, all zeros.
pub fn zeros(samples: u64, points: u64, deflate: Option<u32>) -> Vec<u8> {
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

/// Priors of a group and of an unknown.
pub const PRIORS: &str = "[lag]\nvalue = 0.1\nspread = 0.02\nunit = \"s\"\n\n[\"gain of servo 1\"]\nbounds = [0.9, 1.1]\n";

/// Names of the columns of `columns.toml`.
pub const NAMES: &str = "t,motion,a,b,c,d,e,f,x,y,z,mx,my,mz,qw,qx,qy,qz";

/// A recording with these columns.
pub fn recording(separator: &str) -> Vec<u8> {
    let row =
        |k: usize| format!("{k},up and down,1,180,0,0.1,-3,{k}e-3,0,0,2{k}0,0,0,0.1,1,0,0,0.1");
    let rows = std::iter::once(NAMES.to_owned()).chain((0..6).map(row));
    let rows: Vec<String> = rows.map(|row| row.replace(',', separator)).collect();
    rows.join("\n").into_bytes()
}

/// Each row is bad in another way.
pub const BAD_ROWS: &str = "\u{feff}# by hand
t,motion,a,b,c,d,e,f,x,y,z,mx,my,mz,qw,qx,qy,qz
1,\"a, b\",1,2,3,4,5,6,0,0,0,0,0,0,1,0,0,0
0,back,1,2,3,4,5,6,0,0,0,0,0,0,1,0,0,0
2,nan,nan,2,3,4,5,6,0,0,0,0,0,0,1,0,0,0
3,short,1,2
4,no turn,1,2,3,4,5,6,0,0,0,0,0,0,0,0,0,0
5,far,1,2,3,4,5,6,1e300,-1e300,0,0,0,0,1e200,1e200,0,0
";

/// A MuJoCo model with what a robot touches: all shapes, pairs, exclusions, a mesh.
pub const OBSTACLES: &str = r#"<mujoco>
  <asset><mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1" scale="0.1 0.1 0.1"/></asset>
  <default><default class="thing"><geom contype="4" conaffinity="4" friction="0.3 0 0"/></default></default>
  <worldbody>
    <geom name="floor" class="thing" type="plane" size="1 1 0.1" margin="0.001"/>
    <geom class="thing" type="capsule" fromto="0 0 0 0 0 0.1" size="0.01" rgba="1 0 0 1"/>
    <geom class="thing" type="cylinder" size="0.01 0.1" pos="0.3 0 0" euler="0 90 0"/>
    <geom class="thing" type="mesh" mesh="wedge" pos="0.3 0 0"/>
    <body name="shelf" pos="0 0.2 0.1"><geom name="board" class="thing" type="box" size="0.1 0.05 0.005"/></body>
    <geom name="paired" type="sphere" size="0.02" pos="0.2 0 0.1" contype="0" conaffinity="0"/>
    <body name="disc0" pos="0 0 0.05">
      <joint type="ball" stiffness="0.1" pos="0 0 -0.02"/>
      <geom name="one" type="cylinder" size="0.02 0.005" density="500" contype="4" conaffinity="4"/>
    </body>
  </worldbody>
  <contact><pair geom1="one" geom2="paired" friction="0.2 0.2 0 0 0"/><exclude body1="shelf" body2="disc0"/></contact>
</mujoco>
"#;
